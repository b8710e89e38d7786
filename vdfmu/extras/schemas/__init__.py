"""JSON schemas of robot, scenario and system files, for editors."""

from typing import TYPE_CHECKING

from vdfmu.base.extras import lazy

if TYPE_CHECKING:
    from vdfmu.extras.schemas.schemas import robot_schema, scenario_schema, system_schema

__all__ = ["robot_schema", "scenario_schema", "system_schema"]
__getattr__ = lazy(__name__, {"schemas": __all__})
