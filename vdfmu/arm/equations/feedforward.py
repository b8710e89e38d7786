"""Feedforward torque: exact inverse of the plant, and virtual decomposition control (12)-(28), (48)-(53)."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from vdfmu.arm.equations.desired_drive import Desired, DriveMotion, desired_drive_motion
from vdfmu.arm.equations.flexible_joint import (
    Z_TAU,
    axial_torques,
    inertia_torques,
    link_torques,
    rotor_body,
    rotor_forces,
    rotor_velocities,
)
from vdfmu.arm.equations.inverse_dynamics import (
    AT_REST,
    NO_WRENCH,
    Base,
    ChainMotion,
    gravity_in_links,
    handed_back,
    joint_torques,
    link_forces,
    link_motion,
    link_velocities,
)
from vdfmu.arm.equations.rigid_body import coriolis_matrix, gravity_force, mass_matrix


class FeedforwardTorques(NamedTuple):
    """tau_m [N m, motor-side], and tau_s [N m or N, link-side] and kappa_dot_d of the desired motion: (n,) each."""

    tau_m: Any
    tau_s: Any
    kappa_dot_d: Any


class FeedbackGains(NamedTuple):
    """Gains of required velocities (12), net forces (15)-(17), (50) and drive torques (26)-(27), each (n,).

    Lambda [1/s]; K_V: the gain matrix K_B of link i is K_V times a unit matrix; k_vq, k_vkappa [N m s/rad, motor-side].
    """

    Lambda: Any
    K_V: Any
    k_vq: Any
    k_vkappa: Any


def feedforward_inverse(
    robot: Any, desired: Desired, F_e_d: np.ndarray = NO_WRENCH, base: Base = AT_REST
) -> FeedforwardTorques:
    """Exact inverse of the plant along the desired motion: ``tau_m = z.T F_Dk + tau_s / ell + xi_m``.

    This is (27) with zero velocity error and ``tau_t = tau_s / ell``. ``z.T F_Dk = I_m kappa_ddot`` for rotors in pure
    rotation (56); for `rotor_coupling` see :func:`desired_drive_motion`. `F_e_d`, (6,) [N, N m] in {O}, is the constant
    desired wrench on the surroundings.

    Deviation: (28) as printed, ``tau + tau_f``, adds the link-side tau_f to the motor-side tau, although tau of (27)
    already contains the spring torque as tau_t.
    """
    drive = desired_drive_motion(robot, desired, F_e_d, base)
    motion = link_motion(robot, desired.q_d, desired.q_d_dot, desired.q_d_ddot, base)
    F_Dk = rotor_forces(robot, motion, drive.kappa_dot, drive.kappa_ddot)  # (7), (10)
    tau_s = drive.tau_s
    if robot.rotor_coupling:  # (11), with the actual motion of the rotors
        tau_q = joint_torques(robot, link_forces(robot, motion, F_e_d, F_Dk))  # (44)-(47)
        tau_s = tau_q - link_torques(robot, desired.q_d) + drive.xi_l
    return FeedforwardTorques(feedforward_torque(robot, axial_torques(F_Dk), tau_s, drive.xi_m), tau_s, drive.kappa_dot)


def feedforward_torque(robot: Any, tau_k: Any, tau_s: Any, xi_m: Any) -> Any:
    """Torque of the motors (27) with zero velocity error: (n,) [N m], motor-side; `tau_k` turns the rotors."""
    return tau_k + tau_s / robot.ell + xi_m


class RequiredMotion(NamedTuple):
    """Required velocities and accelerations of links and rotors, each (n,)."""

    q_dot_r: Any
    q_ddot_r: Any
    kappa_dot_r: Any
    kappa_ddot_r: Any


def required_motion(
    gains: FeedbackGains, desired: Desired, drive: DriveMotion, q: np.ndarray, q_dot: np.ndarray
) -> RequiredMotion:
    """Return the required joint velocities, Eq. (12), and their derivatives; the same for the rotors.

    Deviation: the paper does not define kappa_dot_r. Here it is q_dot_r plus the rate of the drive's deformation along
    the desired motion.
    """
    q_dot_r = desired.q_d_dot + gains.Lambda * (desired.q_d - q)
    q_ddot_r = desired.q_d_ddot + gains.Lambda * (desired.q_d_dot - q_dot)
    kappa_dot_r = q_dot_r + (drive.kappa_dot - desired.q_d_dot)
    return RequiredMotion(q_dot_r, q_ddot_r, kappa_dot_r, q_ddot_r + (drive.kappa_ddot - desired.q_d_ddot))


def required_net_force(
    body: tuple[Any, np.ndarray, np.ndarray],
    K_V: Any,
    g_B: np.ndarray,
    V_B: np.ndarray,
    V_B_r: np.ndarray,
    V_B_r_dot: np.ndarray,
) -> np.ndarray:
    """Return the required net force of a body, Eq. (50), (15), (17): (6,) [N, N m] in {B}.

    Deviation: see :func:`required_net_forces`.
    """
    return (
        mass_matrix(*body) @ V_B_r_dot
        + coriolis_matrix(*body, V_B[3:]) @ V_B_r
        + gravity_force(*body[:2], g_B)
        + K_V * (V_B_r - V_B)
    )


def required_net_forces(robot: Any, K_V: Any, links: ChainMotion, links_r: ChainMotion) -> list[np.ndarray]:
    """Return the required net forces of the links (50) along (48)-(49): n times (6,) [N, N m] in {B_i}.

    The joint's base and output link are parts of the links (Table 1 gives their masses together), so that (14), (15)
    and (17) are (49) and (50).

    Deviation: (15)-(17) and (50) are read as ``F*_r = M V_r_dot + C(omega) V_r + G + K (V_r - V)``, with the required
    acceleration, as in virtual decomposition control. `links` is the measured, `links_r` the required motion.
    """
    g_B = gravity_in_links(robot, links.U_AB, links.base)
    V_B, V_B_r, V_B_r_dot = links.V_B, links_r.V_B, links_r.V_B_dot
    return [required_net_force(robot.body(i), K_V[i], g_B[i], V_B[i], V_B_r[i], V_B_r_dot[i]) for i in range(robot.n)]


def required_rotor_forces(
    robot: Any, links: ChainMotion, links_r: ChainMotion, kappa_dot: Any, required: RequiredMotion
) -> list[np.ndarray]:
    """Return the required net forces of the rotors, Eq. (16): n times (6,) [N, N m] in {D_i}.

    The rotor's gain K_D of (16) is k_vkappa; see :func:`drive_torques`. In pure rotation (56) its required velocity
    (13) is ``ell kappa_dot_r`` about z, and (16) is ``I_m kappa_ddot_r``.
    """
    V_D = rotor_velocities(robot, links.V_B, kappa_dot, links.base.V_S)  # (4)
    V_D_r = rotor_velocities(robot, links_r.V_B, required.kappa_dot_r, links_r.base.V_S)  # (13)
    V_D_r_dot = rotor_velocities(robot, links_r.V_B_dot, required.kappa_ddot_r, links_r.base.V_S_dot)
    tau_k = inertia_torques(robot, V_D_r_dot, required.kappa_ddot_r)
    return [
        Z_TAU * tau_k[i] + coriolis_matrix(*rotor_body(robot, i), V_D[i][3:]) @ V_D_r[i] for i in range(robot.n)
    ]  # (16), of a body without mass


def required_forces(
    robot: Any, U_AB: list[Any], F_B_r_star: list[Any], F_D_r_star: list[Any], F_e_d: np.ndarray = NO_WRENCH
) -> list[np.ndarray]:
    """Return the required force on every driven cutting point, Eq. (51)-(53): n times (6,) [N, N m] in {B_i}.

    (52)-(53) are the constraints (18), (20) of the joints, solved for the forces as (23), (25): the base's net force
    is part of the link before it. The load F_l of (51) is the wrench `F_e_d` in {O}; a payload is part of the last
    link.

    Deviation: (53) omits the rotor's part of (20) and (25), ``U_BD F_D_kr``; with `rotor_coupling` it is added.
    """
    return handed_back(robot, U_AB, F_B_r_star, F_e_d, F_D_r_star)


def drive_torques(
    robot: Any,
    gains: FeedbackGains,
    required: RequiredMotion,
    tau_q: Any,
    tau_kr: Any,
    friction: tuple[Any, Any],
    q_dot: np.ndarray,
    kappa_dot: np.ndarray,
) -> tuple[Any, Any]:
    """Drive torques tau_t, Eq. (26), and motor torques tau, Eq. (27), (n,) [N m] each, motor-side.

    They are the solutions of (21) and (22) for given axis components: ``z.T F_qr = tau_q`` [N m or N], link-side, and
    ``z.T F_kr = tau_kr`` [N m], motor-side, which by (19) and (24) is the required net torque of the rotor. The gain
    K_D of (16) is part of k_vkappa. `friction` is (xi_l, xi_m).
    """
    xi_l, xi_m = friction
    tau_t = (tau_q + xi_l) / robot.ell + gains.k_vq * (required.q_dot_r - q_dot)  # (26)
    tau = tau_t + gains.k_vkappa * (required.kappa_dot_r - kappa_dot) + xi_m + tau_kr  # (27)
    return tau_t, tau


def feedforward_vdc(
    robot: Any,
    gains: FeedbackGains,
    desired: Desired,
    q: np.ndarray,
    q_dot: np.ndarray,
    kappa_dot: np.ndarray,
    F_e_d: np.ndarray = NO_WRENCH,
    base: Base = AT_REST,
) -> FeedforwardTorques:
    """Feedforward of virtual decomposition control, Eq. (12)-(27) and (48)-(53), at measured `q`, `q_dot`, `kappa_dot`.

    Deviation: friction is evaluated at the desired velocities. At measured or required velocities its slope near
    standstill, f_s / eps, would be a feedback gain that destabilises every sampled loop. See the functions above for
    the others.
    """
    drive = desired_drive_motion(robot, desired, F_e_d, base)
    required = required_motion(gains, desired, drive, q, q_dot)
    links = link_velocities(robot, q, q_dot, base)  # (29)-(31)
    links_r = link_motion(robot, q, required.q_dot_r, required.q_ddot_r, base, q_dot)  # (48)-(49), (14)
    F_B_r_star = required_net_forces(robot, gains.K_V, links, links_r)
    F_D_r_star = required_rotor_forces(robot, links, links_r, kappa_dot, required)
    F_B_r = required_forces(robot, links.U_AB, F_B_r_star, F_D_r_star, F_e_d)
    tau_q, tau_kr = joint_torques(robot, F_B_r) - link_torques(robot, q), axial_torques(F_D_r_star)
    friction = drive.xi_l, drive.xi_m
    tau_t, tau_m = drive_torques(robot, gains, required, tau_q, tau_kr, friction, q_dot, kappa_dot)
    return FeedforwardTorques(tau_m, robot.ell * tau_t, drive.kappa_dot)
