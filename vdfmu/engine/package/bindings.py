"""Parameter bindings of SSP: parameter sets (SSV), mappings (SSM), prefixes and precedence."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

from vdfmu.base.errors import SspError
from vdfmu.base.standards import SSP_FORMATS
from vdfmu.engine.package.archive import resolve
from vdfmu.engine.package.elements import Node, Scope, read_boolean, read_shape, read_transformation, read_units
from vdfmu.engine.package.parse import NAMESPACES, validate
from vdfmu.engine.package.system import BoundParameter, Hop, UnitFactor, Value
from vdfmu.engine.package.wiring import Key, Wiring, show, show_shape
from vdfmu.engine.rules import Finding, breach, finding, place_of

_SSV = f"{{{NAMESPACES['ssv']}}}"
_TYPES = {"ssv": "application/x-ssp-parameter-set", "ssm": "application/x-ssp-parameter-mapping"}


@dataclass(frozen=True)
class _Bound:
    """A value for a variable of a component, or for a connector of a system."""

    entry: BoundParameter
    """Its name is relative to the element, because the component is not yet known."""
    node: Node
    level: int
    """Depth of the binding in the tree; 0 for the whole system."""
    elsewhere: tuple[tuple[str, str], ...]


class Bindings:
    """Collects the parameter bindings of a tree.

    Bindings of a higher level override bindings of a lower level, later bindings earlier ones of the same level (SSP
    1.0, ParameterBindings). A prefix applies to every name of the set, and a mapping selects the values. A value is set
    in everything of its name, because names of elements may contain dots, so dotted names need not be unique. A
    connector with a value passes it to everything connected to it, where it overrides other values.
    """

    def __init__(self, wiring: Wiring, top: Node, scope: Scope) -> None:
        self.wiring, self._scope = wiring, scope
        self.fatal: list[Finding] = []
        """Faults of unreadable parameter sources."""
        self.unmatched: list[Finding] = []
        self.notes: list[Finding] = []
        """Values without effect."""
        self._bound: dict[Key, _Bound] = {}
        self._lost: dict[tuple[str, ...], list[BoundParameter]] = {}
        self._values: dict[tuple[str, ...], dict[str, BoundParameter]] = {}
        self._collect(top)
        for key, bound in self._bound.items():
            if not self._is_connector(key):
                self._store(key, bound, bound.entry.hops)
        for key, bound in self._bound.items():
            if self._is_connector(key):
                self._pass_on(key, bound)

    def of(self, path: tuple[str, ...]) -> tuple[tuple[BoundParameter, ...], tuple[BoundParameter, ...]]:
        """Return the values for a component, and the values that they override."""
        return tuple(self._values.get(path, {}).values()), tuple(self._lost.get(path, ()))

    def _is_connector(self, key: Key) -> bool:
        return self.wiring.kinds.get(key, "component") != "component"

    def _collect(self, node: Node) -> None:
        """Apply the bindings below `node`, then its own."""
        for child in node.children.values():
            self._collect(child)
        for binding in node.element.iterfind("ssd:ParameterBindings/ssd:ParameterBinding", NAMESPACES):
            if binding.get("sourceBase") == "component" and node.kind == "component" and not node.source:
                continue  # in a missing FMU, which the reader reports
            try:
                entries = self._entries(node, binding)
            except SspError as error:
                self.fatal += error.problems
                continue
            for entry in entries:
                places, names = list(node.places(entry.name)), self.wiring.names
                for place, name in places:
                    elsewhere = tuple((names.get(n.path, n.label), m) for n, m in places if n is not place)
                    key = place.path, name
                    if key in self._bound and place.kind == "component":
                        old = self._bound[key]
                        self._lost.setdefault(place.path, []).append(self._parameter(key, old, old.entry.hops))
                    self._bound[key] = _Bound(entry, place, len(node.path), elsewhere)
                if not places:
                    text = f"{node.label or 'the system'}: parameter {entry.name!r} ({entry.origin}) "
                    text += "matches no element or connector"
                    self.unmatched.append(finding("SSP052", text, entry.place))

    def _pass_on(self, key: Key, bound: _Bound) -> None:
        """Pass the value of a connector of a system to all variables fed from it."""
        connector = bound.node.connectors[key[1]]
        (hop,) = bound.entry.hops
        if not self._passes_on(key):
            reason = f"{show(key)} is of kind {connector.kind} and has the value of its source"
            return self._no_effect(key, bound, reason)
        for above in self.wiring.above(key):
            if self._passes_on(above):
                return self._overridden(key, bound, above)
        first = Hop(hop.transformation, hop.suppress_unit_conversion, connector.unit, connector.type)
        fed = list(self.wiring.reach(key))
        for sink, hops, indices in fed:
            if any(indices):
                text = f"is set, but only a part of it is connected to {show(sink)}; set {show(sink)} itself"
                text = f"{self._named(key, bound)}: {text}"
                self.fatal.append(finding("SSP054", text, bound.entry.place))
            if sink in self._bound:
                self._overridden(sink, self._bound[sink], key)
            self._store(sink, bound, (first, *hops))
        if not fed:
            self._no_effect(key, bound, f"nothing of a component is connected to {show(key)}")
        return None

    def _passes_on(self, key: Key) -> bool:
        """Return whether a connector of a system has a value for its sinks; outputs get theirs from inside."""
        bound = self._bound.get(key) if self._is_connector(key) else None
        return bound is not None and bound.node.connectors[key[1]].kind not in {"output", "calculatedParameter"}

    def _overridden(self, key: Key, bound: _Bound, source: Key) -> None:
        """Note a value that is overridden by its source although its level is not lower."""
        winner = self._bound[source]
        if bound.level <= winner.level:
            reason = f"{show(key)} is connected to {show(source)} and takes its value ({winner.entry.origin})"
            self._no_effect(key, bound, reason)

    def _no_effect(self, key: Key, bound: _Bound, reason: str) -> None:
        text = f"{self._named(key, bound)}: has no effect, {reason}"
        self.notes.append(finding("SSP057", text, bound.entry.place))

    def _named(self, key: Key, bound: _Bound) -> str:
        return f"{bound.node.label or 'the system'}: parameter {key[1]!r} ({bound.entry.origin})"

    def _store(self, key: Key, bound: _Bound, hops: tuple[Hop, ...]) -> None:
        self._values.setdefault(key[0], {})[key[1]] = self._parameter(key, bound, hops)

    def _parameter(self, key: Key, bound: _Bound, hops: tuple[Hop, ...]) -> BoundParameter:
        elsewhere = () if self._is_connector((bound.node.path, key[1])) else bound.elsewhere
        return replace(bound.entry, component=self.wiring.names[key[0]], name=key[1], hops=hops, elsewhere=elsewhere)

    def _document(self, node: Node, element: Any, kind: str, where: str) -> Any:
        """Return the root of an external file (`source`) or of the inline content."""
        scope, supported, source = self._scope, _TYPES[kind], element.get("source")
        if element.get("type", supported) != supported:
            text = f"{where}: type {element.get('type')!r} is not supported; only {supported} is"
            raise breach("SSP050", text, element)
        if source and element.get("sourceBase", "SSD") == "component":
            member = resolve(source, where, element)
            if node.kind != "component":
                raise breach("SSP050", f"{where}: sourceBase 'component' needs a component", element)
            return scope.read(member, kind, scope.archive.inside(node.source))
        if source:
            return scope.read(resolve(source, where, element), kind)
        inline = "ssd:ParameterValues/ssv:ParameterSet" if kind == "ssv" else "ssm:ParameterMapping"
        root = element.find(inline, NAMESPACES)
        if root is None:
            raise breach("SSP050", f"{where}: has neither a source nor inline content", element)
        validate(root, kind, where, scope.version)
        return root

    def _entries(self, node: Node, binding: Any) -> list[BoundParameter]:
        """Return the values of a binding by their names in the node; SspError with all faults of both files."""
        where = f"{self._scope.label}: parameter binding of {node.label or 'the system'}"
        problems: list[Finding] = []
        entries: list[BoundParameter] = []
        mapping: Any = None
        try:
            root = self._document(node, binding, "ssv", where)
            label = binding.get("source") or root.get("name")
            entries = self._values_of(root, binding.get("prefix", ""), label)
        except SspError as error:
            problems += error.problems
        element = binding.find("ssd:ParameterMapping", NAMESPACES)
        if element is not None:
            try:
                mapping = self._document(node, element, "ssm", f"{where}, mapping")
            except SspError as error:
                problems += error.problems
        if problems:
            raise SspError(problems)
        return entries if mapping is None else self._mapped(entries, mapping, where)

    def _mapped(self, entries: list[BoundParameter], mapping: Any, where: str) -> list[BoundParameter]:
        by_name = {entry.name: entry for entry in entries}
        mapped: list[BoundParameter] = []
        items = list(mapping.iterfind("ssm:MappingEntry", NAMESPACES))
        sources: dict[str, list[str]] = {}
        for item in items:
            sources.setdefault(item.get("target"), []).append(repr(item.get("source")))
        for target, names in sources.items():
            if len(names) > 1:
                text = f"the mapping has several entries for target {target!r}, from {', '.join(names)}; keep one"
                self.fatal.append(finding("SSP051", f"{where}: {text}", mapping))
        for item in items:
            entry = by_name.get(item.get("source"))
            if entry is None:
                text = f"{where}: the mapping's source {item.get('source')!r} is not in the parameter set"
                self.unmatched.append(finding("SSP052", text, item))
                continue
            transformation = read_transformation(item, f"{where}: {entry.name!r}")
            hop = Hop(transformation, read_boolean(item.get("suppressUnitConversion")))
            mapped.append(replace(entry, name=item.get("target"), hops=(hop,)))
        return mapped

    def _values_of(self, root: Any, prefix: str, label: str) -> list[BoundParameter]:
        scope = self._scope
        units = {**scope.units, **read_units(root.iterfind("ssv:Units/ssc:Unit", NAMESPACES))}
        entries: dict[str, BoundParameter] = {}

        def fault(rule: str, text: str) -> None:
            self.fatal.append(finding(rule, f"{scope.label}: {origin}: {text}", item))

        for item in root.iterfind("ssv:Parameters/ssv:Parameter", NAMESPACES):
            name = item.get("name")
            typed = next(c for c in item if c.tag.startswith(_SSV))
            kind, origin = typed.tag[len(_SSV) :], f"{label}: {name}"
            if kind == "Binary" and not SSP_FORMATS[scope.version].binary_parameters:
                fault("SSP054", "binary parameters are not part of FMI 2.0")
                continue
            if name in entries:
                fault("SSP051", "occurs twice in the parameter set")
            shape, text = read_shape(item), typed.get("value")
            texts = [value.get("value") for value in typed.iterfind("ssv:Value", NAMESPACES)]
            if not texts:
                texts = [text] if kind in ("String", "Enumeration") else text.split()
            read = _READ.get(kind.rstrip("0123456789"), str)
            values: list[Value] = [read(text) for text in texts]
            if None not in shape and len(values) != math.prod(size or 0 for size in shape):
                fault("SSP054", f"{len(values)} value(s) for {show_shape(shape)}")
            unit = typed.get("unit")
            entries[name] = BoundParameter(
                "",
                prefix + name,
                tuple(values) if shape or not values else values[0],
                kind,
                units.get(unit, UnitFactor(unit)) if unit else None,
                (Hop(),),
                origin,
                place_of(item),
                shape,
            )
        return list(entries.values())


_READ = {"Real": float, "Float": float, "Boolean": read_boolean, **dict.fromkeys(("Integer", "Int", "UInt"), int)}
"""Readers of values by type, without the number of bits."""
