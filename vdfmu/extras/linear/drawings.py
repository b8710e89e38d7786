"""Pictures of modes and frequency responses."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from matplotlib.figure import Figure as Picture
from matplotlib.lines import Line2D
from matplotlib.ticker import MultipleLocator

from vdfmu.base.arrays import Floats
from vdfmu.extras.pictures import style


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
    title: str,
    frequency: Floats,
    curves: Mapping[str, npt.NDArray[np.complex128]],
    unit: str,
    resonance: Floats,
    antiresonance: Floats,
) -> Picture:
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
            above.annotate(
                f"{place:.3g}", (place, height), xycoords=("data", "axes fraction"), fontsize=7.5, ha="center", va=side
            )
    style.dress(above, "Amplitude", "", unit)
    style.dress(below, "Phase", "", "deg", frequency)
    low, high = below.get_ylim()
    below.yaxis.set_major_locator(MultipleLocator(90.0 * max(1, round((high - low) / 630.0))))
    below.set_xlabel("Frequency [Hz]")
    return figure
