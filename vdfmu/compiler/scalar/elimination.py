"""Gaussian elimination in plain numpy, generic in dtype.

``numpy.linalg`` knows floats only. The elimination here takes its pivots on the diagonal, in order, and does
not swap rows: it is meant for matrices where that is safe (mass matrices are positive definite; a Rosenbrock
matrix ``I/(h gamma) - J`` tends to a multiple of the identity as the step h shrinks, and a bad pivot shows up
in the step's own error estimate). Structural zeros are skipped, so that a trace of it has the length of a
sparse elimination.
"""

from __future__ import annotations

from typing import Any

import numpy as np


def is_zero(x: Any) -> bool:
    """Whether an element is 0 whatever the values are."""
    known = getattr(x, "is_zero", None)
    return known() if known is not None else bool(x == 0.0)


def pattern(A: np.ndarray) -> np.ndarray:
    """Where a matrix is not a structural zero, (n, n)."""
    elements = list(A.flat)
    filled = {id(x): not is_zero(x) for x in {id(x): x for x in elements}.values()}  # structural zeros are one object
    return np.array([filled[id(x)] for x in elements], dtype=bool).reshape(A.shape)


def factorize(A: np.ndarray) -> np.ndarray:
    """LU factors of `A` in one array: U on and above the diagonal, the multipliers of L below it.

    Parameters
    ----------
    A : (n, n); not changed
    """
    LU = np.array(A)
    filled = pattern(LU)
    for k in range(len(LU)):
        columns = k + 1 + np.flatnonzero(filled[k, k + 1 :])
        for i in k + 1 + np.flatnonzero(filled[k + 1 :, k]):
            LU[i, k] = LU[i, k] / LU[k, k]
            for j in columns:
                LU[i, j] = LU[i, j] - LU[i, k] * LU[k, j]
                filled[i, j] = not is_zero(LU[i, j])
    return LU


def solve(LU: np.ndarray, b: np.ndarray, filled: np.ndarray | None = None) -> np.ndarray:
    """Solve ``A x = b`` with the factors of :func:`factorize`.

    Parameters
    ----------
    LU : (n, n)
    b : (n,)
    filled : (n, n), optional
        :func:`pattern` of `LU`, which takes longer to find than a sparse system to solve.
    """
    n = len(LU)
    x = np.array(b, dtype=object if object in (LU.dtype, np.asarray(b).dtype) else float)
    filled = pattern(LU) if filled is None else filled
    for i in range(n):
        for j in np.flatnonzero(filled[i, :i]):
            x[i] = x[i] - LU[i, j] * x[j]
    for i in reversed(range(n)):
        for j in i + 1 + np.flatnonzero(filled[i, i + 1 :]):
            x[i] = x[i] - LU[i, j] * x[j]
        x[i] = x[i] / LU[i, i]
    return x
