"""The pictures of a run: the paper's figures 7, 8, 10, 11, 13 and 14 from our data, torques link-side.

Every picture has a function that returns the matplotlib figure (``draw_...``). It reads of the results and of the
scenario only what `vdfmu.study.report.pictures.picture_key` has, so that pictures can be kept. Angles are in deg,
torques in N.m; a prismatic joint has mm and N. Joints of different units never share an axis.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from vdfmu.arm.dynamics import forward_kinematics
from vdfmu.arm.robot import Robot
from vdfmu.base import style
from vdfmu.base.arrays import Floats
from vdfmu.base.measure import JOINT_UNITS
from vdfmu.engine.results.results import Results
from vdfmu.study.report.captions import run_caption
from vdfmu.study.report.joints import Group, group_joints, panel_letter
from vdfmu.system.scenario import Scenario

# --- figures ---------------------------------------------------------------------------------------------


@style.styled
def draw_torques(results: Results, scenario: Scenario) -> Figure:
    """Figure 10: control torque and feedforward torque, link-side, one panel a joint."""
    robot = scenario.arm
    rows, columns = style.grid_of(robot.n)
    figure = style.new_figure(
        "Control and feedforward torques, link side",
        run_caption(results, scenario, {4: 10}),
        width=max(style.WIDTH, 2.9 * columns),
        height=1.1 + (3.2 if rows == 1 else 2.1) * rows,
        legend=_legend(),
    )
    grid: NDArray[Any] = figure.subplots(rows, columns, squeeze=False)
    panels: list[Axes] = grid.ravel().tolist()
    for axes in panels[robot.n :]:
        axes.remove()
    style.label_time(panels[: robot.n], columns)
    tau, tau_m = _torques(results, robot)
    for i, axes in enumerate(panels[: robot.n]):
        _over_each_other(axes, f"Joint {i + 1}", robot, i, results.time, tau, tau_m)
    return _lettered(figure)


@style.styled
def draw_errors(results: Results, scenario: Scenario) -> Figure:
    """Figure 11: position tracking errors above torque compensation errors, link-side."""
    robot = scenario.arm
    groups = group_joints(robot, range(robot.n))
    caption = run_caption(results, scenario, {4: 11})
    figure, grid = _unit_columns("Position tracking and torque compensation errors", caption, groups, 2)
    for column, group in enumerate(groups):
        _position_errors(grid[0, column], results, group)
        _compensation_errors(grid[1, column], results, robot, group)
    style.label_time(grid.ravel().tolist(), len(groups))
    style.legend_beside(grid[0, -1], style.joint_handles(range(robot.n)))
    return _lettered(figure)


@style.styled
def draw_moving_positions(results: Results, scenario: Scenario) -> Figure:
    """Figure 13: desired and actual positions of the joints that move, above their tracking errors."""
    moving = _moving(results)
    groups = group_joints(scenario.arm, moving)
    caption = run_caption(results, scenario, {5: 13})
    figure, grid = _unit_columns("Joint positions and their tracking errors", caption, groups, 2)
    q_d, q = results["trajectory.q_d"], results["plant.q"]
    for column, group in enumerate(groups):
        axes: Axes = grid[0, column]
        unit, time = group.unit, results.time
        for i in group.joints:
            style.curve(axes, time, unit.factor * q[:, i], **{**style.joint_look(i), "linewidth": 3.2})
            style.curve(axes, time, unit.factor * q_d[:, i], **style.ON_TOP)
        style.dress(axes, f"Desired and actual positions{group.suffix}", "Position", unit.position, time)
        _position_errors(grid[1, column], results, group)
    style.label_time(grid.ravel().tolist(), len(groups))
    desired = Line2D([], [], label="desired", **style.ON_TOP)
    style.legend_beside(grid[0, -1], [*style.joint_handles(moving), desired])
    return _lettered(figure)


@style.styled
def draw_moving_torques(results: Results, scenario: Scenario) -> Figure:
    """Figure 14: control and feedforward torques of the joints that move, above their compensation errors.

    Each joint has a torque panel of its own: in one panel the smaller torques would be flat lines.
    """
    robot, moving = scenario.arm, _moving(results)
    groups = group_joints(robot, moving)
    rows, columns = style.grid_of(len(moving))
    figure = style.new_figure(
        "Joint torques, link side, and their compensation errors",
        run_caption(results, scenario, {5: 14}),
        height=1.4 + 2.5 * (rows + 1),
        width=_width(groups),
        legend=_legend(),
    )
    # fine enough that a panel a joint and a panel a unit both span whole cells
    grid = figure.add_gridspec(rows + 1, columns * len(groups))
    tau, tau_m = _torques(results, robot)
    upper: list[Axes] = []
    for place, i in enumerate(moving):
        row, column = divmod(place, columns)
        axes = figure.add_subplot(grid[row, column * len(groups) : (column + 1) * len(groups)])
        _over_each_other(axes, f"Joint {i + 1}", robot, i, results.time, tau, tau_m)
        upper.append(axes)
    lower: list[Axes] = []
    for column, group in enumerate(groups):
        axes = figure.add_subplot(grid[rows, column * columns : (column + 1) * columns])
        _compensation_errors(axes, results, robot, group)
        lower.append(axes)
    style.label_time(upper, columns)
    style.label_time(lower, len(groups))
    style.legend_beside(lower[-1], style.joint_handles(moving))
    return _lettered(figure)


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
        style.dress(axes, f"Torsion{group.suffix}", r"$\kappa - q$", group.unit.position, results.time)
        style.label_time([axes], 1)
    style.legend_beside(figure.axes[-1], style.joint_handles(range(scenario.arm.n)))
    below = figure.add_subplot(grid[1, :])
    curves = {"x": error[:, 0], "y": error[:, 1], "z": error[:, 2], "length": np.linalg.norm(error, axis=1)}
    handles: list[Line2D] = []
    for place, (label, values) in enumerate(curves.items()):
        look = {"color": "black", "linewidth": 1.0} if label == "length" else style.joint_look(place)
        handles.append(style.curve(below, results.time, values, label=label, **look))
    style.dress(below, "Tool", "$p_{O,d} - p_O$", "mm", results.time)
    style.label_time([below], 1)
    style.legend_beside(below, handles)
    return _lettered(figure)


# --- written files ---------------------------------------------------------------------------------------


_DRAW: dict[str, Callable[..., Figure]] = {
    "figure_10": draw_torques,
    "figure_11": draw_errors,
    "figure_13": draw_moving_positions,
    "figure_14": draw_moving_torques,
    "torques": draw_torques,
    "errors": draw_errors,
    "tool": draw_tool,
}


def draw_picture(results: Results, scenario: Scenario, path: Path) -> None:
    """Write a picture of `vdfmu.study.report.pictures.PICTURES`, as its name and suffix say."""
    style.save(_DRAW[path.stem](results, scenario), path)


# --- panels ----------------------------------------------------------------------------------------------


def _lettered(figure: Figure) -> Figure:
    """Put (a), (b), ... before the titles of a figure's panels, row by row."""
    for place, axes in enumerate(figure.axes):
        axes.set_title(f"{panel_letter(place)} {axes.get_title(loc='left')}")
    return figure


