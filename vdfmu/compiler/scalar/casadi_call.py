"""A CasADi function called from the method of a unit, on floats and on symbols."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from vdfmu.base.errors import UsageError
from vdfmu.compiler.scalar.symbol import from_sx, to_sx


def casadi_call(function: ca.Function, *arguments: Any) -> Any:
    """Call a CasADi function with numbers, or with the symbols of a trace.

    Parameters
    ----------
    function : casadi.Function
        ``function.expand()`` must be possible.
    *arguments : array_like
        One for each input: () for 1 by 1, (m,) for m by 1, else (m, k).

    Returns
    -------
    array, or tuple of them
        The output, or outputs, in such shapes.

    Raises
    ------
    UsageError
        For another number of arguments, or other shapes.
    """
    if len(arguments) != function.n_in():
        raise UsageError(f"{function.name()}: expected {function.n_in()} arguments, got {len(arguments)}.")
    arrays = [np.asarray(one) for one in arguments]
    traced = any(one.dtype == object for one in arrays)
    given: list[Any] = []
    for k, array in enumerate(arrays):
        size = function.size_in(k)
        if array.shape != shape_of(size):
            raise UsageError(
                f"{function.name()}: input {function.name_in(k)}: expected shape {shape_of(size)}, got {array.shape}."
            )
        array = array.reshape(size)
        given.append(ca.reshape(to_sx(array.T), *size) if traced else ca.DM(array.astype(float)))
    found: list[Any] = function.call(given)
    results = [(from_sx(one) if traced else one.full()).reshape(shape_of(one.shape))[()] for one in found]
    return results[0] if len(results) == 1 else tuple(results)


def shape_of(size: tuple[int, int]) -> tuple[int, ...]:
    """Return the shape of an array for a matrix of CasADi."""
    return size if size[1] != 1 else () if size[0] == 1 else size[:1]
