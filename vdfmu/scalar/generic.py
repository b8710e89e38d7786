"""Elementwise functions that numpy cannot dispatch to objects by itself.

``np.sin`` and its like call the method ``sin`` of every element of an object array. The functions here have
no such method dispatch in numpy (they compare, which a symbol must refuse), so they call the element's own
method by name and fall back to numpy on floats.
"""

from __future__ import annotations

from typing import Any

import numpy as np

__all__ = ["clip", "minimum", "piecewise_hold", "sgn", "zeros"]


def sgn(x: Any) -> Any:
    """Sign of every element, -1 or 1; that of the zero at zero, so that sgn(x) * f(|x|) keeps its slope."""
    if isinstance(x, np.ndarray) and x.dtype == object:
        return np.frompyfunc(sgn, 1, 1)(x)
    own = getattr(x, "sgn", None)
    return np.copysign(1.0, x) if own is None else own()


def minimum(a: Any, b: Any) -> Any:
    """Return the smaller of two scalars, of which the first decides whether they are symbols."""
    return a.minimum(b) if hasattr(a, "minimum") else min(a, b)


def clip(x: Any, low: Any, high: Any) -> Any:
    """Limit every element of `x` to [`low`, `high`]."""
    x, low, high = np.broadcast_arrays(x, low, high)
    if not any(a.dtype == object for a in (x, low, high)):
        return np.clip(x, low, high)
    return np.frompyfunc(_clip_one, 3, 1)(x, low, high)


def _clip_one(x: Any, low: Any, high: Any) -> Any:
    symbol = next(v for v in (x, low, high) if hasattr(v, "clip_between"))
    return symbol.clip_between(x, low, high)


def piecewise_hold(s: Any) -> tuple[Any, Any]:
    """Return a scalar `s` limited to [0, 1], and a factor that is 1 inside that interval and 0 outside."""
    if hasattr(s, "hold_unit_interval"):
        return s.hold_unit_interval()
    return min(max(s, 0.0), 1.0), 1.0 if 0.0 <= s <= 1.0 else 0.0


def zeros(shape: tuple[int, ...], *like: Any) -> np.ndarray:
    """Zeros of a dtype that can hold the elements of all arrays in `like` (object if any of them is)."""
    return np.zeros(shape, dtype=object if any(np.asarray(a).dtype == object for a in like) else float)
