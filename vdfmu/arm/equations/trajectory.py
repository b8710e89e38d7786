"""Desired joint trajectory, Eq. (57), with its first four time derivatives."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from vdfmu.compiler.scalar import clip, lookup, minimum


class Desired(NamedTuple):
    """Desired joint positions and four time derivatives, each (n,)."""

    q_d: Any
    q_d_dot: Any
    q_d_ddot: Any
    q_d_dddot: Any
    q_d_ddddot: Any


EARLY = 1e-9
"""Fraction of ``|t_start| + T`` that is rounding of a time: a sum of 10^6 steps has a relative error of up to 1e-10."""


def desired_motion(t: Any, q_start: Any, q_end: Any, T: Any, t_start: Any = 0.0) -> Desired:
    """Rest-to-rest motion with a sinusoidal acceleration, Eq. (57).

    Deviation: (57) starts from zero at t = 0; here it goes from `q_start` to `q_end` between `t_start` and `t_start +
    T`, and is held before and after. Its third derivative jumps at both ends, between 0 and ``4 pi^2 (q_end - q_start)
    / T^3``. At both ends it has the value just after them: at `t_start` the joints move, at ``t_start + T`` they rest.
    Both ends are shifted earlier by `EARLY`, so that rounding of `t` does not matter.

    Parameters
    ----------
    t : float [s]
    q_start, q_end : (n,) [rad or m]
    T, t_start : float [s]
    """
    s = clip((t - t_start) / T, 0.0, 1.0)
    early = EARLY * (abs(t_start) + T)
    inside = 1.0 * ((t >= t_start - early) & (t < t_start + T - early))
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


def played_motion(t: Any, edges: Any, rows: Any, cycles: Any = 1.0) -> Desired:
    """Piecewise polynomials of degree 5, starting at t = 0 and held before and after.

    A closed motion, which ends at its start, is repeated `cycles` times, a whole number of at least 1.

    Parameters
    ----------
    t : float [s]
    edges : (m + 1,) floats [s]
        Starts of the pieces, from 0 on, and any later time.
    rows : (m, 1 + 6 n) floats
        Start of a piece, then its coefficients, (6, n) row by row, constants first. The last piece is the constant end.
    """
    T = edges[-2]
    s = clip(t, 0.0, cycles * T)
    s = s - T * minimum(np.floor(s / T), cycles - 1.0)
    row = lookup(s, edges, rows)
    u, c = s - row[0], row[1:].reshape(6, -1)
    derivatives: list[Any] = []
    for order in range(5):
        value = math.perm(5, order) * c[5]
        for k in range(4, order - 1, -1):
            value = value * u + math.perm(k, order) * c[k]
        derivatives.append(value)
    return Desired(*derivatives)
