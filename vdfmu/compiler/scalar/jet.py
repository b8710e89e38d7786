"""Time derivatives by jets: scalars that carry a value and its first two time derivatives.

The exact inverse of the flexible plant needs two time derivatives of the rigid inverse dynamics. Run on arrays of jets,
the code of :mod:`vdfmu.arm.equations.inverse_dynamics` computes them without a second formula. Coefficients are floats
or symbols, so jets can be traced.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from vdfmu.compiler.scalar.generic import sgn


def _method(expansion: Callable[[Any], tuple[Any, Any, Any]]) -> Callable[[Jet], Jet]:
    """Return the method of a function f from its f, f' and f'' at x."""
    return lambda jet: jet.chain(*expansion(jet.x))


class Jet:
    """Value and first two time derivatives of a scalar, with arithmetic by the product and chain rules."""

    __slots__ = ("x", "x_dot", "x_ddot")

    def __init__(self, x: Any, x_dot: Any = 0.0, x_ddot: Any = 0.0) -> None:
        self.x, self.x_dot, self.x_ddot = x, x_dot, x_ddot

    def __repr__(self) -> str:
        return f"Jet({self.x!r}, {self.x_dot!r}, {self.x_ddot!r})"

    def __float__(self) -> float:
        raise TypeError("A jet is not a float: use derivative(jet, 0) for its value.")

    def __neg__(self) -> Jet:
        return Jet(-self.x, -self.x_dot, -self.x_ddot)

    def __add__(self, other: Any) -> Any:
        if isinstance(other, np.ndarray):
            return NotImplemented  # numpy then continues element by element
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
        return self * (other._reciprocal() if isinstance(other, Jet) else 1.0 / other)

    def __rtruediv__(self, other: Any) -> Jet:
        return self._reciprocal() * other

    def __pow__(self, n: float) -> Jet:
        return self.chain(self.x**n, n * self.x ** (n - 1), n * (n - 1) * self.x ** (n - 2))

    def __abs__(self) -> Jet:
        return self * sgn(self.x)

    def chain(self, f: Any, df: Any, ddf: Any) -> Jet:
        """Jet of f(x) from f, f' and f'' at x."""
        return Jet(f, df * self.x_dot, df * self.x_ddot + ddf * self.x_dot**2)

    def sgn(self) -> Any:
        """Sign, at a zero the sign of the zero; its derivatives are 0."""
        return Jet(sgn(self.x))

    def sqrt(self) -> Jet:
        """Square root."""
        return self**0.5

    _reciprocal = _method(lambda x: (1.0 / x, -1.0 / x**2, 2.0 / x**3))
    sin = _method(lambda x: (s := np.sin(x), np.cos(x), -s))
    cos = _method(lambda x: (c := np.cos(x), -np.sin(x), -c))
    exp = _method(lambda x: (e := np.exp(x), e, e))
    expm1 = _method(lambda x: (np.expm1(x), e := np.exp(x), e))
    log1p = _method(lambda x: (np.log1p(x), d := 1.0 / (1.0 + x), -d * d))
    tanh = _method(lambda x: (t := np.tanh(x), d := 1.0 - t * t, -2.0 * t * d))
    arctan = _method(lambda x: (np.arctan(x), d := 1.0 / (1.0 + x**2), -2.0 * x * d * d))


def jets(x: Any, x_dot: Any, x_ddot: Any) -> Any:
    """Array of jets from arrays of values and derivatives of one shape."""
    return np.frompyfunc(Jet, 3, 1)(x, x_dot, x_ddot)


def derivative(x: Any, order: int) -> np.ndarray:
    """Value (order 0), first or second time derivative of an array of jets. Numbers in it are constants."""
    name = Jet.__slots__[order]

    def element(value: Any) -> Any:
        return getattr(value, name) if isinstance(value, Jet) else 0.0 if order else value

    out = np.frompyfunc(element, 1, 1)(np.asarray(x, dtype=object))
    floats = all(isinstance(v, (float, int, np.floating)) for v in np.ravel(out))
    return np.asarray(out, dtype=float) if floats else out
