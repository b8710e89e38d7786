"""Signals from outside, checked and connected to inputs: they are outputs of a source beside the components."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from vdfmu.base.errors import UsageError
from vdfmu.base.measure import BASE_UNITS, coherent, measure
from vdfmu.base.text import close_to
from vdfmu.engine.fmu.description import Description
from vdfmu.engine.fmu.variables import FmuVariable
from vdfmu.engine.package.system import UnitFactor
from vdfmu.engine.plan.conversion import SOURCE, Conversion, Link, Port, between
from vdfmu.engine.plan.inputs import Course, InputTable


class Fed(NamedTuple):
    """Signals of one FMI type, with their names as outputs of the source."""

    kind: str
    names: tuple[str, ...]
    course: Course


class Feed(NamedTuple):
    """The source's signals, its description for the schedule and the exchange, its connections, and notes."""

    courses: tuple[Fed, ...]
    description: Description
    links: tuple[Link, ...]
    notes: tuple[str, ...]


def feed_inputs(
    tables: Sequence[InputTable],
    descriptions: Mapping[str, Description],
    links: Sequence[Link],
    unit_of: Callable[[Port, FmuVariable], UnitFactor | None],
    units: Mapping[str, UnitFactor],
) -> tuple[Feed | None, list[str]]:
    """Connect columns of tables to the inputs of their names; None without tables. Also return all problems.

    `links` are the connections of the system, `unit_of` returns the unit of an input, `units` are the definitions of
    the SSD.
    """
    if not tables:
        return None, []
    connected = {link.end: ".".join(link.start) for link in links}
    variables = {
        f"{component}.{variable.name}": (component, variable)
        for component, description in descriptions.items()
        for variable in description.variables.values()
    }
    free = [name for name, (unit, v) in variables.items() if v.causality == "input" and (unit, v.name) not in connected]
    problems: list[str] = []
    notes: list[str] = []
    made: dict[str, tuple[FmuVariable, Link]] = {}
    courses: list[Fed] = []
    for table in tables:
        groups: dict[tuple[str, bool], list[int]] = {}
        left = 0
        for i, (name, unit) in enumerate(zip(table.names, table.units, strict=True)):
            if not table.chosen and name not in free:
                left += 1
                continue
            where = f"{table.where}: {name}"
            if name not in free:
                problems.append(f"{where}: {_why_not(name, variables, connected, free)}")
                continue
            if name in made:
                problems.append(f"{where}: is given twice; give each input one signal")
                continue
            component, sink = variables[name]
            port = component, sink.name
            try:
                conversion = _conversion(unit, unit_of(port, sink), sink, units)
                _check_values(table.values[:, i], sink, conversion)
            except (ValueError, UsageError) as error:
                problems.append(f"{where}: {error}")
                continue
            held = table.held or sink.type != "Real" or sink.variability == "discrete"
            source = dataclasses.replace(
                sink, name=name, causality="output", initial="exact", variability="discrete" if held else "continuous"
            )
            made[name] = source, Link((SOURCE, name), port, source, sink, conversion, stepped=True)
            groups.setdefault((sink.kind, held), []).append(i)
        elements = [name for name in variables if table.group and name.startswith(f"{table.group}[")]
        if not {*elements} <= {*table.names}:
            problems.append(f"{table.where}: expected {len(elements)} columns, a value for each of {elements[0]} to "
                            f"{elements[-1]}, got {len(table.names)}")  # fmt: skip
        for (kind, held), columns in groups.items():
            course = Course(table.t, table.values[:, columns], held)
            courses.append(Fed(kind, tuple(table.names[i] for i in columns), course))
        if left == len(table.names):
            problems.append(f"{table.where}: no column names an input that nothing is connected to{_list(free)}")
        elif left:
            notes.append(f"{table.where}: {len(table.names) - left} columns feed inputs; {left} name no free one")
    sources = {name: source for name, (source, _) in made.items()}
    none: dict[str, frozenset[str] | None] = dict.fromkeys(sources, frozenset())
    description = Description("", "", "", False, sources, none, none)
    return Feed(tuple(courses), description, tuple(link for _, link in made.values()), tuple(notes)), problems


def _why_not(
    name: str, variables: Mapping[str, tuple[str, FmuVariable]], connected: Mapping[Port, str], free: Sequence[str]
) -> str:
    if name not in variables:
        return "no component has such an input" + (close_to(name, free) or _list(free))
    component, variable = variables[name]
    if variable.causality != "input":
        return f"expected an input, got a variable of causality {variable.causality}{_list(free)}"
    return f"expected an input that nothing is connected to; {connected[component, variable.name]} feeds it"


def _list(free: Sequence[str]) -> str:
    more = f" and {len(free) - 8} more" if len(free) > 8 else ""
    return f". Free inputs: {', '.join(free[:8]) or 'none'}{more}"


def _conversion(name: str, target: UnitFactor | None, sink: FmuVariable, units: Mapping[str, UnitFactor]) -> Conversion:
    """Return the conversion from a unit of measurement by its name; an empty name means the input's unit."""
    if not name or (target is not None and target.name == name):
        return Conversion()
    unit = units.get(name)
    if unit is None:
        base_name, factor = coherent(name)
        exponents = measure(base_name).exponents
        unit = UnitFactor(name, tuple(exponents.get(base, 0) for base in BASE_UNITS), factor)
    if sink.type != "Real":
        raise ValueError(f"expected no unit of measurement for a variable of type {sink.type}, got {name!r}")
    return Conversion(*between(unit, target, sink.relative)) if target is not None else Conversion()


def _check_values(values: np.ndarray, sink: FmuVariable, conversion: Conversion) -> None:
    if sink.type == "String":
        raise ValueError("text cannot be given as a signal; set a value")
    allowed = values == (values != 0.0) if sink.type == "Boolean" else values == np.rint(values)
    if sink.type != "Real" and not allowed.all():
        expected = "0 or 1" if sink.type == "Boolean" else "whole numbers"
        raise ValueError(f"expected {expected} for a variable of type {sink.type}, got {values[np.argmin(allowed)]:g}")
    for value in (values.min(), values.max()):
        if fault := sink.domain.fault(float(conversion.factor * value + conversion.offset)):
            raise ValueError(fault)
