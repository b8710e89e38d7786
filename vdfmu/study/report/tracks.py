"""Tracks of a page's sliders: the verdict on the sampled loops as a function of the gains of a controller.

One slider is moved at a time, for all joints. The gains of a controller only scale the feedback of the loops, so the
loops with another gain are calculated from the loops of the recorded run; only the states of that run would differ. If
a run is judged without dry friction, so are its tracks. Other parameters have no track, because they change the run's
motion, and neither have gains of single joints, because finding the smallest margin of each at all rows would take
seconds.

A track is green where the margins are within the limits of :mod:`vdfmu.study.limits`, amber where they are not, and
red where the loops are unstable.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np

from vdfmu.base.arrays import Floats
from vdfmu.base.cache import cache_folder, load, store
from vdfmu.base.errors import UsageError, VdfmuError
from vdfmu.base.files import digest_of
from vdfmu.base.sources import source_digest
from vdfmu.engine.linear.growth import Poses, growth_of
from vdfmu.engine.linear.linearise import can_change
from vdfmu.engine.linear.loops import Loop, margins_of, rates_of
from vdfmu.engine.run import Simulator
from vdfmu.study.analysis.arm_space import least_dry_friction
from vdfmu.study.analysis.loops import TIED, place_of

NOTCHES = 100.0
"""Places of a slider on either side of 0, where its factor is 1."""
_COARSE, _NEAR, _LIMIT = 12.5, 6.25, 1.5625
"""Largest distance between places whose figures are calculated, and the smallest distance to which it is halved where
figures are not linear or stability ends: 4 % of a factor of up to 10."""
_STRAIGHT = np.array([2e-3, 2e-2])
"""Largest deviations of margin and delay margin [samples] from a straight line."""
_LATE = 1.5
"""Delay margin [samples] above which its value does not affect verdicts."""
_PROBES, _EVERY = (12.5, 25.0, 50.0, NOTCHES), 2
"""Places on either side at which every second row is judged, up to the first unstable one. All other places are judged
only at the rows that were worst at these places and in the run."""
_ROUNDING = 1e-9
"""Relative rounding of derivatives that are proportional to a gain."""

Names = Mapping[str, Mapping[str, float]]
"""Values in the run, by component and parameter."""
Track = dict[str, Any]
Slopes = Mapping[tuple[int, ...], Floats]
"""Change of the loops' feedback, by its shape."""
Figures = dict[str, Any]
"""See :attr:`vdfmu.study.analysis.loops.Judged.figures`."""


def factor(slider: Mapping[str, Any], place: float) -> float:
    """Return the factor of a place of a slider, as ``web/slider.js`` does."""
    share = abs(place) / NOTCHES
    if place > 0:
        return slider["most"] ** share
    return slider["least"] ** share if slider["least"] else 1.0 - share


def tracks(
    package: Path,
    algorithm: str,
    sliders: Sequence[Mapping[str, Any]],
    parameters: Names,
    span: tuple[float, float, float],
    dry: bool = True,
    poses: Poses | None = None,
) -> list[Track | None]:
    """Return the track of each slider, None for a slider without one.

    A track has ``places``; ``figures``, the numbers by which a verdict judges the loops at each; ``limits``, the lowest
    and the highest place with stable loops, or None; and ``still`` if dry friction is omitted.

    `span` is the start, stop and step of the run [s]. If `dry`, the run is judged with the arms' dry friction. `poses`
    are the loops of the run, recorded with `again`; without them the run is repeated.
    """
    facts = [source_digest("study.report.tracks"), algorithm, sliders, parameters, span, dry]
    digest = sha256(json.dumps(facts).encode() + digest_of(package).encode()).hexdigest()
    path = cache_folder() / "tracks" / digest
    if (stored := load(path, json.loads)) is not None and len(stored) == len(sliders):
        return stored
    still = {} if dry else {unit: least_dry_friction(values) for unit, values in parameters.items()}
    still = {unit: values for unit, values in still.items() if values}
    start, stop, step = span
    made: list[Track | None] = [None] * len(sliders)
    try:
        with Simulator(package, algorithm=algorithm) as simulator:
            if poses is None or not poses.seconds:
                poses = Poses("tau", TIED, again=True)
                simulator.run(start=start, stop=stop, step=step, record=(), taps=[poses])
            elif not poses.lacking:
                poses.components = simulator.stand(step=step)
            if not poses.lacking:
                loops = _MovedLoops(poses, parameters, still, (start, stop))
                made = [_track(loops, slider) if slider["gain"] else None for slider in sliders]
    except VdfmuError:  # there are no loops, or no directional derivatives
        pass
    store(path, json.dumps(made).encode())
    return made


