"""The master algorithms, and the number of steps of a run."""

import math

from vdfmu.base.errors import UsageError

ALGORITHMS = ("gauss-seidel", "jacobi", "extrapolated", "iterative")
CONTINUOUS = ("extrapolated", "iterative")
"""Those that take the coupled signals as continuous, between the communication points too."""
_MOST = 10**9
"""Communication steps of a run: 11 days at 1 kHz."""
_CLOSE = 1e-9
"""Relative error of a stop that is a multiple of the step; that of the rounded division is 1e-16."""


def count_steps(step: float, stop: float, start: float = 0.0) -> int:
    """Return the number of communication steps of a run; UsageError if its times [s] do not fit together."""
    for name, value in (("step", step), ("stop - start" if start else "stop", stop - start)):
        if not 0.0 < value < math.inf:
            raise UsageError(f"{name}: expected a positive finite time, got {value:g} s.")
    ratio, after = (stop - start) / step, f" after start = {start:g} s" if start else ""
    if ratio > _MOST:
        raise UsageError(
            f"stop: expected at most {_MOST:g} steps of {step:g} s, got {stop:g} s. Give an earlier end or a longer "
            "step."
        )
    n = max(1, round(ratio))
    if abs(ratio - n) > _CLOSE * n:
        raise UsageError(
            f"stop: expected a multiple of step = {step:.12g} s{after}, got {stop:.12g} s. The nearest is "
            f"{start + n * step:.12g} s."
        )
    return n
