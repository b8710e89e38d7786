"""The unit MomentumObserver: external wrench without a force sensor."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from vdfmu.arm.equations.flexible_joint import link_torques
from vdfmu.arm.equations.friction import joint_friction
from vdfmu.arm.equations.inverse_dynamics import inverse_dynamics
from vdfmu.arm.equations.mapping import jacobian
from vdfmu.arm.signals import MEASURED, WRENCH, six, small_motion
from vdfmu.compiler.scalar import derivative, jets
from vdfmu.compiler.unit import JOINTS, Input, Output, Parameter, RobotParameters, Sampled, Terminal, Unit, solve


def momentum(robot: Any, q: Any, q_dot: Any, kappa_dot: Any) -> tuple[Any, Any]:
    """Generalised momentum of the links, and its rate at zero accelerations: (n,) each.

    The inverse dynamics without gravity, with these velocities as accelerations, along a motion of q only.
    """
    zero, still = np.zeros(robot.n), replace(robot, gravity=np.zeros(3))
    along = jets(q, q_dot, zero)
    p = inverse_dynamics(still, along, zero, q_dot, rotors=(zero, kappa_dot))
    return derivative(p, 0), derivative(p, 1)


class MomentumObserver(Unit):
    """Momentum observer of the external wrench, from the drives' torques (De Luca and Mattone 2003), sampled.

    The momentum of the links p = M q_dot (with rotor_coupling of the carried rotors too) follows, from (9)::

        p_dot = tau_s - xi_l + C' q_dot - G - tau_ext             tau_ext = J_q' F_e
        r     = K_o [integral (tau_s - xi_l + C' q_dot - G - r) dt - p + p(0)]

    so that r_dot = K_o (tau_ext - r): r is the torque of the wrench F_e of the arm on its surroundings, by joint,
    behind a lag of 1 / K_o. The sampled form integrates by trapezoids; it is exact for a constant tau_ext::

        r <- a r + (1 - a) [mean of (tau_s - xi_l + C' q_dot - G) - (p - p_before) / period]       a = exp(-K_o period)

    F_e_hat is the smallest wrench, in SI numbers, that results in r, by damped least squares: it is F_e for an arm of
    six or more joints away from singular positions. Friction of the links is from the model; states of drive options,
    such as hysteresis, add to r.
    """

    q = Input(*MEASURED["q"])
    q_dot = Input(*MEASURED["q_dot"])
    kappa_dot = Input(*MEASURED["kappa_dot"])
    tau_s = Input(*MEASURED["tau_s"])
    F_e_hat = Output(*WRENCH, six("Estimated force on the surroundings in {O}", "Estimated moment in {O}"))
    K_o = Parameter("1/s", JOINTS, "gain, the bandwidth of the estimate", start=100.0, minimum=1e-6, tunable=True)
    damping = Parameter("1", text="damping of the least squares, in SI units", start=1e-4, minimum=1e-9)
    period = Parameter("s", text="time between samples", start=1e-3, minimum=1e-6)
    r = Sampled("torque", JOINTS, "estimated torque of the wrench on the surroundings, link-side")
    p_before = Sampled("1", JOINTS, "momentum at the last sample, in SI units")
    b_before = Sampled("torque", JOINTS, "known part of the momentum's derivative at the last sample, link-side")
    count = Sampled("1", text="number of samples, counted up to 1")
    robot = RobotParameters()
    terminals = (Terminal("joints", "left", ("q", "q_dot", "kappa_dot", "tau_s"), "Motion and torques of the joints"),)

    def update(self) -> None:
        """Compare the momentum's rate over the last sample with its known part."""
        robot, zero = self.robot, np.zeros(self.n)
        p, change = momentum(robot, self.q, self.q_dot, self.kappa_dot)
        xi_l, _ = joint_friction(robot, self.q_dot, self.kappa_dot, self.tau_s)
        held = inverse_dynamics(robot, self.q, self.q_dot, zero, rotors=(self.kappa_dot, zero))  # C q_dot + G
        b = self.tau_s - xi_l + change - (held - link_torques(robot, self.q))
        a = np.exp(-self.K_o * self.period)
        seen = 0.5 * (b + self.b_before) - (p - self.p_before) / self.period
        self.r = a * self.r + (1.0 - a) * self.count * seen
        self.p_before, self.b_before, self.count = p, b, 1.0

    def outputs(self) -> None:
        """Wrench by damped least squares."""
        J = jacobian(self.robot, self.q)
        self.F_e_hat = J @ solve(J.T @ J + self.damping**2 * np.eye(self.n), self.r)

    def experiment(self) -> None:
        """Move a little, under torques that the motion does not explain."""
        t, phase = self.t, 0.4 * np.arange(self.n)
        motion = small_motion(t, self.n, self.experiment_stop)
        self.q, self.q_dot = motion.q_d, motion.q_d_dot
        self.kappa_dot = motion.q_d_dot + 1e-3 * np.cos(t + phase)
        self.tau_s = 10.0 * np.sin(3.0 * t + phase)
