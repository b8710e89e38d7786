"""The rows at which an arm is drawn: some at equal distances in time, more where it moves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vdfmu.base.arrays import Floats, distinct
from vdfmu.base.thinning import bends
from vdfmu.engine.results.recorded import Signal
from vdfmu.engine.results.results import Results
from vdfmu.study.report.curves import Curve, CurveTable, Terms, recipes_of, values_of
from vdfmu.study.report.shapes import Chain, drawing_of

FRAMES = 1000
"""Most intervals between the rows at equal distances, at which an arm is drawn and a figure has a value in any case."""
_MORE = 500
"""Most rows between them at which an arm is drawn too, since it moves there."""
_LEAST = 1e-5
"""Deviation of a joint [rad], or of the base or a prismatic joint over the arm's reach, that nobody sees."""


class ArmFrames:
    """The drawing of an arm, and its motion at rows between which it moves on straight lines in joint space.

    Parameters
    ----------
    name : str
        Its component.
    arm : mapping
        See :func:`vdfmu.study.report.content.arm_of`; None for a run whose times alone are of interest.
    motion : mapping of str to terms
        What moves: q, and what is drawn with it; ``base``: position and rotation of its base, row by row.
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
        even = distinct(np.array([*np.arange(-first % self._stride, last + 1, self._stride), *ends], dtype=int))
        moved = {name: values_of(curves, part) for name, curves in self.motion.items()}
        rows, distances = even, np.full(len(even), np.inf)
        if self._arm:
            self._travel = np.maximum(self._travel, np.abs(moved["q"]).max(axis=1))
            if self._stride > 1:
                shown = self._scale * np.concatenate([moved["q"], *([moved["base"]] if "base" in moved else [])])
                more, found = bends(part.time, shown, even, _MORE, _LEAST)
                rows, distances = np.append(even, more), np.append(distances, found)
                order = np.argsort(rows)
                rows, distances = rows[order], distances[order]
        self._distances.append(distances)
        self._table.add(part.time, [*moved.values()], rows)

    def packed(self, copies: Mapping[str, Signal]) -> dict[str, Any]:
        """Return name, drawing and frames, ready for JSON; of the rows where it moves those that matter most."""
        distances = np.concatenate(self._distances)
        most = int(np.isinf(distances).sum()) + _MORE
        kept: NDArray[np.intp] = np.sort(np.argsort(-distances, kind="stable")[:most])
        recipes = {name: recipes_of(curves, copies) for name, curves in self.motion.items()}
        return {
            "component": self._name,
            "mounted": (self._arm or {}).get("mounted", ""),
            "arm": self._arm and drawing_of(self._arm, self._travel),
            "frames": self._table.packed([*self.motion], kept) | {"recipes": recipes},
        }
