"""The command line: ``vdfmu run``, ``build``, ``ssp``, ``container``, ``check`` and ``models``.

Exit codes: 0 done, 1 a check or a unit failed, 2 wrong usage or input, 130 stopped with Ctrl-C.
"""

from __future__ import annotations

import json
import logging
import os
import sys
from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import Annotated, Any, NoReturn

import typer
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.table import Table

from vdfmu import __version__
from vdfmu.cosim import Interrupted, LogMessage
from vdfmu.errors import ModelError, SspError, StorageError, UsageError, VdfmuError
from vdfmu.model import load_robot, load_scenario, robot_names, scenario_names

__all__ = ["app", "main"]

app = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
    help="Flexible-joint manipulators as co-simulation FMUs: build them, wire them, run them, check them.",
)
models_app = typer.Typer(no_args_is_help=True, help="List and show robots and scenarios.")
app.add_typer(models_app, name="models")
console = Console(highlight=False)
errors = Console(stderr=True, highlight=False)

ScenarioArgument = Annotated[str, typer.Argument(help="Name of a shipped scenario, or path of a TOML file.")]
RobotOption = Annotated[
    str | None,
    typer.Option("--robot", help="Robot in place of the scenario's: a name or the path of a TOML file."),
]
BackendOption = Annotated[
    str | None,
    typer.Option(
        "--backend", help="Kind of FMU, native or python; default native where its compiler is installed."
    ),
]
SetOption = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="UNIT.PARAMETER=VALUE",
        help="Set a parameter; without an index, for all joints. Repeatable.",
    ),
]


def _show_version(wanted: bool) -> None:
    if wanted:
        console.print(f"vdfmu {__version__}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool,
        typer.Option("--version", help="Show the version and exit.", is_eager=True, callback=_show_version),
    ] = False,
) -> None:
    pass


def _stoppable(command: Callable[..., None]) -> Callable[..., None]:
    """Say that Ctrl-C stopped a command; typer would end the program without a word."""

    @wraps(command)
    def stoppable(*args: Any, **kwargs: Any) -> None:
        try:
            command(*args, **kwargs)
        except KeyboardInterrupt as stopped:
            kept = "; the rows so far are kept" if isinstance(stopped, Interrupted) else ""
            errors.print(f"stopped: {stopped}{kept}" if str(stopped) else "stopped", markup=False)
            raise typer.Exit(130) from None

    return stoppable


@app.command(epilog="Example: [bold]vdfmu run tracking --set controller.K_p=1500 --out results/soft[/bold]")
@_stoppable
def run(
    scenario: ScenarioArgument = "tracking",
    robot: RobotOption = None,
    step: Annotated[float | None, typer.Option(help="Communication step in seconds.")] = None,
    stop: Annotated[float | None, typer.Option(help="End of the run in seconds.")] = None,
    master: Annotated[
        str | None, typer.Option(help="gauss-seidel, jacobi, extrapolated or iterative.")
    ] = None,
    adaptive: Annotated[
        float | None,
        typer.Option(
            help="Relative error of a coupled signal that a communication step may have; steps are shortened to it.",
            show_default=False,
        ),
    ] = None,
    out: Annotated[Path | None, typer.Option(help="Folder of the results; default results/SCENARIO.")] = None,
    no_reference: Annotated[
        bool, typer.Option("--no-reference", help="Do not solve the references.")
    ] = False,
    backend: BackendOption = None,
    container: Annotated[
        bool, typer.Option("--container", help="Fold the units into one container FMU and run that.")
    ] = False,
    settings: SetOption = None,
) -> None:
    """Run a scenario: build what is stale, co-simulate, solve the references, compare, write tables and figures."""
    from vdfmu.report import tables
    from vdfmu.study.run import run as run_study

    with _Bars() as bars:
        results = run_study(
            scenario,
            robot=robot,
            step=step,
            stop=stop,
            master=master,
            adaptive=adaptive,
            out=out,
            reference=not no_reference,
            backend=backend,
            container=container,
            settings=_settings(settings),
            progress=bars.update,
            log=bars.log,
        )
    summary = results.summary
    console.print(tables.run_panel(summary))
    console.print(
        tables.contrast_table(summary) if summary["kind"] == "contrast" else tables.tracking_table(summary)
    )
    if "reference" in summary:
        console.print(tables.reference_table(summary))
    folder = out if out is not None else Path("results") / summary["scenario"]
    _say(f"Written to {folder}: {', '.join(sorted(p.name for p in folder.iterdir()))}")


