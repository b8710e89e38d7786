"""Rules of SSP 2.0 for arrays and units, beyond the schema."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from vdfmu.engine.cosim.conversion import between
from vdfmu.engine.cosim.description import limit_fault, limits_of
from vdfmu.engine.ssp.elements import Node
from vdfmu.engine.ssp.parse import NAMESPACES
from vdfmu.engine.ssp.structure import BASE_UNITS, Connector, Unit
from vdfmu.engine.ssp.wiring import FLOWS, Key, Wiring

__all__ = [
    "ArrayWiring",
    "Shape",
    "connector_unit_faults",
    "dimension_faults",
    "fmu_units",
    "parameter_faults",
    "shape_of",
    "show_shape",
    "unit_faults",
]

Shape = tuple[int | None, ...]
_NUMBERS = {
    "Real", "Integer", "Boolean", "Float64", "Float32", *(f"{u}Int{n}" for u in ("", "U") for n in (8, 16, 32, 64)),
}  # fmt: skip
"""Types of parameters whose attribute ``value`` is a list."""


_INTEGERS = {"Integer", *(f"{u}Int{n}" for u in ("", "U") for n in (8, 16, 32, 64))}
_FLOATS = {"Real", "Float64", "Float32"}
_FITTING = {**dict.fromkeys(_FLOATS, _FLOATS | _INTEGERS), **dict.fromkeys(_INTEGERS, _INTEGERS),
            "Enumeration": {"Enumeration"} | _INTEGERS}  # fmt: skip
"""Types of variables to the types of parameters that can set them; others take their own."""


def _flows() -> set[tuple[str, str]]:
    """Return the table "Allowed connections" of SSP 2.0; a connector of kind unspecified is of any kind."""
    flows = FLOWS | {
        ("system structuralParameter", sink)
        for sink in (
            "system calculatedParameter", "system output", "system local", "structuralParameter", "parameter", "input",
            "inout",
        )
    }  # fmt: skip
    flows |= {("system parameter", "system local"), ("system input", "system local")}
    flows |= {("local", sink) for sink in ("input", "inout", "system output", "system local")}
    flows |= {(source, "system local") for source in ("calculatedParameter", "output", "inout")}
    flows |= {
        ("constant", sink)
        for sink in (
            "structuralParameter", "parameter", "input", "inout", "system constant", "system calculatedParameter",
            "system output", "system local",
        )
    }  # fmt: skip

    def wild(kind: str) -> str:
        return "system unspecified" if kind.startswith("system ") else "unspecified"

    for source, sink in list(flows):
        flows |= {(wild(source), sink), (source, wild(sink)), (wild(source), wild(sink))}
    return flows


class ArrayWiring(Wiring):
    """The wiring of SSP 2.0, where several connections may feed one array, each of them other elements of it."""

    flows = _flows()

    def __init__(self, top: Node) -> None:
        self._parts: dict[Key, set[tuple[str, ...]]] = {}
        super().__init__(top)

    def _connect(self, node: Node, item: Any) -> None:
        parts: list[tuple[Key, tuple[str, ...]]] = []
        for end in ("start", "end"):
            indices = tuple((item.get(f"{end}Indices") or "").split())
            owner = _owner(node, item, end)
            if indices and owner is not None:
                key: Key = owner.path, item.get(f"{end}Connector")
                parts.append((key, indices))
                if key in self._parts and indices not in self._parts[key]:
                    self._source_of.pop(key, None)
        super()._connect(node, item)
        for key, indices in parts:
            self._parts.setdefault(key, set()).add(indices)


def _owner(node: Node, item: Any, end: str) -> Node | None:
    """Return the element at one end of a connection; None where there is none, which the wiring reports."""
    name = item.get(f"{end}Element") or None
    return node if name is None else node.children.get(name)


def dimension_faults(top: Node, variables: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """Return the connections whose ends differ in size, or whose indices lie outside.

    Parameters
    ----------
    top : Node
    variables : mapping of str to mapping of str to variable
        The variables of the FMUs, by the dotted names of the components.
    """
    problems: list[str] = []
    for item in top.element.iterfind("ssd:Connections/ssd:Connection", NAMESPACES):
        shapes: list[Shape] = []
        names: list[str] = []
        faults: list[str] = []
        for end in ("start", "end"):
            owner, name = _owner(top, item, end), item.get(f"{end}Connector")
            if owner is None or name not in owner.connectors:
                break  # reported by the wiring
            names.append(owner.dotted(name))
            variable = variables.get(owner.label, {}).get(name) if owner.kind == "component" else None
            shape = owner.connectors[name].dimensions if variable is None else shape_of(variable)
            indices = [int(i) for i in (item.get(f"{end}Indices") or "").split()]
            if len(indices) > len(shape):
                faults.append(f"{end}Indices: {len(indices)} for {names[-1]}, which is {show_shape(shape)}")
            faults += [
                f"{end}Indices: {index} is outside of {names[-1]}, {show_shape(shape)}; the first index is 1"
                for index, size in zip(indices, shape, strict=False)
                if index < 1 or (size is not None and index > size)
            ]
            shapes.append(shape[len(indices) :])
        if len(shapes) < 2:
            continue
        if not faults and not _fit(*shapes):
            faults = [f"dimension mismatch, {show_shape(shapes[0])} to {show_shape(shapes[1])}"]
        problems += [f"connection {' -> '.join(names)}: {fault}" for fault in faults]
    for child in top.children.values():
        if child.kind == "system":
            problems += dimension_faults(child, variables)
    return problems


def _fit(one: Shape, other: Shape) -> bool:
    """Tell whether two shapes can be the same; an open size fits every one."""
    return len(one) == len(other) and all(
        a is None or b is None or a == b for a, b in zip(one, other, strict=True)
    )


def shape_of(variable: Any) -> Shape:
    """Return the sizes of a variable; None for one that a parameter sets, as far as it has no start value."""
    sizes: list[int | None] = []
    for dimension in variable.dimensions or ():
        text = dimension.start
        if text is None and dimension.variable is not None:
            text = dimension.variable.start
        try:
            sizes.append(None if text is None else int(text))
        except ValueError:  # reported by the check of the unit
            sizes.append(None)
    return tuple(sizes)


def show_shape(shape: Shape) -> str:
    """Return a shape in words."""
    sizes = " x ".join("?" if size is None else str(size) for size in shape)
    return f"an array of {sizes}" if shape else "a scalar"


def fmu_units(description: Any) -> dict[str, Unit]:
    """Return the unit definitions of an FMU."""
    units: dict[str, Unit] = {}
    for item in description.unitDefinitions or ():
        base = item.baseUnit
        if base is None:
            units[item.name] = Unit(item.name)
        else:
            exponents = tuple(int(getattr(base, name) or 0) for name in BASE_UNITS)
            units[item.name] = Unit(item.name, exponents, float(base.factor), float(base.offset))
    return units


def unit_faults(units: Mapping[str, Unit]) -> list[str]:
    """Return the units with which nothing can be converted."""
    return [
        f"unit {name!r}: factor {unit.factor:g} and offset {unit.offset:g}; expected finite numbers, "
        "and a factor other than 0"
        for name, unit in units.items()
        if not (math.isfinite(unit.factor) and math.isfinite(unit.offset) and unit.factor != 0.0)
    ]


def connector_unit_faults(
    connector: Connector, units: Mapping[str, Unit], declared: Unit | None
) -> list[str]:
    """Return what is wrong with the unit of a connector, given that of the FMU's variable."""
    if not connector.unit:
        return []
    unit = units.get(connector.unit)
    if unit is None:
        return [f"the SSD has no definition of unit {connector.unit!r}"]
    if declared is None or unit.same_as(declared):
        return []
    return [f"unit mismatch, the SSD declares {_full(unit)}, the FMU {_full(declared)}"]


