"""Builds the FMUs of a scenario and writes its system as a package: SSP 1.0 or 2.0."""

from __future__ import annotations

import io
import os
import re
import zipfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from vdfmu.arm.fmus import build_fmus
from vdfmu.arm.robot import Robot
from vdfmu.base.cache import cache_folder, load, store
from vdfmu.base.errors import StorageError, UsageError
from vdfmu.base.files import data_path, pack_zip, read_member, regular_target, require_ours, storing
from vdfmu.base.option import checks_types
from vdfmu.base.platforms import native_available, this_platform
from vdfmu.base.standards import FMI_2, FMI_VERSIONS, PYTHON_FMI, SSP_1, SSP_FORMATS, SspFormat
from vdfmu.compiler.fmu.build import FMI, Content, choose_backend, form_of, targets, unit_name
from vdfmu.compiler.unit import Unit
from vdfmu.engine.package.parse import to_bytes, validate
from vdfmu.system.package import structure_file as files
from vdfmu.system.package.description import SystemDescription
from vdfmu.system.package.drawing import icon_source
from vdfmu.system.scenario.scenario import Scenario

_VERSION = re.compile(rb'<fmiModelDescription[^>]*\sfmiVersion="([^"]*)"')


def ssp_format(version: str) -> SspFormat:
    """Return a version of SSP by name. UsageError for an unknown one."""
    if version not in SSP_FORMATS:
        raise UsageError(f"There is no SSP {version!r} here. There are: {', '.join(map(repr, SSP_FORMATS))}.")
    return SSP_FORMATS[version]


def fmi_of_format(form: str, backend: str | None) -> str:
    """Return the FMI version of an SSP version. UsageError if it is unknown or its units cannot be built here."""
    version = ssp_format(form).fmi.name
    if version != PYTHON_FMI.name and backend == "python":
        raise UsageError(
            f"--ssp {form}: contains units of FMI {version}, but Python FMUs have FMI {PYTHON_FMI.name}. "
            f"Omit --backend python, or use --ssp {SSP_1.name}."
        )
    if version != PYTHON_FMI.name and not native_available():
        raise UsageError(
            f"--ssp {form}: contains native units of FMI {version}, whose compiler is not installed. "
            f"Install it (pip install vdfmu[native]), or use --ssp {SSP_1.name}."
        )
    return version


def require_fmi(fmus: Mapping[str, str | os.PathLike[str]], versions: Sequence[str], form: str) -> list[str]:
    """Return the FMI versions of units. StorageError if unreadable, UsageError for versions not in `versions`."""
    there: set[str] = set()
    for component, fmu in fmus.items():
        content = read_member(Path(fmu), "modelDescription.xml")
        if content is None:
            raise StorageError(f"{component}: {fmu} is missing or no FMU. Build it with vdfmu.arm.fmus.build_fmus.")
        match = _VERSION.search(content)
        got = match[1].decode() if match else "none"
        if got not in versions:
            raise UsageError(
                f"{component}: {form} holds units of FMI {' or '.join(versions)}, got {Path(fmu).name} of FMI {got}. "
                f'Build it with fmi_version="{versions[0]}".'
            )
        there.add(got)
    return sorted(there)


