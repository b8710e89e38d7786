"""Jacobian and velocity mapping matrices: Eq. (37)-(43), and the dynamics that follow from them."""

from __future__ import annotations

from typing import Any

import numpy as np

from vdfmu.arm.equations.kinematics import joint_transforms, tool_transform
from vdfmu.arm.equations.rigid_body import mass_matrix as body_mass_matrix
from vdfmu.arm.equations.spatial import joint_axis
from vdfmu.compiler.scalar import zeros


def velocity_mapping(robot: Any, q: np.ndarray) -> np.ndarray:
    """Return the mapping matrix J_ba from joint velocities to ``V_b = [V_O, V_B1, .., V_Bn]``, Eq. (40)-(41).

    Deviation: the paper gives its size as 72 x 6; it is 6 (n + 1) x n, 42 x 6 for six joints.
    """
    n = robot.n
    U_AB = joint_transforms(robot, q)
    J_ba = zeros((6 * (n + 1), n), q)
    for j in range(n):
        column = joint_axis(robot.joint_types[j])
        for i in range(j, n):
            if i > j:
                column = U_AB[i].T @ column  # U_(B_j B_i).T z
            J_ba[6 * (i + 1) : 6 * (i + 2), j] = column
        J_ba[:6, j] = tool_transform(robot).T @ column
    return J_ba


def jacobian(robot: Any, q: np.ndarray) -> np.ndarray:
    """Jacobian J_q of the end effector, Eq. (37)-(38): ``V_O = J_q @ q_dot`` with V_O in {O}.

    Deviation: (38) is printed with a transpose around the whole matrix; its columns are ``U_(B_i O).T z``.
    """
    return velocity_mapping(robot, q)[:6]


def joint_space_jacobian(robot: Any, q: np.ndarray) -> np.ndarray:
    """Inverse J_a of the Jacobian, Eq. (39), for six joints away from singular positions (floats only).

    LinAlgError if J_q is singular, as at q_5 = 0, the start of trajectory (57): (39) does not exist there. ValueError
    if the arm does not have six joints.
    """
    J_q = jacobian(robot, q)
    if J_q.shape != (6, 6):
        raise ValueError(f"Eq. (39) needs a square Jacobian, so six joints; robot {robot.name!r} has {robot.n}.")
    if np.linalg.cond(J_q) > 1.0 / np.finfo(float).eps:
        raise np.linalg.LinAlgError("J_q is singular: Eq. (39) cannot be solved at this position.")
    return np.linalg.inv(J_q)


def extended_jacobian(robot: Any, q: np.ndarray) -> np.ndarray:
    """Return the extended Jacobian of (42)-(43): ``[V_O, q_dot, V_B1, .., V_B6] = J_e @ V_O``, (48, 6)."""
    J_a = joint_space_jacobian(robot, q)
    J_ba = velocity_mapping(robot, q)
    return np.vstack([J_ba[:6], np.eye(6), J_ba[6:]]) @ J_a


def joint_space_mass_matrix(robot: Any, q: np.ndarray) -> np.ndarray:
    """Mass matrix of the rigid arm by the mapping matrices, ``M = J_ba.T diag(M_B) J_ba``: (n, n) [kg m2, kg m, kg]."""
    J_ba = velocity_mapping(robot, q)
    M = np.zeros((robot.n, robot.n))
    for i in range(robot.n):
        J_i = J_ba[6 * (i + 1) : 6 * (i + 2)]
        M = M + J_i.T @ body_mass_matrix(*robot.body(i)) @ J_i
    return M