def _width(groups: Sequence[Group]) -> float:
    """Width [in] of a figure with a column for each group of joints."""
    return style.WIDTH + 2.0 * (len(groups) - 1)


def _unit_columns(title: str, caption: str, groups: Sequence[Group], rows: int) -> tuple[Figure, NDArray[Any]]:
    """Return a figure with a column of panels for each group of joints, and the panels, (rows, groups)."""
    figure = style.new_figure(title, caption, height=2.0 + 2.2 * rows, width=_width(groups))
    return figure, figure.subplots(rows, len(groups), squeeze=False)


def _legend() -> list[Line2D]:
    """Entries of two curves that may lie on each other: a broad one and a dashed one over it."""
    return [
        Line2D([], [], label=r"control $\ell\,\tau$", **style.BACK),
        Line2D([], [], label=r"feedforward $\ell\,\tau_m$", **style.ON_TOP),
    ]


def _over_each_other(axes: Axes, title: str, robot: Robot, i: int, time: Floats, back: Floats, on_top: Floats) -> None:
    """Draw two torques (m, n) of joint `i` over each other."""
    unit = JOINT_UNITS[robot.joint_types[i]]
    style.curve(axes, time, back[:, i], **style.BACK)
    style.curve(axes, time, on_top[:, i], **style.ON_TOP)
    style.dress(axes, title, unit.noun.capitalize(), unit.torque, time)


def _position_errors(axes: Axes, results: Results, group: Group) -> None:
    """Draw desired minus actual link positions of the joints of one unit."""
    error = group.unit.factor * (results["trajectory.q_d"] - results["plant.q"])
    _errors(axes, results.time, error, group, "Position tracking", "$q_d - q$", group.unit.position)


def _compensation_errors(axes: Axes, results: Results, robot: Robot, group: Group) -> None:
    """Draw control minus feedforward torque, link-side, of the joints of one unit."""
    tau, tau_m = _torques(results, robot)
    what = f"{group.unit.noun.capitalize()} compensation"
    _errors(axes, results.time, tau - tau_m, group, what, r"$\ell\,(\tau - \tau_m)$", group.unit.torque)


def _errors(axes: Axes, time: Floats, values: Floats, group: Group, what: str, quantity: str, unit: str) -> None:
    for i in group.joints:
        style.curve(axes, time, values[:, i], **style.joint_look(i))
    style.dress(axes, f"{what} errors{group.suffix}", quantity, unit, time)


# --- data ------------------------------------------------------------------------------------------------


def _torques(results: Results, robot: Robot) -> tuple[Floats, Floats]:
    """Control torque and the feedforward to which the controller added, (m, n), link-side [N.m or N]."""
    return robot.ell * results["controller.tau"], robot.ell * results["feedforward.tau_m"]


def _moving(results: Results) -> list[int]:
    """Joints whose desired position changes; all if none does."""
    q_d = results["trajectory.q_d"]
    return np.flatnonzero(np.ptp(q_d, axis=0)).tolist() or list(range(q_d.shape[1]))


def torsion(results: Results) -> Floats:
    """Return the positions of the rotors before those of their links, ``kappa - q``: (m, n) [rad or m]."""
    return results["plant.kappa"] - results["plant.q"]


def tool_error(results: Results, scenario: Scenario) -> Floats:
    """Return the desired position of the tool minus the actual one, in {I}: (m, 3) [m]."""
    p_d, _ = forward_kinematics(scenario.arm, results["trajectory.q_d"])
    return p_d - results["plant.p_O"]
