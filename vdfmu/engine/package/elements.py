"""Elements of an SSD before flattening, and readers of parts of SSP files."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from vdfmu.base.errors import SspError
from vdfmu.base.measure import BASE_UNITS
from vdfmu.base.standards import SSP_1
from vdfmu.engine.algorithms import ALGORITHMS, choice
from vdfmu.engine.package.archive import Archive
from vdfmu.engine.package.parse import EXPERIMENT_TYPE, FOREIGN, NAMESPACES, OSP_TYPE, parse_ssp_xml
from vdfmu.engine.package.system import Connector, Experiment, Shape, Transformation, UnitFactor
from vdfmu.engine.rules import Finding, breach, finding, place_of

_SSC = f"{{{NAMESPACES['ssc']}}}"


class Document(NamedTuple):
    """An XML file of SSP: its kind, its root, and its name in messages."""

    kind: str
    root: Any
    where: str


@dataclass
class Scope:
    """An SSD, in which names are looked up."""

    archive: Archive
    """The package that holds the SSD."""
    document: str
    """Name of the SSD in the package."""
    label: str
    """Name of the package in messages."""
    version: str = SSP_1.name
    """SSP version."""
    units: dict[str, UnitFactor] = field(default_factory=dict)
    """The unit definitions of the SSD."""
    files: dict[str, Document] = field(default_factory=dict)
    """All files that have been read, each once."""
    refused: dict[str, SspError] = field(default_factory=dict)
    """Errors of unreadable files, so that such a file is not tried again at each reference to it."""

    def read(self, member: str, kind: str, archive: Archive | None = None) -> Any:
        """Return the root of a file of the package, or of an FMU in it; SspError if it violates the schema."""
        archive = archive or self.archive
        key = f"{archive.label}: {member}"
        if key in self.refused:
            raise SspError(self.refused[key].problems)
        if key not in self.files:
            where, version = f"{self.label}: {member}", None if kind == "ssd" else self.version
            try:
                self.files[key] = Document(kind, parse_ssp_xml(archive.read(member), kind, where, version), where)
            except SspError as error:
                self.refused[key] = error
                raise
        return self.files[key].root


@dataclass
class Node:
    """A system or component of the tree. The root has an empty path."""

    path: tuple[str, ...]
    kind: str
    connectors: dict[str, Connector]
    element: Any
    children: dict[str, Node] = field(default_factory=dict)
    source: str = ""
    implementation: str = "any"
    step: float | None = None

    @property
    def label(self) -> str:
        """The dotted name."""
        return ".".join(self.path)

    def places(self, name: str) -> Iterator[tuple[Node, str]]:
        """Yield everything that a name in an element may mean: connectors of systems, and variables of components."""
        if self.kind == "component" or name in self.connectors:
            yield self, name
        for element, child in self.children.items():
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


def _connector(item: Any) -> Connector:
    """Read a connector."""
    typed = next((c for c in item if c.tag.startswith(_SSC) and c.tag not in _NO_TYPES), None)
    return Connector(
        name=item.get("name"),
        kind=item.get("kind"),
        type=None if typed is None else typed.tag[len(_SSC) :],
        unit=None if typed is None else typed.get("unit"),
        dimensions=(*read_shape(item), *(() if typed is None else read_shape(typed))),
        place=place_of(item),
    )


_NO_TYPES = {_SSC + name for name in ("Dimension", "Annotations", "MetaData", "Signature")}


def read_connectors(element: Any) -> dict[str, Connector]:
    """Read the connectors of an element, by name."""
    items = element.iterfind("ssd:Connectors/ssd:Connector", NAMESPACES)
    return {item.get("name"): _connector(item) for item in items}


def read_shape(item: Any) -> Shape:
    """Return the sizes of an array; an open size is None."""
    sizes = (d.get("size") for d in item.iterfind("ssc:Dimension", NAMESPACES))
    return tuple(None if size is None else int(size) for size in sizes)


def read_units(items: Iterable[Any]) -> dict[str, UnitFactor]:
    """Read the elements ``Unit`` of a file of SSP or FMI; base units have the same attributes in both."""
    units: dict[str, UnitFactor] = {}
    for item in items:
        name, base = item.get("name"), next((c for c in item if c.tag.endswith("BaseUnit")), None)
        units[name] = UnitFactor(name)
        if base is not None:
            exponents = tuple(int(base.get(b, "0")) for b in BASE_UNITS)
            units[name] = UnitFactor(name, exponents, float(base.get("factor", "1")), float(base.get("offset", "0")))
    return units


def read_boolean(text: str | None) -> bool:
    """Read an ``xs:boolean``, false if missing."""
    return text is not None and text.strip() in {"true", "1"}


def read_transformation(element: Any, where: str) -> Transformation | None:
    """Read the transformation of a connection or a mapping entry; SspError if a source value has two entries."""
    for item in element:
        if item.tag == _SSC + "LinearTransformation":
            return Transformation("linear", float(item.get("factor", "1")), float(item.get("offset", "0")))
        for kind, convert in (("Boolean", read_boolean), ("Integer", int), ("Enumeration", str)):
            if item.tag != f"{_SSC}{kind}MappingTransformation":
                continue
            entries = item.iterfind("ssc:MapEntry", NAMESPACES)
            pairs: Any = [(convert(entry.get("source")), convert(entry.get("target"))) for entry in entries]
            counts = Counter(source for source, _ in pairs)
            if twice := [str(source) for source, count in counts.items() if count > 1]:
                text = f"{where}: the mapping has several entries for {', '.join(twice)}; keep one"
                raise breach("SSP036", text, item)
            if kind == "Enumeration":
                return Transformation("enumeration", names=dict(pairs))
            return Transformation(kind.lower(), table={int(a): int(b) for a, b in pairs})
    return None


def read_experiment(root: Any, where: str) -> tuple[Experiment, list[Finding]]:
    """Return the default experiment of an SSD, and its faults."""
    element = root.find("ssd:DefaultExperiment", NAMESPACES)
    if element is None:
        return Experiment(), []
    reader = _NumberReader(element, f"{where}, line {element.sourceline}: default experiment")
    start, stop = (reader.number(element, f"{name}Time") for name in ("start", "stop"))
    if not reader.problems and stop is not None and stop <= (start or 0.0):
        reader.fault(f"expected a stopTime after startTime {start or 0.0:g} s, got {stop:g} s")
    ours, step = reader.step("osp:Algorithm/osp:FixedStepAlgorithm", "baseStepSize")
    algorithm = None if ours is None else ours.get("algorithm")
    adaptive = reader.number(ours, "adaptive", 0.0, 1.0, "a relative error below 1")
    if algorithm is not None and algorithm not in ALGORITHMS:
        reader.fault(f"expected algorithm {', '.join(ALGORITHMS.names())}, got {algorithm!r}")
    elif adaptive is not None and not (algorithm and ALGORITHMS[algorithm].continuous):
        reader.fault(f"adaptive is for {choice(continuous=True)}, not for {algorithm}")
    return Experiment(start, stop, step, algorithm, adaptive), reader.problems


def read_step(component: Any, where: str) -> tuple[float | None, list[Finding]]:
    """Return a component's own step [s], from an annotation of this project or of libcosim, and the faults."""
    reader = _NumberReader(component, where)
    _, step = reader.step("osp:StepSizeHint", "value")
    return step, reader.problems


