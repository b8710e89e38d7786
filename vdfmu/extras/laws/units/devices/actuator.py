"""The unit Actuator: motors and drives with limits."""

from __future__ import annotations

from typing import Any

import numpy as np

from vdfmu.arm.signals import torque_limit
from vdfmu.compiler.unit import JOINTS, Input, Parameter, Sampled, Unit, clip, minimum
from vdfmu.compiler.unit.declaration import NO_LIMIT


class Actuator(Unit):
    """Motor and drive of each joint, with limits of torque, its rate, current and heat, sampled.

    ::

        |tau[k] - tau[k-1]| <= tau_dot_max period                       then
        |tau[k]| <= min(tau_max, k_t i_lim)              i = tau / k_t
        h[k] = a h[k-1] + (1 - a) i[k]^2                    h <= i_rms^2         a = exp(-period / T_i)

    h is the mean square of the current over the thermal time constant T_i. i_lim = min(i_max, i_h), where i_h, at least
    i_rms, is the current with which h = i_rms^2 after the sample. So a cold motor delivers i_max for ``-T_i ln(1 -
    i_rms^2 / i_max^2)``, then i_rms. If heat limits the current, the torque falls faster than tau_dot_max. All limits
    are off by default.
    """

    tau_c = Input("N.m", JOINTS, "requested torque, motor-side")
    k_t = Parameter("N.m/A", JOINTS, "torque constant", start=1.0, minimum=1e-9)
    tau_max = torque_limit()
    tau_dot_max = Parameter("N.m/s", JOINTS, "limit of the rate of the torque", start=NO_LIMIT, minimum=0.0)
    i_max = Parameter("A", JOINTS, "limit of the current", start=NO_LIMIT, minimum=0.0)
    i_rms = Parameter("A", JOINTS, "limit of the RMS current", start=NO_LIMIT, minimum=0.0)
    T_i = Parameter("s", JOINTS, "thermal time constant over which the RMS current is taken", start=10.0, minimum=1e-6)
    period = Parameter("s", text="time between samples", start=1e-3, minimum=1e-6)
    h = Sampled("A2", JOINTS, "mean of the square of the current")
    i = Sampled("A", JOINTS, "current")
    tau = Sampled("N.m", JOINTS, "motor torque, motor-side")

    def start(self) -> None:
        """Cold, with the commanded torque."""
        limit = self._limit(0.0)
        self.tau, self.h = clip(self.tau_c, -limit, limit), np.zeros(self.n)
        self.i = self.tau / self.k_t

    def _limit(self, kept: Any) -> Any:
        """Largest torque (n,) [N.m] if h would be `kept` [A^2] without current."""
        warm = (self.i_rms**2 - kept) / -np.expm1(-self.period / self.T_i)
        return minimum(self.tau_max, self.k_t * minimum(self.i_max, np.sqrt(warm)))

    def update(self) -> None:
        """Limit the rate, then the torque."""
        kept = np.exp(-self.period / self.T_i) * self.h
        change, limit = self.tau_dot_max * self.period, self._limit(kept)
        self.tau = clip(clip(self.tau_c, self.tau - change, self.tau + change), -limit, limit)
        self.i = self.tau / self.k_t
        self.h = kept - np.expm1(-self.period / self.T_i) * self.i**2
