"""The elements of an SSD before flattening, and the parts that several files share."""

from __future__ import annotations

import posixpath
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any
from urllib.parse import unquote, urlsplit

from vdfmu.engine.ssp.archive import INSIDE, Archive, is_inside, resolve
from vdfmu.engine.ssp.parse import NAMESPACES
from vdfmu.engine.ssp.structure import BASE_UNITS, Connector, Transformation, Unit
from vdfmu.errors import SspError

_SSC = f"{{{NAMESPACES['ssc']}}}"
_SCALARS = ("Real", "Integer", "Boolean", "String", "Enumeration", "Binary")
_ARRAYS = ("Float64", "Float32", *(f"{u}Int{n}" for u in ("", "U") for n in (8, 16, 32, 64)), "Clock")
_TYPES = {_SSC + name for name in _SCALARS + _ARRAYS}


@dataclass(frozen=True)
class Scope:
    """Where the names of one SSD are looked up.

    Attributes
    ----------
    archive : Archive
        The package that holds the SSD.
    prefix : str
        What leads from the outermost package to it, such as ``resources/arm.ssp!/``.
    base : str
        Folder of the SSD in the package; relative URIs start there.
    document : str
        Name of the SSD in its package.
    label : str
        The package in messages.
    aliases : dict of str to str
        Names of units that another SSD of the tree defines otherwise, and the names they have here instead.
    units : dict of str to Unit
        All unit definitions of the tree; shared by its scopes.
    """

    archive: Archive
    prefix: str
    base: str
    document: str
    label: str
    aliases: dict[str, str] = field(default_factory=dict)
    units: dict[str, Unit] = field(default_factory=dict)

    def member(self, source: str, where: str) -> str:
        """Return the member that a URI of the SSD names; SspError when it leaves the package."""
        parts = urlsplit(source)
        joined = posixpath.normpath(posixpath.join(self.base, unquote(parts.path)))
        if not self.base or parts.scheme or parts.netloc or parts.query or not is_inside(joined):
            return resolve(source, where)
        return joined

    def define(self, units: dict[str, Unit]) -> None:
        """Add the unit definitions of this SSD to those of the tree."""
        for name, unit in units.items():
            known = self.units.get(name)
            if known is None or (known.exponents, known.factor, known.offset) == (
                unit.exponents, unit.factor, unit.offset,
            ):  # fmt: skip
                self.units[name] = unit
                continue
            alias = f"{name} of {self.prefix}{self.document}"
            self.aliases[name] = alias
            self.units[alias] = Unit(alias, unit.exponents, unit.factor, unit.offset)

    def unit(self, name: str | None) -> str | None:
        """Return the name that a unit of this SSD has in the tree."""
        return None if name is None else self.aliases.get(name, name)

    def units_here(self) -> dict[str, Unit]:
        """Return the unit definitions under the names of this SSD."""
        return {**self.units, **{name: self.units[alias] for name, alias in self.aliases.items()}}

    def inside(self, member: str) -> tuple[Archive, str]:
        """Return a package inside the package, and its prefix."""
        return self.archive.inside(member), f"{self.prefix}{member}{INSIDE}"


@dataclass
class Node:
    """A system, component or signal dictionary reference of the tree. The root has an empty path.

    A component that is a system of its own is a system here: `element` is that system, `scope` its SSD, and
    `outer` the component with the scope in which it stands.
    """

    path: tuple[str, ...]
    kind: str
    connectors: dict[str, Connector]
    element: Any
    scope: Scope
    children: dict[str, Node] = field(default_factory=dict)
    source: str = ""
    implementation: str = "any"
    dictionaries: dict[str, tuple[tuple[str, ...], dict[str, Connector]]] = field(default_factory=dict)
    outer: tuple[Any, Scope] | None = None

    @property
    def label(self) -> str:
        """The dotted name."""
        return ".".join(self.path)

    def places(self, name: str) -> Iterator[tuple[Node, str]]:
        """Yield all that a name means in an element: connectors of systems, and variables of components."""
        if self.kind == "component" or name in self.connectors:
            yield self, name
        for element, child in self.children.items():  # a component has none
            if name.startswith(element + "."):
                yield from child.places(name[len(element) + 1 :])

    def dotted(self, name: str) -> str:
        """Return the dotted name of an element or connector of this node."""
        return ".".join((*self.path, name))


def read_connectors(element: Any, scope: Scope) -> dict[str, Connector]:
    """Read the connectors of an element, by name."""
    connectors: dict[str, Connector] = {}
    for item in element.iterfind("ssd:Connectors/ssd:Connector", NAMESPACES):
        kind = next((c for c in item if c.tag in _TYPES), None)
        sizes = [d.get("size") for d in item.iterfind("ssc:Dimension", NAMESPACES)]
        if kind is not None:
            sizes += [d.get("size") for d in kind.iterfind("ssc:Dimension", NAMESPACES)]
        connectors[item.get("name")] = Connector(
            name=item.get("name"),
            kind=item.get("kind"),
            type=None if kind is None else kind.tag[len(_SSC) :],
            unit=None if kind is None else scope.unit(kind.get("unit")),
            dimensions=tuple(None if size is None else int(size) for size in sizes),
        )
    return connectors


def read_units(element: Any) -> dict[str, Unit]:
    """Read an ``ssd:Units`` or ``ssv:Units`` element (or None)."""
    units: dict[str, Unit] = {}
    for item in () if element is None else element.iterfind("ssc:Unit", NAMESPACES):
        base = item.find("ssc:BaseUnit", NAMESPACES)
        if base is None:
            units[item.get("name")] = Unit(item.get("name"))
            continue
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


def read_transformation(element: Any, where: str) -> Transformation | None:
    """Read the transformation of a connection or a mapping entry.

    Raises
    ------
    SspError
        A mapping with two entries for one source value.
    """
    for item in element:
        tag = item.tag
        if tag == _SSC + "LinearTransformation":
            return Transformation("linear", float(item.get("factor", "1")), float(item.get("offset", "0")))
        for kind, convert in (("Boolean", read_boolean), ("Integer", int), ("Enumeration", str)):
            if tag != f"{_SSC}{kind}MappingTransformation":
                continue
            pairs = [
                (convert(entry.get("source")), convert(entry.get("target")))
                for entry in item.iterfind("ssc:MapEntry", NAMESPACES)
            ]
            sources = [source for source, _ in pairs]
            twice = [str(source) for source in dict.fromkeys(sources) if sources.count(source) > 1]
            if twice:
                raise SspError(f"{where}: the mapping has several entries for {', '.join(twice)}; keep one")
            if kind == "Enumeration":
                return Transformation("enumeration", names={str(a): str(b) for a, b in pairs})
            return Transformation(kind.lower(), table={int(a): int(b) for a, b in pairs})
    return None
