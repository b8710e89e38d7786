"""The command that makes a run again."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from vdfmu.base.errors import VdfmuError
from vdfmu.base.standards import PYTHON_FMI
from vdfmu.base.toml_file import locate, read_toml, shipped_names
from vdfmu.compiler.unit.declaration import SOLVER_TOLERANCE
from vdfmu.system.scenario.scenario_file import MASTER

_OPTIONS = ("stop", "step", "master", "adaptive", "tolerance")
_DEFAULTS = {"master": MASTER, "tolerance": SOLVER_TOLERANCE}
"""Of a scenario's file without these keys."""


def run_command(summary: Mapping[str, Any]) -> str:
    """Return the command that makes the run of a scenario, with what differs from the scenario.

    It has every option of a scenario whose file cannot be read any more. Empty for other runs, and for those with
    inputs from outside, or units of Python instead of a file or name.
    """
    name, units = summary.get("scenario"), summary.get("units") or {}
    if not name or summary.get("inputs") or any("<" in unit for unit in units.values()):
        return ""
    scenario = str(summary.get("scenario_file", name))
    written, robot = _written(scenario)
    if written is None and scenario.endswith("_reach"):  # as `reach_scenario` names it
        scenario = "reach"
    words = ["vdfmu", "run", scenario]
    asked = summary.get("robot_file") or summary.get("robot")
    if "robot_file" in summary or asked != robot and asked in shipped_names("robots"):
        words += ["--robot", str(asked)]
    for option in _OPTIONS:
        value = summary.get(option)
        if value is not None and (written is None or value != written.get(option, _DEFAULTS.get(option))):
            words += [f"--{option}", repr(value).removesuffix(".0") if isinstance(value, float) else str(value)]
    words += ["--backend", "python"] if summary.get("backend") == "python" else []
    words += ["--fmi", summary["fmi"]] if summary.get("fmi", PYTHON_FMI.name) != PYTHON_FMI.name else []
    for component, unit in units.items():
        words += ["--unit", f"{component}={unit}"]
    for key, value in (summary.get("settings") or {}).items():
        words += ["--set", f"{key}={value}"]
    return shlex.join(words)


def _written(scenario: str) -> tuple[dict[str, Any] | None, str | None]:
    """Return the content of a scenario's file, None if there is none to read, and the name of its robot."""
    try:
        path = locate(scenario, "scenarios")
        written = read_toml(path, "scenarios")
        robot = written.get("robot")
        return written, robot and _robot_name(robot, path.parent)
    except VdfmuError:
        return None, None


def _robot_name(robot: str, start: Path) -> str | None:
    try:
        return read_toml(locate(robot, "robots", start), "robots").get("name")
    except VdfmuError:
        return None
