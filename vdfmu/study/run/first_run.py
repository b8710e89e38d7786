"""The run of a scenario, or of a first motion of any robot."""

from __future__ import annotations

import os
from functools import wraps
from pathlib import Path
from typing import Unpack

from vdfmu.engine.run import Results
from vdfmu.study.options import ScenarioRunOptions
from vdfmu.study.run.scenario_run import run as run_study
from vdfmu.system.scenario import Scenario


@wraps(run_study)
def run(scenario: Scenario | str | os.PathLike[str], **options: Unpack[ScenarioRunOptions]) -> Results:
    """See :func:`vdfmu.study.run.scenario_run.run`, which does not know motions made for a robot."""
    if scenario == "reach" and not Path("reach").exists():
        from vdfmu.study.analysis.reach import reach_scenario

        scenario = reach_scenario(options.pop("robot", None))
    return run_study(scenario, **options)
