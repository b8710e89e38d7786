"""A scalar symbol that numpy treats as an opaque object, so that the equations trace as they are written.

Bare ``casadi.SX`` scalars in numpy arrays lead to silent NaN on assignment into a float array, and to
products that turn into SX matrices. A `Symbol` cannot: it refuses ``float()`` unless it is constant, and
``bool()`` always.
"""

from __future__ import annotations

import operator
from collections.abc import Callable
from hashlib import sha256
from typing import Any

import casadi as ca
import numpy as np

from vdfmu.errors import KernelError

_binary = ca.SX.binary
"""Operation of two scalars; CasADi's operators take seven times as long to find the types of theirs."""


def _sx(value: Any) -> ca.SX:
    return value.sx if isinstance(value, Symbol) else ca.SX(float(value))


def _rint(x: Any) -> Any:
    low = ca.floor(x)
    rest, odd = x - low, low - 2.0 * ca.floor(0.5 * low)
    return low + ca.logic_or(rest > 0.5, ca.logic_and(rest >= 0.5, odd))


def _remainder(a: Any, b: Any) -> Any:
    """Remainder with the sign of `b`, as in Python; exact, unlike ``a - b floor(a / b)``."""
    rest = ca.fmod(a, b)
    return rest + b * (rest * b < 0.0)


def _quotient(a: Any, b: Any) -> Any:
    return _rint((a - _remainder(a, b)) / b)


def _method(function: Callable[[ca.SX], ca.SX]) -> Callable[[Symbol], Symbol]:
    """Return the method of a function of one scalar; numpy calls it by its name."""
    return lambda symbol: Symbol(function(symbol.sx))


def _operator(function: Callable[[ca.SX, ca.SX], ca.SX]) -> Callable[[Symbol, Any], Any]:
    """Return the method of an operator."""
    return lambda a, b: NotImplemented if _foreign(b) else Symbol(function(a.sx, _sx(b)))


class Symbol:
    """One scalar expression. Arithmetic and the functions that numpy calls by name build larger ones."""

    __slots__ = ("sx",)

    def __init__(self, sx: Any) -> None:
        self.sx = sx if isinstance(sx, ca.SX) else ca.SX(sx)  # a copy takes half the time of a trace

    def __repr__(self) -> str:
        text = str(self.sx)
        return f"Symbol({text if len(text) < 60 else text[:57] + '...'})"

    def __bool__(self) -> bool:
        raise KernelError(
            "a condition on a value is not known while equations are traced. Write it with where(condition, a, b), "
            "clip, minimum, maximum or sgn of vdfmu.unit"
        )

    def __eq__(self, other: object) -> Any:
        return bool(self)  # raises: numpy and Python would take the identity of two objects for equality

    __hash__ = None  # pyright: ignore[reportAssignmentType]

    def __float__(self) -> float:
        if not self.sx.is_constant():
            raise KernelError(
                f"{self!r} has no value while equations are traced, so it cannot become a float. "
                "Take numpy's functions, np.sin, in place of math's, and interpolate of vdfmu.unit for a table; "
                "an array to put it into is zeros(shape, *like) of vdfmu.unit"
            )
        return float(self.sx)

    def is_zero(self) -> bool:
        """Whether the expression is the constant 0, a structural zero."""
        return bool(self.sx.is_zero())

    def __neg__(self) -> Symbol:
        return Symbol(-self.sx)

    def __add__(self, other: Any) -> Any:
        return NotImplemented if _foreign(other) else Symbol(_binary(ca.OP_ADD, self.sx, _sx(other)))

    def __sub__(self, other: Any) -> Any:
        return NotImplemented if _foreign(other) else Symbol(_binary(ca.OP_SUB, self.sx, _sx(other)))

    def __mul__(self, other: Any) -> Any:
        return NotImplemented if _foreign(other) else Symbol(_binary(ca.OP_MUL, self.sx, _sx(other)))

    def __truediv__(self, other: Any) -> Any:
        return NotImplemented if _foreign(other) else Symbol(_binary(ca.OP_DIV, self.sx, _sx(other)))

    __radd__, __rmul__ = __add__, __mul__
    __abs__, __floor__, __ceil__, __invert__ = map(_method, (ca.fabs, ca.floor, ca.ceil, ca.logic_not))

    def __rsub__(self, other: Any) -> Any:
        return NotImplemented if _foreign(other) else Symbol(_binary(ca.OP_SUB, _sx(other), self.sx))

    def __rtruediv__(self, other: Any) -> Any:
        return NotImplemented if _foreign(other) else Symbol(_binary(ca.OP_DIV, _sx(other), self.sx))

    __pow__, __floordiv__, __mod__ = map(_operator, (operator.pow, _quotient, _remainder))
    __lt__, __le__, __gt__, __ge__ = map(_operator, (operator.lt, operator.le, operator.gt, operator.ge))
    __and__, __or__ = map(_operator, (ca.logic_and, ca.logic_or))
    __rand__, __ror__ = __and__, __or__

    def __rpow__(self, base: Any) -> Symbol:
        return Symbol(_sx(base) ** self.sx)

    def __rfloordiv__(self, other: Any) -> Any:
        return NotImplemented if _foreign(other) else Symbol(_quotient(_sx(other), self.sx))

    def __rmod__(self, other: Any) -> Any:
        return NotImplemented if _foreign(other) else Symbol(_remainder(_sx(other), self.sx))

    def where(self, a: Any, b: Any) -> Symbol:
        """Return `a` where the symbol is not 0, else `b`."""
        return Symbol(ca.if_else(self.sx, _sx(a), _sx(b)))

    sin, cos, tan = map(_method, (ca.sin, ca.cos, ca.tan))
    arcsin, arccos, arctan = map(_method, (ca.asin, ca.acos, ca.atan))
    sinh, cosh, tanh = map(_method, (ca.sinh, ca.cosh, ca.tanh))
    exp, expm1, log, log1p = map(_method, (ca.exp, ca.expm1, ca.log, ca.log1p))
    sqrt, rint = map(_method, (ca.sqrt, _rint))

    def arctan2(self, x: Any) -> Symbol:
        """Angle of the point (x, self)."""
        return Symbol(ca.atan2(self.sx, _sx(x)))

    def sgn(self) -> Symbol:
        """Sign, that of the zero at zero."""
        return Symbol(ca.copysign(1.0, self.sx))

    def minimum(self, other: Any) -> Symbol:
        """Return the smaller of two."""
        return Symbol(ca.fmin(self.sx, _sx(other)))

    def maximum(self, other: Any) -> Symbol:
        """Return the larger of two."""
        return Symbol(ca.fmax(self.sx, _sx(other)))

    @staticmethod
    def clip_between(x: Any, low: Any, high: Any) -> Symbol:
        """Limit `x` to [`low`, `high`]; any of them may be a number."""
        return Symbol(ca.fmin(ca.fmax(_sx(x), _sx(low)), _sx(high)))

    def row_of(self, edges: Any, rows: Any) -> np.ndarray:
        """Return the row of a table of the interval that the symbol lies in."""
        table = lookup_function(np.asarray(edges, dtype=float), np.asarray(rows, dtype=float))
        return from_sx(table(self.sx))

    def hold_unit_interval(self) -> tuple[Symbol, Symbol]:
        """Limit the symbol to [0, 1]; with a factor that is 1 inside the interval and 0 outside."""
        inside = ca.logic_and(self.sx >= 0.0, self.sx <= 1.0)
        return Symbol(ca.fmin(ca.fmax(self.sx, 0.0), 1.0)), Symbol(inside)


