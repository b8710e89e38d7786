"""The loops of a scenario or package along its run, for all commands: their margins, and growing modes.

A run is linearised at some of its rows, see :class:`vdfmu.engine.linear.growth.Poses`, with its friction. Because
"split" friction makes loops unstable, the loops of its plants are then judged without dry friction.
"""

from __future__ import annotations

import math
import os
import re
from collections.abc import Generator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple, Unpack

from vdfmu.base.errors import CosimError, UsageError
from vdfmu.base.option import with_options
from vdfmu.base.progress import doing
from vdfmu.engine.linear.growth import Along, Growth, Poses
from vdfmu.engine.linear.loops import SLOW, Margins, Tied
from vdfmu.engine.plan.grid import Grid
from vdfmu.engine.run import LostProcessError, Simulator
from vdfmu.study.analysis.arm_space import least_dry_friction, packaged
from vdfmu.study.options import LoopOptions
from vdfmu.study.run.prepare import scenario_of
from vdfmu.system.package.description import SystemDescription
from vdfmu.system.scenario import Scenario
from vdfmu.system.scenario.values import system_values

TIED = (Tied("tau_s", "kappa", "kappa_dot"),)
"""The torque of a drive's spring is a function of the rotor's position, whose rate is the rotor's speed."""


class Judged(NamedTuple):
    """The loops by which a run is judged."""

    loops: Along
    growth: Growth
    """Where disturbances grow most, relative to the rate `SLOW`."""
    excited: str = ""
    """Where friction makes the loops unstable, if the loops are judged without dry friction."""

    @property
    def figures(self) -> dict[str, Any]:
        """The numbers by which a verdict judges the loops, as entries of a summary's ``key_figures``.

        ``unstable``, the factor by which disturbances grow in a step; or else ``margin``, the smallest modulus margin,
        and ``delay``, the smallest delay margin in samples, of a sampled loop. ``growth`` is the fraction by which
        disturbances grow for a while. ``excited`` means that dry friction makes the loops unstable, so the other
        numbers are calculated without it, ``open`` that nothing is fed back to a joint. Each has its place and its time
        [s].
        """
        loops, growth, excited = self
        figures: dict[str, Any] = {}
        if excited:
            figures["excited"] = {"value": 1.0, "place": excited, "at_s": loops.poses[0].time}
        if growth.unstable:
            factor = math.exp(growth.rate * loops.system.step)
            figures["unstable"] = {"value": factor, "place": place_of(growth.state, loops), "at_s": growth.begin}
            return figures | half_step(loops)
        if (slow := grown(loops)).notable:
            figures["growth"] = {
                "value": math.expm1(slow.exponent),
                "place": place_of(slow.state, loops),
                "at_s": slow.begin,
                "until_s": slow.end,
            }
        if (nearest := loops.nearest()) is not None:
            place = place_of(nearest.name, loops)
            figures["margin"] = {"value": nearest.modulus, "place": place, "at_s": nearest.time}
            figures |= {} if nearest.modulus else half_step(loops)
            if (late := loops.delay()) is not None:
                figures["delay"] = {"value": late.samples, "place": place_of(late.name, loops), "at_s": late.time}
            if (silent := loops.without_feedback()) is not None:
                figures["open"] = {"value": 1.0, "place": place_of(silent, loops), "at_s": loops.poses[0].time}
        return figures


def poses_of(system: SystemDescription, **options: Any) -> Poses:
    """Return the tap of the loops of a scenario, see :class:`~vdfmu.engine.linear.growth.Poses`."""
    robots = system.resolved.robots
    split = [p for p in system.resolved.plants if (robot := robots[p]) and robot.friction == "split"]
    return Poses("tau", TIED, without={p: least_dry_friction(system.values[p]) for p in split}, **options)


