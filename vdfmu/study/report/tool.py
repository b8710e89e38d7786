"""The picture of the elastic arm: how far its drives twist, and the effect on the tool."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from vdfmu.arm.dynamics import forward_kinematics
from vdfmu.base import style
from vdfmu.base.arrays import Floats
from vdfmu.engine.results.results import Results
from vdfmu.study.report.captions import run_caption
from vdfmu.study.report.joints import group_joints, panel_letter
from vdfmu.system.scenario import Scenario


def torsion(results: Results) -> Floats:
    """Return the positions of the rotors before those of their links, ``kappa - q``: (m, n) [rad or m]."""
    return results["plant.kappa"] - results["plant.q"]


def tool_error(results: Results, scenario: Scenario) -> Floats:
    """Return the desired position of the tool minus the actual one, in {I}: (m, 3) [m]."""
    p_d, _ = forward_kinematics(scenario.arm, results["trajectory.q_d"])
    return p_d - results["plant.p_O"]


@style.styled
def draw_tool(results: Results, scenario: Scenario) -> Figure:
    """Draw torsion, a panel for each type of joint, above the tool's position error along the axes of {I}, in mm."""
    groups = group_joints(scenario.arm, range(scenario.arm.n))
    figure = style.new_figure(
        "Torsion of the drives, and the error of the tool", run_caption(results, scenario, {}), height=6.4
    )
    grid = figure.add_gridspec(2, len(groups))
    twist, error = torsion(results), 1e3 * tool_error(results, scenario)
    for column, group in enumerate(groups):
        axes = figure.add_subplot(grid[0, column])
        for i in group.joints:
            style.curve(axes, results.time, group.unit.factor * twist[:, i], **style.joint_look(i))
        title = f"{panel_letter(column)} Torsion{group.suffix}"
        style.dress(axes, title, r"$\kappa - q$", group.unit.position, results.time)
        style.label_time([axes], 1)
    style.legend_beside(figure.axes[-1], style.joint_handles(range(scenario.arm.n)))
    below = figure.add_subplot(grid[1, :])
    curves = {"x": error[:, 0], "y": error[:, 1], "z": error[:, 2], "length": np.linalg.norm(error, axis=1)}
    handles: list[Line2D] = []
    for place, (label, values) in enumerate(curves.items()):
        look = {"color": "black", "linewidth": 1.0} if label == "length" else style.joint_look(place)
        handles.append(style.curve(below, results.time, values, label=label, **look))
    style.dress(below, f"{panel_letter(len(groups))} Tool", "$p_{O,d} - p_O$", "mm", results.time)
    style.label_time([below], 1)
    style.legend_beside(below, handles)
    return figure
