"""The memory of a native unit: what lies at which position, and which positions FMI 3 sees as one array."""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import groupby

import numpy as np

from vdfmu.fmu.dependencies import patterns
from vdfmu.fmu.interface import Interface
from vdfmu.fmu.table import Variable
from vdfmu.fmu.units import DERIVATIVES
from vdfmu.kernel.structure import parameters

__all__ = ["Array", "Derivative", "Layout", "general_description"]


@dataclass(frozen=True)
class Derivative(Variable):
    """Derivative of a state; its name has the index inside, ``der(q[1])``."""

    @property
    def name(self) -> str:
        """Structured FMI name."""
        group, _, index = super().name.partition(")")
        return f"{group}{index})"


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


class Layout:
    """Memory of a native unit: the variables of the table, the derivatives of the states, the time.

    Attributes
    ----------
    table : Interface
    variables : tuple of Variable
        What lies at each position.
    states, derivatives : slice
        Positions of the states and of their derivatives, in the same order; empty without states.
    time : int
        Position of the time, the last.
    """

    def __init__(self, table: Interface) -> None:
        self.table = table
        self.states, self.derivatives = table.slice("x"), table.slice("x_dot")
        self.time = table.size - 1
        derivatives = [_derivative(v) for v in table.variables[self.states]]
        self.variables = (*table.variables, *derivatives, _TIME)

    def __iter__(self) -> Iterator[Variable]:
        return iter(self.variables)

    def __len__(self) -> int:
        return len(self.variables)

    @cached_property
    def arrays(self) -> tuple[Array, ...]:
        """Variables of FMI 3 in the order of their positions.

        A group is an array if all its elements are there and differ in nothing but start value and description.
        Others are scalars: parameters of a robot where some are folded, and groups whose elements differ in
        unit, as ``q`` of an arm with revolute and prismatic joints or ``F_e``, since an array of FMI 3 has one
        unit.
        """
        found: list[Array] = []
        for group, members in groupby(enumerate(self.variables), lambda item: item[1].group):
            positions, variables = zip(*members, strict=True)
            shape = self._shape(group, variables)
            if shape:
                found.append(Array(group, positions[0], shape))
            else:
                found += [Array(v.name, i, ()) for i, v in zip(positions, variables, strict=True)]
        return tuple(found)

    def _shape(self, group: str, variables: tuple[Variable, ...]) -> tuple[int, ...]:
        """Shape of a group as an array; empty if it is none."""
        if group in self._robot_fields:
            shape = np.shape(getattr(self.table.robot, group))
        else:
            shape = tuple(max(axis) + 1 for axis in zip(*(v.index for v in variables), strict=True))
        one = {dataclasses.replace(v, index=(), start=None, description="") for v in variables}
        whole = [v.index for v in variables] == list(np.ndindex(shape))
        return shape if whole and len(one) == 1 else ()

    @cached_property
    def _robot_fields(self) -> frozenset[str]:
        return frozenset(p.field for p in parameters(self.table.robot))

    @cached_property
    def owners(self) -> tuple[int, ...]:
        """Position to the index in :attr:`arrays` of the variable it belongs to."""
        return tuple(i for i, array in enumerate(self.arrays) for _ in range(array.size))

    def description(self, array: Array) -> str:
        """Return the description of an array: that of its elements, without what tells one from the next."""
        text = self.variables[array.first].description
        return general_description(text) if array.shape else text

    def step_dependencies(self, position: int) -> list[int]:
        """Positions on which an output or derivative depends after initialization: inputs, states, time.

        A state depends on itself.
        """
        return np.flatnonzero(self._patterns[0][position]).tolist()

    def start_dependencies(self, position: int) -> list[int]:
        """Positions on which it depends during initialization: inputs, parameters, time."""
        return np.flatnonzero(self._patterns[1][position]).tolist()

    @cached_property
    def _patterns(self) -> tuple[np.ndarray, np.ndarray]:
        return patterns(self.table)


def general_description(description: str) -> str:
    """Return a description without what tells one variable of a group from the next."""
    text = re.sub(r"^Joint \d+: |,? axis [\d,]+$|, row \d+, column \d+$| [\d,]+$", "", description)
    return text[0].upper() + text[1:]


def _derivative(state: Variable) -> Derivative:
    assert state.unit is not None
    return Derivative(
        f"der({state.group})", state.index, "Real", "local", "continuous", DERIVATIVES[state.unit],
        None, None, None, re.sub(r"^(Joint \d+: )?", r"\1derivative of the ", state.description),
    )  # fmt: skip


_TIME = Variable(
    "time", (), "Real", "independent", "continuous", "s", None, None, None, "Time of the simulation"
)
