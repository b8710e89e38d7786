"""Feedforward torque: exact inverse of the plant, and virtual decomposition control (12)-(28), (48)-(53)."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from vdfmu.equations.flexible_joint import rotor_position
from vdfmu.equations.friction import joint_friction
from vdfmu.equations.inverse_dynamics import inverse_dynamics, joint_torques, tool_transform
from vdfmu.equations.jet import derivative, jets
from vdfmu.equations.kinematics import gravity_in_links, joint_transforms
from vdfmu.equations.rigid_body import coriolis_matrix, gravity_force, link_body, mass_matrix
from vdfmu.equations.spatial import cross_motion, joint_axis
from vdfmu.equations.trajectory import Desired

__all__ = [
    "Feedforward",
    "Gains",
    "RequiredMotion",
    "desired_drive_motion",
    "drive_torques",
    "feedforward_inverse",
    "feedforward_vdc",
    "printed_motor_torque",
    "required_forces",
    "required_motion",
    "required_net_forces",
]


class Feedforward(NamedTuple):
    """Motor torque, and what springs and rotors do along the desired motion, each (n,).

    tau_m [N m, motor-side]; tau_s [N m or N, link-side]; kappa_dot_d [rad/s or m/s].
    """

    tau_m: Any
    tau_s: Any
    kappa_dot_d: Any


class Gains(NamedTuple):
    """Gains of required velocities (12), net forces (15)-(17), (50) and drive torques (26)-(27), each (n,).

    Lambda [1/s]; K_V, the multiple of the unit matrix that stands for the gain matrix K_B of link i; k_vq
    [N m s/rad, motor-side]; k_vkappa [N m s/rad, motor-side].
    """

    Lambda: Any
    K_V: Any
    k_vq: Any
    k_vkappa: Any


class DriveMotion(NamedTuple):
    """Spring torque, rotor position, velocity and acceleration along the desired motion, each (n,)."""

    tau_s: Any
    kappa: Any
    kappa_dot: Any
    kappa_ddot: Any


def desired_drive_motion(robot: Any, desired: Desired, F_e_d: np.ndarray | None = None) -> DriveMotion:
    """Return what springs and rotors must do while the links follow the desired motion exactly.

    ``tau_s = ID(q_d, ..) + xi_l`` and ``kappa = q_d + D(tau_s) + theta_err``; the two derivatives of kappa
    come from running these lines on jets, which takes q_d up to its fourth derivative. The derivatives of the wrench
    `F_e_d` are taken as zero.
    """
    q_d, q_d_dot, q_d_ddot, q_d_dddot, q_d_ddddot = desired
    q = jets(q_d, q_d_dot, q_d_ddot)
    q_dot = jets(q_d_dot, q_d_ddot, q_d_dddot)
    q_ddot = jets(q_d_ddot, q_d_dddot, q_d_ddddot)
    xi_l, _ = joint_friction(robot, q_dot, q_dot)
    tau_s = inverse_dynamics(robot, q, q_dot, q_ddot, F_e_d) + xi_l
    kappa = rotor_position(robot, q, tau_s)
    return DriveMotion(derivative(tau_s, 0), derivative(kappa, 0), derivative(kappa, 1), derivative(kappa, 2))


def feedforward_inverse(robot: Any, desired: Desired, F_e_d: np.ndarray | None = None) -> Feedforward:
    """Exact inverse of the plant along the desired motion: ``tau_m = I_m kappa_ddot + tau_s / ell + xi_m``.

    This is (27) with zero velocity error and ``tau_t = tau_s / ell``; see :func:`printed_motor_torque` for
    (28).

    Parameters
    ----------
    desired : q_d to its fourth derivative, each (n,)
    F_e_d : (6,) [N, N m] wrench that the arm is to exert on its surroundings, in {O}, constant
    """
    drive = desired_drive_motion(robot, desired, F_e_d)
    _, xi_m = joint_friction(robot, desired.q_d_dot, drive.kappa_dot)
    tau_m = robot.I_m * drive.kappa_ddot + drive.tau_s / robot.ell + xi_m  # (27), (56)
    return Feedforward(tau_m, drive.tau_s, drive.kappa_dot)


class RequiredMotion(NamedTuple):
    """Required velocities and accelerations of links and rotors, each (n,)."""

    q_dot_r: Any
    q_ddot_r: Any
    kappa_dot_r: Any
    kappa_ddot_r: Any


def required_motion(
    gains: Gains, desired: Desired, drive: DriveMotion, q: np.ndarray, q_dot: np.ndarray
) -> RequiredMotion:
    """Return the required joint velocities, Eq. (12), and their derivatives; the same for the rotors.

    Deviation: the paper leaves kappa_dot_r open. Here it is q_dot_r plus the rate of the drive's deformation along
    the desired motion.
    """
    q_dot_r = desired.q_d_dot + gains.Lambda * (desired.q_d - q)
    q_ddot_r = desired.q_d_ddot + gains.Lambda * (desired.q_d_dot - q_dot)
    return RequiredMotion(
        q_dot_r,
        q_ddot_r,
        q_dot_r + (drive.kappa_dot - desired.q_d_dot),
        q_ddot_r + (drive.kappa_ddot - desired.q_d_ddot),
    )


def required_net_forces(
    robot: Any,
    gains: Gains,
    U_AB: list[np.ndarray],
    q_dot: np.ndarray,
    required: RequiredMotion,
) -> list[np.ndarray]:
    """Return the required net force of every link, Eq. (50), along its required velocity, Eq. (48)-(49).

    The joint's base and output link are parts of the links (Table 1 gives their masses together), so that (14), (15)
    and (17) are (49) and (50). The rotor's (13) and (16) are scalars, see :func:`drive_torques`.

    Deviation: (15)-(17) and (50) are read as ``F*_r = M V_r_dot + C(omega) V_r + G + K (V_r - V)``, with the required
    acceleration, as virtual decomposition control has it.

    Returns
    -------
    F_B_r_star : n times (6,) [N, N m] in {B_i}
    """
    g_B = gravity_in_links(robot, U_AB)
    F_B_r_star: list[np.ndarray] = []
    V_A, V_A_r, V_A_r_dot = np.zeros(6), np.zeros(6), np.zeros(6)
    for i in range(robot.n):
        z = joint_axis(robot.joint_types[i])
        V_B = z * q_dot[i]
        V_B_r = z * required.q_dot_r[i]  # (48)
        V_B_r_dot = z * required.q_ddot_r[i]
        if i > 0:
            V_B = V_B + U_AB[i].T @ V_A
            V_B_r = V_B_r + U_AB[i].T @ V_A_r  # (49), (14)
            # the derivative of (49): U depends on the measured position, so its rate on the measured velocity
            V_B_r_dot = V_B_r_dot + U_AB[i].T @ V_A_r_dot + cross_motion(V_B_r) @ (z * q_dot[i])
        body = link_body(robot, i)
        F_B_r_star.append(
            mass_matrix(*body) @ V_B_r_dot
            + coriolis_matrix(*body, V_B[3:]) @ V_B_r
            + gravity_force(*body[:2], g_B[i])
            + gains.K_V[i] * (V_B_r - V_B)
        )  # (50), (15), (17)
        V_A, V_A_r, V_A_r_dot = V_B, V_B_r, V_B_r_dot
    return F_B_r_star


def required_forces(
    robot: Any, U_AB: list[np.ndarray], F_B_r_star: list[np.ndarray], F_e_d: np.ndarray | None = None
) -> list[np.ndarray]:
    """Return the required force on every driven cutting point, Eq. (51)-(53), from the last link to the first.

    (52)-(53) are the constraints (18), (20) of the joints, solved for the forces as (23), (25): the base's net force
    is part of the link before it. The load F_l of (51) is the wrench `F_e_d` in {O}; a payload is part of the last
    link.

    Returns
    -------
    F_B_r : n times (6,) [N, N m] in {B_i}
    """
    F_B_r = list(F_B_r_star)
    if F_e_d is not None:
        F_B_r[-1] = F_B_r[-1] + tool_transform(robot) @ F_e_d  # (51)
    for i in reversed(range(len(F_B_r) - 1)):
        F_B_r[i] = F_B_r[i] + U_AB[i + 1] @ F_B_r[i + 1]  # (52)-(53)
    return F_B_r


def drive_torques(
    robot: Any,
    gains: Gains,
    required: RequiredMotion,
    tau_q: np.ndarray,
    friction: tuple[Any, Any],
    q_dot: np.ndarray,
    kappa_dot: np.ndarray,
) -> tuple[Any, Any]:
    """Return the drive torques tau_t, Eq. (26), and the motor torques tau, Eq. (27).

    They solve (21) and (22) with ``z.T F_qr = tau_q`` and ``z.T F_kr``, by (19) and (24) the required net torque of
    the rotor: in pure rotation (56) its velocity (13) is ``ell kappa_dot_r`` about z, and (16) is
    ``I_m kappa_ddot_r``, with its gain K_D in k_vkappa.

    Parameters
    ----------
    tau_q : (n,) [N m or N] axis components of the required forces, link-side
    friction : (xi_l, xi_m) link-side and motor-side
    """
    xi_l, xi_m = friction
    tau_t = (tau_q + xi_l) / robot.ell + gains.k_vq * (required.q_dot_r - q_dot)  # (26)
    tau_kr = robot.I_m * required.kappa_ddot_r  # (16), (19), (24), (56)
    tau = tau_t + gains.k_vkappa * (required.kappa_dot_r - kappa_dot) + xi_m + tau_kr  # (27)
    return tau_t, tau


def feedforward_vdc(
    robot: Any,
    gains: Gains,
    desired: Desired,
    q: np.ndarray,
    q_dot: np.ndarray,
    kappa_dot: np.ndarray,
    F_e_d: np.ndarray | None = None,
) -> Feedforward:
    """Return the feedforward of virtual decomposition control, Eq. (12)-(27) and (48)-(53).

    Deviation: friction is evaluated at the desired velocities. At measured or required ones its slope around
    standstill, f_s / eps, is a feedback gain that no sampled loop stands. See the functions above for the others.

    Parameters
    ----------
    desired : q_d to its fourth derivative, each (n,)
    q, q_dot, kappa_dot : (n,) measured
    F_e_d : (6,) [N, N m] as in :func:`feedforward_inverse`
    """
    drive = desired_drive_motion(robot, desired, F_e_d)
    required = required_motion(gains, desired, drive, q, q_dot)
    U_AB = joint_transforms(robot, q)
    F_B_r = required_forces(robot, U_AB, required_net_forces(robot, gains, U_AB, q_dot, required), F_e_d)
    friction = joint_friction(robot, desired.q_d_dot, drive.kappa_dot)
    tau_q = joint_torques(robot, F_B_r)
    tau_t, tau_m = drive_torques(robot, gains, required, tau_q, friction, q_dot, kappa_dot)
    return Feedforward(tau_m, robot.ell * tau_t, drive.kappa_dot)


def printed_motor_torque(tau: Any, tau_f: Any) -> Any:
    """Motor torque as Eq. (28) is printed, ``tau + tau_f``, kept to document it: nothing else calls it.

    It adds the link-side tau_f to the motor-side tau, and tau of (27) already holds the spring torque as
    tau_t.
    """
    return tau + tau_f
