"""Passes along a chain, in which each part passes values to the next, outward to the end or inward to the base.

On floats, and in the trace of a short chain, a pass is a loop. In the trace of one part of a long chain, the values
that it receives are symbols, so that one trace serves all equal parts.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from vdfmu.compiler.scalar.jet import Jet
from vdfmu.compiler.scalar.symbol import from_sx, to_sx

Step = Callable[[Any, int], tuple[Any, Any]]
"""Function of the values from the previous part and of the part's number that returns the values passed on and the
result."""


def outward(step: Step, carry: Any, n: int) -> tuple[Any, list[Any]]:
    """Run `step` from part 0 to part n - 1; return the values that the last part passes on, and all results."""
    return _run(step, carry, n, inward=False)


def inward(step: Step, carry: Any, n: int) -> tuple[Any, list[Any]]:
    """Run `step` from part n - 1 to part 0; return the values that part 0 passes on, and all results, part 0 first."""
    return _run(step, carry, n, inward=True)


def total(values: Any, first: Any = None) -> Any:
    """Return the sum over the parts, plus `first` if given; a scalar is already the sum."""
    if np.ndim(values) == 0:
        return values if first is None else first + values
    if _recorder.get() is None:
        return np.sum(values) if first is None else sum(values, first)
    return outward(lambda carry, i: (carry + values[i], None), 0.0 if first is None else first, len(values))[0]


class HandedOn(NamedTuple):
    """The values that the parts of a chain pass on, as columns of SX."""

    inward: bool
    first: ca.SX
    """The values with which the pass begins."""
    before: ca.SX
    """Symbols of the values from the previous part."""
    after: ca.SX
    """The values that the part passes on."""
    last: ca.SX
    """Symbols of the values that the last part passes on."""


_recorder: ContextVar[list[HandedOn] | None] = ContextVar("recorder", default=None)


@contextmanager
def recording() -> Generator[list[HandedOn]]:
    """Record the passes of a chain of one part, in order."""
    passes: list[HandedOn] = []
    token = _recorder.set(passes)
    try:
        yield passes
    finally:
        _recorder.reset(token)


def _run(step: Step, carry: Any, n: int, inward: bool) -> tuple[Any, list[Any]]:
    passes = _recorder.get()
    if passes is not None:
        return _recorded(passes, step, carry, inward)
    results: list[Any] = [None] * n
    for i in reversed(range(n)) if inward else range(n):
        carry, results[i] = step(carry, i)
    return carry, results


def _recorded(passes: list[HandedOn], step: Step, carry: Any, inward: bool) -> tuple[Any, list[Any]]:
    form = _joined(step(carry, 0)[0], carry)
    size = len(list(_scalars(form, form)))
    before, last = ca.SX.sym("before", size), ca.SX.sym("last", size)
    after, result = step(_filled(form, iter(from_sx(before))), 0)
    first, after = (to_sx(list(_scalars(form, value))) for value in (carry, after))
    passes.append(HandedOn(inward, first, before, after, last))
    return _filled(form, iter(from_sx(last))), [result]


def _joined(form: Any, carry: Any) -> Any:
    """Return the union of two forms, because a pass may start with None instead of some values."""
    if form is None or carry is None:
        return carry if form is None else form
    if isinstance(form, tuple):
        return _made(form, [_joined(*pair) for pair in zip(form, carry, strict=True)])
    return form


def _made(form: Any, parts: list[Any]) -> Any:
    return type(form)(*parts) if hasattr(form, "_fields") else tuple(parts)


def _scalars(form: Any, value: Any) -> Iterator[Any]:
    """Yield the scalars of `value`, which is structured like `form`; zeros where it is None."""
    if isinstance(form, tuple):
        for part, each in zip(form, [None] * len(form) if value is None else value, strict=True):
            yield from _scalars(part, each)
    elif form is not None:
        elements = np.ravel(np.asarray(form, dtype=object))
        values = [0.0] * len(elements) if value is None else np.ravel(np.asarray(value, dtype=object))
        for element, scalar in zip(elements, values, strict=True):
            if isinstance(element, Jet):
                jet = scalar if isinstance(scalar, Jet) else Jet(scalar)
                yield from (jet.x, jet.x_dot, jet.x_ddot)
            else:
                yield scalar


def _filled(form: Any, scalars: Iterator[Any]) -> Any:
    """Return a value structured like `form` from its scalars: the inverse of :func:`_scalars`."""
    if isinstance(form, tuple):
        return _made(form, [_filled(part, scalars) for part in form])
    if form is None:
        return None
    array = np.empty(np.shape(form), dtype=object)
    for index in np.ndindex(array.shape):
        is_jet = isinstance(np.asarray(form, dtype=object)[index], Jet)
        array[index] = Jet(next(scalars), next(scalars), next(scalars)) if is_jet else next(scalars)
    return array[()]
