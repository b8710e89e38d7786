"""The pictures of a run: the paper's figures 7, 8, 10, 11, 13 and 14 from our data, torques link-side.

Every picture has a function that returns the matplotlib figure (``draw_...``); :func:`run_figures` writes them. Angles
are in deg, torques in N.m; a prismatic joint has mm and N. Joints of different units never share an axis.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from vdfmu.arm.robot import Robot
from vdfmu.base import style
from vdfmu.base.arrays import Floats
from vdfmu.engine.results.results import Results
from vdfmu.study.report.captions import contrast_caption, paper_table, run_caption
from vdfmu.study.report.contrast import Contrast
from vdfmu.study.report.joints import UNITS, Group, group_joints, panel_letter
from vdfmu.study.report.tool import draw_tool
from vdfmu.system.scenario import Scenario

_BACK: dict[str, Any] = {"color": style.COLORS[5], "linewidth": 3.2}
_ON_TOP: dict[str, Any] = {"color": "#000000", "linewidth": 1.1, "linestyle": (0, (5, 3))}
_TORQUES = (r"control $\ell\,\tau$", r"feedforward $\ell\,\tau_m$")
_DARK, _MIDDLE, _LIGHT = "#444444", "#888888", "#CCCCCC"


# --- figures ---------------------------------------------------------------------------------------------


@style.styled
def draw_contrast_torques(contrast: Contrast, scenario: Scenario | None = None) -> Figure:
    """Figure 7: torques of the rigid arm by both formulations, one panel a joint."""
    robot, time = contrast.robot, contrast.time
    title = "Joint torques by virtual decomposition and by Newton-Euler"
    caption = contrast_caption(robot, time, scenario, 7)
    legend = _pair("virtual decomposition", "Newton-Euler")
    return _joint_panels(title, caption, robot, legend, time, contrast.tau_vd, contrast.tau_ne)


@style.styled
def draw_contrast_differences(contrast: Contrast, scenario: Scenario | None = None) -> Figure:
    """Figure 8: VD minus Newton-Euler, g minus a lower g, and the RMS of that and 1e-3 of the torque beside Table 3.

    The first panels show absolute values on a logarithmic axis of at most nine decades; a difference of 0 has
    no point there.
    """
    robot, time = contrast.robot, contrast.time
    rounding = 1e3 * (contrast.tau_vd - contrast.tau_ne)
    gravity = 1e3 * (contrast.tau_vd - contrast.tau_low_g)
    g, low = contrast.gravities
    paper = [] if scenario is None else scenario.paper.get("rms_torque_difference_nmm", [])
    groups = group_joints(robot, range(robot.n))
    caption = contrast_caption(robot, time, scenario, 8)
    figure, grid = _unit_columns("Differences of the joint torques", caption, groups, 3)
    for column, (unit, joints, suffix) in enumerate(groups):
        noise, constant, rms = grid[:, column]
        if rounding[:, joints].any():
            noise.set_yscale("log")
        for i in joints:
            size = np.abs(rounding[:, i])
            rows = size > 0.0
            dots = {"linestyle": "none", "marker": ".", "markersize": 3.0}
            noise.plot(time[rows], size[rows], **{**style.joint_look(i), **dots})
            style.curve(constant, time, gravity[:, i], **style.joint_look(i))
        beside = [] if unit.joint_type == "prismatic" else paper
        shown = f"RMS of {panel_letter(len(groups) + column)}"
        _rms_bars(rms, shown, gravity, contrast.tau_vd, joints, beside)
        style.dress(
            noise, f"VD minus Newton-Euler: rounding{suffix}", "|difference|", unit.small_torque, time
        )
        style.dress(
            constant, f"g = {g:#.4g} minus g = {low:#.4g}{suffix}", "Difference", unit.small_torque, time
        )
        title = f"{shown}, Table 3, and 1e-3 of the RMS torque" if beside else shown
        style.dress(rms, f"{title}{suffix}", "RMS", unit.small_torque)
        style.label_time([noise], 1)
        style.label_time([constant], 1)
    style.legend_beside(grid[0, -1], style.joint_handles(range(robot.n)))
    return _lettered(figure)


@style.styled
def draw_torques(results: Results, scenario: Scenario) -> Figure:
    """Figure 10: control torque and feedforward torque, link-side, one panel a joint."""
    title, caption = "Control and feedforward torques, link side", run_caption(results, scenario, {4: 10})
    torques = _torques(results, scenario.arm)
    return _joint_panels(title, caption, scenario.arm, _pair(*_TORQUES), results.time, *torques)


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
            style.curve(axes, time, unit.factor * q_d[:, i], **_ON_TOP)
        style.dress(axes, f"Desired and actual positions{group.suffix}", "Position", unit.position, time)
        _position_errors(grid[1, column], results, group)
    style.label_time(grid.ravel().tolist(), len(groups))
    desired = Line2D([], [], label="desired", **_ON_TOP)
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
        legend=_pair(*_TORQUES),
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


# --- what is written -------------------------------------------------------------------------------------


FIGURES: dict[int, dict[str, Callable[..., Figure]]] = {
    3: {"figure_7": draw_contrast_torques, "figure_8": draw_contrast_differences},
    4: {"figure_10": draw_torques, "figure_11": draw_errors, "tool": draw_tool},
    5: {"figure_13": draw_moving_positions, "figure_14": draw_moving_torques, "tool": draw_tool},
    0: {"torques": draw_torques, "errors": draw_errors, "tool": draw_tool},
}
"""Table of the paper that a scenario compares with, to the names of its pictures and what draws them."""


def run_figures(
    shown: Results | Contrast, scenario: Scenario, folder: Path | str, pictures: Sequence[str] = ("png",)
) -> list[Path]:
    """Write the pictures of a run: which ones, `FIGURES` says, by the table in ``scenario.paper["source"]``.

    The folder is made if it is missing. `pictures` are suffixes that `vdfmu.base.style.save` knows.
    """
    table = 3 if not isinstance(shown, Results) else {4: 4, 5: 5}.get(paper_table(scenario), 0)
    wanted = FIGURES[table].items()
    figures = {name: draw(shown, scenario) for name, draw in wanted}
    return [
        style.save(figure, Path(folder, f"{name}.{suffix}"))
        for name, figure in figures.items()
        for suffix in pictures
    ]


# --- panels ----------------------------------------------------------------------------------------------


def _lettered(figure: Figure) -> Figure:
    """Put (a), (b), ... before the titles of a figure's panels, row by row."""
    for place, axes in enumerate(figure.axes):
        axes.set_title(f"{panel_letter(place)} {axes.get_title(loc='left')}")
    return figure


