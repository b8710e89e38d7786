"""What each unit computes: its program on its own memory, with no FMI in sight.

All values of a unit lie in one float array, in the order of the variable table. The traced functions read and
write slices of it in place, so that a step copies nothing.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
import numpy.typing as npt

from vdfmu.errors import FmuError, KernelError, ModelError
from vdfmu.fmu.interface import Interface
from vdfmu.fmu.program import PROGRAMS, Call, Copy, Statement, When
from vdfmu.kernel import Integrator, Kernel
from vdfmu.kernel.structure import set_parameters
from vdfmu.model import check_robot

__all__ = ["Behaviour", "robot_problems"]

Floats = npt.NDArray[np.float64]


class Behaviour:
    """A unit's program, bound to its memory.

    Parameters
    ----------
    table : Interface
    memory : (len(table),) array
        Values of all variables; booleans and integers as floats.
    kernel : Kernel
    """

    def __init__(self, table: Interface, memory: Floats, kernel: Kernel) -> None:
        self.table = table
        self.memory = memory
        self._kernel = kernel
        self._t = np.zeros(1)
        program = PROGRAMS[table.unit]
        self._start = [self._bind(statement) for statement in program.start]
        self._outputs = [self._bind(statement) for statement in program.outputs]
        self._integrator: Integrator | None = None
        if program.step is not None:
            groups = ("x", "p", *{v.group for v in table if v.causality == "input"})
            self._integrator = Integrator(kernel, **{group: self._buffer(group) for group in groups})

    def _buffer(self, group: str) -> Floats:
        return self._t if group == "t" else self.memory[self.table.slice(group)]

    def _bind(self, statement: Statement) -> tuple[Floats | None, float, Callable[[], Any]]:
        """Return parameter, value and function of a statement: it runs where the parameter has the value."""
        action = self._copy(statement) if isinstance(statement, Copy) else self._call(statement)
        return (*self._chooser(statement.when), action)

    def _chooser(self, when: When | None) -> tuple[Floats | None, float]:
        return (None, 0.0) if when is None else (self._buffer(when[0]), float(when[1]))

    def _copy(self, statement: Copy) -> Callable[[], Any]:
        target, source = self._buffer(statement.target), self._buffer(statement.source)

        def copy() -> None:
            target[:] = source

        return copy

    def _call(self, call: Call) -> Callable[[], Any]:
        function = self._kernel.casadi_function(call.function)
        names = (*function.name_in(), *function.name_out())
        bound = self._kernel.function(
            call.function, **{name: self._buffer(call.group(name)) for name in names}
        )

        def run() -> None:
            bound.run()

        return run

    def check(self) -> list[str]:
        """Problems of the parameter values together; those of each alone are checked when they are set."""
        return robot_problems(self.table, self.memory)

    def start(self, t: float, tolerance: float | None) -> None:
        """Take the parameters as they are and set the state to that of the start time `t` [s].

        `tolerance` is that of the experiment; the smaller of it and the parameter holds.
        """
        if self._integrator is not None:
            own = float(self._buffer("tolerance")[0])
            self._integrator.tolerance = own if tolerance is None else min(own, tolerance)
            self._integrator.h = 1e-4
        self._t[0] = t
        _run(self._start)

    def outputs(self, t: float) -> None:
        """Calculate the outputs at time `t` [s] from inputs, parameters and state."""
        self._t[0] = t
        _run(self._outputs)

    def step(self, t: float, duration: float) -> None:
        """Move from `t` to `t + duration` [s] with the inputs held.

        A unit without a state calculates its outputs from the inputs at `t`.
        """
        if self._integrator is not None:
            try:
                self._integrator.advance(t, duration)
            except KernelError as error:
                raise FmuError(str(error)) from None
        self.outputs(t + duration)

    def state(self) -> Any:
        """Everything beyond the variables that decides the future, JSON-able."""
        if self._integrator is None:
            return None
        return {"h": self._integrator.h, "tolerance": self._integrator.tolerance}

    def restore(self, state: Any) -> None:
        """Take a state of :meth:`state` back; raise and change nothing if it is none."""
        if self._integrator is not None:
            h, tolerance = float(state["h"]), float(state["tolerance"])
            self._integrator.h, self._integrator.tolerance = h, tolerance


def _run(statements: Iterable[tuple[Floats | None, float, Callable[[], Any]]]) -> None:
    for chooser, value, action in statements:
        if chooser is None or chooser[0] == value:
            action()


def robot_problems(table: Interface, memory: Floats) -> list[str]:
    """Tell what is not physical in the robot parameters of a unit's memory, with FMI names."""
    if not table.has_robot:
        return []
    robot = set_parameters(table.robot, memory[table.slice("p")])
    try:
        check_robot(robot, _ROBOT)
    except ModelError as error:
        return [_FILE_KEY.sub(_fmi_name, problem) for problem in error.problems]
    return []


_ROBOT = "robot"
_FILE_KEY = re.compile(rf"^{_ROBOT}: (?:joints\[(\d+)\]\.)?(?:(payload)\.|\w+\.)?(\w+)")


def _fmi_name(key: re.Match[str]) -> str:
    """Turn ``robot: joints[2].friction.f_s`` into ``f_s[2]``."""
    joint, payload, field = key.groups()
    field = f"{payload}_{field}" if payload else field
    return f"{field}[{joint}]" if joint else field
