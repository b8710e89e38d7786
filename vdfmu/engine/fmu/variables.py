"""The variables of an FMU, from its model description."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from fmpy.model_description import ModelDescription

from vdfmu.base.arrays import element_name
from vdfmu.base.domain import Domain
from vdfmu.base.standards import MASTER_VERSIONS
from vdfmu.engine.package.system import UnitFactor, Value

INTEGERS = tuple(f"{sign}Int{bits}" for sign in ("", "U") for bits in (8, 16, 32, 64))
"""Integer types of FMI 3.0; numpy's have the same names in lower case."""
RANGES = {"Integer": (-(2**31), 2**31 - 1)} | {
    name: (int(np.iinfo(name.lower()).min), min(int(np.iinfo(name.lower()).max), 2**63 - 1)) for name in INTEGERS
}
"""Smallest and largest value of integer types; UInt64 is limited by the master."""
_TYPES = {"Float32": "Real", "Float64": "Real", **dict.fromkeys(INTEGERS, "Integer")}
"""Types of FMI 3.0 that the master treats as a type of FMI 2.0."""


def type_of(name: str) -> str:
    """Return the master's name of a type of FMI 2.0 or 3.0: floats of any length are Real, integers Integer."""
    return _TYPES.get(name, name)


_WIDER = {"Boolean": ("Integer", "Real"), "Enumeration": ("Integer", "Real"), "Integer": ("Real",)}
"""Types of sources to the other types that hold all of their values. SSP leaves conversions to the implementation."""
CONVERT_TYPE = (
    "Booleans and enumerations may also feed integers and reals, integers may feed reals; for other types put a "
    "component between them that converts the value"
)
"""Fix for types that do not convert."""


def feeds(source: str, sink: str) -> bool:
    """Whether a source of a type may feed a sink of a type of FMI or SSP: no value may be lost."""
    start, end = type_of(source), type_of(sink)
    return start == end or end in _WIDER.get(start, ())


class Clock(NamedTuple):
    """A clock of FMI 3.0: variability of its interval, its interval (NaN if not declared) and its first tick [s]."""

    variability: str
    interval: float
    shift: float

    @property
    def triggered(self) -> bool:
        """Whether it ticks at events of components."""
        return self.variability == "triggered"

    @property
    def asked(self) -> bool:
        """Whether the component determines the interval."""
        return self.variability in ("calculated", "tunable", "changing", "countdown")


def _read_clock(element: Any) -> Clock:
    def seconds(decimal: str, counter: str, default: float) -> float:
        if element.get(counter) is not None and element.get("resolution") is not None:
            return int(element.get(counter)) / int(element.get("resolution"))
        return float(element.get(decimal, default))

    return Clock(
        element.get("intervalVariability"),
        seconds("intervalDecimal", "intervalCounter", math.nan),
        seconds("shiftDecimal", "shiftCounter", 0.0),
    )


@dataclass(frozen=True)
class FmuVariable:
    """A scalar variable of an FMU, or an element of an array of FMI 3.0.

    `type` is Real, Integer, Enumeration, Boolean, String or Binary, `native` the type in the names of its functions,
    `items` the items of an enumeration or of a unit's choice, `nominal` its nominal value if stated, `limits` the
    smallest and the largest value. `index` is its position among the `length` elements of the array, row by row.
    `reference` is its value reference, `clocks` are those of its clocks. `clock` has the properties of a clock.
    """

    name: str
    reference: int
    type: str
    causality: str
    variability: str
    initial: str | None
    unit: UnitFactor | None = None
    relative: bool = False
    items: Mapping[str, int] | None = None
    nominal: float | None = None
    limits: tuple[float, float] = (-math.inf, math.inf)
    native: str = ""
    index: int = 0
    length: int = 1
    start: Value = 0
    clocks: tuple[int, ...] = ()
    clock: Clock | None = None

    @property
    def kind(self) -> str:
        """Its type in the master: Real, Integer (enumerations too), Boolean, String or Binary."""
        return "Integer" if self.type == "Enumeration" else self.type

    @property
    def declared(self) -> str:
        """The type that the FMU states."""
        return self.type if self.type == "Enumeration" else self.native

    @cached_property
    def domain(self) -> Domain:
        """Its type and limits; an integer is also limited by its number of bits."""
        low, high = self.limits
        if self.type == "Integer":
            least, most = RANGES[self.native]
            low, high = max(least, low), min(most, high)
        return Domain(self.type, self.items, low, high, self.unit.name if self.unit else None, self.start)

    @property
    def size(self) -> float:
        """The nominal value, 1 by default (FMI)."""
        return self.nominal or 1.0

    @property
    def settable(self) -> bool:
        """Whether FMI allows the value to be set before initialization mode."""
        return self.causality == "input" or (self.variability != "constant" and self.initial in {"exact", "approx"})


