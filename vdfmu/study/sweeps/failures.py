"""The failed points of a study by cause, and where they are."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vdfmu.base.errors import FailureKind
from vdfmu.study.sweeps.axes import read_axes
from vdfmu.study.sweeps.table import StudyTable

_NAMED = 3
"""Number of causes of failures that are named."""
_CAUSES: Mapping[str, str] = {
    FailureKind.UNSTABLE: "unstable loop",
    FailureKind.SOLVER: "solver of {}: its step reached the minimum, as in an unstable loop",
    FailureKind.NOT_FINITE: "values of {} are not finite",
    FailureKind.COUPLING: "coupling of {} does not converge",
    FailureKind.TIME_LIMIT: "took longer than the time limit",
}
"""FailureKind to the text of the cause, where {} is the component. Other kinds have the cause in their messages."""


class FailedGroup(NamedTuple):
    """Points that failed for the same cause."""

    cause: str
    points: Sequence[int]
    where: str
    """Ranges of the axes, if they are narrower than over all points."""
    message: str
    """Message of the first of these points."""


def failed_groups(study: StudyTable) -> list[FailedGroup]:
    """Return the failed points by cause, the most frequent first."""
    causes: dict[str, list[int]] = {}
    failed = study.failed
    if not failed:
        return []
    kept = [name for name in ("kind", "failed_in") if name in study.columns]
    for row in study.table(["point", "failed", *kept]).to_pylist():
        if row["failed"] is not None:
            causes.setdefault(cause_of(**row), []).append(row["point"])
    points = study["point"]
    columns = {words: study[axis] for axis, words in axis_words(study).items()}
    failures: list[FailedGroup] = []
    for cause, members in sorted(causes.items(), key=lambda item: -len(item[1])):
        chosen = np.isin(points, members)
        ranges = [words for axis, values in columns.items() if (words := _range(axis, values, values[chosen]))]
        failures.append(FailedGroup(cause, members, ", ".join(ranges), failed[members[0]]))
    return failures


def cause_of(failed: str, kind: str | None = None, failed_in: str | None = None, point: int = 0) -> str:
    """Return the cause that a failed point shares with others: that of its kind, or its message without numbers."""
    if kind is not None and kind in _CAUSES:
        return _CAUSES[kind].format(failed_in)
    return re.sub(r"-?\d+(\.\d+)?(e[-+]?\d+)?", "…", failed.splitlines()[0])[:160]


def failure_words(study: StudyTable) -> Iterator[str]:
    """Yield how many points failed, and the most frequent causes."""
    if not (each := failed_groups(study)):
        return
    causes = [f"{g.cause} ({', '.join(filter(None, (str(len(g.points)), g.where)))})" for g in each[:_NAMED]]
    causes += [f"{len(each) - _NAMED} other causes"] if len(each) > _NAMED else []
    yield f"{len(study.failed)} of {len(study)} points failed: {'; '.join(causes)}"


def axis_words(study: StudyTable) -> dict[str, str]:
    """Return the axes and their text, in which factors have a cross after the name."""
    return {axis.target: f"{axis.target} ×" if axis.factor else axis.target for axis in read_axes(study.facts["axes"])}


def place_of(study: StudyTable, row: Mapping[str, Any]) -> str:
    """Return the values of the axes at a point as text."""
    return ", ".join(f"{words} {_value(row[name])}" for name, words in axis_words(study).items())


def _value(value: Any) -> str:
    return f"{value:.3g}" if isinstance(value, float) else Path(str(value)).name


def _range(axis: str, values: NDArray[Any], chosen: NDArray[Any]) -> str:
    """Return the range of an axis as text; empty if all points have the same range."""
    if values.dtype.kind not in "iuf":
        words = sorted(set(map(str, chosen)))
        return f"{axis} {', '.join(words)}" if len(words) < len(set(map(str, values))) else ""
    low, high = chosen.min(), chosen.max()
    if low == values.min() and high == values.max():
        return ""
    return f"{axis} {low:.3g}" + (f" to {high:.3g}" if high > low else "")
