"""Pictures of motions, modes, identifications and tunings."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Picture
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator, MultipleLocator

from vdfmu.arm.robot import Robot
from vdfmu.base import style
from vdfmu.base.arrays import Floats
from vdfmu.base.measure import Shown, shown_as
from vdfmu.engine.results.figure import Curve, Figure
from vdfmu.engine.results.picture import draw
from vdfmu.engine.results.results import Recorded, Signal

if TYPE_CHECKING:
    from vdfmu.study.identify.fit import LogScore

_ORDERS = {"position": 0, "velocity": 1, "acceleration": 2, "snap": 4}
"""Quantity of a motion to the number of its derivative."""
_BEFORE, _AFTER = "#888888", style.COLORS[0]
_BY_JOINT = {
    "error": ("RMS error", "", "rad or m"),
    "peak_torque": ("Peak torque", "", "N.m"),
    "modulus": ("Modulus margin", r"min $|1 + L|$", ""),
}
"""Rows of a tuning's table that are drawn by joint: title, quantity, unit of measurement."""


def _recorded(t: Floats, groups: Mapping[str, Floats]) -> Recorded:
    """Return arrays (m, n) as signals ``group[i]``."""
    names = [f"{group}[{i}]" for group, values in groups.items() for i in range(1, 1 + values.shape[1])]
    signals = [Signal(name, "real", "", column) for column, name in enumerate(names)]
    return Recorded(t, signals, {"real": np.hstack([*groups.values()])})


def draw_motion(robot: Robot, t: Floats, q: Floats) -> Picture:
    """Draw `q`, (5, m, n) [rad or m, s], and four derivatives over `t`, (m,) [s], a column for each type of joint."""
    results = _recorded(t, {order: q[k] for order, k in _ORDERS.items()})
    kinds = sorted(set(robot.joint_types), reverse=True)
    figures: list[Figure] = []
    for order, kind in itertools.product(_ORDERS, kinds):
        joints = [i for i, joint_type in enumerate(robot.joint_types, 1) if joint_type == kind]
        curves = [Curve(f"joint {i}", i, [(1.0, f"{order}[{i}]")]) for i in joints]
        title = f"{order.capitalize()}, {kind}" if len(kinds) > 1 else order.capitalize()
        figures.append(Figure(f"{order}.{kind}", title, shown_as(order, kind), curves))
    return draw(figures, {"": results}, columns=len(kinds))


def draw_torques(t: Floats, torque: Floats, error: Floats, units: Sequence[str]) -> Picture:
    """Draw measured torques (m, n), link-side, under the model, and the differences with their histograms."""
    results = _recorded(t, {"measured": torque, "model": torque - error, "difference": error})
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
        axes.axhline(0.0, color=_BEFORE, linewidth=0.6)
    return picture


def _draw_histogram(axes: Axes, left: Floats, color: Any) -> None:
    """Draw how often residuals occur, values upwards, and a normal distribution of the same deviation around zero."""
    axes.hist(left, bins=40, density=True, orientation="horizontal", color=color, alpha=0.6)
    deviation = max(float(np.sqrt(np.mean(left**2))), 1e-300)
    at = np.linspace(-4.0, 4.0, 81)
    axes.plot(np.exp(-(at**2) / 2.0) / deviation / np.sqrt(2.0 * np.pi), deviation * at, color="black", linewidth=0.8)
    axes.axhline(0.0, color=_BEFORE, linewidth=0.6)


@style.styled
def draw_modes(
    title: str, times: Floats, panels: Mapping[str, Sequence[tuple[Floats, npt.NDArray[np.intp]]]]
) -> Picture:
    """Draw natural frequencies over `times`, (m,) [s], a panel by the state of the motors.

    A panel has m pairs: frequencies [Hz] of the modes at a time, and the joint whose spring has most of the energy.
    """
    words = (
        "At rest at poses of the desired motion, the fastest modes, a colour each. Numbers on a curve, from there on: "
        "the joint whose spring has most of its energy."
    )
    n = max(len(frequency) for along in panels.values() for frequency, _ in along)
    figure = style.new_figure(title, words, height=2.6 * len(panels) + 1.0)
    shown = [figure.add_subplot(len(panels), 1, k) for k in range(1, 1 + len(panels))]
    for axes, (motors, along) in zip(shown, panels.items(), strict=True):
        for mode in range(n):
            track = [
                (t, f[mode - n], of[mode - n]) for t, (f, of) in zip(times, along, strict=True) if len(f) >= n - mode
            ]
            if not track:
                continue
            time, frequency, joint = (np.array(column) for column in zip(*track, strict=True))
            axes.plot(time, frequency, label=f"mode {mode + 1}", **style.joint_look(mode))
            for k in [0, *(np.flatnonzero(np.diff(joint)) + 1)]:
                place = (2, (-8, 2)[mode % 2])  # of two neighbours one below its curve and one above
                axes.annotate(
                    str(joint[k] + 1), (time[k], frequency[k]), place, textcoords="offset points", fontsize=7.5
                )
        style.dress(axes, f"Motors {motors}", "frequency", "Hz", times)
        style.legend_beside(axes, axes.lines[::-1])
    style.label_time(shown, 1)
    return figure


