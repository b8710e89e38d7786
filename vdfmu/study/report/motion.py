"""The picture of a motion: positions of the joints and three of the derivatives."""

from __future__ import annotations

from matplotlib.figure import Figure

from vdfmu.arm.robot import Robot
from vdfmu.base import style
from vdfmu.base.arrays import Floats
from vdfmu.study.report.joints import group_joints

_PANELS = ((0, "Position", ""), (1, "Speed", "/s"), (2, "Acceleration", "/s²"), (4, "Snap", "/s⁴"))


@style.styled
def draw_motion(title: str, robot: Robot, t: Floats, q: Floats) -> Figure:
    """Draw a motion, a column for each type of joint.

    Parameters
    ----------
    title : str
    robot : Robot
    t : (m,) [s]
    q : (5, m, n) [rad or m, and per s .. s4]
        Positions and four derivatives.
    """
    groups = group_joints(robot, range(robot.n))
    columns = len(groups)
    figure = style.new_figure(title, "", height=7.0, legend=style.joint_handles(range(robot.n)))
    panels = [figure.add_subplot(4, columns, k + 1) for k in range(4 * columns)]
    for k, axes in enumerate(panels):
        (order, name, per), group = _PANELS[k // columns], groups[k % columns]
        for j in group.joints:
            style.curve(axes, t, group.unit.factor * q[order, :, j], **style.joint_look(j))
        style.dress(axes, f"{name}{group.suffix}", name.lower(), group.unit.position + per, t)
    style.label_time(panels, columns)
    return figure