def _limits_of(variable: Any) -> tuple[float, float]:
    """Return the limits of fmpy's variable, or of its type; infinite if neither can be read."""
    limits = [-math.inf, math.inf]
    for k, name in enumerate(("min", "max")):
        text = getattr(variable, name)
        text = getattr(variable.declaredType, name, None) if text is None else text
        with suppress(ValueError):  # reported by the check of the unit
            limits[k] = limits[k] if text is None else float(text)
    return limits[0], limits[1]


def element_names(name: str, shape: Sequence[int] | None) -> list[str]:
    """Return the names of the elements of a variable, row by row, counted from 1; for a scalar its name."""
    return [element_name(name, index) for index in np.ndindex(*(shape or ()))]


def read_variables(
    model: ModelDescription,
    relative: set[str],
    units: Mapping[str, UnitFactor],
    clocks: Mapping[str, Any],
    names: Mapping[str, Mapping[str, int]],
) -> dict[str, FmuVariable]:
    """Return the variables of fmpy's description by name, arrays as their elements.

    `relative` contains the names of relative quantities, `clocks` the elements of clocks by variable, and `names` the
    names of integers' values by variable.
    """
    version = MASTER_VERSIONS[str(model.fmiVersion)]
    variables: dict[str, FmuVariable] = {}
    for v in model.modelVariables:
        declared = v.declaredType
        unit = v.unit or (declared.unit if declared is not None else None)
        elements = element_names(v.name, v.shape)
        items = {str(i.name): int(str(i.value)) for i in declared.items} if declared is not None else None
        nominals = _elements(v.nominal or (declared.nominal if declared is not None else None), len(elements))
        for index, (name, start, nominal) in enumerate(zip(elements, start_values(v), nominals, strict=True)):
            variables[name] = FmuVariable(
                name,
                v.valueReference,
                type_of(v.type),
                v.causality,
                v.variability,
                v.initial,
                unit=units.get(unit, UnitFactor(unit)) if unit else None,
                relative=v.name in relative or bool(declared is not None and declared.relativeQuantity),
                items=items or names.get(name),
                nominal=abs(float(nominal or 0)) or None,
                limits=_limits_of(v),
                native=version.enumeration if v.type == "Enumeration" else v.type,
                index=index,
                length=len(elements),
                start=start,
                clocks=tuple(each.valueReference for each in v.clocks or ()),  # pyright: ignore[reportAttributeAccessIssue]
                clock=_read_clock(clocks[name]) if name in clocks else None,
            )
    return variables


def _elements(text: str | None, length: int) -> list[str | None]:
    """Return the text of each element, from an array's text or from one text for all."""
    parts: list[str | None] = [None] if text is None else [*text.split()]
    return parts if len(parts) == length else [parts[0] if parts else None] * length


def start_values(variable: Any) -> list[Value]:
    """Return the start values of the elements of fmpy's variable; 0 if unreadable, as the check of the unit reports."""
    kind, text, length = type_of(variable.type), variable.start, math.prod(variable.shape or ())
    if kind in ("String", "Binary"):
        return [bytes.fromhex(text or "") if kind == "Binary" else text or ""] * length
    starts: list[Value] = []
    read = float if kind == "Real" else int  # an integer may have more digits than a float
    for part in _elements(text, length):
        try:
            starts.append(part in ("true", "1") if kind == "Boolean" else read(part or 0))
        except ValueError:
            starts.append(read(0))
    return starts
