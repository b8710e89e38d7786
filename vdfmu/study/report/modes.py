"""Pictures of an arm's natural frequencies along a motion, and of its frequency responses."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from matplotlib.figure import Figure

from vdfmu.base import style
from vdfmu.base.arrays import Floats

_SOLID: dict[str, Any] = {"linestyle": "-"}
_DOTTED: dict[str, Any] = {"linestyle": ":"}


@style.styled
def draw_modes(
    title: str, times: Floats, panels: Mapping[str, Sequence[tuple[Floats, npt.NDArray[np.intp]]]]
) -> Figure:
    """Draw natural frequencies over time, a panel by the state of the motors.

    Parameters
    ----------
    title : str
    times : (m,) [s]
    panels : mapping of str to m pairs
        Frequencies [Hz] of the modes at a time, and which joint's spring has most of the energy of each.
    """
    joints = sorted({int(i) for along in panels.values() for _, joint in along for i in joint})
    handles = style.joint_handles(joints)
    for handle in handles:
        handle.set(marker="o", markersize=4.0, linestyle="none")
    figure = style.new_figure(
        title,
        "At rest at poses of the desired motion, the fastest modes. Colour: the joint whose spring has most energy.",
        height=2.2 * len(panels) + 1.0,
        legend=handles,
    )
    shown = [figure.add_subplot(len(panels), 1, place + 1) for place in range(len(panels))]
    for axes, (motors, along) in zip(shown, panels.items(), strict=True):
        for joint in joints:
            here = [(t, f) for t, (each, of) in zip(times, along, strict=True) for f in each[of == joint]]
            if here:
                axes.plot(*np.transpose(here), ".", color=style.joint_look(joint)["color"], markersize=4.0)
        style.dress(axes, f"Motors {motors}", "frequency", "Hz", times)
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
) -> Figure:
    """Draw responses to one input over frequency [Hz]: amplitudes, above, and phases.

    Parameters
    ----------
    title : str
    frequency : (m,) [Hz]
    curves : mapping of str to (m,) arrays
        Name of an output to its response.
    unit : str
        Unit of the amplitudes.
    resonance, antiresonance : (k,) [Hz]
        Marked by vertical lines: poles, and zeros of the first curve.
    """
    looks = [style.joint_look(i) for i in range(len(curves))]
    marks = [("resonance", resonance, _SOLID), ("anti-resonance", antiresonance, _DOTTED)]
    handles = [style.Line2D([], [], label=name, **look) for name, look in zip(curves, looks, strict=True)]
    handles += [style.Line2D([], [], label=name, color="0.5", **look) for name, _, look in marks]
    figure = style.new_figure(
        title,
        "Linear, at rest. Above: resonances; below: anti-resonances of the first curve, where its amplitude is least.",
        height=5.4,
        legend=handles,
    )
    above, below = figure.subplots(2, 1, sharex=True)
    for values, look in zip(curves.values(), looks, strict=True):
        above.loglog(frequency, np.abs(values), **look)
        below.semilogx(frequency, np.degrees(np.unwrap(np.angle(values))), **look)
    for axes in (above, below):
        for _, places, look in marks:
            for place in places:
                axes.axvline(place, color="0.5", linewidth=0.8, zorder=0, **look)
    for places, height, side in ((resonance, 1.0, "bottom"), (antiresonance, -0.02, "top")):
        for place in places:
            above.annotate(f"{place:.3g}", (place, height), xycoords=("data", "axes fraction"), fontsize=7.5,
                           ha="center", va=side)  # fmt: skip
    style.dress(above, "Amplitude", "", unit)
    style.dress(below, "Phase", "", "deg", frequency)
    below.set_xlabel("Frequency [Hz]")
    return figure
