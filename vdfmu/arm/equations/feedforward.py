"""Feedforward torque: exact inverse of the plant, and virtual decomposition control (12)-(28), (48)-(53)."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from vdfmu.arm.equations.flexible_joint import (
    axial_torques,
    inertia_torques,
    rotor_body,
    rotor_forces,
    rotor_position,
    rotor_transform,
    rotor_velocities,
)
from vdfmu.arm.equations.friction import joint_friction
from vdfmu.arm.equations.inverse_dynamics import (
    driven_acceleration,
    driven_velocity,
    gravity_in_links,
    inverse_dynamics,
    joint_torques,
    link_forces,
    link_motion,
)
from vdfmu.arm.equations.kinematics import joint_transforms, tool_transform
from vdfmu.arm.equations.rigid_body import body_regressor, coriolis_matrix, gravity_force, link_body, mass_matrix
from vdfmu.arm.equations.spatial import joint_axis, skew
from vdfmu.arm.equations.trajectory import Desired
from vdfmu.arm.world.attachment import AT_REST, NO_WRENCH, Base
from vdfmu.compiler.scalar.jet import derivative, jets


class FeedforwardTorques(NamedTuple):
    """Motor torque, and what springs and rotors do along the desired motion, each (n,).

    tau_m [N m, motor-side]; tau_s [N m or N, link-side]; kappa_dot_d [rad/s or m/s].
    """

    tau_m: Any
    tau_s: Any
    kappa_dot_d: Any


class FeedbackGains(NamedTuple):
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


def turning_gravity(g: np.ndarray, V: np.ndarray, V_dot: np.ndarray) -> Any:
    """Gravity (3,) [m/s2] in a frame that moves with `V` and `V_dot`, (6,) each, with two derivatives: jets."""
    turning = skew(V[3:])
    g_dot = -(turning @ g)
    return jets(g, g_dot, -(skew(V_dot[3:]) @ g) - turning @ g_dot)


def _seen_from_base(robot: Any, base: Base) -> tuple[Any, Base]:
    """Return the arm and its base in {S}, with two derivatives in time: gravity turns there. A_S changes none."""
    zero = np.zeros(6)
    # the linear velocity stays 0: see `moving_base`
    V_S_dot = np.concatenate([np.zeros(3), base.V_S_dot[3:]])
    seen = replace(robot, gravity=turning_gravity(base.R_S.T @ robot.gravity, base.V_S, base.V_S_dot))
    return seen, Base(np.eye(3), jets(base.V_S, V_S_dot, zero), jets(base.V_S_dot, zero, zero))


def desired_drive_motion(
    robot: Any, desired: Desired, F_e_d: np.ndarray = NO_WRENCH, base: Base = AT_REST
) -> DriveMotion:
    """Return what springs and rotors must do while the links follow the desired motion exactly.

    ``tau_s = ID(q_d, ..) + xi_l`` and ``kappa = q_d + D(tau_s) + theta_err``; the two derivatives of kappa
    come from running these lines on jets, which takes q_d up to its fourth derivative. The derivatives of the wrench
    `F_e_d`, and of the acceleration of a moving base, are taken as zero.

    With `rotor_coupling` ID holds the rotors' reaction (11), in which each rotor turns as its link does: the
    deformation's own acceleration would take two more derivatives of q_d for each joint of the chain. What it adds to
    kappa, ``D' I_m D_ddot``, is left out here; the torques of :func:`feedforward_inverse` have it. No inverse has all
    of it: D'' of (3) jumps where a torque passes 0, and the rotors of the joints before would have to jump with it.
    """
    q, q_dot, q_ddot = desired_jets(desired)
    seen, base_jets = _seen_from_base(robot, base)
    return drive_motion(robot, q, q_dot, inverse_dynamics(seen, q, q_dot, q_ddot, F_e_d, (q_dot, q_ddot), base_jets))


def desired_jets(desired: Desired) -> tuple[Any, Any, Any]:
    """Return q_d, q_d_dot and q_d_ddot with two derivatives each, (n,) jets."""
    q_d, q_d_dot, q_d_ddot, q_d_dddot, q_d_ddddot = desired
    return jets(q_d, q_d_dot, q_d_ddot), jets(q_d_dot, q_d_ddot, q_d_dddot), jets(q_d_ddot, q_d_dddot, q_d_ddddot)


def drive_motion(robot: Any, q: Any, q_dot: Any, tau: Any) -> DriveMotion:
    """Return what springs and rotors do, of the desired motion and of the links' torques `tau`: (n,) jets each."""
    xi_l, _ = joint_friction(robot, q_dot, q_dot)
    tau_s = tau + xi_l
    kappa = rotor_position(robot, q, tau_s)
    return DriveMotion(derivative(tau_s, 0), derivative(kappa, 0), derivative(kappa, 1), derivative(kappa, 2))


