"""Traced functions of a robot and their calls on arrays."""

from __future__ import annotations

import threading
from collections.abc import Callable, Collection, Sequence
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import numpy.typing as npt

from vdfmu.arm.equations.flexible_joint import link_torques
from vdfmu.arm.equations.forward_dynamics import forward_dynamics
from vdfmu.arm.equations.inverse_dynamics import inverse_dynamics
from vdfmu.arm.equations.kinematics import end_effector_pose
from vdfmu.arm.equations.mapping import jacobian, joint_space_mass_matrix
from vdfmu.arm.equations.newton_euler import newton_euler
from vdfmu.arm.robot import Robot
from vdfmu.base.arrays import Floats
from vdfmu.base.errors import KernelError
from vdfmu.compiler.functions.traced import Functions, KernelFunction, traced_function
from vdfmu.compiler.scalar import from_sx, to_sx


def _of_drives(dynamics: Callable[..., Any]) -> Callable[..., Any]:
    return lambda robot, q, *rest: dynamics(robot, q, *rest) - link_torques(robot, q)


def _driven(robot: Any, q: Any, q_dot: Any, tau: Any, F_e: Any) -> Any:
    return forward_dynamics(robot, q, q_dot, tau + link_torques(robot, q), F_e)


FUNCTIONS: dict[str, tuple[tuple[str, ...], str, Callable[..., Any]]] = {
    "inverse_dynamics": (("q", "q_dot", "q_ddot", "F_e"), "tau", _of_drives(inverse_dynamics)),
    "newton_euler": (("q", "q_dot", "q_ddot", "F_e"), "tau", _of_drives(newton_euler)),  # for contrast, section IV-A
    "forward_dynamics": (("q", "q_dot", "tau", "F_e"), "q_ddot", _driven),
    "forward_kinematics": (("q",), "pose", lambda *a: np.concatenate([np.ravel(x) for x in end_effector_pose(*a)])),
    "jacobian": (("q",), "J_q", jacobian),
    "mass_matrix": (("q",), "M", joint_space_mass_matrix),
}
"""Name to inputs, output and equation. The last input of all is ``p``, the run-time parameters of the robot."""


def trace(name: str, robot: Robot) -> ca.Function:
    """Trace one of `FUNCTIONS` for the structure of a robot."""
    names, result, equation = FUNCTIONS[name]
    symbols, p = robot.symbolic()
    inputs = {n: ca.SX.sym(n, 6 if n == "F_e" else robot.n) for n in names}
    arguments = [from_sx(v) for v in inputs.values()]
    return traced_function(name, inputs | {"p": p}, {result: to_sx(equation(symbols, *arguments))})


class Kernel(Functions):
    """The functions of :data:`FUNCTIONS` for one robot structure; `p` holds the values of its run-time parameters."""

    def __init__(self, robot: Robot, cache: Path | None | str = "default") -> None:
        super().__init__(robot.key(), cache)
        self.robot = robot
        self.p = robot.values()
        self._bound = threading.local()
        """Functions with buffers, by name; each thread has its own."""

    def names(self) -> Collection[str]:
        """Names of the functions, without derivatives."""
        return FUNCTIONS.keys()

    def made(self, name: str) -> ca.Function:
        """Trace one of :meth:`names`."""
        return trace(name, self.robot)

    def rows(self, name: str, arguments: Sequence[npt.ArrayLike], sizes: Sequence[int]) -> Floats:
        """Call a function of one result for arrays (m,) or batches (k, m), with this robot's parameters."""
        bound: KernelFunction | None = getattr(self._bound, name, None)
        if bound is None:
            bound = self.function(name, p=self.p)
            setattr(self._bound, name, bound)
        *buffers, _ = bound.args.values()  # the last are the parameters
        (result,) = bound.results.values()
        arrays = [_checked(name, a, v, size) for a, v, size in zip(bound.args, arguments, sizes, strict=False)]
        batches = {len(a) for a in arrays if a.ndim == 2}
        if len(batches) > 1:
            raise KernelError(f"{name}: batches of different lengths {sorted(batches)}: expected one length.")
        out = np.empty((batches.pop() if batches else 1, len(result)))
        columns = [np.broadcast_to(a, (len(out), a.shape[-1])) for a in arrays]
        for k, row in enumerate(out):
            for buffer, column in zip(buffers, columns, strict=True):
                buffer[:] = column[k]
            bound.run()
            row[:] = result
        _finite(name, out)
        return out if any(array.ndim == 2 for array in arrays) else out[0]


def _checked(function: str, name: str, value: npt.ArrayLike, size: int) -> Floats:
    try:
        array = np.asarray(value, dtype=float)
    except (TypeError, ValueError, OverflowError) as error:
        raise KernelError(f"{function}: {name}: expected numbers of shape ({size},) or (m, {size}): {error}") from error
    if array.ndim not in (1, 2) or array.shape[-1] != size:
        raise KernelError(f"{function}: {name}: expected shape ({size},) or (m, {size}), got {array.shape}.")
    if not np.all(np.isfinite(array)):
        where = np.argwhere(~np.isfinite(array))[0].tolist()
        raise KernelError(f"{function}: {name}{where}: expected a finite number, got {array[tuple(where)]}.")
    return array


def _finite(function: str, result: Floats) -> Floats:
    """Return a result; KernelError for a number that is not finite."""
    flat = result.ravel()
    if np.isfinite(flat).all():
        return result
    place = np.argwhere(~np.isfinite(result))[0].tolist()
    raise KernelError(
        f"{function}: expected a finite result, got {result[tuple(place)]} at {place}. An argument is too large, or "
        "the robot is not physical: check_robot of vdfmu.arm.robot lists its problems."
    )
