"""The unit TorqueNoise: torques of the motors with noise."""

from __future__ import annotations

from typing import Any

from vdfmu.compiler.unit import JOINTS, Input, Parameter, Sampled, Unit, normal, seeded
from vdfmu.extras.laws.sampling import seed, whole


class TorqueNoise(Unit):
    """Noise of the motors' torques, sampled.

    ::

        tau[k] = tau_c(t_k) + sigma w_k

    w_k is the white noise of :class:`~vdfmu.extras.laws.units.devices.torque_sensor.TorqueSensor`.
    """

    tau_c = Input("N.m", JOINTS, "requested torque, motor-side")
    sigma = Parameter("N.m", JOINTS, "standard deviation of the noise, motor-side", start=0.001, minimum=0.0)
    seed = seed(3)
    period = Parameter("s", text="time between samples", start=1e-3, minimum=1e-6)
    random = Sampled("1", 6, "state of the random numbers")
    tau = Sampled("N.m", JOINTS, "motor torque, motor-side")

    def requirements(self) -> dict[str, tuple[str, Any]]:
        """Require a whole seed."""
        return {"seed": ("a whole number", whole(self.seed))}

    def start(self) -> None:
        """Without noise until the first sample."""
        self.random, self.tau = seeded(self.seed), self.tau_c

    def update(self) -> None:
        """Draw the noise and add it."""
        noise, self.random = normal(self.random, self.n)
        self.tau = self.tau_c + self.sigma * noise
