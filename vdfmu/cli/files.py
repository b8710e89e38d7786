"""``vdfmu build``, ``ssp`` and ``check``: FMUs and packages."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from vdfmu.base.errors import StorageError, UsageError
from vdfmu.base.extras import module_of_extra
from vdfmu.base.files import PACKAGE, replacing_foreign, require_ours
from vdfmu.base.option import Option, option_of
from vdfmu.base.plugins import added
from vdfmu.base.standards import PYTHON_FMI, SSP_1, SSP_FORMATS
from vdfmu.base.text import first_few
from vdfmu.base.toml_file import shipped_names
from vdfmu.cli.app import RUNS, meets_code
from vdfmu.cli.options import (
    BackendOption,
    FmiOption,
    ForeignOption,
    JsonOption,
    Positional,
    RobotOption,
    ScenarioArgument,
    SetOption,
    UnpackOption,
    load,
    refuse,
)
from vdfmu.cli.terminal import fail, say, say_json, say_notes, say_written
from vdfmu.engine.rules import Finding
from vdfmu.study.options import RobotOptions

if TYPE_CHECKING:
    from vdfmu.system.scenario import Scenario

FoldedOption = Annotated[
    bool,
    Option(
        "Fold zero gravity, centroids, tool into the code.",
        more="The FMU is then faster. By default these zeros are parameters that can be set, like those of a payload.",
    ),
]
_SCHEMAS = ("robot", "scenario", "system")


@meets_code(RUNS)
def build(
    scenario: Annotated[
        str,
        Positional(
            "Unit, scenario or package [tracking].",
            metavar="[UNIT|SCENARIO|FILE.ssp]",
            more="A unit is plant, my_unit.py or my_units.py:Name. With --robot the "
            "default is reach. A package, .ssp, needs --container.",
        ),
    ] = "",
    robot: RobotOption = None,
    container: Annotated[
        bool,
        Option(
            "Write one FMU of the whole system.",
            group="Output",
            more="It contains the native FMUs and steps them, so no master is needed.",
        ),
    ] = False,
    out: Annotated[
        Path | None,
        Option("Folder (default fmus), or the file of --container.", more="The default of the file is SCENARIO.fmu."),
    ] = None,
    backend: BackendOption = None,
    fmi: FmiOption = PYTHON_FMI.name,
    platform: Annotated[
        list[str] | None,
        Option(
            "x86_64-windows, .. or all. Repeatable.",
            metavar="NAME",
            more="Default: this machine. wasm32 is a module of WebAssembly.",
        ),
    ] = None,
    sources: Annotated[bool, Option("Include the C sources in native FMUs.")] = True,
    target: Annotated[str, Option("fmi, or efmi for microcontrollers.", metavar="NAME")] = "fmi",
    precision: Annotated[str, Option("Floating-point type of a target.", choices=("double", "float32"))] = "double",
    step: Annotated[
        float | None, Option("Step of the target or the container in s.", more="Default: the scenario's, or 0.001.")
    ] = None,
    parameters: SetOption = None,
    folded: FoldedOption = False,
    overwrite: ForeignOption = False,
) -> None:
    """Build the FMU of a unit, or the FMUs of a scenario. Their start values are the values of the scenario."""
    scenario = scenario or ("tracking" if robot is None else "reach")
    if container:
        of_units = {
            "--backend": backend == "python",
            "--fmi": fmi != PYTHON_FMI.name,
            "--platform": platform,
            "--no-sources": not sources,
            "--target": target != "fmi",
        }
        refuse(of_units, "does not go with --container")
        return say_written(_container(scenario, robot, out, step, parameters, folded, overwrite))
    if scenario.lower().endswith(".ssp"):
        raise UsageError(f"{scenario} is a package of FMUs that are built. Use --container to make one FMU of it.")
    chosen = None if _is_unit(scenario) else _load(scenario, robot, parameters, folded)
    from vdfmu.arm.fmus import build_fmus
    from vdfmu.arm.robot import load_robot
    from vdfmu.arm.units import find_unit
    from vdfmu.compiler.fmu.build import unit_name
    from vdfmu.study.run.prepare import prepare
    from vdfmu.system.package.write import build_parts, left_out
    from vdfmu.system.scenario.replace import robot_for
    from vdfmu.system.scenario.values import start_values

    asked: Any = {
        "backend": backend,
        "fmi_version": fmi,
        "platforms": platform,
        "sources": sources,
        "target": target,
        "precision": precision,
    }
    out = out or Path("fmus")
    with replacing_foreign(overwrite):
        if chosen is None:
            unit = find_unit(scenario)
            fixed = robot_for(load_robot(robot), parameters or {}) if robot is not None else None
            fixed = fixed if folded or fixed is None else fixed.unfolded()
            if scenario in shipped_names("scenarios"):
                say_notes([f"the unit {scenario}. For the scenario: 'vdfmu scenario show {scenario} > my.toml'."])
            values = {unit_name(unit): start_values(unit, fixed, parameters or {})}
            asked["step"] = 1e-3 if step is None else step
            built = build_fmus(fixed, out, units=[unit], parameters=values, folded=True, **asked)
        else:
            if step is not None:
                chosen = prepare(chosen, step=step)
            built = build_parts(chosen, out, _values(chosen, backend, parameters), **asked)
            say_notes(left_out(chosen, target))
    say_written(*dict.fromkeys(built.values()))


def _is_unit(name: str) -> bool:
    """Return whether a name or a file is a unit, which takes precedence over a scenario of that name."""
    if name.partition(":")[0].endswith(".py"):
        return True
    if Path(name).suffix or Path(name).is_file():
        return False
    folders = (PACKAGE / "arm" / "units", *(PACKAGE / "extras").glob("*/units"))
    files = [file for folder in folders for file in folder.rglob("[!_]*.py")]  # importing them takes long
    classes = (re.findall(r"^class (\w+)\(", path.read_text(encoding="utf-8"), re.MULTILINE) for path in files)
    if name in {path.stem for path in files}.union(*classes):
        return True
    return name not in shipped_names("scenarios") and added("units", name)


def _values(scenario: Scenario, backend: str | None, parameters: Mapping[str, str] | None) -> dict[str, dict[str, Any]]:
    """Print notes on a scenario to build, and return the values of its components."""
    from vdfmu.compiler.fmu.build import build_notes
    from vdfmu.system.scenario.check import model_notes
    from vdfmu.system.scenario.values import system_values

    overrides = parameters or {}
    say_notes([*model_notes(scenario, overrides), *build_notes(scenario.robot, backend)])
    return system_values(scenario, overrides)


def _load(name: str, robot: str | None, parameters: Mapping[str, str] | None, folded: bool) -> Scenario:
    """Load a scenario for FMUs that leave this machine."""
    loaded = load(name, robot, parameters)
    from vdfmu.system.scenario.replace import unfolded

    return loaded if folded else unfolded(loaded)


def _container(
    system: str,
    robot: str | None,
    out: Path | None,
    step: float | None,
    parameters: Mapping[str, str] | None,
    folded: bool,
    overwrite: bool,
) -> Path:
    """Write the system of a scenario or a package as one native FMU."""
    if system.lower().endswith(".ssp"):
        refuse({"--robot": robot, "--set": parameters}, f"is for a scenario; {system} has its own")
        from vdfmu.study.connected import load as load_system

        with replacing_foreign(overwrite):
            return load_system(system).container(out or Path(f"{Path(system).stem}.fmu"), step)
    containers = module_of_extra("containers", "container", "--container")
    chosen = _load(system, robot, parameters, folded)
    from vdfmu.base.files import temporary_folder
    from vdfmu.study.run.prepare import prepare
    from vdfmu.system.package.write import cached_fmus, write_ssp

    chosen = prepare(chosen, step=step)
    values = _values(chosen, "native", parameters)
    path = out or Path(f"{chosen.name}.fmu")
    with replacing_foreign(overwrite), temporary_folder("vdfmu_") as folder:
        require_ours(path)
        package = write_ssp(chosen, cached_fmus(chosen, folder, "native"), Path(folder) / "system.ssp", values)
        return containers.write_container(package, path, step=chosen.step)


@meets_code(RUNS)
def ssp(
    scenario: ScenarioArgument = "tracking",
    robot: RobotOption = None,
    form: Annotated[
        str, Option("Version of SSP; 2.0 holds FMUs of FMI 3.0.", flag="--ssp", choices=tuple(SSP_FORMATS))
    ] = SSP_1.name,
    out: Annotated[
        Path | None,
        Option("File to write (default SCENARIO.ssp).", more="With --reference the folder, by default reference."),
    ] = None,
    apart: Annotated[bool, Option("Split arms into their links and joints.", flag="--decomposed")] = False,
    reference: Annotated[
        bool,
        Option(
            "Write a folder for comparison with another tool.",
            group="Output",
            more="It contains the system as SSP 1.0 and 2.0, its results, and a script for the comparison.",
        ),
    ] = False,
    backend: BackendOption = None,
    parameters: SetOption = None,
    folded: FoldedOption = False,
    overwrite: ForeignOption = False,
) -> None:
    """Pack the system of a scenario as an SSP.

    It contains the FMUs and parameters. The FMUs also have the scenario's values as start values, because some
    importers do not apply all parameter sets.
    """
    chosen = _load(scenario, robot, parameters, folded)
    from vdfmu.base.files import temporary_folder
    from vdfmu.system.package.write import build_parts, fmi_of_format, write_ssp
    from vdfmu.system.scenario.values import system_values

    fmi_version = fmi_of_format(form, backend)
    if reference:
        from vdfmu.study.runs import write_reference

        refuse(
            {"--ssp": form != SSP_1.name, "--decomposed": apart, "--backend": backend}, "does not go with --reference"
        )
        for each in SSP_FORMATS:
            fmi_of_format(each, None)
        with replacing_foreign(overwrite):
            return say_written(
                *write_reference(chosen, out or Path("reference"), system_values(chosen, parameters or {}))
            )
    name = f"{chosen.name}{'_decomposed' * apart}{f'_{form}' * (form != SSP_1.name)}"
    target = out or Path(f"{name}.ssp")
    with replacing_foreign(overwrite):
        require_ours(target)
    values = _values(chosen, backend, parameters)
    if apart:
        decomposed = module_of_extra("decomposition", "decompose", "--decomposed").decomposed
        chosen, values = decomposed(chosen, parameters or {})
    with replacing_foreign(overwrite), temporary_folder("vdfmu_") as folder:
        fmus = build_parts(chosen, folder, values, backend=backend, fmi_version=fmi_version)
        say_written(write_ssp(chosen, fmus, target, values, version=form))


def check(
    file: Annotated[
        Path | None,
        Positional(
            "FMU, SSP, SSD, TOML file or unit.", more="It can come from any tool; a unit is a file such as my_unit.py."
        ),
    ] = None,
    no_run: Annotated[bool, Option("Only read the file; do not run its code.")] = False,
    run_anyway: Annotated[bool, Option("Run FMUs even if their description has faults.")] = False,
    as_json: JsonOption = False,
    unpack_limit: UnpackOption = None,
    robot: Annotated[str, option_of(RobotOptions, "robot", "Robot of a unit or system.")] = "planar_2dof",
    schema: Annotated[
        str | None,
        Option(
            "Print a JSON schema: robot, scenario or system.",
            metavar="KIND",
            names=lambda: _SCHEMAS,
            more="If FILE is the system of a scenario, the schema of the scenario also has the sections of its "
            'components. Editors read the schema if the first line of the file is "#:schema robot.schema.json".',
        ),
    ] = None,
) -> None:
    """Check an FMU or a system.

    This checks schema, rules, binaries for this platform, ten steps and reference results. The steps run code of the
    file in a process with limited time and memory; --no-run skips them. A file with problems is run only with
    --run-anyway.
    """
    if schema is not None:
        return _say_schema(schema, file)
    if file is None:
        raise UsageError("check: expected FILE, or --schema KIND, got neither.")
    from vdfmu.engine.inspect.inspection import inspect_file
    from vdfmu.engine.package.archive import package_limit

    def say_runs(subject: str) -> None:
        say_notes([f"runs code of {subject} in another process; --no-run only reads the file"])

    source = file.suffix.lower() in (".toml", ".py")
    try:
        with package_limit(unpack_limit):
            if source:
                from vdfmu.system.inspect_source import inspect_source

                report = inspect_source(file, robot, run=not no_run, say=say_runs)
            else:
                report = inspect_file(file, run=not no_run, say=say_runs, anyway=run_anyway)
    except StorageError as error:
        fail(error, 2)
    if as_json:
        say_json(report.to_dict())
    else:
        _report(file, report.kind if source else report.standard, report.problems, report.notes)
    if report.problems:
        raise SystemExit(1)


def _say_schema(kind: str, system: Path | None) -> None:
    """Print the schema of a kind of TOML file."""
    schemas = module_of_extra("schemas", "schemas", "--schema")
    if kind not in _SCHEMAS:
        raise UsageError(f"--schema must be {', '.join(_SCHEMAS)}, got {kind!r}.")
    if kind != "scenario":
        refuse({"FILE": system}, "goes with --schema scenario")
    arguments = {} if system is None else {"system": str(system)}
    say_json(getattr(schemas, f"{kind}_schema")(**arguments))


def _report(file: Path, label: str | None, problems: Sequence[str], notes: Sequence[str]) -> None:
    """Print findings, and the number of problems and notes."""
    for kind, texts in (("note", notes), ("problem", problems)):
        for text in first_few(texts, _rule):
            rule = f" [{_rule(text)}]" if _rule(text) else ""
            say(f"{kind}: {text}{rule}")  # the rule is in a fixed place, so that scripts need not search the text
    kinds = (("problem", len(problems)), ("note", len(notes)))
    counts = [f"{n} {kind}{'s' * (n > 1)}" for kind, n in kinds if n]
    count = ", ".join(counts if problems else ["no problems", *counts])
    say(f"{file}{f' ({label})' if label else ''}: {count}")


def _rule(text: str) -> str:
    """Return the number of a finding's rule; empty for any other text."""
    return text.rule.number if isinstance(text, Finding) else ""
