"""Growth exponents: fitted to times, and exact for counts."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from typing import NamedTuple

import numpy as np


class Exponent(NamedTuple):
    """Fit ``y = factor * x**slope`` over `points` points from `low` to `high`.

    `error` is the standard error of the slope: the scatter around the line, not the bend of the curve.
    """

    slope: float
    error: float
    factor: float
    points: int
    low: float
    high: float

    @property
    def range(self) -> str:
        """The range of x as text."""
        return f"{self.low:g} to {self.high:g}"

    def at(self, x: float) -> float:
        """Value of the fitted line at `x`."""
        return self.factor * x**self.slope


def upper_half(x: Sequence[float], y: Sequence[float]) -> tuple[list[float], list[float]]:
    """Return the points with the larger `x`: half of them, rounded up."""
    pairs = sorted(zip(x, y, strict=True))[len(x) // 2 :]
    return [a for a, _ in pairs], [b for _, b in pairs]


def fit_exponent(x: Sequence[float], y: Sequence[float]) -> Exponent:
    """Least-squares slope of log y over log x.

    Parameters
    ----------
    x, y : at least two positive numbers each
    """
    u, v = np.log(np.asarray(x, dtype=float)), np.log(np.asarray(y, dtype=float))
    if len(u) < 2:
        raise ValueError(f"expected at least 2 points, got {len(u)}")
    centred = u - u.mean()
    slope = float(centred @ v / (centred @ centred))
    rest = v - v.mean() - slope * centred
    freedom = len(u) - 2
    error = float(np.sqrt(rest @ rest / freedom / (centred @ centred))) if freedom else float("nan")
    factor = float(np.exp(v.mean() - slope * u.mean()))
    return Exponent(slope, error, factor, len(u), float(min(x)), float(max(x)))


class Polynomial(NamedTuple):
    """Exact coefficients, the constant first; `checked` points beyond those it was found from lie on it."""

    coefficients: tuple[Fraction, ...]
    checked: int

    @property
    def degree(self) -> int:
        """Degree of the polynomial."""
        return len(self.coefficients) - 1

    def __call__(self, x: int) -> Fraction:
        """Value at `x`."""
        return sum((c * x**k for k, c in enumerate(self.coefficients)), Fraction(0))

    def __str__(self) -> str:
        text = ""
        for k in range(self.degree, -1, -1):
            c = self.coefficients[k]
            if c == 0:
                continue
            sign = ("-" if c < 0 else "") if not text else (" - " if c < 0 else " + ")
            size = "" if abs(c) == 1 and k else str(abs(c))
            power = "" if k == 0 else "n" if k == 1 else f"n^{k}"
            text += sign + " ".join(part for part in (size, power) if part)
        return text or "0"


def exact_polynomial(x: Sequence[int], y: Sequence[int], spare: int = 2) -> Polynomial | None:
    """Polynomial of least degree through all the points, or None.

    Newton's divided differences in rational numbers. A degree d counts as found if at least `spare` points
    lie on the polynomial beyond the d + 1 that determine it.
    """
    table = [Fraction(int(v)) for v in y]
    newton: list[Fraction] = []
    for k in range(len(x)):
        if len(table) >= spare and all(v == 0 for v in table):
            break
        newton.append(table[0])
        table = [
            (b - a) / (x[i + k + 1] - x[i]) for i, (a, b) in enumerate(zip(table, table[1:], strict=False))
        ]
    else:
        return None
    coefficients = [Fraction(0)]
    for k in reversed(range(len(newton))):  # Horner: p = newton[k] + (n - x[k]) * p
        shifted = [Fraction(0), *coefficients]
        for i, c in enumerate(coefficients):
            shifted[i] -= x[k] * c
        shifted[0] += newton[k]
        coefficients = shifted
    while len(coefficients) > 1 and coefficients[-1] == 0:
        coefficients.pop()
    return Polynomial(tuple(coefficients), len(x) - len(newton))
