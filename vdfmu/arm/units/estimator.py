"""The unit TorqueEstimator: spring torques from measured positions."""

from __future__ import annotations

import numpy as np

from vdfmu.arm.equations.torque_estimation import torque_estimates
from vdfmu.arm.robot.parameters import SPRING_KEYS
from vdfmu.arm.signals import MEASURED, small_motion
from vdfmu.compiler.unit import JOINTS, Input, Output, Parameter, RobotParameters, Terminal, Unit


class TorqueEstimator(Unit):
    """Joint torque from the positions of link and rotor, Eq. (2)-(3).

    With the measured deformation delta = kappa - q - theta_err(kappa)::

        tau_f_hat = tan(c_f K_f0 [delta - delta_w(tau)]) / c_f        as printed, (2)-(3)
        delta_w   = sgn(tau) (1 - exp(-c_w |tau|)) / (c_w ell K_w0)   the motor's torque at the wave generator
        D(tau_s_hat) = delta                                          consistent: it carries tau_s_hat / ell

    Both are limited to +- tau_hat_max, which is also the estimate for deformations beyond the pole of the tangent.
    """

    sampled = True
    q = Input(*MEASURED["q"])
    kappa = Input(*MEASURED["kappa"])
    tau = Input("N.m", JOINTS, "motor torque, motor-side")
    tau_s_hat = Output("torque", JOINTS, "spring torque from the positions alone, link-side")
    tau_f_hat = Output("torque", JOINTS, "spring torque from the motor torque, link-side, Eq. (2)-(3) as printed")
    tau_hat_max = Parameter(
        "torque",
        JOINTS,
        "largest estimate, link-side; start: 10/c_f, where the flexspline is 100 times as stiff as at rest",
        start=lambda robot: 10.0 / robot.c_f,
        minimum=0.0,
        tunable=True,
    )
    robot = RobotParameters(*SPRING_KEYS)
    terminals = (
        Terminal("joints", "left", ("tau", "q", "kappa"), "Motor torques and positions of the joints"),
        Terminal("estimates", "right", ("tau_s_hat", "tau_f_hat"), "Estimated spring torques"),
    )

    def outputs(self) -> None:
        """Both estimates."""
        estimates = torque_estimates(self.robot, self.q, self.kappa, self.tau, self.tau_hat_max)
        self.tau_s_hat, self.tau_f_hat = estimates.tau_s_hat, estimates.tau_f_hat

    def experiment(self) -> None:
        """Move a little, with deformations of the size that catalogue drives have."""
        t, phase = self.t, 0.4 * np.arange(self.n)
        self.q = small_motion(t, self.n, self.experiment_stop).q_d - 1e-4 * np.cos(t + phase)
        self.kappa = self.q + 1e-3 * np.sin(2.0 * t + phase)
        self.tau = 0.1 * np.sin(3.0 * t + phase)
