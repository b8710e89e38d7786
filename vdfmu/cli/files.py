"""``vdfmu build``, ``container``, ``ssp``, ``reference`` and ``check``: FMUs and packages."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from vdfmu.base.errors import StorageError
from vdfmu.base.files import PACKAGE, replacing_foreign, require_ours
from vdfmu.base.option import read_settings
from vdfmu.base.plugins import added
from vdfmu.base.standards import PYTHON_FMI, SSP_1, SSP_FORMATS
from vdfmu.base.text import first_few
from vdfmu.base.toml_file import shipped_names
from vdfmu.cli.terminal import (
    BackendOption,
    FmiOption,
    ForeignOption,
    JsonOption,
    RobotOption,
    ScenarioArgument,
    SetOption,
    UnpackOption,
    choice,
    fail,
    load,
    out_option,
    say,
    say_json,
    say_notes,
    say_written,
    typer_option,
)
from vdfmu.engine.rules import Finding
from vdfmu.study.options import RobotOptions

if TYPE_CHECKING:
    from vdfmu.system.scenario import Scenario


def build(
    scenario: Annotated[
        str,
        typer.Argument(
            metavar="SCENARIO|UNIT",
            help="Name or file of a scenario, or a unit: controller, my_unit.py or my_units.py:Name.",
        ),
    ] = "tracking",
    robot: RobotOption = None,
    out: Annotated[Path, out_option("Folder of the FMUs.")] = Path("fmus"),
    backend: BackendOption = None,
    fmi: FmiOption = PYTHON_FMI.name,
    platform: Annotated[
        list[str] | None,
        typer.Option(
            help="Platform of native FMUs, such as x86_64-windows, or all; wasm32 is a module of "
            "WebAssembly. Default this machine's. Repeatable."
        ),
    ] = None,
    sources: Annotated[bool, typer.Option(help="Carry the C of native FMUs in them.")] = True,
    target: Annotated[
        str,
        typer.Option(
            **choice("fmi", "efmi"), help="What to build; efmi: FMUs of controllers, with code for microcontrollers."
        ),
    ] = "fmi",
    precision: Annotated[str, typer.Option(**choice("double", "float32"), help="Numbers of that code.")] = "double",
    step: Annotated[
        float | None, typer.Option(help="Time between steps of that code [s]; default the scenario's, or 0.001.")
    ] = None,
    settings: SetOption = None,
    overwrite: ForeignOption = False,
) -> None:
    """Build the FMUs of a scenario's system, with the scenario's values as start values, or the FMU of a unit."""
    chosen = None if _is_unit(scenario) else load(scenario, robot, settings)
    from vdfmu.arm.fmus import build_fmus
    from vdfmu.arm.robot import load_robot
    from vdfmu.arm.units import find_unit
    from vdfmu.compiler.unit.base import unit_name
    from vdfmu.study.run.scenario_run import prepare
    from vdfmu.system.scenario.parts import build_parts, left_out
    from vdfmu.system.scenario.values import start_values

    asked: Any = {"backend": backend, "fmi_version": fmi, "platforms": platform, "sources": sources, "target": target,
                  "precision": precision}  # fmt: skip
    with replacing_foreign(overwrite):
        if chosen is None:
            unit = find_unit(scenario)
            fixed = load_robot(robot) if robot is not None else None
            values = {unit_name(unit): start_values(unit, fixed, read_settings(settings))}
            asked["step"] = 1e-3 if step is None else step
            built = build_fmus(fixed, out, units=[unit], start_values=values, **asked)
        else:
            if step is not None:
                chosen = prepare(chosen, step=step)
            built = build_parts(chosen, out, _values(chosen, backend, settings), **asked)
            say_notes(left_out(chosen, target))
    say_written(*dict.fromkeys(built.values()))


def _is_unit(name: str) -> bool:
    """Whether what is to be built is a unit, by its file or its name; a scenario of the same name goes first."""
    if name.partition(":")[0].endswith(".py"):
        return True
    units = {path.stem for path in (PACKAGE / "arm" / "units").rglob("[!_]*.py")}  # to import them takes long
    if name in shipped_names("scenarios") or Path(name).suffix or Path(name).is_file():
        return False
    return name in units or added("units", name)


def _values(scenario: Scenario, backend: str | None, settings: list[str] | None) -> dict[str, dict[str, Any]]:
    """Say what is odd about a scenario that is to be built, and return the values of its components."""
    from vdfmu.compiler.fmu.build import build_notes
    from vdfmu.system.scenario.check import model_notes
    from vdfmu.system.scenario.values import system_values

    given = read_settings(settings)
    say_notes([*model_notes(scenario, given), *build_notes(scenario.robot, backend)])
    return system_values(scenario, given)


def container(
    scenario: ScenarioArgument = "tracking",
    robot: RobotOption = None,
    out: Annotated[Path | None, out_option("File to write; default SCENARIO.fmu.")] = None,
    step: Annotated[float | None, typer.Option(help="Step at which the units exchange values.")] = None,
    settings: SetOption = None,
    overwrite: ForeignOption = False,
) -> None:
    """Fold the system of a scenario into one native FMU that steps its units without a master."""
    chosen = load(scenario, robot, settings)
    from vdfmu.base.files import temporary_folder
    from vdfmu.engine.container import write_container
    from vdfmu.study.run.scenario_run import prepare
    from vdfmu.system.package.write import write_ssp
    from vdfmu.system.scenario.parts import cached_fmus

    chosen = prepare(chosen, step=step)
    values = _values(chosen, "native", settings)
    path = out if out is not None else Path(f"{chosen.name}.fmu")
    with replacing_foreign(overwrite), temporary_folder("vdfmu_") as folder:
        require_ours(path)
        package = write_ssp(chosen, cached_fmus(chosen, folder, "native"), Path(folder) / "system.ssp", values)
        written = write_container(package, path, step=chosen.step)
    say_written(written)


def ssp(
    scenario: ScenarioArgument = "tracking",
    robot: RobotOption = None,
    form: Annotated[
        str, typer.Option("--ssp", **choice(*SSP_FORMATS), help="Version of SSP; 2.0 has native units of FMI 3.0.")
    ] = SSP_1.name,
    out: Annotated[Path | None, out_option("File to write; default SCENARIO.ssp or SCENARIO_2.0.ssp.")] = None,
    apart: Annotated[
        bool, typer.Option("--decomposed", help="Wire arms from their links and joints: SCENARIO_decomposed.ssp.")
    ] = False,
    backend: BackendOption = None,
    settings: SetOption = None,
    overwrite: ForeignOption = False,
) -> None:
    """Pack the system of a scenario as an SSP, with FMUs and parameters inside.

    The FMUs have the scenario's values as start values too, for importers that do not apply all parameter sets.
    """
    chosen = load(scenario, robot, settings)
    from vdfmu.base.files import temporary_folder
    from vdfmu.system.package.write import fmi_of_format, write_ssp
    from vdfmu.system.scenario.parts import build_parts

    fmi_version = fmi_of_format(form, backend)
    name = f"{chosen.name}{'_decomposed' * apart}{f'_{form}' * (form != SSP_1.name)}"
    target = out or Path(f"{name}.ssp")
    with replacing_foreign(overwrite):
        require_ours(target)
    values = _values(chosen, backend, settings)
    if apart:
        from vdfmu.system.scenario.decomposed import decomposed

        chosen, values = decomposed(chosen, read_settings(settings))
    with replacing_foreign(overwrite), temporary_folder("vdfmu_") as folder:
        fmus = build_parts(chosen, folder, values, backend=backend, fmi_version=fmi_version)
        say_written(write_ssp(chosen, fmus, target, values, version=form))


def reference(
    scenario: ScenarioArgument = "tracking",
    robot: RobotOption = None,
    out: Annotated[Path, out_option("Folder to write.")] = Path("reference"),
    settings: SetOption = None,
    overwrite: ForeignOption = False,
) -> None:
    """Write a folder for other tools: the system as SSP 1.0 and 2.0, its results, a script that compares."""
    chosen = load(scenario, robot, settings)
    from vdfmu.study.run.reference_folder import write_reference
    from vdfmu.system.package.write import fmi_of_format
    from vdfmu.system.scenario.values import system_values

    for form in SSP_FORMATS:
        fmi_of_format(form, None)
    with replacing_foreign(overwrite):
        say_written(*write_reference(chosen, out, system_values(chosen, read_settings(settings))))


def check(
    file: Annotated[
        Path, typer.Argument(help="An FMU, SSP or SSD of any tool; a robot, scenario or system file; my_unit.py.")
    ],
    no_run: Annotated[bool, typer.Option("--no-run", help="Read only; do not run the units' code.")] = False,
    as_json: JsonOption = False,
    unpack_limit: UnpackOption = None,
    robot: Annotated[
        str, typer_option(RobotOptions, "robot", help="Robot for a unit or a system of one's own.")
    ] = "planar_2dof",
) -> None:
    """Check an FMU or a system: schema, rules, binaries for this platform, ten steps, reference results.

    Steps run code of the file, in a process of its own that is limited in time and memory; not with --no-run.
    """
    from vdfmu.engine.inspect.inspection import inspect_file
    from vdfmu.engine.package.limits import package_limit

    def say_runs(what: str) -> None:
        say_notes([f"runs code of {what} in a process of its own; --no-run reads only"])

    source = file.suffix.lower() in (".toml", ".py")
    try:
        with package_limit(unpack_limit):
            if source:
                from vdfmu.system.inspect_source import inspect_source

                report = inspect_source(file, robot, run=not no_run, say=say_runs)
            else:
                report = inspect_file(file, run=not no_run, say=say_runs)
    except StorageError as error:
        fail(error, 2)
    if as_json:
        say_json(report.to_dict())
    else:
        _report(file, report.kind if source else report.standard, report.problems, report.notes)
    if report.problems:
        raise typer.Exit(1)


def _report(file: Path, what: str | None, problems: Sequence[str], notes: Sequence[str]) -> None:
    """Print findings, and how many are problems."""
    for kind, texts in (("note", notes), ("problem", problems)):
        for text in first_few(texts, _rule):
            rule = f" [{_rule(text)}]" if _rule(text) else ""
            say(f"{kind}: {text}{rule}")  # its rule stands where no script looks for the text
    count = f"{len(problems)} problem(s)" if problems else "no problems"
    say(f"{file}{f' ({what})' if what else ''}: {count}")


def _rule(text: str) -> str:
    """Return the number of the rule of a finding; empty for another text."""
    return text.rule.number if isinstance(text, Finding) else ""
