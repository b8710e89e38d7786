"""The unit NotchFilter: removes one frequency from the torque of each joint."""

from __future__ import annotations

import numpy as np

from vdfmu.compiler.unit import JOINTS, Input, Parameter, Sampled, Unit


class NotchFilter(Unit):
    """Notch filter of second order for the torque of each joint, sampled.

    ::

        H(s) = (s^2 + 2 zeta_n w s + w^2) / (s^2 + 2 zeta_d w s + w^2)        w = 2 pi f

    With Tustin's rule prewarped at f, ``s = w / tan(w period / 2) (z - 1) / (z + 1)``, the gain of the sampled filter
    at f is zeta_n / zeta_d exactly. At any other frequency f_z it is the gain of H at
    ``w tan(pi f_z period) / tan(pi f period)``. At rest it is 1. The filter starts at rest with u = 0.

    ``vdfmu linear ROBOT`` shows the first mode for f. At f_z far below f the filter lags by
    2 (zeta_d - zeta_n) f_z / f rad: too much for a loop with a bandwidth near f.
    """

    u = Input("N.m", JOINTS, "torque before the filter, motor-side")
    f = Parameter("Hz", JOINTS, "frequency of the notch", start=20.0, minimum=1e-3)
    zeta_n = Parameter("1", JOINTS, "damping of the zeros", start=0.05, minimum=0.0)
    zeta_d = Parameter("1", JOINTS, "damping of the poles", start=0.7, minimum=1e-3)
    period = Parameter("s", text="time between samples", start=1e-3, minimum=1e-6)
    z_1 = Sampled("N.m", JOINTS, "first state of the filter")
    z_2 = Sampled("N.m", JOINTS, "second state of the filter")
    y = Sampled("N.m", JOINTS, "torque behind the filter, motor-side")

    def requirements(self) -> dict[str, tuple[str, float]]:
        """Require a notch below half of the sampling frequency."""
        return {"f": ("less than half of 1 / period, for every joint", np.prod(0.5 / self.period > self.f) - 0.5)}

    def update(self) -> None:
        """Transposed direct form II."""
        t = np.tan(np.pi * self.f * self.period)
        a_0 = 1.0 + 2.0 * self.zeta_d * t + t * t
        b_0 = (1.0 + 2.0 * self.zeta_n * t + t * t) / a_0
        b_1 = 2.0 * (t * t - 1.0) / a_0  # the coefficient of the poles too
        b_2 = (1.0 - 2.0 * self.zeta_n * t + t * t) / a_0
        a_2 = (1.0 - 2.0 * self.zeta_d * t + t * t) / a_0
        self.y = b_0 * self.u + self.z_1
        self.z_1 = b_1 * (self.u - self.y) + self.z_2
        self.z_2 = b_2 * self.u - a_2 * self.y
