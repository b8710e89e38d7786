"""Parts common to the figures of a parameter study: captions, colours, scales, and how failed points look."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import LogLocator, NullLocator
from numpy.typing import NDArray

from vdfmu.base import style
from vdfmu.study.sweeps.table import Side, View

COLOUR_MAP = "viridis"
_LONG = 20
"""Characters of a label beyond which its unit has a line of its own."""
LOW, HIGH, FAILED = style.COLORS[0], style.COLORS[4], style.COLORS[1]


def new_figure(shown: View, title: str, words: str, height: float, width: float = style.WIDTH, **more: Any) -> Figure:
    """Return a figure whose caption names the study and the measure."""
    facts, failed = shown.study.facts, int(shown.failed.sum())
    name = shown.value.name.partition(",")[0].partition("[")[0]
    caption = (
        f"{words} {facts['scenario']}, {len(shown.failed)} points ({Path(facts['sample']).name})"
        f"{f', of which {failed} without a value' if failed else ''}. {name} = {shown.text}"
    )
    return style.new_figure(title, caption.strip(), height=height, width=width, **more)


def dress(axes: Axes, side: Side, which: str, label: bool = True) -> None:
    """Give an axis, ``x`` or ``y``, the scale, the words and the name of a side."""
    axis: Any = getattr(axes, f"{which}axis")
    words = (side.label if side.words or side.log else fitted_label(axis, side)).replace(" (", "\n(")
    if len(words) > _LONG:
        words = words.replace(" [", "\n[")
    getattr(axes, f"set_{which}label")(words if label else "")
    if side.words:
        slanted: dict[str, Any] = {"rotation": 30.0, "ha": "right"} if which == "x" else {}
        getattr(axes, f"set_{which}ticks")(range(len(side.words)), side.words, **slanted)
    elif side.log:
        getattr(axes, f"set_{which}scale")("log")
        low, high = float(np.nanmin(side.values)), float(np.nanmax(side.values))
        if high < 100.0 * low:  # decades alone would leave one label, or none
            axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
            axis.set_minor_locator(NullLocator())
            axis.set_major_formatter("{x:g}")


def fitted_label(axis: Axis, side: Side) -> str:
    """Let a linear axis show the values of a side in a unit that fits; return its name with this unit."""
    unit = style.fit_axis(axis, side.unit, float(np.nanmax(np.abs(side.values))))
    return replace(side, unit=unit).label


def legend_of(shown: View) -> list[Line2D]:
    """Return the legend of failed points, if there are any."""
    look: dict[str, Any] = {"color": FAILED, "marker": "x", "linestyle": "none"}
    return [Line2D([], [], label="no value: the run failed", **look)] if shown.failed.any() else []


def at_bottom(axes: Axes, x: NDArray[Any]) -> None:
    """Mark failed points, which have no height."""
    axes.plot(x, np.full(len(x), 0.03), "x", color=FAILED, ms=4, transform=axes.get_xaxis_transform())
