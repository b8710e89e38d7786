"""A unit's declared variables as FMI 2.0 scalars for a robot.

FMI names are structured and count from 1, Python indices count from 0; only `Variable.name` converts between them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from vdfmu.base.arrays import element_name
from vdfmu.base.domain import Domain
from vdfmu.base.measure import derivative_of, measure, unit_of
from vdfmu.compiler.unit.base import BaseUnit
from vdfmu.compiler.unit.declaration import (
    JOINTS,
    Attributes,
    Declared,
    Derivative,
    Entry,
    Event,
    Held,
    Input,
    Machine,
    Mode,
    Output,
    Sampled,
    State,
)


@dataclass(frozen=True)
class Variable(Attributes):
    """One scalar variable, with `minimum` and `maximum`."""

    group: str
    """Name without indices, the paper's symbol."""
    index: tuple[int, ...]
    """Indices from 0; empty for a scalar."""
    type: str
    """Real, Integer or Boolean."""
    causality: str
    """input, output or parameter; in native units also local, for derivatives, and independent, for the time."""
    variability: str
    """continuous, discrete, fixed or tunable."""
    unit: str | None
    start: Any
    """Number or bool; None for a calculated output."""
    description: str
    choices: tuple[str, ...] = ()
    """Names of the values 0, 1, .. of an integer."""

    @cached_property
    def name(self) -> str:
        """Structured FMI name, counted from 1: ``q[1]``, ``inertia[1,3,3]``, ``T``, ``der(q[1])``."""
        if self.group.endswith(")"):
            return element_name(self.group[:-1], self.index) + ")"
        return element_name(self.group, self.index)

    @property
    def display_unit(self) -> str | None:
        """First display unit of the unit, if it has any."""
        return next(iter(measure(self.unit).display), None) if self.unit else None

    @cached_property
    def domain(self) -> Domain:
        """Its type and limits."""
        names = {name: value for value, name in enumerate(self.choices)}
        return Domain(self.type, names, self.minimum, self.maximum, self.unit, self.start)

    def problem(self, value: Any) -> str | None:
        """Return the fault of a value, as ``expected .., got ..``; None if it is valid."""
        try:
            self.domain.read(value)
        except ValueError as error:
            return str(error)
        return None


_ORDER = (Input, State, Sampled, Held, Mode, Output, Event)


def scalar_variables(unit: type[BaseUnit], robot: Machine | None) -> list[Variable]:
    """Variables of a unit in the order of their value references.

    The order is inputs, states (continuous, sampled, held), outputs, event indicators, parameters, robot's parameters.
    """
    groups = [d for d in unit.declared_for(robot).values() if not isinstance(d, Derivative)]
    groups.sort(key=lambda d: _ORDER.index(type(d)) if type(d) in _ORDER else len(_ORDER))
    variables = [v for declared in groups for v in _scalars(declared, robot)]
    if unit.robot_fields is not None:
        assert robot is not None
        variables += _robot_parameters(robot, unit.robot_fields)
    return variables


def derivative_variables(unit: type[BaseUnit], robot: Machine | None) -> list[Variable]:
    """Return the derivatives of the continuous states of a unit, in the order of the states."""
    declared = unit.declared_for(robot).values()
    by_state = {d.state: d for d in declared if isinstance(d, Derivative)}
    return [v for state in declared if type(state) is State for v in _scalars(by_state[state], robot)]


def _scalars(declared: Declared, robot: Machine | None) -> Iterator[Variable]:
    start = declared.start_value(robot) if declared.set_by is None else None
    derived = isinstance(declared, Derivative)
    for position, index in enumerate(np.ndindex(declared.sizes(robot.n if robot is not None else 0))):
        joint = robot.joint_types[index[0]] if robot is not None and JOINTS in declared.shape[:1] else "revolute"
        unit = unit_of(declared.unit if isinstance(declared.unit, str) else declared.unit[position], joint)
        yield Variable(
            f"der({declared.state.name})" if derived else declared.name,
            index,
            declared.type,
            declared.causality,
            declared.variability,
            (derivative_of(unit) if derived else unit) if declared.type == "Real" else None,
            None if start is None else start[index].item(),
            _text(declared, position, index),
            declared.choices,
            **declared.attributes(),
        )


def _text(declared: Declared, position: int, index: tuple[int, ...]) -> str:
    """Return the description of an element."""
    if not isinstance(declared.text, str):
        return declared.text[position]
    text = declared.text
    if isinstance(declared, Derivative):
        text = f"derivative of the {text}" if text else f"derivative of {declared.state.name}"
    elif not text:
        return ""
    counted = tuple(i + 1 for i in index)
    if declared.shape[:1] == (JOINTS,):
        text, counted = f"Joint {counted[0]}: {text}", counted[1:]
    else:
        text = text[:1].upper() + text[1:]
    if len(counted) == 2:
        return f"{text}, row {counted[0]}, column {counted[1]}"
    return f"{text} {','.join(map(str, counted))}".rstrip()


def _robot_parameters(robot: Machine, fields: tuple[str, ...]) -> Iterator[Variable]:
    """Parameters of the robot in the order of the parameter vector; with `fields`, the elements of these arrays."""
    for entry in [Entry(field, (i,)) for field in fields for i in range(robot.n)] if fields else robot.entries():
        unit, minimum, maximum, text = robot.facts(entry)
        start = float(getattr(robot, entry.field)[entry.index])
        yield Variable(
            entry.field, entry.index, "Real", "parameter", "fixed", unit, start, text, minimum=minimum, maximum=maximum
        )
