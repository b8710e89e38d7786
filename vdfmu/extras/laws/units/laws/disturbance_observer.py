"""The unit DisturbanceObserverPD: feedback, and an estimate of unknown torques."""

from __future__ import annotations

import numpy as np

from vdfmu.arm.law import SampledPD
from vdfmu.compiler.unit import JOINTS, Parameter, RobotParameters, Sampled, clip


class DisturbanceObserverPD(SampledPD):
    """PD controller, Eq. (58), with a disturbance observer on the rotors, sampled.

    The rotor's equation (10), (56) minus the same along the desired motion, with the feedforward tau_m::

        I_m (kappa_ddot - kappa_ddot_d) = tau - tau_m - d                    d: torque unknown to the feedforward
        tau = tau_m + [K_p (q_d - q) + K_v (kappa_dot_d - kappa_dot)] / ell + d_hat       limited to -tau_max .. tau_max

    d [N.m, motor-side] is estimated by the filter Q = 1 / (T_Q s + 1), from the torque after the limit and the change
    of the velocity e = kappa_dot_d - kappa_dot over a sample. That is exact for constant tau - tau_m and d::

        d_hat <- a d_hat + (1 - a) [tau - tau_m + I_m (e - e_before) / period]         a = exp(-period / T_Q)

    So the error of the estimate of a constant d falls as exp(-t / T_Q). Because the estimate uses the torque after the
    limit, it does not wind up while the motor is at its limit; the estimate itself is limited to -tau_max .. tau_max.
    The load of the spring is a part of d: a small T_Q makes the rotor stiff against the link, whose vibration the motor
    then no longer damps.
    """

    T_Q = Parameter("s", JOINTS, "time constant of the estimate", start=0.05, minimum=1e-6, tunable=True)
    d_hat = Sampled("N.m", JOINTS, "estimated disturbance, motor-side")
    added = Sampled("N.m", JOINTS, "motor torque minus feedforward torque from the last sample on, motor-side")
    e_before = Sampled("velocity", JOINTS, "error of the rotor's velocity at the last sample")
    robot = RobotParameters("ell", "I_m")

    def update(self) -> None:
        """Estimate from the sample before, then the torque."""
        e = self.kappa_dot_d - self.kappa_dot
        a = np.exp(-self.period / self.T_Q)
        seen = self.added + self.robot.I_m * (e - self.e_before) / self.period
        self.d_hat = clip(a * self.d_hat + (1.0 - a) * seen, -self.tau_max, self.tau_max)
        self.tau = self.pd(self.d_hat)
        self.added = self.tau - self.tau_m
        self.e_before = e
