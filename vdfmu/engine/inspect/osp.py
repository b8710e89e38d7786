"""Check of an OspSystemStructure.xml, the system description of libcosim."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlsplit

from vdfmu.base.errors import SspError
from vdfmu.engine.fmu.variables import limit_fault, limits_of
from vdfmu.engine.inspect.findings import Findings
from vdfmu.engine.inspect.fmu import check_unit, read_unit
from vdfmu.engine.package.parse import parse_xml
from vdfmu.engine.rules import found

NAMESPACE = "http://opensimulationplatform.com/MSMI/OSPSystemStructure"
_NS = {"osp": NAMESPACE}
_ALGORITHMS = ("fixedStep", "ecco")
_VALUES = ("Real", "Integer", "Boolean", "String")
_ECCO = (
    "SafetyFactor", "StepSize", "MinimumStepSize", "MaximumStepSize", "MinimumChangeRate", "MaximumChangeRate",
    "ProportionalGain", "IntegralGain", "RelativeTolerance", "AbsoluteTolerance",
)  # fmt: skip
_TIMES = ("StartTime", "EndTime", "BaseStepSize")
_CHILDREN: dict[str, tuple[str, ...]] = {
    "OspSystemStructure": (
        *_TIMES,
        "Algorithm",
        "Simulators",
        "Functions",
        "Connections",
        "EccoConfiguration",
    ),
    "Simulators": ("Simulator",),
    "Simulator": ("InitialValues",),
    "InitialValues": ("InitialValue",),
    "InitialValue": _VALUES,
    "Functions": ("LinearTransformation", "Sum", "VectorSum"),
    "Connections": (
        "VariableConnection",
        "SignalConnection",
        "VariableGroupConnection",
        "SignalGroupConnection",
    ),
    "VariableConnection": ("Variable",),
    "SignalConnection": ("Variable", "Signal"),
    "VariableGroupConnection": ("VariableGroup",),
    "SignalGroupConnection": ("SignalGroup", "VariableGroup"),
    "EccoConfiguration": _ECCO,
}
"""Elements of the version 0.1 and what may be in them."""
_NEEDED: dict[str, tuple[str, ...]] = {
    "Simulator": ("name", "source"),
    "InitialValue": ("variable",),
    **dict.fromkeys(_VALUES, ("value",)),
    **dict.fromkeys(("Variable", "VariableGroup"), ("simulator", "name")),
    **dict.fromkeys(("Signal", "SignalGroup"), ("function", "name")),
    "LinearTransformation": ("name",),
    "Sum": ("name", "inputCount"),
    "VectorSum": ("name", "inputCount", "dimension"),
}
"""Attributes that an element must have."""


def check_osp(path: Path, run: bool = True) -> Findings:
    """Check the simulators of a system structure, their FMUs, initial values and the connections between variables."""
    findings = Findings()
    try:
        root = parse_xml(path.read_bytes(), path.name)
    except SspError as error:
        return Findings(error.problems)
    if root.tag != f"{{{NAMESPACE}}}OspSystemStructure":
        text = f"{path.name}: expected the root OspSystemStructure, got {root.tag!r}"
        return Findings([found("OSP001", text, root)])
    findings.problems += _structure(root, path.name)
    if findings.problems:
        return findings  # what follows finds elements by their names; libcosim goes no further either
    text = "the system was not run: that takes libcosim; the master of vdfmu runs SSP"
    findings.notes.append(found("RUN006", text))
    known: dict[str, dict[str, Any] | None] = {}
    checked: dict[str, dict[str, Any] | None] = {}
    for item in root.iterfind("osp:Simulators/osp:Simulator", _NS):
        name, source = item.get("name", ""), item.get("source", "")
        where = f"simulator {name!r}"
        if name in known:
            findings.problems.append(found("OSP003", f"{where}: two simulators have that name", item))
        if source not in checked:
            checked[source] = _unit(path, source, where, run, findings)
        variables = known[name] = checked[source]
        for value in item.iterfind("osp:InitialValues/osp:InitialValue", _NS):
            name = value.get("variable")
            faults = _value_faults(value[0])
            if variables is not None and name not in variables:
                faults.append(f"{source} has no such variable")
            elif variables is not None:
                faults = faults or _set_faults(value[0], variables[name])
            place = f"{where}: initial value of {name!r}"
            findings.problems += [found("OSP004", f"{place}: {fault}", value) for fault in faults]
    if not known:
        findings.problems.append(found("OSP001", f"{path.name}: has no simulators", root))
    _connections(root, known, findings)
    return findings


def _tag(element: Any) -> str:
    return element.tag.removeprefix(f"{{{NAMESPACE}}}")


def _structure(root: Any, label: str) -> list[str]:
    """Return what breaks the structure of version 0.1: elements, attributes, numbers."""
    problems: list[str] = []
    if root.get("version") != "0.1":
        text = f"{label}: version is {root.get('version')!r}; expected '0.1'"
        problems.append(found("OSP001", text, root))
    for element in root.iter():
        tag, children = _tag(element), [_tag(child) for child in element]
        where = f"{label}, line {element.sourceline}: {tag}"
        known = _CHILDREN.get(tag, ())
        faults = [f"unknown element {child!r}" for child in children if child not in known]
        faults += [f"has no {name}" for name in _NEEDED.get(tag, ()) if element.get(name) is None]
        if tag == "InitialValue" and len(children) != 1:
            faults.append(f"expected one of {', '.join(_VALUES)}, got {len(children)} elements")
        elif tag.endswith("Connection") and len(children) != 2:
            faults.append(f"expected two ends, got {len(children)}")
        problems += [found("OSP001", f"{where}: {fault}", element) for fault in faults]
        faults = []
        if tag == "Algorithm" and (element.text or "").strip() not in ("", *_ALGORITHMS):
            faults = [f"{element.text!r} is unknown; expected one of {', '.join(_ALGORITHMS)}"]
        elif tag in (*_TIMES, *_ECCO):
            faults = _number_faults(element.text, tag == "BaseStepSize")
        elif tag == "Simulator" and element.get("stepSize") is not None:
            faults = [f"stepSize: {fault}" for fault in _number_faults(element.get("stepSize"), False)]
        problems += [found("OSP002", f"{where}: {fault}", element) for fault in faults]
    return problems


def _number_faults(text: str | None, positive: bool) -> list[str]:
    try:
        value = float(text or "")
    except ValueError:
        value = math.nan
    if not math.isfinite(value) or (positive and value <= 0.0):
        return [f"expected a {'positive' if positive else 'finite'} number, got {text!r}"]
    return []


def _value_faults(value: Any) -> list[str]:
    """Return what is wrong with the text of a value."""
    kind, text = _tag(value), value.get("value")
    try:
        if kind == "Real":
            float(text)
        elif kind == "Integer" and not -(2**31) <= int(text) < 2**31:
            raise ValueError
        elif kind == "Boolean" and text.strip() not in ("true", "false", "1", "0"):
            raise ValueError
    except ValueError:
        return [f"{text!r} is no {kind}"]
    return []


def _set_faults(value: Any, variable: Any) -> list[str]:
    """Return why a variable does not take an initial value."""
    kind = _tag(value)
    faults: list[str] = []
    if kind != variable.type and (kind, variable.type) != ("Integer", "Enumeration"):
        faults.append(f"type mismatch, {kind} for a variable of type {variable.type}")
    settable = variable.causality in ("input", "parameter") or variable.initial in ("exact", "approx")
    if variable.variability == "constant" or not settable:
        initial = f", initial {variable.initial!r}" if variable.initial else ""
        faults.append(f"cannot be set, it is {variable.variability or ''} {variable.causality}{initial}")
    if kind in ("Real", "Integer") and (fault := limit_fault(float(value.get("value")), limits_of(variable))):
        faults.append(fault)
    return faults


def _file(path: Path, source: str) -> Path | None:
    """Return the file that a URI means, a relative one beside the description; None for one elsewhere."""
    try:
        parts = urlsplit(source)
    except ValueError:
        return path.parent / source
    if parts.scheme == "file":
        return path.parent / unquote(parts.path)
    if len(parts.scheme) > 1 or parts.netloc:
        return None
    return path.parent / unquote(source)


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except OSError:  # a name that is too long
        return False


def _unit(path: Path, source: str, where: str, run: bool, findings: Findings) -> dict[str, Any] | None:
    """Check an FMU and return its variables by name, or None."""
    fmu = _file(path, source)
    if fmu is None:
        text = f"{where}: {source} was not checked: it is not a file beside the description"
        findings.notes.append(found("RUN006", text))
        return None
    if not _is_file(fmu):
        findings.problems.append(found("OSP003", f"{where}: there is no file {source!r} beside {path.name}"))
        return None
    unit, standard = check_unit(fmu, run)
    findings.add(unit, source, source)
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
        faults: list[tuple[str, str]] = []
        joined: list[Any] = []
        for unit, name in ends:
            if unit not in known:
                faults.append(("OSP005", f"there is no simulator {unit!r}"))
                continue
            variables = known[unit]
            if variables is not None and name not in variables:
                faults.append(("OSP005", f"{unit} has no variable {name!r}"))
            elif variables is not None:
                joined.append(variables[name])
        if len(ends) == len(joined) == 2:
            source, sink = joined
            pair = source.causality, sink.causality
            if pair not in {("output", "input"), ("calculatedParameter", "parameter")}:
                faults.append(("OSP005", f"direction error, it joins {' and '.join(pair)}"))
            if source.type != sink.type:
                faults.append(("OSP005", f"type mismatch, {source.type} to {sink.type}"))
            if ends[1] in fed:
                faults.append(("OSP006", f"duplicate source, {'.'.join(ends[1])} is already fed"))
            fed.add(ends[1])
        where = "connection " + " -> ".join(f"{unit}.{name}" for unit, name in ends)
        findings.problems += [found(rule, f"{where}: {fault}", item) for rule, fault in faults]
