"""The command that makes a run again."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from typing import Any

from vdfmu.base.errors import VdfmuError
from vdfmu.base.standards import PYTHON_FMI
from vdfmu.base.toml_file import locate, read_toml, shipped_names
from vdfmu.compiler.unit.declaration import SOLVER_TOLERANCE
from vdfmu.engine.algorithms import DEFAULT

_OPTIONS = ("stop", "step", "master", "adaptive", "tolerance")
_DEFAULTS = {"master": DEFAULT, "tolerance": SOLVER_TOLERANCE}
"""Of a scenario's file without these keys."""


def run_command(summary: Mapping[str, Any]) -> str:
    """Return the command that makes the run of a scenario, with its changes of the scenario.

    It has every option if the scenario's file cannot be read. It is empty for other runs, for runs with inputs from
    outside, and for units that are Python objects.
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
    limits = {key: own["value"] for key, own in (summary.get("own_limits") or {}).items() if own["by"] == "--limit"}
    words += [word for key, value in limits.items() for word in ("--limit", f"{key}={value!r}")]
    words += [word for component, unit in units.items() for word in ("--unit", f"{component}={unit}")]
    words += [word for each in (summary.get("settings") or {}).items() for word in ("--set", "=".join(map(str, each)))]
    return shlex.join(words)


def _written(scenario: str) -> tuple[dict[str, Any] | None, str | None]:
    """Return the content of a scenario's file, None without a readable file, and the name of its robot."""
    try:
        path = locate(scenario, "scenarios")
        written = read_toml(path)
    except VdfmuError:
        return None, None
    try:
        robot = written.get("robot")
        return written, robot and read_toml(locate(robot, "robots", path.parent)).get("name")
    except VdfmuError:
        return written, None
