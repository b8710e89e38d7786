"""The answer of a study in sentences, the same on its page and in the terminal; its failures by cause."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vdfmu.base.arrays import Floats
from vdfmu.base.errors import UsageError, VdfmuError
from vdfmu.base.measure import number, quantity
from vdfmu.base.option import pick
from vdfmu.engine.results.verdict import DOUBTFUL, FAILED, GOOD
from vdfmu.study.options import LoopOptions
from vdfmu.study.sweeps.axes import read_axes
from vdfmu.study.sweeps.indices import indices
from vdfmu.study.sweeps.table import SearchPoints, Side, StudyTable, View, groups, view

_TIE = 0.01
"""Share by which the values of points that tie differ at most."""
_SHUFFLES, _CHANCE = 199, 0.05
"""Shuffles of a measure, and the share of them from which an axis does no more than chance."""
_NAMED = 3
"""Causes of failures that are named."""


class Answer(NamedTuple):
    """The result of a study."""

    state: str
    """``good``; ``doubtful`` if the best point is; ``failed`` if no point has a value."""
    sentences: tuple[str, ...]
    """Best point, its loops, how sure the ranking is, the axis that matters most, failures."""


def answer_of(study: StudyTable) -> Answer:
    """Return the answer of a study. The best point of a scenario of the user runs again, for its margin."""
    try:
        values = study.values()
    except UsageError:
        values = np.array([np.nan])
    failed = " ".join(_failures(study))
    if not np.isfinite(values).any():
        return Answer(FAILED, (failed or "No point has a value.",))
    search, axes = study.search, read_axes(study.facts["axes"])
    drawn = search is None and all(axis.form in ("normal", "lognormal") for axis in axes)
    state, loops = _loops(study, search)
    if search is not None and search.chosen & search.infeasible:
        state = DOUBTFUL
    if search is not None:
        first = [_chosen(study, search), *_robots(study, search, values)]
    else:
        first = [_spread(study, values)] if drawn else [_best(study, values), *_edges(study)]
    ranked = [] if drawn or study.robots > 1 else [_ranking(study, values)]
    missed = ""
    if search is not None and (count := len(search.infeasible)):
        missed = f"{count} of {len(study)} runs {'misses' if count == 1 else 'miss'} a limit or the margin."
    return Answer(state, tuple(filter(None, [*first, loops, *ranked, _influence(study), missed, failed])))


def place_of(study: StudyTable, row: Mapping[str, Any]) -> str:
    """Return the values of the axes at a point in words."""
    return ", ".join(f"{words} {_value(row[name])}" for name, words in _axes(study).items())


def _axes(study: StudyTable) -> dict[str, str]:
    """Return the axes and their words: factors have a cross behind the name."""
    return {axis.target: f"{axis.target} ×" if axis.factor else axis.target for axis in read_axes(study.facts["axes"])}


def _value(value: Any) -> str:
    return f"{value:.3g}" if isinstance(value, float) else Path(str(value)).name


def _less(value: float, other: float, unit: str) -> str:
    """Return by how much a value is less than another: times, per cent, or a difference."""
    if value > 0.0 and other > 2.0 * value:
        return f"{number(other / value)} times less than"
    if value > 0.0:
        return f"{_per_cent(1.0 - value / other)} less than"
    return f"{quantity(other - value, unit)} less than"


def _per_cent(share: float) -> str:
    return f"{100.0 * share:.2g} %" if share < 0.995 else f"{100.0 * share:.0f} %"


def _named(study: StudyTable) -> tuple[str, str]:
    """Return the first measure and its unit."""
    name = next(iter(study.facts["measures"]))
    return name, study.facts["units"].get(name, "")


def _best(study: StudyTable, values: Floats) -> str:
    (name, unit), (best, worst) = _named(study), (study.row(which) for which in ("best", "worst"))
    low, middle, high = (float(f(values)) for f in (np.nanmin, np.nanmedian, np.nanmax))
    if low == high:
        return f"{name} is {quantity(low, unit)} at each point."
    return (
        f"Best: {name} {quantity(low, unit)} at {place_of(study, best)} (point {best['point']}). "
        f"It is {_less(low, middle, unit)} the median, and {_less(low, high, unit)} the largest, "
        f"{quantity(high, unit)} at {place_of(study, worst)} (point {worst['point']})."
    )


def _spread(study: StudyTable, values: Floats) -> str:
    (name, unit), worst, finite = _named(study), study.row("worst"), values[np.isfinite(values)]
    return (
        f"{name} is {quantity(float(np.median(finite)), unit)} in the median, at most "
        f"{quantity(float(np.quantile(finite, 0.95)), unit)} in 95 % of the points, and "
        f"{quantity(float(finite.max()), unit)} at worst, {place_of(study, worst)} (point {worst['point']})."
    )


def _edges(study: StudyTable) -> Iterator[str]:
    """Yield whether the best point is at an end of an axis."""
    best = study.row("best")
    for axis in read_axes(study.facts["axes"]):
        column = study[axis.target]
        if column.dtype.kind in "iuf" and len(np.unique(column)) > 2:
            for end, words in ((column.min(), "lower"), (column.max(), "upper")):
                if best[axis.target] == end:
                    yield f"It is at the {words} end of {axis.target}: a better point may be beyond."


def _chosen(study: StudyTable, search: SearchPoints) -> str:
    point = min(search.chosen)
    place = f"{place_of(study, study.row(point))} (point {point})"
    pairs = [pair for name, pair in search.compared.items() if name.partition("[")[0] == "cost"]
    unit = study.facts["units"].get("cost", "")
    if search.chosen & search.infeasible:
        return f"The search found no values within the limits and the margin. The nearest is {place}."
    if search.chosen == search.start:
        return f"The search found nothing better than the start, cost {quantity(pairs[0][0], unit)}."
    if len(pairs) > 1:
        ratio = float(np.mean([after / before for before, after in pairs]))
        return f"Chosen: {place}. Its {len(pairs)} costs are {number(ratio)} times those at the start in the mean."
    ((before, after),) = pairs
    return (
        f"Chosen: cost {quantity(after, unit)} at {place}. It is "
        f"{_less(after, before, unit)} the cost at the start, {quantity(before, unit)}."
    )


def _robots(study: StudyTable, search: SearchPoints, values: Floats) -> Iterator[str]:
    """Yield for how many robots of several the chosen values are better than those at the start."""
    if study.robots > 1:
        of = dict(zip(study["point"].tolist(), values.tolist(), strict=True))
        better = sum(of[b] < of[a] for a, b in zip(sorted(search.start), sorted(search.chosen), strict=False))
        yield f"The chosen values are better for {better} of {study.robots} robots."


def _loops(study: StudyTable, search: SearchPoints | None) -> tuple[str, str]:
    """Return the state of the best point by its loops, and its margin in words."""
    demanded = study.facts.get("tune", {}).get("margin") if search else None
    if search is not None and demanded:
        pairs = [pair for name, pair in search.compared.items() if name.startswith("modulus[")]
        before, after = (min(pair[k] for pair in pairs) for k in (0, 1))
        # COBYQA ends at a border from either side: the tenth digit is rounding
        holds = all(pair[1] > needed - 1e-9 for pair, needed in zip(pairs, demanded, strict=True))
        words = f"It {'holds' if holds else 'misses'} the margin: the modulus margin is {after:.2g}"
        return GOOD if holds else DOUBTFUL, f"{words}, {min(demanded):.2g} demanded, {before:.2g} at the start."
    from vdfmu.study.analysis.loops import judged, run_along
    from vdfmu.study.verdict import loop_sentences
    from vdfmu.system.scenario import load_scenario

    try:
        options = study.options(min(search.chosen) if search else "best")
        if options.pop("units", None):
            return GOOD, ""  # the loops of other units need a run of the whole system
        scenario = load_scenario(options["scenario"], options.get("robot"))
        kept = pick(LoopOptions, options)
        with run_along(scenario, **kept) as (poses, grid, failed):
            figures = judged(poses, grid.begin, grid.end, failed=bool(failed)).figures
    except VdfmuError:
        return GOOD, ""
    state, sentences = loop_sentences(figures)
    if state != GOOD:
        return DOUBTFUL, f"The best point: {sentences[0]}."
    margin = figures.get("margin")
    return GOOD, f"The best point has a modulus margin of {margin['value']:.2g}." if margin else ""


def _ranking(study: StudyTable, values: Floats) -> str:
    points, allowed = study["point"], np.isfinite(values)
    if study.search:
        allowed &= ~np.isin(points, [*study.search.infeasible])
    finite = np.sort(values[allowed])
    if len(finite) < 2:
        return ""
    gap = (finite[1] - finite[0]) / abs(finite[0]) if finite[0] else np.inf
    second = points[allowed][np.argsort(values[allowed], kind="stable")[1]]
    if tied := int(np.sum(finite[1:] - finite[0] <= _TIE * abs(finite[0]))):
        return f"{tied} other point{' ties' if tied == 1 else 's tie'} with it, within {100.0 * _TIE:.0f} %."
    return f"The ranking is clear: the next, point {second}, has {_per_cent(gap)} more." if gap < np.inf else ""


def _influence(study: StudyTable) -> str:
    """Return the axis that matters most, and whether chance does as much."""
    try:
        shown = view(study)
    except UsageError:
        return ""
    sides, (name, unit) = shown.sides, _named(study)
    if study.facts["sample"] == "saltelli" and not shown.failed.any():
        try:
            total = indices(study, name)
        except UsageError:
            return ""
        k = int(np.argmax(total.values["total"]))
        share, width = 100.0 * total.values["total"][k], 100.0 * total.widths["total"][k]
        return f"{total.axes[k]} matters most: {share:.2g} ± {width:.1g} % of the variance of {name}."
    names = [side.name.removesuffix(" (factor)") for side in sides]
    means = [[mean for _, mean in groups(side, shown.value)] for side in sides]
    if len(sides) == 1:
        steps, axis = np.sign(np.diff(means[0])), names[0]
        if sides[0].words or not steps.any() or steps.min() < 0.0 < steps.max():
            return ""
        return f"{name} {'falls' if steps.min() < 0.0 else 'rises'} as {axis} grows."
    ends = [f"from {quantity(min(each), unit)} to {quantity(max(each), unit)}" for each in means[:2]]
    chance = _chance(shown)
    if chance > _CHANCE:
        return (
            f"No axis stands out: {names[0]} moves the mean of {name} most, {ends[0]}, and in "
            f"{100.0 * chance:.0f} % of shuffles chance does as much."
        )
    return f"{names[0]} matters most: it moves the mean of {name} {ends[0]}, {names[1]} {ends[1]}."


def _chance(shown: View) -> float:
    """Return in which share of shuffles of the points' ranks the means over any axis differ as much as over the first.

    Ranks, since a few large values would hide the order of the others.
    """
    good, rng = np.isfinite(shown.value.values), np.random.default_rng(0)
    over = [replace(side, values=side.values[good]) for side in shown.sides]
    ranks = np.unique(shown.value.values[good], return_inverse=True)[1].astype(float)

    def spread(y: Floats, sides: Sequence[Side]) -> float:
        value = replace(shown.value, values=y)
        return max(float(np.ptp([mean for _, mean in groups(side, value)])) for side in sides)

    least = (1.0 - 1e-12) * spread(ranks, over[:1])  # a shuffle sums equal values in another order
    return (1 + sum(spread(rng.permutation(ranks), over) >= least for _ in range(_SHUFFLES))) / (1 + _SHUFFLES)


_CAUSES = {
    r"unstable": "unstable loop",
    r"internal step reached its minimum": "solver of {}: its step reached the minimum, as of an unstable loop",
    r"not finite": "values of {} are not finite",
    r"time.?limit|took longer": "took longer than the time limit",
}
"""Pattern of the message of a failed run to the cause in words; {} is the component."""


class FailedGroup(NamedTuple):
    """Points that failed for one cause."""

    cause: str
    points: Sequence[int]
    where: str
    """Ranges of the axes, if they are narrower than over all points."""
    message: str
    """Message of the first point."""


def _failures(study: StudyTable) -> Iterator[str]:
    """Yield how many points failed, and the most frequent causes."""
    if not (each := failed_groups(study)):
        return
    causes = [f"{g.cause} ({', '.join(filter(None, (str(len(g.points)), g.where)))})" for g in each[:_NAMED]]
    causes += [f"{len(each) - _NAMED} other causes"] if len(each) > _NAMED else []
    yield f"{len(study.failed)} of {len(study)} points failed: {'; '.join(causes)}."


def cause_of(message: str) -> str:
    """Return the cause that a message shares with other points: its text without numbers and elements."""
    component = re.split(": | failed at ", message, maxsplit=1)[0]
    for pattern, words in _CAUSES.items():
        if re.search(pattern, message):
            return words.format(component)
    return re.sub(r"-?\d+(\.\d+)?(e[-+]?\d+)?", "…", message.splitlines()[0])[:160]


def failed_groups(study: StudyTable) -> list[FailedGroup]:
    """Return the failed points by cause, the most frequent first."""
    causes: dict[str, list[int]] = {}
    failed = study.failed
    for point, message in failed.items():
        causes.setdefault(cause_of(message), []).append(point)
    if not failed:
        return []
    points = study["point"]
    columns = {words: study[axis] for axis, words in _axes(study).items()}
    failures: list[FailedGroup] = []
    for cause, members in sorted(causes.items(), key=lambda item: -len(item[1])):
        chosen = np.isin(points, members)
        ranges = [words for axis, values in columns.items() if (words := _range(axis, values, values[chosen]))]
        failures.append(FailedGroup(cause, members, ", ".join(ranges), failed[members[0]]))
    return failures


def _range(axis: str, values: NDArray[Any], chosen: NDArray[Any]) -> str:
    """Return the range of an axis in words; empty if all points have the same range."""
    if values.dtype.kind not in "iuf":
        words = sorted(set(map(str, chosen)))
        return f"{axis} {', '.join(words)}" if len(words) < len(set(map(str, values))) else ""
    low, high = chosen.min(), chosen.max()
    if low == values.min() and high == values.max():
        return ""
    return f"{axis} {low:.3g}" + (f" to {high:.3g}" if high > low else "")
