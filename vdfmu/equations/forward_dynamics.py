"""Forward dynamics of links and rotors: articulated recursion, and the paper's route by mapping matrices."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from vdfmu.equations.flexible_joint import rotor_force, rotor_transform, rotor_velocity
from vdfmu.equations.inverse_dynamics import gravity_in_links, inverse_dynamics
from vdfmu.equations.kinematics import joint_placements, tool_transform
from vdfmu.equations.mapping import joint_space_mass_matrix
from vdfmu.equations.rigid_body import coriolis_force, gravity_force, link_body, mass_matrix
from vdfmu.equations.spatial import cross_motion, force_transform, joint_axis, transform_mass_matrix
from vdfmu.scalar.elimination import factorize, solve
from vdfmu.scalar.generic import zeros


class Rotors(NamedTuple):
    """Rotors: speed kappa_dot (n,) [rad/s] divided by ell, torque tau_k (n,) [N m, motor-side] about the axis."""

    kappa_dot: Any
    tau_k: Any


def forward_dynamics(
    robot: Any,
    q: np.ndarray,
    q_dot: np.ndarray,
    tau: np.ndarray,
    F_e: np.ndarray | None = None,
    rotors: Rotors | None = None,
) -> np.ndarray:
    """Joint accelerations of the arm by the articulated recursion. The cost is O(n).

    The recursion eliminates V_B_dot from (44)-(47) link by link, from the end effector to the base: what
    hangs on link i acts on it like one body with mass matrix M_A and force p_A (Featherstone 2008, table 7.1,
    in the paper's notation).

    Parameters
    ----------
    q, q_dot : (n,) [rad or m, per s]
    tau : (n,) [N m or N], link-side
    F_e : (6,) [N, N m] wrench on the surroundings in {O}
    rotors : Rotors, optional
        Rotors whose reaction on the links counts, Eq. (11). It holds no acceleration, because the torque about the
        rotor's axis is known: the recursion stays that of the links alone.

    Returns
    -------
    q_ddot : (n,) [rad/s2 or m/s2]
    """
    n = robot.n
    z = [joint_axis(joint_type) for joint_type in robot.joint_types]

    # pass 1, base to end effector: velocities (31), and the forces at zero joint acceleration (47)
    placements = joint_placements(robot, q)
    U_AB = [force_transform(R_AB, p_AB) for R_AB, p_AB in placements]
    g_B = gravity_in_links(robot, U_AB)
    V_B: list[np.ndarray] = []
    c_B: list[np.ndarray] = []  # part of V_B_dot that is quadratic in velocities
    M_A: list[np.ndarray] = []
    p_A: list[np.ndarray] = []
    for i in range(n):
        V_B.append(z[i] * q_dot[i] if i == 0 else z[i] * q_dot[i] + U_AB[i].T @ V_B[i - 1])
        c_B.append(np.zeros(6) if i == 0 else cross_motion(V_B[i]) @ (z[i] * q_dot[i]))
        body = link_body(robot, i)
        M_A.append(mass_matrix(*body))
        p_A.append(coriolis_force(*body, V_B[i]) + gravity_force(*body[:2], g_B[i]))
        if rotors is not None and i > 0:
            U_BD = rotor_transform(robot, i)
            V_D = rotor_velocity(V_B[i - 1], U_BD, robot.ell[i], rotors.kappa_dot[i])  # (4)
            p_A[i - 1] = p_A[i - 1] + U_BD @ rotor_force(robot, i, V_D, rotors.tau_k[i])  # (10)-(11)
    if F_e is not None:
        p_A[-1] = p_A[-1] + tool_transform(robot) @ F_e

    # pass 2, end effector to base: eliminate q_ddot_i, hand the rest to the previous link
    M_z: list[np.ndarray] = [np.zeros(6)] * n
    d: list[Any] = [None] * n
    u: list[Any] = [None] * n
    for i in reversed(range(n)):
        M_z[i] = M_A[i] @ z[i]
        d[i] = z[i] @ M_z[i]
        u[i] = tau[i] - z[i] @ p_A[i]
        if i > 0:
            M_a = M_A[i] - np.outer(M_z[i], M_z[i] / d[i])
            p_a = p_A[i] + M_a @ c_B[i] + M_z[i] * (u[i] / d[i])
            M_A[i - 1] = M_A[i - 1] + transform_mass_matrix(*placements[i], M_a)
            p_A[i - 1] = p_A[i - 1] + U_AB[i] @ p_a

    # pass 3, base to end effector: accelerations
    q_ddot = zeros((n,), q, q_dot, tau)
    V_A_dot = np.zeros(6)
    for i in range(n):
        a = c_B[i] if i == 0 else U_AB[i].T @ V_A_dot + c_B[i]
        q_ddot[i] = (u[i] - M_z[i] @ a) / d[i]
        V_A_dot = a + z[i] * q_ddot[i]
    return q_ddot


def forward_dynamics_by_mapping(
    robot: Any, q: np.ndarray, q_dot: np.ndarray, tau: np.ndarray, F_e: np.ndarray | None = None
) -> np.ndarray:
    """Joint accelerations by the mapping matrices (37)-(43): ``M q_ddot = tau - ID(q, q_dot, 0)``.

    The cost is O(n^3). Parameters and result as in :func:`forward_dynamics`; the two agree to rounding.
    """
    M = joint_space_mass_matrix(robot, q)
    bias = inverse_dynamics(robot, q, q_dot, np.zeros(robot.n), F_e)
    return solve(factorize(M), tau - bias)
