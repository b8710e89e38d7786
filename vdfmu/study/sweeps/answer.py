"""The answer of a study: its verdict, and the first sentences of its page and of the command's output."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vdfmu.base.arrays import Floats
from vdfmu.base.errors import UsageError
from vdfmu.base.extras import module_of_extra
from vdfmu.base.measure import number, quantity
from vdfmu.engine.results.verdict import DOUBTFUL, FAILED, GOOD, UNJUDGED, Check, verdict_of
from vdfmu.study.sweeps.axes import read_axes
from vdfmu.study.sweeps.candidates import MOST, JudgedPoint, best_of, candidates, judge_point, neighbours
from vdfmu.study.sweeps.failures import failure_words, place_of
from vdfmu.study.sweeps.table import SearchPoints, StudyTable, View, groups, parts_of, view

_TIE = 0.01
"""Largest relative difference between points that tie, and smallest improvement by a search that is reported."""
_SHUFFLES, _CHANCE = 199, 0.05
"""Number of random shuffles of a measure, and the share of them above which an axis' effect may be chance."""
_SENSITIVITY = ("saltelli", "morris")
"""Samples of studies that ask which axis matters, not which point is best."""


class Answer(NamedTuple):
    """The result of a study."""

    verdict: dict[str, Any]
    """Verdict as for a run, see :func:`vdfmu.engine.results.verdict.verdict_of`."""
    sentences: tuple[str, ...]
    """Sentences on the best point, its robustness, how clear the ranking is, the axis that matters most, and
    failures."""
    best: int | None = None
    """Number of the best point, a good one if possible; None for a study that does not search one."""

    @property
    def state(self) -> str:
        """``good``; ``doubtful`` if no judged point is good; ``failed`` if no point has a value."""
        return self.verdict["state"]

    @property
    def headline(self) -> str:
        """The state and the reason for it, in at most 90 characters."""
        return self.verdict["headline"]


def answer_of(study: StudyTable) -> Answer:
    """Return the answer of a study. For a user's scenario the best points are run again to judge them."""
    try:
        values = study.values()
    except UsageError:
        values = np.array([np.nan])
    failed = [*failure_words(study)]
    finite = int(np.isfinite(values).sum())
    state = GOOD if finite else FAILED
    some = f"{finite} of {len(study)} points have a value" if finite else "".join(failed) or "no point has a value"
    checks, sentences = [Check("points", "Points", state, some)], [_sentence(each) for each in failed]
    if not finite:
        return Answer(verdict_of(checks), tuple(sentences))
    if study.search is not None:
        return _of_search(study, study.search, values, checks, sentences)
    axes = read_axes(study.facts["axes"])
    if study.facts["sample"] in _SENSITIVITY:
        check, influence = module_of_extra("sensitivities", "sensitivity", "the answer").matters(study)
        return Answer(verdict_of([*checks, check], influence), (_spread(study, values), *sentences))
    if all(axis.form in ("normal", "lognormal") for axis in axes):
        spread, influence = _spread(study, values), _influence(study)
        phrase = spread.partition(", and ")[0]
        return Answer(verdict_of(checks, [phrase]), tuple(filter(None, [spread, influence, *sentences])))
    judged = candidates(study, values)
    best = best_of(judged)
    check, phrases = _chosen_of(study, values, judged)
    lines = [_best(study, values, best.point), *([_sentence(check.more)] if check.more else [])]
    lines += [*_edges(study, best.point), *_around(study, values, best)]
    lines += filter(None, [_ranking(study, values, best.value), _influence(study)])
    return Answer(verdict_of([*checks, check], phrases), (*lines, *sentences), best.point)


def _sentence(phrase: str) -> str:
    return f"{phrase[:1].upper()}{phrase[1:]}."


