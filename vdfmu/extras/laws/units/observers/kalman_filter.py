"""The unit KalmanFilter: motion of links from encoders of motors."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from vdfmu.arm.equations.flexible_joint import rotor_position
from vdfmu.arm.equations.friction import linear_friction
from vdfmu.arm.equations.harmonic_drive import deformation_derivative
from vdfmu.arm.equations.mapping import joint_space_mass_matrix
from vdfmu.arm.equations.plant import equilibrium_torque
from vdfmu.compiler.scalar import derivative, jets
from vdfmu.compiler.unit import JOINTS, Input, Parameter, RobotParameters, Sampled, Terminal, Unit, expm


def _rest(robot: Any, q: Any) -> Any:
    """Positions of the rotors [rad or m] and motor torques [N m] that hold a pose, (n,) each."""
    held = equilibrium_torque(robot, q)
    return rotor_position(robot, q, held), held / robot.ell


def _model(robot: Any, q: Any, period: float) -> Any:
    """Each joint over a period about a pose, (n, 4, 6): by its state, motor torque and torque on the link."""
    zero, links = np.zeros(robot.n), np.diag(joint_space_mass_matrix(robot, q))
    stiffness = 1.0 / deformation_derivative(robot, _rest(robot, q)[1] * robot.ell)
    viscous = linear_friction(robot)[:, 0]
    on_rotor = viscous * float(robot.friction == "lumped")
    joints = []
    for i, (M, J, K, ell) in enumerate(zip(links, robot.I_m * robot.ell, stiffness, robot.ell, strict=True)):
        turned = equilibrium_torque(robot, jets(q, np.eye(robot.n)[i], zero))
        K_g, b, b_q = derivative(turned, 1)[i], on_rotor[i], viscous[i] - on_rotor[i]
        rates = np.zeros((6, 6))
        rates[:4] = [
            [0.0, 1.0, 0.0, 0.0, 0.0, 0.0],
            [-(K + K_g) / M, -b_q / M, K / M, 0.0, 0.0, 1.0 / M],
            [0.0, 0.0, 0.0, 1.0, 0.0, 0.0],
            [K / J, 0.0, -K / J, -b / J, ell / J, 0.0],
        ]
        joints.append(expm(rates * period)[:4])
    return np.array(joints)


def _designed(name: str) -> Callable[[Any], Any]:
    return lambda robot: KalmanFilter.design(robot)[name]


class KalmanFilter(Unit):
    """Kalman filter for positions and velocities of links, from encoders and torques of motors, sampled.

    Each joint is filtered separately, about a pose q_0 held by kappa_0 and tau_0, with x = [q - q_0, q_dot, kappa -
    kappa_0, kappa_dot]::

        M q_ddot     = K (kappa - q) - K_g q - b_q q_dot + w_q             M, K_g: of the arm at the pose, its diagonal
        J kappa_ddot = ell (tau + w_tau) - K (kappa - q) - b kappa_dot     K: of the spring under the weight
        x_hat <- A x_hat + B (tau - tau_0) + L (kappa - kappa_hat)         over a period, tau held

    `design` returns the parameters for a pose, a period and the sizes of noise. After a step the estimate is that for
    the end of the step, in time for its readers. Coupling of the joints, dry friction and another pose act on the
    filter as unknown torques.
    """

    kappa = Input("position", JOINTS, "measured position of the rotor divided by ell")
    tau = Input("N.m", JOINTS, "motor torque, motor-side")
    period = Parameter("s", text="time between samples", start=1e-3, minimum=1e-6)
    design_period = Parameter("s", text="period for which joint and L are designed", start=_designed("design_period"))
    rest = Parameter("1", (JOINTS, 3), "q, kappa and tau of the pose at rest, in SI units", start=_designed("rest"))
    joint = Parameter(
        "1",
        (JOINTS, 4, 5),
        "matrix [A, B] of each joint over a period, for its state and motor torque",
        start=_designed("joint"),
    )
    L = Parameter("1", (JOINTS, 4), "gain, in SI units", start=_designed("L"))
    q_hat = Sampled("position", JOINTS, "estimated position of the link", delayed=True)
    q_dot_hat = Sampled("velocity", JOINTS, "estimated velocity of the link", delayed=True)
    kappa_hat = Sampled("position", JOINTS, "estimated position of the rotor divided by ell", delayed=True)
    kappa_dot_hat = Sampled("velocity", JOINTS, "estimated velocity of the rotor divided by ell", delayed=True)
    robot = RobotParameters("ell")
    terminals = (Terminal("joints", "left", ("tau", "kappa"), "Motor torques and positions of the joints"),)

    @staticmethod
    def design(
        robot: Any,
        q: Any = 0.0,
        *,
        period: float = 1e-3,
        sigma_tau: Any = 0.01,
        sigma_q: Any = 1.0,
        sigma_kappa: Any = 1e-5,
    ) -> dict[str, Any]:
        """Return ``period`` [s], ``design_period``, ``rest``, ``joint`` and ``L`` of the stationary filter at a pose.

        Parameters
        ----------
        q : (n,) or float [rad or m]
            Pose of the links.
        sigma_tau, sigma_q : (n,) or float [N m or N]
            Standard deviations of the unknown torques on the rotor, motor-side, and on the link, held over a period.
        sigma_kappa : (n,) or float [rad or m]
            Standard deviation of the encoder's noise.
        """
        from scipy.linalg import solve_discrete_are  # slow to import

        pose, *sigmas = (
            np.broadcast_to(np.asarray(each, float), robot.n) for each in (q, sigma_tau, sigma_q, sigma_kappa)
        )
        joints, gains, C = _model(robot, pose, period), [], np.array([[0.0, 0.0, 1.0, 0.0]])
        for AB, torque, load, noise in zip(joints, *sigmas, strict=True):
            A, G = AB[:, :4], AB[:, 4:] * [torque, load]
            P = solve_discrete_are(A.T, C.T, G @ G.T, np.array([[noise**2]]))
            gains.append(A @ P[:, 2] / (P[2, 2] + noise**2))
        filter_values = {"joint": joints[:, :, :5], "L": np.array(gains)}
        rest = np.stack([pose, *_rest(robot, pose)], axis=1)
        return {"period": period, "design_period": period, "rest": rest, **filter_values}

    def requirements(self) -> dict[str, tuple[str, Any]]:
        """Require the period of the design."""
        away = np.abs(self.period - self.design_period)
        return {"period": ("design_period, for which joint and L are designed", 1e-9 * self.period - away)}

    def start(self) -> None:
        """At rest at the position of the encoder, the spring as at the pose."""
        self.q_hat, self.q_dot_hat = self.kappa - self.rest[:, 1] + self.rest[:, 0], np.zeros(self.n)
        self.kappa_hat, self.kappa_dot_hat = self.kappa, np.zeros(self.n)

    def update(self) -> None:
        """Predict the end of the period."""
        q_0, kappa_0, tau_0 = self.rest[:, 0], self.rest[:, 1], self.rest[:, 2]
        error, torque = self.kappa - self.kappa_hat, self.tau - tau_0
        x = [self.q_hat - q_0, self.q_dot_hat, self.kappa_hat - kappa_0, self.kappa_dot_hat, torque]
        x = np.sum(self.joint * np.stack(x, axis=1)[:, None, :], axis=2) + self.L * error[:, None]
        self.q_hat, self.q_dot_hat, self.kappa_hat, self.kappa_dot_hat = (
            x[:, 0] + q_0,
            x[:, 1],
            x[:, 2] + kappa_0,
            x[:, 3],
        )
