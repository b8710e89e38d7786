"""Scenarios and systems: what is run, from TOML files to the values of each component."""

from vdfmu.scenario.load import load_scenario, load_system, scenario_names
from vdfmu.scenario.scenario import Controller, Feedforward, Scenario, Trajectory

__all__ = [
    "Controller",
    "Feedforward",
    "Scenario",
    "Trajectory",
    "load_scenario",
    "load_system",
    "scenario_names",
]
