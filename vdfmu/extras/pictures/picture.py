"""Writes figures for papers with matplotlib: panels over time without title or caption, with 8 pt text."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from textwrap import wrap
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Picture
from matplotlib.lines import Line2D

from vdfmu.base.errors import UsageError
from vdfmu.engine.results.figure import Figure, signal_figures
from vdfmu.engine.results.formats import figure_file
from vdfmu.engine.results.recorded import Recorded
from vdfmu.extras.pictures import style

PANELS = 12
"""Most panels of a picture."""
_CURVES, _CURVES_ALONE = 8, 28
"""Most curves in a panel beside others, and in a single panel, so that they differ in colour or dashes."""
_WORDS = 38
"""Largest number of characters of a title, a label and a unit."""
_SYMBOL = re.compile(r"(?<![\w.])(ℓ?[qτκ])(?:_([a-z]))?(?![\w.\[])")
"""A symbol of the paper in a label, but not in a signal's name such as ``plant.q``."""
_LETTERS = {"ℓ": r"\ell ", "τ": r"\tau", "κ": r"\kappa"}
_LEAST, _LARGEST = 1e-290, 1e290
"""Values that matplotlib can draw."""
_DASHED: dict[str, Any] = {"linestyle": (0, (5, 3)), "linewidth": 0.7}
_ON_TOP = _DASHED | {"color": "black"}
"""Styles of dashed curves; the second is for a curve that may coincide with another of its joint."""


def plot(results: Recorded, names: Sequence[str], over: Mapping[str, Recorded], path: str | Path | None) -> Picture:
    """Draw chosen signals, and write the picture if there is a path; see `Results.plot`."""
    runs: list[Any] = list(over.values()) if hasattr(over, "values") else [None]
    if not all(isinstance(run, Recorded) for run in runs):
        raise UsageError(f"plot: expected results by label, over={{'soft': other}}, got {over!r:.60}.")
    wanted = [signal for name in names or results.names for signal in results.members(name)]
    place = {signal: k for k, signal in reversed([*enumerate(wanted)])}
    figures = signal_figures(results, {*results.names} - {*wanted})
    ordered = sorted(figures, key=lambda figure: min(place[curve.terms[0][1]] for curve in figure.curves))
    picture = draw(chosen(ordered), {str(results.summary.get("scenario") or "this run"): results, **over})
    if path is not None:
        style.save(picture, Path(path))
    return picture


def write_figures(
    figures: Iterable[Figure], results: Recorded, folder: Path, suffixes: Sequence[str], width: float, serif: bool
) -> None:
    """Write a file for each figure and file format; `width` in inches."""
    for figure in figures:
        picture = draw([figure], {"": results}, width, serif=serif)
        for suffix in suffixes:
            style.save(picture, folder / figure_file(figure.key, suffix))


def write_signals(
    results: Recorded, folder: Path, suffixes: Sequence[str], width: float, serif: bool = False
) -> list[str]:
    """Write ``signals.png`` and so on, unless nothing is recorded; return the titles of the figures left out."""
    figures = list(signal_figures(results))
    shown = chosen(figures)
    if shown:
        picture = draw(shown, {"": results}, width, serif=serif)
        for suffix in suffixes:
            style.save(picture, folder / f"signals.{suffix}")
    return [figure.title for figure in figures if figure not in shown]


