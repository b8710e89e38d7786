"""Pictures of an identification: torques of log and model, and residuals."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Picture

from vdfmu.arm.robot import Robot
from vdfmu.base.arrays import Floats
from vdfmu.base.measure import Shown
from vdfmu.engine.results.figure import Curve, Figure
from vdfmu.extras.identify.fit import LogScore
from vdfmu.extras.pictures import style
from vdfmu.extras.pictures.motion_picture import recorded
from vdfmu.extras.pictures.picture import draw


def draw_torques(t: Floats, torque: Floats, error: Floats, units: Sequence[str]) -> Picture:
    """Draw measured torques (m, n), link-side, below those of the model, and the differences with histograms."""
    results = recorded(t, {"measured": torque, "model": torque - error, "difference": error})
    figures: list[Figure] = []
    for i, unit in enumerate(units, 1):
        both = [
            Curve(f"joint {i}, {kind}", i, [(1.0, f"{kind}[{i}]")], dashed=kind == "model")
            for kind in ("measured", "model")
        ]
        difference = Curve("difference", i, [(1.0, f"difference[{i}]")])
        figures.append(Figure(f"torque.{i}", f"Joint {i}", Shown(unit), both))
        figures.append(Figure(f"difference.{i}", f"Joint {i}, measured minus model", Shown(unit), [difference]))
    picture = draw(figures, {"": results}, columns=2)
    for i, axes in enumerate(picture.axes[1::2]):
        (line,) = axes.get_lines()
        beside = axes.inset_axes((1.02, 0.0, 0.2, 1.0), sharey=axes)
        _draw_histogram(beside, np.asarray(line.get_ydata()), style.joint_look(i)["color"])
        beside.set_axis_off()
        axes.axhline(0.0, color="#888888", linewidth=0.6)
    return picture


def _draw_histogram(axes: Axes, left: Floats, color: str) -> None:
    """Draw a histogram of residuals, values upwards, and a zero-mean normal distribution of the same deviation."""
    axes.hist(left, bins=40, density=True, orientation="horizontal", color=color, alpha=0.6)
    deviation = max(float(np.sqrt(np.mean(left**2))), 1e-300)
    at = np.linspace(-4.0, 4.0, 81)
    axes.plot(np.exp(-(at**2) / 2.0) / deviation / np.sqrt(2.0 * np.pi), deviation * at, color="black", linewidth=0.8)
    axes.axhline(0.0, color="#888888", linewidth=0.6)


_ACROSS = ("speed", "load", "position", "histogram", "spectrum", "autocorrelation")


@style.styled
def draw_residuals(title: str, score: LogScore, robot: Robot) -> Picture:
    """Draw residuals of torques, then of deformations, with a row per joint.

    The columns show them over the rotor's speed, the load of the drive and the position; the histogram with a normal
    distribution; the share of power by frequency; and the autocorrelation with 95 % bounds for independent rows.
    """
    problem, t = score.rows.problem, score.rows.t
    rows = [(i, "torque", score.torque_error[:, i]) for i in range(robot.n)]
    rows += [(i, "deformation", 1e6 * score.deformation_error[:, i]) for i in range(robot.n) if problem.seen[i]]
    words = "Measured minus model, in the band of the estimation. The clouds of a complete model have no structure."
    figure = style.new_figure(title, words, width=16.0, height=1.7 * len(rows) + 1.0)
    for k, (i, quantity, left) in enumerate(rows):
        turns = robot.joint_types[i] == "revolute"
        unit = {"torque": "N.m" if turns else "N", "deformation": "µrad" if turns else "µm"}[quantity]
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
            elif across == "histogram":
                _draw_histogram(axes, left, look["color"])
                label = "density"
            elif across == "spectrum":
                axes.plot(*_spectrum(t, left), color=look["color"])
                label = "frequency [Hz]"
            else:
                lag, alike, bound = _alike(t, left)
                axes.plot(lag, alike, color=look["color"])
                axes.axhspan(-bound, bound, color="#888888", alpha=0.25, linewidth=0.0)
                label = "time between rows [s]"
            if place == 0:
                axes.set_ylabel(f"{i + 1}: {quantity} [{unit}]")
            if k == 0:
                axes.set_title(across.capitalize())
            if k == len(rows) - 1:
                axes.set_xlabel(label)
    return figure


def _spectrum(t: Floats, left: Floats) -> tuple[Floats, Floats]:
    """Return frequencies and shares of the power, smoothed over three neighbours."""
    power = np.abs(np.fft.rfft((left - left.mean()) * np.hanning(len(left)))) ** 2
    power = np.convolve(power / max(power.sum(), 1e-300), np.ones(3) / 3.0, mode="same")
    return np.fft.rfftfreq(len(left), t[1] - t[0])[1:], power[1:]


def _alike(t: Floats, left: Floats) -> tuple[Floats, Floats, float]:
    """Return times between rows, correlations, and the bound for independent rows."""
    free = left - left.mean()
    lags = np.arange(len(free) // 4)
    alike = np.array([free[lag:] @ free[: len(free) - lag] for lag in lags]) / max(free @ free, 1e-300)
    return lags * (t[1] - t[0]), alike, 1.96 / len(free) ** 0.5
