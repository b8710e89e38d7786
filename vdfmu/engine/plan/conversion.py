"""Connections between two variables of FMUs: their transformations, unit conversions and types."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from vdfmu.engine.fmu.variables import FmuVariable
from vdfmu.engine.package.system import Hop, Transformation, UnitFactor


class MisfitError(ValueError):
    """A mismatch of two variables, or of a value; `kind` is type, unit, limit or transformation."""

    def __init__(self, kind: str, text: str) -> None:
        super().__init__(text)
        self.kind = kind


class Conversion(NamedTuple):
    """``target = factor * source + offset``, or a table for booleans and integers; other values pass unchanged.

    The source is first converted to the type of the target.
    """

    factor: float = 1.0
    offset: float = 0.0
    table: Mapping[int, int] | None = None

    @property
    def trivial(self) -> bool:
        """Whether the value passes unchanged."""
        return self.table is None and self.factor == 1.0 and self.offset == 0.0


def between(source: UnitFactor, target: UnitFactor, relative: bool = False) -> tuple[float, float]:
    """Return the factor and offset from one unit to another; MisfitError if they cannot be converted.

    `relative` is FMI's relativeQuantity: a difference, so without offset.
    """
    if source.same_as(target):
        return 1.0, 0.0
    for unit in (source, target):
        if unit.exponents is None or not unit.usable:
            has = "has no unit definition" if unit.exponents is None else "has an unusable factor or offset"
            text = f"unit mismatch, {source.name!r} to {target.name!r}: {unit.name!r} {has}"
            raise MisfitError("unit", text)
    if source.exponents != target.exponents:
        text = f"{source.name!r} ({source.dimension}) to {target.name!r} ({target.dimension})"
        raise MisfitError("unit", f"unit mismatch, {text}")
    offset = 0.0 if relative else (source.offset - target.offset) / target.factor
    return source.factor / target.factor, offset


def compose(
    hops: Sequence[Hop],
    source: UnitFactor | None,
    target: UnitFactor | None,
    kind: str,
    units: Mapping[str, UnitFactor],
    relative: bool = False,
    items: tuple[Mapping[str, int] | None, Mapping[str, int] | None] = (None, None),
) -> Conversion:
    """Compose the hops to a variable of a type, such as ``Real``; MisfitError if type or unit mismatch.

    Each hop first converts the unit, unless this is suppressed or one side has no unit, and then applies the
    transformation (SSP 1.0, GTransformationChoice). A connector of a system without a unit has its source's unit.

    `source` and `target` are the units of the variables, `units` the definitions of the SSD; `relative` is whether the
    target is a relative quantity, `items` are the values by name of both variables if they are enumerations.
    """
    factor, offset = 1.0, 0.0
    table: dict[int, int] | None = None
    here = source
    for index, hop in enumerate(hops):
        last = index == len(hops) - 1
        there = target if last else units.get(hop.unit, UnitFactor(hop.unit)) if hop.unit else here
        if kind == "Real" and here is not None and there is not None and not hop.suppress_unit_conversion:
            f, o = between(here, there, relative)
            factor, offset = f * factor, f * offset + o
        here = here if there is None else there
        transformation = hop.transformation
        if transformation is None:
            continue
        if transformation.kind == "linear":
            if kind != "Real":
                raise MisfitError("transformation", f"a linear transformation does not apply to {kind}")
            factor = transformation.factor * factor
            offset = transformation.factor * offset + transformation.offset
        elif {"boolean": "Boolean", "integer": "Integer"}.get(transformation.kind) == kind or (
            transformation.kind == "integer" and kind == "Enumeration"
        ):
            table = _chain(table, transformation.table)
        elif transformation.kind == "enumeration" and kind == "Enumeration":
            table = _chain(table, _values_of(transformation, *items))
        else:
            raise MisfitError("transformation", f"a {transformation} is not supported for {kind}")
    return Conversion(factor, offset, table)


def _chain(first: Mapping[int, int] | None, then: Mapping[int, int]) -> dict[int, int]:
    """Return one table for two in series; other values pass unchanged."""
    before = first or {}
    return {**then, **{source: then.get(value, value) for source, value in before.items()}}


def _values_of(
    transformation: Transformation, source: Mapping[str, int] | None, target: Mapping[str, int] | None
) -> dict[int, int]:
    """Return the table of a mapping of item names, by the items of both variables; MisfitError for an unknown name."""
    table: dict[int, int] = {}
    for name, meaning in transformation.names.items():
        for which, item, items in (("source", name, source), ("target", meaning, target)):
            if item not in (items or {}):
                there = ", ".join(items or {}) or "none"
                text = f"the mapping names {item!r}, but items of the {which} are {there}"
                raise MisfitError("transformation", text)
        table[(source or {})[name]] = (target or {})[meaning]
    return table


Port = tuple[str, str]
"""Component and variable."""
SOURCE = "(inputs)"
"""Component of the external signals."""


class Link(NamedTuple):
    """A checked connection between two variables. `stepped` is False for links from parameters."""

    start: Port
    end: Port
    source: FmuVariable
    sink: FmuVariable
    conversion: Conversion
    stepped: bool

    @property
    def discrete(self) -> bool:
        """Whether the value changes only at communication points."""
        ends = self.source, self.sink
        return any(v.type != "Real" or v.variability == "discrete" for v in ends)

    @property
    def is_given(self) -> bool:
        """Whether the value comes from a file or the user. Values from other processes have their sources' names."""
        return self.start == (SOURCE, ".".join(self.end))

    def __str__(self) -> str:
        return f"{'.'.join(self.start)} -> {'.'.join(self.end)}"
