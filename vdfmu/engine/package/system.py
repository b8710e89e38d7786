"""The flattened system: components, and connections from component to component."""

from __future__ import annotations

import math
import re
from collections.abc import Hashable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from vdfmu.base.errors import UsageError
from vdfmu.base.measure import BASE_UNITS
from vdfmu.base.standards import SSP_1
from vdfmu.engine.rules import Finding, Place

_DIGITS = 1e-6
"""Relative difference up to which units are equal; survey foot and engineering foot differ by 2e-6."""
Shape = tuple[int | None, ...]
"""Sizes of an array, empty for a scalar; None for an open size."""


class UnitFactor(NamedTuple):
    """A unit: ``value in base units = factor * value + offset``."""

    name: str
    exponents: tuple[int, ...] | None = None
    """Exponents of `BASE_UNITS`; None for a unit that has only a name."""
    factor: float = 1.0
    offset: float = 0.0

    def same_as(self, other: UnitFactor) -> bool:
        """Return whether two units need no conversion, although tools may write factors with only 6 digits."""
        if self.exponents is None or other.exponents is None:
            return self.name == other.name
        pairs = (self.factor, other.factor), (self.offset, other.offset)
        return self.exponents == other.exponents and all(math.isclose(*pair, rel_tol=_DIGITS) for pair in pairs)

    @property
    def usable(self) -> bool:
        """Whether values can be converted to and from it."""
        return math.isfinite(self.factor) and math.isfinite(self.offset) and self.factor != 0.0

    @property
    def dimension(self) -> str:
        """The base units as text, such as ``kg.m2/s2``."""
        if self.exponents is None:
            return "without definition"
        pairs = list(zip(BASE_UNITS, self.exponents, strict=True))
        above = ".".join(f"{b}{e if e > 1 else ''}" for b, e in pairs if e > 0) or "1"
        below = "".join(f"/{b}{-e if e < -1 else ''}" for b, e in pairs if e < 0)
        return above + below


def factor_of(value: Any) -> float | None:
    """Return the factor in the text ``*0.8``; None for any other value. ValueError for a factor without a number."""
    if not isinstance(value, str) or not value.startswith("*"):
        return None
    try:
        return float(value[1:])
    except ValueError:
        raise ValueError(f"expected a number after the star, such as *0.8, got {value}") from None


def spread(value: Any, names: Sequence[str]) -> list[Any]:
    """Return a value for each variable: one scalar for all, or the elements of a list or array in order.

    A text with several numbers is a list: ``0.3,-0.5``, ``[0.3, -0.5]``, ``0.3 -0.5``. ValueError for a wrong number.
    """
    if isinstance(value, str) and len(names) > 1:
        numbers = re.sub(r"[\[\],]", " ", value).split()
        with suppress(ValueError):
            value = numbers if len([float(number) for number in numbers]) > 1 else value
    if not isinstance(value, (list, tuple, np.ndarray)):
        return [value] * len(names)
    values = np.asarray(value, dtype=object).ravel().tolist()
    if len(values) != len(names):
        last = f" to {names[-1]}" if len(names) > 1 else ""
        raise ValueError(f"expected one value, or {len(names)} for {names[0]}{last}, got {len(values)}")
    return values


@dataclass(frozen=True)
class Connector:
    """A connector of an element as the SSD declares it; `type` is None if not stated."""

    name: str
    kind: str
    type: str | None = None
    unit: str | None = None
    dimensions: Shape = ()
    place: Place = field(default=("", 0), compare=False)


@dataclass(frozen=True)
class Transformation:
    """A transformation of SSP 1.0: ``linear`` (factor * x + offset), or a mapping of values.

    Values that are not in a mapping are kept. `names` is the table of an enumeration's items.
    """

    kind: str
    factor: float = 1.0
    offset: float = 0.0
    table: Mapping[int, int] = field(default_factory=dict)
    names: Mapping[str, str] = field(default_factory=dict)

    def __str__(self) -> str:
        return f"{self.kind} transformation"


@dataclass(frozen=True)
class Hop:
    """A connection of the SSD as a part of a flattened connection; its end declares `unit` and `type`."""

    transformation: Transformation | None = None
    suppress_unit_conversion: bool = False
    unit: str | None = None
    type: str | None = None
    place: Place = field(default=("", 0), compare=False)


Index = tuple[int, ...]
"""Indices of an element or a part of an array, from 1; empty for the whole array."""


