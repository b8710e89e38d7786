"""Time derivatives by jets: a scalar that carries its value and its first two time derivatives.

The exact inverse of the flexible plant needs two time derivatives of the rigid inverse dynamics. Run on
arrays of jets, the same lines of :mod:`vdfmu.arm.equations.inverse_dynamics` give them without a second formula.
Coefficients are floats or symbols, so a jet traces as well.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from vdfmu.compiler.scalar.generic import sgn


class Jet:
    """Value and first two time derivatives of a scalar, with arithmetic by the product and chain rules."""

    __slots__ = ("x", "x_dot", "x_ddot")

    def __init__(self, x: Any, x_dot: Any = 0.0, x_ddot: Any = 0.0) -> None:
        self.x, self.x_dot, self.x_ddot = x, x_dot, x_ddot

    def __repr__(self) -> str:
        return f"Jet({self.x!r}, {self.x_dot!r}, {self.x_ddot!r})"

    def __float__(self) -> float:
        raise TypeError("A jet is not a float: take derivative(jet, 0) for its value.")

    def __neg__(self) -> Jet:
        return Jet(-self.x, -self.x_dot, -self.x_ddot)

    def __add__(self, other: Any) -> Any:
        if isinstance(other, np.ndarray):
            return NotImplemented  # numpy then goes on element by element
        if isinstance(other, Jet):
            return Jet(self.x + other.x, self.x_dot + other.x_dot, self.x_ddot + other.x_ddot)
        return Jet(self.x + other, self.x_dot, self.x_ddot)

    __radd__ = __add__

    def __sub__(self, other: Any) -> Any:
        return self + -other

    def __rsub__(self, other: Any) -> Any:
        return -self + other

    def __mul__(self, other: Any) -> Any:
        if isinstance(other, np.ndarray):
            return NotImplemented
        if not isinstance(other, Jet):
            return Jet(self.x * other, self.x_dot * other, self.x_ddot * other)
        return Jet(
            self.x * other.x,
            self.x_dot * other.x + self.x * other.x_dot,
            self.x_ddot * other.x + 2.0 * self.x_dot * other.x_dot + self.x * other.x_ddot,
        )

    __rmul__ = __mul__

    def __truediv__(self, other: Any) -> Any:
        if isinstance(other, np.ndarray):
            return NotImplemented
        if not isinstance(other, Jet):
            return self * (1.0 / other)
        return self * other._chain(1.0 / other.x, -1.0 / other.x**2, 2.0 / other.x**3)

    def __rtruediv__(self, other: Any) -> Jet:
        return self._chain(1.0 / self.x, -1.0 / self.x**2, 2.0 / self.x**3) * other

    def __pow__(self, n: float) -> Jet:
        return self._chain(self.x**n, n * self.x ** (n - 1), n * (n - 1) * self.x ** (n - 2))

    def __abs__(self) -> Jet:
        return self * sgn(self.x)

    def _chain(self, f: Any, df: Any, ddf: Any) -> Jet:
        """Jet of f(x) from f, f' and f'' at x."""
        return Jet(f, df * self.x_dot, df * self.x_ddot + ddf * self.x_dot**2)

    def sgn(self) -> Any:
        """Sign; at a zero the sign of the zero. Its derivatives are 0."""
        return Jet(sgn(self.x))

    def sin(self) -> Jet:
        """Sine."""
        s, c = np.sin(self.x), np.cos(self.x)
        return self._chain(s, c, -s)

    def cos(self) -> Jet:
        """Cosine."""
        s, c = np.sin(self.x), np.cos(self.x)
        return self._chain(c, -s, -c)

    def exp(self) -> Jet:
        """Exponential."""
        e = np.exp(self.x)
        return self._chain(e, e, e)

    def expm1(self) -> Jet:
        """Exponential minus 1."""
        e = np.exp(self.x)
        return self._chain(np.expm1(self.x), e, e)

    def log1p(self) -> Jet:
        """Logarithm of 1 plus the argument."""
        d = 1.0 / (1.0 + self.x)
        return self._chain(np.log1p(self.x), d, -d * d)

    def sqrt(self) -> Jet:
        """Square root."""
        return self**0.5

    def tanh(self) -> Jet:
        """Hyperbolic tangent."""
        t = np.tanh(self.x)
        d = 1.0 - t * t
        return self._chain(t, d, -2.0 * t * d)

    def arctan(self) -> Jet:
        """Inverse tangent."""
        d = 1.0 / (1.0 + self.x**2)
        return self._chain(np.arctan(self.x), d, -2.0 * self.x * d * d)


def jets(x: Any, x_dot: Any, x_ddot: Any) -> Any:
    """Array of jets from arrays of values and derivatives of one shape."""
    return np.frompyfunc(Jet, 3, 1)(x, x_dot, x_ddot)


def derivative(x: Any, order: int) -> np.ndarray:
    """Value (order 0), first or second time derivative of an array of jets; numbers in it are constants."""
    name = ("x", "x_dot", "x_ddot")[order]

    def one(jet: Any) -> Any:
        if isinstance(jet, Jet):
            return getattr(jet, name)
        return jet if order == 0 else 0.0

    out = np.frompyfunc(one, 1, 1)(np.asarray(x, dtype=object))
    floats = all(isinstance(v, (float, int, np.floating)) for v in np.ravel(out))
    return np.asarray(out, dtype=float) if floats else out
