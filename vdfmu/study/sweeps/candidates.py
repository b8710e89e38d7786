"""Candidates for the best point of a study, each judged by the verdict on a separate run, and their neighbours."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from vdfmu.base.arrays import Floats
from vdfmu.base.errors import CosimError, VdfmuError
from vdfmu.engine.results.verdict import FAILED, GOOD, STATES, UNJUDGED, checks_of, verdict_of
from vdfmu.study.sweeps.axes import read_axes
from vdfmu.study.sweeps.table import StudyTable

MOST = 8
"""Number of best points that run again, before ranks are skipped, to find the best good one; most neighbours of a
point."""
_FARTHER, _BACK = 2, 3
"""Ratio of the next rank to the last after these points, and most halvings of the skipped ranks before a good point."""


class JudgedPoint(NamedTuple):
    """A judged point."""

    point: int
    value: float
    """Value of the measure that ranks the points."""
    state: str
    """State of its run; "not judged" if the study does not contain how to run it, as for packages."""
    why: str = ""
    """The worst check of a run that is not good, or why it was not judged."""
    margin: float = math.nan
    """Smallest modulus margin of its loops; NaN if unknown."""


def candidates(study: StudyTable, values: Floats) -> list[JudgedPoint]:
    """Judge points in the order of their values (n,) until one is good, or not judged.

    After the `MOST` best, more and more ranks are skipped. The skipped ranks before the first good point are then
    searched by bisection, so that of a hundred thousand points at most 25 are run.
    """
    points, finite = study["point"], int(np.isfinite(values).sum())
    places = np.argsort(values, kind="stable")[:finite].tolist()
    judged: dict[int, JudgedPoint] = {}

    def decided(rank: int) -> bool:
        judged[rank] = judge_point(study, int(points[places[rank]]), float(values[places[rank]]))
        return judged[rank].state in (GOOD, UNJUDGED)

    before, rank = -1, 0
    while rank < finite and not decided(rank):
        before, rank = rank, rank + 1 if rank < MOST - 1 else _FARTHER * rank
    for _ in range(_BACK if rank < finite else 0):
        middle = (before + rank) // 2
        if middle <= before:
            break
        before, rank = (before, middle) if decided(middle) else (middle, rank)
    return [judged[rank] for rank in sorted(judged)]


def judge_point(study: StudyTable, point: int, value: float, without: Sequence[str] = ()) -> JudgedPoint:
    """Run a point and judge it like `vdfmu.run`, but without a reference and some checks."""
    from vdfmu.study.runs import run
    from vdfmu.study.verdict import loop_checks

    try:
        options: dict[str, Any] = study.options(point)
    except VdfmuError as error:
        return JudgedPoint(point, value, UNJUDGED, str(error).partition(". ")[0])
    try:
        summary = run(**options, out=False, reference=False).summary
    except CosimError as error:
        figures = getattr(error.results, "summary", {}).get("key_figures", {})
        unstable = [check.sentence for check in loop_checks({"key_figures": figures}) if check.state == FAILED]
        return JudgedPoint(point, value, FAILED, (unstable or [error.sentence])[0])
    except VdfmuError as error:
        return JudgedPoint(point, value, FAILED, str(error).partition(". ")[0])
    checks = [check for check in checks_of(summary) if check.key not in without]
    state = verdict_of(checks)["state"] if {check.state for check in checks} - {UNJUDGED} else UNJUDGED
    why = "" if state == GOOD else next((each.sentence for each in checks if each.state == state), "no check applies")
    margin = summary["key_figures"].get("margin", {}).get("value", math.nan)
    return JudgedPoint(point, value, state, why, margin)


def best_of(judged: Sequence[JudgedPoint]) -> JudgedPoint:
    """Return the first candidate with the best state."""
    order = (*STATES, UNJUDGED)
    return min(judged, key=lambda candidate: order.index(candidate.state))


def neighbours(study: StudyTable, point: int) -> Iterator[int]:
    """Yield the points of a grid that differ from a point by one step on one numeric axis."""
    if study.facts["sample"] != "grid" or study.search is not None:
        return
    axes = [axis.target for axis in read_axes(study.facts["axes"])]
    columns = [study[axis] for axis in axes]
    points = study["point"]
    here = int(np.flatnonzero(points == point)[0])
    places = [np.unique(column, return_inverse=True)[1] for column in columns]
    apart = np.abs(np.array([place - place[here] for place in places]))
    numbers = np.array([column.dtype.kind in "iuf" for column in columns])
    beside = (apart.sum(axis=0) == 1) & (apart[~numbers].sum(axis=0) == 0)
    yield from points[beside].tolist()
