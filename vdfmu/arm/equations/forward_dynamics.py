"""Forward dynamics of the links by the articulated recursion: Eq. (44)-(47) solved for the accelerations."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from vdfmu.arm.equations.inverse_dynamics import (
    AT_REST,
    NO_WRENCH,
    Base,
    gravity_in_links,
    link_velocities,
    rotor_reaction,
)
from vdfmu.arm.equations.kinematics import joint_placements, joint_transforms, tool_transform
from vdfmu.arm.equations.rigid_body import bias_force, mass_matrix
from vdfmu.arm.equations.spatial import blocks, cross_motion, inward, joint_axis, outward, transform_mass_matrix, whole


class Hanging(NamedTuple):
    """A body attached to a frame, on which it needs the force ``M V_dot + p``, in that frame."""

    M: Any
    """(6, 6) [kg, kg m, kg m2] apparent mass matrix, symmetric."""
    p: Any
    """(6,) [N, N m] bias force, at ``V_dot = 0``."""


class Articulated(NamedTuple):
    """Result of passes 1 and 2 for each link, which lacks only the acceleration of its base."""

    U_AB: list[np.ndarray]
    c_B: list[np.ndarray]
    """Part of V_B_dot that is quadratic in velocities."""
    joints: list[Eliminated]
    arm: Hanging
    """The whole arm as seen at its base, in {S}, without the rotor of the first joint."""
    reaction: Any
    """(6,) [N, N m] force of that rotor on the base, in {S}, or None."""


class Eliminated(NamedTuple):
    """A joint without its acceleration: ``q_ddot = (u - M_z @ a) / d``, with `a` of its link if locked."""

    M_z: np.ndarray
    d: Any
    u: Any


def eliminate(z: np.ndarray, M_B: np.ndarray, p_B: np.ndarray, tau: Any) -> Eliminated:
    """Eliminate the acceleration of a joint with axis `z` and torque `tau` [N m or N], link-side, that carries a body.

    `M_B` (6, 6) is the body's apparent mass, `p_B` (6,) [N, N m] its force at ``V_B_dot = 0``, both in {B}.
    """
    M_z = M_B @ z
    return Eliminated(M_z, z @ M_z, tau - z @ p_B)


def articulated(
    robot: Any,
    q: np.ndarray,
    q_dot: np.ndarray,
    tau: np.ndarray,
    F_e: np.ndarray,
    F_Dk: list[np.ndarray] | None,
    base: Base,
    load: Hanging | None,
) -> Articulated:
    """Eliminate the accelerations link by link, see :func:`forward_dynamics`."""
    n = robot.n
    z = [joint_axis(joint_type) for joint_type in robot.joint_types]

    # pass 1, base to end effector: velocities (31), and the forces at zero joint acceleration (47)
    placements = joint_placements(robot, q)
    U_AB = joint_transforms(robot, q)
    g_B = gravity_in_links(robot, U_AB, base)
    V_B = link_velocities(robot, q, q_dot, base).V_B
    c_B = [cross_motion(V_B[i]) @ (z[i] * q_dot[i]) for i in range(n)]

    # pass 2, end effector to base: eliminate q_ddot_i, pass the remainder to the previous link
    def link(beyond: Any, i: int) -> tuple[Any, Eliminated]:
        force, hanging = beyond
        m_B, r_B, I_B = robot.body(i)
        M_A, p_A = mass_matrix(m_B, r_B, I_B), bias_force(m_B, r_B, I_B, g_B[i], V_B[i])
        p_A = p_A if force is None else p_A + force
        if hanging is not None:
            M_A, p_A = M_A + whole(hanging[0]), p_A + hanging[1]
        joint = eliminate(z[i], M_A, p_A, tau[i])
        arm = handed_on(placements[i], U_AB[i], M_A, p_A, c_B[i], joint)
        reaction = None if F_Dk is None else rotor_reaction(robot, i, F_Dk[i])  # (11)
        return (reaction, (blocks(arm.M), arm.p)), joint

    end = None if load is None else (blocks(load.M), load.p)
    (reaction, arm), joints = inward(link, (tool_transform(robot) @ F_e, end), n)  # (44)
    return Articulated(U_AB, c_B, joints, Hanging(whole(arm[0]), arm[1]), reaction)


def handed_on(
    placement: tuple[np.ndarray, np.ndarray], U_AB: np.ndarray, M_B: Any, p_B: Any, c_B: Any, joint: Eliminated
) -> Hanging:
    """Return the body on a joint as a body attached to the link {A} before it.

    `c_B` is the part of V_B_dot that is quadratic in velocities; other parameters: see :func:`eliminate`.
    """
    M_a = M_B - np.outer(joint.M_z, joint.M_z / joint.d)
    p_a = p_B + M_a @ c_B + joint.M_z * (joint.u / joint.d)
    return Hanging(transform_mass_matrix(*placement, M_a), U_AB @ p_a)


def accelerate(
    z: np.ndarray, U_AB: np.ndarray, V_A_dot: np.ndarray, c_B: np.ndarray, joint: Eliminated
) -> tuple[Any, np.ndarray]:
    """Return the acceleration of a joint [rad/s2 or m/s2] and V_B_dot (6,), from V_A_dot of the previous link."""
    a = U_AB.T @ V_A_dot + c_B
    q_ddot = (joint.u - joint.M_z @ a) / joint.d
    return q_ddot, a + z * q_ddot


def forward_dynamics(
    robot: Any,
    q: np.ndarray,
    q_dot: np.ndarray,
    tau: np.ndarray,
    F_e: np.ndarray = NO_WRENCH,
    F_Dk: list[np.ndarray] | None = None,
    base: Base = AT_REST,
    load: Hanging | None = None,
) -> np.ndarray:
    """Joint accelerations (n,) [rad/s2 or m/s2] of the arm from the articulated recursion, at cost O(n).

    The recursion eliminates V_B_dot from (44)-(47) link by link, from the end effector to the base: all bodies
    beyond link i act on it like one body with mass matrix M_A and force p_A (Featherstone 2008, table 7.1, in the
    paper's notation).

    Parameters
    ----------
    q, q_dot : (n,) [rad or m, per s]
    tau : (n,) [N m or N], link-side, on the links, see :func:`.inverse_dynamics`
    F_e : (6,) [N, N m] wrench on the surroundings in {O}
    F_Dk : n times (6,) [N, N m], optional
        Force from the base to every rotor whose reaction on the links is included, Eq. (11). It contains no
        acceleration, because the torque about the rotor's axis is known, so the recursion covers only the links.
    load : Hanging, optional
        A body attached to the last link, in {B_n}.
    """
    a = articulated(robot, q, q_dot, tau, F_e, F_Dk, base, load)

    # pass 3, base to end effector: accelerations
    def link(V_A_dot: Any, i: int) -> tuple[Any, Any]:
        z = joint_axis(robot.joint_types[i])
        q_ddot, V_B_dot = accelerate(z, a.U_AB[i], V_A_dot, a.c_B[i], a.joints[i])
        return V_B_dot, q_ddot

    return np.array(outward(link, base.V_S_dot, robot.n)[1])
