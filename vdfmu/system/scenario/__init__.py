"""Scenarios and systems: from TOML files to the values of each component."""

from vdfmu.system.scenario.scenario import Scenario
from vdfmu.system.scenario.scenario_file import load_scenario, load_system, scenario_names

__all__ = ["Scenario", "load_scenario", "load_system", "scenario_names"]