def _chosen_of(study: StudyTable, values: Floats, judged: Sequence[JudgedPoint]) -> tuple[Check, list[str]]:
    """Return the check of the best of the judged points, and the results of a good one."""
    (name, unit), best, first = _named(study), best_of(judged), judged[0]
    point = f"{best.point} ({name} {quantity(best.value, unit)})"
    margin = [f"modulus margin {best.margin:.2g}"] if math.isfinite(best.margin) else []
    better = f"point {first.point} has {quantity(first.value, unit)} but {_how(first)}"
    if best.state == UNJUDGED:
        return Check("best", "verdict on the best point", UNJUDGED, best.why), [f"best point {point}"]
    if best.state == GOOD:
        phrases = [f"best point {point}"] if best is first else [f"best good point {point}", better]
        if margin and best is not first:
            margin = [f"point {best.point} has {margin[0]}"]
        return Check("best", "Best point", GOOD, phrases[0]), [*phrases, *margin]
    left_out = int(np.isfinite(values).sum()) - len(judged)
    tried = f"none of {len(judged)} points is good" + (f"; the other {left_out} were not judged" if left_out else "")
    state = FAILED if best.state == FAILED and not left_out else DOUBTFUL
    link = " " if best.why.startswith("unstable") else ": "
    sentence = f"best {name} {quantity(best.value, unit)} (point {best.point}){link}{best.why.partition(' (limit')[0]}"
    more = "; ".join([tried, *([better] if best is not first else [])])
    return Check("best", "Best point", state, sentence, more), []


def _how(candidate: JudgedPoint) -> str:
    """Return the fault of a point, as the end of a sentence about it."""
    if candidate.why.startswith("unstable"):
        return f"is {candidate.why}"
    why = f": {candidate.why}" if candidate.why else ""
    return f"fails{why}" if candidate.state == FAILED else f"is {candidate.state}{why}"


def _around(study: StudyTable, values: Floats, best: JudgedPoint) -> Iterator[str]:
    """Yield a sentence on whether the neighbours of a good point in a grid are good too."""
    beside = [*neighbours(study, best.point)]
    if best.state != GOOD or not 0 < len(beside) <= MOST:
        return
    of = dict(zip(study["point"].tolist(), values.tolist(), strict=True))
    judged = [
        judge_point(study, point, of[point]) if math.isfinite(of[point]) else JudgedPoint(point, of[point], FAILED)
        for point in beside
    ]
    bad = [candidate for candidate in judged if candidate.state != GOOD]
    smallest = min((c.margin for c in judged if math.isfinite(c.margin)), default=math.nan)
    margins = f", with a modulus margin of {smallest:.2g} or more" if math.isfinite(smallest) else ""
    alone = len(beside) == 1
    beside_it = "neighbour in the grid is" if alone else f"{len(beside)} neighbours in the grid are"
    if not bad:
        yield f"Its {beside_it} good too{margins}."
        return
    worst = next((c for c in bad if c.state == FAILED), bad[0])
    if len(bad) == 1:
        beside_it = beside_it.replace(" are", " is")
    begin = "Its" if alone else f"{len(bad)} of its"
    yield f"{begin} {beside_it} not good: point {worst.point} {_how(worst)}."


