"""The unit PDGravity: feedback of the rotors only, with gravity at the desired position."""

from __future__ import annotations

from typing import Any

from vdfmu.arm.law import GravityLaw
from vdfmu.arm.signals import MEASURED, gain
from vdfmu.compiler.unit import Input


class PDGravity(GravityLaw):
    """PD control of the rotors with compensation of gravity at the desired position.

    ::

        g       = ID(q_d, 0, 0)                          spring torques that hold the arm at q_d
        kappa_d = q_d + D(g) + theta_err(kappa_d)        their rotor positions
        tau     = [g + K_p (kappa_d - kappa) + K_v (q_d_dot - kappa_dot)] / ell     limited to -tau_max .. tau_max

    It only measures the motors. At rest at q_d the error is 0, because kappa_d contains the deflection of the springs.
    The rest position is globally stable if K_p and the springs are stiffer than the slope of gravity. During a motion
    the error is about the torque of accelerations and friction, divided by K_p.

    Source: P. Tomei, "A simple PD controller for robots with elastic joints", IEEE Transactions on Automatic Control
    36(10), 1991; here with springs that stiffen, and with the desired velocity in the derivative term.
    """

    kappa = Input(*MEASURED["kappa"])
    K_p = gain("stiffness", "gain of the rotor position, link-side", 1000.0)
    K_v = gain("damping", "gain of the rotor velocity, link-side", 20.0)

    def feedback(self) -> Any:
        """Gravity and PD feedback of the rotors: (n,) [N m or N], link-side."""
        gravity, kappa_d = self.rest()
        return gravity + self.K_p * (kappa_d - self.kappa) + self.K_v * (self.q_d_dot - self.kappa_dot)

    def outputs(self) -> None:
        """Torque of the motors."""
        self.command(self.feedback())
