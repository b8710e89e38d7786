"""Runs FMUs for the command line: results, verdict and page."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from functools import partial as bound
from pathlib import Path
from typing import TYPE_CHECKING, Any, Unpack

from vdfmu.base.errors import CosimError
from vdfmu.base.option import pick
from vdfmu.base.progress import doing
from vdfmu.engine.options import RowOptions, SimulatorOptions, SystemOptions
from vdfmu.engine.package.read import load_ssp
from vdfmu.engine.package_run import run_system
from vdfmu.engine.results.folder import PAGE, RUN_OUTPUTS
from vdfmu.engine.results.results import Results
from vdfmu.engine.results.verdict import GOOD, verdict_of
from vdfmu.engine.run import Interrupted
from vdfmu.study.expected import Expected

if TYPE_CHECKING:
    from vdfmu.study.judgement import Judgement


def run_joined(
    package: Path,
    source: str | None,
    folder: Path,
    wanted: float | None,
    sampled: bool | None,
    expected: Expected | None = None,
    **options: Unpack[SystemOptions],
) -> Results:
    """Run a package of any tool, judge the run and write its page, all in a folder.

    It is judged by the largest allowed error `wanted`, a fraction of each range, and by `expected` results, unless
    these are None.

    The run and its page need neither CasADi nor the equations of arms. `source` is the name of a package that was made
    for the run and is kept as ``system.ssp``. Errors: see :func:`vdfmu.engine.package_run.run_system` and
    :func:`vdfmu.study.judgement.judge`.
    """

    def finish(partial: Path, results: Results) -> None:
        """Judge the run and write its page, so that all files together replace those of an earlier run."""
        if source is not None:
            shutil.copyfile(package, partial / "system.ssp")
        if judged is not None:
            results.summary["judgement"] = judged().to_dict()
        if expected is not None:
            results.summary["expected"] = expected.compare(results)
        _judge(results.summary)
        from vdfmu.study.report.page import write_report  # takes long to import
        from vdfmu.study.report.shown_run import ShownRun

        with doing("page"):
            write_report([ShownRun(package.stem, results, results.summary, package)], partial / PAGE)

    def failed(partial: Path, error: CosimError | Interrupted) -> None:
        from vdfmu.study.report.page import write_failed  # takes long to import

        write_failed(package.stem, package, partial, error)

    judged: Callable[[], Judgement] | None = None
    if wanted is not None:
        from vdfmu.study.judgement import check_connected, judge_connected  # takes long to import

        checked = check_connected(load_ssp(package, options["variant"]), options)
        rows, how = pick(RowOptions, options), pick(SimulatorOptions, options)
        judged = bound(judge_connected, checked, wanted, sampled, rows, how)
    return run_system(package, source, RUN_OUTPUTS, finish, failed, **{**options, "out": folder})


def _judge(summary: dict[str, Any]) -> None:
    """Add the verdict to the summary of a judged run."""
    if summary.keys().isdisjoint(("judgement", "expected")):
        return
    from vdfmu.study.verdict import calculated_checks  # takes long to import

    checks = [check for check in calculated_checks(summary) if check.key != "reference"]  # FMUs have none
    summary["verdict"] = verdict_of(checks, [check.sentence for check in checks if check.state == GOOD])
