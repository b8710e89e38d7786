"""The variables of a unit for one robot, and its memory: what lies at which position.

FMI 2.0 sees scalars, whose value references are their positions; FMI 3.0 sees an array where a group's elements lie
one after the other and are alike.
"""

from __future__ import annotations

import dataclasses
import math
import re
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import groupby
from typing import Any

import numpy as np

from vdfmu.base.cache import cached_per_command
from vdfmu.base.errors import UnitError, UsageError
from vdfmu.compiler.unit.base import BaseUnit, is_shipped, unit_name
from vdfmu.compiler.unit.declaration_check import check_unit
from vdfmu.compiler.unit.dependencies import Rows, patterns
from vdfmu.compiler.unit.machine import Machine
from vdfmu.compiler.unit.program import Program, UnitFunctions
from vdfmu.compiler.unit.trace import argument_name
from vdfmu.compiler.unit.variable import Variable, derivative_variables, scalar_variables

_CAST = {"Real": float, "Integer": int, "Boolean": bool}
_TIME = Variable("time", (), "Real", "independent", "continuous", "s", None, "Time of the simulation")


@dataclass(frozen=True)
class Array:
    """One variable as FMI 3 sees it.

    Attributes
    ----------
    name : str
        The group, ``q``, of an array; the structured name, ``offset[2,1]``, of a scalar.
    first : int
        Position of the first element, and the value reference in FMI 3.
    shape : tuple of int
        Empty for a scalar. The elements lie row by row.
    """

    name: str
    first: int
    shape: tuple[int, ...]

    @property
    def size(self) -> int:
        """Number of elements."""
        return math.prod(self.shape)

    @property
    def positions(self) -> slice:
        """Positions of the elements."""
        return slice(self.first, self.first + self.size)


