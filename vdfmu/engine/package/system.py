"""The system as the master sees it: components, and connections from component to component."""

from __future__ import annotations

import math
import re
from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from vdfmu.base.standards import SSP_1
from vdfmu.engine.package.experiment import Experiment
from vdfmu.engine.rules import Finding, Place

_DIGITS = 1e-6
"""Relative difference of units that are the same; the feet of survey and of engineering differ by 2e-6."""
Shape = tuple[int | None, ...]
"""Sizes of an array, none for a scalar; None for a size that is open."""
BASE_UNITS = ("kg", "m", "s", "A", "K", "mol", "cd", "rad")


@dataclass(frozen=True)
class UnitFactor:
    """A unit: ``value in base units = factor * value + offset``."""

    name: str
    exponents: tuple[int, ...] | None = None
    """Exponents of `BASE_UNITS`; None where the unit has a name only."""
    factor: float = 1.0
    offset: float = 0.0

    def same_as(self, other: UnitFactor) -> bool:
        """Whether no conversion lies between two units; tools write their factors with 6 digits or more."""
        if self.exponents is None or other.exponents is None:
            return self.name == other.name
        return (
            self.exponents == other.exponents
            and math.isclose(self.factor, other.factor, rel_tol=_DIGITS)
            and math.isclose(self.offset, other.offset, rel_tol=_DIGITS)
        )

    @property
    def usable(self) -> bool:
        """Whether it can be converted to and from."""
        return math.isfinite(self.factor) and math.isfinite(self.offset) and self.factor != 0.0

    @property
    def dimension(self) -> str:
        """The base units in words, such as ``kg.m2/s2``."""
        if self.exponents is None:
            return "without definition"
        pairs = list(zip(BASE_UNITS, self.exponents, strict=True))
        above = ".".join(f"{b}{e if e > 1 else ''}" for b, e in pairs if e > 0) or "1"
        below = "".join(f"/{b}{-e if e < -1 else ''}" for b, e in pairs if e < 0)
        return above + below


def spread(value: Any, names: Sequence[str]) -> list[Any]:
    """Return a value for each of some variables: one value is for all, a list or array has one for each, in order.

    A text of several numbers is a list: ``0.3,-0.5``, ``[0.3, -0.5]``, ``0.3 -0.5``. ValueError if their number differs
    from that of the variables.
    """
    if isinstance(value, str) and len(names) > 1:
        numbers = re.sub(r"[\[\],]", " ", value).split()
        if len(numbers) > 1 and all(map(_is_number, numbers)):
            value = numbers
    if not isinstance(value, (list, tuple, np.ndarray)):
        return [value] * len(names)
    values = np.asarray(value, dtype=object).ravel().tolist()
    if len(values) != len(names):
        last = f" to {names[-1]}" if len(names) > 1 else ""
        raise ValueError(f"expected one value, or {len(names)} for {names[0]}{last}, got {len(values)}")
    return values


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


@dataclass(frozen=True)
class Connector:
    """A connector of an element as the SSD declares it; `type` is None when it does not say."""

    name: str
    kind: str
    type: str | None = None
    unit: str | None = None
    dimensions: Shape = ()
    place: Place = field(default=("", 0), compare=False)


@dataclass(frozen=True)
class Transformation:
    """A transformation of SSP 1.0: ``linear`` (factor * x + offset), or a mapping of values.

    Values that a mapping does not mention are kept. `names` is the table of an enumeration's items.
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
    """One connection of the SSD on the way of a flattened connection."""

    transformation: Transformation | None = None
    suppress_unit_conversion: bool = False
    unit: str | None = None
    """Declared by the connector at the end of the hop; so is the type."""
    type: str | None = None
    place: Place = field(default=("", 0), compare=False)


Index = tuple[int, ...]
"""Indices of an element or a part of an array, from 1; empty for the whole."""


@dataclass(frozen=True)
class Connection:
    """A connection from a component's connector to another component's, with the hops between them.

    `indices` choose the parts of arrays at its start and its end (SSP 2.0).
    """

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
    """A value that a parameter binding gives to a variable of a component."""

    component: str
    name: str
    value: Value | tuple[Value, ...]
    type: str
    """In the parameter set: ``Real``, ``Integer``, ``Boolean``, ``String``, ``Enumeration``, ``Float64`` ..."""
    unit: UnitFactor | None
    """The unit of the value."""
    hops: tuple[Hop, ...]
    """Mapping and connections the value passes; units are converted at each."""
    origin: str
    """The parameter set and the name in it, for messages."""
    place: Place = field(default=("", 0), compare=False)
    dimensions: Shape = ()
    """Sizes of an array."""
    elsewhere: tuple[tuple[str, str], ...] = ()
    """Other components with variables, or systems with connectors, that the same name of a system's parameter set
    means, since dots may be part of names. It is enough that one of all exists."""


@dataclass(frozen=True)
class Component:
    """A component; nested ones are named ``system.component``, and ``system.component#2`` where that is taken.

    `step` [s] is a multiple of the communication step in which it is stepped, None for the communication step.
    `overruled` are values that others in `parameters` replace.
    `source` is the member of the package, ``inner.ssp!/member`` where a package inside it holds the FMU; empty
    where the FMU is missing. The system's `problems` then say so.
    """

    name: str
    source: str
    implementation: str
    connectors: Mapping[str, Connector]
    parameters: tuple[BoundParameter, ...] = ()
    overruled: tuple[BoundParameter, ...] = ()
    step: float | None = None
    place: Place = field(default=("", 0), compare=False)


@dataclass(frozen=True)
class FlatSystem:
    """A flattened system."""

    path: Path
    """The package."""
    name: str
    components: tuple[Component, ...]
    """In the order of the SSD."""
    connections: tuple[Connection, ...]
    """Component to component; nested systems and system connectors are resolved."""
    units: Mapping[str, UnitFactor]
    """The unit definitions of the SSD."""
    experiment: Experiment = field(default_factory=Experiment)
    """How it is run unless told otherwise."""
    problems: tuple[Finding, ...] = ()
    """Faults of the wiring, and with `vdfmu.engine.package.read.read_system` of the reading.
    `vdfmu.engine.plan.check` reports them together with faults of the FMUs."""
    unmatched: tuple[Finding, ...] = ()
    """Parameters of system-level bindings that name no element or connector."""
    notes: tuple[Finding, ...] = ()
    """Notes, not errors: parameters without effect, components with one dotted name."""
    faults: tuple[Finding, ...] = ()
    """Breaches of rules that do not keep it from being run."""
    version: str = SSP_1.name
    """SSP version."""
    inspected: dict[Hashable, Any] = field(default_factory=dict[Hashable, Any], repr=False, compare=False)
    """What `vdfmu.engine.plan.checker` has read of the FMUs."""

    def component(self, name: str) -> Component:
        """Return a component by its name."""
        for component in self.components:
            if component.name == name:
                return component
        raise KeyError(name)
