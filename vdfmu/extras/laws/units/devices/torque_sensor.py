"""The unit TorqueSensor: torques of the springs with noise."""

from __future__ import annotations

from typing import Any

from vdfmu.arm.signals import MEASURED
from vdfmu.compiler.unit import JOINTS, Input, Parameter, Sampled, Unit, normal, seeded
from vdfmu.extras.laws.sampling import rounded, seed, whole


class TorqueSensor(Unit):
    """Torque sensor of each joint, with offset, noise and resolution, sampled.

    ::

        tau_s_m[k] = r floor((tau_s(t_k) + offset + sigma w_k) / r + 1/2)

    w_k is white, of mean 0 and standard deviation 1: the sum of twelve uniform numbers less 6, at most 6. All is
    link-side. The random numbers are MRG32k3a's, the same on every platform. Two sensors need two seeds, or their noise
    is the same.
    """

    tau_s = Input(*MEASURED["tau_s"])
    offset = Parameter("torque", JOINTS, "offset")
    sigma = Parameter("torque", JOINTS, "standard deviation of the noise", start=0.1, minimum=0.0)
    resolution = Parameter("torque", JOINTS, "resolution r", start=1e-9, minimum=1e-12)
    seed = seed(1)
    period = Parameter("s", text="time between samples", start=1e-3, minimum=1e-6)
    random = Sampled("1", 6, "state of the random numbers")
    tau_s_m = Sampled("torque", JOINTS, "measured spring torque, link-side")

    def requirements(self) -> dict[str, tuple[str, Any]]:
        """Require a whole seed."""
        return {"seed": ("a whole number", whole(self.seed))}

    def start(self) -> None:
        """Without noise until the first sample."""
        self.random = seeded(self.seed)
        self.tau_s_m = rounded(self.tau_s + self.offset, self.resolution)

    def update(self) -> None:
        """Draw the noise, then round."""
        noise, self.random = normal(self.random, self.n)
        self.tau_s_m = rounded(self.tau_s + self.offset + self.sigma * noise, self.resolution)
