"""Slopes of functions, and the derivatives that a native unit gives."""

from collections.abc import Callable, Sequence

import numpy as np

from tests.compiler.native.binding import Instance, Variable

Evaluate = Callable[[np.ndarray], np.ndarray]


def slopes(evaluate: Evaluate, point: np.ndarray, steps: np.ndarray) -> np.ndarray:
    """Jacobian of a function: differences over h and h/2, combined so that the error is of fourth order."""
    columns = []
    for k, h in enumerate(steps):

        def difference(h: float, k: int = k) -> np.ndarray:
            low, high = point.copy(), point.copy()
            low[k] -= h
            high[k] += h
            return (evaluate(high) - evaluate(low)) / (high[k] - low[k])

        columns.append((4.0 * difference(h / 2.0) - difference(h)) / 3.0)
    return np.array(columns).T


def assert_slopes(actual: np.ndarray, expected: np.ndarray, values: np.ndarray, steps: np.ndarray) -> None:
    """Hold derivatives against slopes."""
    # Truncation is h^4 times the fifth derivative, some (h/l)^4 = 1e-12 of the slope at h = 1e-3 l; l is the length
    # over which a function bends: 1e-7 of the row's largest slope leaves l room to be small. Rounding is a few hundred
    # times 1e-16 of the value, over h.
    row = np.abs(expected).max(axis=1, keepdims=True)
    rounding = 1e-13 * (1.0 + np.abs(values))[:, None] / steps[None, :]
    assert np.all(np.abs(actual - expected) <= 1e-7 * row + rounding)


def elements(variables: Sequence[Variable]) -> list[str]:
    return [name for v in variables for name in v.names]


def directional(unit: Instance, unknowns: Sequence[Variable], knowns: Sequence[Variable]) -> np.ndarray:
    n = len(elements(knowns))
    return np.array([unit.directional(unknowns, knowns, seed) for seed in np.eye(n)]).T
