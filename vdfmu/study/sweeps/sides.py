"""Data in the figures of a parameter study: the numbers of its axes and of a measure, and their names."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vdfmu.base.arrays import Floats
from vdfmu.base.errors import UsageError
from vdfmu.study.sweeps.axes import read_axes
from vdfmu.study.sweeps.table import StudyTable

_DECADES = 1.5
"""Decades that a measure must span to be drawn on a logarithmic scale."""
_FIFTHS = 5


@dataclass(frozen=True)
class Side:
    """A column as a figure has it."""

    name: str
    unit: str
    values: Floats
    """(n,): Numbers; for words, their places in `words`."""
    log: bool = False
    """Whether its scale is logarithmic."""
    words: tuple[str, ...] = ()
    """Its values, if they are not numbers."""

    @property
    def label(self) -> str:
        """Name and unit."""
        return f"{self.name} [{self.unit}]" if self.unit else self.name

    @property
    def scaled(self) -> Floats:
        """Values between 0 and 1 on the side's scale, NaN where there is none."""
        x = self.on_scale(self.values)
        low, high = np.nanmin(x), np.nanmax(x)
        return (x - low) / (high - low) if high > low else np.where(np.isnan(x), x, 0.5)

    def on_scale(self, values: Floats) -> Floats:
        """Return values, or their logarithms for a logarithmic side."""
        return np.log(values) if self.log else values

    def at(self, scaled: Floats) -> Floats:
        """Return the values at places between 0 and 1 of the side's scale."""
        x = self.on_scale(self.values)
        found = np.nanmin(x) + scaled * (np.nanmax(x) - np.nanmin(x))
        return np.exp(found) if self.log else found

    def text(self, value: float) -> str:
        """Return a value as it is written next to an axis."""
        return self.words[round(value)] if self.words else f"{float(f'{value:.3g}'):g}"


@dataclass(frozen=True)
class View:
    """A measure over the axes that vary, the most influential first."""

    study: StudyTable
    measure: str | None
    """Name as requested."""
    sides: list[Side]
    value: Side
    """The measure."""
    failed: NDArray[np.bool_]
    """(n,): Points without a value."""
    text: str
    """Its expression."""


def view(study: StudyTable, measure: str | None = None) -> View:
    """Read the data in figures of a measure, or of one of its columns; UsageError if there are none."""
    columns = study.elements(measure)
    values = study.values(measure)
    name, units = columns[0].partition("[")[0], study.facts["units"]
    good = np.isfinite(values)
    if not good.any():
        raise UsageError(f"{study.path}: no point has a value of {name}: all failed.")
    shown = columns[0] if len(columns) == 1 else f"{name}, largest of {len(columns)}"
    spread = values[good]
    log = bool(spread.min() > 0.0 and np.log10(spread.max() / spread.min()) > _DECADES)
    value = Side(shown, units.get(name, ""), np.where(good, values, np.nan), log)
    sides: list[Side] = []
    for axis in read_axes(study.facts["axes"]):
        column = study[axis.target]
        label = f"{axis.target} (factor)" if axis.factor else axis.target
        if column.dtype.kind not in "iuf":
            words = tuple(dict.fromkeys(map(str, axis.values)))
            places = np.array([words.index(str(one)) for one in column], dtype=float)
            names = tuple(Path(word).name for word in words)  # of files without their folders
            side = Side(label, "", places, words=names if len(set(names)) == len(words) else words)
        else:
            log = axis.form in ("log", "lognormal") and column.min() > 0.0
            side = Side(label, units.get(axis.target, ""), column.astype(float), bool(log))
        if np.ptp(side.values) > 0.0:
            sides.append(side)
    if not sides:
        raise UsageError(f"{study.path}: expected an axis with two values at least to draw {name} over.")
    sides.sort(key=lambda side: -np.ptp([mean for _, mean in groups(side, value)]))
    return View(study, measure, sides, value, ~good, study.facts["measures"].get(name, name))


def groups(side: Side, value: Side) -> list[tuple[float, float]]:
    """Return means of a side and of the measure, at each value of a side with few, else in fifths of its points."""
    good = np.isfinite(value.values)
    x, y = side.values[good], value.values[good]
    distinct = np.unique(x)
    if len(distinct) <= _FIFTHS or side.words:
        parts: Sequence[NDArray[np.intp]] = [np.flatnonzero(x == one) for one in distinct]
    else:
        parts = [part for part in np.array_split(np.argsort(x, kind="stable"), _FIFTHS) if len(part)]
    return [(float(np.mean(x[part])), float(np.mean(y[part]))) for part in parts]
