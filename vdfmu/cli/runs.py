"""``vdfmu run``, ``simulate`` and ``federate``."""

from __future__ import annotations

import webbrowser
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Unpack

import typer
from rich.text import Text

from vdfmu.base.bars import errors
from vdfmu.base.errors import CosimError, UsageError
from vdfmu.base.files import inside, replacing_foreign, require_ours
from vdfmu.base.option import pick
from vdfmu.cli.terminal import (
    ForeignOption,
    ScenarioArgument,
    UnpackOption,
    choice,
    console,
    load,
    out_option,
    say_error,
    say_notes,
    say_written,
    tell,
    typer_option,
    unit_messages,
)
from vdfmu.cli.view import LiveOption, PortOption, live_view
from vdfmu.engine.options import PackageOptions, SystemOptions
from vdfmu.study.options import RobotOptions, ScenarioOptions, ScenarioRunOptions

OpenOption = Annotated[bool, typer.Option("--open", help="Open the page in a browser.")]
PackageArgument = Annotated[Path, typer.Argument(help="A system package of SSP 1.0 or 2.0, of this or any other tool.")]


def run(
    context: typer.Context,
    scenario: ScenarioArgument = "tracking",
    *,
    study: Annotated[
        Path | None,
        typer.Option("--from", metavar="SWEEP", help="Run a point of a parameter study: sweep.parquet or its folder."),
    ] = None,
    row: Annotated[
        str | None, typer.Option(help="Of --from: worst, best, or the number of a point; default worst.")
    ] = None,
    by: Annotated[
        str | None, typer.Option(metavar="NAME", help="Of worst and best: by which measure; default the first.")
    ] = None,
    trust: Annotated[
        bool, typer.Option("--trust", help="Of --from: run files that a study from elsewhere names, with your rights.")
    ] = False,
    live: LiveOption = False,
    port: PortOption = None,
    opened: OpenOption = False,
    **options: Unpack[ScenarioRunOptions],
) -> None:
    """Run a scenario: build what is stale, co-simulate, solve the references, compare, write tables and figures.

    The exit code is 1 if the run failed, 0 if it is good or doubtful.
    """
    way = {
        ".ssp": "is a system package; 'vdfmu simulate' runs it",
        ".py": "is a unit; 'vdfmu build' makes its FMU, and --unit COMPONENT=FILE puts it into a scenario",
    }.get(Path(scenario).suffix.lower())
    if way:
        raise UsageError(f"{scenario}: expected a scenario; this {way}.")
    given: dict[str, Any] = {**options}
    if given["simulate"] is None:
        given["simulate"] = True
    if study is None:
        if row is not None or by is not None or trust:
            raise UsageError("row, by, trust: expected --from with a parameter study, of which they choose a point.")
        given["scenario"] = load(scenario, given.pop("robot"))
    else:
        from vdfmu.study.sweeps.sweep import Sweep

        source = context.get_parameter_source("scenario")
        if source is not None and source.name == "COMMANDLINE":
            raise UsageError(f"{scenario}: expected no scenario with --from: {study} has its own.")
        found = Sweep(study)
        point = found.options(row or "worst", by, trust=trust)
        say_notes(found.notes)
        changed = pick(ScenarioOptions, options)
        given |= point | {name: value for name, value in changed.items() if value not in (None, {}, [])}
        for name in ("units", "settings"):
            given[name] = point.get(name, {}) | (options[name] or {})
    from vdfmu.engine.results.folder import written
    from vdfmu.engine.results.verdict import FAILED, state_of
    from vdfmu.engine.run import Interrupted
    from vdfmu.study.report import tables
    from vdfmu.study.report.page import NAME
    from vdfmu.study.report.sheets import sheets
    from vdfmu.study.run.scenario_run import RUN_OUTPUTS
    from vdfmu.study.run.scenario_run import run as run_study

    with live_view(live, port) as observer:
        try:
            with unit_messages() as log:
                given |= {"log": log, "observer": observer}
                results = run_study(**given)
        except (CosimError, Interrupted) as error:
            if error.results is not None:
                _say_failed(error, Path(options["out"] or Path("results", error.results.summary["scenario"])), opened)
            raise
        summary = results.summary
        failed = state_of(summary) == FAILED
        tell(tables.run_panel(summary), *map(tables.sheet_table, sheets(summary)))
        (console.print if failed else tell)(tables.verdict_table(summary))
        folder = Path(options["out"] or Path("results", summary["scenario"]))
        say_written(*(folder / name for name in written(folder, RUN_OUTPUTS)))
        _say_verdict(summary)
        _say_page(folder / NAME, opened)
    if failed:
        raise typer.Exit(1)


def _say_failed(error: Any, folder: Path, opened: bool = False) -> None:
    """Print why a run failed, or that it was stopped, and where the page of its rows is."""
    from vdfmu.engine.results.folder import PARTIAL
    from vdfmu.study.report.page import NAME

    page, summary = folder / PARTIAL / NAME, error.results.summary
    if not len(error.results) or not page.exists():
        return
    stopped = isinstance(error, KeyboardInterrupt)
    if not stopped:
        say_error(error)
    else:
        _say_verdict(summary)
    _say_page(page, opened)
    if not stopped:
        raise typer.Exit(1)


