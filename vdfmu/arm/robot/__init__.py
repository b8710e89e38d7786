"""Robots as frozen dataclasses, and their loading from TOML files."""

from vdfmu.arm.robot.drive_file import DriveFile
from vdfmu.arm.robot.robot import FRICTION_ARRANGEMENTS, Robot, joint_free, robot_argument
from vdfmu.arm.robot.robot_file import check_robot, load_robot, robot_from_dict, robot_names, section_numbers
from vdfmu.arm.robot.visual import SHAPES

__all__ = [
    "FRICTION_ARRANGEMENTS",
    "SHAPES",
    "DriveFile",
    "Robot",
    "check_robot",
    "joint_free",
    "load_robot",
    "robot_argument",
    "robot_from_dict",
    "robot_names",
    "section_numbers",
]
