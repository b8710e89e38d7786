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

from collections.abc import Callable, Iterator, Mapping
from itertools import islice, pairwise
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.integrate import DOP853, LSODA

from vdfmu.errors import UsageError, VdfmuError
from vdfmu.kernel import Kernel
from vdfmu.kernel.structure import parameters
from vdfmu.model import Robot

__all__ = ["BLOCK", "REFERENCE_OF", "Reference", "reference", "reference_blocks"]

Floats = npt.NDArray[np.float64]

REFERENCE_OF = {"gauss-seidel": "sampled", "jacobi": "sampled-delayed"}
"""Master algorithm to the reference that it must match."""

BLOCK = 1024
"""Communication points of a stretch: what is kept in memory of a reference and of the run that it is compared with."""

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


def reference_blocks(
    name: str,
    robot: Robot,
    values: Mapping[str, Mapping[str, Any]],
    *,
    step: float,
    stop: float,
    progress: Callable[[int, int], None] | None = None,
) -> Iterator[Reference]:
    """Compute one of the three references in stretches of `BLOCK` communication points, the last of what is left.

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
    if name not in ("sampled", "sampled-delayed", "continuous"):
        raise UsageError(f"no reference {name!r}; there are sampled, sampled-delayed and continuous.")
    loop = _Loop(robot, values)
    m = round(stop / step)
    t: Floats = step * np.arange(m + 1, dtype=np.float64)
    rows = _continuous(loop, t) if name == "continuous" else _sampled(loop, t, name == "sampled-delayed")
    for first in range(0, m + 1, BLOCK):
        x, tau, tau_m = (np.array(part) for part in zip(*islice(rows, BLOCK), strict=True))
        yield Reference(name, t[first : first + BLOCK], x, tau, tau_m)
        if progress is not None:
            progress(min(first + BLOCK, m), m)


def reference(
    name: str, robot: Robot, values: Mapping[str, Mapping[str, Any]], *, step: float, stop: float
) -> Reference:
    """Compute one of the three references as a whole; see :func:`reference_blocks`."""
    blocks = list(reference_blocks(name, robot, values, step=step, stop=stop))
    return Reference(name, *(np.concatenate(parts) for parts in list(zip(*blocks, strict=True))[1:]))


Row = tuple[Floats, Floats, Floats]
"""State, torque and feedforward torque at a communication point: x (4 n,), tau and tau_m (n,)."""


def _sampled(loop: _Loop, t: Floats, delayed: bool) -> Iterator[Row]:
    """Solve the sampled loop: zero-order hold, and scipy's DOP853 for the plant between the samples."""
    x, h = loop.x_0, float(t[-1])
    feedforward = loop.feedforward(0.0, x)
    tau = loop.torque(x, feedforward)
    yield x, tau, feedforward[0]
    for t_0, t_1 in pairwise(map(float, t)):
        before, held = feedforward, tau
        feedforward = loop.feedforward(t_0, x)
        # delayed: the controller has the feedforward of one step ago, the plant the torque of one step ago
        tau = loop.torque(x, before if delayed else feedforward)
        x, h = _advance(loop, t_0, t_1, x, held if delayed else tau, h)
        yield x, tau, feedforward[0]


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


def _continuous(loop: _Loop, t: Floats) -> Iterator[Row]:
    """Solve the loop without sampling by scipy's LSODA; it is read at the communication points."""

    def closed_loop(time: float, x: Floats) -> Floats:
        return loop.plant(x, loop.torque(x, loop.feedforward(time, x)))

    def row(time: float, x: Floats) -> Row:
        feedforward = loop.feedforward(time, x)
        return x, loop.torque(x, feedforward), feedforward[0]

    yield row(0.0, loop.x_0)
    solver = LSODA(closed_loop, 0.0, loop.x_0, t[-1], rtol=_RTOL, atol=_ATOL, max_step=0.05)
    k = 1
    while solver.status == "running":
        message = solver.step()
        if message is not None:
            raise VdfmuError(f"The continuous reference failed at t = {solver.t:.9g} s: {message}")
        solution = solver.dense_output()
        end = int(np.searchsorted(t, solver.t, side="right"))
        for time in t[k:end].tolist():
            yield row(time, solution(time))
        k = end
