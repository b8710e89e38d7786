"""Desired joint trajectory, Eq. (57), with its first four time derivatives."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from vdfmu.scalar.generic import piecewise_hold


class Desired(NamedTuple):
    """Desired joint positions and four time derivatives, each (n,)."""

    q_d: Any
    q_d_dot: Any
    q_d_ddot: Any
    q_d_dddot: Any
    q_d_ddddot: Any


def desired_motion(t: Any, q_start: Any, q_end: Any, T: Any, t_start: Any = 0.0) -> Desired:
    """Rest-to-rest motion with a sinusoidal acceleration, Eq. (57).

    Deviation: (57) starts from zero at t = 0; here it goes from `q_start` to `q_end` between `t_start` and
    `t_start + T`, and holds before and after. Its third derivative jumps at both ends, from 0 to
    ``4 pi^2 (q_end - q_start) / T^3``; the value at the ends themselves is the one inside.

    Parameters
    ----------
    t : float [s]
    q_start, q_end : (n,) [rad or m]
    T, t_start : float [s]
    """
    s, inside = piecewise_hold((t - t_start) / T)
    w = 2.0 * np.pi
    sin, cos = np.sin(w * s), np.cos(w * s)
    distance = q_end - q_start
    return Desired(
        q_start + distance * (s - sin / w),
        distance * (inside * (1.0 - cos) / T),
        distance * (inside * w * sin / T**2),
        distance * (inside * w**2 * cos / T**3),
        distance * (inside * -(w**3) * sin / T**4),
    )
