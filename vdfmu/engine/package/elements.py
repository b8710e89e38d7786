"""The elements of an SSD before flattening, and the parts that several files share."""

from __future__ import annotations

import posixpath
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any, NamedTuple
from urllib.parse import unquote, urlsplit

from vdfmu.base.standards import SSP_1
from vdfmu.engine.package.archive import INSIDE, Archive, is_inside, resolve
from vdfmu.engine.package.parse import NAMESPACES, parse_ssp_xml
from vdfmu.engine.package.system import BASE_UNITS, Connector, Shape, Transformation, UnitFactor
from vdfmu.engine.rules import breach, place_of

_SSC = f"{{{NAMESPACES['ssc']}}}"


class Document(NamedTuple):
    """An XML file of SSP: its kind, its root, and its name in messages."""

    kind: str
    root: Any
    where: str


@dataclass(frozen=True)
class Scope:
    """Where the names of one SSD are looked up."""

    archive: Archive
    """The package that holds the SSD."""
    prefix: str
    """Prefix that leads from the outermost package to it, such as ``resources/arm.ssp!/``."""
    base: str
    """Folder of the SSD in the package; relative URIs start there."""
    document: str
    """Name of the SSD in its package."""
    label: str
    """Name of the package in messages."""
    version: str = SSP_1.name
    """SSP version."""
    aliases: dict[str, str] = field(default_factory=dict)
    """Names of units that another SSD of the tree defines otherwise, and the names they have here instead."""
    units: dict[str, UnitFactor] = field(default_factory=dict)
    """All unit definitions of the tree; shared by its scopes."""
    files: dict[str, Document] = field(default_factory=dict)
    """All files that were read, each once; shared."""

    def member(self, source: str, where: str, at: Any = ("", 0)) -> str:
        """Return the member that a URI of the SSD names; SspError when it leaves the package."""
        parts = urlsplit(source)
        joined = posixpath.normpath(posixpath.join(self.base, unquote(parts.path)))
        if not self.base or parts.scheme or parts.netloc or parts.query or not is_inside(joined):
            return resolve(source, where, at)
        return joined

    def read(self, member: str, kind: str, archive: Archive | None = None) -> Any:
        """Return the root of a file of the package, or of an FMU in it; SspError if the schema refuses it."""
        archive = archive or self.archive
        key = f"{self.prefix}{archive.label}{INSIDE}{member}"
        if key not in self.files:
            where = f"{self.label}: {member}"
            version = None if kind == "ssd" else self.version
            root = parse_ssp_xml(archive.read(member), kind, where, version)
            self.files[key] = Document(kind, root, where)
        return self.files[key].root

    def define(self, root: Any, kind: str = "ssd") -> None:
        """Add the unit definitions of an SSD, or of a signal dictionary, to the tree's."""
        for name, unit in read_units(root.iterfind(f"{kind}:Units/ssc:Unit", NAMESPACES)).items():
            known = self.units.get(name)
            if known is None or (known.exponents, known.factor, known.offset) == (
                unit.exponents, unit.factor, unit.offset,
            ):  # fmt: skip
                self.units[name] = unit
                continue
            alias = f"{name} of {self.prefix}{self.document}"
            self.aliases[name] = alias
            self.units[alias] = UnitFactor(alias, unit.exponents, unit.factor, unit.offset)

    def unit(self, name: str | None) -> str | None:
        """Return the name that a unit of this SSD has in the tree."""
        return None if name is None else self.aliases.get(name, name)

    def units_here(self) -> dict[str, UnitFactor]:
        """Return the unit definitions under the names of this SSD."""
        return {**self.units, **{name: self.units[alias] for name, alias in self.aliases.items()}}

    def inside(self, member: str) -> tuple[Archive, str]:
        """Return a package inside the package, and its prefix."""
        return self.archive.inside(member), f"{self.prefix}{member}{INSIDE}"


@dataclass
class Node:
    """A system, component or signal dictionary reference of the tree. The root has an empty path.

    A component that is a system of its own is a system here: `element` is that system, `scope` its SSD, and
    `outer` the component with the scope that contains it.
    """

    path: tuple[str, ...]
    kind: str
    connectors: dict[str, Connector]
    element: Any
    scope: Scope
    children: dict[str, Node] = field(default_factory=dict)
    source: str = ""
    implementation: str = "any"
    step: float | None = None
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

    def components(self) -> Iterator[Node]:
        """Yield the components below, in the order of the SSD."""
        for child in self.children.values():
            if child.kind == "component":
                yield child
            yield from child.components()


def read_connector(item: Any, kind: str, scope: Scope) -> Connector:
    """Read a connector, or an entry of a signal dictionary."""
    typed = next((c for c in item if c.tag.startswith(_SSC) and c.tag not in _NO_TYPES), None)
    return Connector(
        name=item.get("name"),
        kind=kind,
        type=None if typed is None else typed.tag[len(_SSC) :],
        unit=None if typed is None else scope.unit(typed.get("unit")),
        dimensions=(*read_shape(item), *(() if typed is None else read_shape(typed))),
        place=place_of(item),
    )


_NO_TYPES = {_SSC + name for name in ("Dimension", "Annotations", "MetaData", "Signature")}


def read_connectors(element: Any, scope: Scope) -> dict[str, Connector]:
    """Read the connectors of an element, by name."""
    items = element.iterfind("ssd:Connectors/ssd:Connector", NAMESPACES)
    return {item.get("name"): read_connector(item, item.get("kind"), scope) for item in items}


def read_shape(item: Any) -> Shape:
    """Return the sizes of an array; None for one that the file leaves open."""
    sizes = (d.get("size") for d in item.iterfind("ssc:Dimension", NAMESPACES))
    return tuple(None if size is None else int(size) for size in sizes)


def read_units(items: Iterable[Any]) -> dict[str, UnitFactor]:
    """Read the elements ``Unit`` of a file of SSP or FMI, whose base units have the same attributes."""
    units: dict[str, UnitFactor] = {}
    for item in items:
        base = next((c for c in item if c.tag.endswith("BaseUnit")), None)
        units[item.get("name")] = (
            UnitFactor(item.get("name"))
            if base is None
            else UnitFactor(
                item.get("name"),
                tuple(int(base.get(b, "0")) for b in BASE_UNITS),
                float(base.get("factor", "1")),
                float(base.get("offset", "0")),
            )
        )
    return units


def read_boolean(text: str | None) -> bool:
    """Read an ``xs:boolean``; a missing one is false."""
    return text is not None and text.strip() in {"true", "1"}


def read_transformation(element: Any, where: str) -> Transformation | None:
    """Read the transformation of a connection or a mapping entry; SspError for two entries for one source value."""
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
                text = f"{where}: the mapping has several entries for {', '.join(twice)}; keep one"
                raise breach("SSP036", text, item)
            if kind == "Enumeration":
                return Transformation("enumeration", names={str(a): str(b) for a, b in pairs})
            return Transformation(kind.lower(), table={int(a): int(b) for a, b in pairs})
    return None
