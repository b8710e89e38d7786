"""Robots as frozen dataclasses, and their loading from TOML files."""

from vdfmu.arm.robot.robot import Robot
from vdfmu.arm.robot.robot_file import check_robot, load_robot, robot_from_dict, robot_names

__all__ = ["Robot", "check_robot", "load_robot", "robot_from_dict", "robot_names"]