class _NumberReader:
    """Reads numbers of an element and its annotations, and collects their faults."""

    def __init__(self, element: Any, place: str) -> None:
        self.place = place
        self.problems: list[Finding] = []
        self._element = element

    def fault(self, text: str) -> None:
        self.problems.append(finding("SSP010", f"{self.place}: {text}", self._element))

    def step(self, path: str, key: str) -> tuple[Any, float | None]:
        """Return this project's annotation, and the step [s] in it or else in libcosim's annotation at `path`."""
        hint = self.number(self._content(OSP_TYPE, path), key, 0.0)
        ours = self._content(EXPERIMENT_TYPE, "vdfmu:Experiment")
        step = self.number(ours, "communicationStepSize", 0.0)
        return ours, hint if step is None else step

    def _content(self, kind: str, path: str) -> Any:
        """Return the element at `path` in the annotation of a type, or None."""
        annotations = self._element.iterfind("ssd:Annotations/ssc:Annotation", NAMESPACES)
        elements = (each.find(path, FOREIGN) for each in annotations if each.get("type") == kind)
        return next((element for element in elements if element is not None), None)

    def number(
        self, element: Any, key: str, above: float = -math.inf, below: float = math.inf, quantity: str = "a time in s"
    ) -> float | None:
        """Return a number between two limits; None if it is missing or faulty."""
        text = None if element is None else element.get(key)
        if text is None:
            return None
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if above < value < below:
            return value
        limits = "finite" if above < 0.0 else "positive finite" if below > 1.0 else "positive"
        self.fault(f"expected a {limits} {key}, got {text}; write {quantity} or omit it")
        return None