@app.command(
    epilog="Example: [bold]vdfmu build tracking --backend native --fmi 3.0 --platform all --out fmus[/bold]"
)
@_stoppable
def build(
    scenario: ScenarioArgument = "tracking",
    robot: RobotOption = None,
    out: Annotated[Path, typer.Option(help="Folder of the FMUs.")] = Path("fmus"),
    backend: BackendOption = None,
    fmi: Annotated[str, typer.Option(help="Version of FMI: 2.0, or 3.0 for native FMUs.")] = "2.0",
    platform: Annotated[
        list[str] | None,
        typer.Option(
            help="Platform of native FMUs, such as x86_64-windows, or all; default this machine's. Repeatable."
        ),
    ] = None,
    settings: SetOption = None,
) -> None:
    """Build the four FMUs of a scenario's robot, with the scenario's values as start values."""
    from vdfmu.fmu import build_fmus
    from vdfmu.ssp.parameters import system_values

    chosen = load_scenario(scenario, robot)
    built = build_fmus(
        chosen.robot,
        out,
        start_values=system_values(chosen, _settings(settings)),
        backend=backend,
        fmi_version=fmi,
        platforms=platform,
    )
    for path in built.values():
        _say(str(path))


@app.command(epilog="Example: [bold]vdfmu container tracking --out tracking.fmu[/bold]")
@_stoppable
def container(
    scenario: ScenarioArgument = "tracking",
    robot: RobotOption = None,
    out: Annotated[Path | None, typer.Option(help="File to write; default SCENARIO.fmu.")] = None,
    step: Annotated[float | None, typer.Option(help="Step at which the units exchange values.")] = None,
    settings: SetOption = None,
) -> None:
    """Fold the system of a scenario into one native FMU that steps its units without a master."""
    import tempfile

    from vdfmu.cosim.container import write_container
    from vdfmu.ssp.parameters import system_values
    from vdfmu.ssp.write import write_ssp
    from vdfmu.study.run import cached_fmus, prepare

    chosen = prepare(scenario, robot=robot, step=step)
    values = system_values(chosen, _settings(settings))
    with tempfile.TemporaryDirectory(prefix="vdfmu_") as folder:
        package = write_ssp(chosen, cached_fmus(chosen.robot, "native"), Path(folder) / "system.ssp", values)
        path = out if out is not None else Path(f"{chosen.name}.fmu")
        _say(str(write_container(package, path, step=chosen.step)))


@app.command(epilog="Example: [bold]vdfmu ssp two_joint --format 2.0 --out two_joint.ssp[/bold]")
@_stoppable
def ssp(
    scenario: ScenarioArgument = "tracking",
    robot: RobotOption = None,
    form: Annotated[
        str,
        typer.Option(
            "--format",
            help="1.0 or 2.0: version of SSP, 2.0 with native units of FMI 3.0. osp: a folder for libcosim.",
        ),
    ] = "1.0",
    out: Annotated[
        Path | None,
        typer.Option(help="File to write, default SCENARIO.ssp; with osp a folder, default SCENARIO_osp."),
    ] = None,
    backend: BackendOption = None,
    settings: SetOption = None,
) -> None:
    """Pack the system of a scenario as an SSP or for libcosim, with FMUs and parameters inside.

    The FMUs have the scenario's values as start values too, for importers that do not apply all parameter sets.
    """
    import tempfile

    from vdfmu.fmu import build_fmus
    from vdfmu.ssp.parameters import system_values
    from vdfmu.ssp.versions import fmi_of_format
    from vdfmu.ssp.write import write_osp, write_ssp

    fmi_version = fmi_of_format(form, backend)
    chosen = load_scenario(scenario, robot)
    values = system_values(chosen, _settings(settings))
    with tempfile.TemporaryDirectory(prefix="vdfmu_") as folder:
        fmus = build_fmus(chosen.robot, folder, start_values=values, backend=backend, fmi_version=fmi_version)
        if form == "osp":
            _say(str(write_osp(chosen, fmus, out or Path(f"{chosen.name}_osp"), values)))
        else:
            _say(str(write_ssp(chosen, fmus, out or Path(f"{chosen.name}.ssp"), values, version=form)))


@app.command(epilog="Example: [bold]vdfmu check fmus/Plant.fmu[/bold]")
@_stoppable
def check(
    file: Annotated[Path, typer.Argument(help="An FMU, SSP, SSD or OSP file, of this or any other tool.")],
    no_run: Annotated[bool, typer.Option("--no-run", help="Read only; do not run the units' code.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print the findings as JSON.")] = False,
) -> None:
    """Check an FMU or a system: schema, rules, binaries for this platform, ten steps, reference results."""
    from vdfmu.study.check import inspect_file

    try:
        report = inspect_file(file, run=not no_run)
    except StorageError as error:
        _fail(error, 2)
    if as_json:
        try:
            print(json.dumps(report.to_dict(), indent=1), flush=True)
        except BrokenPipeError:
            raise
        except OSError as error:
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            _fail(f"the findings cannot be written: {error.strerror}", 2)
    else:
        for note in report.notes:
            _say(f"note: {note}")
        for problem in report.problems:
            _say(f"problem: {problem}")
        what = f" ({report.standard})" if report.standard else ""
        count = f"{len(report.problems)} problem(s)" if report.problems else "no problems"
        _say(f"{file}{what}: {count}")
    if report.problems:
        raise typer.Exit(1)