class Interface:
    """Variables of one unit in the order of their value references, 0, 1, ..., and its memory.

    The memory holds the variables, the derivatives of the continuous states, and the time. A group's variables lie next
    to each other: its values are a slice of the memory. Iteration is over the variables.

    Parameters
    ----------
    unit : type of Unit
    robot : Robot or None
        None for a unit without joints.
    start : mapping of str to float, optional
        Start values by variable, instead of the declared ones.

    Attributes
    ----------
    variables : tuple of Variable
    memory : tuple of Variable
        Meaning of each position.
    states, derivatives : slice
        Positions of the continuous states and of their derivatives, in the same order; empty without states.

    Raises
    ------
    UsageError
        If a start value has no variable, belongs to an output or is out of its limits; names all of them.
    UnitError
        If the unit needs a robot and there is none, or is declared wrongly.
    """

    def __init__(self, unit: type[BaseUnit], robot: Machine | None, start: Mapping[str, float] | None = None) -> None:
        self.unit = unit
        self.robot = robot
        self.variables, derivatives = _declared(unit, robot)
        if start:
            self.variables = self._started(start)
        N, n_x = len(self.variables), len(derivatives)
        first = next((i for i, v in enumerate(self.variables) if v.causality == "output"), N)
        self.states = slice(first, first + n_x) if n_x else slice(N, N)
        self.derivatives = slice(N, N + n_x)
        self.memory = (*self.variables, *derivatives, _TIME)

    def _started(self, start: Mapping[str, float]) -> tuple[Variable, ...]:
        known: dict[str, Any] = {}
        problems: list[str] = []
        for name, value in start.items():
            variable = self.find(name)
            if variable.causality == "output":
                problems.append(f"{name} is an output, which has no start value.")
            elif problem := variable.problem(value):
                problems.append(f"{name}: {problem}.")
            else:
                known[name] = _CAST[variable.type](value)
        if problems:
            raise UsageError(f"start values of {self.name}: {' '.join(problems)}")
        return tuple(dataclasses.replace(v, start=known[v.name]) if v.name in known else v for v in self.variables)

    def __iter__(self) -> Iterator[Variable]:
        return iter(self.variables)

    def __len__(self) -> int:
        return len(self.variables)

    @property
    def name(self) -> str:
        """Name of the unit: ``plant``."""
        return unit_name(self.unit)

    @property
    def model_name(self) -> str:
        """Model identifier of the FMU: ``Plant``."""
        return self.unit.__name__

    @property
    def description(self) -> str:
        """One line on what the unit is."""
        return self.unit.description()

    @cached_property
    def functions(self) -> UnitFunctions:
        """Traced functions of the unit."""
        return _functions(self.unit, self.robot)

    @cached_property
    def program(self) -> Program:
        """The program of the unit."""
        return Program(self.functions)

    # ---------------------------------------------------------------- places

    @cached_property
    def reference(self) -> dict[str, int]:
        """Name to value reference."""
        return {v.name: i for i, v in enumerate(self.variables)}

    @cached_property
    def groups(self) -> dict[str, slice]:
        """Group to its slice of value references, in order."""
        found: dict[str, slice] = {}
        for i, v in enumerate(self.variables):
            found[v.group] = slice(found[v.group].start if v.group in found else i, i + 1)
        return found

    def groups_of(self, *causalities: str) -> dict[str, slice]:
        """Return the :attr:`groups` of some causalities: input, output, parameter."""
        return {g: where for g, where in self.groups.items() if self.memory[where.start].causality in causalities}

    @property
    def has_robot(self) -> bool:
        """Whether all run-time parameters of the robot are parameters of the unit."""
        return self.unit.robot_fields == ()

    @property
    def joints(self) -> int:
        """Number of joints of the robot; 0 without one."""
        return self.robot.n if self.robot is not None else 0

    @cached_property
    def shorter(self) -> tuple[Interface, ...]:
        """The unit for shorter machines, which say what it calculates for this long one; none for most.

        Only units of the package are known to calculate the same for each joint, those whose variables grow evenly.
        """
        robots = self.robot.shorter() if self.robot is not None and is_shipped(self.unit) else ()
        if not robots:
            return ()
        found = tuple(interface_of(self.unit, robot) for robot in robots)
        sizes = [Counter(v.group for v in one.memory) for one in (*found, self)]
        joints = np.diff([one.joints for one in (*found, self)])
        grows = (np.diff([size[group] for size in sizes]) / joints for group in sizes[-1])
        return found if all(np.ptp(growth) == 0.0 for growth in grows) else ()

    @property
    def has_states(self) -> bool:
        """Whether the unit has continuous states."""
        return self.states.stop > self.states.start

    @property
    def has_exchange(self) -> bool:
        """Whether the native FMU is for model exchange, too."""
        return self.has_states or self.unit.exchange

    @property
    def implementation(self) -> str:
        """What the unit is in a system, by the name that FMI and SSP have for it."""
        return "ModelExchange" if self.unit.exchange else "CoSimulation"

    @cached_property
    def sampled(self) -> slice:
        """Positions of the sampled states, which follow the continuous ones."""
        found = [i for i, v in enumerate(self) if v.variability == "discrete"]
        return slice(found[0], found[-1] + 1) if found else slice(0, 0)

    @property
    def is_sampled(self) -> bool:
        """Whether the unit has sampled states."""
        return self.sampled.stop > 0

    @property
    def size(self) -> int:
        """Length of the memory."""
        return len(self.memory)

    @property
    def time(self) -> int:
        """Position of the time, the last."""
        return self.size - 1

    @cached_property
    def arguments(self) -> dict[str, slice]:
        """Argument of traced functions to its positions: groups, ``p`` of a robot, ``x``, ``x_dot`` and ``t``."""
        found = {argument_name(group): where for group, where in self.groups.items()}
        if self.robot is not None and self.has_robot:
            found["p"] = slice(len(self) - len(self.robot.entries()), len(self))
        return found | {"x": self.states, "x_dot": self.derivatives, "t": slice(self.time, self.size)}

    def find(self, name: str) -> Variable:
        """Variable of a name.

        Raises
        ------
        UsageError
            If there is none; the message lists near names.
        """
        if name in self.reference:
            return self.variables[self.reference[name]]
        group = name.split("[")[0]
        near = [v.name for v in self if v.group == group] or list(self.groups)
        raise UsageError(f"{self.name} has no variable {name!r}. There are: {', '.join(near)}.")

    def start_values(self) -> np.ndarray:
        """Start values in the order of the value references; outputs are 0 until they are calculated."""
        return np.array([0.0 if v.start is None else float(v.start) for v in self])

    def memory_of(self, values: Mapping[str, Any]) -> np.ndarray:
        """Memory with the start values, and instead some by variable."""
        memory = np.zeros(self.size)
        memory[: len(self)] = self.start_values()
        for name, value in values.items():
            memory[self.reference[name]] = float(value)
        return memory

    # ---------------------------------------------------------------- dependencies

    def step_dependencies(self, position: int) -> list[int]:
        """Positions on which an output or derivative depends after initialization: inputs, states, time.

        A continuous state depends on itself, a sampled one on what its unit reads for a sample, unless it is delayed.
        """
        return np.flatnonzero(self.patterns[0][position]).tolist()

    def held_dependencies(self, position: int) -> list[int]:
        """Return what :meth:`step_dependencies` does, while sampled states are held."""
        return np.flatnonzero(self.patterns[2][position]).tolist()

    def start_dependencies(self, position: int) -> list[int]:
        """Positions on which it depends during initialization: inputs, parameters, time."""
        return np.flatnonzero(self.patterns[1][position]).tolist()

    @cached_property
    def patterns(self) -> tuple[Rows, Rows, Rows]:
        """See :func:`~vdfmu.compiler.unit.dependencies.patterns`."""
        return patterns(self)

    # ---------------------------------------------------------------- arrays of FMI 3

    @cached_property
    def arrays(self) -> tuple[Array, ...]:
        """Variables of FMI 3 in the order of their positions.

        A group is an array if all its elements are there and differ in nothing but start value and description.
        Others are scalars: parameters of a robot where some are folded, and groups whose elements differ in
        unit, as ``q`` of an arm with revolute and prismatic joints or ``F_e``, since an array of FMI 3 has one
        unit.
        """
        found: list[Array] = []
        for group, members in groupby(enumerate(self.memory), lambda item: item[1].group):
            positions, variables = zip(*members, strict=True)
            shape = self._shape(group, variables)
            if shape:
                found.append(Array(group, positions[0], shape))
            else:
                found += [Array(v.name, i, ()) for i, v in zip(positions, variables, strict=True)]
        return tuple(found)

    def _shape(self, group: str, variables: tuple[Variable, ...]) -> tuple[int, ...]:
        """Shape of a group as an array; empty if it is not one."""
        if group not in self.unit.declared and hasattr(self.robot, group):
            shape = np.shape(getattr(self.robot, group))
        else:
            shape = tuple(max(axis) + 1 for axis in zip(*(v.index for v in variables), strict=True))
        one = {dataclasses.replace(v, index=(), start=None, description="") for v in variables}
        whole = [v.index for v in variables] == list(np.ndindex(shape))
        return shape if whole and len(one) == 1 else ()

    @cached_property
    def owners(self) -> tuple[int, ...]:
        """Position to the index in :attr:`arrays` of the variable it belongs to."""
        return tuple(i for i, array in enumerate(self.arrays) for _ in range(array.size))

    def array_description(self, array: Array) -> str:
        """Return the description of an array: its elements', without their indices."""
        text = self.memory[array.first].description
        return general_description(text) if array.shape else text


@cached_per_command
def interface_of(unit: type[BaseUnit], robot: Machine | None) -> Interface:
    """Return the variables of a unit for a robot, with the start values of its declaration; made once in a job."""
    return Interface(unit, robot)


@cached_per_command
def _declared(unit: type[BaseUnit], robot: Machine | None) -> tuple[tuple[Variable, ...], tuple[Variable, ...]]:
    """Return the variables of a unit and the derivatives of its states; UnitError if it is declared wrongly."""
    if robot is None and unit.needs_robot():
        raise UnitError(f"{unit.__name__} needs a robot, for its joints: name one, --robot planar_2dof.")
    check_unit(unit, robot)
    return tuple(scalar_variables(unit, robot)), tuple(derivative_variables(unit, robot))


@cached_per_command
def _functions(unit: type[BaseUnit], robot: Machine | None) -> UnitFunctions:
    return UnitFunctions(unit, robot)


def general_description(description: str) -> str:
    """Return a description without the index of the variable in its group."""
    text = re.sub(r"^Joint \d+: |,? axis [\d,]+$|, row \d+, column \d+$| [\d,]+$", "", description)
    return text[:1].upper() + text[1:]
