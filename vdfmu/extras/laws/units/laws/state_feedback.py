"""The unit StateFeedback: gains on positions and velocities of links and rotors, with gravity."""

from __future__ import annotations

from typing import Any

import numpy as np

from vdfmu.arm.law import GravityLaw
from vdfmu.arm.signals import MEASURED
from vdfmu.compiler.unit import JOINTS, Input, Parameter


def _matrix(unit: str, text: str, diagonal: float) -> Parameter:
    """Tunable matrix of gains, by default a multiple of the unit matrix."""
    return Parameter(unit, (JOINTS, JOINTS), text, start=lambda robot: diagonal * np.eye(robot.n), tunable=True)


class StateFeedback(GravityLaw):
    """Feedback of the whole state of links and rotors, with gravity.

    ::

        g       = ID(q_d, 0, 0)
        kappa_d = q_d + D(g) + theta_err(kappa_d)
        tau     = [g + K_q (q_d - q) + K_q_dot (q_d_dot - q_dot)
                     + K_kappa (kappa_d - kappa) + K_kappa_dot (q_d_dot - kappa_dot)] / ell   within -tau_max .. tau_max

    The gains are matrices, link-side: the torque of joint i depends on the errors of all joints. The start values are
    PD control of the rotors. ``vdfmu.extras.laws.gains.state_gains`` calculates optimal gains at a pose (LQR). A column
    of a prismatic joint is per m instead of per rad.

    Source: A. De Luca, W. Book, "Robots with Flexible Elements", Springer Handbook of Robotics, 2008, section 13.1.
    """

    q = Input(*MEASURED["q"])
    q_dot = Input(*MEASURED["q_dot"])
    kappa = Input(*MEASURED["kappa"])
    K_q = _matrix("stiffness", "gain of the link positions, link-side", 0.0)
    K_q_dot = _matrix("damping", "gain of the link velocities, link-side", 0.0)
    K_kappa = _matrix("stiffness", "gain of the rotor positions, link-side", 1000.0)
    K_kappa_dot = _matrix("damping", "gain of the rotor velocities, link-side", 20.0)

    def outputs(self) -> None:
        """Torque of the motors."""
        gravity, kappa_d = self.rest()
        links: Any = self.K_q @ (self.q_d - self.q) + self.K_q_dot @ (self.q_d_dot - self.q_dot)
        rotors: Any = self.K_kappa @ (kappa_d - self.kappa) + self.K_kappa_dot @ (self.q_d_dot - self.kappa_dot)
        self.command(gravity + links + rotors)