def feedforward_inverse(
    robot: Any, desired: Desired, F_e_d: np.ndarray = NO_WRENCH, base: Base = AT_REST
) -> FeedforwardTorques:
    """Exact inverse of the plant along the desired motion: ``tau_m = z.T F_Dk + tau_s / ell + xi_m``.

    This is (27) with zero velocity error and ``tau_t = tau_s / ell``. ``z.T F_Dk = I_m kappa_ddot`` for rotors in pure
    rotation (56); for `rotor_coupling` see :func:`desired_drive_motion`.

    Deviation: (28) as printed, ``tau + tau_f``, adds the link-side tau_f to the motor-side tau, and tau of (27) already
    holds the spring torque as tau_t.

    Parameters
    ----------
    desired : q_d to its fourth derivative, each (n,)
    F_e_d : (6,) [N, N m] wrench that the arm is to exert on its surroundings, in {O}, constant
    base : Base
        Its motion, of :func:`~vdfmu.arm.world.attachment.moving_base`; default at rest.
    """
    drive = desired_drive_motion(robot, desired, F_e_d, base)
    xi_l, xi_m = joint_friction(robot, desired.q_d_dot, drive.kappa_dot, drive.tau_s)
    motion = link_motion(robot, desired.q_d, desired.q_d_dot, desired.q_d_ddot, base)
    F_Dk = rotor_forces(robot, motion, drive.kappa_dot, drive.kappa_ddot)  # (7), (10)
    tau_k = axial_torques(F_Dk)
    with_rotors = joint_torques(robot, desired.q_d, link_forces(robot, motion, F_e_d, F_Dk)) + xi_l  # (11), (44)-(47)
    tau_s = np.where(robot.rotor_coupling, with_rotors, drive.tau_s)
    return FeedforwardTorques(feedforward_torque(robot, tau_k, tau_s, xi_m), tau_s, drive.kappa_dot)


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


class LinkVelocities(NamedTuple):
    """Velocities of links, those required, and the derivatives of these: n times (6,) each, in {B_i}."""

    V_B: list[np.ndarray]
    V_B_r: list[np.ndarray]
    V_B_r_dot: list[np.ndarray]


def link_velocities(
    robot: Any, U_AB: list[np.ndarray], q_dot: np.ndarray, q_dot_r: Any, q_ddot_r: Any, base: Base = AT_REST
) -> LinkVelocities:
    """Return measured and required velocities of the links from those of the joints, Eq. (29)-(31), (48)-(49)."""
    found = LinkVelocities([], [], [])
    V_A, V_A_r, V_A_r_dot = base.V_S, base.V_S, base.V_S_dot
    for i in range(robot.n):
        z = joint_axis(robot.joint_types[i])
        V_A = driven_velocity(z, U_AB[i], V_A, q_dot[i])  # (29)-(31)
        V_A_r = driven_velocity(z, U_AB[i], V_A_r, q_dot_r[i])  # (48)-(49), (14)
        # the derivative of (49): U depends on the measured position, so its rate on the measured velocity
        V_A_r_dot = driven_acceleration(z, U_AB[i], V_A_r_dot, V_A_r, q_dot[i], q_ddot_r[i])
        for listed, V in zip(found, (V_A, V_A_r, V_A_r_dot), strict=True):
            listed.append(V)
    return found


def required_net_force(
    body: tuple[Any, np.ndarray, np.ndarray], K_V: Any, g_B: np.ndarray, V_B: np.ndarray, V_B_r: np.ndarray,
    V_B_r_dot: np.ndarray,
) -> np.ndarray:  # fmt: skip
    """Return the required net force of a body, Eq. (50), (15), (17): (6,) [N, N m] in {B}; see the function below."""
    return (
        mass_matrix(*body) @ V_B_r_dot
        + coriolis_matrix(*body, V_B[3:]) @ V_B_r
        + gravity_force(*body[:2], g_B)
        + K_V * (V_B_r - V_B)
    )