def _joint_panels(
    title: str,
    caption: str,
    robot: Robot,
    legend: Sequence[Line2D],
    time: Floats,
    back: Floats,
    on_top: Floats,
) -> Figure:
    """Return a figure of two torques (m, n) over each other, one panel a joint."""
    rows, columns = style.grid_of(robot.n)
    width = max(style.WIDTH, 2.9 * columns)
    height = 1.1 + (3.2 if rows == 1 else 2.1) * rows
    figure = style.new_figure(title, caption, width=width, height=height, legend=legend)
    grid: NDArray[Any] = figure.subplots(rows, columns, squeeze=False)
    panels: list[Axes] = grid.ravel().tolist()
    for axes in panels[robot.n :]:
        axes.remove()
    style.label_time(panels[: robot.n], columns)
    for i, axes in enumerate(panels[: robot.n]):
        _over_each_other(axes, f"Joint {i + 1}", robot, i, time, back, on_top)
    return _lettered(figure)


def _width(groups: Sequence[Group]) -> float:
    """Width [in] of a figure with a column for each group of joints."""
    return style.WIDTH + 2.0 * (len(groups) - 1)


def _unit_columns(
    title: str, caption: str, groups: Sequence[Group], rows: int
) -> tuple[Figure, NDArray[Any]]:
    """Return a figure with a column of panels for each group of joints, and the panels, (rows, groups)."""
    figure = style.new_figure(title, caption, height=2.0 + 2.2 * rows, width=_width(groups))
    return figure, figure.subplots(rows, len(groups), squeeze=False)


def _pair(back: str, on_top: str) -> list[Line2D]:
    """Entries of a legend of two curves that may lie on each other: a broad one and a dashed one over it."""
    return [Line2D([], [], label=back, **_BACK), Line2D([], [], label=on_top, **_ON_TOP)]


def _over_each_other(
    axes: Axes, title: str, robot: Robot, i: int, time: Floats, back: Floats, on_top: Floats
) -> None:
    """Draw two torques (m, n) of joint `i` over each other."""
    unit = UNITS[robot.joint_types[i]]
    style.curve(axes, time, back[:, i], **_BACK)
    style.curve(axes, time, on_top[:, i], **_ON_TOP)
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


def _errors(
    axes: Axes, time: Floats, values: Floats, group: Group, what: str, quantity: str, unit: str
) -> None:
    for i in group.joints:
        style.curve(axes, time, values[:, i], **style.joint_look(i))
    style.dress(axes, f"{what} errors{group.suffix}", quantity, unit, time)


def _rms_bars(
    axes: Axes, shown: str, values: Floats, torque: Floats, joints: Sequence[int], paper: Sequence[float]
) -> None:
    """Draw each joint's RMS of `values` [N.mm], and beside the paper's, if any, 1e-3 of that of `torque` [N.m]."""
    ours, thousandth = (np.sqrt(np.mean(a[:, joints] ** 2, axis=0)).tolist() for a in (values, torque))
    series = [(shown, ours, _DARK)]
    if paper:
        series.append(("Table 3", [paper[i] if i < len(paper) else math.nan for i in joints], _LIGHT))
        series.append(("1e-3 of torque", thousandth, _MIDDLE))
    width = 0.8 / len(series)
    handles: list[Line2D] = []
    for k, (label, heights, color) in enumerate(series):
        places = np.arange(len(joints)) + (k - 0.5 * (len(series) - 1)) * width
        bars = axes.bar(places, heights, width=0.92 * width, color=color)
        texts = ["" if math.isnan(h) else f"{h:.1f}" if paper else f"{h:.2g}" for h in heights]
        axes.bar_label(bars, texts, padding=1.5, fontsize=7.5 if paper else 9.0)  # three side by side
        handles.append(Line2D([], [], linestyle="none", marker="s", markersize=9.0, color=color, label=label))
    axes.set_xticks(range(len(joints)), [f"Joint {i + 1}" for i in joints])
    axes.grid(visible=False, axis="x")
    axes.margins(y=0.14)
    beside = max(0.5, 0.5 * (4 - len(joints)))  # no broader than a bar of four
    axes.set_xlim(-beside, len(joints) - 1 + beside)
    if paper:
        style.legend_beside(axes, handles)


# --- data ------------------------------------------------------------------------------------------------


def _torques(results: Results, robot: Robot) -> tuple[Floats, Floats]:
    """Control torque and the feedforward that the controller added to, (m, n), link-side [N.m or N]."""
    return robot.ell * results["controller.tau"], robot.ell * results["controller.tau_m"]


def _moving(results: Results) -> list[int]:
    """Joints whose desired position changes; all if none does."""
    q_d = results["trajectory.q_d"]
    return np.flatnonzero(np.ptp(q_d, axis=0)).tolist() or list(range(q_d.shape[1]))
