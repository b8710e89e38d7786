"""Writing of the system as a folder with an OspSystemStructure.xml, the configuration of libcosim."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from lxml import etree  # pyright: ignore[reportAttributeAccessIssue]  # lxml ships no stubs

from vdfmu.base.errors import StorageError
from vdfmu.base.files import MARK, replacing, require_ours, storing
from vdfmu.base.version import __version__
from vdfmu.compiler.fmu.description import number
from vdfmu.system.package.description import SystemDescription
from vdfmu.system.package.versions import require_fmi
from vdfmu.system.package.xml import to_bytes, value_text
from vdfmu.system.scenario import Scenario

_NAMESPACE = "http://opensimulationplatform.com/MSMI/OSPSystemStructure"


def write_osp(
    scenario: Scenario,
    fmus: Mapping[str, str | os.PathLike[str]],
    folder: str | os.PathLike[str],
    values: Mapping[str, Mapping[str, Any]] | None = None,
) -> Path:
    """Write the system of a scenario for libcosim: a folder with ``OspSystemStructure.xml`` and the FMUs beside it.

    Parameters
    ----------
    scenario : Scenario
    fmus : mapping of unit to path
        Of :func:`vdfmu.build_fmus`, for the scenario's robot, of FMI 2.0.
    folder : path
        Made if it does not exist. Files of other names in it are left alone.
    values : mapping of unit to mapping of variable to value, optional
        Parameter values, see :func:`vdfmu.system.scenario.values.system_values`; default those of robot and scenario.

    Returns
    -------
    Path
        The file ``OspSystemStructure.xml``.

    Raises
    ------
    UsageError
        If the FMUs are not of FMI 2.0.
    UsageError
        If the folder has files of these names that vdfmu did not write.
    StorageError
        If a file cannot be written.
    """
    if not os.fspath(folder):
        raise StorageError("the name of the folder to write is empty; expected one such as system_osp")
    folder = Path(folder)
    if folder.exists() and not folder.is_dir():
        raise StorageError(f"{folder}: is a file; expected a folder, or a new name for one")
    description = SystemDescription(scenario, values)
    fmus = {unit: fmu for unit, fmu in fmus.items() if unit in description.tables}
    require_fmi(fmus, ("2.0",), "an OSP system structure")
    names = {unit: Path(fmu).name for unit, fmu in fmus.items()}
    head, end, structure = to_bytes(osp_structure(description, names)).partition(b"?>\n")
    content = head + end + b"<!-- " + MARK + f' {__version__}" -->\n'.encode() + structure
    path = folder / "OspSystemStructure.xml"
    targets = {unit: folder / name for unit, name in names.items()}
    require_ours(path, *(target for unit, target in targets.items() if not _same(target, Path(fmus[unit]))))
    with storing(folder):
        folder.mkdir(parents=True, exist_ok=True)
        for unit, fmu in fmus.items():
            data = Path(fmu).read_bytes()
            if not _same(targets[unit], Path(fmu)):
                _write(targets[unit], data)
        _write(path, content)
    return path


def _same(target: Path, fmu: Path) -> bool:
    """Whether a file is there and is the FMU that is to be put there."""
    return target.is_file() and target.samefile(fmu)


def _write(path: Path, content: bytes) -> None:
    with replacing(path) as stream:
        stream.write(content)


def osp_structure(description: SystemDescription, names: Mapping[str, str]) -> Any:
    """Root element: simulators with their initial values, and one connection for each signal.

    Parameters
    ----------
    description : SystemDescription
    names : mapping of unit to str
        File of its FMU, beside the configuration.
    """
    top = etree.Element(f"{{{_NAMESPACE}}}OspSystemStructure", {"version": "0.1"}, nsmap={None: _NAMESPACE})
    for key, text in (
        ("StartTime", number(0.0)),
        ("EndTime", number(description.scenario.stop)),
        ("BaseStepSize", number(description.scenario.step)),
        ("Algorithm", "fixedStep"),
    ):
        _add(top, key).text = text
    simulators = _add(top, "Simulators")
    for unit, table in description.tables.items():
        simulator = _add(
            simulators, "Simulator", name=unit, source=names[unit], stepSize=number(description.scenario.step)
        )
        initial = _add(simulator, "InitialValues")
        for name, value in description.values[unit].items():
            kind = table.variables[table.reference[name]].type
            _add(_add(initial, "InitialValue", variable=name), kind, value=value_text(kind, value))
    connections = _add(top, "Connections")
    for link in description.links:
        connection = _add(connections, "VariableConnection")
        for unit, signal in (link.start, link.end):
            _add(connection, "Variable", simulator=unit, name=signal.name)
    return top


def _add(parent: Any, tag: str, /, **attributes: str) -> Any:
    return etree.SubElement(parent, f"{{{_NAMESPACE}}}{tag}", attributes)
