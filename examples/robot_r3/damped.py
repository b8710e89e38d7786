"""The Plant with dampers parallel to the springs of its drives."""

import numpy as np

from vdfmu.arm.equations.flexible_joint import PlantState, spring_rate
from vdfmu.arm.equations.plant import plant_derivative
from vdfmu.arm.units.plant import Plant
from vdfmu.unit import JOINTS, Parameter, Unit


class DampedPlant(Plant):
    """The unit Plant, whose links and rotors feel ``tau_s + d (kappa_dot - q_dot)`` instead of tau_s."""

    d = Parameter("damping", JOINTS, "damping of the drive, link-side", minimum=0.0)
    balance = Unit.balance

    def derivatives(self) -> None:
        """Equations of the plant, with the torque of spring and damper, and the rate of the spring alone."""
        torque = self.tau_s + self.d * (self.kappa_dot - self.q_dot)
        x = np.concatenate([self.q, self.q_dot, self.kappa_dot, torque])
        x_dot = plant_derivative(self.robot, x, self.tau, self.F_e)
        self.der_q, self.der_q_dot, self.der_kappa_dot, _ = np.split(x_dot, 4)
        self.der_tau_s = spring_rate(self.robot, PlantState(self.q, self.q_dot, self.kappa_dot, self.tau_s))
