"""Traced functions of a robot and their calls on arrays, compiled for large batches."""

from __future__ import annotations

import math
import threading
from collections import Counter
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

_WORTH = 50_000
"""Number of states in batches from which a function is compiled, because compiling takes as long as evaluating
these."""


def _of_drives(dynamics: Callable[..., Any]) -> Callable[..., Any]:
    return lambda robot, q, *rest: dynamics(robot, q, *rest) - link_torques(robot, q)


def _driven(robot: Any, q: Any, q_dot: Any, tau: Any, F_e: Any) -> Any:
    return forward_dynamics(robot, q, q_dot, tau + link_torques(robot, q), F_e)


FUNCTIONS: dict[str, tuple[tuple[str, ...], str, Callable[..., Any]]] = {
    "inverse_dynamics": (("q", "q_dot", "q_ddot", "F_e"), "tau", _of_drives(inverse_dynamics)),
    "newton_euler": (("q", "q_dot", "q_ddot", "F_e"), "tau", _of_drives(newton_euler)),  # for comparison, section IV-A
    "forward_dynamics": (("q", "q_dot", "tau", "F_e"), "q_ddot", _driven),
    "forward_kinematics": (("q",), "pose", lambda *a: np.concatenate([np.ravel(x) for x in end_effector_pose(*a)])),
    "jacobian": (("q",), "J_q", jacobian),
    "mass_matrix": (("q",), "M", joint_space_mass_matrix),
}
"""Name to inputs, output and equation. The last input is always ``p``, the run-time parameters of the robot."""


def trace(name: str, robot: Robot) -> ca.Function:
    """Trace one of `FUNCTIONS` for the structure of a robot."""
    names, result, equation = FUNCTIONS[name]
    symbols, p = robot.symbolic()
    inputs = {n: ca.SX.sym(n, 6 if n == "F_e" else robot.n) for n in names}
    arguments = [from_sx(v) for v in inputs.values()]
    return traced_function(name, inputs | {"p": p}, {result: to_sx(equation(symbols, *arguments))})


class Kernel(Functions):
    """The functions of :data:`FUNCTIONS` for one robot structure; `p` has the values of its run-time parameters."""

    def __init__(self, robot: Robot, cache: Path | None | str = "default") -> None:
        super().__init__(robot.key(), cache)
        self.robot = robot
        self.p = robot.values()
        self._prepared = threading.local()
        self._lock = threading.Lock()
        self._states: Counter[str] = Counter()
        self._compiled: dict[str, Any] = {}

    def names(self) -> Collection[str]:
        """Names of the functions, without derivatives."""
        return FUNCTIONS.keys()

    def made(self, name: str) -> ca.Function:
        """Trace one of :meth:`names`."""
        return trace(name, self.robot)

    def rows(self, name: str, arguments: Sequence[npt.ArrayLike], sizes: Sequence[int]) -> Floats:
        """Call a function with one result on arrays (m,) or batches (k, m), with this robot's parameters."""
        prepared = getattr(self._prepared, name, None)
        if prepared is None:
            prepared = _Prepared(self.casadi_function(name), sizes, self.p)
            setattr(self._prepared, name, prepared)
        if prepared.takes(arguments):
            prepared.run()
            return _finite(name, prepared.result.copy())
        names = list(prepared.buffers)
        arrays = [_checked(name, a, v, size) for a, v, size in zip(names, arguments, sizes, strict=True)]
        batches = {len(a) for a in arrays if a.ndim == 2}
        if len(batches) > 1:
            raise KernelError(f"{name}: batches of different lengths {sorted(batches)}: expected one length.")
        out = np.empty((batches.pop() if batches else 1, len(prepared.result)))
        with self._lock:
            self._states[name] += len(out)
            if name not in self._compiled and self._states[name] >= _WORTH:
                from vdfmu.compiler.c.loaded import compiled_rows  # takes long to import

                self._compiled[name] = compiled_rows(self.casadi_function(name))
        run = self._compiled.get(name)
        if run is None:
            self.calculate(prepared, arrays, out)
        else:
            run([*arrays, self.p], out)
        _finite(name, out)
        return out if any(array.ndim == 2 for array in arrays) else out[0]

    def calculate(self, prepared: _Prepared, arrays: Sequence[Floats], out: Floats) -> None:
        """Calculate the rows of `out` from `arrays`, each a batch or a single row, without the compiler."""
        rows = np.hstack([np.broadcast_to(a, (len(out), a.shape[-1])) for a in arrays])
        for result, row in zip(out, rows, strict=True):
            prepared.all[:] = row
            prepared.run()
            result[:] = prepared.result


class _Prepared:
    """A function with one result and buffers for one state; each thread has its own."""

    def __init__(self, function: ca.Function, sizes: Sequence[int], p: Floats) -> None:
        self.all = np.zeros(sum(sizes))
        parts = np.split(self.all, np.cumsum(sizes)[:-1])
        self.buffers = dict(zip(function.name_in(), parts, strict=False))
        """Arguments except for the parameters, contiguous in `all`."""
        self._function = KernelFunction(function, {**self.buffers, "p": p})
        (self.result,), self.run = self._function.results.values(), self._function.run
        self._places = [(buffer, buffer.shape) for buffer in parts]

    def takes(self, arguments: Sequence[npt.ArrayLike]) -> bool:
        """Copy the arguments of one state into the buffers; return whether they fit and their squares are finite."""
        try:
            for (buffer, shape), argument in zip(self._places, arguments, strict=True):
                array = np.asarray(argument, dtype=float)
                if array.shape != shape:
                    return False
                buffer[:] = array
        except (TypeError, ValueError, OverflowError):
            return False
        return math.isfinite(self.all.dot(self.all))


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
