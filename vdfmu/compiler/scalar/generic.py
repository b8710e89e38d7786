"""Elementwise functions without method dispatch in numpy.

``np.sin`` calls the method ``sin`` of every element of an object array. The functions here would compare elements in
numpy, which symbols refuse, so they call a method of the element by name, and numpy on floats.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from vdfmu.base.errors import UsageError


def sgn(x: Any) -> Any:
    """Return the sign of every element, -1 or 1, of a zero too, so that sgn(x) * f(|x|) keeps its slope there."""
    if isinstance(x, np.ndarray) and x.dtype == object:
        return np.frompyfunc(sgn, 1, 1)(x)
    method = getattr(x, "sgn", None)
    return np.copysign(1.0, x) if method is None else method()


def clip(x: Any, low: Any, high: Any) -> Any:
    """Limit every element of `x` to [`low`, `high`]. None means no limit, as in numpy."""
    x = x if low is None else maximum(x, low)
    return x if high is None else minimum(x, high)


def where(condition: Any, a: Any, b: Any) -> Any:
    """Return the elements of `a` under a condition, else the elements of `b`."""
    if all(np.asarray(x).dtype != object for x in (condition, a, b)):
        return np.where(condition, a, b)[()]

    def select(c: Any, x: Any, y: Any) -> Any:
        return c.where(x, y) if hasattr(c, "where") else (x if c else y)

    return np.frompyfunc(select, 3, 1)(condition, a, b)


def minimum(a: Any, b: Any) -> Any:
    """Return the smaller of two, element by element."""
    return _by_pairs(a, b, "minimum", np.minimum)


def maximum(a: Any, b: Any) -> Any:
    """Return the larger of two, element by element."""
    return _by_pairs(a, b, "maximum", np.maximum)


def _by_pairs(a: Any, b: Any, method: str, on_floats: Any) -> Any:
    def pair(x: Any, y: Any) -> Any:
        if hasattr(x, method):
            return getattr(x, method)(y)
        return getattr(y, method)(x) if hasattr(y, method) else on_floats(x, y)

    return np.frompyfunc(pair, 2, 1)(a, b) if object in (np.asarray(a).dtype, np.asarray(b).dtype) else on_floats(a, b)


def interpolate(x: Any, points: Any, values: Any) -> Any:
    """Interpolate linearly in a table, holding the first and the last value beyond its ends.

    Parameters
    ----------
    x : scalar or array
    points : (m,) floats or parameters, increasing
    values : (m, ...) values at the points. UsageError for another length.
    """
    if np.ndim(points) != 1 or np.shape(values)[:1] != np.shape(points):
        raise UsageError(
            f"interpolate: expected points (m,) and values (m, ...), got {np.shape(points)} and {np.shape(values)}."
        )
    result = values[0]
    for k in range(len(points) - 1):
        share = clip((x - points[k]) / (points[k + 1] - points[k]), 0.0, 1.0)
        result = result + share * (values[k + 1] - values[k])
    return result


def lookup(x: Any, edges: Any, rows: Any) -> Any:
    """Return the row of the interval that contains `x`; the first row before the table, the last row after it.

    Parameters
    ----------
    x : scalar
    edges : (m + 1,) floats, increasing
    rows : (m, w) or (m,) floats
        Row k belongs to ``edges[k] <= x < edges[k + 1]``. UsageError for other shapes.
    """
    shapes = np.shape(x), np.shape(edges), np.shape(rows)
    if shapes[0] or len(shapes[2]) not in (1, 2) or shapes[1] != (shapes[2][0] + 1,):
        raise UsageError(
            "lookup: expected a scalar x, edges (m + 1,) and rows (m, w) or (m,), got the shapes "
            f"{shapes[0]}, {shapes[1]} and {shapes[2]}. For values at points use interpolate."
        )
    if hasattr(x, "row_of"):
        return x.row_of(edges, rows)
    return np.asarray(rows)[min(max(int(np.searchsorted(edges, x, "right")) - 1, 0), len(rows) - 1)]


def zeros(shape: tuple[int, ...], *like: Any) -> np.ndarray:
    """Return zeros of dtype object if an array in `like` has it, else float."""
    return np.zeros(shape, dtype=object if any(np.asarray(a).dtype == object for a in like) else float)