class _MovedLoops:
    """The loops of a run from a start to an end [s], and with other gains."""

    def __init__(
        self, poses: Poses, parameters: Names, still: Mapping[str, Mapping[str, float]], span: tuple[float, float]
    ) -> None:
        assert poses.components is not None
        self.checked = poses.components.exchange.checked
        self.parameters, self.still, self.span, self._poses = parameters, still, span, poses
        self.along = along = poses.changed(still) if still else poses.loops
        if along.lacking:
            raise UsageError(along.lacking)
        self.alike = {pose.loop.K.shape: (row, pose.loop) for row, pose in enumerate(along.rows) if pose.loop}
        """A row with its loop for each number of states."""
        at = [(pose.loop, pose.time) for pose in along.poses if pose.loop and pose.loop.K.shape in self.alike]
        self.loops, self.times = [loop for loop, _ in at], [time for _, time in at]
        self.every = range(len(self.loops))
        of_run = [(loop.rate, loop.modulus, loop.delay) for loop in self.loops]  # most are known from the run
        self.recorded, self.worst = self._figures({}, self.every, *map(np.array, zip(*of_run, strict=True)))

    def slopes(self, slider: Mapping[str, Any]) -> Slopes:
        """Return the change of the feedback if a slider adds 1 to its factor.

        It is empty if the slider changes anything but the feedback, or changes the feedback nonlinearly.
        """
        if not all(can_change(self.checked, target["unit"]) for target in slider["targets"]):
            return {}
        slopes: list[list[Floats]] = []
        for by in (factor(slider, place) for place in (-NOTCHES, NOTCHES)):
            changes = {unit: dict(values) for unit, values in self.still.items()}
            for target in slider["targets"]:
                values = self.parameters[target["unit"]].items()
                new = {name: by * value for name, value in values if target["name"] in (name, name.partition("[")[0])}
                changes.setdefault(target["unit"], {}).update(new)
            moved = self._poses.moved(changes, [row for row, _ in self.alike.values()])
            pairs = [(more, loop) for more, (_, loop) in zip(moved, self.alike.values(), strict=True)]
            if not all(
                np.array_equal(*each) for more, loop in pairs for each in zip(more.plant, loop.plant, strict=True)
            ):
                return {}
            slopes.append([(more.K - loop.K) / (by - 1.0) for more, loop in pairs])
        alike = all(map(partial(np.allclose, rtol=_ROUNDING, atol=0.0), *slopes))
        return dict(zip(self.alike, slopes[0], strict=True)) if alike else {}

    def moved(self, more: Slopes, rows: Sequence[int]) -> list[Loop]:
        """Return the loops at rows with more feedback; inputs without feedback stay so."""
        loops = [self.loops[row] for row in rows]
        if not more:
            return loops
        return [
            replace(loop, K=loop.K + np.where(loop.K.any(axis=1, keepdims=True), more[loop.K.shape], 0.0))
            for loop in loops
        ]

    def judged(self, more: Slopes, rows: Sequence[int]) -> tuple[Figures, set[int]]:
        """Return the figures of the loops at rows with more feedback, and the rows that determine them."""
        return self._figures(more, rows, *margins_of(self.moved(more, rows), least=True))

    def _figures(
        self, more: Slopes, rows: Sequence[int], rates: Floats, modulus: Floats, delay: Floats
    ) -> tuple[Figures, set[int]]:
        first = self.loops[0]
        figures = self._growth(more) if rates.max() > 0.0 else {}
        margins = {"margin": modulus} | ({"delay": delay / first.step} if first.sampled else {})
        margins = {key: values for key, values in margins.items() if np.isfinite(values).any()}
        worst = {rows[int(values.min(axis=1).argmin())] for values in margins.values()}
        if "unstable" in figures:
            return figures, {rows[int(rates.argmax())]}
        return figures | {key: self._least(values, rows) for key, values in margins.items()}, worst

    def _least(self, values: Floats, rows: Sequence[int]) -> Figures:
        row, loop = (int(each) for each in np.unravel_index(values.argmin(), values.shape))
        return {"value": round(float(values[row, loop]), 5), **self._at(loop, self.times[rows[row]])}

    def _at(self, loop: int, time: float) -> dict[str, Any]:
        return {"place": place_of(self.along.opened_at(loop), self.along), "at_s": round(time, 6)}

    def _growth(self, more: Slopes) -> Figures:
        rates = rates_of(loops := self.moved(more, self.every))
        fastest = loops[int(np.argmax(rates))]
        growth = growth_of(self.times, rates, *self.span)
        if growth.unstable:
            grows = math.exp(min(growth.rate * fastest.step, 700.0))
            return {"unstable": {"value": grows, **self._at(fastest.fastest, growth.begin)}}
        slow = growth_of(self.times, rates, self.times[0], self.times[-1], 0.0)
        ends = {**self._at(fastest.fastest, slow.begin), "until_s": slow.end}
        return {"growth": {"value": math.expm1(slow.exponent), **ends}} if slow.notable else {}


