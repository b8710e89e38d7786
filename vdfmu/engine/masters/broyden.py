"""Broyden's method: repeat until a guess comes out as it went in."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from vdfmu.base.arrays import Floats

_LEAST, _EACH = 30, 3
"""Repetitions at least, and for each unknown: a linear loop needs two, apart from rounding errors (Gay 1979)."""
_HOPELESS = 1e9
"""Growth of the change over the first that ends repeating, before numbers overflow. On its way the change grows a
lot: 1e3 is too little for 8 unknowns whose loop has a gain of 40."""
_KEPT = 1e-3
"""Bound below which Broyden's formula divides mostly by rounding errors."""

_Map = Callable[[Floats], Floats]


def not_solved(size: float, count: int, tolerance: float) -> str:
    """Return how far a size of the last residual is from the tolerance, for messages."""
    still = f"still changes by {size:.3g} of its size" if np.isfinite(size) else "is not a number"
    return f"{still} after {count} repetitions (wanted: {tolerance:g})"


@dataclass
class Broyden:
    """Solves one fixed point problem after the other and keeps what it has learnt."""

    inverse: Floats | None = None
    """(n, n): Inverse of the derivative of the residual by the guess, as far as the method knows it. None: minus the
    identity, which is right without coupling."""

    def solve(
        self,
        guess: Floats,
        repeat: _Map,
        size: _Map,
        tolerance: float,
        first: Callable[[], Floats | None] | None = None,
    ) -> tuple[Floats, int]:
        """Repeat with better guesses until every residual is within the tolerance, or there is no hope.

        Parameters
        ----------
        guess : (n,) array
        repeat : callable
            Returns what comes out of a guess, (n,).
        size : callable
            Sizes of the residual, what came out minus the guess, (n,), as the tolerance measures them.
        tolerance : float
        first : callable, optional
            Returns an `inverse` for when there is none, or None.

        Returns
        -------
        (n,) array
            Sizes of the last residual: all within the tolerance if it was solved.
        int
            Number of repetitions.
        """
        if self.inverse is None and first is not None:
            self.inverse = first()
        with np.errstate(invalid="ignore", over="ignore"):  # the caller is told by the sizes
            kept = self.inverse is not None
            sizes, count = self._try(guess, repeat, size, tolerance)
            if kept and self.inverse is None:  # the kept inverse may belong to another regime
                sizes, more = self._try(guess, repeat, size, tolerance)
                count += more
        return sizes, count

    def _try(self, guess: Floats, repeat: _Map, size: _Map, tolerance: float) -> tuple[Floats, int]:
        """Repeat from what was learnt; forget that without a solution."""
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
        """Improve the inverse by Broyden's first formula in its inverse form."""
        inverse = -np.eye(change.size) if self.inverse is None else self.inverse
        moved = inverse @ difference
        scale = change @ moved
        if abs(scale) > _KEPT * (change @ change):
            self.inverse = inverse + np.outer(change - moved, change @ inverse) / scale
