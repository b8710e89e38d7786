"""The picture of any system's run: a panel for each recorded variable, arrays as the curves of one panel."""

from __future__ import annotations

import re
from collections.abc import Collection
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from vdfmu.engine.cosim.results import Results
from vdfmu.report import style

PANELS = 12
"""Panels of a picture; more would be too small to read."""
_CURVES, _CURVES_ALONE = 8, 28
"""Curves of a panel whose legend fits beside it, and of one that is alone; those differ in colour or dashes."""
_TITLE, _TITLE_ALONE = 38, 80
"""Characters of the title of a panel."""
_LEAST, _LARGEST = 1e-290, 1e290
"""Values that matplotlib can draw."""
_INDEX = re.compile(r"(.+)(\[\d+(?:,\d+)*\])")


class _Panel(NamedTuple):
    component: str
    title: str
    unit: str
    curves: list[tuple[str, str]]
    """Label and name of the signal."""


def signals_figure(results: Results, folder: Path, hidden: Collection[str] = ()) -> list[Path]:
    """Write ``signals.png``, unless nothing is recorded; see :func:`draw_signals`."""
    if all(name in hidden for name in results.names):
        return []
    return [style.save(draw_signals(results, hidden), folder / "signals.png")]


@style.styled
def draw_signals(results: Results, hidden: Collection[str] = ()) -> Figure:
    """Draw the recorded variables over time.

    Of more than `PANELS` variables each component shows its first ones.

    Parameters
    ----------
    results : Results
    hidden : collection of str
        Signals to leave out.
    """
    panels = _panels(results, hidden)
    shown = _chosen(panels)
    facts = results.summary
    caption = f"{Path(facts.get('package', '')).name}, {facts['algorithm']}, step {1e3 * facts['step']:g} ms."
    left = len(panels) - len(shown)
    if left:
        caption += f" {left} more variables are in the results; --record chooses others."
    alone = len(shown) == 1
    most = _CURVES_ALONE if alone else _CURVES
    if any(len(p.curves) > most for p in shown):
        caption += f" Of arrays the first {most} elements."
    columns = 1 if alone else 2 if len(shown) <= 6 else 3
    rows = -(-len(shown) // columns)
    figure = style.new_figure(
        _plain(f"Signals of {facts['system']}", _TITLE_ALONE),
        _plain(caption, 10 * _TITLE_ALONE),
        width=3.9 * columns if columns > 1 else style.WIDTH,
        height=1.0 + (3.2 if rows == 1 else 2.2) * rows,
    )
    grid: NDArray[Any] = figure.subplots(rows, columns, squeeze=False)
    axes: list[Axes] = grid.ravel().tolist()
    for spare in axes[len(shown) :]:
        spare.remove()
    for place, panel in zip(axes, shown, strict=False):
        _draw(place, results, panel, most, _TITLE_ALONE if alone else _TITLE)
    style.label_time(axes[: len(shown)], columns)
    return figure


def _draw(axes: Axes, results: Results, panel: _Panel, most: int, length: int) -> None:
    handles: list[Line2D] = []
    for i, (label, name) in enumerate(panel.curves[:most]):
        look = style.joint_look(i)
        if results.kinds[name] != "real":
            look["drawstyle"] = "steps-post"
        values = results[name].astype(float)
        values[~(np.abs(values) <= _LARGEST)] = np.nan
        values[np.abs(values) < _LEAST] = 0.0
        handles.append(style.curve(axes, results.time, values, label=label, **look))
    style.dress(axes, _plain(panel.title, length), "", _plain(panel.unit, length), results.time)
    if len(handles) > 1:
        style.legend_beside(axes, handles)


def _plain(text: str, length: int) -> str:
    """Return a text that matplotlib takes for no formula, shortened in its middle."""
    if len(text) > length:
        text = f"{text[: length // 2 - 1]}…{text[-(length - length // 2) :]}"
    return text.replace("$", r"\$")


def _panels(results: Results, hidden: Collection[str]) -> list[_Panel]:
    """Variables in the order of the results; elements of another unit are another panel."""
    panels: dict[tuple[str, str], _Panel] = {}
    for name in results.names:
        if name in hidden:
            continue
        match = _INDEX.fullmatch(name)
        title, label = match.groups() if match else (name, name)
        unit = results.units[name]
        component = title.rpartition(".")[0]
        panel = panels.setdefault((title, unit), _Panel(component, title, unit, []))
        panel.curves.append((label, name))
    return list(panels.values())


def _chosen(panels: list[_Panel]) -> list[_Panel]:
    """As many first panels of every component as there is room for."""
    for most in range(len(panels), 0, -1):
        seen: dict[str, int] = {}
        chosen: list[_Panel] = []
        for panel in panels:
            seen[panel.component] = seen.get(panel.component, 0) + 1
            if seen[panel.component] <= most:
                chosen.append(panel)
        if len(chosen) <= PANELS:
            return chosen
    return panels[:PANELS]
