"""Gaussian elimination of sparse matrices, generic in what their elements are.

``numpy.linalg`` knows floats only. The elimination here takes its pivots on the diagonal, in order, and does
not swap rows: it is meant for matrices where that is safe (mass matrices are positive definite; a Rosenbrock
matrix ``I/(h gamma) - J`` tends to a multiple of the identity as the step h shrinks, and a bad pivot shows up
in the step's own error estimate). Structural zeros are skipped, so that a trace of it has the length of a
sparse elimination.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from vdfmu.base.errors import KernelError

Rows = list[dict[int, Any]]
"""A matrix (n, n): of each row, column to element, without zeros."""


def is_zero(x: Any) -> bool:
    """Whether an element is 0 whatever the values are."""
    known = getattr(x, "is_zero", None)
    return known() if known is not None else bool(x == 0.0)


def sparse(n: int, elements: Iterable[tuple[int, int, Any]]) -> Rows:
    """Return a matrix (n, n) of elements (row, column, element)."""
    rows: Rows = [{} for _ in range(n)]
    for i, j, element in elements:
        if not is_zero(element):
            rows[i][j] = element
    return rows


def sparse_of(A: np.ndarray) -> Rows:
    """Return a matrix from an array (n, n)."""
    return sparse(len(A), ((i, j, A[i, j]) for i in range(len(A)) for j in range(len(A))))


def factorize(A: Rows) -> Rows:
    """LU factors of `A` in one matrix: U on and above the diagonal, the multipliers of L below it.

    Raises
    ------
    KernelError
        If a row has no pivot whatever the values are.
    """
    LU = [dict(row) for row in A]
    below: list[set[int]] = [set() for _ in LU]  # by column
    for i, row in enumerate(LU):
        for j in row:
            if j < i:
                below[j].add(i)
    for k, pivots in enumerate(LU):
        if k not in pivots:
            raise KernelError(f"row {k + 1} of a matrix has no pivot: its element on the diagonal is always 0.")
        columns = sorted(j for j in pivots if j > k)
        for i in sorted(below[k]):
            row = LU[i]
            row[k] = row[k] / pivots[k]
            for j in columns:
                product = row[k] * pivots[j]
                found = row[j] - product if j in row else -product
                if is_zero(found):
                    row.pop(j, None)
                    below[j].discard(i)
                else:
                    row[j] = found
                    if j < i:
                        below[j].add(i)
    return LU


def solve(LU: Rows, b: np.ndarray) -> np.ndarray:
    """Solve ``A x = b`` with the factors of :func:`factorize`; `b` is (n,)."""
    pivots = np.array([row[i] for i, row in enumerate(LU)])
    x = np.array(b, dtype=object if object in (pivots.dtype, np.asarray(b).dtype) else float)
    for i, row in enumerate(LU):
        for j in sorted(j for j in row if j < i):
            x[i] = x[i] - row[j] * x[j]
    for i in reversed(range(len(LU))):
        row = LU[i]
        for j in sorted(j for j in row if j > i):
            x[i] = x[i] - row[j] * x[j]
        x[i] = x[i] / row[i]
    return x