def _of_search(
    study: StudyTable, search: SearchPoints, values: Floats, checks: list[Check], failed: list[str]
) -> Answer:
    """Return the answer of a search: the chosen values, their margin, and the verdict on their run."""
    point, demanded = min(search.chosen), study.facts.get("tune", {}).get("margin")
    feasible = not search.chosen & search.infeasible
    if not feasible:
        missed = "no values that were tried meet the limits and the margin"
        checks.append(Check("feasible", "Limits of the search", DOUBTFUL, missed))
    if demanded:
        pairs = [pair for name, pair in search.compared.items() if name.startswith("modulus[")]
        before, after = (min(pair[k] for pair in pairs) for k in (0, 1))
        # COBYQA may stop on either side of a bound: the tenth digit is rounding
        holds = all(pair[1] > needed - 1e-9 for pair, needed in zip(pairs, demanded, strict=True))
        words = f"modulus margin {after:.2g}, {min(demanded):.2g} requested, {before:.2g} at the start"
        state = GOOD if holds else DOUBTFUL
        by = "the requested margin"
        checks.append(Check("margin", "Modulus margin", state, words, "", after, min(demanded), by))
    phrases, lines = _chosen(study, search)
    if feasible:
        chosen = judge_point(study, point, float(values[study["point"] == point][0]), ["margin"] if demanded else [])
        how = chosen.why if chosen.state == UNJUDGED else f"the chosen point {_how(chosen)}" if chosen.why else "good"
        name = "Chosen point" if chosen.state != UNJUDGED else "verdict on the chosen point"
        checks.append(Check("best", name, chosen.state, how))
        margin = chosen.margin
        phrases += [f"modulus margin {margin:.2g}"] if math.isfinite(margin) and not demanded else []
    lines += [*_robots(study, search, values), _influence(study)]
    if count := len(search.infeasible):
        lines.append(
            f"{count} of {len(study)} runs cannot be chosen: they fail, miss a limit or the margin, or have an element "
            "of the cost that is larger than at the start."
        )
    phrases += [check.sentence for check in checks if check.key == "margin" and check.state == GOOD]
    return Answer(verdict_of(checks, phrases), tuple(filter(None, [*lines, *failed])), point)


def _less(value: float, other: float, unit: str) -> str:
    """Return how far a value is below another, as a factor, in per cent, or as a difference."""
    if value > 0.0 and other > 2.0 * value:
        return f"a factor of {number(other / value)} below"
    if value > 0.0:
        return f"{_per_cent(1.0 - value / other)} below"
    return f"{quantity(other - value, unit)} below"


def _per_cent(share: float) -> str:
    return f"{100.0 * share:.2g} %" if share < 0.995 else f"{100.0 * share:.0f} %"


def _named(study: StudyTable) -> tuple[str, str]:
    """Return the first measure and its unit, which is empty for pure numbers."""
    name = next(iter(study.facts["measures"]))
    unit = study.facts["units"].get(name, "")
    return name, "" if unit == "1" else unit


def _best(study: StudyTable, values: Floats, point: int) -> str:
    """Return where a point is, and how its value compares with the others."""
    (name, unit), worst = _named(study), study.row("worst")
    value = float(values[study["point"] == point][0])
    middle, high = (float(f(values)) for f in (np.nanmedian, np.nanmax))
    place = f"Point {point}: {place_of(study, study.row(point))}"
    if float(np.nanmin(values)) == high:
        return f"{place}; {name} is {quantity(high, unit)} at each point."
    than_median = f"{_less(value, middle, unit)} the median, and " if value < middle else ""
    return (
        f"{place}. Its {name} is {than_median}{_less(value, high, unit)} the largest, "
        f"{quantity(high, unit)} at {place_of(study, worst)} (point {worst['point']})."
    )


def _spread(study: StudyTable, values: Floats) -> str:
    (name, unit), worst, finite = _named(study), study.row("worst"), values[np.isfinite(values)]
    return (
        f"{name} is {quantity(float(np.median(finite)), unit)} in the median, at most "
        f"{quantity(float(np.quantile(finite, 0.95)), unit)} in 95 % of the points, and "
        f"{quantity(float(finite.max()), unit)} at worst, {place_of(study, worst)} (point {worst['point']})."
    )


def _edges(study: StudyTable, point: int) -> Iterator[str]:
    """Yield a sentence if the best point is at an end of an axis."""
    best = study.row(point)
    for axis in read_axes(study.facts["axes"]):
        column = study[axis.target]
        if column.dtype.kind in "iuf" and len(np.unique(column)) > 2:
            for end, words in ((column.min(), "lower"), (column.max(), "upper")):
                if best[axis.target] == end:
                    yield f"It is at the {words} end of {axis.target}: a better point may lie beyond it."


