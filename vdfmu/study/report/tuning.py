"""The picture of a tuning: the cost over the evaluations, and each joint before and after."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from vdfmu.base import style

_BEFORE, _AFTER = "#888888", style.COLORS[0]
_PANELS = {
    "error": ("RMS error", "", "rad or m"),
    "peak_torque": ("Peak torque", "", "N.m"),
    "modulus": ("Modulus margin", r"min $|1 + L|$", ""),
}
"""Rows of the table that are drawn by joint: title, quantity, unit of measurement."""


@style.styled
def draw_tuning(history: Sequence[float], table: Sequence[tuple[str, float, float]]) -> Figure:
    """Draw the cost over the evaluations, and the table's values of each joint.

    Parameters
    ----------
    history : sequence of float
        Objective of each evaluation, 1 at the start; beyond 10 where a constraint is missed.
    table : sequence of (name, before, after)
    """
    groups = {
        key: [(before, after) for name, before, after in table if name.partition("[")[0] == key] for key in _PANELS
    }
    shown = {key: pairs for key, pairs in groups.items() if pairs}
    handles = [
        Line2D([], [], color=color, linewidth=6.0, label=label)
        for color, label in ((_BEFORE, "before"), (_AFTER, "after"))
    ]
    figure = style.new_figure(
        "Tuning",
        "Cost: relative to that of the start; dots: values that keep to all limits, line: the best so far. Errors and "
        "torques: those of the worst robot. Margin: with one sample of delay.",
        height=2.8 if not shown else 5.6,
        legend=handles if shown else (),
    )
    rows = 2 if shown else 1
    grid = figure.add_gridspec(rows, max(len(shown), 1))
    _draw_history(figure.add_subplot(grid[0, :]), np.array(history))
    for column, (key, pairs) in enumerate(shown.items()):
        _draw_joints(figure.add_subplot(grid[1, column]), np.array(pairs), *_PANELS[key])
    return figure


def _draw_history(axes: Axes, cost: np.ndarray) -> None:
    number = np.arange(1, len(cost) + 1)
    allowed = cost < 10.0
    best = np.minimum.accumulate(np.where(allowed, cost, np.inf))
    known = np.isfinite(best)
    axes.plot(number[allowed], cost[allowed], ".", color=style.COLORS[5], markersize=4.0)
    axes.step(number[known], best[known], where="post", color=_AFTER)
    axes.axhline(1.0, color=_BEFORE, linewidth=1.0, linestyle="--")
    style.dress(axes, "Cost", "relative to the start", "")
    top = max(1.2, float(np.quantile(cost[allowed], 0.9))) if allowed.any() else 1.2
    axes.set_ylim(0.0, 1.1 * min(top, 3.0))
    axes.set_xlim(0.0, len(cost) + 1.0)
    axes.set_xlabel("Evaluation")


def _draw_joints(axes: Axes, pairs: np.ndarray, title: str, quantity: str, unit: str) -> None:
    joints = np.arange(1, len(pairs) + 1)
    for shift, column, color in ((-0.2, 0, _BEFORE), (0.2, 1, _AFTER)):
        axes.bar(joints + shift, pairs[:, column], 0.38, color=color)
    style.dress(axes, title, quantity, unit)
    axes.set_xlim(0.4, len(pairs) + 0.6)
    axes.set_ylim(0.0, 1.08 * max(float(np.nanmax(pairs)), 1e-300))
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.grid(visible=False, axis="x")
    axes.set_xlabel("Joint")
