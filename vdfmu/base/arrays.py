"""Arrays: their type, elements by name, thinning for plots, and fast imports of scipy's modules."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from heapq import heapify, heappop, heappush
from importlib import import_module
from itertools import pairwise
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]


def element_name(name: str, index: Sequence[int]) -> str:
    """Return the name of an array's element, counted from 1: ``inertia[1,3]``. A scalar keeps its name."""
    return f"{name}[{','.join(str(i + 1) for i in index)}]" if index else name


def with_named(numbers: ArrayLike, name: str, values: Mapping[str, Any]) -> Floats:
    """Return the array `name` with elements replaced by `values`, whose keys count from 1: ``name[2,3]``."""
    replaced = np.array(numbers, dtype=np.float64)
    for place in np.ndindex(replaced.shape):
        replaced[place] = values.get(element_name(name, place), replaced[place])
    return replaced


def extremes(values: NDArray[Any], buckets: int) -> NDArray[np.intp]:
    """Return the first row, the last row, and the rows of minimum and maximum in each of `buckets` equal intervals.

    `values` (m,), m > 0. NaN is ignored.
    """
    m = len(values)
    edges = np.linspace(0, m, min(buckets, m) + 1).astype(int)
    first, last = edges[:-1, None], edges[1:, None]
    places = np.minimum(first + np.arange(np.max(last - first)), last - 1)  # shorter ones repeat their last row
    low, high = np.where(np.isnan(values), [[np.inf], [-np.inf]], values)
    rows = [np.argmin(low[places], axis=1), np.argmax(high[places], axis=1)]
    return distinct([0, m - 1], *(first[:, 0] + each for each in rows))


def distinct(*arrays: ArrayLike) -> NDArray[Any]:
    """Return the sorted distinct numbers of all arrays. np.unique would load numpy.ma, which takes 15 ms."""
    ordered = np.sort(np.concatenate(arrays))
    new = np.ones(len(ordered), bool)
    new[1:] = ordered[1:] != ordered[:-1]
    return ordered[new]


def bends(
    time: NDArray[Any], values: NDArray[Any], rows: NDArray[np.intp], count: int, least: float
) -> tuple[NDArray[np.intp], NDArray[Any]]:
    """Return up to `count` more rows where curves deviate most from straight lines between `rows`, and the deviations.

    The algorithm of Ramer (1972) and Douglas and Peucker (1973), top down: the next row added is always the one
    farthest from its line. A deviation is the largest over the curves when its row is added. Distances below `least`
    and values that are not finite are ignored. `time` (m,) and `rows` (k,) increase. `values` (curves, m) have the same
    unit.
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
    added: list[int] = []
    distances: list[float] = []
    while waiting and len(added) < count and -waiting[0][0] > least:
        distance, row, first, last = heappop(waiting)
        added.append(row)
        distances.append(-distance)
        for a, b in ((first, row), (row, last)):
            if b - a > 1:
                heappush(waiting, farthest(a, b))
    return np.array(added, dtype=np.intp), np.array(distances)


def scipy_part(name: str) -> Any:
    """Import a module of scipy without its package, which takes 0.1 to 0.3 s; or with it if that fails."""
    import scipy

    package = name.rpartition(".")[0]
    stand_in = ModuleType(package)
    stand_in.__path__ = [str(Path(path, *package.split(".")[1:])) for path in scipy.__path__]
    sys.modules.setdefault(package, stand_in)
    try:
        with suppress(ImportError):
            return import_module(name)
    finally:
        if sys.modules[package] is stand_in:
            del sys.modules[package]
    return import_module(package)


def odeint(rate: Callable[[float, Floats], Floats], x: Floats, times: Floats, **options: Any) -> tuple[Floats, str]:
    """Integrate by LSODA from `x` at the first time. Return a row for each time, and the reason of a failure."""
    options |= {"full_output": 1, "tfirst": 1}
    with suppress(TypeError, ValueError):  # a scipy with other internals
        # it changes the array of the start
        states, _, state = scipy_part("scipy.integrate._odepack").odeint(rate, x.copy(), times, **options)
        if state == 2 and np.isfinite(states[-1]).all():
            return states, ""
    from scipy.integrate import odeint as whole

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        states, info = whole(rate, x, times, **options)
    if info["message"] != "Integration successful.":
        return states, info["message"]
    return states, "" if np.isfinite(states[-1]).all() else "no finite state."
