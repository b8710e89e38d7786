"""What a page judges a simulated run by: the table of limits, and what of a system its verdict needs.

``web/verdict.js`` makes the checks of :mod:`vdfmu.study.verdict` that need neither references nor linearisations.
"""

from __future__ import annotations

import math
import shlex
from collections.abc import Mapping
from typing import Any

import numpy as np

from vdfmu.arm.robot.parameters import section
from vdfmu.engine.results.verdict import CUT, LONGEST
from vdfmu.study.limits import LIMITS, Limit, read_limits
from vdfmu.study.run.key_figures import comparable, least_sizes
from vdfmu.study.run.summary import LIMITED, limits_of
from vdfmu.study.verdict import ENERGY_FLOOR, loop_checks, remark_checks
from vdfmu.system.package.description import SystemDescription
from vdfmu.system.scenario.check import motions


def facts_of(system: SystemDescription) -> dict[str, Any]:
    """Return what of a system its verdict needs, ready for JSON.

    ``arms``: the limits of motors and stops; ``motions``: begin and length [s] of each;
    ``touch``: signals of the wrench at the tool; ``robot``: what errors are compared with, None without a robot.
    """
    scenario = system.scenario
    robot, touch = scenario.robot, scenario.system.fed.get("plant.F_e", "")
    return {
        "arms": [
            {
                "plant": arm.plant,
                "asked": arm.asked,
                "tau_max": arm.tau_max.tolist(),
                "robot": arm.robot
                and {row.name: np.nan_to_num(getattr(arm.robot, row.name)).tolist() for row in section("limits")},
            }
            for arm in limits_of(system)
        ],
        "motions": [
            {"unit": unit, "begin": begin, "length": length} for unit, begin, length in motions(scenario, system.values)
        ],
        "touch": touch,
        "robot": robot
        and {
            "types": list(robot.joint_types),
            "ell": robot.ell.tolist(),
            "least": least_sizes(robot).tolist(),
            "comparable": comparable(robot, scenario.plant_robot),
        },
        "split": any(each is not None and each.friction == "split" for each in system.resolved.robots.values()),
    }


def row_of(row: Limit) -> dict[str, Any]:
    """Return a limit for JSON; ``own``: a user set it, so that a sentence says who."""
    facts = {**row._asdict(), "own": row.by != LIMITS[row.key].by}
    return facts if math.isfinite(row.failed) else {key: value for key, value in facts.items() if key != "failed"}


def rules_of(summary: Mapping[str, Any], command: str) -> dict[str, Any]:
    """Return the limits of a run, ready for JSON, and its checks that hold for any place of its sliders.

    `command` makes the run. It says whether the user chose the run's end.
    """
    limits = LIMITS
    for key, entry in (summary.get("own_limits") or {}).items():
        limits = read_limits({key: entry["value"]}, entry["by"], limits)
    kept = [*remark_checks(summary), *(loop_checks(summary) if "stability" in summary else ())]
    figures: Mapping[str, Any] = summary.get("key_figures") or {}
    return {
        "rows": {key: row_of(row) for key, row in limits.items()},
        "kept": [check.to_dict() for check in kept],
        "figures": {key: figures[key] for key in ("excited", "open") if key in figures},
        "asked": "--stop" in shlex.split(command),
        "command": command,
        "weights": [LIMITS[key].value for key in ("joint", "tool")],
        "limited": LIMITED,
        "floor": ENERGY_FLOOR,
        "longest": LONGEST,
        "cut": CUT.pattern,
    }
