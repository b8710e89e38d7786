"""Loops of a whole system."""

from collections.abc import Sequence

from vdfmu.engine.linear.loops import Loop, loop_of_part
from vdfmu.engine.linear.system import LinearSystem


def system_loop(system: LinearSystem, opened: Sequence[str]) -> Loop:
    """Return the loops of a system, opened at some inputs."""
    return loop_of_part(system.around(opened), opened)
