"""The unit VirtualDecompositionControl: the paper's control with adapted parameters."""

from __future__ import annotations

from typing import Any

import numpy as np

from vdfmu.arm.equations.flexible_joint import link_torques
from vdfmu.arm.equations.friction import friction_regressor, linear_friction
from vdfmu.arm.equations.inverse_dynamics import (
    AT_REST,
    NO_WRENCH,
    Base,
    gravity_in_links,
    handed_back,
    joint_torques,
    link_motion,
    link_velocities,
)
from vdfmu.arm.equations.rigid_body import PAIRS, body_parameters
from vdfmu.arm.equations.spatial import skew
from vdfmu.arm.law import TORQUE, Law
from vdfmu.arm.signals import DESIRED, MEASURED, base_motion, base_of, gain
from vdfmu.compiler.scalar import zeros
from vdfmu.compiler.unit import JOINTS, Choice, Input, Parameter, Sampled, clip


def start_parameters(robot: Any) -> np.ndarray:
    """Parameters of the robot's bodies, (n, 10)."""
    return body_parameters(robot).reshape(-1, 10)


def start_joints(robot: Any) -> np.ndarray:
    """Inertia of the rotors, viscous and dry friction, link-side: (n, 3)."""
    return np.hstack([(robot.I_m * robot.ell)[:, None], linear_friction(robot)])


def parameter_scales(robot: Any) -> np.ndarray:
    """Scale of the parameters, (n, 10): m, m l and m l^2, with l the radius of gyration about the origin of {B}."""
    phi = start_parameters(robot)
    m, moment = phi[:, :1], phi[:, 4:5] + phi[:, 6:7] + phi[:, 9:10]
    length = np.sqrt(0.5 * moment / m)
    return np.hstack([m, np.repeat(m * length, 3, axis=1), np.repeat(m * length**2, 6, axis=1)])


def body_regressor(V_B: np.ndarray, V_B_r: np.ndarray, V_B_r_dot: np.ndarray, g_B: np.ndarray) -> np.ndarray:
    """Return Y_B with ``Y_B @ phi = M_B V_B_r_dot + C V_B_r + G_B``, phi the parameters :data:`BODY`.

    Deviation: C of (61) is not linear in ten parameters, so virtual decomposition control uses 13. The C used here is
    linear in ten: ``-(I_o omega) x`` is in the lower right, and ``-m omega x r x`` and its opposite are off the
    diagonal. It is also skew-symmetric, with the same ``C V_B`` as (61). Y_B is (6, 10); `V_B_r` is the required
    velocity, g_B: see :func:`gravity_force`.
    """
    omega_cross, omega_r_cross = skew(V_B[3:]), skew(V_B_r[3:])
    a = V_B_r_dot[:3] + omega_cross @ V_B_r[:3] + g_B
    Y_B = zeros((6, 10), V_B, V_B_r, V_B_r_dot, g_B)
    Y_B[:3, 0] = a
    Y_B[:3, 1:4] = skew(V_B_r_dot[3:]) + omega_cross @ omega_r_cross
    Y_B[3:, 1:4] = -skew(a)
    for k, (i, j) in enumerate(PAIRS, 4):
        part = np.zeros((3, 3))
        part[i, j] = part[j, i] = 1.0
        Y_B[3:, k] = part @ V_B_r_dot[3:] + omega_r_cross @ (part @ V_B[3:])
    return Y_B


