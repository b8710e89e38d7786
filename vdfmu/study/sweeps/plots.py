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
from matplotlib.figure import Figure
from numpy.typing import NDArray

from vdfmu.base import style
from vdfmu.base.errors import UsageError
from vdfmu.study.sweeps.lines import draw_indices, draw_tornado
from vdfmu.study.sweeps.looks import FAILED, LOW, at_bottom, colours_of, dress, legend_of, new_figure
from vdfmu.study.sweeps.sides import View, view
from vdfmu.study.sweeps.table import StudyTable

_SCATTERED, _PARALLEL = 5, 9
"""Most axes in a matrix and side by side; the most influential are shown."""
_LINES = 1000
"""Most points that are drawn as lines, and that a fit goes through."""
_GRID = 61


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
            written.append(style.save(draw(shown), folder / f"{name}_{each}.png"))
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
    "tornado": (draw_tornado, lambda shown: "" if len(shown.sides) > 1 else "two axes that vary"),
    "indices": (draw_indices, _no_indices),
}
"""Kind of figure to the function that draws it, and the reason why it does not fit; empty if it fits."""