def simulate(
    package: PackageArgument,
    *,
    unpack_limit: UnpackOption = None,
    live: LiveOption = False,
    port: PortOption = None,
    robot: Annotated[
        str | None,
        typer_option(
            RobotOptions,
            "robot",
            help="Of --live: whose arm it is, a name or the path of a TOML file; plant.q are its positions.",
        ),
    ] = None,
    **options: Unpack[SystemOptions],
) -> None:
    """Run a system package, and write its signals.

    Start, stop, step and master that are not given are those of the package's default experiment and its annotations.
    """
    if robot is not None and not live:
        raise UsageError("--robot: expected --live, which it is for.")
    with live_view(live, port, robot) as observer:
        options["observer"] = observer
        _run_package(package, unpack_limit, **options)


def federate(
    package: PackageArgument,
    split: Annotated[
        list[str],
        typer.Option(
            metavar="COMPONENT,...",
            help="Components of one federate, which has the name of the first; those not named are one more. "
            "Repeatable.",
        ),
    ],
    *,
    only: Annotated[
        str | None,
        typer.Option("--federate", metavar="NAME", help="Run this federate only; others run elsewhere. With --broker."),
    ] = None,
    broker: Annotated[
        str | None,
        typer.Option(
            metavar="HOST:PORT", help="The HELICS broker of all federates; default one of the run, on loopback."
        ),
    ] = None,
    core: Annotated[
        str,
        typer.Option(
            **choice("tcp_ss", "tcp", "zmq", "ipc"), help="How HELICS carries messages; ipc on one machine only."
        ),
    ] = "tcp_ss",
    unpack_limit: UnpackOption = None,
    **options: Unpack[PackageOptions],
) -> None:
    """Run a system package in several processes, on this machine or on several, joined by HELICS.

    Each steps its components with what the others had at the start of the step, as --master jacobi does in one process.
    """
    from vdfmu.engine.federation import Federation
    from vdfmu.engine.package_run import default_folder

    if options["out"] is None and only is not None:
        folder = default_folder(package)
        options["out"] = folder.with_name(f"{folder.name}_{only}")
    _run_package(package, unpack_limit, **options, federation=Federation(split, only, broker, core))


def report(
    folders: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="[DIR ...]",
            help="Folders of runs; several are compared on one page. Of a folder of runs: index.html, a list of links "
            "with verdicts. Default: the newest in results.",
            show_default=False,
        ),
    ] = None,
    out: Annotated[
        Path | None,
        out_option(
            "File to write; default report.html in the folder, of several comparison.html beside it. FILE.tex has "
            "the tables as LaTeX."
        ),
    ] = None,
    simulate: Annotated[
        bool, typer.Option(help="Let the page run them again, with sliders, where the compiler is installed.")
    ] = True,
    opened: OpenOption = False,
    overwrite: ForeignOption = False,
) -> None:
    """Write the page of a run, or of several side by side: one file, which any browser opens."""
    from vdfmu.study.report.gallery import INDEX, is_gallery, write_gallery
    from vdfmu.study.report.latex import SUFFIX, write_tables
    from vdfmu.study.report.page import NAME, write_report
    from vdfmu.study.report.sheets import sheets
    from vdfmu.study.report.shown_run import newest_run, read_run, run_folder

    if folders and len(folders) == 1 and is_gallery(folders[0]):
        page = out or inside(folders[0], folders[0] / INDEX)
        with replacing_foreign(overwrite):
            require_ours(page)
        say_written(write_gallery(folders[0], page))
        _say_page(page, opened)
        return
    folders = folders or [newest_run(Path("results"))]
    runs = [read_run(folder) for folder in folders]
    page = out or (run_folder(folders[0]) / NAME if len(runs) == 1 else folders[0].parent / "comparison.html")
    if out is None:
        inside(folders[0] if len(runs) == 1 else page.parent, page)
    with replacing_foreign(overwrite):
        require_ours(page)
    if page.suffix == SUFFIX:
        say_written(write_tables((sheet for each in runs for sheet in sheets(each.summary)), page))
        return
    write_report(runs, page, simulate=simulate)
    say_written(page)
    _say_page(page, opened)


def _run_package(package: Path, unpack_limit: int | None, **options: Unpack[SystemOptions]) -> None:
    """Run a package with what a command line says, and print what the run was."""
    from vdfmu.engine.package.limits import package_limit
    from vdfmu.engine.package_run import default_folder, run_system
    from vdfmu.engine.results.folder import PARTIAL, SYSTEM_OUTPUTS, written
    from vdfmu.engine.run import Interrupted
    from vdfmu.study.report import tables

    folder = Path(options["out"] or default_folder(package))
    try:
        with unit_messages() as log, package_limit(unpack_limit):
            options["log"] = log
            results = run_system(package, **options)
    except (CosimError, Interrupted) as error:
        if error.results is not None:
            from vdfmu.study.report.page import write_failed  # takes long to import

            write_failed(package.stem, package, folder / PARTIAL, error)
            _say_failed(error, folder)
        raise
    tell(tables.run_panel(results.summary))
    say_written(*(folder / name for name in written(folder, SYSTEM_OUTPUTS)))


def _say_verdict(summary: Mapping[str, Any]) -> None:
    """Print the verdict on a run in a line; with ``--quiet`` of a run that is not good."""
    from vdfmu.engine.results.verdict import GOOD, state_of
    from vdfmu.study.report.tables import verdict_text

    if (text := verdict_text(summary)) and not (errors.quiet and state_of(summary) == GOOD):
        console.print(text, soft_wrap=True)


def _say_page(page: Path, opened: bool) -> None:
    """Print how to open a page, as a link where the terminal has them, and open it if that is wanted."""
    address = page.resolve().as_uri()
    if not errors.quiet and page.exists():
        console.print(Text.assemble("Open ", (str(page), f"link {address}")), soft_wrap=True)
    if opened and not webbrowser.open(address):
        say_notes([f"{page}: expected a browser to open it in, found none."])
