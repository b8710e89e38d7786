"""The elements of an SSD before flattening, and the parts that several files share."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from vdfmu.ssp.archive import NAMESPACES
from vdfmu.ssp.structure import BASE_UNITS, Connector, Transformation, Unit

_SSC = f"{{{NAMESPACES['ssc']}}}"
_TYPES = ("Real", "Integer", "Boolean", "String", "Enumeration", "Binary")


@dataclass
class Node:
    """A system, component or signal dictionary reference of the tree. The root has an empty path."""

    path: tuple[str, ...]
    kind: str
    connectors: dict[str, Connector]
    element: Any
    children: dict[str, Node] = field(default_factory=dict)
    source: str = ""
    implementation: str = "any"
    dictionaries: dict[str, tuple[tuple[str, ...], dict[str, Connector]]] = field(default_factory=dict)

    @property
    def label(self) -> str:
        """The dotted name."""
        return ".".join(self.path)

    def dotted(self, name: str) -> str:
        """Return the dotted name of an element or connector of this node."""
        return ".".join((*self.path, name))


def read_connectors(element: Any) -> dict[str, Connector]:
    """Read the connectors of an element, by name."""
    connectors: dict[str, Connector] = {}
    for item in element.iterfind("ssd:Connectors/ssd:Connector", NAMESPACES):
        kind = next((c for c in item if c.tag in {_SSC + t for t in _TYPES}), None)
        connectors[item.get("name")] = Connector(
            name=item.get("name"),
            kind=item.get("kind"),
            type=None if kind is None else kind.tag[len(_SSC) :],
            unit=None if kind is None else kind.get("unit"),
        )
    return connectors


def read_units(element: Any) -> dict[str, Unit]:
    """Read an ``ssd:Units`` or ``ssv:Units`` element (or None)."""
    units: dict[str, Unit] = {}
    for item in () if element is None else element.iterfind("ssc:Unit", NAMESPACES):
        base = item.find("ssc:BaseUnit", NAMESPACES)
        units[item.get("name")] = Unit(
            item.get("name"),
            tuple(int(base.get(b, "0")) for b in BASE_UNITS),
            float(base.get("factor", "1")),
            float(base.get("offset", "0")),
        )
    return units


def read_boolean(text: str | None) -> bool:
    """Read an ``xs:boolean``; a missing one is false."""
    return text is not None and text.strip() in {"true", "1"}


def read_transformation(element: Any) -> Transformation | None:
    """Read the transformation of a connection or a mapping entry.

    Enumeration mappings are kept by kind only; their use is refused where they are applied.
    """
    for item in element:
        tag = item.tag
        if tag == _SSC + "LinearTransformation":
            return Transformation("linear", float(item.get("factor", "1")), float(item.get("offset", "0")))
        for kind, convert in (("Boolean", read_boolean), ("Integer", int), ("Enumeration", None)):
            if tag == f"{_SSC}{kind}MappingTransformation":
                entries = item.iterfind("ssc:MapEntry", NAMESPACES)
                table = (
                    {}
                    if convert is None
                    else {int(convert(e.get("source"))): int(convert(e.get("target"))) for e in entries}
                )
                return Transformation(kind.lower(), table=table)
    return None
