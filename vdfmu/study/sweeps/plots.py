"""The figures of a parameter study, in the style of a run's figures."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import LogLocator, NullLocator

from vdfmu.base import style
from vdfmu.base.errors import UsageError
from vdfmu.base.files import inside
from vdfmu.study.sweeps.indices import CONFIDENCE, indices
from vdfmu.study.sweeps.table import Side, StudyTable, View, groups, view

COLOUR_MAP = "viridis"
_LONG = 20
"""Longest label [characters] with its unit in one line."""
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
    if not side.words and not side.log:
        side = replace(side, unit=style.fit_axis(axis, side.unit, float(np.nanmax(np.abs(side.values)))))
    words = side.label.replace(" (", "\n(")
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


_BARS = 20
"""Most axes; the most influential are shown."""
_UNSURE, _MOST = "#e4e4e4", 0.1
"""Colour of an index that may be zero; least end of the scale of pairs."""


def plot(study: StudyTable, kind: str | None = None, measure: str | None = None, out: Path | None = None) -> list[Path]:
    """Draw figures of a measure, ``MEASURE_KIND.png``, and return their files.

    The kind is one of `KINDS`, by default all that fit the study. Of a measure, by default the first, the largest
    element counts at each point; it may be one of its columns. The folder is by default the study's. UsageError if the
    kind does not fit, or nothing can be drawn.
    """
    if kind is not None and kind not in KINDS:
        raise UsageError(f"kind: expected {', '.join(KINDS)}, got {kind}.")
    if out is not None and (out.is_file() or out.suffix in (".png", ".svg", ".pdf") and not out.is_dir()):
        raise UsageError(f"out: expected a folder for MEASURE_KIND.png, got the name of a file, {out}.")
    shown = view(study, measure)
    folder = study.folder if out is None else out
    name = (measure or next(iter(study.facts["measures"]))).replace("[", "_").replace("]", "")
    written: list[Path] = []
    for each, (draw, fits) in KINDS.items():
        reason = fits(shown)
        if kind == each and reason:
            raise UsageError(f"kind: {kind} needs {reason}.")
        if kind in (None, each) and not reason:
            written.append(style.save(draw(shown), inside(folder, folder / f"{name}_{each}.png")))
    return written


@style.styled
def _curve(shown: View) -> Figure:
    side, value, failed = shown.sides[0], shown.value, shown.failed
    missing = Line2D([], [], label="no value: the run failed", color=FAILED, marker="x", linestyle="none")
    legend = [missing] if failed.any() else []
    figure = new_figure(shown, f"{value.label} over {side.name}", "", 4.0, legend=legend)
    axes: Axes = figure.subplots()
    order = np.argsort(side.values)
    axes.plot(side.values[order], value.values[order], ".-", color=LOW)
    below = side.values[failed]
    axes.plot(below, np.full(len(below), 0.03), "x", color=FAILED, ms=4, transform=axes.get_xaxis_transform())
    axes.margins(0.03)
    dress(axes, side, "x")
    dress(axes, value, "y")
    return figure


@style.styled
def _tornado(shown: View) -> Figure:
    """Draw the change of the measure from the lowest to the highest values of each axis."""
    sides = shown.sides[:_BARS]
    mean = float(np.nanmean(shown.value.values))
    handles = [
        Line2D([], [], linestyle="none", marker="s", markersize=9.0, color=color, label=label)
        for color, label in ((LOW, "lowest values of the axis"), (HIGH, "highest"))
    ]
    words = (
        "Bars: mean of the measure at the lowest and at the highest value of an axis, or in the lowest and highest "
        "fifth of its points if it has more than five values; of words the least and the largest mean. Thin line: "
        "range of the means of all fifths. Vertical line: mean of all points. Words at the bars: values of the axis."
    )
    title = f"{shown.value.label} from low to high of each axis"
    figure = new_figure(shown, title, words, 1.9 + 0.55 * len(sides), legend=handles)
    axes: Axes = figure.subplots()
    for k, side in enumerate(reversed(sides)):
        parts = groups(side, shown.value)
        ends = sorted((parts[0], parts[-1]) if not side.words else (min(parts, key=_mean), max(parts, key=_mean)))
        axes.plot([min(map(_mean, parts)), max(map(_mean, parts))], [k, k], color="#333333", linewidth=1.0)
        for (at, height), color, y in zip(ends, (LOW, HIGH), (k + 0.17, k - 0.17), strict=True):
            axes.barh(y, height - mean, left=mean, height=0.3, color=color)
            left = height < mean
            axes.annotate(
                f"at {side.text(at)}", (height, y), (-4 if left else 4, 0), textcoords="offset points", va="center",
                ha="right" if left else "left", fontsize=8.0,
            )  # fmt: skip
    axes.axvline(mean, color="#333333", linewidth=0.8)
    axes.set_yticks(range(len(sides)), [side.label for side in reversed(sides)])
    dress(axes, shown.value, "x")
    axes.margins(x=0.12)
    axes.grid(visible=False, axis="y")
    return figure


def _mean(part: tuple[float, float]) -> float:
    return part[1]


@style.styled
def _indices(shown: View) -> Figure:
    """Draw Sobol or Morris indices with their confidence intervals."""
    sensitivity = indices(shown.study, shown.measure)
    d, words = len(sensitivity.axes), f"Bars of error: {100.0 * CONFIDENCE:.0f} % by bootstrap."
    if sensitivity.kind == "sobol":
        words += " Grey pairs: their interval has zero in it."
    if sensitivity.kind == "morris":
        figure = new_figure(shown, f"{shown.value.label}: Morris", words, 4.6)
        axes: Axes = figure.subplots()
        star, sigma = sensitivity.values["mu_star"], sensitivity.values["sigma"]
        axes.errorbar(star, sigma, xerr=sensitivity.widths["mu_star"], fmt="o", color=LOW, capsize=3.0)
        for k, name in enumerate(sensitivity.axes):
            axes.annotate(name, (star[k], sigma[k]), (5, 5), textcoords="offset points", fontsize=8.5)
        axes.margins(0.2)
        axes.set_xlim(left=0.0)
        axes.set_ylim(bottom=0.0)
        axes.xaxis.set_major_formatter("{x:.3g}")
        axes.yaxis.set_major_formatter("{x:.3g}")
        unit = f" [{shown.value.unit}]" if shown.value.unit else ""
        axes.set_xlabel(rf"$\mu^*$: mean change over the whole range of an axis{unit}")
        axes.set_ylabel(rf"$\sigma$: curvature and interactions{unit}")
        return figure
    pairs = ((0.2, "first", LOW), (-0.2, "total", HIGH))
    handles = [Line2D([], [], linestyle="none", marker="s", ms=9.0, color=c, label=name) for _, name, c in pairs]
    title = f"{shown.value.label}: Sobol indices, shares of the variance"
    figure = new_figure(shown, title, words, 2.8 + 0.55 * d, legend=handles)
    left, right = figure.subplots(1, 2, width_ratios=(3, 2))
    for shift, name, color in pairs:
        look: dict[str, Any] = {"xerr": sensitivity.widths[name], "color": color, "capsize": 2.5}
        left.barh(np.arange(d)[::-1] + shift, sensitivity.values[name], 0.36, **look)
    left.set_yticks(np.arange(d)[::-1], sensitivity.axes)
    left.margins(x=0.05)
    left.set_title("One axis: first order and total")
    left.grid(visible=False, axis="y")
    second, widths = sensitivity.values["second"], sensitivity.widths["second"]
    sure = second > widths  # of the others the interval has zero in it
    right.imshow(np.where(np.isnan(second), np.nan, 0.0), cmap=ListedColormap([_UNSURE]))
    image = right.imshow(np.where(sure, second, np.nan), cmap=COLOUR_MAP, vmin=0.0, vmax=max([_MOST, *second[sure]]))
    for i, j in zip(*np.triu_indices(d, 1), strict=True):
        dark = sure[i, j] and second[i, j] < 0.6 * image.norm.vmax
        right.text(j, i, f"{second[i, j]:.2f}\n± {widths[i, j]:.2f}", ha="center", va="center", fontsize=8.0,
                   color="white" if dark else "black")  # fmt: skip
    names = [name.rpartition(".")[2] for name in sensitivity.axes]
    right.set_xticks(range(d), names, rotation=30, ha="right")
    right.set_yticks(range(d), names)
    right.set_title("Pairs: second order")
    right.grid(visible=False)
    return figure


def _no_indices(shown: View) -> str:
    if shown.study.facts["sample"] not in ("saltelli", "morris"):
        return f"a study with --sample saltelli or morris, got {shown.study.facts['sample']}"
    return "all points, got some without a value" if shown.failed.any() else ""


KINDS: dict[str, tuple[Callable[[View], Figure], Callable[[View], str]]] = {
    "curve": (_curve, lambda shown: "one axis of numbers" if len(shown.sides) != 1 or shown.sides[0].words else ""),
    "tornado": (_tornado, lambda shown: "" if len(shown.sides) > 1 else "two axes that vary"),
    "indices": (_indices, _no_indices),
}
"""Kind of figure to the function that draws it, and the reason why it does not fit; empty if it fits."""
