"""The run of FMUs on the command line: results, verdict and page."""

from __future__ import annotations

import shutil
from contextlib import suppress
from pathlib import Path
from typing import Unpack

from vdfmu.base.errors import LOG, CosimError
from vdfmu.base.option import pick
from vdfmu.base.progress import doing
from vdfmu.engine.options import LoadedOptions, SpanOptions, SystemOptions
from vdfmu.engine.package.read import load_ssp
from vdfmu.engine.package_run import run_system
from vdfmu.engine.results.folder import PAGE, RUN_OUTPUTS
from vdfmu.engine.results.results import Results
from vdfmu.engine.results.verdict import verdict_of
from vdfmu.engine.run import Interrupted


def run_joined(
    package: Path, source: str | None, folder: Path, wanted: float | None, sampled: bool | None,
    **options: Unpack[SystemOptions],
) -> Results:  # fmt: skip
    """Run a package of any tool, judge the run and write its page, all in a folder.

    It is judged by the largest error `wanted`, a share of each swing, unless that is None.

    The run needs the engine alone: where CasADi is missing, it has no page. `source` is the name of a package that was
    made for the run, which is kept as ``system.ssp``. Errors: see :func:`vdfmu.engine.package_run.run_system` and
    :func:`vdfmu.study.judgement.judge`.
    """

    def finish(partial: Path, results: Results) -> None:
        """Judge the run and write its page, so that all files replace those of an earlier run at once."""
        if source is not None:
            shutil.copyfile(package, partial / "system.ssp")
        if wanted is not None:
            _judge(package, results, wanted, sampled, options)
        try:
            from vdfmu.study.report.page import write_report  # takes long to import
            from vdfmu.study.report.shown_run import ShownRun
        except ImportError as error:
            LOG.warning("the page was not written: %s", error)
            return
        with doing("page"):
            write_report([ShownRun(package.stem, results, results.summary, package)], partial / PAGE)

    def failed(partial: Path, error: CosimError | Interrupted) -> None:
        with suppress(ImportError):
            from vdfmu.study.report.page import write_failed  # takes long to import

            write_failed(package.stem, package, partial, error)

    return run_system(package, source, RUN_OUTPUTS, finish, failed, **{**options, "out": folder})


def _judge(package: Path, results: Results, wanted: float, sampled: bool | None, options: SystemOptions) -> None:
    """Add judgement and verdict to the summary of a run."""
    from vdfmu.study.judgement import judge  # takes long to import
    from vdfmu.study.verdict import calculated_checks

    summary = results.summary
    judgement = judge(
        load_ssp(package, options["variant"]), wanted, start=options["start"], sampled=sampled,
        algorithm=summary["algorithm"], parameters=options["parameters"],
        **pick(SpanOptions, options), **pick(LoadedOptions, options),
    )  # fmt: skip
    summary["judgement"] = judgement.to_dict()
    sentence = summary["judgement"]["text"].partition(". ")[0]
    summary["verdict"] = verdict_of([*calculated_checks(summary)], [sentence])
