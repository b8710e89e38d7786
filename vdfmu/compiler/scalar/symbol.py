"""A scalar symbol that numpy treats as an opaque object, so that the equations can be traced as written.

Bare ``casadi.SX`` scalars in numpy arrays lead to silent NaN on assignment into a float array, and to products that
turn into SX matrices. A `Symbol` refuses ``float()`` unless it is constant, and ``bool()`` always.
"""

from __future__ import annotations

import operator
import re
from collections.abc import Callable, Mapping
from contextvars import ContextVar
from functools import partial
from hashlib import sha256
from typing import Any, TypeVar

import casadi as ca
import numpy as np

from vdfmu.base.errors import KernelError, UsageError
from vdfmu.compiler.scalar.generic import clip, where

_Function = TypeVar("_Function", bound=Callable[..., Any])

refusals: ContextVar[list[Exception] | None] = ContextVar("refusals", default=None)
"""Errors that symbols raised since a list was set here. A method that catches one would take a different branch than on
floats, so the caller of the trace raises the first of them at the end."""


def refusal(error: Exception) -> Exception:
    """Add an error to `refusals` before it is raised."""
    if (kept := refusals.get()) is not None:
        kept.append(error)
    return error


_binary = ca.SX.binary
"""Operation of two scalars. CasADi's operators take seven times as long, because they look up types."""


def _sx(value: Any) -> ca.SX:
    return value.sx if isinstance(value, Symbol) else ca.SX(float(value))


def _rint(x: Any) -> Any:
    low = ca.floor(x)
    rest, odd = x - low, low - 2.0 * ca.floor(0.5 * low)
    return low + ca.logic_or(rest > 0.5, ca.logic_and(rest >= 0.5, odd))


def _log_to(base: float) -> Callable[[Any], Any]:
    """Return the logarithm to a base, exact at whole powers so that its floor is right."""

    def logarithm(x: Any) -> Any:
        whole = _rint(ca.log(x) / np.log(base))
        return whole + ca.log(x / base**whole) / np.log(base)

    return logarithm


def _remainder(a: Any, b: Any) -> Any:
    """Remainder with the sign of `b`, as in Python. It is exact, unlike ``a - b floor(a / b)``."""
    rest = ca.fmod(a, b)
    return rest + b * (rest * b < 0.0)


def _quotient(a: Any, b: Any) -> Any:
    return _rint((a - _remainder(a, b)) / b)


def _method(function: Callable[[ca.SX], ca.SX]) -> Callable[[Symbol], Symbol]:
    """Return the method of a function of one scalar, for numpy to call by its name."""
    return lambda symbol: Symbol(function(symbol.sx))


def _paired(function: Callable[[ca.SX, ca.SX], ca.SX]) -> Callable[[Symbol, Any], Symbol]:
    """Return the method of a function of two scalars."""
    return lambda a, b: Symbol(function(a.sx, _sx(b)))


def _operator(function: Callable[[ca.SX, ca.SX], ca.SX]) -> Callable[[Symbol, Any], Any]:
    """Return the method of an operator."""
    return lambda a, b: NotImplemented if _foreign(b) else Symbol(function(a.sx, _sx(b)))


def _reflected(function: Callable[[ca.SX, ca.SX], ca.SX]) -> Callable[[Symbol, Any], Any]:
    """Return the method of an operator with the symbol as second operand."""
    return lambda b, a: NotImplemented if _foreign(a) else Symbol(function(_sx(a), b.sx))


_ARITHMETIC = partial(_binary, ca.OP_SUB), partial(_binary, ca.OP_DIV), operator.pow, _quotient, _remainder


class _Dispatched:
    """Dispatches functions of numpy to the functions of symbols."""

    __slots__ = ()

    def __array_ufunc__(self, function: np.ufunc, method: str, *inputs: Any, **kwargs: Any) -> Any:
        return _elementwise(function, method, inputs, kwargs)

    def __array_function__(self, function: Any, types: Any, args: Any, kwargs: Any) -> Any:
        return _of_arrays(function, args, kwargs)


