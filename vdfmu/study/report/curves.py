"""Curves over time: sums of signals, and their rows packed for a browser."""

from __future__ import annotations

import base64
from collections.abc import Iterable, Sequence
from functools import reduce
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vdfmu.base.arrays import Floats
from vdfmu.engine.results.results import Results

Terms = Sequence[tuple[float, str]]
"""Factors, and names of signals; an empty name is 1."""


class Curve(NamedTuple):
    """A curve of a figure: `scale` times the sum of signals, each times its factor.

    The page evaluates the same sums for a run that it has simulated.
    """

    label: str
    joint: int
    """From 1; 0 for none."""
    terms: Terms
    """At least one."""
    scale: float = 1.0
    dashed: bool = False

    def values(self, results: Results) -> Floats:
        """Return its values: (m,)."""
        one = np.ones(len(results))
        return self.scale * reduce(np.add, [factor * (results[name] if name else one) for factor, name in self.terms])


class Figure(NamedTuple):
    """Curves of one unit of measurement over time."""

    key: str
    title: str
    unit: str
    curves: Sequence[Curve]
    peak: str = ""
    """Name of its largest absolute value; empty if not of interest."""


class CurveTable:
    """Rows of curves, gathered stretch by stretch."""

    def __init__(self, figure: Figure | None = None) -> None:
        self._facts: dict[str, Any] = figure._asdict() if figure else {}
        self.curves: Sequence[Curve] = self._facts.pop("curves", ())
        if figure:
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


def values_of(curves: Iterable[Curve], results: Results) -> Floats:
    """Return the values of curves: (curves, m)."""
    return np.array([curve.values(results) for curve in curves])


def recipes_of(curves: Iterable[Curve]) -> list[Any]:
    """Return how curves come from signals, for the page: scale; factors and signals."""
    return [[curve.scale, [*map(list, curve.terms)]] for curve in curves]


def packed(values: NDArray[Any], kind: str) -> str:
    """Return numbers as base64 of a `kind` of the page."""
    with np.errstate(over="ignore"):  # values beyond single precision are drawn as gaps
        return base64.b64encode(np.ascontiguousarray(values, dtype=kind).tobytes()).decode()
