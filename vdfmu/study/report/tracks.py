"""Tracks of a page's sliders: the modulus margin of the sampled loops along each, and where they become unstable.

The run is linearised at some times. There each slider is moved alone: the components whose parameters it scales are
linearised again with the new ones, at the states and inputs that the run had. The states of a faster or heavier arm
would be others; what a gain or a stiffness does to the loops depends little on them. Where the run's own loops are
unstable at one of these times, arms are taken without dry friction, which may excite itself.

A margin of `GOOD` is a largest sensitivity of 2, the upper end of what is recommended (Astrom and Hagglund, Advanced
PID Control, 2006, section 4.5); of `POOR` one of 4, above which both performance and robustness are poor (Skogestad and
Postlethwaite, Multivariable Feedback Control, 2005, section 2.4.3).
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, nullcontext
from dataclasses import replace
from functools import partial
from hashlib import sha256
from typing import Any

import numpy as np

from vdfmu.arm.robot.parameters import section
from vdfmu.base.arrays import Floats
from vdfmu.base.cache import cache_folder, load, store
from vdfmu.base.errors import VdfmuError
from vdfmu.compiler.functions.sources import source_digest
from vdfmu.engine.linear.growth import margin_rows
from vdfmu.engine.linear.linearise import Linearisation, can_change, changed, with_part
from vdfmu.engine.linear.loops import GROWTH, Loop, modulus_margins, of_positions, opened_at, system_loop
from vdfmu.engine.linear.system import LinearSystem
from vdfmu.engine.masters.components import Components
from vdfmu.engine.package.system import Value
from vdfmu.engine.plan.check import Checked
from vdfmu.engine.run.simulator import Simulator
from vdfmu.study.analysis.arm_space import least_dry_friction
from vdfmu.study.report.causes import Names

GOOD, POOR = 0.5, 0.25
"""Modulus margins from which a track is green, and below which it is red."""
NOTCHES = 100
"""Places of a slider to either side of 0, where its factor is 1."""
_PLACES = range(-NOTCHES, NOTCHES + 1, NOTCHES // 4)
OWN = len(_PLACES) // 2
"""Place of the run's own margin among these."""
_HALVINGS = 4
"""Of the distance of two places, for the limit of stability: to 1.6 notches, 4 % of a factor of up to 10."""
_WORST = 2
"""Times of the run at which each joint or the arm is tried, those of the least margins; all joints are at all."""
_JOINTS = 8
"""Most joints that have tracks of their own."""
_POINTS = 30
"""Frequencies, in addition to those around poles, where margins are least."""
_ROUNDING = 1e-9
"""Rounding of derivatives that are in proportion, relative."""

_FRICTION = {row.name for row in section("friction")}
"""Parameters without a track: near standstill friction that falls with speed makes a loop grow for a moment, whatever
the motion before and after."""

Track = dict[str, Any]


def factor(knob: Mapping[str, Any], place: float) -> float:
    """Return the factor of a place of a slider, as ``web/simulation.js`` does."""
    share = abs(place) / NOTCHES
    if place > 0:
        return knob["most"] ** share
    return knob["least"] ** share if knob["least"] else 1.0 - share


def tracks(
    checked: Checked, knobs: Sequence[Mapping[str, Any]], parameters: Names, span: tuple[float, float, float]
) -> list[list[Track | None]]:
    """Return the tracks of each slider: of all joints, then of each joint; None where it has none.

    A track has ``places``, the least modulus margin at each, ``modulus``, and in ``limits`` the places below and above
    which the loops are unstable, or None; ``still`` where arms are taken without dry friction.

    Parameters
    ----------
    span : tuple of float [s]
        Start, stop and step of the run.
    """
    content = json.dumps([source_digest("study.report.tracks"), str(checked.algorithm), knobs, parameters, span])
    digest = sha256(content.encode() + sha256(checked.system.path.read_bytes()).digest()).hexdigest()
    path = cache_folder() / "tracks" / digest
    if (stored := load(path)) is not None:
        return json.loads(stored)
    try:
        found = _tracks(checked, knobs, parameters, span)
    except VdfmuError:  # there are no loops, or the FMUs do not tell them
        found = [list[Track | None]([None]) for _ in knobs]
    store(path, json.dumps(found).encode())
    return found


def _tracks(
    checked: Checked, knobs: Sequence[Mapping[str, Any]], parameters: Names, span: tuple[float, float, float]
) -> list[list[Track | None]]:
    start, stop, step = span
    poses = _LinearisedRows()
    with Simulator(checked.system, isolate=False, algorithm=checked.algorithm) as simulator:
        simulator.run(start=start, stop=stop, step=step, record=(), visitor=poses)
        if not opened_at(poses.systems[0][1], "tau"):  # no loop goes through a motor's torque
            return [[None] for _ in knobs]
        loops = _MovedLoops(poses, parameters, {})
        if not min(loops.least):  # friction may excite itself
            still = {unit: own for unit, values in parameters.items() if (own := least_dry_friction(values))}
            loops = _MovedLoops(poses, parameters, still)
        return [list(_of_knob(loops, knob)) for knob in knobs]


class _LinearisedRows:
    """Linearises all components of a run at the rows by which it is judged."""

    def __init__(self) -> None:
        self.systems: list[tuple[float, LinearSystem]] = []
        self.components: Components | None = None
        self._linearisation: Linearisation | None = None

    def rows(self, n: int) -> frozenset[int]:
        """Return the rows of a run with n steps."""
        return frozenset(margin_rows(n))

    def visit(self, components: Components, time: float, step: float) -> None:
        """Linearise the components."""
        if self._linearisation is None:
            self.components, self._linearisation = components, Linearisation(components, step, loops=True)
        self.systems.append((time, self._linearisation.at(time)))


