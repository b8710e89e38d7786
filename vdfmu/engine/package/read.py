"""`load_ssp` and `read_system`, which read a file into a `FlatSystem`, and rules beyond the schemas."""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Iterator
from pathlib import Path
from typing import Any

from vdfmu.base.cache import cached_per_command
from vdfmu.base.errors import SspError
from vdfmu.base.option import checks_types
from vdfmu.engine.package import archive, parse
from vdfmu.engine.package.archive import Archive, stamp_of
from vdfmu.engine.package.bindings import Bindings
from vdfmu.engine.package.elements import Document, Scope, read_experiment, read_units
from vdfmu.engine.package.parse import NAMESPACES, version_of
from vdfmu.engine.package.system import Component, FlatSystem
from vdfmu.engine.package.tree import TreeReader
from vdfmu.engine.package.wiring import Wiring
from vdfmu.engine.rules import Finding, breach, finding, notes_in, place_of, problems_in

DEFAULT = "SystemStructure.ssd"
"""The SSD that a package must have."""


@checks_types
def load_ssp(path: str | Path, variant: str = DEFAULT) -> FlatSystem:
    """Read a system structure package (SSP 1.0 or 2.0) and flatten it.

    Nested systems and system connectors are resolved to connections from component to component. Parameter bindings of
    all levels are resolved to one value per variable: a higher level overrides a lower one, and a later binding an
    earlier one of the same level.

    Parameters
    ----------
    path : str or Path
        The ``.ssp`` file.
    variant : str, optional
        The SSD to read, if the package has several at its root.

    Returns
    -------
    FlatSystem
        Faults of the wiring, such as two sources of a connector, are in its `problems`, so that
        `vdfmu.engine.plan.check.check_system` can report them together with faults of the FMUs.

    Raises
    ------
    SspError
        The file cannot be understood: not a zip, an entry outside the package, a missing resource, a member over the
        size limit, XML with a document type, a violation of the schemas, an unknown element. It lists all such
        problems.
    """
    return _loaded(Path(path), variant, stamp_of(Path(path)), archive.unpack_limit())


@cached_per_command
def _loaded(path: Path, variant: str, *_: Hashable) -> FlatSystem:
    """Read a package once per job unless it changes."""
    system, problems = read_system(path, variant)
    if system is None or problems:
        raise SspError(problems)
    return system


def read_system(path: str | Path, variant: str = DEFAULT) -> tuple[FlatSystem | None, list[Finding]]:
    """Read a package as far as possible, with all problems; `load_ssp` accepts a package without problems.

    The system is None if the package or its SSD cannot be parsed or is over a limit. Otherwise it is returned without
    its unreadable parts, and a component with a missing FMU has the source "". Its `problems` include the problems of
    reading, so `vdfmu.engine.plan.check.check_system` reports everything at once.
    """
    path = Path(path)
    try:
        with Archive(path, path.name) as archive:
            return _read(archive, path, variant)
    except SspError as error:
        return None, error.problems


def _read(archive: Archive, path: Path, variant: str) -> tuple[FlatSystem, list[Finding]]:
    scope = Scope(archive, variant, path.name)
    try:
        root = _structure(scope)
        scope.version = version_of(root)
        return _flattened(root, scope, path)
    except (ValueError, TypeError, AttributeError, StopIteration) as error:
        if parse.schema_of("ssd", scope.version) is not None:
            raise
        text = f"{path.name}: {variant}: cannot be read, an element or attribute is missing or invalid: {error}"
        raise breach("SSP003", text) from None  # as the missing schema would


