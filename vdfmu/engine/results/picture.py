"""The picture of any system's run, or of several: a panel for each variable, arrays as the curves of one panel."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from vdfmu.base import style
from vdfmu.base.errors import UsageError
from vdfmu.engine.results.results import Recorded

PANELS = 12
"""Most panels of a readable picture."""
_CURVES, _CURVES_ALONE = 8, 28
"""Most curves of a panel, for its legend, and of a single panel, for distinct colours and dashes."""
_TITLE, _TITLE_ALONE = 38, 80
"""Characters of the title of a panel."""
_NAMED = 8
"""Names of panels that were left out, in the caption."""
_LEAST, _LARGEST = 1e-290, 1e290
"""Values that matplotlib can draw."""


class _Panel(NamedTuple):
    component: str
    title: str
    unit: str
    curves: list[tuple[int, str, str]]
    """Place in its array from 0, for its colour; label; name of the signal."""


def signals_figure(results: Recorded, folder: Path, pictures: Sequence[str] = ("png",)) -> list[Path]:
    """Write ``signals.png``, or of the suffixes `pictures`, unless nothing is recorded; see :func:`draw_signals`."""
    if not results.names:
        return []
    figure = draw_signals(results)
    return [style.save(figure, folder / f"signals.{suffix}") for suffix in pictures]


def plot(results: Recorded, names: Sequence[str], over: Mapping[str, Recorded], path: str | Path | None) -> Figure:
    """Draw chosen signals, and write the picture if there is a path; see `Results.plot`."""
    runs: list[Any] = list(over.values()) if hasattr(over, "values") else [None]
    if not all(isinstance(run, Recorded) for run in runs):
        raise UsageError(f"plot: expected results by label, over={{'soft': other}}, got {over!r:.60}.")
    wanted = [signal for name in names or results.names for signal in results.members(name)]
    figure = draw_signals(results, set(results.names).difference(wanted), over, wanted)
    if path is not None:
        style.save(figure, Path(path))
    return figure


@style.styled
def draw_signals(
    results: Recorded, hidden: Collection[str] = (), over: Mapping[str, Recorded] | None = None,
    order: Sequence[str] = (),
) -> Figure:  # fmt: skip
    """Draw the recorded variables over time, without `hidden` signals, and other runs `over` them, by label.

    With more than `PANELS` variables each component shows its first variables. Panels are in the `order` of signals, by
    default of the results.
    """
    panels = _panels(results, hidden, order)
    shown = _chosen(panels)
    facts = results.summary
    runs = {str(facts.get("scenario") or "this run"): results, **(over or {})}
    about = [Path(facts.get("package", "")).name, str(facts.get("algorithm", ""))]
    about += [f"step {1e3 * facts['step']:g} ms"] if "step" in facts else []
    caption = ", ".join(filter(None, about)) + "." if any(about) else ""
    left = [panel.title for panel in panels if panel not in shown]
    if left:
        more = f" and {len(left) - _NAMED} more" if len(left) > _NAMED else ""
        caption += f" Not drawn: {', '.join(left[:_NAMED])}{more}; they are in the results, --record chooses others."
    alone = len(shown) == 1
    most = _CURVES_ALONE if alone else _CURVES
    if any(len(p.curves) > most for p in shown):
        caption += f" Of arrays the first {most} elements."
    columns = 1 if alone else 2 if len(shown) <= 6 else 3
    rows = -(-len(shown) // columns)
    legend = [Line2D([], [], label=name, color="black", **_run_look(k)) for k, name in enumerate(runs)]
    figure = style.new_figure(
        _plain(f"Signals of {facts.get('scenario') or facts.get('system', 'a run')}", _TITLE_ALONE),
        _plain(caption, 10 * _TITLE_ALONE),
        width=3.9 * columns if columns > 1 else style.WIDTH,
        height=1.0 + (3.2 if rows == 1 else 2.2) * rows,
        legend=legend if len(runs) > 1 else (),
    )
    grid: NDArray[Any] = figure.subplots(rows, columns, squeeze=False)
    axes: list[Axes] = grid.ravel().tolist()
    for spare in axes[len(shown) :]:
        spare.remove()
    for place, panel in zip(axes, shown, strict=False):
        _draw(place, list(runs.values()), panel, most, _TITLE_ALONE if alone else _TITLE)
    style.label_time(axes[: len(shown)], columns)
    return figure


def _run_look(k: int) -> dict[str, Any]:
    """Dashes and width of run `k`, from 0: runs drawn over another are dashed and thinner."""
    return {"linestyle": style.DASHES[k % len(style.DASHES)], "linewidth": 1.6 if k == 0 else 1.2}


def _draw(axes: Axes, runs: Sequence[Recorded], panel: _Panel, most: int, length: int) -> None:
    handles: list[Line2D] = []
    for i, label, name in panel.curves[:most]:
        for k, results in enumerate(runs):
            if name not in results.kinds:
                continue
            look = style.joint_look(i) | (_run_look(k) if len(runs) > 1 else {})
            if results.kinds[name] != "real":
                look["drawstyle"] = "steps-post"
            values = results[name].astype(float)
            values[~(np.abs(values) <= _LARGEST)] = np.nan
            values[np.abs(values) < _LEAST] = 0.0
            line = style.curve(axes, results.time, values, label=label, **look)
            if k == 0:
                handles.append(line)
    style.dress(axes, _plain(panel.title, length), "", _plain(panel.unit, length), runs[0].time)
    if len(handles) > 1:
        style.legend_beside(axes, handles)


def _plain(text: str, length: int) -> str:
    """Return a text that matplotlib does not take for a formula, shortened in its middle."""
    if len(text) > length:
        text = f"{text[: length // 2 - 1]}…{text[-(length - length // 2) :]}"
    return text.replace("$", r"\$")


def _panels(results: Recorded, hidden: Collection[str], order: Sequence[str] = ()) -> list[_Panel]:
    """Return the groups in the order of the results or of signals, with a panel for each unit."""
    panels: dict[tuple[str, str], _Panel] = {}
    for group, elements in results.groups.items():
        units = {results.units[name] for name in elements.values()}
        for place, (index, name) in enumerate(sorted(elements.items())):
            if name in hidden:
                continue
            unit, label = results.units[name], name.removeprefix(group) or name
            panel = panels.setdefault((group, unit), _Panel(group.rpartition(".")[0], group, unit, []))
            panel.curves.append((index[0] - 1 if len(index) == 1 else place, label, name))
        for unit in units if len(units) > 1 else ():
            if (group, unit) in panels:
                panel = panels[group, unit]
                indices = ", ".join(label.strip("[]") for _, label, _ in panel.curves)
                panels[group, unit] = panel._replace(title=f"{group}[{indices}]")
    places = {name: place for place, name in reversed(list(enumerate(order)))}
    return sorted(panels.values(), key=lambda panel: min(places.get(name, 0) for _, _, name in panel.curves))


def _chosen(panels: list[_Panel]) -> list[_Panel]:
    """Return the first panels of every component, up to `PANELS`."""
    seen: dict[str, int] = {}
    ranked: list[tuple[int, _Panel]] = []
    for panel in panels:
        seen[panel.component] = seen.get(panel.component, 0) + 1
        ranked.append((seen[panel.component], panel))
    for most in range(len(panels), 0, -1):
        chosen = [panel for rank, panel in ranked if rank <= most]
        if len(chosen) <= PANELS:
            return chosen
    return panels[:PANELS]