def required_net_forces(
    robot: Any,
    gains: FeedbackGains,
    U_AB: list[np.ndarray],
    q_dot: np.ndarray,
    kappa_dot: np.ndarray,
    required: RequiredMotion,
    base: Base = AT_REST,
) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Return the required net forces of links (50) and rotors (16), along required velocities, Eq. (48)-(49).

    The joint's base and output link are parts of the links (Table 1 gives their masses together), so that (14), (15)
    and (17) are (49) and (50). The rotor's gain K_D of (16) is k_vkappa, see :func:`drive_torques`. In pure rotation
    (56) its required velocity (13) is ``ell kappa_dot_r`` about z, and (16) is ``I_m kappa_ddot_r``.

    Deviation: (15)-(17) and (50) are read as ``F*_r = M V_r_dot + C(omega) V_r + G + K (V_r - V)``, with the required
    acceleration, as virtual decomposition control has it.

    Returns
    -------
    F_B_r_star : n times (6,) [N, N m] in {B_i}
    F_D_r_star : n times (6,) [N, N m] in {D_i}
    """
    g_B = gravity_in_links(robot, U_AB, base)
    links = link_velocities(robot, U_AB, q_dot, required.q_dot_r, required.q_ddot_r, base)
    V_B, V_B_r, V_B_r_dot = links
    F_B_r_star = [
        required_net_force(link_body(robot, i), gains.K_V[i], g_B[i], V_B[i], V_B_r[i], V_B_r_dot[i])
        for i in range(robot.n)
    ]
    at_base = LinkVelocities([base.V_S], [base.V_S], [base.V_S_dot])
    return F_B_r_star, required_rotor_forces(robot, links, kappa_dot, required, at_base)


def required_rotor_forces(
    robot: Any, links: LinkVelocities, kappa_dot: Any, required: RequiredMotion, at_base: LinkVelocities
) -> list[np.ndarray]:
    """Return the required net forces of the rotors, Eq. (16): n times (6,) [N, N m] in {D_i}.

    `at_base` are the velocities of what carries the first rotor, measured and required, and the derivative of these.
    """
    (V_S,), (V_S_r,), (V_S_r_dot,) = at_base
    V_D = rotor_velocities(robot, links.V_B, kappa_dot, V_S)  # (4)
    V_D_r = rotor_velocities(robot, links.V_B_r, required.kappa_dot_r, V_S_r)  # (13)
    V_D_r_dot = rotor_velocities(robot, links.V_B_r_dot, required.kappa_ddot_r, V_S_r_dot)
    tau_k = inertia_torques(robot, V_D_r_dot, required.kappa_ddot_r)
    z = joint_axis("revolute")
    return [
        z * tau_k[i] + coriolis_matrix(*rotor_body(robot, i), V_D[i][3:]) @ V_D_r[i] for i in range(robot.n)
    ]  # (16), of a body without mass


def required_forces(
    robot: Any,
    U_AB: list[np.ndarray],
    F_B_r_star: list[np.ndarray],
    F_D_r_star: list[np.ndarray],
    F_e_d: np.ndarray = NO_WRENCH,
) -> list[np.ndarray]:
    """Return the required force on every driven cutting point, Eq. (51)-(53), from the last link to the first.

    (52)-(53) are the constraints (18), (20) of the joints, solved for the forces as (23), (25): the base's net force
    is part of the link before it. The load F_l of (51) is the wrench `F_e_d` in {O}; a payload is part of the last
    link.

    Deviation: (53) leaves out the rotor's part of (20) and (25), ``U_BD F_D_kr``; with `rotor_coupling` it is added.

    Returns
    -------
    F_B_r : n times (6,) [N, N m] in {B_i}
    """
    F_B_r = list(F_B_r_star)
    F_B_r[-1] = F_B_r[-1] + tool_transform(robot) @ F_e_d  # (51)
    for i in reversed(range(robot.n - 1)):
        F_B_r[i] = F_B_r[i] + U_AB[i + 1] @ F_B_r[i + 1]  # (52)-(53)
        F_B_r[i] = F_B_r[i] + rotor_transform(robot, i + 1) @ F_D_r_star[i + 1]  # (19), (24)-(25)
    return F_B_r


def drive_torques(
    robot: Any,
    gains: FeedbackGains,
    required: RequiredMotion,
    tau_q: np.ndarray,
    tau_kr: np.ndarray,
    friction: tuple[Any, Any],
    q_dot: np.ndarray,
    kappa_dot: np.ndarray,
) -> tuple[Any, Any]:
    """Return the drive torques tau_t, Eq. (26), and the motor torques tau, Eq. (27).

    They solve (21) and (22) with ``z.T F_qr = tau_q`` and ``z.T F_kr = tau_kr``, by (19) and (24) the required net
    torque of the rotor, with the gain K_D of (16) in k_vkappa.

    Parameters
    ----------
    tau_q : (n,) [N m or N] axis components of the required forces, link-side
    tau_kr : (n,) [N m] axis components of the rotors' required forces, motor-side
    friction : (xi_l, xi_m) link-side and motor-side
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
    """Return the feedforward of virtual decomposition control, Eq. (12)-(27) and (48)-(53).

    Deviation: friction is evaluated at the desired velocities. At measured or required ones its slope around
    standstill, f_s / eps, is a feedback gain that destabilises every sampled loop. See the functions above for the
    others.

    Parameters
    ----------
    desired : q_d to its fourth derivative, each (n,)
    q, q_dot, kappa_dot : (n,) measured
    F_e_d, base : as in :func:`feedforward_inverse`
    """
    drive = desired_drive_motion(robot, desired, F_e_d, base)
    required = required_motion(gains, desired, drive, q, q_dot)
    U_AB = joint_transforms(robot, q)
    F_B_r_star, F_D_r_star = required_net_forces(robot, gains, U_AB, q_dot, kappa_dot, required, base)
    F_B_r = required_forces(robot, U_AB, F_B_r_star, F_D_r_star, F_e_d)
    friction = joint_friction(robot, desired.q_d_dot, drive.kappa_dot, drive.tau_s)
    tau_q, tau_kr = joint_torques(robot, q, F_B_r), axial_torques(F_D_r_star)
    tau_t, tau_m = drive_torques(robot, gains, required, tau_q, tau_kr, friction, q_dot, kappa_dot)
    return FeedforwardTorques(tau_m, robot.ell * tau_t, drive.kappa_dot)


