"""The connections of an SSD as a graph of connectors, and their flattening."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import count
from typing import Any

from vdfmu.engine.ssp.elements import Node, read_boolean, read_transformation
from vdfmu.engine.ssp.parse import NAMESPACES
from vdfmu.engine.ssp.structure import Connection, Connector, Hop, Unit
from vdfmu.errors import SspError

Key = tuple[tuple[str, ...], str]

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
"""SSP 1.0, Allowed connections: source and destination, connectors of elements or of the system around them."""


class Wiring:
    """All connectors of a system tree and the connections between them.

    The words start and end of an SSD do not say where data flows to: the kinds of the connectors do. Inside
    a system, an output of an element and an input of the system itself are sources; an input of an element
    and an output of the system are sinks; the same for calculated parameters and parameters.
    """

    flows = FLOWS
    """The pairs of kinds that may be connected."""

    def __init__(self, top: Node) -> None:
        self.problems: list[str] = []
        self.kinds: dict[Key, str] = {}
        """"component", "system" or "dictionary" of every connector."""
        self.forward: dict[Key, list[tuple[Key, Hop]]] = {}
        self._source_of: dict[Key, Key] = {}
        self.names: dict[tuple[str, ...], str] = {}
        """The components: path to name, which is unique."""
        self._taken: set[str] = set()
        self.notes: list[str] = []
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
        """Name a component by its path; dots in the names of elements can give two components one dotted name."""
        names = (f"{node.label}#{i}" if i > 1 else node.label for i in count(1))
        name = next(n for n in names if n not in self._taken)
        self._taken.add(name)
        self.names[node.path] = name
        if name != node.label:
            self.notes.append(
                f"several components have the dotted name {node.label}: {' / '.join(node.path)} is called {name} here"
            )

    def _end(self, node: Node, element: str | None, connector: str, where: str) -> Node | None:
        """Return the owner of one end, or None with a problem noted."""
        owner = node if element is None else node.children.get(element)
        if owner is None:
            self.problems.append(f"{where}: there is no element {node.dotted(str(element))!r}")
            return None
        if connector not in owner.connectors:
            self.problems.append(
                f"{where}: {owner.label or 'the system'} declares no connector {connector!r}"
            )
            return None
        return owner

    def _connect(self, node: Node, item: Any) -> None:
        # some tools write startElement="" for a connector of the system itself
        names = [(item.get(f"{e}Element") or None, item.get(f"{e}Connector")) for e in ("start", "end")]
        text = " -> ".join(".".join(p for p in (*node.path, *pair) if p) for pair in names)
        where = f"connection {text}"
        ends = [self._end(node, element, connector, where) for element, connector in names]
        first, second = ends
        if first is None or second is None:
            return
        kinds = [
            ("system " if owner is node else "") + owner.connectors[name].kind
            for owner, (_, name) in ((first, names[0]), (second, names[1]))
        ]
        if (kinds[0], kinds[1]) in self.flows:
            pass
        elif (kinds[1], kinds[0]) in self.flows:
            first, second = second, first
            names.reverse()
        else:
            joined = " and ".join(
                f"{kind} {owner.dotted(name)}"
                for kind, owner, (_, name) in zip(kinds, (first, second), names, strict=True)
            )
            self.problems.append(f"{where}: direction error, it joins {joined}{self._expected(kinds)}")
            return
        source, sink = (first.path, names[0][1]), (second.path, names[1][1])
        if sink in self._source_of:
            self.problems.append(
                f"{where}: duplicate source, {show(sink)} is already fed by {show(self._source_of[sink])}"
            )
            return
        self._source_of[sink] = source
        try:
            transformation = read_transformation(item, where)
        except SspError as error:
            self.problems += error.problems
            return
        begin, target = first.connectors[names[0][1]], second.connectors[names[1][1]]
        hop = Hop(
            transformation,
            read_boolean(item.get("suppressUnitConversion")),
            target.unit,
            target.type,
        )
        if (
            not node.path
        ):  # paths from component to component do not lead over the connectors of the outermost system
            self.problems += [
                f"{where}: {fault}" for fault in self._outer_faults(node, begin, target, hop, kinds)
            ]
        self.forward.setdefault(source, []).append((sink, hop))

    def _outer_faults(
        self, node: Node, begin: Connector, target: Connector, hop: Hop, kinds: Sequence[str]
    ) -> list[str]:
        """Return how the connectors of a connection to the outermost system itself do not fit together."""
        if not any(kind.startswith("system ") for kind in kinds):
            return []
        faults: list[str] = []
        types = {begin.type, target.type}
        if None not in types and len(types) > 1 and hop.transformation is None:
            faults.append(f"type mismatch, {begin.type} to {target.type}")
        if begin.unit and target.unit and not hop.suppress_unit_conversion:
            units = [node.scope.units.get(unit, Unit(unit)) for unit in (begin.unit, target.unit)]
            known = [unit.exponents for unit in units]
            if None not in known and known[0] != known[1]:
                a, b = units
                faults.append(f"unit mismatch, {a.name!r} ({a.dimension}) to {b.name!r} ({b.dimension})")
        return faults

    def _expected(self, kinds: Sequence[str]) -> str:
        """Say what can feed connectors of these kinds."""
        known = {
            sink: sorted(source for source, end in self.flows if end == sink) for sink in dict.fromkeys(kinds)
        }
        return "".join(
            f"; {sink} can be fed by {' or '.join(found)}" for sink, found in known.items() if found
        )

    def above(self, key: Key) -> Iterator[Key]:
        """Yield what feeds a connector, what feeds that, and so on."""
        seen = {key}
        while (source := self._source_of.get(key)) is not None and source not in seen:
            yield source
            seen.add(source)
            key = source

    def reach(self, key: Key) -> Iterator[tuple[Key, tuple[Hop, ...]]]:
        """Yield every component connector fed from `key`, with the hops on the way."""
        stack: list[tuple[Key, tuple[Hop, ...], frozenset[Key]]] = [(key, (), frozenset([key]))]
        while stack:
            here, hops, seen = stack.pop()
            for sink, hop in self.forward.get(here, ()):
                if self.kinds[sink] == "component":
                    yield sink, (*hops, hop)
                elif sink in seen:
                    self.problems.append(f"{show(sink)} is connected to itself through system connectors")
                else:
                    stack.append((sink, (*hops, hop), seen | {sink}))

    def flatten(self) -> Iterator[Connection]:
        """Yield the connections from component to component."""
        for key in list(self.forward):
            if self.kinds[key] == "component":
                for sink, hops in self.reach(key):
                    yield Connection((self.names[key[0]], key[1]), (self.names[sink[0]], sink[1]), hops)


def show(key: Key) -> str:
    """Return the dotted name of a connector."""
    return ".".join((*key[0], key[1]))