def adaptive_torques(
    robot: Any,
    phi: np.ndarray,
    K_V: Any,
    q: np.ndarray,
    q_dot: np.ndarray,
    q_dot_r: Any,
    q_ddot_r: Any,
    base: Base = AT_REST,
) -> tuple[np.ndarray, np.ndarray]:
    """Return axis components of the required forces (50)-(53) for estimated bodies `phi`, (n, 10), and their drift.

    Like the feedforward, with ``M V_r_dot + C V_r + G = Y_B phi`` of :func:`body_regressor`, but without the tool's
    wrench and the rotors' part: tau_q (n,) [N m or N], link-side, of the drives, and s (n, 10), ``Y_B.T (V_B_r -
    V_B)``.
    """
    U_AB, V_B, *_ = link_velocities(robot, q, q_dot, base)
    _, V_B_r, V_B_r_dot, *_ = link_motion(robot, q, q_dot_r, q_ddot_r, base, q_dot)
    g_B = gravity_in_links(robot, U_AB, base)
    s: list[np.ndarray] = []
    F_B_r_star: list[np.ndarray] = []
    for i in range(robot.n):
        Y_B, e_B = body_regressor(V_B[i], V_B_r[i], V_B_r_dot[i], g_B[i]), V_B_r[i] - V_B[i]
        s.append(Y_B.T @ e_B)
        F_B_r_star.append(Y_B @ phi[i] + K_V[i] * e_B)
    F_B_r = handed_back(robot, U_AB, F_B_r_star, NO_WRENCH, None)
    return joint_torques(robot, F_B_r) - link_torques(robot, q), np.array(s)


def projected(phi: Any, s: Any, rate: Any, scale: Any, middle: Any, span: Any) -> Any:
    """Gradient law with projection (Zhu 2010): ``phi <- phi + rate scale^2 s`` within ``middle +- span scale``."""
    return clip(phi + rate * scale**2 * s, middle - span * scale, middle + span * scale)


def natural(phi: Any, s: Any, rate: Any) -> Any:
    """Natural law (Lee, Kwon and Park 2018) for one body: ``P_dot = rate P S P``, P the pseudo-inertia (4, 4).

    S is the symmetric matrix with ``tr(P S) = phi @ s``. The step ``(1 + rate P S / 2) P (1 + rate S P / 2)`` is of
    first order and keeps P positive definite, so the estimate stays a physical body for any step.
    """
    P, S = zeros((4, 4), phi), zeros((4, 4), s)
    for k, (i, j) in enumerate(PAIRS, 4):
        P[i, j] = P[j, i] = -phi[k]
        S[i, j] = S[j, i] = -s[k] if i == j else -0.5 * s[k]
    P[:3, :3] = P[:3, :3] + 0.5 * (phi[4] + phi[6] + phi[9]) * np.eye(3)
    S[:3, :3] = S[:3, :3] + (s[4] + s[6] + s[9]) * np.eye(3)
    P[:3, 3] = P[3, :3] = phi[1:4]
    S[:3, 3] = S[3, :3] = 0.5 * s[1:4]
    P[3, 3], S[3, 3] = phi[0], s[0]
    X = np.eye(4) + 0.5 * rate * (P @ S)
    P = X @ P @ X.T
    inertia = (P[0, 0] + P[1, 1] + P[2, 2]) * np.eye(3) - P[:3, :3]
    return np.array([P[3, 3], P[0, 3], P[1, 3], P[2, 3], *(inertia[i, j] for i, j in PAIRS)])


