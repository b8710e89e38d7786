"""Check of a system of SSP 2.0, which the master does not run."""

from __future__ import annotations

import importlib.util
from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path, PurePosixPath
from typing import Any

from lxml import etree  # pyright: ignore[reportAttributeAccessIssue]  # lxml ships no stubs

from vdfmu.engine.check.findings import Findings
from vdfmu.engine.check.fmu import check_unit, read_unit, store
from vdfmu.engine.check.ssp1 import encoding_faults
from vdfmu.engine.check.values import (
    ArrayWiring,
    connector_unit_faults,
    dimension_faults,
    fmu_units,
    parameter_faults,
    shape_of,
    show_shape,
    unit_faults,
)
from vdfmu.engine.cosim.conversion import compose
from vdfmu.engine.ssp.archive import Archive
from vdfmu.engine.ssp.elements import Node, Scope, read_units
from vdfmu.engine.ssp.experiment import read_experiment
from vdfmu.engine.ssp.parse import NAMESPACES, parse_xml
from vdfmu.engine.ssp.structure import Connector, Unit
from vdfmu.engine.ssp.tree import TreeReader
from vdfmu.engine.ssp.wiring import Wiring
from vdfmu.errors import SspError

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
            check.system(root, variant)
        except SspError as error:
            check.findings.problems += error.problems
            check.units()
        except (
            ValueError,
            TypeError,
            AttributeError,
        ) as error:  # what the schema refuses, where there is none
            check.findings.problems.append(
                f"{path.name}: {variant}: cannot be read, an element or attribute is missing or odd: {error}"
            )
            check.units()
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
        self._sources: dict[str, str] = {}
        self._units: dict[str, dict[str, Unit]] = {}
        self._kinds: dict[str, list[str]] = {}

    def system(self, root: Any, variant: str) -> None:
        """Check the system of an SSD, given its root."""
        self.findings.problems += read_experiment(root, f"{self.label}: {variant}")[1]
        scope = Scope(self.archive, "", "", variant, self.label)
        scope.define(read_units(root.find("ssd:Units", NAMESPACES)))
        reader = TreeReader(self.structure)
        top = reader.system(root.find("ssd:System", NAMESPACES), scope, None)
        self.findings.problems += reader.problems
        self.findings.problems += unit_faults(scope.units)
        self.node(top)
        self.all_bindings(top)
        self.connections(ArrayWiring(top), top, scope.units)

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
        self.findings.problems += encoding_faults(root, where)
        schema = _schema(kind)
        if schema is None:
            self.findings.notes.append(_NO_SCHEMA)
        elif not schema.validate(root):
            raise SspError([f"{where}, line {e.line}: {e.message}" for e in schema.error_log])
        nameless = [item for item in root.iter(*_NAMED[kind]) if item.get("name") is None]
        if nameless:  # what follows finds elements by their names
            raise SspError(
                [f"{where}, line {i.sourceline}: {i.tag.rsplit('}')[1]} has no name" for i in nameless]
            )
        return root

    def node(self, node: Node) -> None:
        """Check an element with everything below it."""
        if node.kind == "component" and node.source:
            self.component(node)
        else:
            self.findings.problems += [
                f"{node.dotted(c.name)}: {fault}"
                for c in node.connectors.values()
                for fault in connector_unit_faults(c, node.scope.units, None)
            ]
        for child in node.children.values():
            self.node(child)

    def all_bindings(self, node: Node) -> None:
        """Check the bindings of an element and of everything below it; they need the variables of all components."""
        self.bindings(node, node.element, node.scope)
        if node.outer is not None:
            self.bindings(node, *node.outer)
        for child in node.children.values():
            self.all_bindings(child)

    def component(self, node: Node) -> None:
        """Check the FMU of a component and hold the connectors against its variables."""
        if node.source not in self._variables:
            self._variables[node.source] = self._unit(node.source)
        variables = self._variables[node.source]
        if variables is None:
            return
        self._of_component[node.label] = variables
        self._sources[node.label] = node.source
        units = self._units[node.source]
        kinds = self._kinds[node.source]
        if node.implementation != "any" and node.implementation not in kinds:
            has = " and ".join(kinds) or "none"
            self.findings.problems.append(
                f"{node.label}: the SSD asks for {node.implementation}, {node.source} has {has}"
            )
        for connector in node.connectors.values():
            where = f"{node.label}.{connector.name}"
            variable = variables.get(connector.name)
            if variable is None:
                self.findings.problems.append(f"{where}: {node.source} has no such variable")
            else:
                misfits = _misfits(connector, variable)
                misfits += connector_unit_faults(connector, node.scope.units, _unit_of(variable, units))
                self.findings.problems += [f"{where}: {text}" for text in misfits]

    def units(self) -> None:
        """Check all FMUs of the package, where the system does not say which it has."""
        for name in self.archive.names:
            if name.lower().endswith(".fmu"):
                self._unit(name)

    def _unit(self, source: str) -> dict[str, Any] | None:
        if source not in self.archive:
            return None  # reported by the reader
        try:
            fmu = store(self.archive, source, self.folder)
        except SspError as error:
            self.findings.problems += error.problems
            return None
        if source not in self.checked:
            self.checked.add(source)
            self.findings.add(check_unit(fmu, self.run, PurePosixPath(source).name, self.archive)[0], source)
        try:
            description = read_unit(fmu)
            self._units[source] = fmu_units(description)
            self._kinds[source] = [
                kind for kind in _KINDS if getattr(description, kind[0].lower() + kind[1:], None) is not None
            ]
            return {v.name: v for v in description.modelVariables}
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
                prefix = binding.get("prefix", "")
                items = list(values.iterfind("ssv:Parameters/ssv:Parameter", NAMESPACES))
                names = [prefix + str(item.get("name")) for item in items]
                twice = [name for name in dict.fromkeys(names) if names.count(name) > 1]
                self.findings.problems += [f"{where}: parameter {n!r} occurs twice in the set" for n in twice]
                own = read_units(values.find("ssv:Units", NAMESPACES))
                self.findings.problems += [f"{where}: {fault}" for fault in unit_faults(own)]
                units = {**scope.units_here(), **own}
                if mapping is None:
                    targets = [(item, name, True) for item, name in zip(items, names, strict=True)]
                else:
                    table = self._external(scope, mapping, "ssm", f"{where}, mapping")
                    if table is None:
                        table = mapping.find("ssm:ParameterMapping", NAMESPACES)
                    targets = self._mapped(dict(zip(names, items, strict=True)), table, where)
                for item in items:
                    self._parameter(item, units, where)
                for item, target, plain in targets:
                    self._target(node, item, target, plain, units, where)
            except SspError as error:
                self.findings.problems += error.problems

    def _parameter(self, item: Any, units: Mapping[str, Unit], where: str, *of: Any) -> None:
        faults = parameter_faults(item, units, *of)
        texts = [f"{where}: parameter {item.get('name')!r}: {fault}" for fault in faults]
        self.findings.problems += [text for text in texts if text not in self.findings.problems]

    def _target(
        self, node: Node, item: Any, target: str, plain: bool, units: Mapping[str, Unit], where: str
    ) -> None:
        """Check a value against all that has the name; `plain` without a transformation on the way."""
        found = list(node.places(target))
        if not found:
            self.findings.notes.append(
                f"{where}: parameter {target!r} matches no element or connector; the value is ignored"
            )
        for owner, name in found:
            variables = self._of_component.get(owner.label) if owner.kind == "component" else None
            variable = None if variables is None else variables.get(name)
            if variables is not None and variable is None:
                self.findings.notes.append(
                    f"{where}: {owner.source} has no variable {name!r}; the value is ignored"
                )
            elif variable is not None and plain:
                self._parameter(item, units, where, variable, _unit_of(variable, self._units[owner.source]))

    def _mapped(self, items: Mapping[str, Any], table: Any, where: str) -> list[tuple[Any, str, bool]]:
        """Return the parameters that a mapping names, their targets, and whether they pass as they are."""
        if table is None:
            self.findings.problems.append(f"{where}: its mapping has neither a source nor inline entries")
            return []
        entries = list(table.iterfind("ssm:MappingEntry", NAMESPACES))
        for entry in entries:
            if entry.get("source") not in items:
                self.findings.notes.append(
                    f"{where}: the mapping's source {entry.get('source')!r} is not in the parameter set; "
                    "the entry is ignored"
                )
        return [
            (items[entry.get("source")], str(entry.get("target")), len(entry) == 0)
            for entry in entries
            if entry.get("source") in items
        ]

    def _external(self, scope: Scope, element: Any, kind: str, where: str) -> Any:
        source = element.get("source")
        if not source or element.get("sourceBase") == "component":
            return None
        member = scope.member(source, where)
        return self.document(scope.archive, member, kind, f"{scope.label}: {member}")

    def _declared(self, port: tuple[str, str]) -> Unit | None:
        """Return the unit of a variable of a component."""
        component, name = port
        return _unit_of(self._of_component[component][name], self._units[self._sources[component]])

    def connections(self, wiring: Wiring, top: Node, units: Mapping[str, Unit]) -> None:
        """Check ends, directions, types, units and sizes of the connections."""
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
            elif source.type in ("Real", "Float64", "Float32"):
                try:
                    compose(
                        connection.hops,
                        self._declared(connection.start),
                        self._declared(connection.end),
                        "Real",
                        units,
                    )
                except ValueError as error:
                    self.findings.problems.append(f"connection {connection}: {error}")
        self.findings.problems += dimension_faults(top, self._of_component)


