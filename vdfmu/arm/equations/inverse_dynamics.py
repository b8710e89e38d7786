"""Inverse dynamics by virtual decomposition, the whole recursion: Eq. (29)-(31), (44)-(47), and the rotors' part, (11).

Pass 1 goes from the base to the end effector and pass 2 back. The functions are in the order in which they are called;
:func:`inverse_dynamics`, the last, combines them.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from vdfmu.arm.equations.flexible_joint import rotor_forces, rotor_reaction
from vdfmu.arm.equations.kinematics import joint_transforms, tool_transform
from vdfmu.arm.equations.rigid_body import net_force
from vdfmu.arm.equations.spatial import cross_motion, inward, joint_axis, outward

NO_WRENCH = np.zeros(6)


class Base(NamedTuple):
    """Motion of the base frame {S} relative to an inertial frame in which its origin moves at `V_S[:3]`.

    Forces are the same in all inertial frames (Galilean invariance), so for forces alone the linear velocity may be 0.
    """

    R_S: Any = np.eye(3)
    """(3, 3) rotation of {S} in {I}, the frame of the gravity vector of (62)."""
    V_S: Any = np.zeros(6)
    """(6,) [m/s, rad/s] velocity of {S} in {S}."""
    V_S_dot: Any = np.zeros(6)
    """(6,) [m/s2, rad/s2] derivative of the coordinates V_S."""


AT_REST = Base()
"""{S} is the inertial frame {I}, as in the paper. Its zeros are simplified away in the generated code."""

# pass 1, base to end effector: velocities, accelerations and gravity


def driven_velocity(z: np.ndarray, U_AB: np.ndarray, V_A: np.ndarray, q_dot: Any) -> np.ndarray:
    """Velocity of a link from `V_A` of the link before it and the joint between them, (30)-(31): (6,) in {B}."""
    return z * q_dot + U_AB.T @ V_A


def driven_acceleration(
    z: np.ndarray, U_AB: np.ndarray, V_A_dot: np.ndarray, V_B: np.ndarray, q_dot: Any, q_ddot: Any
) -> np.ndarray:
    """Return the derivative of `V_B` of (31), not printed in the paper: (6,) in {B}; U_AB changes with `q_dot`."""
    return z * q_ddot + U_AB.T @ V_A_dot + cross_motion(V_B) @ (z * q_dot)


class ChainMotion(NamedTuple):
    """Motion of base and links: force transformations U_AB (32), velocities V_B (29)-(31), V_B_dot (or empty)."""

    U_AB: list[np.ndarray]
    V_B: list[np.ndarray]
    V_B_dot: list[np.ndarray]
    base: Base
    V_n: Any = None
    """V_B of the last link."""
    V_n_dot: Any = None


def link_velocities(robot: Any, q: np.ndarray, q_dot: Any, base: Base = AT_REST) -> ChainMotion:
    """Return :func:`link_motion` without accelerations."""
    U_AB = joint_transforms(robot, q)

    def link(V_A: Any, i: int) -> tuple[Any, Any]:
        V_B = driven_velocity(joint_axis(robot.joint_types[i]), U_AB[i], V_A, q_dot[i])  # (29)-(31), (48)-(49)
        return V_B, V_B

    V_n, V_B = outward(link, base.V_S, robot.n)
    return ChainMotion(U_AB, V_B, [], base, V_n)


def link_motion(
    robot: Any, q: np.ndarray, q_dot: Any, q_ddot: Any, base: Base = AT_REST, measured: Any = None
) -> ChainMotion:
    """Velocities of all links by Eq. (29)-(31), and their derivatives.

    Deviation: (30)-(31) are printed for i = 2..5; they run to i = n, and (29) is (31) on a base at rest. If `q_dot`
    are required velocities, (48)-(49), U_AB still changes with the `measured` velocities of the joints.
    """
    motion = link_velocities(robot, q, q_dot, base)
    moving = q_dot if measured is None else measured

    def link(V_A_dot: Any, i: int) -> tuple[Any, Any]:
        z = joint_axis(robot.joint_types[i])
        V_B_dot = driven_acceleration(z, motion.U_AB[i], V_A_dot, motion.V_B[i], moving[i], q_ddot[i])
        return V_B_dot, V_B_dot

    V_n_dot, V_B_dot = outward(link, base.V_S_dot, robot.n)
    return motion._replace(V_B_dot=V_B_dot, V_n_dot=V_n_dot)


def gravity_in_links(robot: Any, U_AB: list[np.ndarray], base: Base = AT_REST) -> list[np.ndarray]:
    """Vector g of (62) in every link frame, ``R_BI @ g`` : n times (3,) [m/s2]."""

    def link(g_A: Any, i: int) -> tuple[Any, Any]:
        g_B = U_AB[i][:3, :3].T @ g_A
        return g_B, g_B

    return outward(link, base.R_S.T @ robot.gravity, robot.n)[1]


# pass 2, end effector to base: forces, and their parts along the axes


def link_forces(
    robot: Any, motion: ChainMotion, F_e: np.ndarray = NO_WRENCH, F_Dk: list[np.ndarray] | None = None
) -> list[np.ndarray]:
    """Force and torque at every driven cutting point, Eq. (44)-(47): n times (6,) [N, N m] in {B_i}.

    Deviation: (46) omits the rotor's reaction on its base, ``U_BD F_Dk`` of (11); here it is added.

    Parameters
    ----------
    F_e : (6,) [N, N m] wrench of the arm on its surroundings, in {O} ({B_6} in the paper).
    F_Dk : n times (6,) [N, N m] force from the base to every rotor, in {D_i}; None is 0.
    """
    g_B = gravity_in_links(robot, motion.U_AB, motion.base)
    F_B_star: list[np.ndarray] = []
    for i in range(robot.n):
        m_B, r_B, I_B = robot.body(i)
        F_B_star.append(net_force(m_B, r_B, I_B, g_B[i], motion.V_B[i], motion.V_B_dot[i]))  # (47)
    return handed_back(robot, motion.U_AB, F_B_star, F_e, F_Dk)


def handed_back(
    robot: Any, U_AB: list[np.ndarray], F_B_star: list[np.ndarray], F_e: np.ndarray, F_Dk: list[np.ndarray] | None
) -> list[np.ndarray]:
    """Force on every driven cutting point from the net forces F_B_star, Eq. (44)-(46), or required forces (51)-(53)."""

    def link(beyond: Any, i: int) -> tuple[Any, Any]:
        F_A, reaction = beyond
        F_B = F_B_star[i] + F_A
        F_B = F_B if reaction is None else F_B + reaction  # (11), (19), (24)-(25)
        reaction = None if F_Dk is None else rotor_reaction(robot, i, F_Dk[i])
        return (U_AB[i] @ F_B, reaction), F_B  # (46), (52)-(53)

    return inward(link, (tool_transform(robot) @ F_e, None), robot.n)[1]  # (44), (51)


def joint_torques(robot: Any, F_B: list[np.ndarray]) -> np.ndarray:
    """Component of every F_B along its joint axis, ``z.T @ F_B``: (n,) [N m or N], link-side."""
    return np.array([joint_axis(joint_type) @ F for joint_type, F in zip(robot.joint_types, F_B, strict=True)])


def inverse_dynamics(
    robot: Any, q: np.ndarray, q_dot: np.ndarray, q_ddot: np.ndarray, F_e: np.ndarray = NO_WRENCH,
    rotors: tuple[Any, Any] | None = None, base: Base = AT_REST,
) -> np.ndarray:  # fmt: skip
    """Joint torques of the rigid arm for a given motion, Eq. (29)-(31) and (44)-(47), at cost O(n).

    (n,) [N m or N], link-side: the sum applied by drives and counterbalances, see :func:`.link_torques`.

    Parameters
    ----------
    q, q_dot, q_ddot : (n,) [rad or m, and per s, s2]
    F_e : (6,) [N, N m] wrench on the surroundings in {O}
    rotors : (kappa_dot, kappa_ddot), each (n,), optional
        Motion of rotors whose reaction on the links is included, Eq. (11). By default only the links are included.
    """
    motion = link_motion(robot, q, q_dot, q_ddot, base=base)
    F_Dk = None if rotors is None else rotor_forces(robot, motion, *rotors)
    return joint_torques(robot, link_forces(robot, motion, F_e, F_Dk))