class Symbol(_Dispatched):
    """A scalar expression. Arithmetic, and functions that numpy calls by name, build larger expressions."""

    __slots__ = ("sx",)

    def __init__(self, sx: Any) -> None:
        self.sx = sx if isinstance(sx, ca.SX) else ca.SX(sx)  # a copy would take half the time of a trace

    def __repr__(self) -> str:
        text = str(self.sx)
        return f"Symbol({text if len(text) < 60 else text[:57] + '...'})"

    def __bool__(self) -> bool:
        raise refusal(
            KernelError(
                "a condition on a value is not known while equations are traced. Write it with where(condition, a, b), "
                "clip, minimum, maximum or sgn of vdfmu.unit"
            )
        )

    def __eq__(self, other: object) -> Any:
        return bool(self)  # raises, because numpy and Python would use the identity of objects instead

    __hash__ = None  # pyright: ignore[reportAssignmentType]

    def __float__(self) -> float:
        if not self.sx.is_constant():
            raise refusal(
                KernelError(
                    f"{self!r} has no value while equations are traced, so it cannot become a float. "
                    "Use numpy's functions, such as np.sin, instead of math's; of vdfmu.unit, interpolate for tables, "
                    "solve, inv and expm for matrices, and zeros(shape, *like) for an array that receives it"
                )
            )
        return float(self.sx)

    def is_zero(self) -> bool:
        """Whether the expression is the constant 0."""
        return bool(self.sx.is_zero())

    def __neg__(self) -> Symbol:
        return Symbol(-self.sx)

    def __add__(self, other: Any) -> Any:
        if other is ZERO or (type(other) in _NUMBERS and other == 0):
            return self
        if self is ZERO and type(other) is Symbol:
            return other
        return NotImplemented if _foreign(other) else Symbol(_binary(ca.OP_ADD, self.sx, _sx(other)))

    def __mul__(self, other: Any) -> Any:
        if other is ZERO or (type(other) in _NUMBERS and other == 0):
            return ZERO
        if type(other) in _NUMBERS and other == 1:
            return self
        if self is ZERO and type(other) is Symbol:
            return ZERO
        return NotImplemented if _foreign(other) else Symbol(_binary(ca.OP_MUL, self.sx, _sx(other)))

    __radd__, __rmul__ = __add__, __mul__
    __abs__, __floor__, __ceil__, __invert__ = map(_method, (ca.fabs, ca.floor, ca.ceil, ca.logic_not))

    __sub__, __truediv__, __pow__, __floordiv__, __mod__ = map(_operator, _ARITHMETIC)
    __rsub__, __rtruediv__, __rpow__, __rfloordiv__, __rmod__ = map(_reflected, _ARITHMETIC)
    __lt__, __le__, __gt__, __ge__ = map(_operator, (operator.lt, operator.le, operator.gt, operator.ge))
    __and__, __or__ = map(_operator, (ca.logic_and, ca.logic_or))
    __rand__, __ror__ = __and__, __or__

    def where(self, a: Any, b: Any) -> Symbol:
        """Return `a` if the symbol is not 0, else `b`."""
        return Symbol(ca.if_else(self.sx, _sx(a), _sx(b)))

    sin, cos, tan = map(_method, (ca.sin, ca.cos, ca.tan))
    arcsin, arccos, arctan = map(_method, (ca.asin, ca.acos, ca.atan))
    sinh, cosh, tanh = map(_method, (ca.sinh, ca.cosh, ca.tanh))
    exp, expm1, log, log1p = map(_method, (ca.exp, ca.expm1, ca.log, ca.log1p))
    arcsinh, arccosh, arctanh = map(_method, (ca.asinh, ca.acosh, ca.atanh))
    arctan2, hypot, minimum, maximum = map(_paired, (ca.atan2, ca.hypot, ca.fmin, ca.fmax))
    sqrt, rint, fabs = map(_method, (ca.sqrt, _rint, ca.fabs))
    sgn = _method(lambda x: ca.copysign(1.0, x))
    cbrt = _method(lambda x: ca.copysign(ca.fabs(x) ** (1.0 / 3.0), x))
    log2, log10, exp2 = map(_method, (_log_to(2.0), _log_to(10.0), lambda x: ca.SX(2.0) ** x))
    radians = deg2rad = _method(lambda x: x * (np.pi / 180.0))
    degrees = rad2deg = _method(lambda x: x * (180.0 / np.pi))
    trunc = __trunc__ = _method(lambda x: ca.copysign(ca.floor(ca.fabs(x)), x))

    def __pos__(self) -> Symbol:
        return self

    conjugate = __pos__

    def row_of(self, edges: Any, rows: Any) -> Any:
        """Return the row of a table for the interval that the symbol lies in."""
        rows = np.asarray(rows, dtype=float)
        table = lookup_function(np.asarray(edges, dtype=float), rows.reshape(len(rows), -1))
        row = from_sx(table(self.sx))
        return row if rows.ndim > 1 else row[0]


_NUMBERS = (float, int)
ZERO = Symbol(0.0)
"""Structural zero. Testing its identity takes a tenth of the time of CasADi's folding."""


class SymbolArray(_Dispatched, np.ndarray):
    """Array of symbols. Comparisons return an array of conditions for ``where``."""


