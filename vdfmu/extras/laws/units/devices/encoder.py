"""The unit Encoder: quantised and delayed positions."""

from __future__ import annotations

from typing import Any

import numpy as np

from vdfmu.compiler.unit import JOINTS, Input, Parameter, Sampled, Unit, maximum, where
from vdfmu.extras.laws.sampling import PAST, rounded, shifted, whole


class Encoder(Unit):
    """Encoder of each joint, with its resolution and delay, and the velocity by differences, sampled.

    ::

        q_m[k]     = r floor(q(t_k - T_d) / r + 1/2)                     r = span / 2^bits
        q_dot_m[k] = a q_dot_m[k-1] + (1 - a) (q_m[k] - q_m[k-1]) / period       a = exp(-period / T_v)

    q is the position of the link or, for a motor encoder, that of the rotor divided by ell; then the span is 2 pi / ell
    for one turn of the motor. T_d is up to 15 periods; q is assumed to be linear between samples, and constant before
    the start. The error of the position is up to r / 2. Without a filter, T_v = 0, the error of the velocity is up to r
    / period.
    """

    q = Input("position", JOINTS, "position")
    span = Parameter("position", JOINTS, "range of the encoder, a length or an angle", start=2.0 * np.pi, minimum=1e-9)
    bits = Parameter("1", JOINTS, "bits of the encoder", start=17.0, minimum=1.0, maximum=48.0)
    T_d = Parameter("s", text="delay", minimum=0.0)
    T_v = Parameter("s", JOINTS, "time constant of the velocity's filter; 0: none", minimum=0.0)
    period = Parameter("s", text="time between samples", start=1e-3, minimum=1e-6)
    past = Sampled("position", (JOINTS, PAST), "positions at the samples, the newest first")
    q_m = Sampled("position", JOINTS, "measured position")
    q_dot_m = Sampled("velocity", JOINTS, "measured velocity")

    def requirements(self) -> dict[Any, tuple[str, Any]]:
        """Require whole bits, and that the delay is remembered."""
        room = (PAST - 1) * self.period - self.T_d
        return {
            ("T_d", "period"): (f"T_d up to {PAST - 1} periods; lower it, or raise period", room + 1e-9 * self.period),
            "bits": ("whole numbers", whole(self.bits)),
        }

    def start(self) -> None:
        """At rest at the positions of the joints."""
        self.past = self.q[:, None] * np.ones(PAST)
        self.q_m, self.q_dot_m = self._in_steps(self.q), np.zeros(self.n)

    def _in_steps(self, q: Any) -> Any:
        return rounded(q, self.span * 2.0**-self.bits)

    def update(self) -> None:
        """Read the delayed position."""
        self.past = shifted(self.past, self.q)
        near = maximum(1.0 - abs(self.T_d / self.period - np.arange(PAST)), 0.0)  # 1 or, of the two next to it, shares
        q_m = self._in_steps(np.sum(self.past * near, axis=1))
        a = where(self.T_v > 0.0, np.exp(-self.period / where(self.T_v > 0.0, self.T_v, 1.0)), 0.0)
        self.q_dot_m = a * self.q_dot_m + (1.0 - a) * (q_m - self.q_m) / self.period
        self.q_m = q_m
