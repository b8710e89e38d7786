"""The torques of the contrast study, and what is reported of them."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from vdfmu.arm.robot import Robot
from vdfmu.base.arrays import Floats
from vdfmu.base.measure import unit_of
from vdfmu.engine.results.recorded import Signal
from vdfmu.engine.results.results import Results

LOW_GRAVITY = 9.80 / 9.81
"""Share of the robot's gravity in the third variant: for 9.81 m/s2 it is 9.80."""


class Contrast(NamedTuple):
    """Joint torques of the rigid arm along the motion, link-side, each (m, n) [N m or N]."""

    robot: Robot
    time: Floats
    """(m,) [s]."""
    tau_vd: Floats
    """By virtual decomposition, Eq. (44)-(47)."""
    tau_ne: Floats
    """By the Newton-Euler recursion."""
    tau_low_g: Floats
    """By the Newton-Euler recursion with 9.80/9.81 of the robot's gravity."""

    @property
    def gravities(self) -> tuple[float, float]:
        """Magnitudes of the robot's gravity and of the lower one [m/s2]."""
        g = float(np.linalg.norm(self.robot.gravity))
        return g, LOW_GRAVITY * g

    def summary(self, paper: dict[str, Any]) -> dict[str, Any]:
        """RMS values over the motion, of torques in N m and of differences in N mm (N and mN for prismatic joints)."""
        return {
            "rms_torque_nm": _rms(self.tau_vd),
            "rms_torque_difference_nmm": _rms(1e3 * (self.tau_vd - self.tau_ne)),
            "rms_torque_difference_nmm_low_g": _rms(1e3 * (self.tau_vd - self.tau_low_g)),
            "gravities_m_s2": list(self.gravities),
            "paper": paper,
        }

    def results(self) -> Results:
        """Torques as recorded signals ``vd.tau[1]``, ``newton_euler.tau[1]``, ``newton_euler_low_g.tau[1]``."""
        groups = {"vd": self.tau_vd, "newton_euler": self.tau_ne, "newton_euler_low_g": self.tau_low_g}
        signals = [
            Signal(
                f"{group}.tau[{i + 1}]",
                "real",
                unit_of("torque", self.robot.joint_types[i]),
                k * self.robot.n + i,
            )
            for k, group in enumerate(groups)
            for i in range(self.robot.n)
        ]
        return Results(self.time, signals, {"real": np.hstack(list(groups.values()))})


def _rms(values: Floats) -> list[float]:
    return np.sqrt(np.mean(values**2, axis=0)).tolist()