@models_app.command("list", epilog="Example: [bold]vdfmu models list[/bold]")
def list_models() -> None:
    """List the robots and scenarios that travel with the package."""
    for title, names, load in (
        ("Robots", robot_names(), load_robot),
        ("Scenarios", scenario_names(), load_scenario),
    ):
        table = Table(title=title, title_justify="left", show_header=False, box=None)
        for name in names:
            table.add_row(name, load(name).description)
        console.print(table)


@models_app.command("show", epilog="Example: [bold]vdfmu models show manipulator_6dof[/bold]")
def show_model(
    name: Annotated[str, typer.Argument(help="Name of a robot or scenario, or path of a robot's TOML file.")],
) -> None:
    """Show a robot's parameters with their sources, or a scenario's file."""
    from vdfmu.data import data_path

    if name in scenario_names():
        console.print(
            (data_path("models") / "scenarios" / f"{name}.toml").read_text(encoding="utf-8"), markup=False
        )
        return
    robot = load_robot(name)
    console.print(f"[bold]{escape(robot.name)}[/bold]: {escape(robot.description)}")
    table = Table(show_edge=False)
    for heading in ("parameter", *(f"joint {i + 1}" for i in range(robot.n)), "source"):
        table.add_column(heading)
    table.add_row("type", *robot.joint_types, "")
    for section, keys in _SHOWN.items():
        for key in keys:
            cells = [_number(getattr(robot, key)[i]) for i in range(robot.n)]
            table.add_row(key, *cells, escape(robot.source_of(f"joints[1].{section}{key}") or ""))
    console.print(table)


_SHOWN = {
    "": ("offset",),
    "link.": ("mass", "centroid", "inertia"),
    "drive.": ("ell", "I_m", "K_f0", "c_f", "K_w0", "c_w", "theta_err_amplitude", "theta_err_phase"),
    "friction.": ("f_c", "f_s", "f_v", "v_s", "f_ck", "eps"),
}


def _number(value: Any) -> str:
    if getattr(value, "ndim", 0) == 2:
        diagonal = [value[k, k] for k in range(3)]
        return _number(diagonal[0]) if len(set(diagonal)) == 1 else " ".join(_number(v) for v in diagonal)
    return " ".join(_number(v) for v in value) if getattr(value, "ndim", 0) == 1 else f"{value:g}"


def _say(text: str) -> None:
    """Print a line that may hold a path: unbroken, so that it can be copied or read by a program."""
    console.print(text, markup=False, soft_wrap=True)


def _settings(items: list[str] | None) -> dict[str, str]:
    settings: dict[str, str] = {}
    for item in items or []:
        key, equals, value = item.partition("=")
        if not equals or not key.strip() or not value.strip():
            raise UsageError(f"--set {item}: expected UNIT.PARAMETER=VALUE, such as controller.K_p[1]=3000.")
        settings[key.strip()] = value.strip()
    return settings


class _Bars:
    """Progress bars, one a stage, and the messages of the units above them."""

    def __init__(self) -> None:
        self._progress = Progress(
            TextColumn("{task.description:20}"), BarColumn(), TextColumn("{task.percentage:3.0f} %"),
            TimeElapsedColumn(), TimeRemainingColumn(), console=errors, transient=False,
            disable=not errors.is_terminal,
        )  # fmt: skip
        self._tasks: dict[str, TaskID] = {}
        self._notes: dict[str, list[str]] = {}

    def __enter__(self) -> _Bars:
        self._progress.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._progress.stop()
        for what, names in self._notes.items():
            self.say(f"note: {', '.join(names)}: {what}")

    def update(self, stage: str, done: int, total: int) -> None:
        if stage not in self._tasks:
            self._tasks[stage] = self._progress.add_task(stage)
        self._progress.update(self._tasks[stage], completed=done, total=total)

    def say(self, text: str) -> None:
        self._progress.console.print(text, markup=False, soft_wrap=True)

    def log(self, message: LogMessage) -> None:
        if message.status == "note":
            name, _, what = message.text.partition(": ")
            self._notes.setdefault(what, []).append(name)
        elif message.status not in ("ok", "error", "fatal"):  # the error that ends the run quotes these
            self.say(str(message) if message.unit else f"{message.status}: {message.text}")


def main() -> None:
    """Entry point: run a command and turn errors into a message and an exit code."""
    # Units in this process say what they say through FMI; their own logger would say it again.
    logging.getLogger("vdfmu.fmu").addHandler(logging.NullHandler())
    try:
        app()
    except (UsageError, ModelError, SspError) as error:
        _fail(error, 2)
    except VdfmuError as error:
        _fail(error, 1)
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(1)


def _fail(error: object, code: int) -> NoReturn:
    errors.print(f"[red]error:[/red] {escape(str(error))}", soft_wrap=True)
    sys.exit(code)


if __name__ == "__main__":
    main()
