"""A motion through waypoints of a CSV file."""

from pathlib import Path

import numpy as np

from vdfmu.unit import JOINTS, Output, Unit, clip

_TABLE = np.loadtxt(Path(__file__).with_name("waypoints.csv"), delimiter=",", skiprows=1)
TIMES, POINTS = _TABLE[:, 0], _TABLE[:, 1:]
POWERS = 10
"""A polynomial of order 9 between two waypoints: it meets the position, and rests up to its fourth derivative."""


def _rest_to_rest() -> np.ndarray:
    """Coefficients of s^0 .. s^9 with s(0) = 0, s(1) = 1 and four derivatives that are 0 at both ends."""
    rows = []
    for order in range(5):
        factor = [np.prod(np.arange(k, k - order, -1)) if k >= order else 0.0 for k in range(POWERS)]
        rows.append(np.where(np.arange(POWERS) == order, factor, 0.0))
        rows.append(np.array(factor, dtype=float))
    return np.linalg.solve(np.array(rows, dtype=float), [0.0, 1.0] + 8 * [0.0])


SHAPE = _rest_to_rest()


class Spline(Unit):
    """Desired motion through waypoints, at rest at each of them, with four derivatives.

    waypoints.csv in this folder has the waypoints: time, then the position of each joint.
    """

    files = ("waypoints.csv",)

    q_d = Output("position", JOINTS, "desired position")
    q_d_dot = Output("velocity", JOINTS, "desired velocity")
    q_d_ddot = Output("acceleration", JOINTS, "desired acceleration")
    q_d_dddot = Output("jerk", JOINTS, "third derivative of the desired position")
    q_d_ddddot = Output("snap", JOINTS, "fourth derivative of the desired position")

    def outputs(self) -> None:
        values = []
        for order in range(5):
            coefficients = np.polynomial.polynomial.polyder(SHAPE, order) if order else SHAPE
            value = POINTS[0] if order == 0 else np.zeros(POINTS.shape[1])
            for t_0, t_1, p_0, p_1 in zip(TIMES, TIMES[1:], POINTS, POINTS[1:], strict=False):
                s = clip((self.t - t_0) / (t_1 - t_0), 0.0, 1.0)
                blend = sum(c * s**k for k, c in enumerate(coefficients))
                value = value + (p_1 - p_0) * blend / (t_1 - t_0) ** order
            values.append(value)
        self.q_d, self.q_d_dot, self.q_d_ddot, self.q_d_dddot, self.q_d_ddddot = values
