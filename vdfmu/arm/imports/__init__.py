"""Imports robots from files of other tools: converts URDF and MJCF to robot files of vdfmu."""

from vdfmu.arm.imports.imported import Imported, import_robot, robot_from_mjcf, robot_from_urdf
from vdfmu.arm.imports.tool import read_placement
from vdfmu.arm.imports.write import ROUNDING

__all__ = ["ROUNDING", "Imported", "import_robot", "read_placement", "robot_from_mjcf", "robot_from_urdf"]
