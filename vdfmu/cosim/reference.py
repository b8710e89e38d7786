"""References for a co-simulation: the closed loop solved by scipy, without FMI and without a master.

Three references say what the answer is (times in communication points t_k, step h, zero-order hold of the torque):

- ``sampled``: the torque of [t_k, t_k+1] is computed from everything at t_k. What ``gauss-seidel`` must give.
- ``sampled-delayed``: every unit sees the others' outputs one sample late, so that feedback acts one sample late and
  feedforward, which passes through the controller, two. What ``jacobi`` must give.
- ``continuous``: no sampling. What both tend to as the step shrinks.

The right-hand side is the traced plant equation, which the tests hold against the plain numpy equations; the solver is
scipy's, not ours.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.integrate import DOP853, solve_ivp

from vdfmu.errors import UsageError, VdfmuError
from vdfmu.kernel import Kernel
from vdfmu.kernel.structure import parameters
from vdfmu.model import Robot

__all__ = ["REFERENCE_OF", "Reference", "continuous_reference", "reference", "sampled_reference"]

Floats = npt.NDArray[np.float64]

REFERENCE_OF = {"gauss-seidel": "sampled", "jacobi": "sampled-delayed"}
"""Master algorithm to the reference that it must match."""

_RTOL, _ATOL = 1e-11, 1e-12
"""Tolerances of scipy: four orders below the 1e-7 rad that a co-simulation may differ by."""


class Reference(NamedTuple):
    """Solution on the communication points: t (m,), x (m, 4 n), tau and tau_m (m, n) motor-side.

    Row k holds the torques of the step that ends at t_k, as the rows of a co-simulation do; row 0 those at the start.
    """

    name: str
    t: Floats
    x: Floats
    tau: Floats
    tau_m: Floats

    @property
    def q(self) -> Floats:
        """Link positions (m, n)."""
        return self.x[:, : self.tau.shape[1]]


class _Loop:
    """The four units as functions: desired motion, feedforward, feedback, plant."""

    def __init__(self, robot: Robot, values: Mapping[str, Mapping[str, Any]]) -> None:
        self.n = n = robot.n
        kernel = Kernel(robot)

        def group(unit: str, name: str, size: int = n) -> Floats:
            return np.array([values[unit].get(f"{name}[{i + 1}]", 0.0) for i in range(size)])

        def p(unit: str) -> Floats:
            return np.array([values[unit][parameter.name] for parameter in parameters(robot)])

        self._trajectory = kernel.function("trajectory")
        for name in ("T", "t_start"):
            self._trajectory.args[name][0] = values["trajectory"][name]
        for name in ("q_start", "q_end"):
            self._trajectory.args[name][:] = group("trajectory", name)
        desired = self._trajectory.results  # the others read it in place
        mode = values["feedforward"]["mode"]
        self._feedforward = kernel.function(
            "feedforward_vdc" if mode else "feedforward_inverse", p=p("feedforward"), **desired
        )
        self._feedforward.args["F_e_d"][:] = group("feedforward", "F_e_d", 6)
        if mode:
            for name in ("Lambda", "K_V", "k_vq", "k_vkappa"):
                self._feedforward.args[name][:] = group("feedforward", name)
        self._kappa_dot_d = np.zeros(n)  # what the controller has, which may be late
        velocity = values["controller"]["velocity"]
        self._pd = kernel.function(
            "pd_control", q_d=desired["q_d"], velocity_d=desired["q_d_dot"] if velocity else self._kappa_dot_d
        )
        for name in ("K_p", "K_v", "tau_max", "ell"):
            self._pd.args[name][:] = group("controller", name)
        self._derivative = kernel.function("plant_derivative", p=p("plant"), F_e=group("plant", "F_e", 6))
        F_e = self._derivative.args["F_e"]
        self._measured = {"q": slice(0, n), "q_dot": slice(n, 2 * n), "kappa_dot": slice(2 * n, 3 * n)}
        self._velocity = self._measured["q_dot" if velocity == 1 else "kappa_dot"]

        q, q_dot = group("plant", "q_0"), group("plant", "q_dot_0")
        kappa_dot, tau_s = group("plant", "kappa_dot_0"), group("plant", "tau_s_0")
        if values["plant"].get("equilibrium", True):
            kappa_dot, tau_s = q_dot, np.ravel(kernel.function("equilibrium_torque")(q, F_e, p("plant")))
        self.x_0 = np.concatenate([q, q_dot, kappa_dot, tau_s])

    def feedforward(self, t: float, x: Floats) -> Floats:
        """Feedforward tau_m and kappa_dot_d, (2, n), from the desired motion and the state at `t`."""
        self._trajectory.args["t"][0] = t
        self._trajectory.run()
        if "q" in self._feedforward.args:
            for name, where in self._measured.items():
                self._feedforward.args[name][:] = x[where]
        self._feedforward.run()
        results = self._feedforward.results
        return np.stack([results["tau_m"], results["kappa_dot_d"]])

    def torque(self, x: Floats, feedforward: Floats) -> Floats:
        """Motor torque from the state, with the desired motion of the last call of :meth:`feedforward`."""
        args = self._pd.args
        args["q"][:] = x[: self.n]
        args["velocity"][:] = x[self._velocity]
        args["tau_m"][:], self._kappa_dot_d[:] = feedforward
        self._pd.run()
        return self._pd.results["tau"].copy()

    def plant(self, x: Floats, tau: Floats) -> Floats:
        """Right-hand side of the plant under a constant wrench at the end effector."""
        self._derivative.args["x"][:] = x
        self._derivative.args["tau"][:] = tau
        self._derivative.run()
        return self._derivative.results["x_dot"].copy()


def reference(
    name: str,
    robot: Robot,
    values: Mapping[str, Mapping[str, Any]],
    *,
    step: float,
    stop: float,
    progress: Callable[[int, int], None] | None = None,
) -> Reference:
    """Compute one of the three references on the communication points.

    Parameters
    ----------
    name : "sampled", "sampled-delayed" or "continuous"
    robot : Robot
        Its structure; all numbers are taken from `values`.
    values : mapping of unit to mapping of parameter to value
        As of :func:`vdfmu.ssp.parameters.system_values`; unit ``plant`` may differ from unit ``feedforward``.
    step, stop : float [s]
    progress : callable, optional
        Called with the number of finished steps and their total.
    """
    if name == "continuous":
        return continuous_reference(robot, values, step=step, stop=stop)
    if name not in ("sampled", "sampled-delayed"):
        raise UsageError(f"no reference {name!r}; there are sampled, sampled-delayed and continuous.")
    return sampled_reference(
        robot, values, step=step, stop=stop, delayed=name == "sampled-delayed", progress=progress
    )


def sampled_reference(
    robot: Robot,
    values: Mapping[str, Mapping[str, Any]],
    *,
    step: float,
    stop: float,
    delayed: bool = False,
    progress: Callable[[int, int], None] | None = None,
) -> Reference:
    """Solve the sampled loop: zero-order hold, and scipy's DOP853 for the plant between the samples.

    Parameters and result as in :func:`reference`.
    """
    loop = _Loop(robot, values)
    m = round(stop / step)
    t: Floats = step * np.arange(m + 1, dtype=np.float64)
    x = np.empty((m + 1, 4 * loop.n))
    tau, feedforward = np.empty((m + 1, loop.n)), np.empty((m + 1, 2, loop.n))
    x[0] = loop.x_0
    feedforward[0] = loop.feedforward(0.0, x[0])
    tau[0] = loop.torque(x[0], feedforward[0])
    h = step
    for k in range(m):
        feedforward[k + 1] = loop.feedforward(t[k], x[k])
        # delayed: the controller has the feedforward of one step ago, the plant the torque of one step ago
        tau[k + 1] = loop.torque(x[k], feedforward[k] if delayed else feedforward[k + 1])
        x[k + 1], h = _advance(loop, t[k], t[k + 1], x[k], tau[k] if delayed else tau[k + 1], h)
        if progress is not None and (k + 1) % 100 == 0:
            progress(k + 1, m)
    return Reference("sampled-delayed" if delayed else "sampled", t, x, tau, feedforward[:, 0])


def _advance(loop: _Loop, t_0: float, t_1: float, x: Floats, tau: Floats, h: float) -> tuple[Floats, float]:
    """State at `t_1` and the solver's last full step, which is a good first one for the next interval."""
    solver = DOP853(
        lambda _, y: loop.plant(y, tau), t_0, x, t_1, rtol=_RTOL, atol=_ATOL, first_step=min(h, t_1 - t_0)
    )
    while solver.status == "running":
        message = solver.step()
        if message is not None:
            raise VdfmuError(f"The reference failed at t = {solver.t:.9g} s: {message}")
        h = max(solver.h_abs, 1e-6)
    return solver.y, h


def continuous_reference(
    robot: Robot, values: Mapping[str, Mapping[str, Any]], *, step: float, stop: float
) -> Reference:
    """Solve the loop without sampling by scipy's LSODA; it is read at the communication points.

    Parameters and result as in :func:`reference`.
    """
    loop = _Loop(robot, values)
    m = round(stop / step)
    t: Floats = step * np.arange(m + 1, dtype=np.float64)

    def closed_loop(time: float, x: Floats) -> Floats:
        return loop.plant(x, loop.torque(x, loop.feedforward(time, x)))

    solution = solve_ivp(
        closed_loop, (0.0, t[-1]), loop.x_0, method="LSODA", t_eval=t, rtol=_RTOL, atol=_ATOL, max_step=0.05
    )
    if not solution.success:
        raise VdfmuError(f"The continuous reference failed at t = {solution.t[-1]:.9g} s: {solution.message}")
    x = solution.y.T
    tau, tau_m = np.empty((m + 1, loop.n)), np.empty((m + 1, loop.n))
    for k in range(m + 1):
        feedforward = loop.feedforward(t[k], x[k])
        tau[k], tau_m[k] = loop.torque(x[k], feedforward), feedforward[0]
    return Reference("continuous", t, x, tau, tau_m)
