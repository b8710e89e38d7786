"""The unit JointTorque: feedback of the rotors, and of the drives' torques to make rotors seem lighter."""

from __future__ import annotations

from vdfmu.arm.signals import MEASURED
from vdfmu.compiler.unit import JOINTS, Input, Parameter
from vdfmu.extras.laws.units.laws.pd_gravity import PDGravity


class JointTorque(PDGravity):
    """Passivity-based control with joint torque sensors.

    ::

        u   = g + K_p (kappa_d - kappa) + K_v (q_d_dot - kappa_dot)       as in PDGravity
        tau = [tau_s + (u - tau_s) / s] / ell                             limited to -tau_max .. tau_max

    With s = share, 1 for no torque feedback, rotors move as if they had the inertia s I_m and the friction s xi_m,
    under the torque u::

        s I_m kappa_ddot + s xi_m + tau_s / ell = u / ell

    At a constant q_d they are passive from -(tau_s - g) to kappa_dot, whatever the links do: with a passive arm and
    surroundings the loop is stable. tau_s is the torque of the whole drive. Sampling bounds s from below, because the
    rotor's gain is K_v / (s ell I_m) times the step, and a held torque is late for the mode of a light link on a stiff
    spring: a wrist needs an s near 1, and with a sample of delay every joint does.

    Source: A. Albu-Schaeffer, C. Ott, G. Hirzinger, "A unified passivity-based control framework for position, torque
    and impedance control of flexible joint robots", International Journal of Robotics Research 26(1), 2007; without the
    derivative of the torque, for undamped springs, and with gravity at q_d.
    """

    tau_s = Input(*MEASURED["tau_s"])
    share = Parameter(
        "1",
        JOINTS,
        "rotor inertia after the torque feedback, as a share of the real inertia",
        start=0.9,
        minimum=1e-3,
        maximum=1.0,
        tunable=True,
    )

    def outputs(self) -> None:
        """Torque of the motors."""
        self.command(self.tau_s + (self.feedback() - self.tau_s) / self.share)
