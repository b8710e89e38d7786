"""Linear systems, inverses and exponentials of matrices, on floats and, for fixed sizes, on symbols.

On floats numpy and scipy calculate them. On symbols there is no branch, and no loop that ends by a value: ``where``
exchanges rows and keeps squarings, so a trace has all cases, and its derivatives belong to the case at hand.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from vdfmu.base.errors import UsageError
from vdfmu.compiler.scalar.elimination import is_zero
from vdfmu.compiler.scalar.generic import maximum, where
from vdfmu.compiler.scalar.symbol import SymbolArray, instead_of

_SQUARINGS = 12
"""Most squarings of `expm`."""
_DEGREE = 18
"""Degree of the Taylor polynomial of `expm`, for matrices of norm 1: its error is below 1/19! = 8e-18."""


@instead_of(np.linalg.solve)
def solve(A: Any, b: Any) -> Any:
    """Solve ``A x = b`` by elimination with partial pivoting.

    On symbols it takes about n^3 operations and n^2 (n + k) choices, for k right-hand sides; a matrix that is singular
    gives infinity or NaN there, which no FMU takes for a state or an input.

    Parameters
    ----------
    A : (n, n)
    b : (n,) or (n, k)

    Raises
    ------
    UsageError
        For other shapes.
    numpy.linalg.LinAlgError
        On floats, for a matrix that is singular.
    """
    A, b = np.asarray(A), np.asarray(b)
    if A.ndim != 2 or A.shape[0] != A.shape[1] or b.ndim not in (1, 2) or len(b) != len(A):
        raise UsageError(f"solve: expected shapes (n, n) and (n,) or (n, k), got {A.shape} and {b.shape}.")
    if object not in (A.dtype, b.dtype):
        return np.linalg.solve(A, b)
    n = len(A)
    rows = np.concatenate([A, b.reshape(n, -1)], axis=1).astype(object)
    for k in range(n):
        for i in range(k + 1, n):  # the largest of the column comes to the diagonal
            if not is_zero(rows[i, k]):
                _exchange(rows, k, i)
        for i in range(k + 1, n):
            if not is_zero(rows[i, k]):
                rows[i, k + 1 :] -= rows[i, k] / rows[k, k] * rows[k, k + 1 :]
    x = rows[:, n:]
    for k in reversed(range(n)):
        for j in range(k + 1, n):
            if not is_zero(rows[k, j]):
                x[k] -= rows[k, j] * x[j]
        x[k] = x[k] / rows[k, k]
    return x.reshape(b.shape).view(SymbolArray)


@instead_of(np.linalg.inv)
def inv(A: Any) -> Any:
    """Return the inverse of a matrix (n, n); :func:`solve` says how."""
    return solve(A, np.eye(len(A)))


def expm(A: Any) -> Any:
    """Return the exponential of a matrix, (n, n), of a 1-norm up to 4096.

    A Taylor polynomial of degree 18 at ``A / 2^s``, of norm up to 1, and s squarings; on floats scipy's. A
    larger norm gives NaN on symbols.

    Raises
    ------
    UsageError
        For another shape; on floats, for a larger norm.
    """
    A = np.asarray(A)
    if A.ndim != 2 or A.shape[0] != A.shape[1]:
        raise UsageError(f"expm: expected the shape (n, n), got {A.shape}.")
    norm: Any = 0.0
    for column in A.T:
        norm = maximum(norm, np.sum(np.abs(column)))
    largest = 2.0**_SQUARINGS
    if A.dtype != object:
        from scipy.linalg import expm as expm_of_floats

        if not norm <= largest:
            raise UsageError(f"expm: expected a matrix of a norm up to {largest:g}, got {norm:g}.")
        return expm_of_floats(A)
    factor = where(norm <= largest, 1.0, np.nan)
    for s in range(_SQUARINGS):
        factor = where(norm > 2.0**s, 0.5 * factor, factor)
    A = A * factor
    one = np.eye(len(A))
    A2 = A @ A
    A3 = A2 @ A
    # six powers at a time: Horner's rule in A^3, with polynomials of degree 2 as coefficients
    c = np.cumprod([1.0, *(1.0 / np.arange(1, _DEGREE + 1))])
    E: Any = c[_DEGREE] * one
    for k in range(_DEGREE - 3, -1, -3):
        E = E @ A3 + (c[k] * one + c[k + 1] * A + c[k + 2] * A2)
    for s in range(_SQUARINGS):
        E = where(norm > 2.0**s, E @ E, E)
    return np.asarray(E).view(SymbolArray)


def _exchange(rows: np.ndarray, k: int, i: int) -> None:
    """Exchange two rows, from column k on, where the second has the larger element in that column."""
    upper, lower = rows[k, k:].copy(), rows[i, k:].copy()
    larger = abs(lower[0]) > abs(upper[0])
    rows[k, k:], rows[i, k:] = where(larger, lower, upper), where(larger, upper, lower)
