"""Picture of a tuning."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Picture
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from vdfmu.base import style
from vdfmu.base.arrays import Floats

_BEFORE, _AFTER = "#888888", style.COLORS[0]
_BY_JOINT = {
    "error": ("RMS error", "", "rad or m"),
    "peak_torque": ("Peak torque", "", "N.m"),
    "modulus": ("Modulus margin", r"min $|1 + L|$", ""),
}
"""Rows of a tuning's table that are drawn by joint: title, quantity, unit of measurement."""


@style.styled
def draw_tuning(history: Sequence[float], table: Sequence[tuple[str, float, float]]) -> Picture:
    """Draw the cost over the evaluations, and the values of each joint in rows of name, before and after.

    `history` has the objective of each evaluation, 1 at the start; beyond 10 if a constraint is missed.
    """
    groups = {key: [pair for name, *pair in table if name.partition("[")[0] == key] for key in _BY_JOINT}
    shown = {key: pairs for key, pairs in groups.items() if pairs}
    handles = [
        Line2D([], [], color=color, linewidth=6.0, label=label)
        for color, label in ((_BEFORE, "before"), (_AFTER, "after"))
    ]
    figure = style.new_figure(
        "Tuning",
        "Cost: relative to the start; dots: values within all limits, line: the best so far. Errors and torques: of "
        "the worst robot. Margin: with one sample of delay.",
        height=5.6 if shown else 2.8,
        legend=handles if shown else (),
    )
    grid = figure.add_gridspec(2 if shown else 1, max(len(shown), 1))
    _draw_history(figure.add_subplot(grid[0, :]), np.array(history))
    for column, (key, pairs) in enumerate(shown.items()):
        _draw_joints(figure.add_subplot(grid[1, column]), np.array(pairs), *_BY_JOINT[key])
    return figure


def _draw_history(axes: Axes, cost: Floats) -> None:
    number, allowed = np.arange(1, len(cost) + 1), cost < 10.0
    best = np.minimum.accumulate(np.where(allowed, cost, np.inf))
    feasible = np.isfinite(best)
    axes.plot(number[allowed], cost[allowed], ".", color=style.COLORS[5], markersize=4.0)
    axes.step(number[feasible], best[feasible], where="post", color=_AFTER)
    axes.axhline(1.0, color=_BEFORE, linewidth=1.0, linestyle="--")
    style.dress(axes, "Cost", "relative to the start", "")
    top = max(1.2, float(np.quantile(cost[allowed], 0.9))) if allowed.any() else 1.2
    axes.set_ylim(0.0, 1.1 * min(top, 3.0))
    axes.set_xlim(0.0, len(cost) + 1.0)
    axes.set_xlabel("Evaluation")


def _draw_joints(axes: Axes, pairs: Floats, title: str, quantity: str, unit: str) -> None:
    joints = np.arange(1, len(pairs) + 1)
    for shift, column, color in ((-0.2, 0, _BEFORE), (0.2, 1, _AFTER)):
        axes.bar(joints + shift, pairs[:, column], 0.38, color=color)
    style.dress(axes, title, quantity, unit)
    axes.set_xlim(0.4, len(pairs) + 0.6)
    axes.set_ylim(0.0, 1.08 * max(float(np.nanmax(pairs)), 1e-300))
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.grid(visible=False, axis="x")
    axes.set_xlabel("Joint")
