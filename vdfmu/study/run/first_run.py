"""The run of a scenario, or of a first motion of any robot."""

from __future__ import annotations

import os
from functools import wraps
from pathlib import Path
from typing import Any

from vdfmu.arm.robot import Robot
from vdfmu.engine.run import Results
from vdfmu.study.run.scenario_run import run as run_study
from vdfmu.system.scenario import Scenario


@wraps(run_study)
def run(
    scenario: Scenario | str | os.PathLike[str],
    *,
    robot: Robot | str | os.PathLike[str] | None = None,
    **options: Any,
) -> Results:
    """As :func:`vdfmu.study.run.scenario_run.run`, which does not know of motions that are made for a robot."""
    if scenario == "reach" and not Path("reach").exists():
        from vdfmu.study.analysis.reach import reach_scenario

        scenario, robot = reach_scenario(robot), None
    return run_study(scenario, robot=robot, **options)