def judged(poses: Poses, begin: float, end: float, failed: bool = False) -> Judged:
    """Return the loops by which a run is judged, times in s. If it `failed`, growth beyond `SLOW` is the cause."""
    growth = poses.loops.growth(begin, end)
    if failed and growth.rate > SLOW:
        return Judged(poses.loops, growth._replace(exponent=math.inf))
    if growth.unstable and poses.alternative is not None:
        return Judged(poses.alternative, poses.alternative.growth(begin, end), place_of(growth.state, poses.loops))
    return Judged(poses.loops, growth)


def grown(loops: Along) -> Growth:
    """Return where disturbances grow most along a run."""
    return loops.growth(loops.poses[0].time, loops.poses[-1].time, 0.0)


def half_step(loops: Along) -> dict[str, Any]:
    """Return the entry ``half_step``: the modulus margin at half the step, from the same linearisations, or empty.

    Sampled components are excluded, because their results may depend on the step.
    """
    system = loops.system
    if system.how.continuous or system.every or system.samples.signals:
        return {}
    half = replace(system, step=system.step / 2.0)
    again = Along(half, loops.opened, ((pose.time, pose.matrix) for pose in loops.poses))
    nearest = None if again.lacking else again.nearest()
    if nearest is None or not nearest.modulus:
        return {}
    return {"half_step": {"value": nearest.modulus, "at_s": nearest.time, "step": half.step * system.how.substeps}}


def place_of(name: str, loops: Along) -> str:
    """Return the joint of a plant's state or input, or of a value waiting at a controller; other names unchanged."""
    component, _, variable = name.removeprefix("at ").partition(".")
    states = loops.system.parts.states
    arms = [arm for arm, _, _ in (opened.partition(".") for opened in loops.opened)]
    arms = [arm for arm in arms if any(state.startswith(f"{arm}.") for state in states)]
    index = re.search(r"\[(\d+)\]$", variable)
    if index is None or (component not in arms and not name.startswith("at ")):
        return name
    return f"joint {index[1]}" + (f" of {component}" if len(arms) > 1 else "")


@contextmanager
def run_along(
    system: Scenario | str | os.PathLike[str],
    opened: Sequence[str] = (),
    at: Sequence[float] = (),
    *,
    again: bool = False,
    **options: Unpack[LoopOptions],
) -> Generator[tuple[Poses, Grid, str]]:
    """Run a scenario or package; yield its loops, including those at times `at` [s], its times, and why it failed.

    A failed run is linearised as far as it came. For `again` see :class:`vdfmu.engine.linear.growth.Poses`; for the
    others, and for errors, see :func:`margins_along`.
    """
    package = not isinstance(system, Scenario) and Path(system).suffix.lower() == ".ssp"
    scenario = system if package else scenario_of(system, names=options.get("parameters") or ())
    step = options.pop("step", None)
    if isinstance(scenario, Scenario) and step is not None:
        scenario = replace(scenario, step=step)
    with packaged(scenario, **options) as (path, taken):
        with Simulator(path, **taken) as simulator:
            grid = simulator.grid(None, None, step)
            places = [(t - grid.begin) / grid.step for t in at]
            if beyond := [f"{t:g}" for t, place in zip(at, places, strict=True) if not -0.5 < place < grid.n + 0.5]:
                raise UsageError(f"at: expected {grid.begin:g} s to {grid.end:g} s, got {', '.join(beyond)} s.")
            asked: dict[str, Any] = {"opened": opened, "more": [*map(round, places)], "again": again, "noted": True}
            if isinstance(scenario, Scenario):
                poses = poses_of(
                    SystemDescription(scenario, system_values(scenario, options.get("parameters"))), **asked
                )
            else:
                poses = Poses("tau", TIED, **asked)
            failed = ""
            try:
                simulator.run(record=(), taps=[poses], step=step)
            except CosimError as error:
                if poses.lacking or not poses.seconds or isinstance(error, LostProcessError):
                    raise
                grid, failed = grid._replace(end=error.time), f"the run fails: {error}"
            if poses.lacking:
                raise UsageError(poses.lacking)
            yield poses, grid, failed


