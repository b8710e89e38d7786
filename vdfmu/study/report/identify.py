"""The picture of an identification: the part of measured torques that the model does not explain."""

from __future__ import annotations

from matplotlib.figure import Figure

from vdfmu.base import style
from vdfmu.base.arrays import Floats


@style.styled
def draw_torques(title: str, t: Floats, torque: Floats, error: Floats, units: tuple[str, ...]) -> Figure:
    """Draw measured torques (m, n) over time, link-side, and the part that the model leaves, a panel each joint."""
    n = torque.shape[1]
    figure = style.new_figure(
        title, "Motor torques times ell, in the band of the estimation, and what the model leaves of them.",
        height=1.8 * n + 1.0,
    )  # fmt: skip
    shown = [figure.add_subplot(n, 2, i + 1) for i in range(2 * n)]
    for i, axes in enumerate(shown):
        joint, name = i // 2, ("measured", "measured minus model")[i % 2]
        style.curve(axes, t, (torque, error)[i % 2][:, joint], **style.joint_look(joint))
        style.dress(axes, f"Joint {joint + 1}, {name}", "torque", units[joint], t)
    style.label_time(shown, 2)
    return figure
