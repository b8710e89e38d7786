"""Evaluates a unit on its memory: methods as traced functions or in numpy, linear model, conditions on parameters."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from functools import cached_property, partial
from typing import Any

import casadi as ca
import numpy as np

from vdfmu.base.arrays import Floats
from vdfmu.base.errors import UnitError, UsageError
from vdfmu.base.state_space import StateSpace
from vdfmu.compiler.functions.traced import KernelFunction, traced_function
from vdfmu.compiler.scalar.symbol import to_sx
from vdfmu.compiler.unit.base import BaseUnit, Values
from vdfmu.compiler.unit.declaration import (
    PHASES,
    STRICT,
    Choice,
    Declared,
    Derivative,
    Entry,
    Machine,
    Requirement,
    Switch,
    constant,
)
from vdfmu.compiler.unit.interface import Interface
from vdfmu.compiler.unit.place import place
from vdfmu.compiler.unit.trace import Call, Symbols, argument_name, run

Conditions = list[tuple[Floats, float]]
"""Choices in the memory of a unit, and the values that they must have."""


def holds(conditions: Conditions) -> bool:
    """Return whether the choices have these values."""
    return all(choice[0] == value for choice, value in conditions)


class Evaluation:
    """The methods of a unit, which read and set its `memory` in place; by default it has the start values."""

    start: Callable[[], None]
    """Set the states at the start time."""
    outputs: Callable[[], None]
    derivatives: Callable[[], None]
    """Set the derivatives of the continuous states."""
    update: Callable[[], None]
    """Set the sampled states."""
    events: Callable[[], None]
    """Set the event indicators, `levels`."""
    at_events: list[Callable[[], None]]
    """Set the states at each event."""

    def __init__(self, interface: Interface, memory: Floats | None = None) -> None:
        self.interface = interface
        self.memory = memory = interface.memory_of({}) if memory is None else memory
        self.x, self.x_dot = memory[interface.states], memory[interface.derivatives]
        self.levels = memory[interface.events]

    def place(self, t: float, x: Floats) -> None:
        """Set the time [s] and the continuous states (n_x,)."""
        self.memory[-1] = t
        self.x[:] = x

    def group(self, name: str) -> Floats:
        """Values of a group, in place."""
        return self.memory[self.interface.groups[name]]

    def argument(self, name: str) -> Floats:
        """Values of an argument of traced functions, in place."""
        return self.memory[self.interface.arguments[name]]

    def rate(self, t: float, x: Floats) -> Floats:
        """Return the derivatives at a time and a state, (n_x,), for a solver."""
        self.memory[-1] = t
        self.x[:] = x
        self.derivatives()
        return self.x_dot.copy()

    @property
    def switches(self) -> bool:
        """Whether the derivatives switch by time, as far as the trace shows it."""
        return self.interface.unit.backend == "native" and bool(self.interface.program.left)

    def left(self, t: float) -> float:
        """Return the time [s] until the derivatives switch by time, with held inputs; inf if they never do."""
        self.memory[-1] = t
        left = math.inf
        for conditions, function in self._left:
            if holds(conditions):
                function.run()
                left = float(function.results["left"][0])
        return left

    @cached_property
    def _left(self) -> list[tuple[Conditions, KernelFunction]]:
        calls = self.interface.program.left if self.switches else ()
        return [(self.conditions(call), self.bound(call.function)) for call in calls]

    def bound(self, name: str, **buffers: Floats) -> KernelFunction:
        """Return the function of the step or of the time left, bound to the memory, with rates of 0."""
        functions = self.interface.functions
        names = [n for n in functions.casadi_function(name).name_in() if n[:5] != "rate_" and n not in buffers]
        return functions.function(name, **{n: self.argument(n) for n in names}, **buffers)

    def conditions(self, call: Call) -> Conditions:
        """Return the choices to which a call applies, in place, and their values."""
        return [(self.argument(argument_name(choice)), float(value)) for choice, value in call.when]

    def takes(self, call: Call) -> bool:
        """Return whether a call applies to the present values of the unit's choices."""
        return holds(self.conditions(call))