class VirtualDecompositionControl(Law):
    """Virtual decomposition control with adaptation, Eq. (12)-(27), (48)-(53), sampled.

    The paper's control with estimated parameters: ten numbers phi per body (mass, first moments, inertia about the
    origin of its frame), and J, b, f per joint, link-side: inertia of the rotor, viscous and dry friction. All start at
    the robot's values::

        q_dot_r = q_d_dot + Lambda (q_d - q)                                     required velocity, (12)
        F*_B,r  = Y_B phi + K_V (V_B,r - V_B)                                    required net forces, (50)
        tau_r   = z' F_B,r + J q_ddot_r + b q_dot_r + f tanh(q_d_dot / eps) + k_q (q_dot_r - q_dot)      (51)-(53), (26)
        tau     = tau_r / ell + k_vkappa (q_dot_r - kappa_dot)                   (27), limited to -tau_max .. tau_max

    With s = Y_B' (V_B,r - V_B) for bodies, and the same for joints, the estimates follow::

        phi <- phi + period gamma scale^2 s,  limited to phi_0 +- span scale     adaptation 0: projection (Zhu 2010)
        P   <- P + period gamma P S P                                            adaptation 1: natural (Lee et al. 2018)

    P is the pseudo-inertia of a body; with the natural law the estimate stays a physical body. Joints always use the
    first law. The virtual power flows (V_B,r - V_B)' (F_B,r - F_B) of two bodies at the cutting point between them
    cancel, so for stiff joints the arm's Lyapunov function decreases because of K_V and k_q. On springs k_vkappa must
    damp the rotors, and Lambda must stay below the first mode. Adaptation pauses while a motor is at its limit. The
    rotors' reaction (11) and the winding of springs are left to adaptation.
    """

    q_d_dot = Input(*DESIRED["q_d_dot"])
    q_d_ddot = Input(*DESIRED["q_d_ddot"])
    q = Input(*MEASURED["q"])
    q_dot = Input(*MEASURED["q_dot"])
    R_S, V_S, A_S = base_motion()
    Lambda = gain("1/s", "gain of the required velocity, Eq. (12)", 10.0)
    K_V = gain("1", "gain K_B of the link in SI units, times the unit matrix, Eq. (50)", 0.01)
    k_q = gain("damping", "gain of the link velocity, link-side, Eq. (26)", 0.0)
    k_vkappa = gain("damping_m", "gain of the rotor velocity, motor-side, Eq. (27)", 0.3)
    adaptation = Choice("projection", "natural", text="Law of the bodies; 0: gradient with projection, 1: natural")
    gamma = Parameter("1/J", text="Gain of the adaptation of bodies; 0: none", start=1.0, minimum=0.0, tunable=True)
    gamma_j = Parameter("1/J", text="Gain of the adaptation of joints; 0: none", start=1.0, minimum=0.0, tunable=True)
    span = Parameter("1", text="Half of the range of an estimate, relative to its scale", start=0.5, minimum=0.0)
    scale = Parameter("1", (JOINTS, 10), "scale of the parameters", start=parameter_scales, minimum=0.0)
    period = Parameter("s", text="time between samples", start=1e-3, minimum=1e-6)
    phi_0 = Parameter("1", (JOINTS, 10), "start of the parameters of the body, in SI units", start=start_parameters)
    theta_0 = Parameter("1", (JOINTS, 3), "start of J, b, f of the joint, link-side, in SI units", start=start_joints)
    phi = Sampled("1", (JOINTS, 10), "estimated parameter of the body, in SI units")
    theta = Sampled("1", (JOINTS, 3), "estimated J, b, f of the joint, link-side, in SI units")
    tau = Sampled(*TORQUE)

    def update(self) -> None:
        """Torque from the present estimates, and the next estimates."""
        robot = self.robot
        q_dot_r = self.q_d_dot + self.Lambda * (self.q_d - self.q)
        q_ddot_r = self.q_d_ddot + self.Lambda * (self.q_d_dot - self.q_dot)
        tau_q, s = adaptive_torques(robot, self.phi, self.K_V, self.q, self.q_dot, q_dot_r, q_ddot_r, base_of(self))
        Y = np.concatenate([q_ddot_r[:, None], friction_regressor(robot, q_dot_r, self.q_d_dot)], axis=1)
        e = q_dot_r - self.q_dot
        tau_r = tau_q + np.sum(Y * self.theta, axis=1) + self.k_q * e
        asked = tau_r / robot.ell + self.k_vkappa * (q_dot_r - self.kappa_dot)
        self.tau = clip(asked, -self.tau_max, self.tau_max)
        free = self.period * np.prod(np.abs(asked) <= self.tau_max)
        if self.adaptation == "natural":
            self.phi = np.array([natural(self.phi[i], s[i], free * self.gamma) for i in range(self.n)])
        else:
            self.phi = projected(self.phi, s, free * self.gamma, self.scale, self.phi_0, self.span)
        self.theta = projected(self.theta, Y * e[:, None], free * self.gamma_j, self.theta_0, self.theta_0, self.span)
