"""Broyden's method for fixed points: repeat until the result equals the guess."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from vdfmu.base.arrays import Floats

_LEAST, _EACH = 30, 3
"""Smallest number of repetitions, and number per unknown: without rounding a linear loop needs two (Gay 1979)."""
_HOPELESS = 1e9
"""Ratio to the first change at which repetitions end, before numbers overflow. Changes may grow a lot before they
converge: 1e3 is too small for 8 unknowns with a loop gain of 40."""
_KEPT = 1e-3
"""Limit below which Broyden's formula divides mostly by rounding errors."""

_Map = Callable[[Floats], Floats]
_First = Callable[[], Floats | None]


def not_solved(size: float, count: int, tolerance: float) -> str:
    """Describe the last residual against the tolerance, for messages."""
    still = f"still changes by {size:.3g} of its size" if np.isfinite(size) else "is not a number"
    return f"{still} after {count} repetitions (wanted: {tolerance:g})"


@dataclass
class Broyden:
    """Solves a series of fixed-point problems, each from the inverse Jacobian of the last."""

    inverse: Floats | None = None
    """Estimated inverse of the derivative of the residual with respect to the guess, (n, n). None means minus the
    identity, which is exact without coupling."""

    def solve(
        self, guess: Floats, repeat: _Map, size: _Map, tolerance: float, first: _First = lambda: None
    ) -> tuple[Floats, int]:
        """Improve the guess (n,) until every residual is within the tolerance; stop after `_EACH` tries or divergence.

        `repeat` returns the result of a guess, (n,). The residual is result minus guess, and `size` returns its sizes,
        (n,), as the tolerance measures them. `first` returns the initial `inverse`, or None.

        Returns the sizes of the last residual, (n,), all within the tolerance if solved, and the number of repetitions.
        """
        if self.inverse is None:
            self.inverse = first()
        with np.errstate(invalid="ignore", over="ignore"):  # the sizes report it
            kept = self.inverse is not None
            sizes, count = self._try(guess, repeat, size, tolerance)
            if kept and self.inverse is None:  # the kept inverse may belong to another regime
                sizes, more = self._try(guess, repeat, size, tolerance)
                count += more
        return sizes, count

    def _try(self, guess: Floats, repeat: _Map, size: _Map, tolerance: float) -> tuple[Floats, int]:
        """Repeat with the known inverse, and discard it if there is no solution."""
        most = max(_LEAST, _EACH * guess.size)
        change = last = np.zeros(guess.size)
        first, count = 0.0, 0
        while True:
            count += 1
            residual = repeat(guess) - guess
            sizes = size(residual)
            largest = float(np.max(sizes, initial=0.0))
            if largest <= tolerance:
                return sizes, count
            if count > 1:
                self._learn(change, residual - last)
            else:
                first = largest
            if count == most or (not largest < _HOPELESS * first and count > 2):
                self.inverse = None
                return sizes, count
            last = residual
            change = residual if self.inverse is None else -self.inverse @ residual
            guess = guess + change

    def _learn(self, change: Floats, difference: Floats) -> None:
        """Update the inverse by Broyden's first formula in its inverse form."""
        inverse = -np.eye(change.size) if self.inverse is None else self.inverse
        moved = inverse @ difference
        scale = change @ moved
        if abs(scale) > _KEPT * (change @ change):
            self.inverse = inverse + np.outer(change - moved, change @ inverse) / scale