class _MovedLoops:
    """The loops at all poses, with the run's parameters and with those of a slider."""

    def __init__(self, poses: _LinearisedRows, parameters: Names, still: Mapping[str, Mapping[str, Value]]) -> None:
        assert poses.components is not None
        self.components, self.parameters, self.still = poses.components, parameters, still
        self._systems, self._opened = poses.systems, opened_at(poses.systems[0][1], "tau")
        for unit, values in still.items():
            if not can_change(self.components, unit):
                continue
            with changed(self.components, unit, values) as instance:
                self._systems = [(time, with_part(system, instance, time)) for time, system in self._systems]
        self.own = [self._loop(system) for _, system in self._systems]
        self.least = [float(modulus_margins(_by_positions(each), self._opened).min()) for _, each in self._systems]
        self.worst: list[int] = np.argsort(self.least).tolist()
        """Poses, the one with the least margin first."""

    def _loop(self, system: LinearSystem) -> Loop:
        return system_loop(_by_positions(system), self._opened, GROWTH, _POINTS)

    @contextmanager
    def moved(self, knob: Mapping[str, Any], place: float, joint: int | None) -> Generator[Callable[[int], Loop]]:
        """Yield a function of the pose: its loop with a slider at a place, of all joints or of one."""
        changes: dict[str, dict[str, Value]] = {}
        for target in knob["targets"]:
            for name, value in self.parameters[target["unit"]].items():
                group, _, index = name.partition("[")
                if group == target["name"] and (joint is None or index.rstrip("]").split(",")[0] == str(joint + 1)):
                    of_unit = changes.setdefault(target["unit"], dict(self.still.get(target["unit"], {})))
                    of_unit[name] = factor(knob, place) * value
        with ExitStack() as stack:
            instances = [stack.enter_context(changed(self.components, unit, new)) for unit, new in changes.items()]

            def loop(pose: int) -> Loop:
                time, system = self._systems[pose]
                for instance in instances:
                    system = with_part(system, instance, time)
                return self._loop(system)

            yield loop

    def open_as_own(self, pose: int, loop: Loop) -> bool:
        """Whether a loop differs from the run's in its feedback at most."""
        return all(np.array_equal(*pair) for pair in zip(loop.plant, self.own[pose].plant, strict=True))

    def feedback(self, knob: Mapping[str, Any], poses: Sequence[int], joint: int | None) -> dict[int, Floats] | None:
        """Return by how much the feedback at poses changes if a slider adds 1 to its factor.

        None if the slider changes more than the feedback, or this not in proportion.
        """
        found: list[list[Floats]] = []
        for place in (-NOTCHES, NOTCHES):
            with self.moved(knob, place, joint) as moved:
                loops = [moved(pose) for pose in poses]
            if not all(map(self.open_as_own, poses, loops)):
                return None
            by = factor(knob, place) - 1.0
            found.append([(loop.K - self.own[pose].K) / by for pose, loop in zip(poses, loops, strict=True)])
        if not all(map(partial(np.allclose, rtol=_ROUNDING, atol=0.0), *found)):
            return None
        return dict(zip(poses, found[0], strict=True))


def _of_knob(loops: _MovedLoops, knob: Mapping[str, Any]) -> Iterator[Track | None]:
    pose = loops.worst[0]
    able = all(can_change(loops.components, target["unit"]) for target in knob["targets"])
    if not able or any(target["name"] in _FRICTION for target in knob["targets"]):
        yield None
        return
    with loops.moved(knob, NOTCHES, None) as moved:
        there = moved(pose)
    alike = loops.open_as_own(pose, there)
    if alike and np.array_equal(there.K, loops.own[pose].K):  # none of its parameters is in a loop
        yield None
        return
    yield _track(loops, knob, loops.worst if alike else loops.worst[:_WORST], None)
    joints = len(knob["values"])
    if alike and 1 < joints <= _JOINTS:
        for joint in range(joints):
            yield _track(loops, knob, loops.worst[:_WORST], joint)


def _track(loops: _MovedLoops, knob: Mapping[str, Any], poses: Sequence[int], joint: int | None) -> Track:
    feedback = loops.feedback(knob, poses, joint)

    def margin(pose: int, loop: Loop | None, place: float) -> float:
        own = loops.own[pose]
        if feedback is not None:
            return _modulus(own, own.K + (factor(knob, place) - 1.0) * feedback[pose])
        assert loop is not None
        return _modulus(own, loop.K) if loops.open_as_own(pose, loop) else _modulus(loop, loop.K)

    def least(place: float) -> float:
        found = math.inf
        with nullcontext() if feedback is not None else loops.moved(knob, place, joint) as moved:
            for pose in poses:
                found = min(found, margin(pose, moved and moved(pose), place))
                if not found:
                    break
        return found

    own = min(loops.least[pose] for pose in poses)
    margins = {place: least(place) if place else own for place in _PLACES}
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
            inside, outside = (middle, outside) if least(middle) else (inside, middle)
        limits.append(inside)
    found = {"places": list(margins), "modulus": [round(each, 3) for each in margins.values()], "limits": limits}
    return found | {"still": True} if loops.still else found


def _by_positions(system: LinearSystem) -> LinearSystem:
    return replace(system, parts=of_positions(system.parts))


def _modulus(loop: Loop, K: Floats) -> float:
    return float(loop.margins(K, delay=0).modulus.min())
