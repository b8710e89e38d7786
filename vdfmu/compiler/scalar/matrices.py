"""Linear systems, inverses and exponentials of matrices, on floats and, for fixed sizes, on symbols.

On floats numpy and scipy calculate :func:`solve`, :func:`inv` and :func:`expm`. On symbols no branch may depend on a
value, so ``where`` exchanges rows and selects squarings: a trace contains all cases, and its derivatives are those of
the current case.

:func:`factorize` uses the diagonal elements as pivots, in order, for matrices that need no exchange of rows: mass
matrices are positive definite, and a Rosenbrock matrix ``I/(h gamma) - J`` tends to a multiple of the identity as the
step h shrinks, while a bad pivot shows up in the step's error estimate. Structural zeros are skipped, so a trace is as
short as a sparse elimination.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import reduce
from typing import Any

import numpy as np

from vdfmu.base.errors import KernelError, UsageError
from vdfmu.compiler.scalar.generic import maximum, where
from vdfmu.compiler.scalar.symbol import SymbolArray, instead_of

Rows = list[dict[int, Any]]
"""Sparse matrix (n, n): column to element of each row, without zeros."""
_SQUARINGS = 12
"""Most squarings of `expm`."""
_DEGREE = 18
"""Degree of the Taylor polynomial of `expm`, for matrices of norm 1: its error is below 1/19! = 8e-18."""


def is_zero(x: Any) -> bool:
    """Return whether an element is 0 for all values of the symbols."""
    return x.is_zero() if hasattr(x, "is_zero") else bool(x == 0.0)


def sparse(n: int, elements: Iterable[tuple[int, int, Any]]) -> Rows:
    """Return a sparse matrix (n, n) from elements (row, column, element)."""
    rows: Rows = [{} for _ in range(n)]
    for i, j, element in elements:
        if not is_zero(element):
            rows[i][j] = element
    return rows


def factorize(A: Rows | np.ndarray) -> Rows:
    """Return the LU factors of `A` (n, n) in one matrix: U above the diagonal, the multipliers of L below it.

    The diagonal contains the reciprocals of the pivots, because a division takes as long as five products. KernelError
    if a pivot is 0 for all values of the symbols.
    """
    LU = [dict(row) for row in A] if isinstance(A, list) else sparse(len(A), ((*i, x) for i, x in np.ndenumerate(A)))
    below: list[set[int]] = [set() for _ in LU]  # by column
    for i, row in enumerate(LU):
        for j in row:
            if j < i:
                below[j].add(i)
    for k, pivots in enumerate(LU):
        if k not in pivots:
            raise KernelError(f"row {k + 1} of a matrix has no pivot: its element on the diagonal is always 0.")
        pivots[k] = 1.0 / pivots[k]
        columns = sorted(j for j in pivots if j > k)
        for i in sorted(below[k]):
            row = LU[i]
            row[k] = row[k] * pivots[k]
            for j in columns:
                product = row[k] * pivots[j]
                element = row[j] - product if j in row else -product
                if is_zero(element):
                    row.pop(j, None)
                    below[j].discard(i)
                else:
                    row[j] = element
                    if j < i:
                        below[j].add(i)
    return LU


def solve_factorized(LU: Rows, b: np.ndarray) -> np.ndarray:
    """Solve ``A x = b`` for `b` (n,) with the factors of :func:`factorize`."""
    reciprocals = np.array([row[i] for i, row in enumerate(LU)])
    x = np.array(b, dtype=object if object in (reciprocals.dtype, np.asarray(b).dtype) else float)
    for i, row in enumerate(LU):
        for j in sorted(j for j in row if j < i):
            x[i] = x[i] - row[j] * x[j]
    for i in reversed(range(len(LU))):
        row = LU[i]
        for j in sorted(j for j in row if j > i):
            x[i] = x[i] - row[j] * x[j]
        x[i] = x[i] * row[i]
    return x


@instead_of(np.linalg.solve)
def solve(A: Any, b: Any) -> Any:
    """Solve ``A x = b`` by elimination with partial pivoting.

    On symbols it takes about n^3 operations and n^2 (n + k) choices for k right-hand sides. A singular matrix gives
    infinity or NaN on symbols. FMUs reject these as states and inputs.

    Parameters
    ----------
    A : (n, n)
    b : (n,) or (n, k)
        UsageError for other shapes, numpy.linalg.LinAlgError for a singular matrix of floats.
    """
    A, b = np.asarray(A), np.asarray(b)
    if A.ndim != 2 or A.shape[0] != A.shape[1] or b.ndim not in (1, 2) or len(b) != len(A):
        raise UsageError(f"solve: expected shapes (n, n) and (n,) or (n, k), got {A.shape} and {b.shape}.")
    if object not in (A.dtype, b.dtype):
        return np.linalg.solve(A, b)
    n = len(A)
    rows = np.concatenate([A, b.reshape(n, -1)], axis=1).astype(object)
    for k in range(n):
        for i in range(k + 1, n):  # the largest element of the column is moved to the diagonal
            if not is_zero(rows[i, k]):
                upper, lower = rows[k, k:].copy(), rows[i, k:].copy()
                larger = abs(lower[0]) > abs(upper[0])
                rows[k, k:], rows[i, k:] = where(larger, lower, upper), where(larger, upper, lower)
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
    """Return the inverse of a matrix (n, n), see :func:`solve`."""
    return solve(A, np.eye(len(A)))


def expm(A: Any) -> Any:
    """Return the exponential of a matrix (n, n) with a 1-norm up to 4096.

    On symbols: a Taylor polynomial of degree 18 at ``A / 2^s``, of norm up to 1, and s squarings. A larger norm results
    in NaN on symbols, and in a UsageError on floats, as another shape does.
    """
    A = np.asarray(A)
    if A.ndim != 2 or A.shape[0] != A.shape[1]:
        raise UsageError(f"expm: expected the shape (n, n), got {A.shape}.")
    norm: Any = reduce(maximum, (np.sum(np.abs(column)) for column in A.T), 0.0)
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
    identity = np.eye(len(A))
    A2 = A @ A
    A3 = A2 @ A
    # six powers at a time: Horner's rule in A^3, with polynomials of degree 2 as coefficients
    c = np.cumprod([1.0, *(1.0 / np.arange(1, _DEGREE + 1))])
    E: Any = c[_DEGREE] * identity
    for k in range(_DEGREE - 3, -1, -3):
        E = E @ A3 + (c[k] * identity + c[k + 1] * A + c[k + 2] * A2)
    for s in range(_SQUARINGS):
        E = where(norm > 2.0**s, E @ E, E)
    return np.asarray(E).view(SymbolArray)
