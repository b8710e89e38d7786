"""The variables of one unit for one robot: names, value references, groups and dependencies."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from functools import cached_property

import numpy as np
import numpy.typing as npt

from vdfmu.errors import UsageError
from vdfmu.fmu.dependencies import dependencies
from vdfmu.fmu.table import NO_LIMIT, TABLES, Variable
from vdfmu.kernel.structure import parameters
from vdfmu.model import Robot

__all__ = ["MODEL_NAMES", "NO_LIMIT", "UNIT_NAMES", "Interface", "Variable", "interface", "start_values"]

MODEL_NAMES = {
    "trajectory": "Trajectory",
    "feedforward": "Feedforward",
    "controller": "PDController",
    "plant": "Plant",
    "estimator": "TorqueEstimator",
}
UNIT_NAMES = tuple(MODEL_NAMES)
DESCRIPTIONS = {
    "trajectory": "Desired joint trajectory with four time derivatives, Eq. (57)",
    "feedforward": "Feedforward torque by virtual decomposition, Eq. (12)-(28) and (48)-(53)",
    "controller": "Proportional-derivative controller, Eq. (58)",
    "plant": "Serial manipulator with flexible harmonic-drive joints, Eq. (4)-(11), (29)-(47), (54)-(56)",
    "estimator": "Joint torque from the positions of link and rotor, Eq. (2)-(3)",
}


class Interface:
    """Variables of one unit in the order of their value references, 0, 1, ...

    A group's variables lie next to each other: its values are a slice of the unit's memory.
    """

    def __init__(self, unit: str, robot: Robot, variables: Iterable[Variable]) -> None:
        self.unit = unit
        self.robot = robot
        self.variables = tuple(variables)

    def __iter__(self) -> Iterator[Variable]:
        return iter(self.variables)

    def __len__(self) -> int:
        return len(self.variables)

    @property
    def model_name(self) -> str:
        """Model identifier of the FMU."""
        return MODEL_NAMES[self.unit]

    @property
    def description(self) -> str:
        """One line on what the unit is."""
        return DESCRIPTIONS[self.unit]

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

    @property
    def has_robot(self) -> bool:
        """Whether all run-time parameters of the robot are parameters of the unit."""
        return "mass" in self.groups

    @property
    def size(self) -> int:
        """Length of the memory of a native unit: the variables, the derivatives of the states, the time."""
        x = self.slice("x")
        return len(self) + x.stop - x.start + 1

    def slice(self, group: str) -> slice:
        """Positions of a group, or of ``p``, ``x``, ``x_dot`` or ``t`` of :mod:`vdfmu.fmu.program`."""
        N, groups = len(self), self.groups
        match group:
            case "p":
                listed = [self.reference[p.name] for p in parameters(self.robot)]
                return slice(listed[0], listed[-1] + 1)
            case "x" if "tau_s_0" in groups:  # the unit that has a state can start it
                return slice(groups["q"].start, groups["tau_s"].stop)
            case "x" | "x_dot" if "tau_s_0" not in groups:
                return slice(N, N)
            case "x_dot":
                return slice(N, N + 4 * self.robot.n)
            case "t":
                return slice(self.size - 1, self.size)
            case _:
                return groups[group]

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
        raise UsageError(f"{self.unit} has no variable {name!r}. There are: {', '.join(near)}.")

    def direct_dependencies(self, output: Variable) -> list[int]:
        """Value references of the inputs that an output depends on at the same communication point."""
        return np.flatnonzero(self._dependencies[0][self.reference[output.name]]).tolist()

    def initial_dependencies(self, output: Variable) -> list[int]:
        """Value references of the inputs and parameters that an output depends on during initialization."""
        return np.flatnonzero(self._dependencies[1][self.reference[output.name]]).tolist()

    @cached_property
    def _dependencies(self) -> tuple[npt.NDArray[np.bool_], npt.NDArray[np.bool_]]:
        return dependencies(self)


def interface(unit: str, robot: Robot) -> Interface:
    """Variables of a unit for a robot.

    Parameters
    ----------
    unit : one of :data:`UNIT_NAMES`
    """
    if unit not in MODEL_NAMES:
        raise UsageError(f"There is no unit {unit!r}. There are: {', '.join(UNIT_NAMES)}.")
    return Interface(unit, robot, TABLES[unit](robot))


def start_values(table: Interface) -> np.ndarray:
    """Start values in the order of the value references; outputs are 0 until they are calculated."""
    return np.array([0.0 if v.start is None else float(v.start) for v in table])
