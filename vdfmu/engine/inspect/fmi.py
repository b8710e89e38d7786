"""Rules of FMI outside of fmpy: ranges, nominal values, aliases, source files, terminals, manifests."""

from __future__ import annotations

import math
import posixpath
from collections import ChainMap
from collections.abc import Collection, Mapping
from contextlib import suppress
from typing import Any
from urllib.parse import unquote

from lxml.etree import QName  # pyright: ignore[reportAttributeAccessIssue]  # lxml ships no stubs

from vdfmu.engine.inspect.description import DESCRIPTION, schema_faults, types_of, variables_of
from vdfmu.engine.rules import Finding, Findings, finding, line_of

TERMINALS = "terminalsAndIcons/terminalsAndIcons.xml"
BUILD = "sources/buildDescription.xml"
REFERENCES = "extra/org.fmi-standard.fmi-ls-ref/"
"""Folder of reference results (FMI-LS-REF)."""
MANIFEST = "fmi-ls-manifest.xml"
"""Name of the manifest of a layered standard, in its folder."""
_SHOWN = 5
"""Most missing source files in a message."""


def variable_faults(root: Any) -> list[Finding]:
    """Return faults of variables: values outside of their ranges, nominal values, `initial`, aliases."""
    version, types = str(root.get("fmiVersion"))[0], types_of(root)
    faults: list[Finding] = []
    for item, value in variables_of(root):
        stated = _stated(value, types)
        texts = [("FMI009", _range_fault(stated)), ("FMI020", _nominal_fault(stated.get("nominal")))]
        if version == "2" and item.get("causality") == "input" and item.get("initial") is not None:
            text = f"initial is {item.get('initial')!r}; FMI 2.0 allows none where causality is 'input'"
            texts.append(("FMI010", text))
        where = f"{line_of(item)}: variable {item.get('name')!r}"
        faults += [finding(rule, f"{where}: {text}", item) for rule, text in texts if text]
    return faults + (_alias_faults(root, types) if version == "2" else [])


def _stated(value: Any, types: Mapping[str, Any]) -> ChainMap[str, str]:
    """Return the attributes of a variable, else of its type."""
    declared = types.get(value.get("declaredType"))
    return ChainMap(value.attrib, {} if declared is None else declared.attrib)


def _nominal_fault(text: str | None) -> str:
    """Return the fault of a nominal value; importers scale tolerances by it."""
    if text is None or _number(text) is None or (math.isfinite(float(text)) and float(text)):
        return ""
    return f"nominal is {text}; expected a finite number other than 0"


def manifest_faults(name: str, root: Any) -> list[Finding]:
    """Return the missing attributes of the manifest of a layered standard."""
    stated = {QName(each).localname for each, text in root.attrib.items() if text}
    missing = [key for key in ("fmi-ls-name", "fmi-ls-version") if key not in stated]
    return [finding("FMI021", f"{name}: lacks {', '.join(missing)}", root)] if missing else []


_ROLES = (
    "document", "requirement", "specification", "model", "parameter", "system", "testcase", "experiment", "result",
    "method", "rationale", "report", "request", "delivery", "configuration", "signature", "serialized-state",
    "meta-data", "other",
)  # fmt: skip
_PURPOSES = ("smoke-test", "validation", "uncertainty-analysis")
"""Roles of related files, and purposes after experiment/ (FMI-LS-REF 1.0.0-alpha.1, July 2026)."""


def related_notes(root: Any) -> list[Finding]:
    """Return the breaches of FMI-LS-REF, a draft, in its manifest."""
    faults: list[tuple[str, Any]] = []
    if root.tag != "fmiReferences":
        faults.append((f"{REFERENCES}{MANIFEST}: expected the root fmiReferences, got {root.tag!r}", root))
    for item in root.iterfind("Related"):
        where = f"{line_of(item)}: {item.get('source')!r}"
        if not item.get("source"):
            faults.append((f"{line_of(item)}: a related file lacks a source", item))
        role, slash, purpose = (item.get("role") or "").partition("/")
        free = role == "serialized-state" or not slash or (role == "experiment" and purpose in _PURPOSES)
        if role not in _ROLES or not free:
            faults.append((f"{where}: role is {item.get('role')!r}; expected one of {', '.join(_ROLES)}", item))
        if any(not label.get("name") for label in item.iterfind("Label")):
            faults.append((f"{where}: a label lacks a name", item))
    return [finding("FMI022", text, item) for text, item in faults]


