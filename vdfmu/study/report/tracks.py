"""Tracks of a page's sliders: what a verdict says of the sampled loops along each gain of a controller.

Each slider is moved alone. The gains of a controller act on the feedback of the loops alone, and in proportion: the
loops of the run, with more or less of a gain, are those of another run but for its states. A run that is judged without
dry friction is taken without it. Other parameters have no track, since they change the motion of the run.

A track is green where margins keep the limits of :mod:`vdfmu.study.limits`, amber below them, and red where there are
none.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from hashlib import sha256
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from vdfmu.base.arrays import Floats
from vdfmu.base.cache import cache_folder, load, store
from vdfmu.base.errors import UsageError, VdfmuError
from vdfmu.base.state_space import Linear
from vdfmu.compiler.functions.sources import source_digest
from vdfmu.engine.linear.growth import Poses, growth_of
from vdfmu.engine.linear.linearise import can_change
from vdfmu.engine.linear.loops import Loop, rates_of
from vdfmu.engine.package.system import Value
from vdfmu.engine.run import Simulator
from vdfmu.study.analysis.arm_space import least_dry_friction
from vdfmu.study.analysis.loops import TIED, Judged, place_of

NOTCHES = 100
"""Places of a slider to either side of 0. Its factor at 0 is 1."""
_PLACES = range(-NOTCHES, NOTCHES + 1, NOTCHES // 4)
_HALVINGS = 4
"""Of the distance of two places, for the limit of stability: to 1.6 notches, 4 % of a factor of up to 10."""
_SMOOTH, _STRAIGHT = 2, 2e-3
"""Most halvings of the distance of two places between which the margin is not a straight line, to this difference."""
_PROBES, _LATE, _EVERY, _FINE = (-NOTCHES, -NOTCHES // 2, NOTCHES // 2), -NOTCHES // 2, 6, 0.15
"""Places of a slider for which the row with the least modulus margin is looked for, and that for the delay margin:
among every sixth row, and that of the modulus then closer, to a sixth of the distance of two rows. All places are tried
at these rows and those of the run's least margins. Beyond the places there is seldom a margin."""
_JOINTS = 8
"""Most joints that have a track each."""
_ROUNDING = 1e-9
"""Rounding of derivatives that are in proportion, relative."""

Names = Mapping[str, Mapping[str, float]]
"""Component, to parameter, to its value in the run."""
Track = dict[str, Any]
Slopes = Mapping[tuple[int, ...], Floats]
"""Shape of a loop's feedback, to its change."""
Figures = dict[str, Any]
"""See :attr:`vdfmu.study.analysis.loops.Judged.figures`."""


def factor(knob: Mapping[str, Any], place: float) -> float:
    """Return the factor of a place of a slider, as ``web/knob.js`` does."""
    share = abs(place) / NOTCHES
    if place > 0:
        return knob["most"] ** share
    return knob["least"] ** share if knob["least"] else 1.0 - share


def tracks(
    package: Path, algorithm: str, knobs: Sequence[Mapping[str, Any]], parameters: Names,
    span: tuple[float, float, float], dry: bool = True, poses: Poses | None = None,
) -> list[list[Track | None]]:  # fmt: skip
    """Return the tracks of each slider: of all joints, then of each joint; [None] without tracks.

    A track has ``places``; ``figures``, the numbers by which a verdict judges the loops at each; and in ``limits`` the
    lowest and the highest place with stable loops, or None; ``still`` if arms are taken without dry friction.

    `span` has start, stop and step of the run [s]. `dry`: the run is judged with the dry friction of its arms. `poses`
    are the loops of the run, taken with `again`; without them, the run is repeated.
    """
    facts = [source_digest("study.report.tracks"), algorithm, knobs, parameters, span, dry]
    digest = sha256(json.dumps(facts).encode() + sha256(package.read_bytes()).digest()).hexdigest()
    path = cache_folder() / "tracks" / digest
    if (stored := load(path, json.loads)) is not None and len(stored) == len(knobs):
        return stored
    still = {} if dry else {unit: least_dry_friction(values) for unit, values in parameters.items()}
    still = {unit: values for unit, values in still.items() if values}
    start, stop, step = span
    made = [list[Track | None]([None]) for _ in knobs]
    try:
        with Simulator(package, algorithm=algorithm) as simulator:
            if poses is None or not poses.seconds:
                poses = Poses("tau", TIED, again=True)
                simulator.run(start=start, stop=stop, step=step, record=(), taps=[poses])
            elif not poses.lacking:
                poses.components = simulator.stand(step=step)
            if not poses.lacking:
                loops = _MovedLoops(poses, parameters, still, (start, stop))
                made = [list(_of_knob(loops, knob)) for knob in knobs]
    except VdfmuError:  # without loops, or without directional derivatives
        pass
    store(path, json.dumps(made).encode())
    return made


