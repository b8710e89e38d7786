"""The picture of an identification: what the model leaves of the measured torques."""

from __future__ import annotations

from typing import Any

from matplotlib.figure import Figure

from vdfmu.arrays import Floats
from vdfmu.report import style


@style.styled
def draw_torques(title: str, t: Floats, torque: Floats, error: Floats, units: tuple[str, ...]) -> Figure:
    """Draw measured torques (m, n) over time, link-side, and what the model leaves of them, a panel each joint."""
    looks: list[dict[str, Any]] = [style.joint_look(0), style.joint_look(1)]
    names = ("measured", "measured minus model")
    handles = [style.Line2D([], [], label=name, **look) for name, look in zip(names, looks, strict=True)]
    rows, columns = style.grid_of(torque.shape[1])
    figure = style.new_figure(
        title,
        "Motor torques times ell, in the band of the estimation.",
        height=2.0 * rows + 1.0,
        legend=handles,
    )
    shown = [figure.add_subplot(rows, columns, i + 1) for i in range(torque.shape[1])]
    for i, axes in enumerate(shown):
        for values, look in zip((torque, error), looks, strict=True):
            style.curve(axes, t, values[:, i], **look)
        style.dress(axes, f"Joint {i + 1}", "torque", units[i], t)
    style.label_time(shown, columns)
    return figure
