"""Inverse dynamics by virtual decomposition, the whole recursion: Eq. (29)-(31), (44)-(47), and the rotors' part, (11).

Pass 1 goes from the base to the end effector and pass 2 back; the functions stand in the order in which they run, and
:func:`inverse_dynamics`, last, joins them.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from vdfmu.arm.drive.options import link_torques
from vdfmu.arm.equations.flexible_joint import rotor_forces, rotor_transform
from vdfmu.arm.equations.kinematics import joint_transforms, tool_transform
from vdfmu.arm.equations.rigid_body import link_body, net_force
from vdfmu.arm.equations.spatial import cross_motion, joint_axis
from vdfmu.arm.world.attachment import AT_REST, NO_WRENCH, Base
from vdfmu.compiler.scalar.generic import cut

# pass 1, base to end effector: velocities, accelerations and gravity


def driven_velocity(z: np.ndarray, U_AB: np.ndarray, V_A: np.ndarray, q_dot: Any) -> np.ndarray:
    """Velocity of a link from that of the link before it, (30)-(31): (6,) [m/s, rad/s] in {B}.

    Parameters
    ----------
    z : (6,) axis of the joint between them
    U_AB : (6, 6) force transformation from {B} to {A}
    V_A : (6,) [m/s, rad/s] in {A}
    q_dot : float [rad/s or m/s]
    """
    return z * q_dot + U_AB.T @ V_A


def driven_acceleration(
    z: np.ndarray, U_AB: np.ndarray, V_A_dot: np.ndarray, V_B: np.ndarray, q_dot: Any, q_ddot: Any
) -> np.ndarray:
    """Return the derivative of (31), which is not printed in the paper: (6,) [m/s2, rad/s2] in {B}.

    `V_B` is the velocity of which it is the derivative; U_AB moves with the measured `q_dot`.
    """
    return z * q_ddot + U_AB.T @ V_A_dot + cross_motion(V_B) @ (z * q_dot)


class ChainMotion(NamedTuple):
    """Motion of base and links: force transformations U_AB[i] (32), velocities V_B[i] (29)-(31) and V_B_dot[i]."""

    U_AB: list[np.ndarray]
    V_B: list[np.ndarray]
    V_B_dot: list[np.ndarray]
    base: Base


def link_motion(robot: Any, q: np.ndarray, q_dot: np.ndarray, q_ddot: np.ndarray, base: Base = AT_REST) -> ChainMotion:
    """Velocities of all links by Eq. (29)-(31), and their derivatives.

    Deviation: (30)-(31) are printed for i = 2..5; they run to i = n, and (29) is (31) on a base at rest.

    Parameters
    ----------
    q, q_dot, q_ddot : (n,) [rad or m, and per s, s2]
    base : Base
        Its motion, default at rest.
    """
    U_AB = joint_transforms(robot, q)
    V_B: list[np.ndarray] = []
    V_B_dot: list[np.ndarray] = []
    for i in range(robot.n):
        z = joint_axis(robot.joint_types[i])
        V_A, V_A_dot = (V_B[-1], V_B_dot[-1]) if i > 0 else (base.V_S, base.V_S_dot)
        V_B.append(cut(i, driven_velocity(z, U_AB[i], V_A, q_dot[i])))  # (29)-(31)
        V_B_dot.append(cut(i, driven_acceleration(z, U_AB[i], V_A_dot, V_B[i], q_dot[i], q_ddot[i])))
    return ChainMotion(U_AB, V_B, V_B_dot, base)


def gravity_in_links(robot: Any, U_AB: list[np.ndarray], base: Base = AT_REST) -> list[np.ndarray]:
    """Vector g of (62) in every link frame, ``R_BI @ g`` : n times (3,) [m/s2]."""
    g_B = []
    g = base.R_S.T @ robot.gravity
    for i, U in enumerate(U_AB):
        g = cut(i, U[:3, :3].T @ g)
        g_B.append(g)
    return g_B


# pass 2, end effector to base: forces, and their parts along the axes


def link_forces(
    robot: Any, motion: ChainMotion, F_e: np.ndarray = NO_WRENCH, F_Dk: list[np.ndarray] | None = None
) -> list[np.ndarray]:
    """Force and torque on every driven cutting point, Eq. (44)-(47).

    Deviation: (46) leaves out the rotor's reaction on its base, ``U_BD F_Dk`` of (11); here it is added.

    Parameters
    ----------
    F_e : (6,) [N, N m] wrench of the arm on its surroundings, in {O} ({B_6} in the paper).
    F_Dk : n times (6,) [N, N m] force from the base to every rotor, in {D_i}; None is 0.

    Returns
    -------
    F_B : n times (6,) [N, N m] in {B_i}
    """
    n = robot.n
    g_B = gravity_in_links(robot, motion.U_AB, motion.base)
    F_B: list[np.ndarray] = [np.zeros(6)] * n
    for i in reversed(range(n)):
        F_B[i] = net_force(*link_body(robot, i), g_B[i], motion.V_B[i], motion.V_B_dot[i])  # (47)
        if i == n - 1:
            F_B[i] = F_B[i] + tool_transform(robot) @ F_e  # (44)
        else:
            F_B[i] = F_B[i] + motion.U_AB[i + 1] @ F_B[i + 1]  # (46)
            if F_Dk is not None:
                F_B[i] = F_B[i] + rotor_transform(robot, i + 1) @ F_Dk[i + 1]  # (11)
        F_B[i] = cut(i, F_B[i])
    return F_B


def joint_torques(robot: Any, q: np.ndarray, F_B: list[np.ndarray]) -> np.ndarray:
    """Component of every F_B along its joint axis, ``z.T @ F_B``, less counterbalances: (n,) [N m or N], link-side."""
    along = np.array([joint_axis(joint_type) @ F for joint_type, F in zip(robot.joint_types, F_B, strict=True)])
    return along - link_torques(robot, q)


def inverse_dynamics(
    robot: Any,
    q: np.ndarray,
    q_dot: np.ndarray,
    q_ddot: np.ndarray,
    F_e: np.ndarray = NO_WRENCH,
    rotors: tuple[Any, Any] | None = None,
    base: Base = AT_REST,
) -> np.ndarray:
    """Joint torques of the rigid arm for a given motion, Eq. (29)-(31) and (44)-(47). The cost is O(n).

    Parameters
    ----------
    q, q_dot, q_ddot : (n,) [rad or m, and per s, s2]
    F_e : (6,) [N, N m] wrench on the surroundings in {O}
    rotors : (kappa_dot, kappa_ddot), each (n,), optional
        Motion of rotors whose reaction on the links counts, Eq. (11); without it the links are alone.
    base : Base
        Its motion, default at rest.

    Returns
    -------
    tau : (n,) [N m or N], link-side, without friction, of drives: those of counterbalances are taken off
    """
    motion = link_motion(robot, q, q_dot, q_ddot, base=base)
    F_Dk = None if rotors is None else rotor_forces(robot, motion, *rotors)
    return joint_torques(robot, q, link_forces(robot, motion, F_e, F_Dk))
