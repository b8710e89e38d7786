"""Units of models that exist: linear systems, CasADi functions, tables."""

from typing import TYPE_CHECKING

from vdfmu.base.extras import lazy

if TYPE_CHECKING:
    from vdfmu.extras.models.factories import casadi_unit, linear_unit, table_unit

__all__ = ["casadi_unit", "linear_unit", "table_unit"]
__getattr__ = lazy(__name__, {"factories": __all__})
