"""Writing of the system as an SSP 1.0: wiring from ``ssp/system.toml``, values from robot and scenario."""

from __future__ import annotations

import os
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from lxml import etree  # pyright: ignore[reportAttributeAccessIssue]  # lxml ships no stubs

from vdfmu.data import data_path
from vdfmu.errors import SspError, VdfmuError
from vdfmu.fmu.archive import pack_zip
from vdfmu.fmu.interface import Interface, Variable, interface
from vdfmu.fmu.units import UNITS
from vdfmu.model import Scenario
from vdfmu.ssp.archive import NAMESPACES, validate
from vdfmu.ssp.parameters import robot_parameters, system_values

__all__ = ["parameter_set", "system_structure", "write_ssp"]

_NS = {prefix: NAMESPACES[prefix] for prefix in ("ssd", "ssc", "ssv")}
_TIME_STAMP = "2026-01-01T00:00:00Z"


def _tag(name: str) -> str:
    prefix, _, local = name.partition(":")
    return f"{{{_NS[prefix]}}}{local}"


def _add(parent: Any, tag: str, **attributes: Any) -> Any:
    return etree.SubElement(parent, _tag(tag), {key: str(value) for key, value in attributes.items()})


def write_ssp(
    scenario: Scenario,
    fmus: Mapping[str, str | os.PathLike[str]],
    path: str | os.PathLike[str],
    values: Mapping[str, Mapping[str, Any]] | None = None,
) -> Path:
    """Write the system of a scenario as a package with its FMUs.

    Parameters
    ----------
    scenario : Scenario
    fmus : mapping of unit to path
        Of :func:`vdfmu.fmu.build_fmus`, for the scenario's robot.
    path : path
        File to write, ``name.ssp``.
    values : mapping of unit to mapping of variable to value, optional
        Parameter values, see :func:`vdfmu.ssp.parameters.system_values`; default those of robot and scenario.

    Raises
    ------
    VdfmuError
        If the file cannot be written.
    """
    path = Path(path)
    members: dict[str, bytes] = {"SystemStructure.ssd": _to_bytes(system_structure(scenario))}
    if values is None:
        values = system_values(scenario)
    for unit, fmu in fmus.items():
        of_robot = robot_parameters(unit, scenario).keys()
        sets = {
            "robot": {name: value for name, value in values[unit].items() if name in of_robot},
            "scenario": {name: value for name, value in values[unit].items() if name not in of_robot},
        }
        for kind, chosen in sets.items():
            root = parameter_set(f"{unit}.{kind}", unit, scenario, chosen)
            members[f"resources/{unit}.{kind}.ssv"] = _to_bytes(root)
        members[f"resources/{Path(fmu).name}"] = Path(fmu).read_bytes()
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        pack_zip(path, members)
    except OSError as error:
        raise VdfmuError(
            f"{path}: cannot be written: {error}. Choose another folder or free space."
        ) from error
    return path


def system_structure(scenario: Scenario) -> Any:
    """Root element of the SSD: four components, their connectors with units, parameter bindings and connections."""
    description = tomllib.loads((data_path("ssp") / "system.toml").read_text(encoding="utf-8"))
    tables = {unit: interface(unit, scenario.robot) for unit in description["units"]}
    root = etree.Element(
        _tag("ssd:SystemStructureDescription"),
        {
            "version": "1.0",
            "name": f"{description['name']}_{scenario.name}",
            "description": f"{description['description']}. {scenario.description}",
            "generationTool": "vdfmu",
            "generationDateAndTime": _TIME_STAMP,
        },
        nsmap=_NS,
    )
    system = _add(root, "ssd:System", name=description["name"], description=description["description"])
    elements = _add(system, "ssd:Elements")
    for unit, corners in description["units"].items():
        _add_component(elements, tables[unit], corners)
    connections = _add(system, "ssd:Connections")
    for source, targets in description["connections"].items():
        for target in targets:
            _add_connections(connections, tables, source, target)
    units = _add(root, "ssd:Units")
    for name in sorted({v.unit for table in tables.values() for v in table if v.unit}):
        unit = _add(units, "ssc:Unit", name=name)
        _add(unit, "ssc:BaseUnit", **UNITS[name].exponents)
    _add(root, "ssd:DefaultExperiment", startTime=0.0, stopTime=scenario.stop)
    validate(root, "ssd", "SystemStructure.ssd")
    return root


