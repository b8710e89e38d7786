"""Check of a system of SSP 1.0: the package, its files, the wiring, and every FMU."""

from __future__ import annotations

import posixpath
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from vdfmu.engine.check.findings import Findings
from vdfmu.engine.check.fmu import check_unit, store
from vdfmu.engine.check.run import master_of
from vdfmu.engine.cosim.check import check_system
from vdfmu.engine.ssp.archive import Archive
from vdfmu.engine.ssp.elements import Scope
from vdfmu.engine.ssp.parse import NAMESPACES, parse_xml
from vdfmu.engine.ssp.read import read_system
from vdfmu.engine.ssp.structure import System
from vdfmu.engine.ssp.tree import DEFINITION_TYPE, PACKAGE_TYPE
from vdfmu.errors import SspError

__all__ = ["check_ssp1", "encoding_faults", "package_faults", "same_names"]

_EXTERNAL = {"ParameterBinding": "ssv", "ParameterMapping": "ssm", "SignalDictionary": "ssb"}
"""Elements of an SSD that may name a file, to the kind of file."""
_INLINE = {"ssv:ParameterSet": "ssv", "ssm:ParameterMapping": "ssm", "ssb:SignalDictionary": "ssb"}
_MASTER = "; the master "
"""In every message that says what only the master asks of an FMU."""


def check_ssp1(path: Path, variant: str, folder: Path, checked: set[str]) -> Findings:
    """Check one SSD of a package: files, wiring, units, parameters, and each of its FMUs, whatever else is wrong.

    Parameters
    ----------
    path : Path
        The package.
    variant : str
        The SSD.
    folder : Path
        A place for FMUs.
    checked : set of str
        FMUs that have been checked; those of this SSD are added.
    """
    system, problems = read_system(path, variant)
    findings = Findings(list(problems))
    units: dict[str, list[str]] = {}
    with Archive(path, path.name) as archive:
        findings.problems += _file_faults(archive, variant, path.name)
        sources = [n for n in archive.names if n.lower().endswith(".fmu")]
        if system is not None:
            sources = [c.source for c in system.components if c.source]
        for source in dict.fromkeys(sources):
            try:
                fmu = store(archive, source, folder)
                unit, _ = check_unit(fmu, False, posixpath.basename(source), archive)
                units[source] = unit.problems
            except SspError as error:
                units[source] = error.problems
    if system is not None:
        findings.add(_system(system, units))
    for source, faults in units.items():
        if source not in checked:
            checked.add(source)
            findings.add(Findings(faults), source)
    return findings


def _system(system: System, units: Mapping[str, Sequence[str]]) -> Findings:
    """Hold the system against its FMUs; what is wrong with an FMU itself is left to its own check."""
    try:
        return Findings(
            notes=list(check_system(system, algorithm=master_of(system), ignore_unmatched=True).notes)
        )
    except SspError as error:
        starts = tuple(f"{c.name}: {c.source}: " for c in system.components if units.get(c.source))
        return Findings([p for p in error.problems if _MASTER in p or not p.startswith(starts)])


def package_faults(archive: Archive) -> list[str]:
    """Return what breaks the rules for the members of a package."""
    documented = any(name.startswith("documentation/") for name in archive.names)
    if documented and "documentation/index.html" not in archive:
        return [f"{archive.label}: has documentation/ without documentation/index.html, where readers start"]
    return []


def same_names(names: Mapping[str, str | None]) -> list[str]:
    """Return notes on SSDs of one package, given their names by file, that cannot be told apart by them."""
    users: dict[str, list[str]] = {}
    for file, name in names.items():
        users.setdefault(name or "", []).append(file)
    return [
        f"{' and '.join(files)}: have the same name, {name!r}, by which tools let users choose"
        for name, files in users.items()
        if name and len(files) > 1
    ]


def encoding_faults(root: Any, where: str) -> list[str]:
    """Return whether a file of SSP is in another encoding than UTF-8."""
    encoding = root.getroottree().docinfo.encoding or "UTF-8"
    if encoding.upper() in ("UTF-8", "UTF8", "ASCII", "US-ASCII"):
        return []
    return [f"{where}: is encoded in {encoding}; SSP has UTF-8 only"]


def _file_faults(archive: Archive, variant: str, label: str) -> list[str]:
    """Return what is wrong in the files of a system beyond their schemas."""
    faults: list[str] = []
    for kind, root, units, where in _documents(Scope(archive, "", "", variant, label), set()):
        if root.getparent() is None:
            faults += encoding_faults(root, where)
        if kind == "ssd":
            faults += _twice_faults(root, where)
        if kind != "ssm":
            faults += _unit_faults(kind, root, units, where)
    return faults