class Connection(NamedTuple):
    """A connection between connectors of components; `indices` choose parts of arrays at both ends (SSP 2.0)."""

    start: tuple[str, str]
    end: tuple[str, str]
    hops: tuple[Hop, ...]
    indices: tuple[Index, Index] = ((), ())

    def __str__(self) -> str:
        return f"{'.'.join(self.start)} -> {'.'.join(self.end)}"


Value = float | int | bool | str | bytes
"""Value of a variable of any type."""


@dataclass(frozen=True)
class BoundParameter:
    """A value, from a parameter binding, of a component's variable."""

    component: str
    name: str
    value: Value | tuple[Value, ...]
    type: str
    """Type in the parameter set: ``Real``, ``Integer``, ``Boolean``, ``String``, ``Enumeration``, ``Float64`` ..."""
    unit: UnitFactor | None
    """The unit of the value."""
    hops: tuple[Hop, ...]
    """The mapping and the connections from the set to the variable, each with a conversion of units."""
    origin: str
    """Parameter set and the name in it, for messages."""
    place: Place = field(default=("", 0), compare=False)
    dimensions: Shape = ()
    elsewhere: tuple[tuple[str, str], ...] = ()
    """Other elements and variables or connectors that the same name may mean, because names may contain dots; at least
    one of all must exist."""


@dataclass(frozen=True)
class Component:
    """A component; a nested component is named ``system.component``, or ``system.component#2`` if that name is taken.

    `source` is the member of the package, or empty if the FMU is missing, which is then a problem of the system.
    `overruled` are values that `parameters` override. `step` [s], None by default, is its own step, a multiple of the
    communication step.
    """

    name: str
    source: str
    implementation: str
    connectors: Mapping[str, Connector]
    parameters: tuple[BoundParameter, ...] = ()
    overruled: tuple[BoundParameter, ...] = ()
    step: float | None = None
    place: Place = field(default=("", 0), compare=False)


class Experiment(NamedTuple):
    """Default settings of a run; None if the SSD does not state them."""

    start: float | None = None
    """Simulated time [s], like the stop."""
    stop: float | None = None
    step: float | None = None
    """Communication step [s], from an annotation of this project or of libcosim."""
    algorithm: str | None = None
    """Master algorithm, from an annotation of this project."""
    adaptive: float | None = None
    """Largest relative error of a coupled signal in a step, for `algorithm`."""


@dataclass(frozen=True)
class FlatSystem:
    """A flattened system."""

    path: Path
    """The package."""
    name: str
    components: tuple[Component, ...]
    """In the order of the SSD."""
    connections: tuple[Connection, ...]
    """From component to component, through nested systems and system connectors."""
    units: Mapping[str, UnitFactor]
    """The unit definitions of the SSD."""
    experiment: Experiment = field(default_factory=Experiment)
    problems: tuple[Finding, ...] = ()
    """Faults of the wiring, and of reading with `vdfmu.engine.package.read.read_system`.
    `vdfmu.engine.plan.check` reports them together with faults of the FMUs."""
    unmatched: tuple[Finding, ...] = ()
    """Parameters of system-level bindings without a matching element or connector."""
    notes: tuple[Finding, ...] = ()
    """Parameters without effect, components with equal dotted names."""
    faults: tuple[Finding, ...] = ()
    """Breaches of rules that do not prevent a run."""
    version: str = SSP_1.name
    inspected: dict[Hashable, Any] = field(default_factory=dict[Hashable, Any], repr=False, compare=False)
    """Cache of `vdfmu.engine.plan.checker`: descriptions of the FMUs."""

    def component(self, name: str) -> Component:
        """Return a component by its name."""
        return {component.name: component for component in self.components}[name]


Ends = str | Sequence[str]
Connections = Mapping[str, Ends] | Iterable[tuple[str, Ends]]
"""``component.output`` to one or several ``component.input``; without an index, whole vectors."""


def ends_of(connections: Any) -> list[tuple[str, str]]:
    """Return pairs of an output and an input; UsageError if they are not texts."""
    items = connections.items() if isinstance(connections, Mapping) else connections
    try:
        ends = [(start, end) for start, listed in items for end in ([listed] if isinstance(listed, str) else listed)]
    except (TypeError, ValueError):
        ends = [(connections, None)]
    for start, end in ends:
        if not (isinstance(start, str) and isinstance(end, str)):
            got = f"{start!r:.60}" + (f" -> {end!r:.60}" if end is not None else "")
            raise UsageError(f"connections: expected 'component.output' to one or several inputs, got {got}.")
    return ends
