"""The unit IterativeLearningPD: feedback, and a torque learned over cycles of the motion."""

from __future__ import annotations

from typing import Any

import numpy as np

from vdfmu.arm.law import SampledPD
from vdfmu.compiler.unit import JOINTS, Parameter, Sampled, clip, minimum, where
from vdfmu.extras.laws.sampling import whole

HARMONICS = 20
"""Most harmonics of a cycle that are learned."""


class IterativeLearningPD(SampledPD):
    """PD controller, Eq. (58), with a torque learned over cycles of the motion, sampled.

    ::

        tau      = tau_m + u + [K_p (q_d - q) + K_v (kappa_dot_d - kappa_dot)] / ell     limited to -tau_max .. tau_max
        u_(k+1)  = Q [u_k + L (tau_k - tau_m - u_k)]                 from the cycle of duration T to the next

    tau - tau_m - u is the torque of the feedback, which leads the error by atan(w K_v / K_p) at w. From the whole
    cycle, the zero-phase filter Q keeps the mean and the first `harmonics`, at most 20, of 1 / T. So u is a Fourier
    series, c_0 + sum of c_h cos(2 pi h t / T) + s_h sin(2 pi h t / T).

    The unlearned part of a periodic torque falls in each cycle by |1 - L T_C| in the harmonic h, with T_C(j 2 pi h / T)
    of the complementary sensitivity of the loop, -feedback / u. It converges if |Q (1 - L T_C)| < 1 for all h. Keep
    `harmonics` below T times the bandwidth in Hz. tau is the torque after the limit: with L up to 1, u is a filtered
    mean of motor torques in earlier cycles, so it does not wind up while they are at their limit.

    Cycles start at t_start, and end after `cycles`; before and after u is constant. The motion must be closed in each
    cycle. With the default T = 0 there is only feedforward and feedback.

    Source: D. Bristow, M. Tharayil, A. Alleyne, "A survey of iterative learning control", IEEE Control Systems Magazine
    26(3), 2006. Learning from the feedback's torque: M. Kawato, K. Furukawa, R. Suzuki, "A hierarchical neural-network
    model for control and learning of voluntary movement", Biological Cybernetics 57, 1987.
    """

    T = Parameter("s", text="duration of a cycle; 0: nothing is learned", minimum=0.0)
    t_start = Parameter("s", text="start of the first cycle")
    cycles = Parameter("1", text="number of cycles", start=1e9, minimum=1.0)
    L = Parameter(
        "1", JOINTS, "share of the feedback torque that is learned", start=1.0, minimum=0.0, maximum=2.0, tunable=True
    )
    harmonics = Parameter("1", text="number of harmonics that are learned", start=5.0, minimum=0.0, maximum=HARMONICS)
    cycle = Sampled("1", text="number of the cycle, from 0 on")
    u = Sampled("N.m", JOINTS, "learned torque, motor-side")
    learned = Sampled("N.m", (2 * HARMONICS + 1, JOINTS), "coefficient of u, c_0, c_1 .., then s_1 ..; motor-side")
    seen = Sampled("N.m", (2 * HARMONICS + 1, JOINTS), "coefficient of tau - tau_m so far in this cycle, motor-side")

    def requirements(self) -> dict[Any, tuple[str, Any]]:
        """Require samples in whole numbers a cycle, and enough of them."""
        samples = self.T / self.period
        return {
            ("T", "period"): ("T a whole number of periods", 1e-6 - np.abs(samples - np.floor(samples + 0.5))),
            ("harmonics", "T", "period"): (
                "harmonics a whole number, less than half of the samples of a cycle",
                minimum(whole(self.harmonics), where(self.T > 0.0, 0.5 * samples - self.harmonics, 1.0)),
            ),
            "cycles": ("a whole number", whole(self.cycles)),
        }

    def update(self) -> None:
        """Learn from the last cycle at the start of a cycle, then the torque, and its part in `seen`."""
        T = where(self.T > 0.0, self.T, 1.0)
        passed = (self.t - self.t_start) / T + 0.5 * self.period / T  # half a sample: times are rounded
        cycle = where(self.T > 0.0, clip(np.floor(passed), 0.0, self.cycles), 0.0)
        running = where((self.T > 0.0) & (passed >= 0.0) & (passed < self.cycles), 1.0, 0.0)
        orders = np.arange(HARMONICS + 1)
        Q = clip(self.harmonics + 1.0 - orders, 0.0, 1.0)
        Q = np.concatenate([Q, Q[1:]])[:, None]
        angle = running * 2.0 * np.pi / T * (self.t - self.t_start) * orders
        wave = np.concatenate([np.cos(angle), np.sin(angle[1:])])
        ends = cycle > self.cycle
        self.learned = where(ends, Q * (self.learned + self.L * (self.seen - self.learned)), self.learned)
        self.u = wave @ self.learned
        self.tau = self.pd(self.u)
        share = running * self.period / T * np.where(np.arange(wave.size) == 0, 1.0, 2.0)
        self.seen = where(ends, 0.0, self.seen) + (share * wave)[:, None] * (self.tau - self.tau_m)
        self.cycle = cycle
