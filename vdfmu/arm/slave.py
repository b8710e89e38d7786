"""The pythonfmu slaves in ``fmu_src``: units of the package, for a shipped arm unless their FMU contains another."""

from __future__ import annotations

from functools import cache, partial

from vdfmu.arm.robot import load_robot
from vdfmu.arm.units import find_unit
from vdfmu.compiler.fmu.content import Content
from vdfmu.compiler.fmu.python.slave import UnitSlave, slave_class
from vdfmu.compiler.fmu.python.wrapper import hold_globals
from vdfmu.compiler.unit import Unit

__all__ = ["hold_globals", "slave_of"]


@cache
def slave_of(unit: str, robot: str) -> type[UnitSlave]:
    """Return the slave of a shipped unit for a shipped robot, as for ``pythonfmu build -f``.

    An FMU that `vdfmu build` makes with this slave contains its own robot.
    """
    shipped = find_unit(unit)
    return slave_class(shipped.__name__, partial(_content, shipped, robot))


def _content(unit: type[Unit], robot: str) -> Content:
    return Content(unit, load_robot(robot).unfolded(), {})
