"""What each unit computes: kernel functions on the unit's own memory, with no FMI in sight.

All values of a unit lie in one float array, in the order of the variable table. The kernel functions read and
write slices of it in place, so that a step copies nothing.
"""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import numpy.typing as npt

from vdfmu.errors import FmuError, KernelError, ModelError
from vdfmu.fmu.interface import Interface
from vdfmu.kernel import Integrator, Kernel
from vdfmu.kernel.structure import parameters, set_parameters
from vdfmu.model import check_robot

__all__ = ["BEHAVIOURS", "Behaviour", "robot_problems"]

Floats = npt.NDArray[np.float64]


class Behaviour:
    """Common part of the four units.

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
        self.kernel = kernel

    def values(self, group: str) -> Floats:
        """View of the values of a group."""
        return self.memory[self.table.groups[group]]

    def views(self, *groups: str) -> dict[str, Floats]:
        """View several groups, by name."""
        return {group: self.values(group) for group in groups}

    def robot_parameters(self) -> Floats:
        """View of the run-time parameters of the robot, in the kernel's order."""
        return _robot_parameters(self.table, self.memory)

    def check(self) -> list[str]:
        """Problems of the parameter values together; those of each alone are checked when they are set."""
        return []

    def start(self, t: float, tolerance: float | None) -> None:
        """Take the parameters as they are and set the state to that of the start time `t` [s]."""

    def outputs(self, t: float) -> None:
        """Calculate the outputs at time `t` [s] from inputs, parameters and state."""

    def step(self, t: float, duration: float) -> None:
        """Move from `t` to `t + duration` [s].

        A unit without a state calculates its outputs from the inputs at `t`.
        """
        self.outputs(t)

    def state(self) -> Any:
        """Everything beyond the variables that decides the future, JSON-able."""
        return None

    def restore(self, state: Any) -> None:
        """Take a state of :meth:`state` back; raise and change nothing if it is none."""


def _robot_parameters(table: Interface, memory: Floats) -> Floats:
    references = [table.reference[p.name] for p in parameters(table.robot)]
    return memory[references[0] : references[-1] + 1]


def robot_problems(table: Interface, memory: Floats) -> list[str]:
    """Tell what is not physical in the robot parameters of a unit's memory, with FMI names."""
    robot = set_parameters(table.robot, _robot_parameters(table, memory))
    try:
        check_robot(robot, _ROBOT)
    except ModelError as error:
        return [_FILE_KEY.sub(_fmi_name, problem) for problem in error.problems]
    return []


_ROBOT = "robot"
_FILE_KEY = re.compile(rf"^{_ROBOT}: (?:joints\[(\d+)\]\.)?(?:\w+\.)?(\w+)")


def _fmi_name(key: re.Match[str]) -> str:
    """Turn ``robot: joints[2].friction.f_s`` into ``f_s[2]``."""
    joint, field = key.groups()
    return f"{field}[{joint}]" if joint else field


class TrajectoryBehaviour(Behaviour):
    """Eq. (57) as a function of time."""

    def __init__(self, table: Interface, memory: Floats, kernel: Kernel) -> None:
        super().__init__(table, memory, kernel)
        groups = ("q_d", "q_d_dot", "q_d_ddot", "q_d_dddot", "q_d_ddddot", "q_start", "q_end", "T", "t_start")
        self._function = kernel.function("trajectory", **self.views(*groups))
        self._t = self._function.args["t"]

    def outputs(self, t: float) -> None:
        self._t[0] = t
        self._function.run()

    def step(self, t: float, duration: float) -> None:
        self.outputs(t + duration)


class FeedforwardBehaviour(Behaviour):
    """Feedforward torques from the inputs, in the mode that the parameter chooses."""

    def __init__(self, table: Interface, memory: Floats, kernel: Kernel) -> None:
        super().__init__(table, memory, kernel)
        desired = ("q_d", "q_d_dot", "q_d_ddot", "q_d_dddot", "q_d_ddddot", "tau_m", "tau_s")
        buffers = {**self.views(*desired), "p": self.robot_parameters()}
        more = self.views("q", "q_dot", "kappa_dot", "Lambda", "K_V", "k_vq", "k_vkappa")
        self._functions = (
            kernel.function("feedforward_inverse", **buffers),
            kernel.function("feedforward_vdc", **buffers, **more),
        )
        self._mode = self.values("mode")

    def check(self) -> list[str]:
        return robot_problems(self.table, self.memory)

    def outputs(self, t: float) -> None:
        self._functions[int(self._mode[0])].run()


class ControllerBehaviour(Behaviour):
    """Eq. (58) on the inputs."""

    def __init__(self, table: Interface, memory: Floats, kernel: Kernel) -> None:
        super().__init__(table, memory, kernel)
        buffers = self.views("K_p", "K_v", "ell", "tau_max", "q_d", "q_d_dot", "q", "tau_m", "tau", "tau_e")
        self._functions = tuple(
            kernel.function("pd_control", **buffers, velocity=self.values(source))
            for source in ("kappa_dot", "q_dot")
        )
        self._velocity = self.values("velocity")

    def outputs(self, t: float) -> None:
        self._functions[int(self._velocity[0])].run()


class PlantBehaviour(Behaviour):
    """The flexible arm under its solver; the state is the outputs q, q_dot, kappa_dot, tau_s themselves."""

    def __init__(self, table: Interface, memory: Floats, kernel: Kernel) -> None:
        super().__init__(table, memory, kernel)
        first, last = table.groups["q"].start, table.groups["tau_s"].stop
        buffers = {"x": memory[first:last], "p": self.robot_parameters()}
        groups = ("kappa", "p_O", "R_O", "E_kin", "E_pot", "E_spring")
        self._integrator = Integrator(kernel, **buffers, **self.views("tau", "F_e"))
        self._outputs = kernel.function("plant_outputs", **buffers, **self.views(*groups))
        self._equilibrium = kernel.function("equilibrium_torque", p=buffers["p"])

    def check(self) -> list[str]:
        return robot_problems(self.table, self.memory)

    def start(self, t: float, tolerance: float | None) -> None:
        self._integrator.tolerance = float(self.values("tolerance")[0]) if tolerance is None else tolerance
        self._integrator.h = 1e-4
        self.values("q")[:] = self.values("q_0")
        self.values("q_dot")[:] = self.values("q_dot_0")
        if self.values("equilibrium")[0]:
            self.values("kappa_dot")[:] = self.values("q_dot_0")
            self._equilibrium.args["q"][:] = self.values("q_0")
            self._equilibrium.run()
            self.values("tau_s")[:] = self._equilibrium.results["tau_s"]
        else:
            self.values("kappa_dot")[:] = self.values("kappa_dot_0")
            self.values("tau_s")[:] = self.values("tau_s_0")

    def outputs(self, t: float) -> None:
        self._outputs.run()

    def step(self, t: float, duration: float) -> None:
        try:
            self._integrator.advance(t, duration)
        except KernelError as error:
            raise FmuError(str(error)) from None
        self._outputs.run()

    def state(self) -> Any:
        return {"h": self._integrator.h, "tolerance": self._integrator.tolerance}

    def restore(self, state: Any) -> None:
        h, tolerance = float(state["h"]), float(state["tolerance"])
        self._integrator.h, self._integrator.tolerance = h, tolerance


BEHAVIOURS: dict[str, type[Behaviour]] = {
    "trajectory": TrajectoryBehaviour,
    "feedforward": FeedforwardBehaviour,
    "controller": ControllerBehaviour,
    "plant": PlantBehaviour,
}
