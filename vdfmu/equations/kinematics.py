"""Positions, velocities and accelerations of the links: Eq. (29)-(36)."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from vdfmu.equations.spatial import cross_motion, force_transform, joint_axis, rotation_z

__all__ = [
    "Motion",
    "end_effector_pose",
    "gravity_in_links",
    "joint_rotation",
    "joint_transforms",
    "link_motion",
]


class Motion(NamedTuple):
    """Motion of all links: force transformations U_AB[i] (32), velocities V_B[i] (29)-(31) and V_B_dot[i]."""

    U_AB: list[np.ndarray]
    V_B: list[np.ndarray]
    V_B_dot: list[np.ndarray]


def joint_rotation(robot: Any, i: int, q_i: Any) -> np.ndarray:
    """Rotation of {B_i} in {T_i}, the upper left block of Eq. (34)-(36).

    Deviation: the paper labels these matrices with "I"; they are relative to the previous link, in {T_i}.
    {T_i} is {B_(i-1)} moved to the joint without turning, so its z axis is not the axis of joint i as the
    paper says.
    """
    if robot.joint_types[i] == "prismatic":
        return robot.rotation[i]
    return robot.rotation[i] @ rotation_z(q_i)


def joint_placements(robot: Any, q: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """Rotation and origin of every {B_i} in {B_(i-1)}, {B_0} = {I}, from Eq. (34)-(36).

    Parameters
    ----------
    q : (n,) [rad or m] joint positions

    Returns
    -------
    n times (R_AB (3, 3), p_AB (3,) [m])
    """
    placements = []
    for i in range(robot.n):
        p_AB = robot.offset[i]
        if robot.joint_types[i] == "prismatic":
            p_AB = p_AB + robot.rotation[i][:, 2] * q[i]
        placements.append((joint_rotation(robot, i, q[i]), p_AB))
    return placements


def joint_transforms(robot: Any, q: np.ndarray) -> list[np.ndarray]:
    """Force transformations U_AB from every {B_i} to {B_(i-1)}: the product that (31) forms.

    ``U_(B_(i-1) B_i) = U_(B_(i-1) T_i) @ U_(T_i B_i)``: first a pure translation, then the joint.

    Parameters
    ----------
    q : (n,) [rad or m] joint positions
    """
    return [force_transform(R_AB, p_AB) for R_AB, p_AB in joint_placements(robot, q)]


def link_motion(robot: Any, q: np.ndarray, q_dot: np.ndarray, q_ddot: np.ndarray) -> Motion:
    """Velocities of all links by Eq. (29)-(31), and their derivatives.

    Deviation: (30)-(31) are printed for i = 2..5; they run to i = n. The derivative of (31),
    ``V_B_dot = z q_ddot + U.T V_A_dot + (V_B x) z q_dot``, is not printed in the paper.

    Parameters
    ----------
    q, q_dot, q_ddot : (n,) [rad or m, and per s, s2]
    """
    U_AB = joint_transforms(robot, q)
    V_B: list[np.ndarray] = []
    V_B_dot: list[np.ndarray] = []
    for i in range(robot.n):
        z = joint_axis(robot.joint_types[i])
        if i == 0:
            V_B.append(z * q_dot[0])
            V_B_dot.append(z * q_ddot[0])
        else:
            V_B.append(z * q_dot[i] + U_AB[i].T @ V_B[i - 1])
            V_B_dot.append(z * q_ddot[i] + U_AB[i].T @ V_B_dot[i - 1] + cross_motion(V_B[i]) @ (z * q_dot[i]))
    return Motion(U_AB, V_B, V_B_dot)


def gravity_in_links(robot: Any, U_AB: list[np.ndarray]) -> list[np.ndarray]:
    """Vector g of (62) in every link frame, ``R_BI @ g`` : n times (3,) [m/s2]."""
    g_B = []
    g = robot.gravity
    for U in U_AB:
        g = U[:3, :3].T @ g
        g_B.append(g)
    return g_B


def end_effector_pose(robot: Any, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Pose of the end-effector frame {O} in {I}, by the product of (34)-(36).

    Returns
    -------
    p_O : (3,) [m] position of the origin of {O} in {I}
    R_O : (3, 3) rotation of {O} in {I}
    """
    p, R = np.zeros(3), np.eye(3)
    for R_AB, p_AB in joint_placements(robot, q):
        p = p + R @ p_AB
        R = R @ R_AB
    return p + R @ robot.tool_offset, R
