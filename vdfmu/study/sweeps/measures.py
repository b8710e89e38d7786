"""Measures of a run of a parameter study: expressions of its signals, such as ``rms(trajectory.q_d - plant.q)``.

They are parsed as Python, but may contain only signals, numbers, the functions below, ``+ - * / **`` and comparisons.
"""

from __future__ import annotations

import ast
import operator
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vdfmu.base.errors import UsageError, VdfmuError
from vdfmu.base.text import error_text, nearest
from vdfmu.engine.results.results import Results
from vdfmu.study.sweeps.axes import OPTIONS

Array = NDArray[Any]


def _integral(x: Array, t: Array) -> Array:
    """Integral by the trapezoidal rule."""
    return np.tensordot(np.diff(t), 0.5 * (x[1:] + x[:-1]), 1)


def _at(x: Array, t: Array, time: float) -> Array:
    """Value at the first communication point at or after `time` [s]."""
    if not t[0] <= time <= t[-1]:
        raise ValueError(f"expected a time from {t[0]:g} to {t[-1]:g} s, got {time:g} s")
    return x[np.searchsorted(t, time - 1e-9 * t[-1])]


def _settling(x: Array, t: Array, band: float = 0.02) -> Array:
    """First time [s] after which a signal stays within `band` of its last value."""
    if not band > 0.0:
        raise ValueError(f"expected a band above 0, got {band:g}")
    outside = np.abs(x - x[-1]) > band
    last = len(t) - 1 - np.argmax(outside[::-1], axis=0)
    return np.where(outside.any(axis=0), t[np.minimum(last + 1, len(t) - 1)], t[0])


class MeasureFunction(NamedTuple):
    """A function in expressions of measures."""

    of: Callable[..., Array]
    unit: str | None = None
    """Unit of the value; None for the argument's unit, empty if that is not simple."""
    numbers: tuple[int, int] = (0, 0)
    """Smallest and largest number of arguments in addition to the signal."""
    elements: bool = False
    """Whether it reduces the elements of a signal instead of the time."""


