"""The variables of a unit for one robot, and their positions in its memory.

FMI 2.0 has scalars, whose positions are their value references. FMI 3.0 has arrays of similar elements.
"""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Iterator, Mapping
from functools import cached_property
from itertools import groupby
from typing import Any, NamedTuple

import numpy as np

from vdfmu.base.cache import cached_per_command
from vdfmu.base.errors import UnitError, UsageError
from vdfmu.compiler.unit.base import BaseUnit, unit_name
from vdfmu.compiler.unit.declaration import Declared, Event, Machine, Sampled
from vdfmu.compiler.unit.declaration_check import check_unit
from vdfmu.compiler.unit.dependencies import Pattern, patterns
from vdfmu.compiler.unit.program import Program, UnitFunctions
from vdfmu.compiler.unit.trace import argument_name
from vdfmu.compiler.unit.variable import Variable, derivative_variables, scalar_variables

_TIME = Variable("time", (), "Real", "independent", "continuous", "s", None, "Time of the simulation")


class Array(NamedTuple):
    """One variable of FMI 3."""

    name: str
    """The group of an array, ``q``; the structured name of a scalar, ``offset[2,1]``."""
    first: int
    """Position of the first element, and the value reference in FMI 3."""
    shape: tuple[int, ...]
    """Shape, empty for a scalar. The elements are in row-major order."""

    @property
    def size(self) -> int:
        """Number of elements."""
        return math.prod(self.shape)

    @property
    def positions(self) -> slice:
        """Positions of the elements."""
        return slice(self.first, self.first + self.size)


