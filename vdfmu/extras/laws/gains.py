"""State-feedback gains that are optimal at a pose: the linear-quadratic regulator of the sampled arm."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from vdfmu.arm.robot import Robot, robot_argument
from vdfmu.base.arrays import Floats
from vdfmu.base.errors import UsageError
from vdfmu.base.state_space import Linear, held
from vdfmu.study.analysis.arm_space import fast_states, linearize

_FED_BACK = ("q", "q_dot", "kappa", "kappa_dot")


class StateGains(NamedTuple):
    """Gains of the unit StateFeedback, named like its parameters, (n, n) each, link-side."""

    K_q: Floats
    K_q_dot: Floats
    K_kappa: Floats
    K_kappa_dot: Floats


def state_gains(
    robot: Robot,
    q: npt.ArrayLike,
    *,
    error: npt.ArrayLike,
    rate: npt.ArrayLike,
    torque: npt.ArrayLike,
    step: float = 1e-3,
) -> StateGains:
    """Gains that minimise the sum over all samples of ``|e / error|^2 + |kappa_dot / rate|^2 + |tau / torque|^2``.

    e is the error of the links. The arm is linearised at rest at a pose, without dry friction, and its motor torques
    tau are held over a step without any other delay. By Bryson's rule the three arguments are magnitudes that count as
    equally bad. Gains that are optimal at a pose need not be stable elsewhere; a small `rate` damps the rotors
    everywhere. `vdfmu linear` prints the margins along a run.

    Parameters
    ----------
    robot : Robot
        Robot without options whose states cannot be measured, such as hysteresis.
    q : (n,) [rad or m]
        Positions of the joints.
    error : (n,) or float [rad or m]
        Errors of the links.
    rate : (n,) or float [rad/s or m/s]
        Velocities of the rotors, divided by ell.
    torque : (n,) or float [N m], motor-side
        Torques of the motors, in addition to the torques that hold the arm.
    step : float [s]

    Raises
    ------
    UsageError
        See :func:`vdfmu.linearize`; for weights that are not above 0, and for a robot with other states.
    """
    from scipy.linalg import solve_discrete_are

    robot = robot_argument(robot)
    n = robot.n
    numbers = {"error": error, "rate": rate, "torque": torque, "step": step}
    if wrong := [name for name, x in numbers.items() if not (np.asarray(x) > 0.0).all()]:
        raise UsageError(f"state_gains: {', '.join(wrong)}: expected numbers above 0.")
    arm = linearize(robot, at=q)
    fast = fast_states(arm.states, dry=False)
    rows: Any = [arm.outputs.index(f"{name}[{i + 1}]") for name in _FED_BACK for i in range(n)]
    if len(fast) != len(rows):
        more = {arm.states[i].partition("[")[0] for i in fast} - {"q", "q_dot", "kappa_dot", "tau_s"}
        raise UsageError(f"state_gains: {robot.name}: expected no states without feedback, got {', '.join(more)}.")
    T = arm.C[np.ix_(rows, fast)]  # from states with spring torques to states with rotor positions
    A = T @ np.linalg.solve(T.T, arm.A[np.ix_(fast, fast)].T).T
    F, G = held(Linear(A, T @ arm.B[fast, :n]), step)
    weights = [np.broadcast_to(1.0 / np.square(x), n) for x in (error, np.inf, np.inf, rate)]  # as _FED_BACK
    Q, R = np.diag(np.concatenate(weights)), np.diag(np.broadcast_to(1.0 / np.square(torque), n))
    P = solve_discrete_are(F, G, Q, R)
    K = np.linalg.solve(R + G.T @ P @ G, G.T @ P @ F)
    return StateGains(*np.hsplit(robot.ell[:, None] * K, 4))
