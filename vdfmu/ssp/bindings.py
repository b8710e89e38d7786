"""Parameter bindings of SSP 1.0: parameter sets (SSV), mappings (SSM), prefixes and precedence."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from vdfmu.errors import SspError
from vdfmu.ssp.archive import NAMESPACES, Archive, parse_ssp_xml, resolve, validate
from vdfmu.ssp.elements import Node, Scope, read_boolean, read_transformation, read_units
from vdfmu.ssp.structure import Hop, Parameter, Unit
from vdfmu.ssp.wiring import Wiring

_SSV = f"{{{NAMESPACES['ssv']}}}"
SET_TYPE = "application/x-ssp-parameter-set"
MAPPING_TYPE = "application/x-ssp-parameter-mapping"


@dataclass(frozen=True)
class _Entry:
    """One value of a parameter set on its way to a variable."""

    name: str
    value: float | int | bool | str
    type: str
    unit: Unit | None
    hop: Hop
    origin: str
    optional: bool = False


class Bindings:
    """Collects the parameter bindings of a tree.

    Bindings of a higher level take precedence over those of a lower one, later ones over earlier ones of the
    same level (SSP 1.0, ParameterBindings). A prefix is put before every name of the set, then the mapping
    is applied; names that the mapping does not mention stay as they are.
    """

    def __init__(self, wiring: Wiring) -> None:
        self.wiring = wiring
        self.fatal: list[str] = []
        """What makes a parameter source unreadable."""
        self.unmatched: list[str] = []
        self._values: dict[tuple[str, str], Parameter] = {}

    def of(self, component: str) -> tuple[Parameter, ...]:
        """Return the values for one component."""
        return tuple(p for (name, _), p in self._values.items() if name == component)

    def collect(self, node: Node) -> None:
        """Apply the bindings below `node`, then its own, then those of a component that it stands for."""
        for child in node.children.values():
            self.collect(child)
        self._own(node, node.element, node.scope)
        if node.outer is not None:
            self._own(node, *node.outer)

    def _own(self, node: Node, element: Any, scope: Scope) -> None:
        for binding in element.iterfind("ssd:ParameterBindings/ssd:ParameterBinding", NAMESPACES):
            if binding.get("sourceBase") == "component" and node.kind == "component" and not node.source:
                continue  # lies in an FMU that is not there, which is reported
            try:
                entries = self._entries(node, binding, scope)
            except SspError as error:
                self.fatal += error.problems
                continue
            for entry in entries:
                if not self._apply(node, entry.name, entry) and not entry.optional:
                    self.unmatched.append(
                        f"{node.label or 'the system'}: parameter {entry.name!r} ({entry.origin}) "
                        "matches no element or connector"
                    )

    def _apply(self, node: Node, name: str, entry: _Entry) -> bool:
        if node.kind == "component":
            self._store(node.label, name, entry, (entry.hop,))
            return True
        if name in node.connectors:
            connector = node.connectors[name]
            first = Hop(
                entry.hop.transformation, entry.hop.suppress_unit_conversion, connector.unit, connector.type
            )
            found = False
            for sink, hops in self.wiring.reach((node.path, name)):
                self._store(".".join(sink[0]), sink[1], entry, (first, *hops))
                found = True
            return found
        matches = [child for child in node.children if name.startswith(child + ".")]
        if not matches:
            return False
        child = max(matches, key=len)
        return self._apply(node.children[child], name[len(child) + 1 :], entry)

    def _store(self, component: str, name: str, entry: _Entry, hops: tuple[Hop, ...]) -> None:
        self._values[component, name] = Parameter(
            component, name, entry.value, entry.type, entry.unit, hops, entry.origin, entry.optional
        )

    def _document(self, node: Node, scope: Scope, element: Any, kind: str, where: str) -> Any:
        """Return the root of an external file (`source`) or of the inline content; None when empty."""
        source = element.get("source")
        if source:
            if element.get("sourceBase", "SSD") == "component":
                member = resolve(source, where)
                if node.outer is not None and scope is not node.scope:
                    return parse_ssp_xml(
                        node.scope.archive.read(member), kind, f"{node.scope.label}: {member}"
                    )
                if node.kind != "component":
                    raise SspError(f"{where}: sourceBase 'component' needs a component")
                fmu = node.source.removeprefix(scope.prefix)
                with Archive(scope.archive.read(fmu), f"{scope.label}: {fmu}") as inner:
                    return parse_ssp_xml(inner.read(member), kind, f"{scope.label}: {member}")
            member = scope.member(source, where)
            return parse_ssp_xml(scope.archive.read(member), kind, f"{scope.label}: {member}")
        tag, box = (
            ("ssv:ParameterSet", element.find("ssd:ParameterValues", NAMESPACES))
            if kind == "ssv"
            else ("ssm:ParameterMapping", element)
        )
        root = None if box is None else box.find(tag, NAMESPACES)
        if root is not None:
            validate(root, kind, where)
        return root

    def _entries(self, node: Node, binding: Any, scope: Scope) -> list[_Entry]:
        """Return the values of a binding under the names of the node; SspError with the faults of set and mapping."""
        where = f"{scope.label}: parameter binding of {node.label or 'the system'}"
        problems: list[str] = []
        entries: list[_Entry] = []
        mapping: Any = None
        try:
            if binding.get("type", SET_TYPE) != SET_TYPE:
                raise SspError(f"{where}: type {binding.get('type')!r} is not supported; only {SET_TYPE} is")
            root = self._document(node, scope, binding, "ssv", where)
            if root is None:
                raise SspError(f"{where}: has neither a source nor inline values")
            label = binding.get("source") or root.get("name")
            entries = self._values_of(root, binding.get("prefix", ""), label, scope)
        except SspError as error:
            problems += error.problems
        element = binding.find("ssd:ParameterMapping", NAMESPACES)
        if element is not None:
            try:
                if element.get("type", MAPPING_TYPE) != MAPPING_TYPE:
                    raise SspError(f"{where}: mapping type {element.get('type')!r} is not supported")
                mapping = self._document(node, scope, element, "ssm", f"{where}, mapping")
                if mapping is None:
                    raise SspError(f"{where}: its mapping has neither a source nor inline entries")
            except SspError as error:
                problems += error.problems
        if problems:
            raise SspError(problems)
        return entries if mapping is None else self._mapped(entries, mapping, where)

    def _mapped(self, entries: list[_Entry], mapping: Any, where: str) -> list[_Entry]:
        by_name = {entry.name: entry for entry in entries}
        mapped: list[_Entry] = []
        used: set[str] = set()
        for item in mapping.iterfind("ssm:MappingEntry", NAMESPACES):
            entry = by_name.get(item.get("source"))
            if entry is None:
                self.unmatched.append(
                    f"{where}: the mapping's source {item.get('source')!r} is not in the parameter set"
                )
                continue
            used.add(entry.name)
            hop = Hop(
                read_transformation(item, f"{where}: {entry.name!r}"),
                read_boolean(item.get("suppressUnitConversion")),
            )
            mapped.append(_Entry(item.get("target"), entry.value, entry.type, entry.unit, hop, entry.origin))
        rest = [
            _Entry(e.name, e.value, e.type, e.unit, e.hop, e.origin, optional=True)
            for e in entries
            if e.name not in used
        ]
        return rest + mapped

    def _values_of(self, root: Any, prefix: str, label: str, scope: Scope) -> list[_Entry]:
        units = {**scope.units_here(), **read_units(root.find("ssv:Units", NAMESPACES))}
        entries: dict[str, _Entry] = {}
        for item in root.iterfind("ssv:Parameters/ssv:Parameter", NAMESPACES):
            name = item.get("name")
            typed = next(c for c in item if c.tag.startswith(_SSV))
            kind, text = typed.tag[len(_SSV) :], typed.get("value")
            origin = f"{label}: {name}"
            if kind == "Binary":
                self.fatal.append(f"{scope.label}: {origin}: binary parameters are not part of FMI 2.0")
                continue
            if name in entries:
                self.fatal.append(f"{scope.label}: {origin}: occurs twice in the parameter set")
            value: float | int | bool | str = text
            if kind == "Real":
                value = float(text)
            elif kind == "Integer":
                value = int(text)
            elif kind == "Boolean":
                value = read_boolean(text)
            unit = typed.get("unit") if kind == "Real" else None
            entries[name] = _Entry(
                prefix + name, value, kind, units.get(unit, Unit(unit)) if unit else None, Hop(), origin
            )
        return list(entries.values())