class SystemMargins(NamedTuple):
    """Margins of the loops of a system along its run."""

    names: tuple[str, ...]
    """Inputs at which the loops are opened."""
    times: list[float]
    """Times [s], (m,): the requested ones, or all by which the run is judged."""
    margins: list[Margins]
    """Margins at each time."""
    judged: Judged
    algorithm: str
    step: float
    notes: tuple[str, ...]

    def least(self, loop: int) -> int:
        """Return the index of the time with the smallest modulus margin of a loop, or else with the fastest growth."""
        return min(range(len(self.times)), key=lambda k: (self.margins[k].modulus[loop], -self.margins[k].rate))


@with_options
def margins_along(
    system: Scenario | str | os.PathLike[str],
    opened: Sequence[str] = (),
    at: Sequence[float] = (),
    **options: Unpack[LoopOptions],
) -> SystemMargins:
    """Return the margins of the loops of a scenario or package along its run, or at some times.

    Parameters
    ----------
    system
        A scenario, its name or file, or an ``.ssp``.
    opened : sequence of str
        Connected inputs at which the loops are opened, by default the motor torques, ``tau``, of all components.
    at : sequence of float [s]
        Times, rounded to communication points, by default all by which the run is judged.
    **options
        :class:`vdfmu.study.options.LoopOptions`.

    Raises
    ------
    UsageError, SspError, CosimError
        See :class:`vdfmu.engine.run.Simulator`; for times that the run does not have, and loops that are not known.
    """
    with run_along(system, opened, at, **options) as (poses, grid, failed):
        verdict = judged(poses, grid.begin, grid.end, bool(failed))
    every = verdict.loops.poses
    if verdict.loops.lacking:
        raise UsageError(verdict.loops.lacking)
    chosen = [min(every, key=lambda pose: abs(pose.time - t)) for t in at] or every
    first = verdict.loops.system
    return SystemMargins(
        tuple(first.parts.inputs[i] for i in first.places(verdict.loops.opened)),
        [pose.time for pose in chosen],
        [pose.loop.margins() for pose in chosen if pose.loop is not None],
        verdict,
        first.algorithm,
        grid.step,
        (*poses.notes, *filter(None, [failed])),
    )


def closed(system: SystemDescription) -> bool:
    """Return whether the connections feed an output of a plant back to its torque ``tau``."""
    sources: dict[str, set[str]] = {}
    for source, targets in system.connections.items():
        for target in targets:
            sources.setdefault(target.partition(".")[0], set()).add(source.partition(".")[0])
    torques = [
        (target.partition(".")[0], source.partition(".")[0])
        for source, targets in system.connections.items()
        for target in targets
        if target.endswith(".tau")
    ]
    for plant, first in torques:
        before, new = {first}, [first]
        while new:
            more = sources.get(new.pop(), set()) - before
            before |= more
            new += more
        if plant in before:
            return True
    return False


def loops_of(poses: Poses, system: SystemDescription, end: float, failed: bool = False) -> dict[str, Any]:
    """Return a summary's entries on the loops of a run that ended at `end` [s].

    ``key_figures``, see :attr:`Judged.figures`, or ``stability`` with the reason why the loops are not judged, and
    whether that was to be expected, because components without directional derivatives cannot be judged.
    """
    if not closed(system):
        return {"stability": {"reason": "no loop closes over the torque of a plant", "expected": False}}
    if poses.lacking or not poses.seconds:
        reason = poses.lacking or "its components run in separate processes"
        return {"stability": {"reason": reason, "expected": not poses.lacking}}
    with doing("stability"):
        result = judged(poses, 0.0, end, failed)
    lacking = (
        {}
        if result.growth.unstable or not result.loops.lacking
        else {"stability": {"reason": f"its margins are not known: {result.loops.lacking}", "expected": True}}
    )
    return {"key_figures": result.figures} | lacking