def _chosen(study: StudyTable, search: SearchPoints) -> tuple[list[str], list[str]]:
    """Return the results of a search: phrases for the headline, and sentences."""
    point = min(search.chosen)
    place = f"{place_of(study, study.row(point))} (point {point})"
    pairs = [pair for name, pair in search.compared.items() if name.partition("[")[0] == "cost"]
    unit, ratio = study.facts["units"].get("cost", ""), float(np.mean([after / before for before, after in pairs]))
    if search.chosen & search.infeasible:
        return [], [f"The nearest is {place}."]
    if ratio > 1.0 - _TIE:
        start = f"cost {quantity(pairs[0][0], unit)}" if len(pairs) == 1 else f"{len(pairs)} costs"
        same = search.chosen == search.start
        more = [] if same else [f"Chosen: {place}, less than {100.0 * _TIE:.0f} % below the start."]
        return [f"no better values found than the start, {start}"], more
    if len(pairs) > 1:
        phrase = f"chosen point {point}: its {len(pairs)} costs are {number(ratio)} times those at the start"
        return [phrase], [f"Chosen: {place}."]
    ((before, after),) = pairs
    less = f"{_less(after, before, unit)} the cost at the start, {quantity(before, unit)}"
    return [f"cost {quantity(after, unit)}, {less}"], [f"Chosen: {place}."]


def _robots(study: StudyTable, search: SearchPoints, values: Floats) -> Iterator[str]:
    """Yield a sentence on the number of robots for which the chosen values are better than those at the start."""
    if study.robots > 1:
        of = dict(zip(study["point"].tolist(), values.tolist(), strict=True))
        better = sum(of[b] < of[a] for a, b in zip(sorted(search.start), sorted(search.chosen), strict=False))
        yield f"The chosen values are better for {better} of {study.robots} robots."


def _ranking(study: StudyTable, values: Floats, best: float) -> str:
    """Return how far the next value is behind that of the best good point. Smaller values are of points that fail."""
    points, allowed = study["point"], np.isfinite(values) & (values >= best)
    finite = np.sort(values[allowed])
    if len(finite) < 2:
        return ""
    gap = (finite[1] - finite[0]) / abs(finite[0]) if finite[0] else np.inf
    second = points[allowed][np.argsort(values[allowed], kind="stable")[1]]
    if tied := int(np.sum(finite[1:] - finite[0] <= _TIE * abs(finite[0]))):
        return f"{tied} other point{' ties' if tied == 1 else 's tie'} with it, within {100.0 * _TIE:.0f} %."
    more = f"{_per_cent(gap)} more" if gap < 1.0 or finite[0] < 0.0 else f"{number(1.0 + gap)} times as much"
    return f"The ranking is clear: the next, point {second}, has {more}." if gap < np.inf else ""


def _influence(study: StudyTable) -> str:
    """Return a sentence on the axis that matters most, and on whether its effect may be chance."""
    try:
        shown = view(study)
    except UsageError:
        return ""
    sides, (name, unit) = shown.sides, _named(study)
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
            f"No axis stands out: {names[0]} changes the mean of {name} most, {ends[0]}, but in "
            f"{100.0 * chance:.0f} % of random shuffles the change is as large."
        )
    return f"{names[0]} matters most: it changes the mean of {name} {ends[0]}, {names[1]} {ends[1]}."


def _chance(shown: View) -> float:
    """Return the share of shuffles of the points' ranks in which means over any axis differ as much as over the first.

    Ranks are used because a few large values would hide the order of the rest.
    """
    good, rng = np.isfinite(shown.value.values), np.random.default_rng(0)
    over = [parts_of(side.values[good], bool(side.words)) for side in shown.sides]
    ranks = np.unique(shown.value.values[good], return_inverse=True)[1].astype(float)

    def spread(y: Floats, sides: Sequence[Sequence[NDArray[np.intp]]]) -> float:
        return max(float(np.ptp([np.mean(y[part]) for part in parts])) for parts in sides)

    least = (1.0 - 1e-12) * spread(ranks, over[:1])  # a shuffle adds equal values in another order
    return (1 + sum(spread(rng.permutation(ranks), over) >= least for _ in range(_SHUFFLES))) / (1 + _SHUFFLES)