class SymbolArray(np.ndarray):
    """Array of symbols that can be compared; the result is an array of conditions for ``where``."""

    def __array_wrap__(self, array: Any, context: Any = None, return_scalar: bool = False) -> Any:
        # numpy leaves what has no axis an array of a subclass, where it is a scalar of an ordinary array
        return array[()] if array.ndim == 0 else array.view(SymbolArray)

    def __array_function__(self, function: Any, types: Any, args: Any, kwargs: Any) -> Any:
        result = super().__array_function__(
            function, types, args, kwargs
        )  # concatenate and the like drop the class
        return result.view(SymbolArray) if type(result) is np.ndarray and result.dtype == object else result

    def __lt__(self, other: Any) -> Any:
        return np.less(self, other, dtype=object)

    def __le__(self, other: Any) -> Any:
        return np.less_equal(self, other, dtype=object)

    def __gt__(self, other: Any) -> Any:
        return np.greater(self, other, dtype=object)

    def __ge__(self, other: Any) -> Any:
        return np.greater_equal(self, other, dtype=object)


def _foreign(other: Any) -> bool:
    """Whether the other operand must handle the operation: an array, or a jet."""
    return isinstance(other, np.ndarray) or hasattr(other, "x_ddot")


LOOKUP = "lookup_"
"""Begin of the names of the functions that look rows of a table up."""


def lookup_function(edges: np.ndarray, rows: np.ndarray) -> ca.Function:
    """Return the row of the interval of `edges`, (m + 1,), in `rows`, (m, w); its derivative is 0.

    A trace calls it, whatever the length of the table. CasADi knows no function with steps: a place is found by its
    binary search, and taken from the rows by linear interpolation at a whole number, which is exact.
    """
    m, w = rows.shape
    if m == 1:  # which nothing can interpolate
        edges, rows, m = np.append(edges, edges[-1] + 1.0), np.repeat(rows, 2, axis=0), 2
    x = ca.MX.sym("x")
    place = ca.low(ca.DM(edges), x, {"lookup_mode": "binary"})
    values = ca.interpolant("rows", "linear", [np.arange(float(m))], w, {"lookup_mode": ["exact"]})
    name = LOOKUP + sha256(edges.tobytes() + rows.tobytes()).hexdigest()[:12]
    zero = ca.Function(
        f"jac_{name}", [x, ca.MX.sym("y", w)], [ca.MX(ca.DM.zeros(w, 1))], ["i0", "out_o0"], ["jac_o0_i0"]
    )
    options = {
        "never_inline": True,
        "custom_jacobian": zero,
        "enable_forward": False,
        "enable_reverse": False,
    }
    return ca.Function(name, [x], [values(place, ca.MX(ca.DM(rows.ravel())))], options)


def from_sx(expression: ca.SX) -> np.ndarray:
    """Object array of symbols from a column (m,) or a matrix (m, k) expression; structural zeros are one symbol."""
    rows, columns = expression.shape
    array = np.full((rows, columns), Symbol(0.0), dtype=object)
    for i, j, value in zip(*expression.sparsity().get_triplet(), expression.nonzeros(), strict=True):
        array[i, j] = Symbol(value)
    return array[:, 0] if columns == 1 else array


def to_sx(values: Any) -> ca.SX:
    """Column expression from a scalar or an array of symbols and floats, a matrix row by row, as in FMI 3."""
    return ca.vertcat(*[_sx(v) for v in np.ravel(np.asarray(values, dtype=object))])