class _MovedLoops:
    """The loops of a run from a begin to an end [s], and at some of its rows those with other gains."""

    def __init__(
        self, poses: Poses, parameters: Names, still: Mapping[str, Mapping[str, Value]], span: tuple[float, float]
    ) -> None:
        assert poses.components is not None
        self.checked = poses.components.exchange.checked
        self.parameters, self.still, self.span, self._poses = parameters, still, span, poses
        self.along = along = poses.changed(still) if still else poses.loops
        if along.nearest() is None:
            raise UsageError(along.lacking)
        self.figures = Judged(along, along.growth(*span)).figures
        self.loops = loops = [pose.loop for pose in along.rows if pose.loop is not None]
        self.times = [pose.time for pose in along.rows]
        modulus = np.array([loop.modulus for loop in loops])
        self.rows = [
            self._narrowed(row, lambda row, i=i: (self.loop_at(row).modulus[i],))
            for i, row in enumerate(modulus.argmin(axis=0).tolist())
        ]
        """The rows of the least modulus margin of each loop in the run, of the fastest growth, of the least delay."""
        self.rows.append(max(range(len(loops)), key=lambda row: loops[row].rate))
        self.latest = min(range(len(loops)), key=lambda row: loops[row].margins().delay.min())
        self.alike = {loop.K.shape: row for row, loop in enumerate(loops)}
        """A row for each number of states."""

    def moved(self, knob: Mapping[str, Any], by: float, joint: int, rows: Sequence[int]) -> list[Loop]:
        """Return the loops at rows with the parameters of a slider, of all joints or of one, times a factor."""
        changes = {unit: dict(values) for unit, values in self.still.items()}
        for target in knob["targets"]:
            for name, value in self.parameters[target["unit"]].items():
                group, _, index = name.partition("[")
                if group == target["name"] and (not joint or index == f"{joint}]"):
                    changes.setdefault(target["unit"], {})[name] = by * value
        return self._poses.moved(changes, rows)

    def loop_at(self, row: float) -> Loop:
        """Return the loop at a row, or on a straight line between two rows with as many states."""
        k, share = int(row), row % 1.0
        if not share:
            return self.loops[k]
        pair = self.loops[k : k + 2]
        A, B, K = (
            (1.0 - share) * before + share * after
            for before, after in zip(*((*loop.plant, loop.K) for loop in pair), strict=True)
        )
        return replace(pair[0], plant=Linear(A, B), K=K)

    def with_more(self, row: float, by: float, slopes: Slopes) -> Loop:
        """Return the loop at a row with a factor on gains; inputs that have no feedback there keep none."""
        loop = self.loop_at(row)
        more = (by - 1.0) * slopes[loop.K.shape]
        return replace(loop, K=loop.K + np.where(np.any(loop.K, axis=1, keepdims=True), more, 0.0))

    def worst(self, knob: Mapping[str, Any], slopes: Slopes) -> tuple[list[float], list[float]]:
        """Return the rows at which a slider is tried: for its modulus margins, and more rows for its delay margins."""

        def nearness(row: float) -> tuple[float, float]:
            loop = self.with_more(row, by, slopes)
            return loop.least, -loop.rate

        tried = [row for row in range(0, len(self.loops), _EVERY) if self.loops[row].K.shape in slopes]
        rows = [*self.rows]
        for place in _PROBES:
            by = factor(knob, place)
            rows.append(self._narrowed(min(tried, key=nearness), nearness))
        by = factor(knob, _LATE)
        late = min(tried, key=lambda row: self.with_more(row, by, slopes).margins().delay.min())
        return [*dict.fromkeys(rows)], [self.latest, late]

    def _narrowed(self, row: float, of: Callable[[float], tuple[float, ...]]) -> float:
        """Return the place near a row, also between rows with as many states, where a number is least."""
        step = _EVERY / 2.0
        while step >= _FINE:
            around = [each for each in (row - step, row + step) if 0.0 <= each <= len(self.loops) - 1]
            shapes = [{loop.K.shape for loop in self.loops[int(each) : math.ceil(each) + 1]} for each in around]
            row = min([row, *(each for each, alike in zip(around, shapes, strict=True) if len(alike) == 1)], key=of)
            step /= 2.0
        return row

    def same_plant(self, row: int, loop: Loop) -> bool:
        """Whether a loop differs from the run's in its feedback at most."""
        return all(np.array_equal(*pair) for pair in zip(loop.plant, self.loops[row].plant, strict=True))

    def feedback(self, knob: Mapping[str, Any], joint: int = 0) -> Slopes:
        """Return by how much the feedback changes if a slider, of all joints or of one, adds 1 to its factor.

        Empty if the slider changes more than the feedback, or this not in proportion.
        """
        rows = [*self.alike.values()]
        slopes: list[list[Floats]] = []
        for by in (factor(knob, place) for place in (-NOTCHES, NOTCHES)):
            loops = self.moved(knob, by, joint, rows)
            if not all(map(self.same_plant, rows, loops)):
                return {}
            slopes.append([(loop.K - self.loops[row].K) / (by - 1.0) for row, loop in zip(rows, loops, strict=True)])
        if not all(map(partial(np.allclose, rtol=_ROUNDING, atol=0.0), *slopes)):
            return {}
        return dict(zip(self.alike, slopes[0], strict=True))

    def figures_at(self, by: float, slopes: Slopes, rows: Sequence[float], late: Sequence[float]) -> Figures:
        """Return the figures of the loops with a factor, from some rows.

        Growth is found from all rows with as many states, if a mode grows at one of those.
        """
        moved = [self.with_more(row, by, slopes) for row in rows]
        figures: Figures = {}
        if max(loop.rate for loop in moved) > 0.0:
            figures = self._growth(by, slopes)
            if "unstable" in figures:
                return figures
        modulus = np.array([loop.modulus for loop in moved])
        least = int(modulus.min(axis=1).argmin())
        figures["margin"] = self._least(modulus, rows)
        if moved[0].sampled:
            late = [*late, rows[least]]
            delay = [self.with_more(row, by, slopes).margins().delay for row in late]
            figures["delay"] = self._least(np.array(delay) / moved[0].step, late)
        return {key: figure for key, figure in figures.items() if math.isfinite(figure["value"])}

    def _least(self, values: Floats, rows: Sequence[float]) -> Figures:
        row, loop = (int(each) for each in np.unravel_index(values.argmin(), values.shape))
        time = np.interp(rows[row], range(len(self.times)), self.times)
        return {"value": round(float(values[row, loop]), 5), "place": self._place(loop), "at_s": round(float(time), 6)}

    def _growth(self, by: float, slopes: Slopes) -> Figures:
        rows = [row for row, loop in enumerate(self.loops) if loop.K.shape in slopes]
        loops = [self.with_more(row, by, slopes) for row in rows]
        times, rates = [self.times[row] for row in rows], rates_of(loops)
        fastest = loops[int(np.argmax(rates))]
        place = self._place(fastest.fastest)
        growth = growth_of(times, rates, *self.span)
        if growth.unstable:
            grows = math.exp(min(growth.rate * fastest.step, 700.0))
            return {"unstable": {"value": grows, "place": place, "at_s": growth.begin}}
        slow = growth_of(times, rates, times[0], times[-1], 0.0)
        ends = {"place": place, "at_s": slow.begin, "until_s": slow.end}
        return {"growth": {"value": math.expm1(slow.exponent), **ends}} if slow.notable else {}

    def _place(self, loop: int) -> str:
        return place_of(self.along.opened_at(loop), self.along)