class Interface:
    """Variables of a unit in the order of their value references, 0, 1, ..., and its memory.

    The memory holds the variables, the derivatives of the continuous states, and the time. A group's variables are
    adjacent, so its values are a slice of the memory. Iteration is over the variables. Raises one UsageError for all
    wrong start values, and UnitError for a wrong declaration, or joints without a robot.

    `start` are start values by variable that replace declared ones. A unit without joints needs no `robot`.

    Attributes
    ----------
    variables, memory : tuples of Variable
        The variables, and the meaning of each position in the memory.
    size, time : int
        Length of the memory, and position of the time, the last.
    states, derivatives, sampled : slice
        Positions of the continuous states, of their derivatives in the same order, and of the sampled states.
    events : slice
        Positions of the event indicators.
    has_states, is_sampled, has_exchange, has_robot : bool
        Whether the unit has continuous states, sampled states, model exchange in a native FMU, and all run-time
        parameters of the robot.
    """

    def __init__(self, unit: type[BaseUnit], robot: Machine | None, start: Mapping[str, float] | None = None) -> None:
        self.unit, self.robot = unit, robot
        self.name, self.model_name, self.description = unit_name(unit), unit.__name__, unit.description()
        self.joints, self.has_robot = robot.n if robot is not None else 0, unit.robot_fields == ()
        self.variables, derivatives = _declared(unit, robot)
        if start:
            self.variables = self._started(start)
        N, n_x = len(self.variables), len(derivatives)
        first = next((i for i, v in enumerate(self.variables) if v.causality == "output"), N)
        self.states = slice(first, first + n_x) if n_x else slice(N, N)
        self.derivatives = slice(N, N + n_x)
        self.memory = (*self.variables, *derivatives, _TIME)
        self.size, self.time = len(self.memory), N + n_x
        self.has_states, self.has_exchange = n_x > 0, n_x > 0 or unit.exchange
        self.sampled, self.events = self._declared_as(Sampled), self._declared_as(Event)
        self.is_sampled = self.sampled.stop > 0
        self.implementation = "ModelExchange" if unit.exchange else "CoSimulation"  # kind of component in SSP

    def _declared_as(self, kind: type[Declared]) -> slice:
        """Return the positions of the variables declared as a kind, which are adjacent."""
        places = [i for i, v in enumerate(self) if isinstance(self.unit.declared.get(v.group), kind)]
        return slice(places[0], places[-1] + 1) if places else slice(0, 0)

    def _started(self, start: Mapping[str, float]) -> tuple[Variable, ...]:
        variables = list(self.variables)
        problems: list[str] = []
        for name, value in start.items():
            variable = self.find(name)
            if variable.causality == "output":
                problems.append(f"{name} is an output without a start value.")
                continue
            try:
                variables[self.reference[name]] = dataclasses.replace(variable, start=variable.domain.read(value))
            except ValueError as error:
                problems.append(f"{name}: {error}.")
        if problems:
            raise UsageError(f"start values of {self.name}: {' '.join(problems)}")
        return tuple(variables)

    def __iter__(self) -> Iterator[Variable]:
        return iter(self.variables)

    def __len__(self) -> int:
        return len(self.variables)

    @cached_property
    def functions(self) -> UnitFunctions:
        """Traced functions of the unit."""
        return _functions(self.unit, self.robot)

    @cached_property
    def program(self) -> Program:
        """The program of the unit."""
        return Program(self.functions)

    @cached_property
    def reference(self) -> dict[str, int]:
        """Name to value reference."""
        return {v.name: i for i, v in enumerate(self.variables)}

    @cached_property
    def groups(self) -> dict[str, slice]:
        """Group to its slice of value references, in order."""
        slices: dict[str, slice] = {}
        for i, v in enumerate(self.variables):
            slices[v.group] = slice(slices[v.group].start if v.group in slices else i, i + 1)
        return slices

    def groups_of(self, *causalities: str) -> dict[str, slice]:
        """Return the :attr:`groups` of some causalities: input, output, parameter."""
        return {g: where for g, where in self.groups.items() if self.memory[where.start].causality in causalities}

    @cached_property
    def arguments(self) -> dict[str, slice]:
        """Arguments of traced functions to their positions: groups, ``p`` of a robot, ``x``, ``x_dot`` and ``t``."""
        slices = {argument_name(group): where for group, where in self.groups.items()}
        if self.robot is not None and self.has_robot:
            slices["p"] = slice(len(self) - len(self.robot.entries()), len(self))
        return slices | {"x": self.states, "x_dot": self.derivatives, "t": slice(self.time, self.size)}

    def find(self, name: str) -> Variable:
        """Return the variable of a name. UsageError that lists similar names for an unknown name."""
        if name in self.reference:
            return self.variables[self.reference[name]]
        group = name.split("[")[0]
        near = [v.name for v in self if v.group == group] or list(self.groups)
        raise UsageError(f"{self.name} has no variable {name!r}. There are: {', '.join(near)}.")

    def start_values(self) -> np.ndarray:
        """Return start values in the order of the value references; outputs are 0 until they are calculated."""
        return np.array([0.0 if v.start is None else float(v.start) for v in self])

    def memory_of(self, values: Mapping[str, Any]) -> np.ndarray:
        """Return the memory with the start values, except for variables in `values`."""
        memory = np.zeros(self.size)
        memory[: len(self)] = self.start_values()
        for name, value in values.items():
            memory[self.reference[name]] = float(value)
        return memory

    def step_dependencies(self, position: int) -> list[int]:
        """Return the positions on which an output or derivative depends after initialization: inputs, states, time.

        See :func:`~vdfmu.compiler.unit.dependencies.patterns`.
        """
        return np.flatnonzero(self.patterns[0][position]).tolist()

    def held_dependencies(self, position: int) -> list[int]:
        """Return the :meth:`step_dependencies` while sampled states are held."""
        return np.flatnonzero(self.patterns[2][position]).tolist()

    def start_dependencies(self, position: int) -> list[int]:
        """Return the positions on which it depends during initialization: inputs, parameters, time."""
        return np.flatnonzero(self.patterns[1][position]).tolist()

    @cached_property
    def patterns(self) -> tuple[Pattern, Pattern, Pattern]:
        """See :func:`~vdfmu.compiler.unit.dependencies.patterns`."""
        return patterns(self)

    @cached_property
    def arrays(self) -> tuple[Array, ...]:
        """Variables of FMI 3 in the order of their positions.

        A group is an array if it is complete and its elements differ only in start value and description. Other groups
        are scalars: parameters of a robot of which some are folded, and groups with several units, such as ``F_e`` or
        ``q`` of an arm with revolute and prismatic joints, because an array of FMI 3 has one unit.
        """
        arrays: list[Array] = []
        for group, members in groupby(enumerate(self.memory), lambda item: item[1].group):
            positions, variables = zip(*members, strict=True)
            shape = self._shape(group, variables)
            if shape:
                arrays.append(Array(group, positions[0], shape))
            else:
                arrays += [Array(v.name, i, ()) for i, v in zip(positions, variables, strict=True)]
        return tuple(arrays)

    def _shape(self, group: str, variables: tuple[Variable, ...]) -> tuple[int, ...]:
        """Return the shape of a group as an array; empty for scalars."""
        if group not in self.unit.declared and hasattr(self.robot, group):
            shape = np.shape(getattr(self.robot, group))
        else:
            shape = tuple(max(axis) + 1 for axis in zip(*(v.index for v in variables), strict=True))
        kinds = {dataclasses.replace(v, index=(), start=None, description="") for v in variables}
        whole = [v.index for v in variables] == list(np.ndindex(shape))
        return shape if whole and len(kinds) == 1 else ()

    @cached_property
    def owners(self) -> tuple[int, ...]:
        """Position to the index in :attr:`arrays` of its variable."""
        return tuple(i for i, array in enumerate(self.arrays) for _ in range(array.size))

    def array_description(self, array: Array) -> str:
        """Return the description of an array: that of its elements without indices."""
        text = self.memory[array.first].description
        return general_description(text) if array.shape else text


@cached_per_command
def interface_of(unit: type[BaseUnit], robot: Machine | None) -> Interface:
    """Return the variables of a unit for a robot, with the declared start values; made once per job."""
    return Interface(unit, robot)


@cached_per_command
def _declared(unit: type[BaseUnit], robot: Machine | None) -> tuple[tuple[Variable, ...], tuple[Variable, ...]]:
    """Return the variables of a unit and the derivatives of its states; UnitError if it is declared wrongly."""
    if robot is None and unit.needs_robot():
        raise UnitError(f"{unit.__name__} needs a robot, for its joints. Name it: --robot planar_2dof.")
    check_unit(unit, robot)
    return tuple(scalar_variables(unit, robot)), tuple(derivative_variables(unit, robot))


@cached_per_command
def _functions(unit: type[BaseUnit], robot: Machine | None) -> UnitFunctions:
    return UnitFunctions(unit, robot)


def general_description(description: str) -> str:
    """Return a description without the index of the variable in its group."""
    text = re.sub(r"^Joint \d+: |, axis$|,? axis [\d,]+$|, row \d+, column \d+$| [\d,]+$", "", description)
    return text[:1].upper() + text[1:]
