"""``vdfmu run`` and ``report``."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Unpack

import click

from vdfmu.base.bars import errors
from vdfmu.base.errors import LOG, CosimError, UsageError
from vdfmu.base.files import replacing_foreign
from vdfmu.base.option import Option, option_of, pick
from vdfmu.cli.app import LOOKS, RUNS, meets_code
from vdfmu.cli.options import ForeignOption, OpenOption, ScenarioArgument, UnpackOption, load
from vdfmu.cli.parameters import Positional
from vdfmu.cli.terminal import console, say_error, say_notes, say_page, say_written, tell, unit_messages
from vdfmu.engine.options import SystemOptions
from vdfmu.study.options import JudgeOptions, ScenarioOptions, ScenarioRunOptions

_POINT = "One point of a study"


@meets_code(RUNS)
def run(
    scenario: ScenarioArgument = "tracking", *,
    study: Annotated[Path | None, Option(
        "A study: sweep.parquet or its folder.", group=_POINT, flag="--from", metavar="SWEEP")] = None,
    row: Annotated[str | None, Option(
        "worst, best or a number (default worst).", group=_POINT, metavar="POINT")] = None,
    by: Annotated[str | None, Option(
        "Measure that ranks the points (default the first).", group=_POINT, metavar="NAME")] = None,
    trust: Annotated[bool, Option(
        "Run the code that a study of others names.", group=_POINT, more="It runs with your permissions.")] = False,
    opened: OpenOption = False,
    **options: Unpack[ScenarioRunOptions],
) -> None:  # fmt: skip
    """Run a scenario and judge the run, or run FMUs.

    Builds stale FMUs, co-simulates, compares with references, writes a page.
    A failed run has exit code 1. For FMUs: `vdfmu run FILE.ssp --help`.
    """
    if Path(scenario).suffix.lower() == ".py":
        way = "'vdfmu build' makes its FMU, and --unit COMPONENT=FILE puts it into a scenario"
        raise UsageError(f"{scenario}: must be a scenario, got a unit. {way}.")
    settings: dict[str, Any] = {**options, "simulate": options["simulate"] is not False}
    if study is None:
        if row is not None or by is not None or trust:
            raise UsageError("row, by, trust: expected --from with a parameter study. They choose its point.")
        settings["scenario"] = load(scenario, settings.pop("robot"))
    else:
        from vdfmu.study.sweeps.sweep import Sweep

        source = click.get_current_context().get_parameter_source("scenario")
        if source is click.core.ParameterSource.COMMANDLINE:
            raise UsageError(f"{scenario}: expected no scenario with --from: {study} has its own.")
        sweep = Sweep(study)
        point = sweep.options(row or "worst", by, trust=trust)
        say_notes(sweep.notes)
        changed = pick(ScenarioOptions, options)
        settings |= point | {name: value for name, value in changed.items() if value not in (None, {}, [])}
        for name in ("units", "parameters"):
            settings[name] = point.get(name, {}) | (options[name] or {})
    from vdfmu.engine.results.folder import written
    from vdfmu.engine.results.verdict import FAILED, state_of
    from vdfmu.engine.run import Interrupted
    from vdfmu.study.report.sheets import run_panel, sheet_table, sheets, verdict_table
    from vdfmu.study.report.shown_run import NAME
    from vdfmu.study.runs import RUN_OUTPUTS
    from vdfmu.study.runs import run as run_study

    try:
        with unit_messages() as log:
            settings["log"] = log
            results = run_study(**settings)
    except (CosimError, Interrupted) as error:
        if error.results is not None:
            _say_failed(error, Path(options["out"] or Path("results", error.results.summary["scenario"])), opened)
        raise
    summary = results.summary
    failed = state_of(summary) == FAILED
    _say_verdict(summary)
    if LOG.isEnabledFor(logging.INFO):
        tell(run_panel(summary), *map(sheet_table, sheets(summary)))
    (console.print if failed else tell)(verdict_table(summary, LOG.isEnabledFor(logging.INFO)))
    folder = Path(options["out"] or Path("results", summary["scenario"]))
    say_written(*(folder / name for name in written(folder, RUN_OUTPUTS)))
    say_page(folder / NAME, opened)
    if failed:
        raise SystemExit(1)


def _say_failed(error: Any, folder: Path, opened: bool = False) -> None:
    """Print the reason of a run's failure, or its verdict if it was stopped, and the page of its rows."""
    from vdfmu.engine.results.folder import PARTIAL
    from vdfmu.study.report.shown_run import NAME

    page, summary = folder / PARTIAL / NAME, error.results.summary
    if not len(error.results) or not page.exists():
        return
    stopped = isinstance(error, KeyboardInterrupt)
    if stopped:
        _say_verdict(summary)
    else:
        say_error(error)
    say_page(page, opened)
    if not stopped:
        raise SystemExit(1)


