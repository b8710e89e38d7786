"""Check of a system of SSP 2.0, which the master does not run."""

from __future__ import annotations

import importlib.util
from functools import lru_cache
from pathlib import Path, PurePosixPath
from typing import Any

from lxml import etree  # pyright: ignore[reportAttributeAccessIssue]  # lxml ships no stubs

from vdfmu.errors import SspError
from vdfmu.ssp.archive import NAMESPACES, Archive, parse_xml
from vdfmu.ssp.elements import Node, Scope, read_units
from vdfmu.ssp.structure import Connector
from vdfmu.ssp.tree import TreeReader
from vdfmu.ssp.wiring import Wiring
from vdfmu.study.check_unit import check_unit, read_unit
from vdfmu.study.findings import Findings

__all__ = ["check_ssp2"]

_FILES = {
    "ssd": "SystemStructureDescription",
    "ssv": "SystemStructureParameterValues",
    "ssm": "SystemStructureParameterMapping",
    "ssb": "SystemStructureSignalDictionary",
}
_TYPES = {"Real": {"Real", "Float64", "Float32"}, "Integer": {"Integer", "Int32"}}
"""Types of SSP 1.0 to those of the FMU that they stand for; the others have the same name."""
_NO_SCHEMA = "the schemas of SSP 2.0 were not applied: pip install pyssp_standard brings them"


def check_ssp2(path: Path, variant: str, folder: Path, run: bool, checked: set[str]) -> Findings:
    """Check one SSD of a package: schema, resources, connectors, connections, and each FMU with its run.

    Parameters
    ----------
    path : Path
        The package.
    variant : str
        The SSD.
    folder : Path
        A place for FMUs.
    run : bool
        Whether to run the FMUs.
    checked : set of str
        FMUs that have been checked; those of this SSD are added.
    """
    with Archive(path, path.name) as archive:
        check = _Check(archive, path.name, folder, run, checked)
        try:
            root = check.structure(archive, variant, path.name)
        except SspError as error:
            return Findings(error.problems)
        scope = Scope(archive, "", "", variant, path.name)
        scope.define(read_units(root.find("ssd:Units", NAMESPACES)))
        reader = TreeReader(check.structure)
        top = reader.system(root.find("ssd:System", NAMESPACES), scope, None)
        check.findings.problems += reader.problems
        check.node(top)
        check.connections(Wiring(top), top)
        return check.findings