def adaptive_torques(
    robot: Any, phi: np.ndarray, K_V: Any, q: np.ndarray, q_dot: np.ndarray, q_dot_r: Any, q_ddot_r: Any,
    base: Base = AT_REST,
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Return the axis components of the required forces (50)-(53) for estimated bodies, and what drives the estimates.

    As :func:`required_net_forces` and :func:`required_forces`, with ``M V_r_dot + C V_r + G = Y_B phi`` of
    :func:`~vdfmu.arm.equations.rigid_body.body_regressor`, without a wrench of the tool and the rotors' part.

    Parameters
    ----------
    phi : (n, 10) estimated parameters of the bodies
    K_V : (n,) gain of (50), in SI units
    q, q_dot : (n,) measured
    q_dot_r, q_ddot_r : (n,) required velocity (12), and its derivative

    Returns
    -------
    tau_q : (n,) [N m or N], link-side
    s : (n, 10) ``Y_B.T (V_B_r - V_B)``
    """
    U_AB = joint_transforms(robot, q)
    g_B = gravity_in_links(robot, U_AB, base)
    V_B, V_B_r, V_B_r_dot = link_velocities(robot, U_AB, q_dot, q_dot_r, q_ddot_r, base)
    s: list[np.ndarray] = []
    F_B_r_star: list[np.ndarray] = []
    for i in range(robot.n):
        Y_B, e_B = body_regressor(V_B[i], V_B_r[i], V_B_r_dot[i], g_B[i]), V_B_r[i] - V_B[i]
        s.append(Y_B.T @ e_B)
        F_B_r_star.append(Y_B @ phi[i] + K_V[i] * e_B)
    F_B_r = required_forces(robot, U_AB, F_B_r_star, [np.zeros(6)] * robot.n)
    return joint_torques(robot, q, F_B_r), np.array(s)