def _of_knob(loops: _MovedLoops, knob: Mapping[str, Any]) -> Iterator[Track | None]:
    able = knob["gain"] and all(can_change(loops.checked, target["unit"]) for target in knob["targets"])
    slopes = loops.feedback(knob) if able else {}
    if not any(slope.any() for slope in slopes.values()):  # none of its parameters is in a loop
        yield None
        return
    yield _track(loops, knob, slopes)
    if 1 < len(knob["values"]) <= _JOINTS:
        for joint in range(1, len(knob["values"]) + 1):
            yield _track(loops, knob, loops.feedback(knob, joint))


def _track(loops: _MovedLoops, knob: Mapping[str, Any], slopes: Slopes) -> Track:
    rows, late = loops.worst(knob, slopes)
    at: dict[float, Figures] = {0.0: loops.figures}

    def figures(place: float) -> Figures:
        if place not in at:
            at[place] = loops.figures_at(factor(knob, place), slopes, rows, late)
        return at[place]

    for low, high in pairwise(map(float, _PLACES)):
        _halve(figures, low, high)
    places = sorted(at)
    stable = [place for place in places if _margin(at[place])]
    ends = [stable[0], stable[-1]] if stable else [0.0, 0.0]
    limits = [None if end == edge else end for end, edge in zip(ends, (places[0], places[-1]), strict=True)]
    track = {"places": places, "figures": [at[place] for place in places], "limits": limits}
    return track | {"still": True} if loops.still else track


def _margin(figures: Figures) -> float:
    return figures.get("margin", {}).get("value", 0.0)


def _halve(figures: Callable[[float], Figures], low: float, high: float, depth: int = 0) -> None:
    """Add places between two: where stability ends, and where the margin is not a straight line."""
    pair = figures(low), figures(high)
    margins = [_margin(each) for each in pair]
    ends = len({(margin > 0.0, "unstable" in each) for margin, each in zip(margins, pair, strict=True)}) > 1
    if depth >= (_HALVINGS if ends else _SMOOTH) or not any(margins) and not ends:
        return
    middle = (low + high) / 2.0
    between = _margin(figures(middle))
    if ends or abs(between - sum(margins) / 2.0) > _STRAIGHT:
        _halve(figures, low, middle, depth + 1)
        _halve(figures, middle, high, depth + 1)
