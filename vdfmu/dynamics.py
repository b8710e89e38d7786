"""Inverse and forward dynamics of the rigid links, by the generated functions: the Python face of the equations."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import numpy.typing as npt

from vdfmu.kernel import Kernel
from vdfmu.model import Robot
from vdfmu.model.robot import robot_argument

__all__ = ["forward_dynamics", "inverse_dynamics"]


@lru_cache(maxsize=32)
def _kernel(robot: Robot) -> Kernel:
    return Kernel(robot_argument(robot))  # robots are immutable and hash by identity


def inverse_dynamics(
    robot: Robot,
    q: npt.ArrayLike,
    q_dot: npt.ArrayLike,
    q_ddot: npt.ArrayLike,
    F_e: npt.ArrayLike | None = None,
) -> npt.NDArray[np.float64]:
    """Joint torques of the rigid arm for a given motion, Eq. (29)-(31) and (44)-(47), without friction.

    Parameters
    ----------
    robot : Robot
    q, q_dot, q_ddot : (n,) or (m, n) [rad or m, and per s, s2]
        One state or a batch of m; a single row goes with a batch of the others.
    F_e : (6,) or (m, 6) [N, N m], optional
        Wrench that the arm exerts on its surroundings, in the end-effector frame {O}; it adds to the torques.

    Returns
    -------
    tau : (n,) or (m, n) [N m or N], link-side

    Raises
    ------
    KernelError
        For a wrong shape or a number that is not finite.

    Examples
    --------
    >>> robot = vdfmu.load_robot("manipulator_6dof")
    >>> vdfmu.inverse_dynamics(robot, [0] * 6, [0] * 6, [0] * 6).round(3)
    array([ 0.   , 31.884, 13.049,  0.   ,  2.943,  0.   ])
    """
    kernel = _kernel(robot)
    n = kernel.robot.n
    wrench = np.zeros(6) if F_e is None else F_e
    return kernel.rows("inverse_dynamics", (q, q_dot, q_ddot, wrench), (n, n, n, 6))


def forward_dynamics(
    robot: Robot,
    q: npt.ArrayLike,
    q_dot: npt.ArrayLike,
    tau: npt.ArrayLike,
    F_e: npt.ArrayLike | None = None,
) -> npt.NDArray[np.float64]:
    """Joint accelerations of the rigid arm, by the articulated recursion; the inverse of :func:`inverse_dynamics`.

    Parameters
    ----------
    robot : Robot
    q, q_dot : (n,) or (m, n) [rad or m, per s]
    tau : (n,) or (m, n) [N m or N], link-side
    F_e : (6,) or (m, 6) [N, N m], optional
        Wrench on the surroundings in {O}.

    Returns
    -------
    q_ddot : (n,) or (m, n) [rad/s2 or m/s2]

    Raises
    ------
    KernelError
        For a wrong shape or a number that is not finite.
    """
    kernel = _kernel(robot)
    n = kernel.robot.n
    wrench = np.zeros(6) if F_e is None else F_e
    return kernel.rows("forward_dynamics", (q, q_dot, tau, wrench), (n, n, n, 6))
