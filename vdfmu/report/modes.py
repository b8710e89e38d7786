"""The picture of an arm's natural frequencies along a motion."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt
from matplotlib.figure import Figure

from vdfmu import style
from vdfmu.arrays import Floats


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