class Traced(Evaluation):
    """The traced functions, bound to the memory: a call copies nothing."""

    def __init__(self, interface: Interface, memory: Floats | None = None) -> None:
        super().__init__(interface, memory)
        for phase in PHASES:
            setattr(self, phase, self._bound(getattr(interface.program, phase)))
        self.events = self._bound(interface.program.events)
        self.at_events = [self._bound(calls) for calls in interface.program.at_events.values()]

    def _bound(self, calls: Sequence[Call]) -> Callable[[], None]:
        actions = [self._action(call) for call in calls]
        if len(actions) == 1:
            return actions[0]

        def run_all() -> None:
            for action in actions:
                action()

        return run_all

    def _action(self, call: Call) -> Callable[[], None]:
        functions = self.interface.functions
        function = functions.casadi_function(call.function)
        names = (*function.name_in(), *function.name_out())
        new = [name for name in function.name_out() if call.group(name) != name]
        bound = functions.function(
            call.function, **{name: self.argument(call.group(name)) for name in names if name not in new}
        )
        copies = [(self.argument(call.group(name)), bound.results[name]) for name in new]
        conditions = self.conditions(call)
        if not conditions and not copies:
            return lambda: bound.run()  # keeps a reference to `bound`, whose buffers it needs

        def run_chosen() -> None:
            if holds(conditions):
                bound.run()
                for target, source in copies:
                    target[:] = source

        return run_chosen


class Plain(Evaluation, Values):
    """The methods themselves, in numpy, with the memory as their values."""

    def __init__(self, interface: Interface, memory: Floats | None = None) -> None:
        super().__init__(interface, memory)
        unit = self.unit = interface.unit(interface.robot)
        self._robot: tuple[bytes, Any] = (b"", None)
        self.start, self._outputs, self.derivatives, self.update = (partial(run, unit, phase, self) for phase in PHASES)
        self.events = partial(run, unit, "events", self)
        self.at_events = [partial(run, unit, name, self) for name in unit.event_methods(interface.robot)]
        self.experiment = partial(run, unit, "experiment", self)
        self.requirements = partial(run, unit, "requirements", self)

    def outputs(self) -> None:
        """Set the outputs and the event indicators."""
        self._outputs()
        if self.at_events:
            self.events()

    def read(self, declared: Declared) -> Any:
        """Return the value of a variable."""
        place = self._place(declared)
        if isinstance(declared, (Choice, Switch)):
            value = int(place[0])
            return declared.choices[value] if declared.choices else bool(value)
        shape = declared.sizes(self.unit.n)
        return constant(place.reshape(shape), shape) if shape else float(place[0])

    def write(self, declared: Declared, value: Any) -> None:
        """Set a variable."""
        self._place(declared)[:] = np.ravel(self.unit.fitting(declared, value))

    def _place(self, declared: Declared) -> Floats:
        state = declared.state if isinstance(declared, Derivative) else declared
        place = self.interface.groups[state.name]
        shift = self.interface.derivatives.start - self.interface.states.start if state is not declared else 0
        return self.memory[place.start + shift : place.stop + shift]

    def time(self) -> float:
        """Return the time [s]."""
        return float(self.memory[-1])

    def robot(self, fields: tuple[str, ...]) -> Any:
        """Return the robot with the parameters in the memory."""
        robot = self.interface.robot
        assert robot is not None
        values = self.argument("p") if not fields else np.concatenate([self.group(field) for field in fields])
        key = values.tobytes()
        if self._robot[0] != key:
            parameters = {field: self.group(field) for field in fields}
            self._robot = key, robot.with_parameters(**parameters) if fields else robot.with_values(values)
        return self._robot[1]


def evaluation(interface: Interface, memory: Floats | None = None) -> Evaluation:
    """Return the evaluation of a unit: traced, unless its backend is Python."""
    return (Plain if interface.unit.backend == "python" else Traced)(interface, memory)


def state_space(
    unit: Evaluation, inputs: Sequence[str] | None = None, outputs: Sequence[str] | None = None
) -> StateSpace:
    """Linearise a unit exactly at the values in its memory; UsageError if it is not traced.

    `inputs` and `outputs` are groups whose columns and rows are concatenated; the default is all, with the states first
    among the outputs.
    """
    table = unit.interface
    if not isinstance(unit, Traced):
        raise UsageError(f"{table.unit.__name__} is not traced and has no derivatives.")
    inputs = list(table.groups_of("input")) if inputs is None else inputs
    outputs = list(table.groups_of("output")) if outputs is None else outputs
    J = _jacobian(unit, ["x", *map(argument_name, inputs)])
    places = np.arange(table.size)
    x, x_dot = places[table.states], places[table.derivatives]
    J[x, x] = 1.0  # for outputs that are states
    u, y = (np.concatenate([x[:0], *(places[table.groups[g]] for g in gs)]) for gs in (inputs, outputs))
    signals = (
        [(table.memory[i].name, table.memory[i].unit or "1", float(unit.memory[i])) for i in part] for part in (x, u, y)
    )
    model = StateSpace.of(J[np.ix_(np.concatenate([x_dot, y]), np.concatenate([x, u]))], *signals)
    still = ", ".join(dict.fromkeys(v.group for v in table if v.variability == "discrete"))
    kind = "sampled" if table.is_sampled else "held"
    return replace(model, notes=(f"{kind} states are assumed to be constant: {still}",)) if still else model


