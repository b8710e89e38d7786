"""The picture of what an identified model leaves of a log: by what it depends on, structure that the model lacks."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from vdfmu.arm.robot import Robot
from vdfmu.base import style
from vdfmu.base.arrays import Floats
from vdfmu.study.identify.score import LogScore

_ACROSS = ("speed", "load", "position", "spectrum", "autocorrelation")


@style.styled
def draw_residuals(title: str, score: LogScore, robot: Robot) -> Figure:
    """Draw residuals of torques, then of deformations, a row a joint.

    Over the rotor's speed, the load of the drive and the position, the share of their power by frequency, and how alike
    rows are by the time between them, with the bounds within which 95 % of independent rows are.
    """
    problem, t = score.rows.problem, score.rows.t
    rows = [(i, "torque", score.torque_error[:, i]) for i in range(robot.n)]
    rows += [(i, "deformation", 1e6 * score.deformation_error[:, i]) for i in range(robot.n) if problem.seen[i]]
    words = "Measured minus model, in the band of the estimation. Where the model lacks nothing, clouds have no shape."
    figure = style.new_figure(title, words, width=14.0, height=1.7 * len(rows) + 1.0)
    for k, (i, what, left) in enumerate(rows):
        turns = robot.joint_types[i] == "revolute"
        unit = {"torque": "N.m" if turns else "N", "deformation": "µrad" if turns else "µm"}[what]
        side = "rad" if turns else "m"
        over = {
            "speed": (problem.speed[:, i], f"speed [{side}/s]"),
            "load": (score.load[:, i], f"load of the drive [{'N.m' if turns else 'N'}]"),
            "position": (problem.position[:, i], f"position [{side}]"),
        }
        for place, across in enumerate(_ACROSS):
            axes = figure.add_subplot(len(rows), len(_ACROSS), k * len(_ACROSS) + place + 1)
            look = style.joint_look(i)
            if across in over:
                axes.plot(over[across][0], left, ".", color=look["color"], markersize=2.5)
                axes.axhline(0.0, color="#888888", linewidth=0.6)
                label = over[across][1]
            elif across == "spectrum":
                axes.plot(*_spectrum(t, left), color=look["color"])
                label = "frequency [Hz]"
            else:
                lag, alike, bound = _alike(t, left)
                axes.plot(lag, alike, color=look["color"])
                axes.axhspan(-bound, bound, color="#888888", alpha=0.25, linewidth=0.0)
                label = "time between rows [s]"
            if place == 0:
                axes.set_ylabel(f"{i + 1}: {what} [{unit}]")
            if k == 0:
                axes.set_title(across.capitalize())
            if k == len(rows) - 1:
                axes.set_xlabel(label)
    return figure


def _spectrum(t: Floats, left: Floats) -> tuple[Floats, Floats]:
    """Return frequencies and shares of the power, smoothed over three."""
    power = np.abs(np.fft.rfft((left - left.mean()) * np.hanning(len(left)))) ** 2
    power = np.convolve(power / max(power.sum(), 1e-300), np.ones(3) / 3.0, mode="same")
    return np.fft.rfftfreq(len(left), t[1] - t[0])[1:], power[1:]


def _alike(t: Floats, left: Floats) -> tuple[Floats, Floats, float]:
    """Return times between rows, correlations, and the bound for independent rows."""
    free = left - left.mean()
    lags = np.arange(len(free) // 4)
    alike = np.array([free[lag:] @ free[: len(free) - lag] for lag in lags]) / max(free @ free, 1e-300)
    return lags * (t[1] - t[0]), alike, 1.96 / len(free) ** 0.5
