"""The loops of a scenario or package along its run, in one way for all commands: their margins, and growing modes.

A run is linearised at some of its rows, see :class:`vdfmu.engine.linear.growth.Poses`, with the friction that it has.
Friction "split" excites itself. The loops of its plants are judged without dry friction if they grow with it.
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
from vdfmu.engine.linear.growth import Along, Growth, Poses
from vdfmu.engine.linear.loops import SLOW, Margins, Tied
from vdfmu.engine.plan.grid import Grid
from vdfmu.engine.run import Simulator
from vdfmu.study.analysis.arm_space import least_dry_friction, packaged
from vdfmu.study.analysis.reach import scenario_of
from vdfmu.study.options import LoopOptions
from vdfmu.system.package.description import SystemDescription
from vdfmu.system.scenario import Scenario
from vdfmu.system.scenario.values import system_values

TIED = (Tied("tau_s", "kappa", "kappa_dot"),)
"""The torque of a drive's spring follows from the position of its rotor, whose rate is the rotor's speed."""


class Judged(NamedTuple):
    """The loops that decide on a run."""

    loops: Along
    growth: Growth
    """Where disturbances grow most, beyond the rate `SLOW`."""
    excited: str = ""
    """Where friction excites itself, if the loops are without dry friction."""

    @property
    def words(self) -> tuple[str, str]:
        """State of a run by its loops, ``good``, ``doubtful`` or ``failed``, and its words in all commands."""
        loops, growth, excited = self
        before = f"friction 'split' excites itself, most at {excited}; without dry friction " if excited else ""
        if growth.unstable:
            factor = math.exp(growth.rate * loops.system.step)
            return "failed", (
                f"{before}unstable {since(growth.begin)}, {place_of(growth.state, loops)}: disturbances grow by a "
                f"factor of {factor:.3g} a step; its gains are too high, or too low, for this step{finer(loops)}"
            )
        growing, nearest = growth_words(loops), loops.nearest()
        text = f"stable; its margins are not known: {loops.lacking}"
        if nearest is not None:
            where = f"at {place_of(nearest.name, loops)}, {nearest.time:.3g} s"
            text = f"stable with a modulus margin of {nearest.modulus:.2g} {where}"
            if not nearest.modulus:
                text = f"stable over the run, but without a margin {where}{finer(loops)}"
        doubtful = grown(loops).doubtful or (nearest is not None and not nearest.modulus)
        return "doubtful" if doubtful else "good", before + "; ".join(filter(None, (text, growing)))


def poses_of(system: SystemDescription, **options: Any) -> Poses:
    """Return the tap of the loops of a scenario, see :class:`~vdfmu.engine.linear.growth.Poses`."""
    robots = system.resolved.robots
    split = [p for p in system.resolved.plants if (robot := robots[p]) and robot.friction == "split"]
    return Poses("tau", TIED, without={p: least_dry_friction(system.values[p]) for p in split}, **options)


def judged(poses: Poses, begin: float, end: float, failed: bool = False) -> Judged:
    """Return the loops that decide on a run, times in s. If it `failed`, growth beyond `SLOW` is the cause."""
    growth = poses.loops.growth(begin, end)
    if failed and growth.rate > SLOW:
        return Judged(poses.loops, growth._replace(exponent=math.inf))
    if growth.unstable and poses.alternative is not None:
        return Judged(poses.alternative, poses.alternative.growth(begin, end), place_of(growth.state, poses.loops))
    return Judged(poses.loops, growth)


def grown(loops: Along) -> Growth:
    """Return where disturbances grow most along a run."""
    return loops.growth(loops.poses[0].time, loops.poses[-1].time, 0.0)


def growth_words(loops: Along) -> str:
    """Return how a mode grows for a while, in the words of all commands; empty if none does."""
    growth = grown(loops)
    if not growth.notable:
        return ""
    slow = f", slower than {SLOW:g} 1/s" if growth.rate <= SLOW else ""
    return (
        f"a mode grows by {growth.rate:.2g} 1/s at {place_of(growth.state, loops)}{slow}, from {growth.begin:.3g} s to "
        f"{growth.end:.3g} s, by a factor of {math.exp(growth.exponent):.3g} at most"
    )


def finer(loops: Along) -> str:
    """Return the words for the modulus margin at half the step, from the same linearisations; empty without any.

    Sampled components are left out: what they compute may depend on the step.
    """
    system = loops.system
    if system.how.continuous or system.every or system.samples.signals:
        return ""
    half = replace(system, step=system.step / 2.0)
    again = Along(half, loops.opened, ((pose.time, pose.matrix) for pose in loops.poses))
    margin = 0.0 if again.lacking else float(again.modulus.min())
    step = half.step * system.how.substeps
    return f"; with a step of {step:g} s the modulus margin is {margin:.2g}" if margin else ""


def since(time: float) -> str:
    """Return the words for a begin [s]."""
    return f"since {time:.3g} s" if time else "from the start"


def place_of(name: str, loops: Along) -> str:
    """Return the joint of a state or input of a plant, or of a value waiting at a controller; other names unchanged."""
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
    """Run a scenario or package; yield its loops, also at the times `at` [s], the times of the run, and why it failed.

    A run that fails is linearised as far as it came. For `again` see :class:`vdfmu.engine.linear.growth.Poses`; for the
    others, and for errors, see :func:`margins_along`.
    """
    package = not isinstance(system, Scenario) and Path(system).suffix.lower() == ".ssp"
    scenario = system if package else scenario_of(system, names=options.get("settings") or ())
    step = options.pop("step", None)
    if isinstance(scenario, Scenario) and step is not None:
        scenario = replace(scenario, step=step)
    with packaged(scenario, **options) as (path, taken):
        with Simulator(path, isolate=False, **taken) as simulator:
            grid = simulator.grid(None, None, step)
            rows = [round((t - grid.begin) / grid.step) if math.isfinite(t) else -1 for t in at]
            if beyond := [f"{t:g}" for t, row in zip(at, rows, strict=True) if not 0 <= row <= grid.n]:
                raise UsageError(f"at: expected {grid.begin:g} s to {grid.end:g} s, got {', '.join(beyond)} s.")
            asked: dict[str, Any] = {"opened": opened, "more": rows, "again": again, "noted": True}
            if isinstance(scenario, Scenario):
                poses = poses_of(SystemDescription(scenario, system_values(scenario, options.get("settings"))), **asked)
            else:
                poses = Poses("tau", TIED, **asked)
            failed = ""
            try:
                simulator.run(record=(), taps=[poses], step=step)
            except CosimError as error:
                if poses.lacking:
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
    """Times [s], (m,): the times asked for, or all that decide on the run."""
    margins: list[Margins]
    """Margins at each time."""
    judged: Judged
    algorithm: str
    step: float
    notes: tuple[str, ...]

    def __repr__(self) -> str:
        return ": ".join(self.judged.words)

    def least(self, loop: int) -> int:
        """Return which of the times has the least modulus margin of a loop; without any, the fastest growth."""
        return min(range(len(self.times)), key=lambda k: (self.margins[k].modulus[loop], -self.margins[k].rate))


@with_options
def margins_along(
    system: Scenario | str | os.PathLike[str],
    opened: Sequence[str] = (),
    at: Sequence[float] = (),
    **options: Unpack[LoopOptions],
) -> SystemMargins:
    """Margins of the loops of a scenario or package along its run, or at some times of it.

    Parameters
    ----------
    system
        A scenario, its name or file, or an ``.ssp``.
    opened : sequence of str
        Connected inputs at which the loops are opened; default the motor torques, ``tau``, of all components.
    at : sequence of float [s]
        Times, rounded to communication points; default all that decide on the run.
    **options
        :class:`vdfmu.study.options.LoopOptions`.

    Raises
    ------
    UsageError, SspError, CosimError
        See :class:`vdfmu.Simulator`; for times that the run does not have, and loops that are not known.
    """
    with run_along(system, opened, at, **options) as (poses, grid, failed):
        verdict = judged(poses, grid.begin, grid.end, bool(failed))
    every = verdict.loops.poses
    if verdict.loops.lacking:
        raise UsageError(verdict.loops.lacking)
    chosen = [min(every, key=lambda pose: abs(pose.time - t)) for t in at] or every
    first = verdict.loops.system
    return SystemMargins(
        tuple(first.parts.inputs[i] for i in first.places(verdict.loops.opened)), [pose.time for pose in chosen],
        [pose.loop.margins() for pose in chosen if pose.loop is not None], verdict, first.algorithm, grid.step,
        (*poses.notes, *filter(None, [failed])),
    )  # fmt: skip
