"""Rules of FMI that fmpy does not know: ranges, nominal values, aliases, source files, terminals, manifests."""

from __future__ import annotations

import math
import posixpath
from collections.abc import Collection, Mapping
from typing import Any
from urllib.parse import unquote

from lxml.etree import QName  # pyright: ignore[reportAttributeAccessIssue]  # lxml ships no stubs

from vdfmu.engine.inspect.description import DESCRIPTION, schema_faults, variables_of
from vdfmu.engine.inspect.findings import Findings
from vdfmu.engine.rules import finding

TERMINALS = "terminalsAndIcons/terminalsAndIcons.xml"
BUILD = "sources/buildDescription.xml"
REFERENCES = "extra/org.fmi-standard.fmi-ls-ref/fmi-ls-manifest.xml"
_SHOWN = 5
"""Most missing source files that a message names."""


def variable_faults(root: Any) -> list[str]:
    """Return the variables whose values break their own ranges, those with a wrong `initial`, and faulty aliases."""
    version = str(root.get("fmiVersion"))[0]
    types = {
        item.get("name"): item if version == "3" else item[0]
        for item in root.iterfind("TypeDefinitions/*")
        if version == "3" or len(item)
    }
    faults: list[str] = []
    for item, value in variables_of(root):
        where, place = (
            f"{DESCRIPTION}, line {item.sourceline}: variable {item.get('name')!r}",
            (DESCRIPTION, item.sourceline),
        )
        declared = types.get(value.get("declaredType"))
        faults += [finding("FMI009", f"{where}: {fault}", place) for fault in _range_faults(value, declared)]
        faults += [finding("FMI020", f"{where}: {fault}", place) for fault in _nominal_fault(value, declared)]
        if version == "2" and item.get("causality") == "input" and item.get("initial") is not None:
            text = f"initial is {item.get('initial')!r}; FMI 2.0 allows none where causality is 'input'"
            faults.append(finding("FMI010", f"{where}: {text}", place))
    return faults + (_alias_faults(root, types) if version == "2" else [])


def _nominal_fault(value: Any, declared: Any) -> list[str]:
    """Return what is wrong with the nominal value, by which importers scale tolerances; it may come from the type."""
    text = value.get("nominal") or (declared.get("nominal") if declared is not None else None)
    if text is None or _number(text) is None or (math.isfinite(float(text)) and float(text)):
        return []
    return [f"nominal is {text}; expected a finite number other than 0"]


def manifest_faults(name: str, root: Any) -> list[str]:
    """Return what the manifest of a layered standard does not state."""
    missing = [
        key
        for key in ("fmi-ls-name", "fmi-ls-version")
        if not any(QName(each).localname == key and text for each, text in root.attrib.items())
    ]
    if not missing:
        return []
    return [finding("FMI021", f"{name}: lacks {', '.join(missing)}", (name, root.sourceline or 0))]


_ROLES = (
    "document", "requirement", "specification", "model", "parameter", "system", "testcase", "experiment", "result",
    "method", "rationale", "report", "request", "delivery", "configuration", "signature", "serialized-state",
    "meta-data", "other",
)  # fmt: skip
_PURPOSES = ("smoke-test", "validation", "uncertainty-analysis")
"""Roles of related files, and what follows experiment/ (FMI-LS-REF 1.0.0-alpha.1, July 2026)."""


def related_notes(root: Any) -> list[str]:
    """Return what breaks the rules of FMI-LS-REF, a draft, in its manifest."""
    name, faults = REFERENCES, list[str]()
    if root.tag != "fmiReferences":
        faults.append(finding("FMI022", f"{name}: expected the root fmiReferences, got {root.tag!r}", root))
    for item in root.iterfind("Related"):
        where = f"{name}, line {item.sourceline}: {item.get('source')!r}"
        if not item.get("source"):
            faults.append(finding("FMI022", f"{name}, line {item.sourceline}: a related file has no source", item))
        role, slash, purpose = (item.get("role") or "").partition("/")
        free = role == "serialized-state" or not slash or (role == "experiment" and purpose in _PURPOSES)
        if role not in _ROLES or not free:
            text = f"role is {item.get('role')!r}; expected one of {', '.join(_ROLES)}"
            faults.append(finding("FMI022", f"{where}: {text}", item))
        if any(not label.get("name") for label in item.iterfind("Label")):
            faults.append(finding("FMI022", f"{where}: a label has no name", item))
    return faults