def _pairs(function: Callable[[ca.SX, ca.SX], ca.SX]) -> np.ufunc:
    """Return a function of two scalars as a ufunc of numpy, with broadcasting and ``reduce``."""
    return np.frompyfunc(lambda a, b: Symbol(function(_sx(a), _sx(b))), 2, 1)


_ELEMENTWISE: Mapping[np.ufunc, np.ufunc] = {
    np.maximum: _pairs(ca.fmax), np.fmax: _pairs(ca.fmax), np.minimum: _pairs(ca.fmin), np.fmin: _pairs(ca.fmin),
    np.arctan2: _pairs(ca.atan2), np.hypot: _pairs(ca.hypot), np.copysign: _pairs(ca.copysign),
    np.fmod: _pairs(ca.fmod), np.float_power: _pairs(operator.pow),
    np.logical_and: _pairs(ca.logic_and), np.logical_or: _pairs(ca.logic_or),
    np.logical_not: np.frompyfunc(lambda a: Symbol(ca.logic_not(_sx(a))), 1, 1),
    np.heaviside: _pairs(lambda x, at_zero: ca.if_else(x == 0.0, at_zero, x > 0.0)),
    np.logaddexp: _pairs(lambda a, b: ca.fmax(a, b) + ca.log1p(ca.exp(-ca.fabs(a - b)))),
    np.sign: np.frompyfunc(lambda a: Symbol(ca.sign(_sx(a))), 1, 1),
}  # fmt: skip
"""Functions of numpy that compare objects, refuse them, or prefer a float's method to the symbol's."""
_COMPARISONS = (np.less, np.less_equal, np.greater, np.greater_equal)


def _elementwise(function: np.ufunc, method: str, inputs: tuple[Any, ...], kwargs: dict[str, Any]) -> Any:
    """Call an elementwise function of numpy on symbols and their arrays."""
    if function is np.matmul and method == "__call__" and not kwargs:
        a, b = inputs
        matrix, column = (a, b) if np.ndim(b) == 1 else (np.transpose(b), a)  # for a row, x @ W is W.T @ x
        if _is_large(matrix, column):
            return _with_symbols(from_sx(matrix_function(np.asarray(matrix, float))(to_sx(column))))
    if function in _COMPARISONS:
        kwargs["dtype"] = object
    if "out" in kwargs:
        kwargs["out"] = tuple(map(_plain, kwargs["out"]))
    try:
        result = getattr(_ELEMENTWISE.get(function, function), method)(*map(_plain, inputs), **kwargs)
    except TypeError as error:
        raise refusal(KernelError(f"np.{function.__name__} does not accept symbols: {error}")) from None
    return _with_symbols(result)


def _of_arrays(function: Any, args: tuple[Any, ...], kwargs: dict[str, Any]) -> Any:
    """Call another function of numpy on symbols and their arrays."""
    try:
        if function in _REPLACED:
            return _with_symbols(_REPLACED[function](*args, **kwargs))
        result = np.ndarray.__array_function__(np.empty(0), function, (np.ndarray,), args, kwargs)
    except TypeError as error:
        raise refusal(KernelError(f"{function.__name__} of numpy does not accept symbols: {error}")) from None
    return _with_symbols(result)


_REPLACED: dict[Any, Callable[..., Any]] = {np.where: where, np.clip: clip}
"""Functions of numpy that refuse symbols, to their replacement."""


def instead_of(function: Any) -> Callable[[_Function], _Function]:
    """Decorate the replacement of a function of numpy that refuses symbols."""

    def register(replacement: _Function) -> _Function:
        _REPLACED[function] = replacement
        return replacement

    return register


def _plain(value: Any) -> Any:
    """Return a symbol as an array, an array of symbols as a plain array."""
    if isinstance(value, Symbol):
        array = np.empty((), dtype=object)
        array[()] = value
        return array
    return value.view(np.ndarray) if isinstance(value, SymbolArray) else value


def _with_symbols(result: Any) -> Any:
    if isinstance(result, (tuple, list)):
        return type(result)(map(_with_symbols, result))
    return result.view(SymbolArray) if type(result) is np.ndarray and result.dtype == object else result


def _foreign(other: Any) -> bool:
    """Whether the other operand must handle the operation: an array, or a jet."""
    return isinstance(other, np.ndarray) or hasattr(other, "x_ddot")


LOOKUP = "lookup_"
"""Prefix of the names of table lookups."""


