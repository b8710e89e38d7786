"""Robots as files of other tools: URDF and MJCF become robot files of vdfmu, and robots are written as such files."""

from typing import TYPE_CHECKING

from vdfmu.base.extras import lazy

if TYPE_CHECKING:
    from vdfmu.extras.robots.export import export_robot
    from vdfmu.extras.robots.imported import Imported, import_robot, robot_from_mjcf, robot_from_urdf

__all__ = ["Imported", "export_robot", "import_robot", "robot_from_mjcf", "robot_from_urdf"]
_NAMES = {"export": ("export_robot",), "imported": ("Imported", "import_robot", "robot_from_mjcf", "robot_from_urdf")}
__getattr__ = lazy(__name__, _NAMES)