@meets_code(RUNS)
def run_package(
    parts: Annotated[list[str], Positional(
        "A package, an FMU, or components: a=A.fmu b=B.fmu.", metavar="FILE|NAME=FILE...")],
    connect: Annotated[list[str] | None, Option(
        "Connect components. Repeatable.", group="System", flag="--connect", metavar="a.y=b.u",
        more="Vectors connect by name. A component may be a unit too: filter=low_pass.py.")] = None, *,
    unpack_limit: UnpackOption = None,
    judge: Annotated[float | None, option_of(JudgeOptions, "judge")] = None,
    sampled: Annotated[bool | None, option_of(JudgeOptions, "sampled")] = None,
    **options: Unpack[SystemOptions],
) -> None:  # fmt: skip
    """Run FMUs or a system package and write their signals.

    Start, stop, step and algorithm default to those of the package or the FMUs.
    """
    if judge is not None or sampled is not None:
        from vdfmu.study.judgement import check_wanted  # takes long to import

        check_wanted(judge, sampled, options["adaptive"])
    from vdfmu.engine.package.limits import package_limit
    from vdfmu.engine.package_run import default_folder, run_system
    from vdfmu.engine.results.folder import PARTIAL, SYSTEM_OUTPUTS, written
    from vdfmu.engine.results.verdict import FAILED, state_of
    from vdfmu.engine.run import Interrupted
    from vdfmu.study.report.sheets import run_panel

    package, source, kept = _package_of(parts, connect or [])
    folder = default_folder(package) if source is None else Path("results", package.stem)
    options["out"] = folder = Path(options["out"] or folder)
    try:
        with unit_messages() as log, package_limit(unpack_limit):
            options["log"] = log
            results = run_system(package, source, **options)
            if judge is not None:
                from vdfmu.study.runs import judge_run  # takes long to import

                judge_run(package, results.summary, folder, judge, sampled, **options)
    except (CosimError, Interrupted) as error:
        if error.results is not None:
            from vdfmu.study.report.page import write_failed  # takes long to import

            write_failed(package.stem, package, folder / PARTIAL, error)
            _say_failed(error, folder)
        raise
    _say_verdict(results.summary)
    tell(run_panel(results.summary))
    say_written(*(folder / name for name in written(folder, SYSTEM_OUTPUTS)))
    if state_of(results.summary) == FAILED:
        raise SystemExit(1)
    del kept


def _package_of(parts: list[str], connections: list[str]) -> tuple[Path, str | None, Any]:
    """Return the package of FMUs, its name in results, and the system that keeps it."""
    pairs = [part.partition("=") for part in parts]
    if not pairs[0][1] and len(parts) == 1:
        if connections:
            raise UsageError(f"{parts[0]}: must be NAME=FILE with --connect, such as a=A.fmu.")
        if not parts[0].lower().endswith((".ssp", ".fmu")):
            raise UsageError(f"{parts[0]}: must be FMUs or a package. 'vdfmu ssp' writes the package of a scenario.")
        if parts[0].lower().endswith(".ssp"):
            return Path(parts[0]), None, None
    if wrong := [text for text in connections if text.count("=") != 1]:
        raise UsageError(f"--connect {wrong[0]}: must be OUTPUT=INPUT, such as a.y=b.u.")
    if len(parts) > 1 and (wrong := [part for part, (_, sign, _) in zip(parts, pairs, strict=True) if not sign]):
        raise UsageError(f"{wrong[0]}: must be NAME=FILE if there are several. Write {Path(wrong[0]).stem}={wrong[0]}.")
    from vdfmu.study.connected import connect as join
    from vdfmu.study.connected import load as load_system

    if not pairs[0][1]:
        system = load_system(parts[0])
    else:
        links = [tuple(text.split("=")) for text in connections]
        system = join({name: file for name, _, file in pairs}, links)  # pyright: ignore[reportArgumentType]
    return system.path, " ".join(parts), system


@meets_code(LOOKS)
def report(
    folders: Annotated[list[Path] | None, Positional(
        "Folders of runs (default the newest in results).", metavar="[DIR]...",
        more="Several runs are compared on one page. A folder of runs gets index.html, links with verdicts.")] = None,
    out: Annotated[Path | None, Option(
        "Page, or FILE.tex for LaTeX (default report.html).",
        more="The page of several runs is comparison.html. FILE.tex has the tables of the runs.")] = None,
    simulate: Annotated[bool, Option("Let the page run them again, with sliders.")] = True,
    opened: OpenOption = False, overwrite: ForeignOption = False,
) -> None:  # fmt: skip
    """Write the page of a run, or compare several runs on one page."""
    from vdfmu.study.report.page import report_of
    from vdfmu.study.report.sheets import LATEX

    with replacing_foreign(overwrite):
        page = report_of(folders or (), out, simulate=simulate)
    say_written(page)
    if page.suffix != LATEX:
        say_page(page, opened)


def _say_verdict(summary: Mapping[str, Any]) -> None:
    """Print the verdict on a run; with ``--quiet`` its headline alone."""
    from vdfmu.engine.results.verdict import headline_of, state_of
    from vdfmu.study.report.sheets import state_text, verdict_text

    if text := state_text(state_of(summary), headline_of(summary)) if errors.quiet else verdict_text(summary):
        console.print(text, soft_wrap=True)
