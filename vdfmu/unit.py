"""Everything to write a unit of one's own: its base class, its variables, and functions that can be traced.

`find_unit` returns the class of a unit, shipped or of a file.
"""

from vdfmu.arm.units import find_unit
from vdfmu.compiler import unit
from vdfmu.compiler.unit import *  # noqa: F403

__all__ = ["find_unit"]
__all__ += unit.__all__