def _documents(scope: Scope, seen: set[str]) -> Iterator[tuple[str, Any, set[str], str]]:
    """Yield every file of a system and every part of one that could be a file of its own.

    Each comes as kind, root, the units that it may name, and its place. What cannot be read is left out.
    """
    if scope.prefix + scope.document in seen:
        return
    seen.add(scope.prefix + scope.document)
    try:
        root = parse_xml(scope.archive.read(scope.document), scope.document)
    except SspError:
        return
    where = f"{scope.label}: {scope.document}"
    defined = _units(root, "ssd")
    yield "ssd", root, defined, where
    for tag, kind in _INLINE.items():
        prefix, _, name = tag.partition(":")
        for part in root.iter(f"{{{NAMESPACES[prefix]}}}{name}"):
            yield kind, part, defined | _units(part, kind), f"{where}, line {part.sourceline}"
    for tag, kind in _EXTERNAL.items():
        for item in root.iter(f"{{{NAMESPACES['ssd']}}}{tag}"):
            member = _member(scope, item)
            if member is None or scope.prefix + member in seen or item.get("sourceBase") == "component":
                continue
            seen.add(scope.prefix + member)
            try:
                part = parse_xml(scope.archive.read(member), member)
            except SspError:
                continue
            yield kind, part, _units(part, kind), f"{scope.label}: {member}"
    for item in root.iter(f"{{{NAMESPACES['ssd']}}}Component"):
        inner = _inner(scope, item)
        if inner is not None:
            yield from _documents(inner, seen)


def _member(scope: Scope, item: Any) -> str | None:
    source = (item.get("source") or "").partition("#")[0]
    try:
        return scope.member(source, "") if source else None
    except SspError:
        return None


def _inner(scope: Scope, item: Any) -> Scope | None:
    """Return the scope of the SSD that a component stands for, if it does."""
    member = _member(scope, item)
    if member is None or member not in scope.archive:
        return None
    if item.get("type") == DEFINITION_TYPE:
        return Scope(scope.archive, scope.prefix, posixpath.dirname(member), member, scope.label)
    if item.get("type") != PACKAGE_TYPE:
        return None
    document = item.get("source").partition("#")[2] or "SystemStructure.ssd"
    try:
        archive, prefix = scope.inside(member)
    except SspError:
        return None
    return Scope(archive, prefix, "", document, f"{scope.label}: {member}")


def _units(root: Any, kind: str) -> set[str]:
    return {str(unit.get("name")) for unit in root.iterfind(f"{kind}:Units/ssc:Unit", NAMESPACES)}


def _unit_faults(kind: str, root: Any, units: set[str], where: str) -> list[str]:
    """Return the units that connectors, parameters or entries of a file name and that it does not define."""
    tag = {"ssd": "ssd:Connector", "ssv": "ssv:Parameter", "ssb": "ssb:DictionaryEntry"}[kind]
    prefix, _, name = tag.partition(":")
    users: dict[str, list[str]] = {}
    for item in root.iter(f"{{{NAMESPACES[prefix]}}}{name}"):
        for value in item:
            unit = value.get("unit")
            if unit and unit not in units:
                users.setdefault(unit, []).append(f"{_place(item)}{item.get('name')}")
    return [
        f"{where}: unit {unit!r} of {names[0]}{f' and {len(names) - 1} more' if names[1:] else ''} is not defined; "
        f"define it in {kind}:Units"
        for unit, names in users.items()
    ]


def _place(item: Any) -> str:
    """Return the dotted name of the element that has a connector, with a dot; empty for other items."""
    names = [
        above.get("name")
        for above in item.iterancestors(
            f"{{{NAMESPACES['ssd']}}}Component", f"{{{NAMESPACES['ssd']}}}System",
            f"{{{NAMESPACES['ssd']}}}SignalDictionaryReference",
        )
    ]  # fmt: skip
    is_connector = item.tag == f"{{{NAMESPACES['ssd']}}}Connector"
    return "".join(f"{name}." for name in reversed(names[:-1]) if name) if is_connector else ""


def _twice_faults(root: Any, where: str) -> list[str]:
    """Return the connectors of one element that have the same name."""
    faults: list[str] = []
    for box in root.iter(f"{{{NAMESPACES['ssd']}}}Connectors"):
        seen: set[str] = set()
        for item in box.iterfind("ssd:Connector", NAMESPACES):
            name = str(item.get("name"))
            if name in seen:
                faults.append(
                    f"{where}, line {item.sourceline}: two connectors are named {_place(item)}{name}; "
                    "names of connectors of one element must differ"
                )
            seen.add(name)
    return faults
