"""``vdfmu run``, ``simulate`` and ``federate``."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from vdfmu.base.errors import UsageError
from vdfmu.cli.terminal import (
    BackendOption,
    RobotOption,
    ScenarioArgument,
    SetOption,
    UnpackOption,
    complete_robot,
    console,
    load,
    parse_settings,
    say,
    say_notes,
    tell,
    unit_messages,
)
from vdfmu.cli.view import LiveOption, PortOption, SpeedOption, live_view
from vdfmu.engine.algorithms import choice
from vdfmu.engine.results.formats import FORMATS, choice_of_formats

StepOption = Annotated[float | None, typer.Option(help="Communication step in seconds.")]
StopOption = Annotated[float | None, typer.Option(help="End of the run in seconds.")]
MasterOption = Annotated[str | None, typer.Option(help=f"{choice()}.")]
AdaptiveOption = Annotated[
    float | None,
    typer.Option(
        help="Relative error of a coupled signal that a communication step may have; steps are shortened to it.",
        show_default=False,
    ),
]
OverwriteOption = Annotated[
    bool,
    typer.Option("--overwrite", help="Replace files of these names too that no run wrote."),
]

InputOption = Annotated[
    list[str] | None,
    typer.Option(
        "--input",
        metavar="FILE.csv",
        help="Signals for inputs that nothing is connected to: columns time and, say, 'plant.F_e[1] [N]'. Repeatable.",
    ),
]
HoldOption = Annotated[
    bool,
    typer.Option(
        "--input-hold", help="Hold the values of --input until the next row; else they run linearly."
    ),
]
UnitOption = Annotated[
    list[str] | None,
    typer.Option(
        metavar="COMPONENT=UNIT",
        help="Unit in place of a component's: my_unit.py, my_units.py:Name, or an FMU of any tool. Repeatable.",
    ),
]

FormatOption = Annotated[
    str,
    typer.Option(
        "--format",
        metavar="|".join(suffix[1:] for suffix in FORMATS),
        help=f"Files of the results: {choice_of_formats()}.",
    ),
]

PackageArgument = Annotated[
    Path, typer.Argument(help="A system package of SSP 1.0 or 2.0, of this or any other tool.")
]
VariantOption = Annotated[
    str, typer.Option(metavar="SSD", help="The SSD to run, where the package has several.")
]
StartOption = Annotated[float | None, typer.Option(help="Start of the run in seconds.")]
ToleranceOption = Annotated[float | None, typer.Option(help="Relative tolerance for the units' solvers.")]
RecordOption = Annotated[
    list[str] | None,
    typer.Option(metavar="SIGNAL", help="Signals to record, such as 'plant.q[*]'; default all. Repeatable."),
]
ValueOption = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="COMPONENT.VARIABLE=VALUE",
        help="Set a parameter or input; without an index, of all elements. Repeatable.",
    ),
]
UnmatchedOption = Annotated[
    bool,
    typer.Option(
        "--ignore-unmatched", help="Ignore values of the package's parameter sets that no variable takes."
    ),
]


def run(
    context: typer.Context,
    scenario: ScenarioArgument = "tracking",
    robot: RobotOption = None,
    step: StepOption = None,
    stop: StopOption = None,
    master: MasterOption = None,
    adaptive: AdaptiveOption = None,
    out: Annotated[Path | None, typer.Option(help="Folder of the results; default results/SCENARIO.")] = None,
    overwrite: OverwriteOption = False,
    no_reference: Annotated[
        bool, typer.Option("--no-reference", help="Do not solve the references.")
    ] = False,
    backend: BackendOption = None,
    fmi: Annotated[str, typer.Option(help="Version of FMI: 2.0, or 3.0 for native FMUs.")] = "2.0",
    settings: SetOption = None,
    unit: UnitOption = None,
    inputs: InputOption = None,
    input_hold: HoldOption = False,
    formats: FormatOption = "csv",
    pictures: Annotated[
        str, typer.Option("--pictures", help="Kinds of the figures: png, svg and pdf, separated by commas.")
    ] = "png",
    simulate: Annotated[
        bool, typer.Option("--simulate", help="Let report.html run the scenario again, with sliders.")
    ] = False,
    study: Annotated[
        Path | None,
        typer.Option(
            "--from", metavar="SWEEP", help="Run a point of a parameter study: sweep.parquet or its folder."
        ),
    ] = None,
    row: Annotated[
        str | None, typer.Option(help="Of --from: worst, best, or the number of a point; default worst.")
    ] = None,
    by: Annotated[
        str | None, typer.Option(help="Of worst and best: by which measure; default the first.")
    ] = None,
    live: LiveOption = False,
    speed: SpeedOption = None,
    port: PortOption = None,
) -> None:
    """Run a scenario: build what is stale, co-simulate, solve the references, compare, write tables and figures.

    The exit code is 1 if a check of the run failed.
    """
    way = {
        ".ssp": "is a system package; 'vdfmu simulate' runs it",
        ".py": "is a unit; 'vdfmu build' makes its FMU, and --unit COMPONENT=FILE puts it into a scenario",
    }.get(Path(scenario).suffix.lower())
    if way:
        raise UsageError(f"{scenario}: expected a scenario; this {way}.")
    given: dict[str, Any] = {
        "units": parse_settings(unit, "--unit", "COMPONENT=UNIT, such as controller=my_unit.py")
    }
    given |= {"step": step, "stop": stop, "master": master, "adaptive": adaptive, "inputs": inputs}
    given |= {"input_hold": input_hold or None, "settings": parse_settings(settings)}
    if study is None:
        if row is not None or by is not None:
            raise UsageError("row, by: expected --from with a parameter study, of which they choose a point.")
        given["scenario"] = load(scenario, robot)
    else:
        from vdfmu.study.sweeps.study import Sweep

        source = context.get_parameter_source("scenario")
        if source is not None and source.name == "COMMANDLINE":
            raise UsageError(
                f"{scenario}: expected no scenario beside --from: {study} has that of its study."
            )
        found = Sweep(study)
        point = found.options(row or "worst", by)
        say_notes(found.notes)
        chosen = {name: value for name, value in given.items() if value not in (None, {}, [])}
        given = point | chosen | {"units": {**point.get("units", {}), **given["units"]}}
        given["settings"] = point["settings"] | parse_settings(settings)
        given["robot"] = robot or point.get("robot")
    from vdfmu.study.report import tables
    from vdfmu.study.report.sheets import sheets
    from vdfmu.study.run.scenario_run import RUN_OUTPUTS
    from vdfmu.study.run.scenario_run import run as run_study

    with live_view(live, port, speed) as observer:
        with unit_messages() as log:
            results = run_study(
                **given,
                out=out,
                overwrite=overwrite,
                reference=not no_reference,
                backend=backend,
                fmi_version=fmi,
                formats=formats.split(","),
                pictures=pictures.split(","),
                simulate=simulate,
                log=log,
                observer=observer,
            )
        summary = results.summary
        passed = summary["verdict"]["passed"]
        tell(tables.run_panel(summary), *map(tables.sheet_table, sheets(summary)))
        (tell if passed else console.print)(tables.verdict_table(summary))
        _say_written(out if out is not None else Path("results") / summary["scenario"], RUN_OUTPUTS)
    if not passed:
        raise typer.Exit(1)


def simulate(
    package: PackageArgument,
    variant: VariantOption = "SystemStructure.ssd",
    start: StartOption = None,
    stop: StopOption = None,
    step: StepOption = None,
    master: MasterOption = None,
    adaptive: AdaptiveOption = None,
    tolerance: ToleranceOption = None,
    out: Annotated[Path | None, typer.Option(help="Folder of the results; default results/NAME_ssp.")] = None,
    overwrite: OverwriteOption = False,
    record: RecordOption = None,
    settings: ValueOption = None,
    inputs: InputOption = None,
    input_hold: HoldOption = False,
    ignore_unmatched: UnmatchedOption = False,
    unpack_limit: UnpackOption = None,
    isolate: Annotated[
        bool | None,
        typer.Option(
            "--isolate/--no-isolate",
            help="Run the components in a process of their own, which they may crash. Default: where an FMU was not "
            "built by this project.",
            show_default=False,
        ),
    ] = None,
    time_limit: Annotated[
        float | None, typer.Option(help="Seconds that isolated components have for a step; default 300.")
    ] = None,
    memory_limit: Annotated[
        float | None,
        typer.Option(help="Memory in MB that isolated components have; default half of the machine's."),
    ] = None,
    formats: FormatOption = "csv",
    plot: Annotated[bool, typer.Option("--plot", help="Draw the signals: signals.png.")] = False,
    live: LiveOption = False,
    speed: SpeedOption = None,
    port: PortOption = None,
    robot: Annotated[
        str | None,
        typer.Option(
            help="Of --live: whose arm it is, a name or the path of a TOML file; plant.q are its positions.",
            autocompletion=complete_robot,
        ),
    ] = None,
) -> None:
    """Run a system package, and write its signals.

    Start, stop, step and master that are not given are those of the package's default experiment and its annotations.
    """
    if robot is not None and not live:
        raise UsageError("--robot: expected --live, which it is for.")
    with live_view(live, port, speed, robot) as observer:
        _run_package(
            package, out, unpack_limit, settings, record, formats, variant=variant, start=start, stop=stop, step=step,
            master=master, adaptive=adaptive, tolerance=tolerance, inputs=inputs, input_hold=input_hold,
            ignore_unmatched=ignore_unmatched, isolate=isolate, time_limit=time_limit, memory_limit=memory_limit,
            overwrite=overwrite, plot=plot, observer=observer,
        )  # fmt: skip


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
    only: Annotated[
        str | None,
        typer.Option(
            "--federate", metavar="NAME", help="Run this federate only; others run elsewhere. With --broker."
        ),
    ] = None,
    broker: Annotated[
        str | None,
        typer.Option(
            metavar="HOST:PORT",
            help="The HELICS broker of all federates; default one of the run, on loopback.",
        ),
    ] = None,
    core: Annotated[
        str,
        typer.Option(help="How HELICS carries messages: tcp_ss, tcp, zmq, or ipc on one machine."),
    ] = "tcp_ss",
    variant: VariantOption = "SystemStructure.ssd",
    start: StartOption = None,
    stop: StopOption = None,
    step: StepOption = None,
    tolerance: ToleranceOption = None,
    out: Annotated[
        Path | None,
        typer.Option(help="Folder of the results; default results/NAME_ssp, or NAME_ssp_FEDERATE."),
    ] = None,
    overwrite: OverwriteOption = False,
    formats: FormatOption = "csv",
    record: RecordOption = None,
    settings: ValueOption = None,
    inputs: InputOption = None,
    input_hold: HoldOption = False,
    ignore_unmatched: UnmatchedOption = False,
    unpack_limit: UnpackOption = None,
    time_limit: Annotated[
        float | None,
        typer.Option(help="Seconds that a step may take, and each wait for others; default 300."),
    ] = None,
) -> None:
    """Run a system package in several processes, on this machine or on several, joined by HELICS.

    Each steps its components with what the others had at the start of the step, as --master jacobi does in one process.
    """
    from vdfmu.engine.federation import Federation
    from vdfmu.engine.simulate import default_folder

    if out is None and only is not None:
        folder = default_folder(package)
        out = folder.with_name(f"{folder.name}_{only}")
    _run_package(
        package, out, unpack_limit, settings, record, formats, variant=variant, start=start, stop=stop, step=step,
        tolerance=tolerance, inputs=inputs, input_hold=input_hold, ignore_unmatched=ignore_unmatched,
        time_limit=time_limit, overwrite=overwrite, federation=Federation(split, only, broker, core),
    )  # fmt: skip


def report(
    folders: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="[DIR ...]",
            help="Folders of runs; several are compared on one page. Default: the newest in results.",
            show_default=False,
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            help="File to write; default report.html in the folder, of several comparison.html beside it."
        ),
    ] = None,
    simulate: Annotated[
        bool, typer.Option(help="Let the page run them again, with sliders, where the compiler is installed.")
    ] = True,
) -> None:
    """Write the page of a run, or of several beside each other: one file, which any browser opens."""
    from vdfmu.study.report.page import NAME, newest_run, read_run, write_report

    folders = folders or [newest_run(Path("results"))]
    runs = [read_run(folder) for folder in folders]
    default = folders[0] / NAME if len(runs) == 1 else folders[0].parent / "comparison.html"
    say(f"Written to {write_report(runs, out or default, simulate=simulate)}")


def _run_package(
    package: Path,
    out: Path | None,
    unpack_limit: int | None,
    settings: list[str] | None,
    record: list[str] | None,
    formats: str,
    **options: Any,
) -> None:
    """Run a package with what a command line says, and print what the run was."""
    from vdfmu.engine.package.limits import package_limit
    from vdfmu.engine.results.folder import SYSTEM_OUTPUTS
    from vdfmu.engine.simulate import default_folder, run_system
    from vdfmu.study.report import tables

    with unit_messages() as log, package_limit(unpack_limit):
        results = run_system(
            package, settings=parse_settings(settings), record=record or None, out=out, formats=formats.split(","),
            log=log, **options,
        )  # fmt: skip
    tell(tables.run_panel(results.summary))
    _say_written(out or default_folder(package), SYSTEM_OUTPUTS)


def _say_written(folder: Path, outputs: Sequence[str]) -> None:
    from vdfmu.engine.results.folder import written

    say(f"Written to {folder}: {', '.join(written(folder, outputs))}")
