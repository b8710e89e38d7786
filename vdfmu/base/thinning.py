"""Fewer rows that look the same."""

from __future__ import annotations

from heapq import heapify, heappop, heappush
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray


def extremes(values: NDArray[Any], buckets: int) -> NDArray[np.intp]:
    """Return the rows of the first, the last, and of each of `buckets` equal stretches the smallest and largest value.

    `values` (m,), m > 0; NaN is neither.
    """
    m = len(values)
    edges = np.linspace(0, m, min(buckets, m) + 1).astype(int)
    first, last = edges[:-1, None], edges[1:, None]
    places = np.minimum(first + np.arange(np.max(last - first)), last - 1)  # the last repeats in shorter ones
    low, high = np.where(np.isnan(values), [[np.inf], [-np.inf]], values)
    found = [np.argmin(low[places], axis=1), np.argmax(high[places], axis=1)]
    return np.unique(np.concatenate([[0, m - 1], *(first[:, 0] + each for each in found)]))


def bends(
    time: NDArray[Any], values: NDArray[Any], rows: NDArray[np.intp], count: int, least: float
) -> tuple[NDArray[np.intp], NDArray[Any]]:
    """Return at most `count` more rows, at which curves leave the straight lines between the rows that are kept.

    The rule of Ramer (1972) and Douglas and Peucker (1973), from the top: always the row that is farthest from its
    line. With each row its distance from the line at that moment; `least` is the smallest that counts.

    Parameters
    ----------
    time : (m,), increasing
    values : (curves, m)
        In one measure: the distance is the largest over the curves. A value that is not finite has none.
    rows : (k,)
        Rows that are kept already, increasing.
    """

    def farthest(first: int, last: int) -> tuple[float, int, int, int]:
        share = (time[first:last] - time[first]) / (time[last] - time[first])
        ends = values[:, [first, last]]
        with np.errstate(invalid="ignore"):
            off = np.abs(values[:, first:last] - ends[:, :1] - share * (ends[:, 1:] - ends[:, :1])).max(axis=0)
        off[~np.isfinite(off)] = 0.0
        row = int(off.argmax())
        return -float(off[row]), first + row, first, last

    waiting = [farthest(int(a), int(b)) for a, b in pairwise(rows) if b - a > 1]
    heapify(waiting)
    found: list[int] = []
    distances: list[float] = []
    while waiting and len(found) < count and -waiting[0][0] > least:
        distance, row, first, last = heappop(waiting)
        found.append(row)
        distances.append(-distance)
        for a, b in ((first, row), (row, last)):
            if b - a > 1:
                heappush(waiting, farthest(a, b))
    return np.array(found, dtype=np.intp), np.array(distances)
