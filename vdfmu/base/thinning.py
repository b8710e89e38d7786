"""Fewer rows that look the same."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from vdfmu.base.arrays import distinct


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
    return distinct(np.concatenate([[0, m - 1], *(first[:, 0] + each for each in found)]))
