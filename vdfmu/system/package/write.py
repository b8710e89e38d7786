"""Writing of the system as a package (SSP 1.0 or 2.0): wiring from ``ssp/``, values from the scenario."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from vdfmu.base.errors import StorageError, UsageError
from vdfmu.base.files import data_path, pack_zip, read_member, regular_target, require_ours, storing
from vdfmu.base.standards import FMI_VERSIONS, PYTHON_FMI, SSP_1, SSP_FORMATS, SspFormat
from vdfmu.compiler.c.platforms import native_available
from vdfmu.engine.package.parse import validate
from vdfmu.system.package.description import SystemDescription, icon_source
from vdfmu.system.package.documentation import system_page
from vdfmu.system.package.structure_file import mapping_file, mapping_name, parameter_file, structure_file, to_bytes
from vdfmu.system.scenario import Scenario

_VERSION = re.compile(rb'<fmiModelDescription[^>]*\sfmiVersion="([^"]*)"')


def ssp_format(version: str) -> SspFormat:
    """Return a version of SSP by its name; UsageError for an unknown one."""
    if version not in SSP_FORMATS:
        raise UsageError(f"There is no SSP {version!r} here. There are: {', '.join(map(repr, SSP_FORMATS))}.")
    return SSP_FORMATS[version]


def fmi_of_format(form: str, backend: str | None) -> str:
    """Return the version of FMI that a version of SSP needs.

    Raises
    ------
    UsageError
        For an unknown version, or one that a backend or this installation has no units for.
    """
    version = ssp_format(form).fmi.name
    if version != PYTHON_FMI.name and backend == "python":
        raise UsageError(
            f"--ssp {form}: holds units of FMI {version}, but Python FMUs are of FMI {PYTHON_FMI.name}. "
            f"Leave out --backend python, or take --ssp {SSP_1.name}."
        )
    if version != PYTHON_FMI.name and not native_available():
        raise UsageError(
            f"--ssp {form}: holds native units of FMI {version}, whose compiler is not installed. "
            f"Install it (pip install vdfmu[native]), or take --ssp {SSP_1.name}."
        )
    return version


def require_fmi(fmus: Mapping[str, str | os.PathLike[str]], versions: Sequence[str], what: str) -> list[str]:
    """Check the versions of FMI of the units that go into a package, and return those that there are.

    Raises
    ------
    StorageError
        If an FMU is missing or cannot be read.
    UsageError
        If one is of another version: names of arrays and of their elements differ between the two.
    """
    there: set[str] = set()
    for component, fmu in fmus.items():
        content = read_member(Path(fmu), "modelDescription.xml")
        if content is None:
            raise StorageError(f"{component}: {fmu} is missing or no FMU. Build it with vdfmu.build_fmus.")
        found = _VERSION.search(content)
        got = found[1].decode() if found else "none"
        if got not in versions:
            raise UsageError(
                f"{component}: {what} holds units of FMI {' or '.join(versions)}, got {Path(fmu).name} of FMI {got}. "
                f'Build it with fmi_version="{versions[0]}".'
            )
        there.add(got)
    return sorted(there)


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

    It holds the structure with its diagram, parameter sets for robot and scenario, parameter mappings where names
    differ, and ``documentation/index.html``. The same arguments give the same bytes.

    Parameters
    ----------
    scenario : Scenario
    fmus : mapping of component to path
        FMUs from :func:`vdfmu.build_fmus`, for the scenario's robot: FMI 2.0 for SSP 1.0, FMI 3.0 for SSP 2.0.
        Those that the scenario's system does not have are left out.
    path : path
        File to write, ``name.ssp``.
    values : mapping of component to mapping of variable to value, optional
        Parameter values, see :func:`vdfmu.system.scenario.values.system_values`; default those of robot and scenario.
    version : "1.0" or "2.0", optional
        Version of SSP. With 2.0 connectors and parameters are arrays where the units of FMI 3.0 have arrays.
    mixed : bool, optional
        Whether FMUs of FMI 2.0 and 3.0 may go together, for this project's master: with SSP 1.0, the connectors of
        arrays of FMI 3.0 are their elements, which other tools do not read so.

    Returns
    -------
    Path
        `path`.

    Raises
    ------
    UsageError
        For an unknown version, FMUs that the version cannot hold, or components without one.
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
            "with vdfmu.build_fmus, or write the package with vdfmu ssp, which builds all."
        )
    there = require_fmi(fmus, tuple(FMI_VERSIONS) if mixed else (form.fmi.name,), f"SSP {version}")
    icons = {icon_source(name): _icon(table.name) for name, table in description.tables.items()}
    structure = structure_file(description)
    members = {"SystemStructure.ssd": _checked(structure, "ssd", "SystemStructure.ssd", version), **icons}
    for file, parameters in description.parameter_sets.items():
        members[f"resources/{file}"] = _checked(parameter_file(parameters, version), "ssv", file, version)
    for component, bindings in description.bindings.items():
        for binding in bindings:
            if binding.mapping:
                name = mapping_name(component, binding.file)
                mapping = mapping_file(binding.mapping, version)
                members[f"resources/{name}"] = _checked(mapping, "ssm", name, version)
    members["documentation/index.html"] = system_page(description, icons, there)
    with storing(path):
        for component, fmu in fmus.items():
            members[f"resources/{description.fmu_name(component)}"] = Path(fmu).read_bytes()
        path.parent.mkdir(parents=True, exist_ok=True)
        pack_zip(path, members)
    return path


def _icon(unit: str) -> bytes:
    icons = data_path("fmu_src") / "icons"
    own = icons / f"{unit}.svg"
    return (own if own.is_file() else icons / "unit.svg").read_bytes()


def _checked(root: Any, kind: str, name: str, version: str) -> bytes:
    """Bytes of a file, which is validated first where the schemas are always at hand."""
    if SSP_FORMATS[version].always_validated:
        validate(root, kind, name, version)
    return to_bytes(root)
