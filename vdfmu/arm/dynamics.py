"""Kinematics and dynamics of the rigid links, from the traced functions: the Python API of the equations."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt

from vdfmu.arm.kernel import Kernel
from vdfmu.arm.robot import Robot
from vdfmu.arm.robot.robot import robot_argument
from vdfmu.base.arrays import Floats
from vdfmu.base.option import checks_types

_NO_WRENCH = np.zeros(6)


@lru_cache(maxsize=32)
def _kernel(robot: Robot) -> Kernel:
    return Kernel(robot_argument(robot))  # robots are immutable and hash by identity


def inverse_dynamics(
    robot: Robot, q: npt.ArrayLike, q_dot: npt.ArrayLike, q_ddot: npt.ArrayLike, F_e: npt.ArrayLike | None = None
) -> Floats:
    """Joint torques of the rigid arm for a given motion, Eq. (29)-(31) and (44)-(47), without friction.

    The drives must supply these torques; those of [joints.counterbalance] are already subtracted.

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
    >>> vdfmu.dynamics.inverse_dynamics(robot, [0] * 6, [0] * 6, [0] * 6).round(3)
    array([ 0.   , 31.884, 13.049,  0.   ,  2.943,  0.   ])
    """
    return _under_wrench(robot, "inverse_dynamics", (q, q_dot, q_ddot), F_e)


def forward_dynamics(
    robot: Robot, q: npt.ArrayLike, q_dot: npt.ArrayLike, tau: npt.ArrayLike, F_e: npt.ArrayLike | None = None
) -> Floats:
    """Joint accelerations of the rigid arm by the articulated recursion, Eq. (44)-(47) solved for them.

    The inverse of :func:`inverse_dynamics`, with its errors.

    Parameters
    ----------
    robot : Robot
    q, q_dot : (n,) or (m, n) [rad or m, and per s]
        One state or a batch of m; a single row goes with a batch of the others.
    tau : (n,) or (m, n) [N m or N], link-side torques of the drives, to which those of counterbalances are added
    F_e : (6,) or (m, 6) [N, N m], optional
        Wrench that the arm exerts on its surroundings, in {O}.

    Returns
    -------
    q_ddot : (n,) or (m, n) [rad/s2 or m/s2]
    """
    return _under_wrench(robot, "forward_dynamics", (q, q_dot, tau), F_e)


def gravity_torque(robot: Robot, q: npt.ArrayLike) -> Floats:
    """Joint torques that hold the rigid arm at rest against gravity, with counterbalances, Eq. (44)-(47) with (62).

    Parameters
    ----------
    robot : Robot
    q : (n,) or (m, n) [rad or m]
        One position or a batch of m; errors: see :func:`inverse_dynamics`.

    Returns
    -------
    G : (n,) or (m, n) [N m or N], link-side
    """
    rest = np.zeros(robot_argument(robot).n)
    return inverse_dynamics(robot, q, rest, rest)


def mass_matrix(robot: Robot, q: npt.ArrayLike) -> Floats:
    """Mass matrix of the rigid arm by the mapping matrices (37)-(43), without the rotors.

    Parameters
    ----------
    robot : Robot
    q : (n,) or (m, n) [rad or m]
        One position or a batch of m; errors: see :func:`inverse_dynamics`.

    Returns
    -------
    M : (n, n) or (m, n, n) [kg m2, kg m, kg]
        Symmetric positive definite; ``M @ q_ddot`` are link-side torques.
    """
    n = robot_argument(robot).n
    return _at_position(robot, "mass_matrix", q, (n, n))


def jacobian(robot: Robot, q: npt.ArrayLike) -> Floats:
    """Jacobian of the end effector, Eq. (37)-(38): ``V_O = J_q @ q_dot``.

    Parameters
    ----------
    robot : Robot
    q : (n,) or (m, n) [rad or m]
        One position or a batch of m; errors: see :func:`inverse_dynamics`.

    Returns
    -------
    J_q : (6, n) or (m, 6, n) [m, rad, and per rad or m]
        Linear part first, in the end-effector frame {O}; ``J_q.T @ F_e`` are the torques for a wrench in {O}.
    """
    return _at_position(robot, "jacobian", q, (6, robot_argument(robot).n))


def forward_kinematics(robot: Robot, q: npt.ArrayLike) -> tuple[Floats, Floats]:
    """Pose of the end-effector frame {O} in {I}, by the product of (34)-(36).

    Parameters
    ----------
    robot : Robot
    q : (n,) or (m, n) [rad or m]
        One position or a batch of m; errors: see :func:`inverse_dynamics`.

    Returns
    -------
    p_O : (3,) or (m, 3) [m]
        Position of the origin of {O} in {I}.
    R_O : (3, 3) or (m, 3, 3)
        Rotation of {O} in {I}: ``R_O @ v`` transforms a vector from {O} to {I}.
    """
    pose = _at_position(robot, "forward_kinematics", q, (12,))
    return pose[..., :3], pose[..., 3:].reshape(*pose.shape[:-1], 3, 3)


@checks_types
def _under_wrench(robot: Robot, name: str, joints: Sequence[npt.ArrayLike], F_e: npt.ArrayLike | None) -> Floats:
    """Call a traced function of three joint arrays and a wrench."""
    kernel = _kernel(robot)
    return kernel.rows(name, (*joints, _NO_WRENCH if F_e is None else F_e), (*[kernel.robot.n] * 3, 6))


@checks_types
def _at_position(robot: Robot, name: str, q: Any, shape: tuple[int, ...]) -> Floats:
    """Call a traced function of only `q`, which `rows` checks, with a result of `shape`."""
    kernel = _kernel(robot)
    flat = kernel.rows(name, (q,), (kernel.robot.n,))
    return flat.reshape(*flat.shape[:-1], *shape)
