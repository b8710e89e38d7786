"""The Plant with dampers parallel to the springs of its drives, for drives with options too."""

import numpy as np

from vdfmu.arm.equations.plant import plant_derivative
from vdfmu.arm.units.plant import Plant
from vdfmu.unit import JOINTS, Parameter, Unit


class DampedPlant(Plant):
    """The unit Plant, whose links and rotors feel ``tau_s + d (kappa_dot - q_dot)`` instead of tau_s."""

    d = Parameter("damping", JOINTS, "damping of the drive, link-side", minimum=0.0)
    balance = Unit.balance

    def derivatives(self) -> None:
        """Equations of the plant, with the torque of spring and damper for the bodies, and the rate of the spring."""
        super().derivatives()
        x, n = self._x(), self.n
        damped = x[3 * n : 4 * n] + self.d * (self.kappa_dot - self.q_dot)
        felt = np.concatenate([x[: 3 * n], damped, x[4 * n :]])
        x_dot = plant_derivative(self.robot, felt, self.tau, self.F_e)
        self.der_q_dot, self.der_kappa_dot = x_dot[n : 2 * n], x_dot[2 * n : 3 * n]