def _range_fault(stated: Mapping[str, str]) -> str:
    """Return the fault if min <= start <= max does not hold."""
    low, high = (_number(stated.get(name)) for name in ("min", "max"))
    if low is not None and high is not None and low > high:
        return f"min {stated['min']} is above max {stated['max']}"
    numbers = ((text, _number(text)) for text in stated.get("start", "").split())
    for text, number in ((text, number) for text, number in numbers if number is not None):
        if low is not None and number < low:
            return f"start {text} is below min {stated['min']}"
        if high is not None and number > high:
            return f"start {text} is above max {stated['max']}"
    return ""


def _number(text: str | None) -> float | None:
    """Return the number in a text, integers exactly; None for text against the schema."""
    for read in (int, float):
        with suppress(ValueError):
            return None if text is None else read(text)
    return None


def _alias_faults(root: Any, types: Mapping[str, Any]) -> list[Finding]:
    """Return the faults of variables of FMI 2.0 with a common value reference (2.2.7)."""
    shared: dict[tuple[str, str], list[tuple[Any, Any]]] = {}
    for item, value in variables_of(root):
        base = "Integer" if value.tag == "Enumeration" else value.tag
        shared.setdefault((base, item.get("valueReference")), []).append((item, value))
    faults: list[Finding] = []
    for (_, reference), aliases in shared.items():
        if len(aliases) < 2:
            continue
        names, first = ", ".join(repr(item.get("name")) for item, _ in aliases), aliases[0][0]
        where = f"{line_of(first)}: {names} share value reference {reference}"

        def fault(text: str, where: str = where, first: Any = first) -> None:
            faults.append(finding("FMI011", f"{where}: {text}", first))

        constant = [item.get("variability") == "constant" for item, _ in aliases]
        starts = [value.get("start") for _, value in aliases if value.get("start") is not None]
        if any(constant) and not all(constant):
            fault("a constant shares it with constants only")
        elif any(constant) and len({s if (number := _number(s)) is None else number for s in starts}) > 1:
            fault(f"constants must have the same start value, they have {', '.join(starts)}")
        elif not any(constant) and len(starts) > 1:
            fault(f"one of them may have a start value, {len(starts)} have")
        stated = [_stated(value, types).get("unit") for _, value in aliases]
        units = [repr(unit) if unit else "none" for unit in stated]
        if len(set(units)) > 1:
            fault(f"they must have the same unit, they have {', '.join(dict.fromkeys(units))}")
    return faults


def build_faults(root: Any, build: Any, names: Collection[str]) -> Findings:
    """Return the faults of the source files in the model description or a build description."""
    where, listed = DESCRIPTION, root.iterfind("*/SourceFiles/File")
    if build is not None:
        version = build.get("fmiVersion") or "none"
        if not version.startswith("3."):
            return Findings([finding("FMI002", f"{BUILD}: fmiVersion is {version!r}; expected 3.0", build)])
        faults = schema_faults(build, "fmi3/fmi3BuildDescription.xsd", BUILD)
        if faults:
            return Findings(faults)
        where, listed = BUILD, build.iterfind(".//SourceFile")
    files = dict.fromkeys(str(item.get("name")) for item in listed)
    missing = [f for f in files if not {posixpath.normpath(f"sources/{n}") for n in (f, unquote(f))} & {*names}]
    if not missing:
        return Findings()
    shown = ", ".join(map(repr, missing[:_SHOWN])) + (f" and {len(missing) - _SHOWN} more" if missing[_SHOWN:] else "")
    text = f"{where}: lists source files that are not in sources/: {shown}"
    stripped = not any(name.startswith("sources/") and name != BUILD for name in names)
    if stripped and any(name.startswith("binaries/") for name in names):
        text += "; without sources, it can be run by its binaries only"
        return Findings(notes=[finding("FMI014", text, (where, 0))])
    return Findings([finding("FMI014", text, (where, 0))])


def terminal_faults(terminals: Any, root: Any) -> list[Finding]:
    """Return the names in terminals without a variable in the model description."""
    names = {each.get("name") for item, _ in variables_of(root) for each in (item, *item.iterfind("Alias"))}
    return [
        finding("FMI015", f"{line_of(item)}: {item.tag}: {DESCRIPTION} has no variable {item.get(attribute)!r}", item)
        for item in terminals.iter()
        for attribute in ("variableName", "inStreamVariableName", "outStreamVariableName")
        if item.get(attribute) is not None and item.get(attribute) not in names
    ]
