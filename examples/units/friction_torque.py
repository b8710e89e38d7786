"""Computed torque with compensation of friction: a law of the package, extended."""

from typing import Any

from vdfmu.arm.equations.friction import joint_friction
from vdfmu.extras.laws.units.laws.computed_torque import ComputedTorque


class FrictionTorque(ComputedTorque):
    """Computed torque, and the friction of the desired motion.

    ::

        tau = [.. + xi_l(q_d_dot)] / ell + xi_m(q_d_dot)       .. as ComputedTorque has it

    Friction follows Eq. (54)-(55). At the measured velocity it would be feedback, as steep as f_s / eps at rest.
    """

    def command(self, torque: Any) -> None:
        xi_l, xi_m = joint_friction(self.robot, self.q_d_dot, self.q_d_dot)
        super().command(torque + xi_l + self.robot.ell * xi_m)
