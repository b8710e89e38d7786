"""Tracks of a page's sliders: the modulus margin of the sampled loops along each, and their limits of stability.

Each slider is moved alone, at some rows of the run: the components whose parameters it scales are linearised again with
the new ones, at the states and inputs of the run. The states of a faster or heavier arm would differ; a gain or a
stiffness acts on the loops nearly independently of them. A run that is judged without dry friction is taken without it.

A track is green where the margin keeps its limit, see :mod:`vdfmu.study.limits`, amber below it, and red where there is
none.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np

from vdfmu.arm.robot.parameters import section
from vdfmu.base.arrays import Floats
from vdfmu.base.cache import cache_folder, load, store
from vdfmu.base.errors import UsageError, VdfmuError
from vdfmu.compiler.functions.sources import source_digest
from vdfmu.engine.linear.growth import Poses
from vdfmu.engine.linear.linearise import can_change
from vdfmu.engine.linear.loops import Loop
from vdfmu.engine.package.system import Value
from vdfmu.engine.run import Simulator
from vdfmu.study.analysis.arm_space import least_dry_friction
from vdfmu.study.analysis.loops import TIED

NOTCHES = 100
"""Places of a slider to either side of 0. Its factor at 0 is 1."""
_PLACES = range(-NOTCHES, NOTCHES + 1, NOTCHES // 4)
_HALVINGS = 4
"""Of the distance of two places, for the limit of stability: to 1.6 notches, 4 % of a factor of up to 10."""
_ROWS, _SPREAD, _WORST, _FIRST = 6, 5, 2, 3
"""Rows of the run at which sliders are tried: at most, first the rows of the loops' least margins, then some evenly
spread ones; their number for the arm; and for a joint, with those of the least margins at the slider's ends."""
_JOINTS = 8
"""Most joints that have a track each."""
_ROUNDING = 1e-9
"""Rounding of derivatives that are in proportion, relative."""
_FRICTION = {row.name for row in section("friction")}
"""Parameters without a track: near standstill friction that falls with speed makes a loop grow for a moment, whatever
the motion before and after."""

Names = Mapping[str, Mapping[str, float]]
"""Component, to parameter, to its value in the run."""
Track = dict[str, Any]


def factor(knob: Mapping[str, Any], place: float) -> float:
    """Return the factor of a place of a slider, as ``web/simulation.js`` does."""
    share = abs(place) / NOTCHES
    if place > 0:
        return knob["most"] ** share
    return knob["least"] ** share if knob["least"] else 1.0 - share


def tracks(
    package: Path, algorithm: str, knobs: Sequence[Mapping[str, Any]], parameters: Names,
    span: tuple[float, float, float], dry: bool = True, poses: Poses | None = None,
) -> list[list[Track | None]]:  # fmt: skip
    """Return the tracks of each slider: of all joints, then of each joint; [None] without tracks.

    A track has ``places``, the least modulus margin at each, ``modulus``, and in ``limits`` the lowest and the highest
    place with stable loops, or None; ``still`` if arms are taken without dry friction.

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
                loops = _MovedLoops(poses, parameters, still)
                made = [list(_of_knob(loops, knob)) for knob in knobs]
    except VdfmuError:  # without loops, or without directional derivatives
        pass
    store(path, json.dumps(made).encode())
    return made


class _MovedLoops:
    """The loops of a run, and at some of its rows those with the parameters of a slider."""

    def __init__(self, poses: Poses, parameters: Names, still: Mapping[str, Mapping[str, Value]]) -> None:
        assert poses.components is not None
        self.checked = poses.components.exchange.checked
        self.parameters, self.still, self._poses = parameters, still, poses
        along = poses.changed(still) if still else poses.loops
        nearest = along.nearest()
        if nearest is None:
            raise UsageError(along.lacking)
        self.least = nearest.modulus
        self.loops = loops = [pose.loop for pose in along.rows if pose.loop is not None]
        modulus = np.array([loop.modulus for loop in loops])
        spread = np.linspace(0, len(loops) - 1, _SPREAD).astype(int)
        rows = dict.fromkeys([*modulus.argmin(axis=0)[modulus.min(axis=0).argsort()].tolist(), *spread.tolist()])
        self.rows = [*rows][:_ROWS]
        """Some rows, first the row with the least margin."""

    def moved(self, knob: Mapping[str, Any], by: float | Mapping[str, float], rows: Sequence[int]) -> list[Loop]:
        """Return the loops at rows with the parameters of a slider times a factor, or a factor by joint, ``1``."""
        changes = {unit: dict(values) for unit, values in self.still.items()}
        for target in knob["targets"]:
            for name, value in self.parameters[target["unit"]].items():
                group, _, index = name.partition("[")
                if group == target["name"]:
                    times = by.get(index.rstrip("]").split(",")[0], 1.0) if isinstance(by, Mapping) else by
                    changes.setdefault(target["unit"], {})[name] = times * value
        return self._poses.moved(changes, rows)

    def worst(self, knob: Mapping[str, Any]) -> list[int]:
        """Return the rows, those of the least margins with the slider at its ends among the first.

        They are chosen among every second row, whose feedback changes as at another row with as many states.
        """
        first, *more = self.rows
        tried = {self.loops[row].K.shape: row for row in self.rows}
        slopes = {slope.shape: slope for slope in (self.feedback(knob, [*tried.values()]) or {}).values()}
        alike = [row for row, loop in enumerate(self.loops) if row % 2 == 0 and loop.K.shape in slopes]
        ends: list[int] = []
        for place in (-NOTCHES, NOTCHES) if alike else ():
            by = factor(knob, place) - 1.0
            moved = (replace(loop, K=loop.K + by * slopes[loop.K.shape]) for loop in map(self.loops.__getitem__, alike))
            ends.append(alike[int(np.argmin(_margins(moved)))])
        return [*dict.fromkeys([first, *ends, *more])]

    def same_plant(self, row: int, loop: Loop) -> bool:
        """Whether a loop differs from the run's in its feedback at most."""
        return all(np.array_equal(*pair) for pair in zip(loop.plant, self.loops[row].plant, strict=True))

    def feedback(
        self, knob: Mapping[str, Any], rows: Sequence[int], joint: str | None = None
    ) -> dict[int, Floats] | None:
        """Return by how much the feedback at rows changes if a slider, of all joints or of one, adds 1 to its factor.

        None if the slider changes more than the feedback, or this not in proportion.
        """
        slopes: list[list[Floats]] = []
        for by in (factor(knob, place) for place in (-NOTCHES, NOTCHES)):
            loops = self.moved(knob, {joint: by} if joint else by, rows)
            if not all(map(self.same_plant, rows, loops)):
                return None
            slopes.append([(loop.K - self.loops[row].K) / (by - 1.0) for row, loop in zip(rows, loops, strict=True)])
        if not all(map(partial(np.allclose, rtol=_ROUNDING, atol=0.0), *slopes)):
            return None
        return dict(zip(rows, slopes[0], strict=True))

    def by_joint(
        self, knob: Mapping[str, Any], rows: Sequence[int], slopes: Mapping[int, Floats]
    ) -> dict[str, dict[int, Floats]]:
        """Return the numbers of a slider's :meth:`feedback` that belong to each joint; empty if some belong to two.

        Each joint is given another factor, and so shows its numbers.
        """
        factors = {str(joint): 1.0 + joint for joint in range(1, len(knob["values"]) + 1)}
        parts: dict[str, dict[int, Floats]] = {joint: {} for joint in factors}
        for row, loop in zip(rows, self.moved(knob, factors, rows), strict=True):
            slope, change = slopes[row], loop.K - self.loops[row].K
            for joint, by in factors.items():
                belongs = np.isclose(change, (by - 1.0) * slope, rtol=_ROUNDING, atol=0.0)
                parts[joint][row] = np.where(belongs, slope, 0.0)
            if not np.array_equal(sum(part[row] for part in parts.values()), slope):
                return {}
        return parts