@checks_types
def write_ssp(
    scenario: Scenario,
    fmus: Mapping[str, str | os.PathLike[str]],
    path: str | os.PathLike[str],
    values: Mapping[str, Mapping[str, Any]] | None = None,
    *,
    version: str = SSP_1.name,
    mixed: bool = False,
) -> Path:
    """Write the system of a scenario as a package with its FMUs.

    It contains the structure with its diagram, parameter sets for robot and scenario, parameter mappings where names
    differ, and ``documentation/index.html``. The result is reproducible to the bit.

    Parameters
    ----------
    scenario : Scenario
    fmus : mapping of component to path
        FMUs from :func:`vdfmu.arm.fmus.build_fmus`, for the scenario's robot: FMI 2.0 for SSP 1.0, FMI 3.0 for SSP 2.0.
        FMUs of components that the scenario's system does not have are ignored.
    path : path
        File to write, ``name.ssp``.
    values : mapping of component to mapping of variable to value, optional
        Parameter values, see :func:`vdfmu.system.scenario.values.system_values`; by default those of robot and
        scenario.
    version : "1.0" or "2.0", optional
        Version of SSP. With 2.0, connectors and parameters are arrays if they are arrays in the FMI 3.0 units.
    mixed : bool, optional
        Whether FMI 2.0 and 3.0 may be mixed, for this project's master: in SSP 1.0, arrays of FMI 3.0 then have a
        connector per element, which other tools do not support.

    Returns
    -------
    Path
        `path`.

    Raises
    ------
    UsageError
        For an unknown version, FMUs that the version does not support, or components without an FMU.
    StorageError
        If an FMU cannot be read, or the file cannot be written or is not a regular file.
    """
    if not os.fspath(path):
        raise StorageError("the name of the file to write is empty; expected one such as system.ssp")
    path = Path(path)
    regular_target(path)
    require_ours(path)
    form = ssp_format(version)
    description = SystemDescription(scenario, values, version)
    fmus = {component: fmu for component, fmu in fmus.items() if component in description.tables}
    if lacking := [component for component in description.tables if component not in fmus]:
        raise UsageError(
            f"fmus: expected one of each component of {scenario.name}, got none of {', '.join(lacking)}. Build them "
            "with vdfmu.arm.fmus.build_fmus, or run vdfmu ssp, which builds all of them."
        )
    there = require_fmi(fmus, tuple(FMI_VERSIONS) if mixed else (form.fmi.name,), f"SSP {version}")
    icons = {icon_source(name): _icon(table.name) for name, table in description.tables.items()}
    members = {**system_texts(description, version), **icons}
    members["documentation/index.html"] = files.system_page(description, icons, there)
    with storing(path):
        for component, fmu in fmus.items():
            members[f"resources/{description.fmu_name(component)}"] = Path(fmu).read_bytes()
        path.parent.mkdir(parents=True, exist_ok=True)
        pack_zip(path, members)
    return path


def system_texts(description: SystemDescription, version: str = SSP_1.name) -> dict[str, bytes]:
    """Return the text files of SSP in a package, by path: structure, parameter sets, mappings."""
    members = {
        "SystemStructure.ssd": _checked(files.structure_file(description), "ssd", "SystemStructure.ssd", version)
    }
    for file, parameters in description.parameter_sets.items():
        members[f"resources/{file}"] = _checked(files.parameter_file(parameters, version), "ssv", file, version)
    for component, bindings in description.bindings.items():
        for binding in bindings:
            if binding.mapping:
                name = files.mapping_name(component, binding.file)
                mapping = files.mapping_file(binding.mapping, version)
                members[f"resources/{name}"] = _checked(mapping, "ssm", name, version)
    return members


def _icon(unit: str) -> bytes:
    icons = data_path("fmu_src") / "icons"
    icon = icons / f"{unit}.svg"
    return (icon if icon.is_file() else icons / "unit.svg").read_bytes()


def _checked(root: Any, kind: str, name: str, version: str) -> bytes:
    """Return the content of a file, validated if its schemas are always installed."""
    if SSP_FORMATS[version].always_validated:
        validate(root, kind, name, version)
    return to_bytes(root)


