"""Check of an OspSystemStructure.xml, the system description of libcosim."""

from __future__ import annotations

from pathlib import Path
from typing import Any
from urllib.parse import unquote

from vdfmu.errors import SspError
from vdfmu.ssp.archive import parse_xml
from vdfmu.study.check_unit import check_unit, read_unit
from vdfmu.study.findings import Findings

__all__ = ["NAMESPACE", "check_osp"]

NAMESPACE = "http://opensimulationplatform.com/MSMI/OSPSystemStructure"
_NS = {"osp": NAMESPACE}


def check_osp(path: Path, run: bool = True) -> Findings:
    """Check the simulators of a system structure, their FMUs, initial values and the connections between variables."""
    findings = Findings()
    try:
        root = parse_xml(path.read_bytes(), path.name)
    except SspError as error:
        return Findings(error.problems)
    if root.tag != f"{{{NAMESPACE}}}OspSystemStructure":
        return Findings([f"{path.name}: expected the root OspSystemStructure, got {root.tag!r}"])
    findings.notes.append("the system was not run: that takes libcosim; the master of vdfmu runs SSP 1.0")
    known: dict[str, dict[str, Any] | None] = {}
    checked: dict[str, dict[str, Any] | None] = {}
    for item in root.iterfind("osp:Simulators/osp:Simulator", _NS):
        name, source = item.get("name", ""), item.get("source", "")
        where = f"simulator {name!r}"
        if name in known:
            findings.problems.append(f"{where}: two simulators have that name")
        if source not in checked:
            checked[source] = _unit(path, source, where, run, findings)
        variables = known[name] = checked[source]
        for value in item.iterfind("osp:InitialValues/osp:InitialValue", _NS):
            if variables is not None and value.get("variable") not in variables:
                findings.problems.append(f"{where}: initial value: {source} has no {value.get('variable')!r}")
    if not known:
        findings.problems.append(f"{path.name}: has no simulators")
    _connections(root, known, findings)
    return findings


def _unit(path: Path, source: str, where: str, run: bool, findings: Findings) -> dict[str, Any] | None:
    """Check an FMU and return its variables by name, or None."""
    if "://" in source:
        findings.notes.append(f"{where}: {source} was not checked: it is not a file beside the description")
        return None
    fmu = path.parent / unquote(source)
    if not fmu.is_file():
        findings.problems.append(f"{where}: there is no file {source!r} beside {path.name}")
        return None
    unit, standard = check_unit(fmu, run)
    findings.add(unit, source)
    if standard is None:
        return None
    try:
        return {v.name: v for v in read_unit(fmu).modelVariables}
    except Exception:  # reported by the check of the unit
        return None


def _connections(root: Any, known: dict[str, dict[str, Any] | None], findings: Findings) -> None:
    """Check the ends of all connections, and the directions of those between two variables."""
    fed: set[tuple[str, str]] = set()
    for item in root.iterfind("osp:Connections/*", _NS):
        ends = [(end.get("simulator"), end.get("name")) for end in item.iterfind("osp:Variable", _NS)]
        where = "connection " + " -> ".join(f"{unit}.{name}" for unit, name in ends)
        found: list[Any] = []
        for unit, name in ends:
            if unit not in known:
                findings.problems.append(f"{where}: there is no simulator {unit!r}")
                continue
            variables = known[unit]
            if variables is not None and name not in variables:
                findings.problems.append(f"{where}: {unit} has no variable {name!r}")
            elif variables is not None:
                found.append(variables[name])
        if len(ends) != 2 or len(found) != 2:
            continue
        source, sink = found
        if (source.causality, sink.causality) not in {
            ("output", "input"),
            ("calculatedParameter", "parameter"),
        }:
            findings.problems.append(
                f"{where}: direction error, it joins {source.causality} and {sink.causality}"
            )
        if source.type != sink.type:
            findings.problems.append(f"{where}: type mismatch, {source.type} to {sink.type}")
        if ends[1] in fed:
            findings.problems.append(f"{where}: duplicate source, {'.'.join(ends[1])} is already fed")
        fed.add(ends[1])
