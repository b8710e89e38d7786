"""The pictures of a run: the paper's figures 7, 8, 10, 11, 13 and 14 from our data, torques link-side.

Every picture has a function that returns the matplotlib figure (``draw_...``) and is written by one of
:func:`contrast_figures`, :func:`tracking_figures`, :func:`two_joint_figures`. Angles are in deg, torques in N.m; a
prismatic joint has mm and N. Joints of different units never share an axis.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from vdfmu.cosim.results import Results
from vdfmu.model import Robot, Scenario
from vdfmu.report import style

__all__ = [
    "Contrast",
    "contrast_figures",
    "draw_contrast_differences",
    "draw_contrast_torques",
    "draw_errors",
    "draw_moving_positions",
    "draw_moving_torques",
    "draw_torques",
    "run_figures",
    "tracking_figures",
    "two_joint_figures",
]

Floats = NDArray[np.float64]


class Contrast(Protocol):
    """Link-side torques [N.m, N if prismatic] along one motion by several formulations."""

    @property
    def robot(self) -> Robot:
        """The arm."""
        ...

    @property
    def time(self) -> Floats:
        """(m,) [s]."""
        ...

    @property
    def tau_vd(self) -> Floats:
        """(m, n), virtual decomposition."""
        ...

    @property
    def tau_ne(self) -> Floats:
        """(m, n), Newton-Euler."""
        ...

    @property
    def tau_g980(self) -> Floats:
        """(m, n), either of them with a gravity of 9.80 in place of 9.81 m/s2."""
        ...


class _Unit(NamedTuple):
    """How the values of one type of joint are shown: units, and the factor from rad or m."""

    joint_type: str
    position: str
    factor: float
    torque: str
    small_torque: str
    noun: str


_UNITS = (
    _Unit("revolute", "deg", 180.0 / math.pi, "N.m", "N.mm", "torque"),
    _Unit("prismatic", "mm", 1e3, "N", "mN", "force"),
)


_Group = tuple[_Unit, list[int]]


def contrast_figures(contrast: Contrast, folder: Path | str, scenario: Scenario | None = None) -> list[Path]:
    """Write figure_7.png (torques) and figure_8.png (differences) of Section IV-A.

    Parameters
    ----------
    contrast : Contrast
    folder : path
        Is made if it is missing.
    scenario : Scenario, optional
        For the caption and for Table 3, which figure_8 shows beside ours.
    """
    folder = Path(folder)
    return [
        style.save(draw_contrast_torques(contrast, scenario), folder / "figure_7.png"),
        style.save(draw_contrast_differences(contrast, scenario), folder / "figure_8.png"),
    ]


def tracking_figures(results: Results, scenario: Scenario, folder: Path | str) -> list[Path]:
    """Write the torques, one panel a joint, and the errors of all joints.

    The names are those of the paper's figures when `scenario.paper` compares with Table 4: figure_10.png and
    figure_11.png. Otherwise they are torques.png and errors.png.
    """
    folder = Path(folder)
    names = ("figure_10.png", "figure_11.png") if _table(scenario) == 4 else ("torques.png", "errors.png")
    return [
        style.save(draw_torques(results, scenario), folder / names[0]),
        style.save(draw_errors(results, scenario), folder / names[1]),
    ]


def two_joint_figures(results: Results, scenario: Scenario, folder: Path | str) -> list[Path]:
    """Write figure_13.png (positions) and figure_14.png (torques) of the joints that move, Section IV-C."""
    folder = Path(folder)
    return [
        style.save(draw_moving_positions(results, scenario), folder / "figure_13.png"),
        style.save(draw_moving_torques(results, scenario), folder / "figure_14.png"),
    ]


def run_figures(results: Results, scenario: Scenario, folder: Path | str) -> list[Path]:
    """Write the pictures of a co-simulation.

    Which ones follows from ``scenario.paper["source"]``: `two_joint_figures` for Table 5, `tracking_figures` for
    Table 4 and for a scenario that compares with nothing.
    """
    draw = two_joint_figures if _table(scenario) == 5 else tracking_figures
    return draw(results, scenario, folder)


@style.styled
def draw_contrast_torques(contrast: Contrast, scenario: Scenario | None = None) -> Figure:
    """Figure 7: torques of the rigid arm by both formulations, one panel a joint."""
    figure, panels = _joint_panels(
        "Joint torques by virtual decomposition and by Newton-Euler",
        _contrast_caption(contrast, scenario, "Figure 7"),
        contrast.robot.n,
        _pair("virtual decomposition", "Newton-Euler"),
    )
    _draw_pairs(panels, contrast.robot, contrast.time, contrast.tau_vd, contrast.tau_ne)
    return figure


@style.styled
def draw_contrast_differences(contrast: Contrast, scenario: Scenario | None = None) -> Figure:
    """Figure 8: (a) VD minus Newton-Euler, (b) g = 9.81 minus g = 9.80, (c) RMS of (b) beside Table 3.

    The panels (a) show absolute values on a logarithmic axis; a difference of exactly 0 has no point there.
    """
    robot, time = contrast.robot, contrast.time
    rounding = 1e3 * (contrast.tau_vd - contrast.tau_ne)
    gravity = 1e3 * (contrast.tau_vd - contrast.tau_g980)
    paper = [] if scenario is None else scenario.paper.get("rms_torque_difference_nmm", [])
    groups = _groups(robot, range(robot.n))
    figure = style.new_figure(
        "Differences of the joint torques", _contrast_caption(contrast, scenario, "Figure 8"), height=8.6
    )
    grid: NDArray[Any] = figure.subplots(3, len(groups), squeeze=False)
    for column, (unit, joints) in enumerate(groups):
        noise, constant, rms = grid[:, column]
        kind = f", {unit.joint_type}" if len(groups) > 1 else ""
        if rounding[:, joints].any():
            noise.set_yscale("log")
        for i in joints:
            size = np.abs(rounding[:, i])
            rows = size > 0.0
            color = style.joint_look(i)["color"]
            noise.plot(time[rows], size[rows], linestyle="none", marker=".", markersize=3.0, color=color)
            style.curve(constant, time, gravity[:, i], **style.joint_look(i))
        _rms_bars(rms, gravity, joints, [] if unit.joint_type == "prismatic" else paper)
        style.dress(
            noise, f"(a) VD minus Newton-Euler: rounding{kind}", "|Difference|", unit.small_torque, time
        )
        style.dress(
            constant, f"(b) g = 9.81 minus g = 9.80 m/s\u00b2{kind}", "Difference", unit.small_torque, time
        )
        beside = " beside Table 3 of the paper" if paper else ""
        style.dress(rms, f"(c) RMS of (b){beside}{kind}", "RMS", unit.small_torque)
        style.label_time([noise], 1)
        style.label_time([constant], 1)
    style.legend_beside(grid[1, -1], style.joint_handles(range(robot.n)))
    return figure


@style.styled
def draw_torques(results: Results, scenario: Scenario) -> Figure:
    """Figure 10: control torque and feedforward torque, link-side, one panel a joint."""
    figure, panels = _joint_panels(
        "Control and feedforward torques, link side",
        _caption(results, scenario, "Figure 10" if _table(scenario) == 4 else ""),
        scenario.robot.n,
        _torque_pair(),
    )
    _draw_pairs(panels, scenario.robot, results.time, *_torques(results, scenario.robot))
    return figure


@style.styled
def draw_errors(results: Results, scenario: Scenario) -> Figure:
    """Figure 11: (a) position tracking errors, (b) torque compensation errors, link-side."""
    groups = _groups(scenario.robot, range(scenario.robot.n))
    figure = style.new_figure(
        "Position tracking and torque compensation errors",
        _caption(results, scenario, "Figure 11" if _table(scenario) == 4 else ""),
        height=6.4,
    )
    grid: NDArray[Any] = figure.subplots(2, len(groups), squeeze=False)
    for column, group in enumerate(groups):
        _position_errors(grid[0, column], "(a)", results, group, len(groups))
        _compensation_errors(grid[1, column], "(b)", results, scenario.robot, group, len(groups))
    style.label_time(grid.ravel().tolist(), len(groups))
    style.legend_beside(grid[0, -1], style.joint_handles(range(scenario.robot.n)))
    return figure


@style.styled
def draw_moving_positions(results: Results, scenario: Scenario) -> Figure:
    """Figure 13: (a) desired and actual positions of the joints that move, (b) their tracking errors."""
    moving = _moving(scenario)
    groups = _groups(scenario.robot, moving)
    figure = style.new_figure(
        "Joint positions and their tracking errors",
        _caption(results, scenario, "Figure 13" if _table(scenario) == 5 else ""),
        height=6.4,
    )
    grid: NDArray[Any] = figure.subplots(2, len(groups), squeeze=False)
    q_d, q = results.array("trajectory.q_d"), results.array("plant.q")
    for column, group in enumerate(groups):
        unit, joints = group
        axes: Axes = grid[0, column]
        for i in joints:
            style.curve(
                axes, results.time, unit.factor * q[:, i], **{**style.joint_look(i), "linewidth": 3.2}
            )
            style.curve(axes, results.time, unit.factor * q_d[:, i], **_ON_TOP)
        kind = f", {unit.joint_type}" if len(groups) > 1 else ""
        style.dress(axes, f"(a) Desired and actual positions{kind}", "Position", unit.position, results.time)
        _position_errors(grid[1, column], "(b)", results, group, len(groups))
    style.label_time(grid.ravel().tolist(), len(groups))
    style.legend_beside(
        grid[0, -1], [*style.joint_handles(moving), Line2D([], [], label="desired", **_ON_TOP)]
    )
    return figure


@style.styled
def draw_moving_torques(results: Results, scenario: Scenario) -> Figure:
    """Figure 14: (a) control and feedforward torques of the joints that move, (b) compensation errors."""
    robot, moving = scenario.robot, _moving(scenario)
    groups = _groups(robot, moving)
    rows, columns = style.grid_of(len(moving))
    figure = style.new_figure(
        "Joint torques, link side, and their compensation errors",
        _caption(results, scenario, "Figure 14" if _table(scenario) == 5 else ""),
        height=1.4 + 2.5 * (rows + 1),
        legend=_torque_pair(),
    )
    # fine enough that a panel a joint and a panel a unit both span whole cells
    grid = figure.add_gridspec(rows + 1, columns * len(groups))
    panels: list[Axes] = []
    for place in range(len(moving)):
        row, column = divmod(place, columns)
        panels.append(figure.add_subplot(grid[row, column * len(groups) : (column + 1) * len(groups)]))
    tau, tau_m = _torques(results, robot)
    _draw_pairs(panels, robot, results.time, tau, tau_m, moving, "(a)")
    below: list[Axes] = []
    for column, group in enumerate(groups):
        below.append(figure.add_subplot(grid[rows, column * columns : (column + 1) * columns]))
        _compensation_errors(below[-1], "(b)", results, robot, group, len(groups))
    style.label_time(panels, columns)
    style.label_time(below, len(below))
    style.legend_beside(below[-1], style.joint_handles(moving))
    return figure


_BACK: dict[str, Any] = {"color": style.COLORS[5], "linewidth": 3.2}
_DARK, _LIGHT = "#444444", "#BBBBBB"
_ON_TOP: dict[str, Any] = {"color": style.FRONT, "linewidth": 1.1, "linestyle": (0, (5, 3))}


def _pair(back: str, on_top: str) -> list[Line2D]:
    """Entries of a legend of two curves that may lie on each other: a broad one and a dashed one over it."""
    return [Line2D([], [], label=back, **_BACK), Line2D([], [], label=on_top, **_ON_TOP)]


def _torque_pair() -> list[Line2D]:
    return _pair(r"control $\ell\,\tau$", r"feedforward $\ell\,\tau_m$")


def _joint_panels(title: str, caption: str, n: int, legend: Sequence[Line2D]) -> tuple[Figure, list[Axes]]:
    rows, columns = style.grid_of(n)
    width = max(style.WIDTH, 2.9 * columns)
    height = 1.1 + (3.2 if rows == 1 else 2.1) * rows
    figure = style.new_figure(title, caption, width=width, height=height, legend=legend)
    grid: NDArray[Any] = figure.subplots(rows, columns, squeeze=False)
    panels: list[Axes] = grid.ravel().tolist()
    for axes in panels[n:]:
        axes.remove()
    style.label_time(panels[:n], columns)
    return figure, panels[:n]


def _draw_pairs(
    panels: Sequence[Axes],
    robot: Robot,
    time: Floats,
    back: Floats,
    on_top: Floats,
    joints: Sequence[int] | None = None,
    letter: str = "",
) -> None:
    """Draw two torques (m, n) of each joint over each other, one panel a joint."""
    for place, (axes, i) in enumerate(zip(panels, range(robot.n) if joints is None else joints, strict=True)):
        unit = _unit(robot, i)
        style.curve(axes, time, back[:, i], **_BACK)
        style.curve(axes, time, on_top[:, i], **_ON_TOP)
        title = f"{letter or _letter(place)} Joint {i + 1}"
        style.dress(axes, title, unit.noun.capitalize(), unit.torque, time)


def _position_errors(axes: Axes, letter: str, results: Results, group: _Group, groups: int) -> None:
    """Draw desired minus actual link positions of the joints of one unit."""
    unit, joints = group
    e = unit.factor * (results.array("trajectory.q_d") - results.array("plant.q"))
    for i in joints:
        style.curve(axes, results.time, e[:, i], **style.joint_look(i))
    kind = f", {unit.joint_type}" if groups > 1 else ""
    style.dress(axes, f"{letter} Position tracking errors{kind}", "$q_d - q$", unit.position, results.time)


def _compensation_errors(
    axes: Axes, letter: str, results: Results, robot: Robot, group: _Group, groups: int
) -> None:
    """Draw control minus feedforward torque, link-side, of the joints of one unit."""
    unit, joints = group
    tau, tau_m = _torques(results, robot)
    for i in joints:
        style.curve(axes, results.time, tau[:, i] - tau_m[:, i], **style.joint_look(i))
    kind = f", {unit.joint_type}" if groups > 1 else ""
    title = f"{letter} {unit.noun.capitalize()} compensation errors{kind}"
    style.dress(axes, title, r"$\ell\,(\tau - \tau_m)$", unit.torque, results.time)


def _torques(results: Results, robot: Robot) -> tuple[Floats, Floats]:
    """Control torque and the feedforward that the controller added to, (m, n), link-side [N.m or N]."""
    return robot.ell * results.array("controller.tau"), robot.ell * results.array("controller.tau_m")


def _rms_bars(axes: Axes, values: Floats, joints: Sequence[int], paper: Sequence[float]) -> None:
    """Draw the RMS of each joint's column of `values`, and beside it the paper's number if there is one."""
    ours = np.sqrt(np.mean(values[:, joints] ** 2, axis=0)).tolist()
    series = [("this gravity difference", ours, _DARK)]
    if paper:
        series.append(("Table 3", [paper[i] if i < len(paper) else math.nan for i in joints], _LIGHT))
    width = 0.8 / len(series)
    for k, (label, heights, color) in enumerate(series):
        places = np.arange(len(joints)) + (k - 0.5 * (len(series) - 1)) * width
        bars = axes.bar(places, heights, width=0.92 * width, color=color, label=label)
        texts = ["" if math.isnan(h) else f"{h:.1f}" for h in heights]
        axes.bar_label(bars, texts, padding=1.5, fontsize=9.0)
    axes.set_xticks(range(len(joints)), [f"Joint {i + 1}" for i in joints])
    axes.grid(visible=False, axis="x")
    axes.margins(x=0.02, y=0.14)
    if paper:
        style.legend_beside(axes, axes.containers)


def _moving(scenario: Scenario) -> list[int]:
    """Joints whose desired position changes; all if none does."""
    trajectory = scenario.trajectory
    moving = np.flatnonzero(trajectory.q_end != trajectory.q_start).tolist()
    return moving or list(range(scenario.robot.n))


def _unit(robot: Robot, i: int) -> _Unit:
    return _UNITS[1] if robot.joint_types[i] == "prismatic" else _UNITS[0]


def _groups(robot: Robot, joints: Sequence[int]) -> list[_Group]:
    """Joints by unit, in the order of `_UNITS`; units that no joint has are left out."""
    groups = [(unit, [i for i in joints if _unit(robot, i) is unit]) for unit in _UNITS]
    return [(unit, members) for unit, members in groups if members]


def _letter(place: int) -> str:
    """Return (a), (b), ... (z), (aa), ... for the places from 0."""
    text = ""
    place += 1
    while place:
        place, digit = divmod(place - 1, 26)
        text = chr(ord("a") + digit) + text
    return f"({text})"


def _table(scenario: Scenario) -> int:
    """Return the number of the table of the paper that a scenario compares with; 0 for none."""
    source = str(scenario.paper.get("source", ""))
    return next((table for table in (3, 4, 5) if source.startswith(f"Table {table}")), 0)


def _caption(results: Results, scenario: Scenario, figure: str) -> str:
    """Which run a picture shows. What the run says of itself goes before what the scenario asked for."""
    facts: Mapping[str, Any] = results.summary
    master = facts.get("master") or facts.get("algorithm") or scenario.master
    step = 1e3 * float(facts.get("step") or scenario.step)
    lines = [
        f"{f'{figure} of the paper. ' if figure else ''}Scenario {scenario.name}, robot {scenario.robot.name}, "
        f"master {master}, step {step:g} ms, feedforward {scenario.feedforward.mode}."
    ]
    if scenario.plant_factors:
        factors = [
            f"{key} x {float(np.ravel(factor)[0]):g}" if np.ptp(factor) == 0.0 else f"{key} joint by joint"
            for key, factor in scenario.plant_factors.items()
        ]
        lines.append(f"The plant differs from the feedforward's model: {', '.join(factors)}.")
    return "\n".join(lines)


def _contrast_caption(contrast: Contrast, scenario: Scenario | None, figure: str) -> str:
    name = "contrast" if scenario is None else scenario.name
    points = len(contrast.time)
    step = f", step {1e3 * (contrast.time[-1] - contrast.time[0]) / (points - 1):g} ms" if points > 1 else ""
    return f"{figure} of the paper. Scenario {name}, robot {contrast.robot.name}, {points} points{step}, rigid links."
