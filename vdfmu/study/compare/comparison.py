"""The table of a comparison: a row for each cell."""

from __future__ import annotations

from typing import Any

from vdfmu.study.sweeps.study import Sweep

AXES = ("arm", "motion", "mismatch", "law")
GOOD = ("stable",)
VERDICTS = (*GOOD, "not judged", "no margin", "at limits", "off the path", "unstable", "failed")
"""Verdicts on cells; measures of the others than `GOOD` are not compared."""


class LawComparison(Sweep):
    """The table of a comparison: a row for each cell, and the column ``run``, with which it is run again."""

    @property
    def about(self) -> dict[str, Any]:
        """How it was made: budget, margin, seed, axes, and all tunings, also of laws that are not tuned."""
        return self.facts["compare"]

    @property
    def rows(self) -> list[dict[str, Any]]:
        """All cells."""
        return self.table().to_pylist()
