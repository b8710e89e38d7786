"""Pictures of motions, modes and frequency responses."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from matplotlib.figure import Figure as Picture
from matplotlib.lines import Line2D
from matplotlib.ticker import MultipleLocator

from vdfmu.arm.robot import Robot
from vdfmu.base import style
from vdfmu.base.arrays import Floats
from vdfmu.base.measure import shown_as
from vdfmu.engine.results.figure import Curve, Figure
from vdfmu.engine.results.picture import draw
from vdfmu.engine.results.results import Recorded, Signal

_ORDERS = {"position": 0, "velocity": 1, "acceleration": 2, "snap": 4}
"""Quantity of a motion to the order of its derivative."""


def recorded(t: Floats, groups: Mapping[str, Floats]) -> Recorded:
    """Return arrays (m, n) as signals ``group[i]``."""
    names = [f"{group}[{i}]" for group, values in groups.items() for i in range(1, 1 + values.shape[1])]
    signals = [Signal(name, "real", "", column) for column, name in enumerate(names)]
    return Recorded(t, signals, {"real": np.hstack([*groups.values()])})


def draw_motion(robot: Robot, t: Floats, q: Floats) -> Picture:
    """Draw `q`, (5, m, n) [rad or m, s], with four derivatives, over `t`, (m,) [s], with a column per type of joint."""
    results = recorded(t, {order: q[k] for order, k in _ORDERS.items()})
    kinds = sorted(set(robot.joint_types), reverse=True)
    figures: list[Figure] = []
    for order, kind in itertools.product(_ORDERS, kinds):
        joints = [i for i, joint_type in enumerate(robot.joint_types, 1) if joint_type == kind]
        curves = [Curve(f"joint {i}", i, [(1.0, f"{order}[{i}]")]) for i in joints]
        title = f"{order.capitalize()}, {kind}" if len(kinds) > 1 else order.capitalize()
        figures.append(Figure(f"{order}.{kind}", title, shown_as(order, kind), curves))
    return draw(figures, {"": results}, columns=len(kinds))


@style.styled
def draw_modes(
    title: str, times: Floats, panels: Mapping[str, Sequence[tuple[Floats, npt.NDArray[np.intp]]]]
) -> Picture:
    """Draw natural frequencies over `times`, (m,) [s], with a panel for each state of the motors.

    A panel has m pairs: frequencies [Hz] of the modes at a time, and the joint whose spring has most of the energy.
    """
    words = (
        "The fastest modes, a colour each, at rest at poses of the desired motion. A number on a curve is the joint "
        "whose spring has most of the energy from there on."
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
                place = (2, (-8, 2)[mode % 2])  # of two neighbours, one below its curve and one above
                axes.annotate(
                    str(joint[k] + 1), (time[k], frequency[k]), place, textcoords="offset points", fontsize=7.5
                )
        style.dress(axes, f"Motors {motors}", "frequency", "Hz", times)
        style.legend_beside(axes, axes.lines[::-1])
    style.label_time(shown, 1)
    return figure


@style.styled
def draw_bode(
    title: str,
    frequency: Floats,
    curves: Mapping[str, npt.NDArray[np.complex128]],
    unit: str,
    resonance: Floats,
    antiresonance: Floats,
) -> Picture:
    """Draw responses to one input over `frequency`, (m,) [Hz]: amplitudes in `unit` above phases.

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
            above.annotate(
                f"{place:.3g}", (place, height), xycoords=("data", "axes fraction"), fontsize=7.5, ha="center", va=side
            )
    style.dress(above, "Amplitude", "", unit)
    style.dress(below, "Phase", "", "deg", frequency)
    low, high = below.get_ylim()
    below.yaxis.set_major_locator(MultipleLocator(90.0 * max(1, round((high - low) / 630.0))))
    below.set_xlabel("Frequency [Hz]")
    return figure
