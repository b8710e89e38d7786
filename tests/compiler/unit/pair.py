"""A unit on symbols and on floats."""

from vdfmu.compiler.unit.evaluate import Plain, Traced
from vdfmu.compiler.unit.interface import Interface


def both(unit, robot=None):
    interface = Interface(unit, robot)
    return Traced(interface), Plain(interface)