@style.styled
def draw_bode(
    title: str, frequency: Floats, curves: Mapping[str, npt.NDArray[np.complex128]], unit: str, resonance: Floats,
    antiresonance: Floats,
) -> Picture:  # fmt: skip
    """Draw responses to one input over `frequency`, (m,) [Hz]: amplitudes in `unit`, above, and phases.

    `curves` has the response (m,) of each output by its name. Vertical lines mark `resonance` and `antiresonance`
    [Hz]: poles, and zeros of the first curve.
    """
    looks = [style.joint_look(i) for i in range(len(curves))]
    marks: list[tuple[str, Floats, Any]] = [("resonance", resonance, "-"), ("anti-resonance", antiresonance, ":")]
    handles = [Line2D([], [], label=name, **look) for name, look in zip(curves, looks, strict=True)]
    handles += [Line2D([], [], label=name, color="0.5", linestyle=line) for name, _, line in marks]
    words = (
        "Linear, at rest. Above: resonances; below: anti-resonances of the first curve, where its amplitude is least."
    )
    figure = style.new_figure(title, words, height=5.4, legend=handles)
    above, below = figure.subplots(2, 1, sharex=True)
    for values, look in zip(curves.values(), looks, strict=True):
        above.loglog(frequency, np.abs(values), **look)
        below.semilogx(frequency, np.degrees(np.unwrap(np.angle(values))), **look)
    for (_, places, line), height, side in zip(marks, (1.0, -0.02), ("bottom", "top"), strict=True):
        for place in places:
            for axes in (above, below):
                axes.axvline(place, color="0.5", linewidth=0.8, zorder=0, linestyle=line)
            above.annotate(f"{place:.3g}", (place, height), xycoords=("data", "axes fraction"), fontsize=7.5,
                           ha="center", va=side)  # fmt: skip
    style.dress(above, "Amplitude", "", unit)
    style.dress(below, "Phase", "", "deg", frequency)
    low, high = below.get_ylim()
    below.yaxis.set_major_locator(MultipleLocator(90.0 * max(1, round((high - low) / 630.0))))
    below.set_xlabel("Frequency [Hz]")
    return figure


@style.styled
def draw_tuning(history: Sequence[float], table: Sequence[tuple[str, float, float]]) -> Picture:
    """Draw the cost over the evaluations, and the values of each joint in rows of name, before and after.

    `history` has the objective of each evaluation, 1 at the start; beyond 10 if a constraint is missed.
    """
    groups = {key: [pair for name, *pair in table if name.partition("[")[0] == key] for key in _BY_JOINT}
    shown = {key: pairs for key, pairs in groups.items() if pairs}
    handles = [
        Line2D([], [], color=color, linewidth=6.0, label=label)
        for color, label in ((_BEFORE, "before"), (_AFTER, "after"))
    ]
    figure = style.new_figure(
        "Tuning",
        "Cost: relative to the start; dots: values within all limits, line: the best so far. Errors and torques: of "
        "the worst robot. Margin: with one sample of delay.",
        height=5.6 if shown else 2.8, legend=handles if shown else (),
    )  # fmt: skip
    grid = figure.add_gridspec(2 if shown else 1, max(len(shown), 1))
    _draw_history(figure.add_subplot(grid[0, :]), np.array(history))
    for column, (key, pairs) in enumerate(shown.items()):
        _draw_joints(figure.add_subplot(grid[1, column]), np.array(pairs), *_BY_JOINT[key])
    return figure


def _draw_history(axes: Axes, cost: Floats) -> None:
    number, allowed = np.arange(1, len(cost) + 1), cost < 10.0
    best = np.minimum.accumulate(np.where(allowed, cost, np.inf))
    feasible = np.isfinite(best)
    axes.plot(number[allowed], cost[allowed], ".", color=style.COLORS[5], markersize=4.0)
    axes.step(number[feasible], best[feasible], where="post", color=_AFTER)
    axes.axhline(1.0, color=_BEFORE, linewidth=1.0, linestyle="--")
    style.dress(axes, "Cost", "relative to the start", "")
    top = max(1.2, float(np.quantile(cost[allowed], 0.9))) if allowed.any() else 1.2
    axes.set_ylim(0.0, 1.1 * min(top, 3.0))
    axes.set_xlim(0.0, len(cost) + 1.0)
    axes.set_xlabel("Evaluation")


def _draw_joints(axes: Axes, pairs: Floats, title: str, quantity: str, unit: str) -> None:
    joints = np.arange(1, len(pairs) + 1)
    for shift, column, color in ((-0.2, 0, _BEFORE), (0.2, 1, _AFTER)):
        axes.bar(joints + shift, pairs[:, column], 0.38, color=color)
    style.dress(axes, title, quantity, unit)
    axes.set_xlim(0.4, len(pairs) + 0.6)
    axes.set_ylim(0.0, 1.08 * max(float(np.nanmax(pairs)), 1e-300))
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.grid(visible=False, axis="x")
    axes.set_xlabel("Joint")


_ACROSS = ("speed", "load", "position", "histogram", "spectrum", "autocorrelation")


@style.styled
def draw_residuals(title: str, score: LogScore, robot: Robot) -> Picture:
    """Draw residuals of torques, then of deformations, a row a joint.

    Columns: over the rotor's speed, the load of the drive and the position; the histogram with a normal distribution;
    the share of power by frequency; the autocorrelation, with bounds of 95 % of independent rows.
    """
    problem, t = score.rows.problem, score.rows.t
    rows = [(i, "torque", score.torque_error[:, i]) for i in range(robot.n)]
    rows += [(i, "deformation", 1e6 * score.deformation_error[:, i]) for i in range(robot.n) if problem.seen[i]]
    words = "Measured minus model, in the band of the estimation. Clouds of a complete model are shapeless."
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
