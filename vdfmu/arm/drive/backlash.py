"""Backlash as a smooth dead zone that a small torque takes up. Not in the paper; off by default.

The deformation is elastic, an odd, increasing function of the torque, so that the spring with its torque as state stays
explicit and its energy exact.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from vdfmu.arm.drive.option import Array, DriveOption, Spring, row
from vdfmu.base.measure import POSITIVE


@dataclass(frozen=True, eq=False, kw_only=True)
class BacklashRows:
    """Parameters of the backlash."""

    backlash: bool = False
    # fmt: off
    w_gap: Array = row("backlash", "position", "width of the backlash, link-side", "", 1.0, 0.0)
    tau_gap: Array = row(
        "backlash", "torque", "torque that takes up 71 % of the backlash, link-side", "", 1e9, POSITIVE, start=1.0)


def gap_deformation(robot: Any, tau_s: Any) -> Any:
    """Deformation ``w / 2 x / sqrt(1 + x^2)``, ``x = tau_s / tau_gap``: (n,) [rad or m], link-side.

    Between -tau_gap and tau_gap it covers 71 % of the width w, between ten times these torques 99.5 %. `tau_s` is
    the spring torque, (n,) [N m or N], link-side.
    """
    x = tau_s / robot.tau_gap
    return 0.5 * robot.w_gap * x / np.sqrt(1.0 + x * x)


def gap_compliance(robot: Any, tau_s: Any) -> Any:
    """Slope of the deformation: (n,) [rad/(N m) or m/N]."""
    x = tau_s / robot.tau_gap
    root = np.sqrt(1.0 + x * x)
    return 0.5 * robot.w_gap / (robot.tau_gap * root * root * root)


def gap_energy(robot: Any, tau_s: Any) -> Any:
    """Elastic energy, the integral of ``t`` times the slope from 0 to tau_s: (n,) [J]; at most ``w tau_gap / 2``."""
    x = tau_s / robot.tau_gap
    return 0.5 * robot.w_gap * robot.tau_gap * (1.0 - 1.0 / np.sqrt(1.0 + x * x))


def _spring(spring: Spring, robot: Any, tau_s: Any) -> Spring:
    gap = gap_deformation(robot, tau_s), gap_compliance(robot, tau_s), gap_energy(robot, tau_s)
    return Spring(*(a + b for a, b in zip(spring, gap, strict=True)))


BACKLASH = DriveOption(spring=_spring)