def _jacobian(unit: Evaluation, names: Sequence[str]) -> Floats:
    """Return derivatives of outputs and rates with respect to some arguments at the present choices, (size, size)."""
    table, functions = unit.interface, unit.interface.functions
    J = np.zeros((table.size, table.size))
    for call in filter(unit.takes, (*table.program.derivatives, *table.program.outputs)):
        function = functions.casadi_function(call.function)
        arguments = {name: unit.argument(name) for name in function.name_in()}
        product = functions.function(f"{call.function}_forward", **arguments)
        for name in (name for name in names if name in arguments):
            direction = product.args[f"d_{name}"]
            for column, i in enumerate(range(table.size)[table.arguments[name]]):
                direction[:] = 0.0
                direction[column] = 1.0
                product.run()
                for result in function.name_out():
                    J[table.arguments[result], i] = product.results[f"d_{result}"]
            direction[:] = 0.0
    return J


def unmet(interface: Interface, memory: Floats) -> list[str]:
    """Return an error, worded as in native FMUs, for each condition that the parameters in a unit's memory violate."""
    checked: list[tuple[Requirement, float]] = []
    if interface.has_robot and interface.robot is not None:
        requirements = interface.robot.requirements()
        robot = interface.robot.with_values(memory[interface.arguments["p"]])
        checked += zip(requirements, margins(robot, requirements), strict=True)
    if interface.unit.requirements is not BaseUnit.requirements:
        checked += _with_margins(interface, Plain(interface, memory).requirements())
    problems: list[str] = []
    for requirement, margin in checked:
        if not margin >= 0.0:
            places = [interface.reference[parameter.name] for parameter in requirement.parameters]
            variables = [interface.memory[i] for i in places]
            got = (
                f"{v.name} = {memory[i]:.9g}{f' {v.unit}' if v.unit != '1' else ''}"
                for v, i in zip(variables, places, strict=True)
            )
            problems.append(f"{variables[0].name}: expected {requirement.expected}, got {', '.join(got)}.")
    return problems


def margins(machine: Any, requirements: Collection[Requirement]) -> list[Any]:
    """Return the margin of each condition, of floats or symbols; a condition holds if its margin is >= 0."""
    return [each.margin(machine, each.parameters[0]) for each in requirements if each.margin is not None]


def traced_margins(machine: Machine) -> list[ca.Function]:
    """Return the function ``margins`` of the parameter vector to the result of `margins`; empty without conditions."""
    requirements = machine.requirements()
    if not requirements:
        return []
    symbols, p = machine.symbolic()
    return [traced_function("margins", {"p": p}, {"margin": to_sx(margins(symbols, requirements))})]


def traced_requirements(interface: Interface) -> tuple[list[Requirement], ca.Function | None]:
    """Return the conditions of a unit, and the function from its groups to their margins, as in :func:`margins`."""
    if interface.unit.requirements is BaseUnit.requirements:
        return [], None
    unit = interface.unit(interface.robot)
    record = Symbols(unit, "requirements", {})
    checked = _with_margins(interface, run(unit, "requirements", record))
    sizes = ca.vertcat(*(to_sx(margin) for _, margin in checked))
    inputs = {name: record.symbols[name] for name in record.reads}
    function = traced_function(f"{interface.name}_requirements", inputs, {"margin": sizes})
    return [requirement for requirement, _ in checked], function


def _with_margins(interface: Interface, returned: Any) -> list[tuple[Requirement, Any]]:
    """Return conditions with their margins; UnitError if the method returned something else."""
    if not isinstance(returned, Mapping):
        raise _wrong_type(interface, repr(returned))
    pairs: list[tuple[Requirement, Any]] = []
    for key, value in returned.items():
        match value:
            case (str() as expected, size) if np.ndim(size) == 0:
                pass
            case _:
                raise _wrong_type(interface, f"{key!r}: {value!r}")
        entries: list[Entry] = []
        for group in key if isinstance(key, tuple) else (key,):
            members = interface.memory[interface.groups.get(group, slice(0))]
            indices = [v.index for v in members if v.causality == "parameter"]
            if not indices:
                raise _wrong_type(interface, f"{group!r}, which is not a parameter")
            entries += [Entry(group, index) for index in indices]
        pairs.append((Requirement(expected, tuple(entries)), size - STRICT))
    return pairs


def _wrong_type(interface: Interface, got: str) -> UnitError:
    unit = interface.unit
    return UnitError(
        f"{place(unit, 'requirements')}: requirements() of {unit.__name__}: expected a parameter's name to its "
        f'condition and one number, such as {{"k": ("k > 0", self.k)}}, got {got}.'
    )
