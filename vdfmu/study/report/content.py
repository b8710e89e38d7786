"""Content of the page of a run: arms, figures and recorded signals, thinned and packed for a browser.

A figure or a group of signals has its own rows: every k-th of the run, and rows of the smallest and largest values
between them, so that no peak is lost. Numbers are single precision, calculated in double. They come from these rows
without interpolation.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vdfmu.base.arrays import Floats, bends, extremes
from vdfmu.engine.results.figure import Curve, Figure, Terms, signal_figures
from vdfmu.engine.results.results import Results
from vdfmu.study.report.figures import BLOCK, drawn_arms, run_figures
from vdfmu.study.report.scripts import packed
from vdfmu.study.report.shapes import Chain, drawing_of

EXTREMES = 1000
"""Stretches whose smallest and largest values are kept, shared among the curves of a figure."""
FRAMES = 1000
"""Most intervals between equidistant rows, common to the drawing of an arm and all figures."""
_MORE = 500
"""Most rows between them that draw a moving arm too."""
_LEAST = 1e-5
"""Invisible deviation of a joint [rad], or of the base or a prismatic joint over the arm's reach."""


def content_of(results: Results, summary: Mapping[str, Any]) -> dict[str, Any]:
    """Return the content of the page of a run, ready for JSON.

    ``arm``: see :func:`vdfmu.study.report.shapes.drawing_of`, None without one. ``frames``: time and, for the arm,
    joint positions, tracking errors, control torques and torsion at every k-th row. ``figures`` and ``signals``: lists
    of figures, with rows, time and values as base64 of little-endian numbers, curve by curve.
    """
    arms = drawn_arms(results, summary)
    n = len(summary["arm"]["types"]) if "arm" in summary else int(summary.get("joints", 0))
    m, parts = len(results), -(-len(results) // BLOCK)
    stride = max(1, -(-(m - 1) // FRAMES))
    objects = summary.get("scene", {}).get("objects", []) if arms else []
    turns = {each["turn"]: [[(1.0, each["turn"])]] for each in objects if each.get("turn") in results.names}
    moving = [
        ArmFrames(arm.component, arm.facts, {**arm.motion, **({} if k else turns)}, m) for k, arm in enumerate(arms)
    ] or [ArmFrames("", None, {}, m)]
    kinds = {"figures": run_figures(results, summary), "signals": signal_figures(results, (), n)}
    tables = {kind: [CurveTable(figure) for figure in figures] for kind, figures in kinds.items()}
    for k, part in enumerate(results.blocks(BLOCK)):
        for each in moving:
            each.add(part, k * BLOCK)
        even = np.arange(-k * BLOCK % stride, len(part), stride)  # every k-th row of the whole
        if k == parts - 1:
            even = np.unique(np.append(even, len(part) - 1))
        for table in itertools.chain(*tables.values()):
            values = values_of(table.curves, part, table.factor)
            buckets = max(1, EXTREMES // (len(values) * parts))
            rows = [even, *(extremes(row, buckets) for row in values)]
            table.add(part.time, [values], np.unique(np.concatenate(rows)))
    first, *more = [each.packed() for each in moving]
    packs = {
        kind: [table.packed(["values"]) | {"recipes": recipes_of(table.curves, table.factor)} for table in group]
        for kind, group in tables.items()
    }
    return {**first, "more": more, "objects": objects, **packs}


class ArmFrames:
    """The drawing of an arm, and its motion at rows between which it moves on straight lines in joint space.

    `name` is its component, `arm` the facts of :func:`vdfmu.study.run.scene.arm_of`, None for times alone. `motion`
    has q and the curves drawn with it; ``base``: position and rotation of its base, row by row.
    """

    def __init__(self, name: str, arm: Mapping[str, Any] | None, motion: Mapping[str, Sequence[Terms]], m: int) -> None:
        self._name, self._arm, self._m = name, arm, m
        self.motion = {key: [Curve("", 0, terms) for terms in each] for key, each in motion.items()}
        self._table = CurveTable()
        self._distances: list[Floats] = []
        self._stride = max(1, -(-(m - 1) // FRAMES))
        if arm:
            self._travel, reach = np.zeros(len(arm["types"])), Chain(arm).reach
            scale = [1.0 if kind == "revolute" else 1.0 / reach for kind in arm["types"]]
            self._scale = np.array([*scale, *([1.0 / reach] * 3 + [1.0] * 9 if "base" in motion else [])])[:, None]

    def add(self, part: Results, first: int) -> None:
        """Add a stretch of the run that begins with row `first`."""
        last = len(part) - 1
        ends = [0, last] if self._arm else [last] if first + last == self._m - 1 else []
        even = np.unique(np.array([*np.arange(-first % self._stride, last + 1, self._stride), *ends], dtype=int))
        moved = {name: values_of(curves, part) for name, curves in self.motion.items()}
        rows, distances = even, np.full(len(even), np.inf)
        if self._arm:
            self._travel = np.maximum(self._travel, np.abs(moved["q"]).max(axis=1))
            if self._stride > 1:
                shown = self._scale * np.concatenate([moved["q"], *([moved["base"]] if "base" in moved else [])])
                more, far = bends(part.time, shown, even, _MORE, _LEAST)
                rows, distances = np.append(even, more), np.append(distances, far)
                order = np.argsort(rows)
                rows, distances = rows[order], distances[order]
        self._distances.append(distances)
        self._table.add(part.time, [*moved.values()], rows)

    def packed(self) -> dict[str, Any]:
        """Return name, drawing and frames with the rows of the largest deviations, ready for JSON."""
        distances = np.concatenate(self._distances)
        most = int(np.isinf(distances).sum()) + _MORE
        kept: NDArray[np.intp] = np.sort(np.argsort(-distances, kind="stable")[:most])
        recipes = {name: recipes_of(curves) for name, curves in self.motion.items()}
        return {
            "component": self._name,
            "mounted": (self._arm or {}).get("mounted", ""),
            "arm": self._arm and drawing_of(self._arm, self._travel),
            "frames": self._table.packed([*self.motion], kept) | {"recipes": recipes},
        }


class CurveTable:
    """Rows of curves, gathered stretch by stretch."""

    def __init__(self, figure: Figure | None = None) -> None:
        self._facts: dict[str, Any] = {}
        self.curves, self.factor = (figure.curves, figure.quantity.factor) if figure else ((), 1.0)
        if figure:
            self._facts = {"key": figure.key, "title": figure.title, "unit": figure.quantity.unit, "peak": figure.peak}
            self._facts["curves"] = [[curve.label, curve.joint, int(curve.dashed)] for curve in self.curves]
        self._time: list[Floats] = []
        self._parts: list[list[Floats]] = []

    def add(self, time: Floats, arrays: Sequence[Floats], rows: NDArray[np.intp]) -> None:
        """Add the rows of arrays (curves, m)."""
        self._time.append(time[rows])
        self._parts.append([array[:, rows] for array in arrays])

    def packed(self, names: Sequence[str], rows: Any = slice(None)) -> dict[str, Any]:
        """Return the description of the figure, its times at `rows`, and the arrays by name, curve by curve."""
        joined = (np.hstack(array)[:, rows] for array in zip(*self._parts, strict=True))
        return {
            **self._facts,
            "time": packed(np.concatenate(self._time)[rows], "<f8"),
            **{name: packed(array, "<f4") for name, array in zip(names, joined, strict=True)},
        }


def values_of(curves: Iterable[Curve], results: Results, factor: float = 1.0) -> Floats:
    """Return the values of curves times a factor: (curves, m)."""
    return np.array([curve.values(results, factor) for curve in curves])


def recipes_of(curves: Iterable[Curve], factor: float = 1.0) -> list[Any]:
    """Return how curves come from signals, for the page: factor; factors and signals."""
    return [[factor, [*map(list, curve.terms)]] for curve in curves]
