"""Rows of curves, packed for a browser."""

from __future__ import annotations

import base64
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vdfmu.base.arrays import Floats
from vdfmu.engine.results.figure import Curve, Figure
from vdfmu.engine.results.results import Results


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


def packed(values: NDArray[Any], kind: str) -> str:
    """Return numbers as base64 of a `kind` of the page."""
    with np.errstate(over="ignore"):  # values beyond single precision are drawn as gaps
        return base64.b64encode(np.ascontiguousarray(values, dtype=kind).tobytes()).decode()