def _flattened(root: Any, scope: Scope, path: Path) -> tuple[FlatSystem, list[Finding]]:
    scope.units |= read_units(_units_of(root, "ssd"))
    reader = TreeReader(scope)
    top = reader.system(root.find("ssd:System", NAMESPACES))
    wiring = Wiring(top, scope)
    bindings = Bindings(wiring, top, scope)
    experiment, faults = read_experiment(root, f"{path.name}: {scope.document}")
    read = list(dict.fromkeys(reader.problems + bindings.fatal + faults))
    connections = tuple(wiring.flatten())  # adds to wiring.problems
    notes = [*notes_in(read), *wiring.notes, *bindings.notes]
    if parse.schema_of("ssd", scope.version) is None:
        text = "the schemas of SSP 2.0 were not applied: install them with pip install pyssp_standard"
        notes.insert(0, finding("SSP009", text))
    system = FlatSystem(
        path=path,
        name=root.get("name"),
        components=tuple(
            Component(
                wiring.names[node.path],
                node.source,
                node.implementation,
                node.connectors,
                *bindings.of(node.path),
                node.step,
                place_of(node.element),
            )
            for node in top.components()
        ),
        connections=connections,
        units=scope.units,
        experiment=experiment,
        problems=(*problems_in(read), *wiring.problems),
        unmatched=tuple(bindings.unmatched),
        notes=tuple(notes),
        faults=tuple(_file_faults(scope.files.values())),
        version=scope.version,
    )
    return system, problems_in(read)


def variants(archive: Archive) -> list[str]:
    """Return the SSDs at the root of a package, the default first."""
    names = [n for n in archive.names if "/" not in n and n.lower().endswith(".ssd") and n != DEFAULT]
    return [*([DEFAULT] if DEFAULT in archive.names else []), *sorted(names)]


def _structure(scope: Scope) -> Any:
    if scope.document not in scope.archive:
        names = variants(scope.archive)
        has = f"; it has {', '.join(names)}" if names else ""
        raise breach("SSP001", f"{scope.label}: the package has no {scope.document!r}{has}")
    root = scope.read(scope.document, "ssd")
    if root.find("ssd:System", NAMESPACES) is None:  # only without a schema
        raise breach("SSP003", f"{scope.label}: {scope.document}: has no system", root)
    return root


_USERS = {"ssd": "Connector", "ssv": "Parameter"}
"""Elements with units by kind of file."""


def _file_faults(documents: Iterable[Document]) -> list[Finding]:
    """Return faults of files beyond the schemas: encoding, names of connectors, undefined units."""
    faults: list[Finding] = []
    for kind, root, where in documents:
        encoding = root.getroottree().docinfo.encoding or "UTF-8"
        if encoding.upper() not in ("UTF-8", "UTF8", "ASCII", "US-ASCII"):
            faults.append(finding("SSP004", f"{where}: is encoded in {encoding}; SSP allows only UTF-8", root))
        if kind == "ssm":
            continue
        units = read_units(_units_of(root, kind))
        if kind == "ssd":
            faults += _twice_faults(root, where)
        faults += _unit_faults(kind, root, set(units), where)
        for part in root.iter(f"{{{NAMESPACES['ssv']}}}ParameterSet") if kind == "ssd" else ():
            names = {*units, *read_units(_units_of(part, "ssv"))}
            faults += _unit_faults("ssv", part, names, f"{where}, line {part.sourceline}")
    return faults


def _units_of(root: Any, kind: str) -> Iterator[Any]:
    return root.iterfind(f"{kind}:Units/ssc:Unit", NAMESPACES)


def _unit_faults(kind: str, root: Any, units: set[str], where: str) -> Iterator[Finding]:
    """Yield units without a conversion, and undefined units."""
    for item in _units_of(root, kind):
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
    """Return the name of an item, for a connector its dotted name without the outermost system."""
    tags = (f"{{{NAMESPACES['ssd']}}}{t}" for t in ("Component", "System"))
    names = [above.get("name") for above in item.iterancestors(*tags)]
    is_connector = item.tag == f"{{{NAMESPACES['ssd']}}}Connector"
    outer = "".join(f"{name}." for name in reversed(names[:-1]) if name) if is_connector else ""
    return f"{outer}{item.get('name')}"


def _twice_faults(root: Any, where: str) -> Iterator[Finding]:
    """Yield findings on connectors of an element that have the same name."""
    for box in root.iter(f"{{{NAMESPACES['ssd']}}}Connectors"):
        seen: set[str] = set()
        for item in box.iterfind("ssd:Connector", NAMESPACES):
            name = str(item.get("name"))
            if name in seen:
                text = f"{where}, line {item.sourceline}: two connectors are named {_name(item)}; "
                yield finding("SSP018", f"{text}names of connectors of one element must differ", item)
            seen.add(name)