def build_parts(
    scenario: Scenario,
    folder: str | os.PathLike[str],
    values: Mapping[str, Mapping[str, Any]] | None = None,
    *,
    target: str = FMI,
    **options: Any,
) -> dict[str, Path]:
    """Build the FMUs of the scenario's system, or use its foreign FMUs; return component to FMU.

    `values` are start values by component. `target` and `options`: see :func:`vdfmu.arm.fmus.build_fmus`. Components
    with the same unit have different FMUs if their start values differ. Components without an FMU for the target are
    omitted.
    """
    against, robots = _reasons(scenario, target), scenario.resolved.robots
    units = {name: unit for name, unit in scenario.resolved.units.items() if not against[name]}
    # links and joints of the same kind share an FMU: the package has their numbers
    starts = {name: each for name, each in (values or {}).items() if name in units and not units[name].exchange}
    placed = _placed(units, robots, starts, Path(folder))
    foreign = scenario.system.parts.items() if target == FMI else ()
    fmus: dict[str, Path] = {name: part.fmu for name, part in foreign if part.fmu is not None}
    for place, robot in dict.fromkeys((placed[name], robots[name]) for name in units):
        here = {name: unit for name, unit in units.items() if (placed[name], robots[name]) == (place, robot)}
        parameters = {unit_name(unit): dict(starts.get(name, {})) for name, unit in here.items()}
        built = build_fmus(
            robot,
            place,
            units=list(dict.fromkeys(here.values())),
            parameters=parameters,
            target=target,
            step=scenario.step,
            folded=True,
            **options,  # None: folded as the robot says, since the caller has chosen
        )
        fmus |= {name: built[unit_name(unit)] for name, unit in here.items()}
    return {name: fmus[name] for name in scenario.system.parts if name in fmus}


def _reasons(scenario: Scenario, target: str) -> dict[str, str]:
    """Return component to the reason why it cannot be built for a target; empty for an unknown target."""
    row = targets().get(target)
    return {name: row.load().reason_against(unit) if row else "" for name, unit in scenario.resolved.units.items()}


def left_out(scenario: Scenario, target: str) -> list[str]:
    """Return a sentence for each component that is not built for a target."""
    return [f"{name}: not for {target}: {reason}." for name, reason in _reasons(scenario, target).items() if reason]


def _placed(
    units: Mapping[str, type[Unit]],
    robots: Mapping[str, Robot | None],
    values: Mapping[str, Mapping[str, Any]],
    folder: Path,
) -> dict[str, Path]:
    """Return each component's folder for its FMU, a subfolder if the name has another unit, robot or start values."""
    placed: dict[str, Path] = {}
    taken: dict[str, tuple[type[Unit], Robot | None, dict[str, Any]]] = {}
    for name, unit in units.items():
        mine = unit, robots[name] if unit.needs_robot() else None, dict(values.get(name, {}))
        names = (unit.__name__, unit_name(unit))
        placed[name] = folder if all(taken.get(key, mine) == mine for key in names) else folder / name
        if placed[name] == folder:
            taken |= dict.fromkeys(names, mine)
    return placed


def _fmu(content: bytes) -> bytes:
    """Return the content of an FMU; BadZipFile or KeyError for anything else."""
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        archive.getinfo("modelDescription.xml")
    return content


def cached_fmus(
    scenario: Scenario, folder: str | os.PathLike[str], backend: str | None = None, fmi_version: str = FMI_2.name
) -> dict[str, Path]:
    """Return the FMUs of a scenario's system in `folder`, from the cache by content, or newly built."""
    backend = choose_backend(backend)
    fmus = {name: part.fmu for name, part in scenario.system.parts.items() if part.fmu is not None}
    missing: dict[str, Path] = {}
    units, robots = scenario.resolved.units, scenario.resolved.robots
    placed = _placed(units, robots, {}, Path(folder))
    for name, unit in units.items():
        form = form_of(unit, backend, fmi_version)
        content = Content(unit, robots[name] if unit.needs_robot() else None, {}, *form)
        place = cache_folder() / "fmus" / f"{content.guid.strip('{}')}-{this_platform()}"
        if (fmu := load(place, _fmu)) is None:
            missing[name] = place
            continue
        fmus[name] = placed[name] / f"{unit.__name__}.fmu"
        with storing(fmus[name]):
            placed[name].mkdir(parents=True, exist_ok=True)
            fmus[name].write_bytes(fmu)
    if missing:
        fmus = build_parts(scenario, folder, backend=backend, fmi_version=fmi_version)
        for name, place in missing.items():
            store(place, fmus[name].read_bytes())
    return {name: fmus[name] for name in scenario.system.parts}
