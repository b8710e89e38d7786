"""A motion for identification: cosines of several frequencies, other ones for each joint, that start at rest."""

import numpy as np

from vdfmu.unit import JOINTS, Output, Parameter, Unit
from vdfmu.units._signals import DESIRED


class Multisine(Unit):
    """Multisine with four derivatives."""

    q_d = Output(*DESIRED["q_d"])
    q_d_dot = Output(*DESIRED["q_d_dot"])
    q_d_ddot = Output(*DESIRED["q_d_ddot"])
    q_d_dddot = Output(*DESIRED["q_d_dddot"])
    q_d_ddddot = Output(*DESIRED["q_d_ddddot"])
    q_start = Parameter("position", JOINTS, "start")
    size = Parameter("position", JOINTS, "size of the slowest", start=0.6)
    f = Parameter("Hz", text="lowest frequency", start=0.1)

    def outputs(self) -> None:
        """Sum of cosines and their derivatives."""
        q = [self.q_start + 0.0 * self.size] + [0.0 * self.size] * 4
        for m, h in enumerate((1, 3, 7, 13)):
            w = 2 * np.pi * self.f * (h + np.arange(self.n))
            c, s = np.cos(w * self.t), np.sin(w * self.t)
            for k, wave in enumerate((c - 1.0, -s, -c, s, c)):
                q[k] = q[k] + (-1) ** m * self.size / h * w**k * wave
        self.q_d, self.q_d_dot, self.q_d_ddot, self.q_d_dddot, self.q_d_ddddot = q
