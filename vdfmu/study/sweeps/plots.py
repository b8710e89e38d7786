"""The figures of a parameter study, in the style of a run's figures."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from vdfmu.base import style
from vdfmu.base.errors import UsageError
from vdfmu.base.files import inside
from vdfmu.study.sweeps.indices import CONFIDENCE, indices
from vdfmu.study.sweeps.looks import (
    COLOUR_MAP,
    FAILED,
    HIGH,
    LOW,
    at_bottom,
    colours_of,
    dress,
    fitted_label,
    legend_of,
    new_figure,
)
from vdfmu.study.sweeps.table import StudyTable, View, groups, view

_SCATTERED, _PARALLEL = 5, 9
"""Most axes in a matrix and side by side; the most influential are shown."""
_LINES = 1000
"""Most points that are drawn as lines, and that a fit goes through."""
_GRID = 61
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
def _scatter(shown: View) -> Figure:
    """Draw axes against each other, and the measure against each."""
    sides = shown.sides[:_SCATTERED]
    d, failed = len(sides), shown.failed
    left = "" if d == len(shown.sides) else f"The {d} axes of most influence of {len(shown.sides)}. "
    height, width = 1.5 + (2.4 if d < 3 else 1.7) * d, max(style.WIDTH, 1.9 * d + 1.2)
    title = f"{shown.value.label} over each axis"
    figure = new_figure(shown, title, left, height, width, legend=legend_of(shown))
    grid: NDArray[Any] = figure.subplots(d, d, squeeze=False, sharex="col")
    colours = colours_of(shown)
    rows = [*sides[1:], shown.value]
    for i, row in enumerate(rows):
        for j, column in enumerate(sides):
            axes: Axes = grid[i, j]
            if j > i:
                axes.remove()
                continue
            x, y = column.values, row.values
            size = float(np.clip(3e3 / len(x), 2.0, 18.0))
            axes.scatter(x[~failed], y[~failed], size, colours.to_rgba(shown.value.values[~failed]))
            axes.margins(x=0.25 if column.words else 0.06, y=0.25 if row.words else 0.06)
            if row is shown.value:  # failed points have no height: they are at the bottom
                at_bottom(axes, x[failed])
            else:
                axes.plot(x[failed], y[failed], "x", color=FAILED, ms=4)
            dress(axes, column, "x", i == d - 1)
            dress(axes, row, "y", j == 0)
            if j:
                axes.tick_params(labelleft=False)
    figure.colorbar(colours, ax=list(figure.axes), shrink=0.8, label=shown.value.label)
    return figure


@style.styled
def _surface(shown: View) -> Figure:
    """Draw the measure over its axis, or as contours over the two most influential axes."""
    from scipy.spatial import Delaunay

    good = ~shown.failed
    points = np.column_stack([side.scaled for side in shown.sides])[good]
    if len(shown.sides) == 1:
        return _curve(shown)
    first, second, *others = shown.sides
    y = shown.value.on_scale(shown.value.values)
    ticks = np.linspace(0.0, 1.0, _GRID)
    if not others and shown.study.facts["sample"] == "grid":
        words = "Contours through the points of the grid."
        a, b = (np.unique(side.values, return_inverse=True) for side in (first, second))
        heights = np.full((len(b[0]), len(a[0])), np.nan)
        heights[b[1], a[1]] = y
        x_1, x_2 = a[0], b[0]
    else:
        fit, explained = _fit(points, y[good])
        x_1, x_2 = first.at(ticks), second.at(ticks)
        places = np.stack(np.meshgrid(ticks, ticks), axis=-1).reshape(-1, 2)
        middle = np.broadcast_to(np.median(points[:, 2:], axis=0), (len(places), len(others)))
        heights = fit(np.hstack([places, middle])).reshape(_GRID, _GRID)
        outside = Delaunay(points[:, :2]).find_simplex(places) < 0
        heights[outside.reshape(heights.shape)] = np.nan
        words = (
            "Thin-plate spline through the points"
            f"{', the other axes at their median' if others else ''}. From four fifths of the points it explains "
            f"{100.0 * max(explained, 0.0):.0f} % of the variance of the last."
        )
    if shown.value.log:
        heights = np.exp(heights)
    title = f"{shown.value.label} over {first.name} and {second.name}"
    figure = new_figure(shown, title, words, 5.6, legend=legend_of(shown))
    axes: Axes = figure.subplots()
    colours = colours_of(shown)
    low, high = (float(f(shown.value.values)) for f in (np.nanmin, np.nanmax))
    levels = np.geomspace(low, high, 15) if shown.value.log else np.linspace(low, high, 15)
    axes.contourf(
        x_1, x_2, np.clip(np.ma.masked_invalid(heights), low, high), levels, cmap=colours.cmap, norm=colours.norm
    )
    colors = colours.to_rgba(shown.value.values[good])
    axes.scatter(first.values[good], second.values[good], 14.0, colors, edgecolors="white", linewidths=0.5)
    axes.plot(first.values[~good], second.values[~good], "x", color=FAILED)
    axes.use_sticky_edges = False
    axes.margins(0.03)
    axes.grid(visible=False)
    dress(axes, first, "x")
    dress(axes, second, "y")
    figure.colorbar(colours, ax=axes, label=shown.value.label)
    return figure


def _curve(shown: View) -> Figure:
    side, value, failed = shown.sides[0], shown.value, shown.failed
    figure = new_figure(shown, f"{value.label} over {side.name}", "", 4.0, legend=legend_of(shown))
    axes: Axes = figure.subplots()
    order = np.argsort(side.values)
    axes.plot(side.values[order], value.values[order], ".-", color=LOW)
    at_bottom(axes, side.values[failed])
    axes.margins(0.03)
    dress(axes, side, "x")
    dress(axes, value, "y")
    return figure


def _fit(points: NDArray[Any], y: NDArray[Any]) -> tuple[Callable[[NDArray[Any]], NDArray[Any]], float]:
    """Return a smooth function through points, (n, d), and the share of variance that it explains at unseen points.

    Points that coincide count as one, with their mean; of very many, only some are used.
    """
    from scipy.interpolate import RBFInterpolator

    places, which = np.unique(points.round(9), axis=0, return_inverse=True)
    means = np.bincount(which.ravel(), y) / np.bincount(which.ravel())
    order = np.random.default_rng(0).permutation(len(places))[:_LINES]
    places, means = places[order], means[order]
    part = np.arange(len(places)) % 5
    missed = np.empty_like(means)
    for k in range(5):
        missed[part == k] = RBFInterpolator(places[part != k], means[part != k])(places[part == k]) - means[part == k]
    return RBFInterpolator(places, means), 1.0 - float(np.sum(missed**2) / np.sum((means - means.mean()) ** 2))


@style.styled
def _parallel(shown: View) -> Figure:
    """Draw a line for each point, through its values on all axes, in the colour of the measure."""
    sides = [*shown.sides[:_PARALLEL], shown.value]
    left = "" if len(sides) > len(shown.sides) else f"The {_PARALLEL} axes of most influence of {len(shown.sides)}. "
    title, width = f"{shown.value.label}: points as lines", max(style.WIDTH, 1.3 * len(sides))
    figure = new_figure(shown, title, left, 4.8, width, legend=legend_of(shown))
    axes: Axes = figure.subplots()
    heights = np.column_stack([side.scaled for side in sides])
    worst_last = np.argsort(np.nan_to_num(shown.value.values, nan=-np.inf))
    chosen = worst_last[:: math.ceil(len(worst_last) / _LINES)]
    colours = colours_of(shown)
    for failed in (True, False):
        rows = chosen[shown.failed[chosen] == failed]
        lines = [
            np.column_stack([np.arange(len(sides))[: len(sides) - failed], heights[k, : len(sides) - failed]])
            for k in rows
        ]
        look: dict[str, Any] = {"colors": colours.to_rgba(shown.value.values[rows])}
        if failed:
            look = {"colors": FAILED, "linestyles": ":", "alpha": 0.5}
        axes.add_collection(LineCollection(lines, linewidths=0.9, **look))
        if failed:
            axes.plot(np.full(len(rows), len(sides) - 2.0), heights[rows, -2], "x", color=FAILED)
    for i, side in enumerate(sides):
        axes.axvline(i, color="#333333", linewidth=0.8)
        for place in np.unique(side.scaled) if side.words else np.linspace(0.0, 1.0, 5):
            words = side.text(place * (len(side.words) - 1) if side.words else float(side.at(place)))
            axes.text(
                i + 0.03,
                place,
                words,
                fontsize=7.5,
                va="center",
                bbox={"fc": "white", "ec": "none", "alpha": 0.7, "pad": 0.6},
            )
    axes.set_xlim(-0.1, len(sides) - 0.7)
    axes.set_ylim(-0.04, 1.04)
    names = [re.sub(r", | (?=[(\[])", "\n", side.label.replace(".", "\n", 1)) for side in sides]
    axes.set_xticks(range(len(sides)), names)
    axes.set_yticks([])
    axes.grid(visible=False)
    axes.spines[["left", "bottom"]].set_visible(False)
    figure.colorbar(colours, ax=axes, label=shown.value.label)
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
        "fifth of its points, where it has more than five values; of words the least and the largest mean. Thin line: "
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
    axes.set_xlabel(fitted_label(axes.xaxis, shown.value))
    axes.margins(x=0.12)
    axes.grid(visible=False, axis="y")
    return figure


def _mean(part: tuple[float, float]) -> float:
    return part[1]


@style.styled
def _indices(shown: View) -> Figure:
    """Draw Sobol or Morris indices with their confidence intervals."""
    found = indices(shown.study, shown.measure)
    d, words = len(found.axes), f"Bars of error: {100.0 * CONFIDENCE:.0f} % by bootstrap."
    if found.kind == "sobol":
        words += " Grey pairs: their interval has zero in it."
    if found.kind == "morris":
        figure = new_figure(shown, f"{shown.value.label}: Morris", words, 4.6)
        axes: Axes = figure.subplots()
        star, sigma = found.values["mu_star"], found.values["sigma"]
        axes.errorbar(star, sigma, xerr=found.widths["mu_star"], fmt="o", color=LOW, capsize=3.0)
        for k, name in enumerate(found.axes):
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
        look: dict[str, Any] = {"xerr": found.widths[name], "color": color, "capsize": 2.5}
        left.barh(np.arange(d)[::-1] + shift, found.values[name], 0.36, **look)
    left.set_yticks(np.arange(d)[::-1], found.axes)
    left.margins(x=0.05)
    left.set_title("One axis: first order and total")
    left.grid(visible=False, axis="y")
    second, widths = found.values["second"], found.widths["second"]
    sure = second > widths  # of the others the interval has zero in it
    right.imshow(np.where(np.isnan(second), np.nan, 0.0), cmap=ListedColormap([_UNSURE]))
    image = right.imshow(np.where(sure, second, np.nan), cmap=COLOUR_MAP, vmin=0.0, vmax=max([_MOST, *second[sure]]))
    for i, j in zip(*np.triu_indices(d, 1), strict=True):
        dark = sure[i, j] and second[i, j] < 0.6 * image.norm.vmax
        right.text(j, i, f"{second[i, j]:.2f}\n± {widths[i, j]:.2f}", ha="center", va="center", fontsize=8.0,
                   color="white" if dark else "black")  # fmt: skip
    names = [name.rpartition(".")[2] for name in found.axes]
    right.set_xticks(range(d), names, rotation=30, ha="right")
    right.set_yticks(range(d), names)
    right.set_title("Pairs: second order")
    right.grid(visible=False)
    return figure


def _no_surface(shown: View) -> str:
    if any(side.words for side in shown.sides):
        return "axes of numbers"
    d, n = len(shown.sides), int((~shown.failed).sum())
    enough = n >= 5 * (d + 1) or d == 1 or (d == 2 and shown.study.facts["sample"] == "grid")
    return "" if enough else f"{5 * (d + 1)} points with a value, got {n}"


def _no_indices(shown: View) -> str:
    if shown.study.facts["sample"] not in ("saltelli", "morris"):
        return f"a study with --sample saltelli or morris, got {shown.study.facts['sample']}"
    return "all points, of which some have no value" if shown.failed.any() else ""


KINDS: dict[str, tuple[Callable[[View], Figure], Callable[[View], str]]] = {
    "scatter": (_scatter, lambda shown: ""),
    "surface": (_surface, _no_surface),
    "parallel": (_parallel, lambda shown: "" if len(shown.sides) > 1 else "two axes that vary"),
    "tornado": (_tornado, lambda shown: "" if len(shown.sides) > 1 else "two axes that vary"),
    "indices": (_indices, _no_indices),
}
"""Kind of figure to the function that draws it, and the reason why it does not fit; empty if it fits."""
