"""The command that makes a run again."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from typing import Any

from vdfmu.base.toml_file import locate, read_toml
from vdfmu.system.scenario.load import scenario_names
from vdfmu.system.scenario.scenario import Scenario

_OPTIONS = ("stop", "step", "master", "adaptive", "tolerance")


def run_command(summary: Mapping[str, Any]) -> str:
    """Return the command that makes the run of a scenario, with what differs from the scenario.

    Empty for other runs, and for those with inputs from outside, or units of Python instead of a file or name.
    """
    name, units = summary.get("scenario"), summary.get("units") or {}
    if not name or summary.get("inputs") or any("<" in unit for unit in units.values()):
        return ""
    robot = str(summary.get("robot"))
    words = ["vdfmu", "run", str(summary.get("scenario_file", name))]
    if name == f"{robot}_reach":  # as `reach_scenario` names it
        words = ["vdfmu", "run", "reach", "--robot", robot]
    if name in scenario_names():  # else a file of the user's
        written = read_toml(locate(str(name), "scenarios"))
        if "robot" in written and written["robot"] != summary.get("robot"):
            words += ["--robot", robot]
        for option in _OPTIONS:
            value = summary.get(option)
            if value is not None and value != written.get(option, getattr(Scenario, option, None)):
                words += [f"--{option}", f"{value:g}" if isinstance(value, float) else str(value)]
    for component, unit in units.items():
        words += ["--unit", f"{component}={unit}"]
    for key, value in (summary.get("settings") or {}).items():
        words += ["--set", f"{key}={value}"]
    return shlex.join(words)
