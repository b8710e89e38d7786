"""Everything that you need to write a unit: its base class, its variables, and functions that can be traced.

`find_unit` returns the class of a unit, shipped or from a file.
"""

from typing import TYPE_CHECKING, Any

from vdfmu.compiler import unit
from vdfmu.compiler.unit import *  # noqa: F403

if TYPE_CHECKING:
    from vdfmu.arm.units import find_unit as find_unit

__all__ = ["find_unit"]
__all__ += unit.__all__


def __getattr__(name: str) -> Any:
    """Import `find_unit` only when it is used, because units must also work where the package of the arm is absent."""
    if name in ("casadi_unit", "linear_unit", "table_unit"):
        raise AttributeError(f"vdfmu.unit.{name} moved. Write: from vdfmu.extras.models import {name}")
    if name != "find_unit":
        raise AttributeError(f"module 'vdfmu.unit' has no attribute {name!r}")
    from vdfmu.arm.units import find_unit

    return find_unit