_KINDS = ("CoSimulation", "ModelExchange", "ScheduledExecution")
_NAMED = {
    "ssd": [
        f"{{{NAMESPACES['ssd']}}}{tag}" for tag in ("Connector", "Component", "SignalDictionaryReference")
    ],
    "ssv": [f"{{{NAMESPACES['ssv']}}}Parameter"],
    "ssm": [f"{{{NAMESPACES['ssm']}}}none"],  # without a tag every element would be found
    "ssb": [f"{{{NAMESPACES['ssb']}}}DictionaryEntry"],
}


def _unit_of(variable: Any, units: Mapping[str, Unit]) -> Unit | None:
    """Return the unit of a variable, its own or that of its type."""
    name = variable.unit or getattr(variable.declaredType, "unit", None)
    return None if not name else units.get(name, Unit(name))


def _misfits(connector: Connector, variable: Any) -> list[str]:
    """Return what a connector says otherwise than the variable."""
    misfits: list[str] = []
    if connector.kind != variable.causality:
        misfits.append(f"the SSD declares kind {connector.kind!r}, the FMU causality {variable.causality!r}")
    kind = connector.type
    if kind is not None and variable.type not in _TYPES.get(kind, {kind}):
        misfits.append(f"the SSD declares type {kind}, the FMU {variable.type}")
    shape, declared = shape_of(variable), connector.dimensions
    fits = len(declared) == len(shape) and all(
        d is None or s is None or d == s for d, s in zip(declared, shape, strict=True)
    )
    if not fits:
        misfits.append(f"the SSD declares {show_shape(declared)}, the FMU {show_shape(shape)}")
    return misfits


@lru_cache
def _schema(kind: str) -> Any:
    """Return a schema of SSP 2.0, or None where the package that brings them is not installed."""
    found = importlib.util.find_spec("pyssp_standard")
    if found is None or not found.submodule_search_locations:
        return None
    file = Path(found.submodule_search_locations[0], "resources", "ssp2", f"{_FILES[kind]}.xsd")
    return etree.XMLSchema(file=str(file)) if file.is_file() else None
