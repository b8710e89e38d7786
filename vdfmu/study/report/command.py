"""The command that makes a run again."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from typing import Any

from vdfmu.base.errors import VdfmuError
from vdfmu.system.scenario.load import load_scenario

_OPTIONS = ("stop", "step", "master", "adaptive")


def run_command(summary: Mapping[str, Any]) -> str:
    """Return the command that makes the run of a scenario, with what differs from the scenario; empty for other runs.

    Units and inputs of the user's own are not in a summary as files, so a run that has them has no command.
    """
    name = summary.get("scenario")
    if not name or summary.get("inputs") or summary.get("left_out") or summary.get("joined"):
        return ""
    words = ["vdfmu", "run", str(name)]
    try:
        scenario = load_scenario(str(name))
    except VdfmuError:  # a file of the user's
        scenario = None
    if scenario is not None:
        if scenario.robot is not None and scenario.robot.name != summary.get("robot"):
            words += ["--robot", str(summary.get("robot"))]
        for option in _OPTIONS:
            value = summary.get(option)
            if value is not None and value != getattr(scenario, option):
                words += [f"--{option}", f"{value:g}" if isinstance(value, float) else str(value)]
    for key, value in (summary.get("settings") or {}).items():
        words += ["--set", f"{key}={value}"]
    return shlex.join(words)
