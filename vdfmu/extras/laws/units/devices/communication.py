"""The unit Communication: late and lost commands."""

from __future__ import annotations

from typing import Any

import numpy as np

from vdfmu.compiler.unit import JOINTS, Input, Parameter, Sampled, Unit, seeded, uniform, where
from vdfmu.extras.laws.sampling import PAST, seed, shifted, whole

_NEVER = 1e6


class Communication(Unit):
    """Communication of the motor torques, with delay, jitter and lost samples, sampled.

    ::

        tau[k] = tau_c(t_i),  i the largest with t_i + T_d + T_j u_i <= t_k that is not lost

    At each sample the torques of all joints are sent together. u_i is uniform between 0 and 1, and with the probability
    `loss` a sample is lost. The output is the newest torque that has arrived, or at first the torque of the start;
    older torques that arrive later are dropped. T_d + T_j is up to 15 periods; ``age`` is the time since the output was
    sent. The random numbers are MRG32k3a's, the same on every platform, two a sample; two links need two seeds.
    """

    tau_c = Input("N.m", JOINTS, "torque that is sent, motor-side")
    T_d = Parameter("s", text="delay", start=1e-3, minimum=0.0)
    T_j = Parameter("s", text="jitter: largest additional delay", minimum=0.0)
    loss = Parameter("1", text="probability that a sample is lost", minimum=0.0, maximum=1.0)
    seed = seed(2)
    period = Parameter("s", text="time between samples", start=1e-3, minimum=1e-6)
    random = Sampled("1", 6, "state of the random numbers")
    sent = Sampled("N.m", (JOINTS, PAST), "torque sent at the samples, the newest first, motor-side")
    way = Sampled("1", PAST, "transmission times of the samples in periods, the newest first; 1e6 for a lost sample")
    age = Sampled("s", text="time since the output was sent")
    tau = Sampled("N.m", JOINTS, "torque that has arrived, motor-side")

    def requirements(self) -> dict[Any, tuple[str, Any]]:
        """Require a whole seed, and that the delay is remembered."""
        room = (PAST - 1) * self.period - self.T_d - self.T_j
        expected = f"T_d + T_j up to {PAST - 1} periods; lower them, or raise period"
        late = expected, room + 1e-9 * self.period
        return {("T_d", "T_j", "period"): late, "seed": ("a whole number", whole(self.seed))}

    def start(self) -> None:
        """As if only the torque of the start had been sent so far."""
        self.random, self.way, self.age = seeded(self.seed), np.full(PAST, _NEVER), 0.0
        self.sent, self.tau = self.tau_c[:, None] * np.ones(PAST), self.tau_c

    def update(self) -> None:
        """Send, then use the newest arrival."""
        (late, luck), self.random = uniform(self.random, 2)
        self.sent = shifted(self.sent, self.tau_c)
        self.way = shifted(self.way, where(luck < self.loss, _NEVER, (self.T_d + self.T_j * late) / self.period))
        tau, age = self.tau, self.age + self.period
        for k in reversed(range(PAST)):
            arrived = self.way[k] <= k + 1e-9
            tau, age = where(arrived, self.sent[:, k], tau), where(arrived, k * self.period, age)
        self.tau, self.age = tau, age