@style.paper
def draw(
    figures: Sequence[Figure],
    runs: Mapping[str, Recorded],
    width: float = style.WIDTH,
    columns: int | None = None,
    *,
    serif: bool = False,
) -> Picture:
    """Draw a panel for each figure. Of several `runs`, by name, the later ones are dashed. `serif`: see `style.paper`.

    Panels have their legends inside, above the curves. Titles tell several panels apart.
    """
    alone = len(figures) == 1
    columns = columns or (1 if alone else min(int(width / 2.8) or 1, 3))
    rows = -(-len(figures) // columns)
    height = min(0.62 * width, 3.2) if alone else min(0.6 * width / columns, 2.4)
    picture = style.blank(width, height * max(rows, 1))
    panels = [picture.add_subplot(rows, columns, k + 1) for k in range(len(figures))]
    room = width / columns, height - (0.4 if alone else 0.6)
    for axes, figure in zip(panels, figures, strict=True):
        lines = _curves(axes, figure, runs, alone)
        _legend(axes, [*_handles(figure, lines), *(_runs(runs) if axes is panels[0] else [])], room)
    style.label_time(panels, columns)
    return picture


def _curves(axes: Axes, figure: Figure, runs: Mapping[str, Recorded], alone: bool) -> list[Line2D]:
    """Draw the curves of a figure; return the lines of the first run."""
    (unit, factor), lines = figure.quantity, list[Line2D]()
    for place, curve in enumerate(figure.curves[: _CURVES_ALONE if alone else _CURVES], 1):
        for k, results in enumerate(runs.values()):
            kinds = {results.kinds.get(name) for _, name in curve.terms if name}
            if None in kinds:
                continue
            look = style.joint_look((curve.joint or place) - 1)
            look |= ((_ON_TOP if ", " in curve.label else _DASHED) if curve.dashed else {}) | (
                _run_look(k) if len(runs) > 1 else {}
            )
            look |= {"drawstyle": "steps-post"} if kinds - {"real"} else {}
            values = curve.values(results, factor)
            values[~(np.abs(values) <= _LARGEST)] = np.nan
            values[np.abs(values) < _LEAST] = 0.0
            label = curve.label.removeprefix(figure.title.rpartition(".")[2]) or curve.label  # [1] of q[1]
            line = style.curve(axes, results.time, values, label=_plain(label), **look)
            lines += [line] if k == 0 else []
    words = "\n".join(wrap(_plain(re.split("[:,]", figure.title)[0]), 24)) if alone else ""
    time = next(iter(runs.values())).time
    style.dress(axes, "" if alone else _plain(figure.title), words, _plain(unit), time)
    return lines


def _handles(figure: Figure, lines: Sequence[Line2D]) -> list[Line2D]:
    """Return the legend entries of several curves.

    If some are dashed and all have labels ``JOINT, SIGNAL``, it shows the colours of joints and the dashes of signals.
    """
    parts = [curve.label.partition(", ") for curve in figure.curves]
    if len(lines) < 2 or not any(curve.dashed for curve in figure.curves) or not all(part[2] for part in parts):
        return list(lines) if len(lines) > 1 else []
    looks: dict[str, dict[str, Any]] = {}
    for (joint, *_), line in zip(parts, lines, strict=False):
        looks.setdefault(joint, {"color": line.get_color(), "linestyle": line.get_linestyle()})
    for (*_, signal), curve in zip(parts, figure.curves, strict=True):
        looks.setdefault(signal, _ON_TOP if curve.dashed else {"color": "black"})
    return [Line2D([], [], label=_plain(name), **look) for name, look in looks.items()]


def _runs(names: Iterable[str]) -> list[Line2D]:
    """Return the legend entries of several runs."""
    handles = [Line2D([], [], label=_plain(name), color="black", **_run_look(k)) for k, name in enumerate(names)]
    return handles if len(handles) > 1 else []


def _legend(axes: Axes, handles: Sequence[Line2D], room: tuple[float, float]) -> None:
    """Put a legend into a panel of this width and height [in], and make room for it above the curves."""
    if not handles:
        return
    shown = (re.sub(r"\\(\w)\w*|[${}_ ]", r"\1", str(handle.get_label())) for handle in handles)
    entry = 0.36 + 0.065 * max(map(len, shown))  # in, of text of 8 pt
    columns = min(max(int((room[0] - 0.75) / entry), 1), len(handles))
    rows = -(-len(handles) // columns)
    share = min((0.1 + 0.15 * rows) / room[1], 0.7)
    axes.legend(handles=list(handles), loc="upper center", ncols=-(-len(handles) // rows))
    low, high = axes.get_ylim()
    axes.set_ylim(low, low + (high - low) / (1.0 - share))


def _run_look(k: int) -> dict[str, Any]:
    """Return the dashes and width of run `k`, from 0: runs drawn over another are dashed and thinner."""
    return {"linestyle": style.DASHES[k % len(style.DASHES)], "linewidth": 1.0 if k == 0 else 0.8}


def _plain(text: str, length: int = _WORDS) -> str:
    """Return a text, shortened in its middle, so that matplotlib does not read it as a formula."""
    if len(text) > length:
        text = f"{text[: length // 2 - 1]}…{text[-(length - length // 2) :]}"
    return _SYMBOL.sub(_formula, text.replace("$", r"\$"))


def _formula(match: re.Match[str]) -> str:
    """Return a symbol of the paper as mathematics: ``ℓτ_m`` as ℓτ with the index m."""
    letters = "".join(_LETTERS.get(letter, letter) for letter in match[1])
    return f"${letters}_{{{match[2]}}}$" if match[2] else f"${letters}$"


def chosen(figures: Sequence[Figure]) -> list[Figure]:
    """Return the first figures of every component, at most `PANELS`."""
    for most in range(len(figures), 0, -1):
        seen: dict[str, int] = {}
        first: list[Figure] = []
        for figure in figures:
            component = figure.title.rpartition(".")[0]
            seen[component] = seen.get(component, 0) + 1
            if seen[component] <= most:
                first.append(figure)
        if len(first) <= PANELS:
            return first
    return list(figures[:PANELS])
