"""The unit KalmanFilter: motion of links from encoders of motors."""

from __future__ import annotations

from typing import Any

import numpy as np

from vdfmu.arm.equations.flexible_joint import rotor_position
from vdfmu.arm.equations.friction import linear_friction
from vdfmu.arm.equations.harmonic_drive import deformation_derivative
from vdfmu.arm.equations.inverse_dynamics import inverse_dynamics
from vdfmu.arm.equations.mapping import joint_space_mass_matrix
from vdfmu.compiler.scalar.jet import derivative, jets
from vdfmu.compiler.unit import JOINTS, Input, Parameter, RobotParameters, Sampled, Terminal, Unit, expm


def rest(q_pose: Any, robot: Any) -> Any:
    """Position of the rotor [rad or m] and motor torque [N m] that hold each joint at a pose, (n, 2)."""
    held = inverse_dynamics(robot, q_pose, np.zeros(robot.n), np.zeros(robot.n))
    return np.stack([rotor_position(robot, q_pose, held), held / robot.ell], axis=1)


def model(period: Any, q_pose: Any, robot: Any) -> Any:
    """Each joint over a period about a pose, (n, 4, 6): of state, motor torque and torque on the link, both held."""
    zero, links = np.zeros(robot.n), np.diag(joint_space_mass_matrix(robot, q_pose))
    stiffness = 1.0 / deformation_derivative(robot, rest(q_pose, robot)[:, 1] * robot.ell)
    viscous = linear_friction(robot)[:, 0]
    on_rotor = viscous * float(robot.friction == "lumped")
    found = []
    for i, (M, J, K, ell) in enumerate(zip(links, robot.I_m * robot.ell, stiffness, robot.ell, strict=True)):
        turned = inverse_dynamics(robot, jets(q_pose, np.eye(robot.n)[i], zero), zero, zero)
        K_g, b, b_q = derivative(turned, 1)[i], on_rotor[i], viscous[i] - on_rotor[i]
        rates = np.zeros((6, 6))
        rates[:4] = [
            [0.0, 1.0, 0.0, 0.0, 0.0, 0.0],
            [-(K + K_g) / M, -b_q / M, K / M, 0.0, 0.0, 1.0 / M],
            [0.0, 0.0, 0.0, 1.0, 0.0, 0.0],
            [K / J, 0.0, -K / J, -b / J, ell / J, 0.0],
        ]
        found.append(expm(rates * period)[:4])
    return np.array(found)


def gain(joint: Any, sigma_tau: Any, sigma_q: Any, sigma_kappa: Any) -> Any:
    """Gain of the stationary Kalman filter in predictor form, (n, 4)."""
    from scipy.linalg import solve_discrete_are  # takes long to import

    found, C = [], np.array([[0.0, 0.0, 1.0, 0.0]])
    for AB, *sigmas, sigma in zip(joint, sigma_tau, sigma_q, sigma_kappa, strict=True):
        A, G = AB[:, :4], AB[:, 4:] * sigmas
        P = solve_discrete_are(A.T, C.T, G @ G.T, np.array([[sigma**2]]))
        found.append(A @ P[:, 2] / (P[2, 2] + sigma**2))
    return np.array(found)


class KalmanFilter(Unit):
    """Kalman filter for positions and velocities of links, from encoders and torques of motors, sampled.

    Each joint by itself about the pose q_pose, x = [q - q_pose, q_dot, kappa - kappa_pose, kappa_dot]::

        M q_ddot     = K (kappa - q) - K_g q - b_q q_dot + w_q             M, K_g: of the arm at the pose, its diagonal
        J kappa_ddot = ell (tau + w_tau) - K (kappa - q) - b kappa_dot     K: of the spring under the weight
        x_hat <- A x_hat + B (tau - tau_pose) + L (kappa - kappa_hat)      over a period, tau held

    L is that of the stationary filter for unknown torques w_tau, w_q, held over a period, and noise of the encoder, of
    standard deviations sigma_tau, sigma_q, sigma_kappa. After a step the estimate is that of its end, so that others
    read it in time. What the joints' coupling, dry friction and another pose add is to the filter an unknown torque.
    """

    kappa = Input("position", JOINTS, "measured position of the rotor divided by ell")
    tau = Input("N.m", JOINTS, "motor torque, motor-side")
    q_pose = Parameter("position", JOINTS, "pose about which the filter is linear")
    sigma_tau = Parameter("N.m", JOINTS, "unknown torque on the rotor, motor-side", start=0.01, minimum=0.0)
    sigma_q = Parameter("torque", JOINTS, "unknown torque on the link, link-side", start=1.0, minimum=1e-9)
    sigma_kappa = Parameter("position", JOINTS, "noise of the encoder", start=1e-5, minimum=1e-12)
    period = Parameter("s", text="time between samples", start=1e-3, minimum=1e-6)
    held = Parameter("1", (JOINTS, 2), "kappa and tau that hold the pose, in SI units", start=rest)
    joint = Parameter("1", (JOINTS, 4, 6), "state, motor torque and torque on the link over a period", start=model)
    L = Parameter("1", (JOINTS, 4), "gain, in SI units", start=gain)
    q_hat = Sampled("position", JOINTS, "estimated position of the link", delayed=True)
    q_dot_hat = Sampled("velocity", JOINTS, "estimated velocity of the link", delayed=True)
    kappa_hat = Sampled("position", JOINTS, "estimated position of the rotor divided by ell", delayed=True)
    kappa_dot_hat = Sampled("velocity", JOINTS, "estimated velocity of the rotor divided by ell", delayed=True)
    robot = RobotParameters("ell")
    terminals = (Terminal("joints", "left", ("tau", "kappa"), "Motor torques and positions of the joints"),)

    def start(self) -> None:
        """At rest where the encoder is, the spring as at the pose."""
        self.q_hat, self.q_dot_hat = self.kappa - self.held[:, 0] + self.q_pose, np.zeros(self.n)
        self.kappa_hat, self.kappa_dot_hat = self.kappa, np.zeros(self.n)

    def update(self) -> None:
        """Predict the end of the period."""
        error, torque, rest = self.kappa - self.kappa_hat, self.tau - self.held[:, 1], self.held[:, 0]
        x = [self.q_hat - self.q_pose, self.q_dot_hat, self.kappa_hat - rest, self.kappa_dot_hat, torque]
        x = np.sum(self.joint[:, :, :5] * np.stack(x, axis=1)[:, None, :], axis=2) + self.L * error[:, None]
        self.q_hat, self.q_dot_hat, self.kappa_hat, self.kappa_dot_hat = (
            x[:, 0] + self.q_pose, x[:, 1], x[:, 2] + rest, x[:, 3]
        )  # fmt: skip
