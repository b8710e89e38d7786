"""Robots as frozen dataclasses, and their loading from TOML files."""

from vdfmu.arm.robot.load import load_robot, robot_names
from vdfmu.arm.robot.robot import Robot
from vdfmu.arm.robot.robot_file import check_robot, robot_from_dict

__all__ = ["Robot", "check_robot", "load_robot", "robot_from_dict", "robot_names"]
