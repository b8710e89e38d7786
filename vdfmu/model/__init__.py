"""Robots and scenarios as frozen dataclasses, and their loading from TOML files."""

from vdfmu.model.load import (
    check_robot,
    load_robot,
    load_scenario,
    robot_from_dict,
    robot_names,
    scenario_names,
)
from vdfmu.model.robot import Robot
from vdfmu.model.scenario import Controller, Feedforward, Scenario, Trajectory

__all__ = [
    "Controller",
    "Feedforward",
    "Robot",
    "Scenario",
    "Trajectory",
    "check_robot",
    "load_robot",
    "load_scenario",
    "robot_from_dict",
    "robot_names",
    "scenario_names",
]