def _track(loops: _MovedLoops, slider: Mapping[str, Any]) -> Track | None:
    slopes = loops.slopes(slider)
    if not any(slope.any() for slope in slopes.values()):  # none of the slider's parameters is in a loop
        return None

    at, worst = {0.0: loops.recorded}, loops.worst.copy()

    def figures(place: float, rows: Sequence[int]) -> Figures:
        if place not in at:
            more = factor(slider, place) - 1.0
            at[place], decide = loops.judged({shape: more * slope for shape, slope in slopes.items()}, rows)
            worst.update(decide)
        return at[place]

    def halve(near: float, far: float) -> None:
        """Add places between two if stability ends there, or if the margin is not a straight line."""
        pair, distance = (figures(near, rows), figures(far, rows)), abs(far - near)
        margins = np.array([_margins(each) for each in pair])
        ends = len({(margin > 0.0, "unstable" in each) for (margin, _), each in zip(margins, pair, strict=True)}) > 1
        if distance <= (_LIMIT if ends else _NEAR) or not margins.any() and not ends:
            return
        middle = (near + far) / 2.0
        bent = np.abs(_margins(figures(middle, rows)) - margins.mean(axis=0)) > _STRAIGHT
        if ends or bent.any() or distance > _COARSE:
            halve(near, middle)
            halve(middle, far)

    for side in (-1.0, 1.0):
        for place in _PROBES:
            if "unstable" in figures(side * place, sorted({*loops.every[::_EVERY], *worst})):
                break
    rows = sorted(worst)
    halve(0.0, -NOTCHES)
    halve(0.0, NOTCHES)
    places = sorted(at)
    stable = [place for place in places if _margins(at[place])[0]]
    ends = (stable[0], stable[-1]) if stable else (0.0, 0.0)
    limits = [None if abs(end) == NOTCHES else end for end in ends]
    track = {"places": places, "figures": [at[place] for place in places], "limits": limits}
    return track | {"still": True} if loops.still else track


def _margins(figures: Figures) -> Floats:
    """Return modulus and delay margin; 0 without."""
    margin, delay = (figures.get(key, {}).get("value", 0.0) for key in ("margin", "delay"))
    return np.array([margin, min(delay, _LATE)])
