"""The Plant with dampers parallel to the springs of its drives, for drives with options too."""

import numpy as np

from vdfmu.arm.equations.flexible_joint import split_state, spring_rate, state_names
from vdfmu.arm.equations.plant import plant_derivative
from vdfmu.arm.units.plant import Plant
from vdfmu.unit import JOINTS, Parameter, Unit


class DampedPlant(Plant):
    """The unit Plant, whose links and rotors feel ``tau_s + d (kappa_dot - q_dot)`` instead of tau_s."""

    d = Parameter("damping", JOINTS, "damping of the drive, link-side", minimum=0.0)
    balance = Unit.balance

    def derivatives(self) -> None:
        """Equations of the plant, with the torque of spring and damper, and the rate of the spring alone."""
        x, n = self._x(), self.n
        damped = x[3 * n : 4 * n] + self.d * (self.kappa_dot - self.q_dot)
        felt = np.concatenate([x[: 3 * n], damped, x[4 * n :]])
        x_dot = plant_derivative(self.robot, felt, self.tau, self.F_e)
        names = state_names(self.of_robot)
        rates = dict(zip(names, np.split(x_dot, len(names)), strict=True))
        rates["tau_s"] = spring_rate(self.robot, split_state(self.robot, x))
        for name, rate in rates.items():
            self._write(self.declared[f"der_{name}"], rate)
