"""The unit PDController: feedback and the commanded motor torque."""

from __future__ import annotations

import numpy as np

from vdfmu.arm.equations.pd import pd_control
from vdfmu.arm.signals import DESIRED, MEASURED, gain, small_motion, torque_limit
from vdfmu.compiler.unit import JOINTS, Choice, Input, Output, RobotParameters, Terminal, Unit


class PDController(Unit):
    """Proportional-derivative controller, Eq. (58).

    ::

        tau_e = K_p (q_d - q) + K_v (v_d - v)      feedback, link-side, (58)
        tau   = tau_m + tau_e / ell                torque of the motors, limited to -tau_max .. tau_max

    The parameter velocity chooses v_d - v: kappa_dot_d - kappa_dot (0), q_d_dot - q_dot (1) or q_d_dot - kappa_dot (2).
    kappa_dot is collocated with the motor. With q_dot, as printed in (58), the derivative acts across the spring, and
    the loop is unstable at useful gains.
    """

    sampled = True
    q_d = Input(*DESIRED["q_d"])
    q_d_dot = Input(*DESIRED["q_d_dot"])
    q = Input(*MEASURED["q"])
    q_dot = Input(*MEASURED["q_dot"])
    kappa_dot = Input(*MEASURED["kappa_dot"])
    tau_m = Input("N.m", JOINTS, "feedforward torque, motor-side")
    kappa_dot_d = Input("velocity", JOINTS, "desired velocity of the rotor divided by ell")
    tau = Output("N.m", JOINTS, "motor torque, motor-side")
    tau_e = Output("torque", JOINTS, "feedback torque, link-side, Eq. (58)")
    K_p = gain("stiffness", "proportional gain, link-side, Eq. (58)", 1000.0)
    K_v = gain("damping", "derivative gain, link-side, Eq. (58)", 20.0)
    tau_max = torque_limit()
    velocity = Choice(
        "kappa_dot",
        "q_dot",
        "mixed",
        text="Derivative term; 0: kappa_dot_d - kappa_dot (collocated), "
        "1: q_d_dot - q_dot (Eq. 58), 2: q_d_dot - kappa_dot",
    )
    robot = RobotParameters("ell")
    terminals = (
        Terminal("desired", "left", ("q_d", "q_d_dot"), "Desired motion of the joints"),
        Terminal("feedforward", "bottom", ("tau_m", "kappa_dot_d"), "Torques and rotors along the desired motion"),
        Terminal("joints", "right", ("tau", "q", "q_dot", "kappa_dot"), "Motor torques and motion of the joints"),
    )

    def outputs(self) -> None:
        """Eq. (58) and the torque of the motors."""
        if self.velocity == "kappa_dot":
            velocity_d, velocity = self.kappa_dot_d, self.kappa_dot
        elif self.velocity == "q_dot":
            velocity_d, velocity = self.q_d_dot, self.q_dot
        else:
            velocity_d, velocity = self.q_d_dot, self.kappa_dot
        self.tau, self.tau_e = pd_control(
            self.K_p, self.K_v, self.robot.ell, self.tau_max, self.q_d, velocity_d, self.q, velocity, self.tau_m
        )

    def experiment(self) -> None:
        """Linear approximation of the motion of an arm near its start."""
        t, phase = self.t, 0.4 * np.arange(self.n)
        motion = small_motion(t, self.n, self.experiment_stop)
        self.q_d, self.q_d_dot = motion.q_d, motion.q_d_dot
        self.q = motion.q_d - 1e-4 * np.cos(t + phase)
        self.q_dot = motion.q_d_dot + 1e-3 * np.sin(t + phase)
        self.kappa_dot = motion.q_d_dot + 1e-3 * np.cos(t + phase)
        self.kappa_dot_d = motion.q_d_dot + 2e-3 * np.sin(2.0 * t + phase)
        self.tau_m = 0.05 * np.sin(3.0 * t + phase)
