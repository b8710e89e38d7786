"""A unit's methods on its memory, as traced functions or in plain numpy."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import cached_property, partial
from typing import Any

import numpy as np

from vdfmu.base.arrays import Floats
from vdfmu.compiler.functions.traced import KernelFunction
from vdfmu.compiler.unit.declaration import PHASES, Choice, Declared, Derivative, Switch, constant
from vdfmu.compiler.unit.interface import Interface
from vdfmu.compiler.unit.program import Call
from vdfmu.compiler.unit.trace import argument_name, run
from vdfmu.compiler.unit.values import Values

Conditions = list[tuple[Floats, float]]
"""Choices in the memory of a unit, and the values with which something holds."""


def holds(conditions: Conditions) -> bool:
    """Whether the choices have these values."""
    return all(choice[0] == value for choice, value in conditions)


class Evaluation:
    """The methods of a unit, which read and set its memory in place.

    Parameters
    ----------
    interface : Interface
    memory : (interface.size,) array, optional
        Default the start values.

    Attributes
    ----------
    start, outputs, derivatives, update : callable
        Set the states of the start time, the outputs, the derivatives of the continuous states, the sampled states.
    """

    start: Callable[[], None]
    outputs: Callable[[], None]
    derivatives: Callable[[], None]
    update: Callable[[], None]

    def __init__(self, interface: Interface, memory: Floats | None = None) -> None:
        self.interface = interface
        self.memory = memory = interface.memory_of({}) if memory is None else memory
        self.x, self.x_dot = memory[interface.states], memory[interface.derivatives]

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
        """Whether the derivatives switch by time, as far as that is traced."""
        return self.interface.unit.backend == "native" and bool(self.interface.program.left)

    def left(self, t: float) -> float:
        """Return the time [s] until the derivatives switch by time, with the inputs held; inf where they do not."""
        self.memory[-1] = t
        found = math.inf
        for conditions, function in self._left:
            if holds(conditions):
                function.run()
                found = float(function.results["left"][0])
        return found

    @cached_property
    def _left(self) -> list[tuple[Conditions, KernelFunction]]:
        calls = self.interface.program.left if self.switches else ()
        return [(self.conditions(call), self.bound(call.function)) for call in calls]

    def bound(self, name: str, **buffers: Floats) -> KernelFunction:
        """Return a function of the step or the time left on the memory, with rates of 0."""
        functions = self.interface.functions
        names = [n for n in functions.casadi_function(name).name_in() if n[:5] != "rate_" and n not in buffers]
        return functions.function(name, **{n: self.argument(n) for n in names}, **buffers)

    def conditions(self, call: Call) -> Conditions:
        """Return the choices of the unit for which a call is, in place, and their values."""
        return [(self.argument(argument_name(choice)), float(value)) for choice, value in call.when]

    def takes(self, call: Call) -> bool:
        """Whether the values of the unit's choices are those for which a call is."""
        return holds(self.conditions(call))


class Traced(Evaluation):
    """The traced functions, bound to the memory: a call copies nothing."""

    def __init__(self, interface: Interface, memory: Floats | None = None) -> None:
        super().__init__(interface, memory)
        program = interface.program
        self.start, self.outputs = self._bound(program.start), self._bound(program.outputs)
        self.derivatives, self.update = self._bound(program.derivatives), self._bound(program.update)

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
            return lambda: bound.run()  # keeps `bound`, whose buffers it needs

        def run_chosen() -> None:
            if holds(conditions):
                bound.run()
                for target, source in copies:
                    target[:] = source

        return run_chosen


class Plain(Evaluation, Values):
    """The methods themselves, in numpy, on the memory as their values."""

    def __init__(self, interface: Interface, memory: Floats | None = None) -> None:
        super().__init__(interface, memory)
        unit = self.unit = interface.unit(interface.robot)
        self._robot: tuple[bytes, Any] = (b"", None)
        self.start, self.outputs, self.derivatives, self.update = (partial(run, unit, phase, self) for phase in PHASES)
        self.experiment = partial(run, unit, "experiment", self)
        """Set the inputs of the reference experiment."""
        self.requirements = partial(run, unit, "requirements", self)
        """Return what the unit requires of its parameters."""

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
    """Return what runs a unit: traced, unless it says that it cannot be."""
    return (Plain if interface.unit.backend == "python" else Traced)(interface, memory)
