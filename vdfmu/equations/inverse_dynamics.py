"""Inverse dynamics of the links by virtual decomposition: Eq. (44)-(47), and the rotors' reaction on them, (11)."""

from __future__ import annotations

from typing import Any

import numpy as np

from vdfmu.equations.flexible_joint import rotor_forces, rotor_transform
from vdfmu.equations.kinematics import Motion, gravity_in_links, link_motion
from vdfmu.equations.rigid_body import link_body, net_force
from vdfmu.equations.spatial import force_transform, joint_axis
from vdfmu.scalar.generic import zeros

__all__ = ["inverse_dynamics", "joint_torques", "link_forces", "tool_transform"]


def tool_transform(robot: Any) -> np.ndarray:
    """Force transformation from the end-effector frame {O} to {B_n}, the identity for the paper's arm."""
    return force_transform(np.eye(3), robot.tool_offset)


def link_forces(
    robot: Any, motion: Motion, F_e: np.ndarray | None = None, F_Dk: list[np.ndarray] | None = None
) -> list[np.ndarray]:
    """Force and torque on every driven cutting point, Eq. (44)-(47).

    Deviation: (46) leaves out the rotor's reaction on its base, ``U_BD F_Dk`` of (11); here it is added.

    Parameters
    ----------
    F_e : (6,) [N, N m] wrench of the arm on its surroundings, in {O} ({B_6} in the paper); None is 0.
    F_Dk : n times (6,) [N, N m] force from the base to every rotor, in {D_i}; None is 0.

    Returns
    -------
    F_B : n times (6,) [N, N m] in {B_i}
    """
    n = robot.n
    g_B = gravity_in_links(robot, motion.U_AB)
    F_B: list[np.ndarray] = [np.zeros(6)] * n
    for i in reversed(range(n)):
        F_B[i] = net_force(*link_body(robot, i), g_B[i], motion.V_B[i], motion.V_B_dot[i])
        if i == n - 1:
            if F_e is not None:
                F_B[i] = F_B[i] + tool_transform(robot) @ F_e
        else:
            F_B[i] = F_B[i] + motion.U_AB[i + 1] @ F_B[i + 1]  # (46)
            if F_Dk is not None:
                F_B[i] = F_B[i] + rotor_transform(robot, i + 1) @ F_Dk[i + 1]  # (11)
    return F_B


def joint_torques(robot: Any, F_B: list[np.ndarray]) -> np.ndarray:
    """Component of every F_B along its joint axis, ``z.T @ F_B``: (n,) [N m or N], link-side."""
    tau = zeros((robot.n,), *F_B)
    for i in range(robot.n):
        tau[i] = joint_axis(robot.joint_types[i]) @ F_B[i]
    return tau


def inverse_dynamics(
    robot: Any,
    q: np.ndarray,
    q_dot: np.ndarray,
    q_ddot: np.ndarray,
    F_e: np.ndarray | None = None,
    rotors: tuple[Any, Any] | None = None,
) -> np.ndarray:
    """Joint torques of the rigid arm for a given motion, Eq. (29)-(31) and (44)-(47). The cost is O(n).

    Parameters
    ----------
    q, q_dot, q_ddot : (n,) [rad or m, and per s, s2]
    F_e : (6,) [N, N m] wrench on the surroundings in {O}
    rotors : (kappa_dot, kappa_ddot), each (n,), optional
        Motion of rotors whose reaction on the links counts, Eq. (11); without it the links are alone.

    Returns
    -------
    tau : (n,) [N m or N], link-side, without friction
    """
    motion = link_motion(robot, q, q_dot, q_ddot)
    F_Dk = None if rotors is None else rotor_forces(robot, motion, *rotors)
    return joint_torques(robot, link_forces(robot, motion, F_e, F_Dk))
