"""Forward dynamics of links and rotors: articulated recursion, and the paper's route by mapping matrices."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from vdfmu.arm.drive.options import link_torques
from vdfmu.arm.equations.flexible_joint import rotor_force, rotor_transform, rotor_velocity
from vdfmu.arm.equations.inverse_dynamics import driven_velocity, gravity_in_links, inverse_dynamics
from vdfmu.arm.equations.kinematics import joint_placements, tool_transform
from vdfmu.arm.equations.mapping import joint_space_mass_matrix
from vdfmu.arm.equations.rigid_body import bias_force, link_body, mass_matrix
from vdfmu.arm.equations.spatial import cross_motion, force_transform, joint_axis, transform_mass_matrix
from vdfmu.arm.world.attachment import FREE, NO_WRENCH, Ends, point_acceleration
from vdfmu.compiler.scalar.elimination import factorize, solve, sparse_of
from vdfmu.compiler.scalar.generic import zeros


class Rotors(NamedTuple):
    """Rotors: speed kappa_dot (n,) [rad/s] divided by ell, torque tau_k (n,) [N m, motor-side] about the axis."""

    kappa_dot: Any
    tau_k: Any


class _Articulated(NamedTuple):
    """Result of passes 1 and 2 for each link: the acceleration of its base is all that is missing."""

    placements: list[tuple[np.ndarray, np.ndarray]]
    U_AB: Any
    c_B: Any
    """Part of V_B_dot that is quadratic in velocities."""
    M_A: Any
    p_A: Any
    joints: list[Eliminated]
    p_S: Any
    """Force of the first rotor on the base, in {S}."""


class Eliminated(NamedTuple):
    """A joint of which the acceleration is eliminated: ``q_ddot = (u - M_z @ a) / d``, `a` that of its locked link."""

    M_z: np.ndarray
    d: Any
    u: Any


def eliminate(z: np.ndarray, M_B: np.ndarray, p_B: np.ndarray, tau: Any) -> Eliminated:
    """Eliminate the acceleration of a joint with axis `z`, on which a body of `M_B` and `p_B` hangs.

    Parameters
    ----------
    M_B : (6, 6) [kg, kg m, kg m2] apparent mass in {B}
    p_B : (6,) [N, N m] force at ``V_B_dot = 0`` in {B}
    tau : float [N m or N], link-side
    """
    M_z = M_B @ z
    return Eliminated(M_z, z @ M_z, tau - z @ p_B)


def _articulated(
    robot: Any, q: np.ndarray, q_dot: np.ndarray, tau: np.ndarray, F_e: Any, rotors: Rotors | None, ends: Ends
) -> _Articulated:
    """Eliminate the accelerations link by link, see :func:`forward_dynamics`."""
    n, base = robot.n, ends.base
    z = [joint_axis(joint_type) for joint_type in robot.joint_types]

    # pass 1, base to end effector: velocities (31), and the forces at zero joint acceleration (47)
    placements = joint_placements(robot, q)
    U_AB = [force_transform(R_AB, p_AB) for R_AB, p_AB in placements]
    g_B = gravity_in_links(robot, U_AB, base)
    V_B: list[np.ndarray] = []
    c_B: list[np.ndarray] = []
    M_A: list[np.ndarray] = []
    p_A: list[np.ndarray] = []
    p_S = np.zeros(6)
    for i in range(n):
        V_A = V_B[i - 1] if i > 0 else base.V_S
        V_B.append(driven_velocity(z[i], U_AB[i], V_A, q_dot[i]))
        c_B.append(cross_motion(V_B[i]) @ (z[i] * q_dot[i]))
        body = link_body(robot, i)
        M_A.append(mass_matrix(*body))
        p_A.append(bias_force(*body, g_B[i], V_B[i]))
        if rotors is not None:
            U_BD = rotor_transform(robot, i)
            V_D = rotor_velocity(V_A, U_BD, robot.ell[i], rotors.kappa_dot[i])  # (4)
            F_B = U_BD @ rotor_force(robot, i, V_D, rotors.tau_k[i])  # (10)-(11)
            if i > 0:
                p_A[i - 1] = p_A[i - 1] + F_B
            else:
                p_S = F_B
    U_O, V_O = tool_transform(robot), tool_transform(robot).T @ V_B[-1]
    p_A[-1] = p_A[-1] + U_O @ F_e
    # a load that is a body of its own: its part of F is M_e A_O
    M_A[-1] = M_A[-1] + transform_mass_matrix(robot.tool_rotation, robot.tool_offset, ends.M_e)
    p_A[-1] = p_A[-1] + U_O @ (ends.M_e @ point_acceleration(V_O, np.zeros(6)))

    # pass 2, end effector to base: eliminate q_ddot_i, hand the rest to the previous link
    tau = tau + link_torques(robot, q)
    joints: list[Any] = [None] * n
    for i in reversed(range(n)):
        joints[i] = eliminate(z[i], M_A[i], p_A[i], tau[i])
        if i > 0:
            M_a, p_a = handed_on(placements[i], U_AB[i], M_A[i], p_A[i], c_B[i], joints[i])
            M_A[i - 1] = M_A[i - 1] + M_a
            p_A[i - 1] = p_A[i - 1] + p_a
    return _Articulated(placements, U_AB, c_B, M_A, p_A, joints, p_S)


def handed_on(
    placement: tuple[np.ndarray, np.ndarray], U_AB: np.ndarray, M_B: Any, p_B: Any, c_B: Any, joint: Eliminated
) -> tuple[np.ndarray, np.ndarray]:
    """Mass matrix (6, 6) and force (6,) of what hangs on a joint, as the link {A} before it feels them.

    `c_B` is the part of V_B_dot that is quadratic in velocities; other parameters as in :func:`eliminate`.
    """
    M_a = M_B - np.outer(joint.M_z, joint.M_z / joint.d)
    p_a = p_B + M_a @ c_B + joint.M_z * (joint.u / joint.d)
    return transform_mass_matrix(*placement, M_a), U_AB @ p_a


def accelerate(
    z: np.ndarray, U_AB: np.ndarray, V_A_dot: np.ndarray, c_B: np.ndarray, joint: Eliminated
) -> tuple[Any, np.ndarray]:
    """Return the acceleration of a joint [rad/s2 or m/s2] and V_B_dot (6,) where the link before it has V_A_dot."""
    a = U_AB.T @ V_A_dot + c_B
    q_ddot = (joint.u - joint.M_z @ a) / joint.d
    return q_ddot, a + z * q_ddot


def forward_dynamics(
    robot: Any,
    q: np.ndarray,
    q_dot: np.ndarray,
    tau: np.ndarray,
    F_e: np.ndarray = NO_WRENCH,
    rotors: Rotors | None = None,
    ends: Ends = FREE,
) -> np.ndarray:
    """Joint accelerations of the arm by the articulated recursion. The cost is O(n).

    The recursion eliminates V_B_dot from (44)-(47) link by link, from the end effector to the base: what
    hangs on link i acts on it like one body with mass matrix M_A and force p_A (Featherstone 2008, table 7.1,
    in the paper's notation).

    Parameters
    ----------
    q, q_dot : (n,) [rad or m, per s]
    tau : (n,) [N m or N], link-side, without counterbalances
    F_e : (6,) [N, N m] wrench on the surroundings in {O}; with a load ``ends.M_e`` that at ``A_O = 0``
    rotors : Rotors, optional
        Rotors whose reaction on the links counts, Eq. (11). It holds no acceleration, because the torque about the
        rotor's axis is known: the recursion stays that of the links alone.
    ends : Ends
        Motion of the base, and mass of the load.

    Returns
    -------
    q_ddot : (n,) [rad/s2 or m/s2]
    """
    a_ = _articulated(robot, q, q_dot, tau, F_e, rotors, ends)

    # pass 3, base to end effector: accelerations
    q_ddot = zeros((robot.n,), q, q_dot, tau)
    V_A_dot = ends.base.V_S_dot
    for i in range(robot.n):
        z = joint_axis(robot.joint_types[i])
        q_ddot[i], V_A_dot = accelerate(z, a_.U_AB[i], V_A_dot, a_.c_B[i], a_.joints[i])
    return q_ddot


def apparent_load(
    robot: Any,
    q: np.ndarray,
    q_dot: np.ndarray,
    tau: np.ndarray,
    F_e: np.ndarray = NO_WRENCH,
    rotors: Rotors | None = None,
    ends: Ends = FREE,
) -> tuple[np.ndarray, np.ndarray]:
    """Return what an arm is for its base, a load of the wrench ``M_S A_S + F_S0``, by the same recursion one link on.

    Parameters
    ----------
    q, q_dot, tau, F_e, rotors : as in :func:`forward_dynamics`
    ends : Ends
        With a base that has no linear velocity, of which `V_S_dot` does not count, since A_S is left open.

    Returns
    -------
    M_S : (6, 6) [kg, kg m, kg m2] in {S}, symmetric
    F_S0 : (6,) [N, N m] wrench on the base where its acceleration A_S is 0, in {S}
    """
    a = _articulated(robot, q, q_dot, tau, F_e, rotors, ends)
    M_S, p_a = handed_on(a.placements[0], a.U_AB[0], a.M_A[0], a.p_A[0], a.c_B[0], a.joints[0])
    return M_S, p_a + a.p_S


def forward_dynamics_by_mapping(
    robot: Any, q: np.ndarray, q_dot: np.ndarray, tau: np.ndarray, F_e: np.ndarray = NO_WRENCH
) -> np.ndarray:
    """Joint accelerations by the mapping matrices (37)-(43): ``M q_ddot = tau - ID(q, q_dot, 0)``.

    The cost is O(n^3). Parameters and result as in :func:`forward_dynamics`; the two agree to rounding.
    """
    M = joint_space_mass_matrix(robot, q)
    bias = inverse_dynamics(robot, q, q_dot, np.zeros(robot.n), F_e)
    return solve(factorize(sparse_of(M)), tau - bias)
