"""Import of robots from URDF and MJCF, export to these formats, and pages of robots."""

from typing import TYPE_CHECKING

from vdfmu.base.extras import lazy

if TYPE_CHECKING:
    from vdfmu.extras.robots.export import export_robot
    from vdfmu.extras.robots.imported import Imported, import_robot, robot_from_mjcf, robot_from_urdf
    from vdfmu.extras.robots.robot_page import write_robot_page

__all__ = ["Imported", "export_robot", "import_robot", "robot_from_mjcf", "robot_from_urdf", "write_robot_page"]
_NAMES = {
    "export": ("export_robot",),
    "imported": ("Imported", "import_robot", "robot_from_mjcf", "robot_from_urdf"),
    "robot_page": ("write_robot_page",),
}
__getattr__ = lazy(__name__, _NAMES)
