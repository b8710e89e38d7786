"""Rules for the files of a system whose breach does not keep it from being run."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

from vdfmu.engine.package.elements import Document, read_units
from vdfmu.engine.package.parse import NAMESPACES
from vdfmu.engine.rules import Finding, finding

_INLINE = {"ssv": "ParameterSet", "ssb": "SignalDictionary"}
_USERS = {"ssd": "Connector", "ssv": "Parameter", "ssb": "DictionaryEntry"}
"""Elements that name units, by the kind of file."""


def file_faults(documents: Iterable[Document]) -> list[Finding]:
    """Return faults of files, beyond schemas: encoding, names of connectors, units that are not defined."""
    faults: list[Finding] = []
    for kind, root, where in documents:
        encoding = root.getroottree().docinfo.encoding or "UTF-8"
        if encoding.upper() not in ("UTF-8", "UTF8", "ASCII", "US-ASCII"):
            faults.append(finding("SSP004", f"{where}: is encoded in {encoding}; SSP has UTF-8 only", root))
        if kind == "ssm":
            continue
        units = read_units(_each(root, kind, "Units"))
        if kind == "ssd":
            faults += _twice_faults(root, where)
        faults += _unit_faults(kind, root, set(units), where)
        for inner, tag in _INLINE.items() if kind == "ssd" else ():
            for part in root.iter(f"{{{NAMESPACES[inner]}}}{tag}"):
                known = {*units, *read_units(_each(part, inner, "Units"))}
                faults += _unit_faults(inner, part, known, f"{where}, line {part.sourceline}")
    return faults


def _each(root: Any, kind: str, box: str) -> Iterator[Any]:
    return root.iterfind(f"{kind}:{box}/ssc:Unit", NAMESPACES)


def _unit_faults(kind: str, root: Any, units: set[str], where: str) -> Iterator[Finding]:
    """Yield units without any conversion, and units that a file names but does not define."""
    for item in _each(root, kind, "Units"):
        for name, unit in read_units([item]).items():
            if not unit.usable:
                text = f"{where}: unit {name!r}: factor {unit.factor:g} and offset {unit.offset:g}; "
                yield finding("SSP022", f"{text}expected finite numbers, and a factor other than 0", item)
    users: dict[str, list[Any]] = {}
    for item in root.iter(f"{{{NAMESPACES[kind]}}}{_USERS[kind]}"):
        for value in item:
            unit = value.get("unit")
            if unit and unit not in units:
                users.setdefault(unit, []).append(item)
    for unit, items in users.items():
        more = f" and {len(items) - 1} more" if items[1:] else ""
        text = f"{where}: unit {unit!r} of {_name(items[0])}{more} is not defined; define it in {kind}:Units"
        yield finding("SSP022", text, items[0])


def _name(item: Any) -> str:
    """Return the name of an item; for a connector the dotted one, without the outermost system."""
    tags = (f"{{{NAMESPACES['ssd']}}}{t}" for t in ("Component", "System", "SignalDictionaryReference"))
    names = [above.get("name") for above in item.iterancestors(*tags)]
    is_connector = item.tag == f"{{{NAMESPACES['ssd']}}}Connector"
    outer = "".join(f"{name}." for name in reversed(names[:-1]) if name) if is_connector else ""
    return f"{outer}{item.get('name')}"


def _twice_faults(root: Any, where: str) -> Iterator[Finding]:
    """Yield the connectors of one element that have the same name."""
    for box in root.iter(f"{{{NAMESPACES['ssd']}}}Connectors"):
        seen: set[str] = set()
        for item in box.iterfind("ssd:Connector", NAMESPACES):
            name = str(item.get("name"))
            if name in seen:
                text = f"{where}, line {item.sourceline}: two connectors are named {_name(item)}; "
                yield finding("SSP018", f"{text}names of connectors of one element must differ", item)
            seen.add(name)
