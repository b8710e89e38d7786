"""The connections of an SSD as a graph of connectors, and their flattening."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import count, product
from typing import Any

from vdfmu.base.errors import SspError
from vdfmu.base.standards import SSP_FORMATS
from vdfmu.engine.fmu.variables import CONVERT_TYPE, feeds
from vdfmu.engine.package.elements import Node, Scope, read_boolean, read_transformation
from vdfmu.engine.package.parse import NAMESPACES
from vdfmu.engine.package.system import Connection, Connector, Hop, Index, Shape, UnitFactor
from vdfmu.engine.rules import Finding, finding, place_of

Key = tuple[tuple[str, ...], str]
Indices = tuple[Index, Index]
"""Parts of the source and of the sink that a connection joins."""

FLOWS = {
    ("system parameter", "system calculatedParameter"), ("system parameter", "system output"),
    ("system input", "system output"),
    ("system parameter", "parameter"), ("system parameter", "input"), ("system parameter", "inout"),
    ("system input", "input"), ("system input", "inout"),
    ("calculatedParameter", "parameter"), ("calculatedParameter", "input"), ("calculatedParameter", "inout"),
    ("output", "input"), ("output", "inout"), ("inout", "input"),
    ("calculatedParameter", "system calculatedParameter"), ("calculatedParameter", "system output"),
    ("output", "system output"), ("inout", "system output"),
}  # fmt: skip
"""Allowed connections of SSP 1.0: source and destination, which are connectors of elements or of their system."""


def _flows_2() -> set[tuple[str, str]]:
    """Return the table "Allowed connections" of SSP 2.0; the kind unspecified allows any kind."""
    inside = ("structuralParameter", "parameter", "input", "inout")
    around = ("system calculatedParameter", "system output", "system local")
    flows = FLOWS | set(product(("system structuralParameter", "constant"), (*inside, *around)))
    flows |= {("constant", "system constant"), ("system parameter", "system local"), ("system input", "system local")}
    flows |= {("local", sink) for sink in ("input", "inout", "system output", "system local")}
    flows |= {(source, "system local") for source in ("calculatedParameter", "output", "inout")}

    def wild(kind: str) -> str:
        return "system unspecified" if kind.startswith("system ") else "unspecified"

    return flows | {pair for a, b in flows for pair in ((wild(a), b), (a, wild(b)), (wild(a), wild(b)))}


_FLOWS = {False: FLOWS, True: _flows_2()}


class Wiring:
    """All connectors of a system tree and the connections between them.

    The kinds of the connectors, not start and end in the SSD, determine the direction of data. Inside a system, outputs
    of elements and inputs of the system itself are sources; inputs of elements and outputs of the system are sinks.
    Calculated parameters count as outputs, parameters as inputs. In SSP 2.0 several connections may feed different
    elements of an array.
    """

    def __init__(self, top: Node, scope: Scope) -> None:
        self._scope = scope
        self.problems: list[Finding] = []
        self.kinds: dict[Key, str] = {}
        """Kind of the element of each connector: "component" or "system"."""
        self.forward: dict[Key, list[tuple[Key, Hop, Indices]]] = {}
        self._sources: dict[Key, dict[Index, Key]] = {}
        """Sources of a connector, or of a part of it."""
        self.names: dict[tuple[str, ...], str] = {}
        """Unique names of the components by path."""
        self._taken: set[str] = set()
        self.notes: list[Finding] = []
        self._add(top)

    def _add(self, node: Node) -> None:
        if node.kind == "component":
            self._call(node)
        for name in node.connectors:
            self.kinds[node.path, name] = node.kind
        for child in node.children.values():
            self._add(child)
        for item in node.element.iterfind("ssd:Connections/ssd:Connection", NAMESPACES):
            self._connect(node, item)

    def _call(self, node: Node) -> None:
        """Name a component by its path, uniquely even if dots in element names make two dotted names equal."""
        names = (f"{node.label}#{i}" if i > 1 else node.label for i in count(1))
        name = next(n for n in names if n not in self._taken)
        self._taken.add(name)
        self.names[node.path] = name
        if name != node.label:
            text = f"several components have the dotted name {node.label}: {' / '.join(node.path)} is called {name}"
            self.notes.append(finding("SSP021", f"{text} here", node.element))

    def _connect(self, node: Node, item: Any) -> None:
        # startElement="" means the system itself in some tools
        names = [(item.get(f"{e}Element") or None, item.get(f"{e}Connector")) for e in ("start", "end")]
        text = " -> ".join(".".join(p for p in (*node.path, *pair) if p) for pair in names)

        def fault(rule: str, reason: str) -> None:
            self.problems.append(finding(rule, f"connection {text}: {reason}", item))

        ends: list[tuple[str, Node, Connector, Index]] = []
        for end, (element, name) in zip(("start", "end"), names, strict=True):
            owner = node if element is None else node.children.get(element)
            connector = None if owner is None else owner.connectors.get(name)
            if owner is None:
                fault("SSP030", f"there is no element {node.dotted(str(element))!r}")
            elif connector is None:
                fault("SSP030", f"{owner.label or 'the system'} declares no connector {name!r}")
            else:
                index = tuple(int(i) for i in (item.get(f"{end}Indices") or "").split())
                for reason in _index_faults(index, connector.dimensions, owner.dotted(name)):
                    fault("SSP035", f"{end}Indices: {reason}")
                kind = ("system " if owner is node else "") + connector.kind
                ends.append((kind, owner, connector, index))
        if len(ends) < 2:
            return
        flows = _FLOWS[SSP_FORMATS[self._scope.version].more_connections]
        if (ends[0][0], ends[1][0]) not in flows:
            if (ends[1][0], ends[0][0]) not in flows:
                kinds = [kind for kind, *_ in ends]
                joined = " and ".join(f"{kind} {owner.dotted(end.name)}" for kind, owner, end, _ in ends)
                fault("SSP031", f"direction error, it joins {joined}{_expected(kinds, flows)}")
                return
            ends.reverse()
        (first_kind, first, begin, start), (second_kind, second, target, end) = ends
        source, sink = (first.path, begin.name), (second.path, target.name)
        taken = self._sources.setdefault(sink, {})
        for index, other in taken.items():
            if index[: len(end)] == end[: len(index)]:
                fault("SSP032", f"duplicate source, {show(sink)} is already fed by {show(other)}")
                return
        taken[end] = source
        try:
            transformation = read_transformation(item, f"connection {text}")
        except SspError as error:
            self.problems += error.problems
            return
        suppressed = read_boolean(item.get("suppressUnitConversion"))
        hop = Hop(transformation, suppressed, target.unit, target.type, place_of(item))
        around = any(kind.startswith("system ") for kind in (first_kind, second_kind))
        if around and not node.path:  # not on a path from component to component
            for rule, reason in _misfits(self._scope.units, begin, target, hop):
                fault(rule, reason)
        shapes = begin.dimensions[len(start) :], target.dimensions[len(end) :]
        if not fits(*shapes):
            fault("SSP035", f"dimension mismatch, {show_shape(shapes[0])} to {show_shape(shapes[1])}")
        self.forward.setdefault(source, []).append((sink, hop, (start, end)))

    def above(self, key: Key) -> Iterator[Key]:
        """Yield the sources of a connector, their sources, and so on."""
        seen, waiting = {key}, [key]
        while waiting:
            for source in self._sources.get(waiting.pop(0), {}).values():
                if source not in seen:
                    yield source
                    seen.add(source)
                    waiting.append(source)

    def reach(self, key: Key) -> Iterator[tuple[Key, tuple[Hop, ...], Indices]]:
        """Yield all component connectors fed from `key`, with the hops between them and the parts of both."""
        stack: list[tuple[Key, tuple[Hop, ...], frozenset[Key], Indices]] = [(key, (), frozenset([key]), ((), ()))]
        while stack:
            here, hops, seen, indices = stack.pop()
            for sink, hop, more in self.forward.get(here, ()):
                joined = _join(indices, more)
                if joined is None:
                    continue  # other elements
                if self.kinds[sink] == "component":
                    yield sink, (*hops, hop), joined
                elif sink in seen:
                    text = f"{show(sink)} is connected to itself through system connectors"
                    self.problems.append(finding("SSP037", text, hop.place))
                else:
                    stack.append((sink, (*hops, hop), seen | {sink}, joined))

    def flatten(self) -> Iterator[Connection]:
        """Yield the connections from component to component."""
        for key in list(self.forward):
            if self.kinds[key] == "component":
                for sink, hops, indices in self.reach(key):
                    yield Connection((self.names[key[0]], key[1]), (self.names[sink[0]], sink[1]), hops, indices)


def _join(first: Indices, then: Indices) -> Indices | None:
    """Join two connections in series; return parts of the first start and the last end, None if they share nothing."""
    (start, middle), (other, end) = first, then
    if middle[: len(other)] != other[: len(middle)]:
        return None
    return (*start, *other[len(middle) :]), (*end, *middle[len(other) :])


CONVERT = "Connect signals of one quantity, or put a component between them"
"""Fix for units of measurement that cannot be converted."""


def _misfits(
    units: Mapping[str, UnitFactor], begin: Connector, target: Connector, hop: Hop
) -> Iterator[tuple[str, str]]:
    """Yield reasons why two connectors do not fit together, according to the SSD."""
    if begin.type and target.type and not feeds(begin.type, target.type) and hop.transformation is None:
        yield "SSP033", f"type mismatch, {begin.type} to {target.type}. {CONVERT_TYPE}"
    if begin.unit and target.unit and not hop.suppress_unit_conversion:
        a, b = (units.get(unit, UnitFactor(unit)) for unit in (begin.unit, target.unit))
        if None not in (a.exponents, b.exponents) and a.exponents != b.exponents:
            yield "SSP034", f"unit mismatch, {a.name!r} ({a.dimension}) to {b.name!r} ({b.dimension}). {CONVERT}"


def _expected(kinds: Sequence[str], flows: set[tuple[str, str]]) -> str:
    """Return the sources of connectors of these kinds as text."""
    sources = {sink: sorted(source for source, end in flows if end == sink) for sink in dict.fromkeys(kinds)}
    return "".join(f"; {sink} can be fed by {' or '.join(fed)}" for sink, fed in sources.items() if fed)


def _index_faults(index: Index, shape: Shape, name: str) -> list[str]:
    if len(index) > len(shape):
        return [f"{len(index)} for {name}, {show_shape(shape)}"]
    return [
        f"{i} is outside of {name}, {show_shape(shape)}; the first index is 1"
        for i, size in zip(index, shape, strict=False)
        if i < 1 or (size is not None and i > size)
    ]


def fits(first: Shape, second: Shape) -> bool:
    """Return whether two shapes can be equal; an open size fits any."""
    pairs = zip(first, second, strict=False)
    return len(first) == len(second) and all(None in pair or pair[0] == pair[1] for pair in pairs)


def show_shape(shape: Shape) -> str:
    """Return a shape as text."""
    sizes = " x ".join("?" if size is None else str(size) for size in shape)
    return f"an array of {sizes}" if shape else "a scalar"


def show(key: Key) -> str:
    """Return the dotted name of a connector."""
    return ".".join((*key[0], key[1]))