def _range_faults(value: Any, declared: Any) -> list[str]:
    """Return where min <= start <= max does not hold; bounds that a variable does not state come from its type."""
    bounds: dict[str, float] = {}
    shown: dict[str, str] = {}
    for name in ("min", "max"):
        text = value.get(name)
        text = declared.get(name) if text is None and declared is not None else text
        number = _number(text)
        if text is not None and number is not None:
            bounds[name], shown[name] = number, text
    if len(bounds) == 2 and bounds["min"] > bounds["max"]:
        return [f"min {shown['min']} is above max {shown['max']}"]
    for text in (value.get("start") or "").split() if bounds else ():
        number = _number(text)
        if number is None:
            continue
        if "min" in bounds and number < bounds["min"]:
            return [f"start {text} is below min {shown['min']}"]
        if "max" in bounds and number > bounds["max"]:
            return [f"start {text} is above max {shown['max']}"]
    return []


def _number(text: str | None) -> float | None:
    """Return the number in a text, integers exactly; None for text that the schema refuses."""
    if text is None:
        return None
    try:
        return int(text)
    except ValueError:
        pass
    try:
        return float(text)
    except ValueError:
        return None


def _alias_faults(root: Any, types: Mapping[str, Any]) -> list[str]:
    """Return the variables of FMI 2.0 that share a value reference and must not (2.2.7)."""
    shared: dict[tuple[str, str], list[tuple[Any, Any]]] = {}
    for item, value in variables_of(root):
        base = "Integer" if value.tag == "Enumeration" else value.tag
        shared.setdefault((base, item.get("valueReference")), []).append((item, value))
    faults: list[str] = []
    for (_, reference), aliases in shared.items():
        if len(aliases) < 2:
            continue
        names = ", ".join(repr(item.get("name")) for item, _ in aliases)
        line = aliases[0][0].sourceline

        def fault(text: str, names: str = names, reference: str = reference, line: int = line) -> None:
            text = f"{DESCRIPTION}, line {line}: {names} share value reference {reference}: {text}"
            faults.append(finding("FMI011", text, (DESCRIPTION, line)))

        constant = [item.get("variability") == "constant" for item, _ in aliases]
        starts = [value.get("start") for _, value in aliases if value.get("start") is not None]
        if any(constant) and not all(constant):
            fault("a constant shares it with constants only")
        elif any(constant) and len({_number(s) if _number(s) is not None else s for s in starts}) > 1:
            fault(f"constants must have the same start value, they have {', '.join(starts)}")
        elif not any(constant) and len(starts) > 1:
            fault(f"one of them may have a start value, {len(starts)} have")
        units: list[str] = []
        for _, value in aliases:
            declared = types.get(value.get("declaredType"))
            unit = value.get("unit") or (declared.get("unit") if declared is not None else None)
            units.append(repr(unit) if unit else "none")
        if len(set(units)) > 1:
            fault(f"they must have the same unit, they have {', '.join(dict.fromkeys(units))}")
    return faults


def build_faults(root: Any, build: Any, names: Collection[str]) -> Findings:
    """Return what is wrong with the source files that the model description, or a build description, lists."""
    where, listed = DESCRIPTION, root.iterfind("*/SourceFiles/File")
    if build is not None:
        version = build.get("fmiVersion") or "none"
        if not version.startswith("3."):
            return Findings([finding("FMI002", f"{BUILD}: fmiVersion is {version!r}; expected 3.0", build)])
        faults = schema_faults(build, "fmi3/fmi3BuildDescription.xsd", BUILD)
        if faults:
            return Findings(faults)
        where, listed = BUILD, build.iterfind(".//SourceFile")
    missing = [
        name
        for name in dict.fromkeys(str(item.get("name")) for item in listed)
        if not {posixpath.normpath(f"sources/{n}") for n in (name, unquote(name))} & set(names)
    ]
    if not missing:
        return Findings()
    shown = ", ".join(map(repr, missing[:_SHOWN])) + (f" and {len(missing) - _SHOWN} more" if missing[_SHOWN:] else "")
    text = f"{where}: lists source files that are not in sources/: {shown}"
    stripped = not any(name.startswith("sources/") and name != BUILD for name in names)
    if stripped and any(name.startswith("binaries/") for name in names):
        text += "; it has none, so it can be run by its binaries only"
        return Findings(notes=[finding("FMI014", text, (where, 0))])
    return Findings([finding("FMI014", text, (where, 0))])


def terminal_faults(terminals: Any, root: Any) -> list[str]:
    """Return the variables that terminals name and the model description does not have."""
    known = {item.get("name") for item, _ in variables_of(root)}
    known |= {alias.get("name") for item, _ in variables_of(root) for alias in item.iterfind("Alias")}
    return [
        finding(
            "FMI015",
            f"{TERMINALS}, line {item.sourceline}: {item.tag}: {DESCRIPTION} has no variable {item.get(attribute)!r}",
            (TERMINALS, item.sourceline),
        )
        for item in terminals.iter()
        for attribute in ("variableName", "inStreamVariableName", "outStreamVariableName")
        if item.get(attribute) is not None and item.get(attribute) not in known
    ]