def lookup_function(edges: np.ndarray, rows: np.ndarray) -> ca.Function:
    """Return the function that looks up the row of `rows` (m, w) by interval of `edges` (m + 1,); its derivative is 0.

    A trace calls it for tables of any length. CasADi has no step function, but its binary search finds the place, and
    its linear interpolation is exact at integers.
    """
    m, w = rows.shape
    if m == 1:  # interpolation needs two points
        edges, rows, m = np.append(edges, edges[-1] + 1.0), np.repeat(rows, 2, axis=0), 2
    x = ca.MX.sym("x")
    place = ca.low(ca.DM(edges), x, {"lookup_mode": "binary"})
    values = ca.interpolant("rows", "linear", [np.arange(float(m))], w, {"lookup_mode": ["exact"]})
    name = LOOKUP + sha256(edges.tobytes() + rows.tobytes()).hexdigest()[:12]
    zero = ca.Function(
        f"jac_{name}", [x, ca.MX.sym("y", w)], [ca.MX(ca.DM.zeros(w, 1))], ["i0", "out_o0"], ["jac_o0_i0"]
    )
    options = {"never_inline": True, "custom_jacobian": zero, "enable_forward": False, "enable_reverse": False}
    return ca.Function(name, [x], [values(place, ca.MX(ca.DM(rows.ravel())))], options)


MATRIX = "matrix_"
"""Part of the names of products with a matrix. CasADi puts ``fwd1_`` or ``adj1_`` before it for derivatives."""
_LARGE = 2_048
"""Smallest matrix whose product is a call, in numbers: 45 rows and columns. Smaller ones are scalar operations."""


def _is_large(a: Any, b: Any) -> bool:
    """Return whether the factors are a large matrix of numbers and a column.

    For a column of states, operations are scalar whatever the size, so that a linear system's Jacobian has numbers.
    """
    if not (isinstance(a, np.ndarray) and a.dtype.kind in "fiu" and a.ndim == 2 and a.size >= _LARGE):
        return False
    leaves = [each.sx for each in b.flat if isinstance(each, Symbol) and each.sx.is_symbolic()] if np.ndim(b) else []
    return np.ndim(b) == 1 and not any(re.fullmatch(r"x_\d+", leaf.name()) for leaf in leaves)


def matrix_function(matrix: np.ndarray) -> ca.Function:
    """Return the product of a matrix (m, n) with a column. A trace calls it, because inline it is m n operations."""
    x = ca.MX.sym("x", matrix.shape[1])
    name = MATRIX + sha256(repr(matrix.shape).encode() + matrix.tobytes()).hexdigest()[:12]
    return ca.Function(name, [x], [ca.DM(matrix) @ x], {"never_inline": True})


def from_sx(expression: ca.SX) -> np.ndarray:
    """Return the symbols, (m,) or (m, k), of a column or a matrix. Structural zeros are :data:`ZERO`."""
    rows, columns = expression.shape
    array = np.full((rows, columns), ZERO, dtype=object)
    for i, j, value in zip(*expression.sparsity().get_triplet(), expression.nonzeros(), strict=True):
        array[i, j] = Symbol(value)
    return array[:, 0] if columns == 1 else array


def to_sx(values: Any) -> ca.SX:
    """Return the column of a scalar or an array of symbols and floats: a matrix row by row, as in FMI 3."""
    return ca.vertcat(*[_sx(v) for v in np.ravel(np.asarray(values, dtype=object))])


def casadi_call(function: ca.Function, *arguments: Any) -> Any:
    """Call a CasADi function with numbers, or with the symbols of a trace.

    Parameters
    ----------
    function : casadi.Function
        ``function.expand()`` must be possible.
    *arguments : array_like
        One per input: () for 1 by 1, (m,) for m by 1, else (m, k). UsageError for other shapes.

    Returns
    -------
    array or tuple of arrays
        The output or outputs, in the same form.
    """
    if len(arguments) != function.n_in():
        raise UsageError(f"{function.name()}: expected {function.n_in()} arguments, got {len(arguments)}.")
    arrays = list(map(np.asarray, arguments))
    traced = any(array.dtype == object for array in arrays)
    inputs: list[Any] = []
    for k, array in enumerate(arrays):
        size = function.size_in(k)
        if array.shape != (shape := shape_of(size)):
            raise UsageError(
                f"{function.name()}: input {function.name_in(k)}: expected shape {shape}, got {array.shape}."
            )
        array = array.reshape(size)
        inputs.append(ca.reshape(to_sx(array.T), *size) if traced else ca.DM(array.astype(float)))
    outputs: list[Any] = function.call(inputs)
    results = [(from_sx(x) if traced else x.full()).reshape(shape_of(x.shape))[()] for x in outputs]
    return results[0] if len(results) == 1 else tuple(results)


def shape_of(size: tuple[int, int]) -> tuple[int, ...]:
    """Return the shape of an array for a matrix of CasADi."""
    return size if size[1] != 1 else () if size[0] == 1 else size[:1]
