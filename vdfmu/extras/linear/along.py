"""Modes of an arm along the desired motion of a scenario."""

from __future__ import annotations

from collections.abc import Sequence

from vdfmu.base.arrays import Floats
from vdfmu.base.progress import counted
from vdfmu.study.analysis.arm_space import linearize
from vdfmu.study.analysis.modes import MOTORS, Modes, desired_motion, modes_of
from vdfmu.system.scenario import Scenario


def modes_along(scenario: Scenario, *, dry: bool = False) -> tuple[Floats, dict[str, list[Modes]]]:
    """Modes at the poses of the desired motion of a scenario, at rest at each, with motors free and held.

    Returns 101 times [s], evenly spread from the start to the end, and modes by the state of the motors. For
    errors see :func:`vdfmu.natural_modes`; UsageError if no component ``trajectory`` gives the desired motion.
    """
    times, poses = desired_motion(scenario, ("q_d",), 101)
    systems = [linearize(scenario.arm, q, dry=dry) for q in counted("poses", poses[0], len(times))]
    return times, {motors: [modes_of(system, motors, dry) for system in systems] for motors in MOTORS}


def ranges(along: Sequence[Modes], count: int) -> list[tuple[float, float] | None]:
    """Lowest and highest frequency [Hz] of each of the `count` fastest modes, from slow to fast; None for none."""
    limits: list[tuple[float, float] | None] = []
    for place in range(count, 0, -1):
        each = [modes.frequency[-place] for modes in along if len(modes.frequency) >= place]
        limits.append((float(min(each)), float(max(each))) if each else None)
    return limits