def _margins(loops: Iterable[Loop]) -> list[float]:
    """Return the least margin of each loop, up to the first that lacks it."""
    margins: list[float] = []
    for loop in loops:
        margins.append(loop.least)
        if not margins[-1]:
            break
    return margins


def _of_knob(loops: _MovedLoops, knob: Mapping[str, Any]) -> Iterator[Track | None]:
    rows = loops.rows
    able = all(can_change(loops.checked, target["unit"]) for target in knob["targets"])
    if not able or any(target["name"] in _FRICTION for target in knob["targets"]):
        yield None
        return
    (moved,) = loops.moved(knob, factor(knob, NOTCHES), rows[:1])
    alike = loops.same_plant(rows[0], moved)
    if alike and np.array_equal(moved.K, loops.loops[rows[0]].K):  # none of its parameters is in a loop
        yield None
        return
    rows = loops.worst(knob) if alike else rows[:_WORST]
    slopes = loops.feedback(knob, rows) if alike else None
    yield _track(loops, knob, rows, slopes)
    joints = len(knob["values"])
    if alike and 1 < joints <= _JOINTS:
        rows = rows[:_FIRST]
        parts = loops.by_joint(knob, rows, slopes) if slopes else {}
        for joint in map(str, range(1, joints + 1)):
            yield _track(loops, knob, rows, parts.get(joint) or loops.feedback(knob, rows, joint), joint)


def _track(
    loops: _MovedLoops, knob: Mapping[str, Any], rows: Sequence[int], slopes: Mapping[int, Floats] | None,
    joint: str | None = None,
) -> Track:  # fmt: skip
    def moved(place: float) -> Iterable[Loop]:
        by = factor(knob, place)
        if slopes is None:
            return loops.moved(knob, {joint: by} if joint else by, rows)
        pairs = [(loops.loops[row], (by - 1.0) * slopes[row]) for row in rows]
        return (replace(loop, K=loop.K + more) for loop, more in pairs)

    margins = {place: min(_margins(moved(place))) if place else loops.least for place in _PLACES}
    limits: list[float | None] = []
    for side in (-1, 1):
        ordered = [side * abs(place) for place in _PLACES if place >= 0]
        beyond = next((k for k, place in enumerate(ordered) if not margins[place]), None)
        if not beyond:  # stable everywhere, or nowhere
            limits.append(0.0 if beyond == 0 else None)
            continue
        inside, outside = float(ordered[beyond - 1]), float(ordered[beyond])
        for _ in range(_HALVINGS):
            middle = (inside + outside) / 2.0
            lost = any(loop.lost.any() for loop in moved(middle))
            inside, outside = (inside, middle) if lost else (middle, outside)
        limits.append(inside)
    track = {"places": list(margins), "modulus": [round(each, 3) for each in margins.values()], "limits": limits}
    return track | {"still": True} if loops.still else track
