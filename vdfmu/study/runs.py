"""The main job: run a scenario, draw its pictures, write its page."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Unpack

from vdfmu.base.cache import one_job
from vdfmu.base.errors import CosimError
from vdfmu.base.files import temporary_folder
from vdfmu.base.option import pick, with_options
from vdfmu.base.progress import doing, with_progress
from vdfmu.engine.results.folder import SYSTEM_OUTPUTS, known_formats, known_pictures, replacing_results, write_summary
from vdfmu.engine.run import Interrupted, Results
from vdfmu.study.options import ScenarioOptions, ScenarioRunOptions
from vdfmu.study.report.figures import write_pictures
from vdfmu.study.report.page import write_failed, write_report
from vdfmu.study.report.shown_run import NAME, ShownRun
from vdfmu.study.report.simulation import keep_program
from vdfmu.study.run.scenario_run import ScenarioRun, prepare
from vdfmu.system.scenario import Scenario

RUN_OUTPUTS = (*SYSTEM_OUTPUTS, "system.ssp", NAME)
"""Files that the run of a scenario writes and replaces."""


@with_progress
@one_job()
@with_options
def run(scenario: Scenario | str | os.PathLike[str], **options: Unpack[ScenarioRunOptions]) -> Results:
    """Run a scenario and write its results, ``summary.json`` and figures.

    Parameters
    ----------
    scenario : Scenario, str or path
        Loaded, or the name of a shipped one, or a file; or "reach", a first motion of any robot.
    **options
        :class:`vdfmu.study.options.ScenarioRunOptions`.

    Returns
    -------
    Results
        Recorded signals; `summary` is the content of ``summary.json``.

    Raises
    ------
    UsageError, ModelError, SspError
        Before the run, for faults of scenario, robot, options or system.
    CosimError, vdfmu.engine.run.Interrupted
        A unit failed, or the user stopped the run. The rows so far are in ``partial`` of the folder.
    """
    scenario = prepare(scenario, **pick(ScenarioOptions, options))
    known_formats(options["formats"])
    width = known_pictures(options["pictures"], options["width"])
    out, observer = options["out"], options["observer"]
    folder = Path(out or "") if out is not None else Path("results") / scenario.name
    place = (
        temporary_folder("vdfmu_run_") if out is False else replacing_results(folder, RUN_OUTPUTS, options["overwrite"])
    )
    job = ScenarioRun(scenario, options)
    with place as made:
        made = Path(made)
        job.pack(made)
        if out is not False:
            keep_program(job.system, job.package)
        try:
            results = job.simulate()
        except (CosimError, Interrupted) as error:
            if out is not False:
                write_failed(scenario.name, job.package, made, error)
            raise
        summary = results.summary
        job.judge(results)
        if out is False:
            return results
        with doing("figures"):
            write_pictures(results, scenario.robot, made, options["pictures"], width)
        with doing("page"):
            shown = ShownRun(scenario.name, results, summary, job.package, job.poses)
            write_report([shown], made / NAME, simulate=bool(options["simulate"]))
            getattr(observer, "page", lambda path: None)(made / NAME)
        write_summary(summary, made)
        return results