def _full(unit: Unit) -> str:
    if unit.exponents is None:
        return f"{unit.name!r} (without definition)"
    factor = f", factor {unit.factor!r}" if unit.factor != 1.0 else ""
    offset = f", offset {unit.offset!r}" if unit.offset != 0.0 else ""
    return f"{unit.name!r} ({unit.dimension}{factor}{offset})"


def parameter_faults(
    item: Any, units: Mapping[str, Unit], variable: Any = None, declared: Unit | None = None
) -> list[str]:
    """Return what is wrong with a parameter of a set.

    Parameters
    ----------
    item : element
        ``ssv:Parameter``.
    units : mapping of str to Unit
        Unit definitions that it may name.
    variable : optional
        The variable of the FMU that takes the value as it is.
    declared : Unit, optional
        The unit of the variable.
    """
    value = next((c for c in item if c.tag.startswith(f"{{{NAMESPACES['ssv']}}}")), None)
    if value is None:
        return ["has no value"]
    kind = value.tag.rsplit("}", 1)[1]
    faults = [] if variable is None else _setting_faults(kind, variable)
    if kind not in _NUMBERS:
        return faults
    sizes: Shape = tuple(
        None if d.get("size") is None else int(d.get("size"))
        for d in item.iterfind("ssc:Dimension", NAMESPACES)
    )
    texts = str(value.get("value") or "").split()
    count = len(texts)
    if None not in sizes and math.prod(s or 0 for s in sizes) != count:
        faults.append(f"{count} value(s) for {show_shape(sizes)}")
    elif variable is not None and not _fit(sizes, shape_of(variable)):
        faults.append(f"is {show_shape(sizes)}, the FMU declares {show_shape(shape_of(variable))}")
    name = value.get("unit")
    unit = units.get(name) if name else None
    if name and unit is None:
        faults.append(f"there is no definition of unit {name!r}")
    if unit is not None and declared is not None:
        pair = unit.exponents, declared.exponents
        if None not in pair and pair[0] != pair[1]:  # what differs in factor and offset is converted
            faults.append(f"unit mismatch, the value is in {_full(unit)}, the FMU declares {_full(declared)}")
    if variable is not None and not faults and kind != "Boolean":
        faults += _limit_faults(texts, variable, unit, declared)
    return faults


def _limit_faults(texts: list[str], variable: Any, unit: Unit | None, declared: Unit | None) -> list[str]:
    """Return which values lie outside of the limits of a variable, as far as they can be converted."""
    relative = variable.relativeQuantity or getattr(variable.declaredType, "relativeQuantity", False)
    factor, offset = 1.0, 0.0
    try:
        values = [float(text) for text in texts]
        if unit is not None and declared is not None:
            factor, offset = between(unit, declared, bool(relative))
    except (ValueError, ZeroDivisionError):  # reported with the types and units
        return []
    found = [limit_fault(factor * value + offset, limits_of(variable)) for value in values]
    return [fault for fault in dict.fromkeys(found) if fault]


def _setting_faults(kind: str, variable: Any) -> list[str]:
    """Return why a variable cannot be set, or not by a value of a type."""
    faults: list[str] = []
    if variable.variability == "constant" or variable.initial not in ("exact", "approx"):
        faults.append(
            f"{variable.name!r} is not settable: causality {variable.causality}, variability {variable.variability}, "
            f"initial {variable.initial}"
        )
    if kind not in _FITTING.get(variable.type, {variable.type}):
        faults.append(f"type mismatch, {kind} for a variable of type {variable.type}")
    return faults