REDUCTIONS = {
    "rms": MeasureFunction(lambda x, t: np.sqrt(np.mean(np.square(x), axis=0))),
    "mean": MeasureFunction(lambda x, t: np.mean(x, axis=0)),
    "std": MeasureFunction(lambda x, t: np.std(x, axis=0)),
    "max": MeasureFunction(lambda x, t: np.max(x, axis=0)),
    "min": MeasureFunction(lambda x, t: np.min(x, axis=0)),
    "peak": MeasureFunction(lambda x, t: np.max(np.abs(x), axis=0)),
    "first": MeasureFunction(lambda x, t: x[0]),
    "final": MeasureFunction(lambda x, t: x[-1]),
    "integral": MeasureFunction(_integral, ""),
    "at": MeasureFunction(_at, numbers=(1, 1)),
    "settling": MeasureFunction(_settling, "s", (0, 1)),
}
"""Functions over time, from a signal (m, ...) and times (m,) to (...)."""
_FUNCTIONS = REDUCTIONS | {
    "worst": MeasureFunction(lambda x: np.max(x, axis=-1), elements=True),  # over the elements, from (..., n) to (...)
    "least": MeasureFunction(lambda x: np.min(x, axis=-1), elements=True),
    "sum": MeasureFunction(lambda x: np.sum(x, axis=-1), elements=True),
    "norm": MeasureFunction(lambda x: np.linalg.norm(x, axis=-1), elements=True),
    "abs": MeasureFunction(np.abs),  # element by element
    "degrees": MeasureFunction(np.degrees, "deg"),
    **{name: MeasureFunction(getattr(np, name), "") for name in ("sqrt", "exp", "log", "sin", "cos")},
}
"""All functions. A new one needs a row here or in `REDUCTIONS`."""
_TAKEN = ("point", "failed", "failed_at", "failed_in", "kind", "wall_s", "time", *OPTIONS)
"""Columns of a study that are not measures."""
_OPERATORS: dict[type, Callable[..., Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: operator.pow,
    ast.USub: operator.neg,
    ast.UAdd: operator.pos,
    ast.Lt: operator.lt,
    ast.Gt: operator.gt,
    ast.LtE: operator.le,
    ast.GtE: operator.ge,
}
_KEEPING = (ast.Add, ast.Sub, ast.USub, ast.UAdd)
"""Operators whose value has the unit of the operands."""


@dataclass(frozen=True)
class Measure:
    """A named expression, or a function of the results."""

    name: str
    """Name of the column; several elements have ``name[1]``, ``name[2]`` and so on."""
    text: str
    """The expression, or the name of the function."""
    signals: tuple[str, ...]
    """Required signals, ``plant.q[1]``, or all elements, ``plant.q``; for a function those in its attribute `signals`,
    by default all, ``*``."""
    function: Callable[[Results], Any] | None = None
    """Called with the `Results`; returns a number, or several.

    If its attribute `loops` is true, the run is linearised at some of its rows, and the summary of the results contains
    ``loops``, the :class:`~vdfmu.engine.linear.growth.Poses`."""

    def of(self, results: Results) -> dict[str, float]:
        """Return the value or values by column; UsageError if a signal is missing, or if a value is not a number."""
        try:
            if self.function is not None:
                array = np.asarray(self.function(results), dtype=float)
            else:
                with np.errstate(all="ignore"):
                    array = np.asarray(_read(self.text).of(results), dtype=float)
            if array.ndim > 1 or not array.size:
                raise ValueError(f"expected a number or a vector of numbers, got the shape {array.shape}")
        except Exception as error:  # the user's function may raise any
            plain = isinstance(error, VdfmuError) or self.function is None and isinstance(error, ValueError)
            kind = "" if plain else f"{type(error).__name__}: "
            words = f"{kind}{error_text(error)}".removesuffix(".")
            raise UsageError(f"measure {self.name} = {self.text}: {words}.") from None
        if array.ndim == 0:
            return {self.name: float(array)}
        return {f"{self.name}[{i}]": float(x) for i, x in enumerate(array, 1)}


def read_measures(measures: Mapping[str, Any] | Sequence[str]) -> list[Measure]:
    """Read ``NAME=EXPRESSION``, or name to expression or function. UsageError has a line for each faulty one."""
    if isinstance(measures, Mapping):
        pairs = list(measures.items())
    else:
        pairs = [(name.strip(), text.strip()) for name, _, text in (m.partition("=") for m in measures)]
    listed: list[Measure] = []
    problems: list[str] = []
    for name, text in pairs:
        if not name.isidentifier() or not (callable(text) or isinstance(text, str) and text):
            problems.append(f"measure {name}: expected NAME=EXPRESSION, such as error=rms(trajectory.q_d - plant.q).")
            continue
        if name in _TAKEN:
            problems.append(f"measure {name}: expected another name; {', '.join(_TAKEN)} are other columns.")
            continue
        if callable(text):
            needs = tuple(getattr(text, "signals", ("*",)))
            listed.append(Measure(name, getattr(text, "__qualname__", "function"), needs, text))
            continue
        try:
            read = _read(text)
            signals = tuple(dict.fromkeys(read.signals))
            if not signals:
                raise ValueError("expected a signal in it, such as plant.q")
            if read.over_time:
                raise ValueError(f"expected one value for all times; put {', '.join(REDUCTIONS)} around it")
            listed.append(Measure(name, text, signals))
        except (ValueError, SyntaxError, RecursionError, MemoryError) as error:
            words = error.msg if isinstance(error, SyntaxError) else str(error)
            if isinstance(error, (RecursionError, MemoryError)):
                words = "expected a shorter expression; a function in Python may be of any length"
            problems.append(f"measure {name}: {words}; got {text}.")
    counts = Counter(measure.name for measure in listed)
    problems += [f"measure {name}: expected once." for name, n in counts.items() if n > 1]
    if problems:
        raise UsageError("\n".join(problems))
    return listed


def measured(measures: Sequence[Measure], results: Results) -> dict[str, float]:
    """Values of all measures by column."""
    return {column: value for measure in measures for column, value in measure.of(results).items()}


def unit_of(measure: Measure, units: Mapping[str, str]) -> str:
    """Return a measure's unit from `units` of signals and arrays; empty if it is not simple, as for products."""
    return "" if measure.function is not None else _read(measure.text).unit(units)


class _Term(NamedTuple):
    """A part of an expression, and how its value and unit follow from those of the signals."""

    of: Callable[[Results], Any]
    unit: Callable[[Mapping[str, str]], str] = lambda units: ""
    signals: tuple[str, ...] = ()
    over_time: bool = False
    """Whether it has a value for each time."""


@lru_cache
def _read(text: str) -> _Term:
    return _term(ast.parse(text, mode="eval").body)


def _term(node: ast.expr) -> _Term:
    """Read a part; ValueError for anything but signals, numbers, functions and operators."""
    if (name := _signal(node)) is not None:
        values = lambda results: results[name].astype(float, copy=False)  # noqa: E731
        return _Term(values, lambda units: units.get(name, ""), (name,), True)
    match node:
        case ast.Constant(int() | float() as value):
            return _Term(lambda _: float(value))  # powers of Python's integers could have any number of digits
        case ast.Call(ast.Name(name), [_, *_], []):
            return _call(node, name)
        case ast.BinOp(left, op, right) | ast.Compare(left, [op], [right]) if type(op) in _OPERATORS:
            operands = [left, right]
        case ast.UnaryOp(op, operand) if type(op) in _OPERATORS:
            operands = [operand]
        case _:
            raise ValueError(f"expected signals, numbers and functions, got {ast.unparse(node)}")
    # a generator needs a stack frame, so an expression too deep to evaluate is already too deep to parse
    first, *more = terms = tuple(_term(each) for each in operands)

    def of(results: Results) -> Any:
        return _OPERATORS[type(op)](first.of(results), *(term.of(results) for term in more))

    def unit(units: Mapping[str, str]) -> str:
        of_first = first.unit(units) if isinstance(op, _KEEPING) else ""
        return of_first if of_first and all(term.unit(units) == of_first for term in more) else ""

    signals = tuple(signal for term in terms for signal in term.signals)
    return _Term(of, unit, signals, any(term.over_time for term in terms))


def _call(node: ast.Call, name: str) -> _Term:
    """Read the call of a function."""
    if name not in _FUNCTIONS:
        names = nearest(name, [*_FUNCTIONS]).rstrip(".")
        raise ValueError(f"expected a known function, got {name}. {names}")
    function, reduces = _FUNCTIONS[name], name in REDUCTIONS
    least, most = function.numbers
    if not least <= len(node.args) - 1 <= most:
        count = f"{1 + least} to {1 + most}" if least < most else str(1 + most)
        raise ValueError(f"expected {count} arguments of {name}, got {len(node.args)}")
    first, *further = map(_term, node.args)
    if reduces and not first.over_time:
        raise ValueError(f"expected a signal over time in {name}, got {ast.unparse(node.args[0])}")
    if any(term.signals for term in further):
        raise ValueError(f"expected a number after the signal of {name}, got {ast.unparse(node.args[1])}")

    def of(results: Results) -> Any:
        value, *numbers = (term.of(results) for term in (first, *further))
        if function.elements and np.ndim(value) < 1 + first.over_time:
            raise ValueError(f"expected a signal of several elements in {name}, got {ast.unparse(node.args[0])}")
        return function.of(value, *([results.time] if reduces else []), *numbers)

    def unit(units: Mapping[str, str]) -> str:
        return first.unit(units) if function.unit is None else function.unit

    return _Term(of, unit, first.signals, first.over_time and not reduces)


def _signal(node: ast.expr) -> str | None:
    """Return the name of a signal, ``plant.q`` or ``plant.q[1]``; None if it is not a signal."""
    if isinstance(node, ast.Subscript):
        name = _signal(node.value)
        indices = node.slice.elts if isinstance(node.slice, ast.Tuple) else [node.slice]
        if name is None or not all(isinstance(i, ast.Constant) and isinstance(i.value, int) for i in indices):
            return None
        return f"{name}[{','.join(ast.unparse(i) for i in indices)}]"
    if isinstance(node, ast.Attribute):
        parent = node.value.id if isinstance(node.value, ast.Name) else _signal(node.value)
        return None if parent is None else f"{parent}.{node.attr}"
    return None