class _Check:
    def __init__(self, archive: Archive, label: str, folder: Path, run: bool, checked: set[str]) -> None:
        self.archive = archive
        self.label = label
        self.folder = folder
        self.run = run
        self.checked = checked
        self.findings = Findings(notes=["the system was not run: the master runs SSP 1.0 with FMI 2.0"])
        self._variables: dict[str, dict[str, Any] | None] = {}
        self._of_component: dict[str, dict[str, Any]] = {}

    def structure(self, archive: Archive, member: str, label: str) -> Any:
        """Return the root of an SSD of a package; its faults against the schema are kept."""
        root = self.document(archive, member, "ssd", f"{label}: {member}")
        if root.find("ssd:System", NAMESPACES) is None:
            raise SspError(f"{label}: {member}: has no system")
        return root

    def document(self, archive: Archive, member: str, kind: str, where: str) -> Any:
        """Parse a file of SSP and hold it against the schema, where there is one."""
        root = parse_xml(archive.read(member), where)
        if etree.QName(root).namespace != NAMESPACES[kind]:
            raise SspError(
                f"{where}: expected namespace {NAMESPACES[kind]}, got {etree.QName(root).namespace}"
            )
        schema = _schema(kind)
        if schema is None:
            self.findings.notes.append(_NO_SCHEMA)
        elif not schema.validate(root):
            faults = [f"{where}, line {e.line}: {e.message}" for e in schema.error_log]
            if kind == "ssd" and any(item.get("name") is None for item in root.iter(*_NAMED)):
                raise SspError(faults)  # what follows finds elements by their names
            self.findings.problems += faults
        return root

    def node(self, node: Node) -> None:
        """Check an element with everything below it."""
        if node.kind == "component" and node.source:
            self.component(node)
        self.bindings(node, node.element, node.scope)
        if node.outer is not None:
            self.bindings(node, *node.outer)
        for child in node.children.values():
            self.node(child)

    def component(self, node: Node) -> None:
        """Check the FMU of a component and hold the connectors against its variables."""
        if node.source not in self._variables:
            self._variables[node.source] = self._unit(node.source)
        variables = self._variables[node.source]
        if variables is None:
            return
        self._of_component[node.label] = variables
        for connector in node.connectors.values():
            where = f"{node.label}.{connector.name}"
            variable = variables.get(connector.name)
            if variable is None:
                self.findings.problems.append(f"{where}: {node.source} has no such variable")
            else:
                self.findings.problems += [f"{where}: {text}" for text in _misfits(connector, variable)]

    def _unit(self, source: str) -> dict[str, Any] | None:
        if source not in self.archive:
            return None  # reported by the reader
        fmu = self.folder / PurePosixPath(source).name
        fmu.write_bytes(self.archive.read(source))
        try:
            if source not in self.checked:
                self.checked.add(source)
                self.findings.add(check_unit(fmu, self.run)[0], source)
            return {v.name: v for v in read_unit(fmu).modelVariables}
        except Exception:  # reported by the check of the unit
            return None

    def bindings(self, node: Node, element: Any, scope: Scope) -> None:
        """Check the files, and the names that come to a component."""
        for binding in element.iterfind("ssd:ParameterBindings/ssd:ParameterBinding", NAMESPACES):
            where = f"{scope.label}: parameter binding of {node.label or 'the system'}"
            mapping = binding.find("ssd:ParameterMapping", NAMESPACES)
            try:
                values = self._external(scope, binding, "ssv", where)
                if values is None:
                    values = binding.find("ssd:ParameterValues/ssv:ParameterSet", NAMESPACES)
                if values is None:
                    raise SspError(f"{where}: has neither a source nor inline values")
                names = [
                    binding.get("prefix", "") + str(item.get("name"))
                    for item in values.iterfind("ssv:Parameters/ssv:Parameter", NAMESPACES)
                ]
                if mapping is not None:
                    table = self._external(scope, mapping, "ssm", f"{where}, mapping")
                    if table is None:
                        table = mapping.find("ssm:ParameterMapping", NAMESPACES)
                    names = self._mapped(names, table, where)
            except SspError as error:
                self.findings.problems += error.problems
                continue
            variables = self._of_component.get(node.label)
            unknown = [] if variables is None else [name for name in names if name not in variables]
            self.findings.problems += [f"{where}: {node.source} has no variable {name!r}" for name in unknown]

    def _mapped(self, names: list[str], table: Any, where: str) -> list[str]:
        """Return the targets of a mapping; names that it does not mention need not be variables."""
        if table is None:
            self.findings.problems.append(f"{where}: its mapping has neither a source nor inline entries")
            return []
        entries = list(table.iterfind("ssm:MappingEntry", NAMESPACES))
        for entry in entries:
            if entry.get("source") not in names:
                self.findings.problems.append(
                    f"{where}: the mapping's source {entry.get('source')!r} is not in the parameter set"
                )
        return [str(entry.get("target")) for entry in entries]

    def _external(self, scope: Scope, element: Any, kind: str, where: str) -> Any:
        source = element.get("source")
        if not source or element.get("sourceBase") == "component":
            return None
        member = scope.member(source, where)
        return self.document(scope.archive, member, kind, f"{scope.label}: {member}")

    def connections(self, wiring: Wiring, top: Node) -> None:
        """Check ends, directions, types and sizes of the connections."""
        flat = list(wiring.flatten())
        self.findings.problems += wiring.problems
        for connection in flat:
            ends = [
                self._of_component.get(unit, {}).get(name)
                for unit, name in (connection.start, connection.end)
            ]
            source, sink = ends
            if source is None or sink is None:
                continue
            if source.type != sink.type:
                self.findings.problems.append(
                    f"connection {connection}: type mismatch, {source.type} to {sink.type}"
                )
            shapes = [_shape(source), _shape(sink)]
            if None not in shapes and shapes[0] != shapes[1]:
                self.findings.problems.append(
                    f"connection {connection}: dimension mismatch, {_show(shapes[0])} to {_show(shapes[1])}"
                )


_NAMED = [f"{{{NAMESPACES['ssd']}}}{tag}" for tag in ("Connector", "Component", "SignalDictionaryReference")]


def _misfits(connector: Connector, variable: Any) -> list[str]:
    """Return what a connector says otherwise than the variable."""
    misfits: list[str] = []
    if connector.kind != variable.causality:
        misfits.append(f"the SSD declares kind {connector.kind!r}, the FMU causality {variable.causality!r}")
    kind = connector.type
    if kind is not None and variable.type not in _TYPES.get(kind, {kind}):
        misfits.append(f"the SSD declares type {kind}, the FMU {variable.type}")
    shape = _shape(variable)
    if shape is not None:
        declared = connector.dimensions
        fits = len(declared) == len(shape) and all(
            d is None or s is None or d == s for d, s in zip(declared, shape, strict=True)
        )
        if not fits:
            misfits.append(f"the SSD declares {_show(declared)}, the FMU {_show(shape)}")
    return misfits


def _shape(variable: Any) -> tuple[int | None, ...] | None:
    """Return the sizes of a variable; None for one that a parameter sets, as far as it has no start value."""
    sizes: list[int | None] = []
    for dimension in variable.dimensions or ():
        text = dimension.start
        if text is None and dimension.variable is not None:
            text = dimension.variable.start
        sizes.append(None if text is None else int(text))
    return tuple(sizes)


def _show(shape: tuple[int | None, ...] | None) -> str:
    return (
        "a scalar" if not shape else "an array of " + " x ".join("?" if s is None else str(s) for s in shape)
    )


@lru_cache
def _schema(kind: str) -> Any:
    """Return a schema of SSP 2.0, or None where the package that brings them is not installed."""
    found = importlib.util.find_spec("pyssp_standard")
    if found is None or not found.submodule_search_locations:
        return None
    file = Path(found.submodule_search_locations[0], "resources", "ssp2", f"{_FILES[kind]}.xsd")
    return etree.XMLSchema(file=str(file)) if file.is_file() else None
