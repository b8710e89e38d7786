"""The unit DisturbanceObserverPD: feedback, and an estimate of what the feedforward does not know."""

from __future__ import annotations

import numpy as np

from vdfmu.arm.equations.pd import pd_control
from vdfmu.arm.units._signals import DESIRED, MEASURED, gain, small_motion, torque_limit
from vdfmu.compiler.unit import JOINTS, Input, Parameter, RobotParameters, Sampled, Terminal, Unit, clip


class DisturbanceObserverPD(Unit):
    """PD controller, Eq. (58), with a disturbance observer on the rotors, sampled.

    The rotor's equation (10), (56) less the same along the desired motion, for which the feedforward is tau_m::

        I_m (kappa_ddot - kappa_ddot_d) = tau - tau_m - d                    d: what the feedforward does not know
        tau = tau_m + [K_p (q_d - q) + K_v (kappa_dot_d - kappa_dot)] / ell + d_hat       limited to -tau_max .. tau_max

    d [N.m, motor-side] is estimated by the filter Q = 1 / (T_Q s + 1), from the torque after the limit and the change
    of the velocity e = kappa_dot_d - kappa_dot over a sample. That is exact where tau - tau_m and d are constant::

        d_hat <- a d_hat + (1 - a) [tau - tau_m + I_m (e - e_before) / period]         a = exp(-period / T_Q)

    So a constant d is known to exp(-t / T_Q). Since the estimate sees the torque after the limit, it does not wind up
    while the motor is at its limit, and it is limited to -tau_max .. tau_max itself. The load of the spring is a part
    of d: a small T_Q makes the rotor stiff against the link, whose vibration the motor then no longer damps.
    """

    q_d = Input(*DESIRED["q_d"])
    q = Input(*MEASURED["q"])
    kappa_dot_d = Input("velocity", JOINTS, "desired velocity of the rotor divided by ell")
    kappa_dot = Input(*MEASURED["kappa_dot"])
    tau_m = Input("N.m", JOINTS, "feedforward torque, motor-side")
    K_p = gain("stiffness", "proportional gain, link-side, Eq. (58)", 1000.0)
    K_v = gain("damping", "derivative gain, link-side, Eq. (58)", 20.0)
    tau_max = torque_limit()
    T_Q = Parameter("s", JOINTS, "time constant of the estimate", start=0.05, minimum=1e-6, tunable=True)
    period = Parameter("s", text="time between samples", start=1e-3, minimum=1e-6)
    d_hat = Sampled("N.m", JOINTS, "estimated disturbance, motor-side")
    tau = Sampled("N.m", JOINTS, "motor torque, motor-side")
    added = Sampled("N.m", JOINTS, "motor torque less the feedforward's since the last sample, motor-side")
    e_before = Sampled("velocity", JOINTS, "error of the rotor's velocity at the last sample")
    robot = RobotParameters("ell", "I_m")
    terminals = (
        Terminal("desired", "left", ("q_d",), "Desired motion of the joints"),
        Terminal("feedforward", "bottom", ("tau_m", "kappa_dot_d"), "Torques and rotors along the desired motion"),
        Terminal("joints", "right", ("tau", "q", "kappa_dot"), "Motor torques and motion of the joints"),
    )

    def update(self) -> None:
        """Estimate from the sample before, then the torque."""
        e = self.kappa_dot_d - self.kappa_dot
        a = np.exp(-self.period / self.T_Q)
        seen = self.added + self.robot.I_m * (e - self.e_before) / self.period
        self.d_hat = clip(a * self.d_hat + (1.0 - a) * seen, -self.tau_max, self.tau_max)
        self.tau, _ = pd_control(
            self.K_p, self.K_v, self.robot.ell, self.tau_max, self.q_d, self.kappa_dot_d, self.q, self.kappa_dot,
            self.tau_m + self.d_hat,
        )  # fmt: skip
        self.added = self.tau - self.tau_m
        self.e_before = e

    def experiment(self) -> None:
        """Follow a small motion nearly."""
        t, phase = self.t, 0.4 * np.arange(self.n)
        motion = small_motion(t, self.n, self.experiment_stop)
        self.q_d, self.kappa_dot_d = motion.q_d, motion.q_d_dot
        self.q = motion.q_d - 1e-4 * np.cos(t + phase)
        self.kappa_dot = motion.q_d_dot + 1e-3 * np.cos(t + phase)
        self.tau_m = 0.05 * np.sin(3.0 * t + phase)