def parameter_set(name: str, unit: str, scenario: Scenario, values: Mapping[str, Any]) -> Any:
    """Root element of an SSV with the values of one unit, in the units of its variables."""
    table = interface(unit, scenario.robot)
    root = etree.Element(_tag("ssv:ParameterSet"), {"version": "1.0", "name": name}, nsmap=_NS)
    parameters = _add(root, "ssv:Parameters")
    used: set[str] = set()
    for key, value in values.items():
        variable = table.find(key)
        element = _add(
            _add(parameters, "ssv:Parameter", name=key), f"ssv:{variable.type}", value=_text(variable, value)
        )
        if variable.unit:
            element.set("unit", variable.unit)
            used.add(variable.unit)
    units = _add(root, "ssv:Units")
    for name_of_unit in sorted(used):
        element = _add(units, "ssc:Unit", name=name_of_unit)
        _add(element, "ssc:BaseUnit", **UNITS[name_of_unit].exponents)
    if not used:
        root.remove(units)
    validate(root, "ssv", f"{name}.ssv")
    return root


def _text(variable: Variable, value: Any) -> str:
    if variable.type == "Boolean":
        return str(bool(value)).lower()
    return str(int(value)) if variable.type == "Integer" else repr(float(value))


def _add_component(elements: Any, table: Interface, corners: list[float]) -> None:
    component = _add(
        elements,
        "ssd:Component",
        name=table.unit,
        description=table.description,
        type="application/x-fmu-sharedlibrary",
        source=f"resources/{table.model_name}.fmu",
        implementation="CoSimulation",
    )
    connectors = _add(component, "ssd:Connectors")
    for side, kind in ((0.0, "input"), (1.0, "output")):
        listed = [v for v in table if v.causality == kind]
        for k, variable in enumerate(listed):
            connector = _add(connectors, "ssd:Connector", name=variable.name, kind=kind)
            real = _add(connector, f"ssc:{variable.type}")
            if variable.unit:
                real.set("unit", variable.unit)
            _add(connector, "ssd:ConnectorGeometry", x=side, y=round(1.0 - (k + 1) / (len(listed) + 1), 6))
    x1, y1, x2, y2 = corners
    _add(component, "ssd:ElementGeometry", x1=x1, y1=y1, x2=x2, y2=y2)
    bindings = _add(component, "ssd:ParameterBindings")
    for kind in ("robot", "scenario"):
        _add(bindings, "ssd:ParameterBinding", source=f"resources/{table.unit}.{kind}.ssv")


def _add_connections(connections: Any, tables: Mapping[str, Interface], source: str, target: str) -> None:
    start_unit, start_group = source.split(".")
    end_unit, end_group = target.split(".")
    ends = {v.index: v for v in tables[end_unit] if v.group == end_group and v.causality == "input"}
    starts = [v for v in tables[start_unit] if v.group == start_group and v.causality == "output"]
    pairs = [(v, ends[v.index]) for v in starts if v.index in ends]
    if not pairs:
        raise SspError(f"ssp/system.toml: {source} -> {target}: the two share no signal.")
    for start, end in pairs:
        _add(
            connections,
            "ssd:Connection",
            startElement=start_unit,
            startConnector=start.name,
            endElement=end_unit,
            endConnector=end.name,
        )


def _to_bytes(root: Any) -> bytes:
    return etree.tostring(root, xml_declaration=True, encoding="UTF-8", pretty_print=True)
