"""The communication points of a run."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from vdfmu.base.arrays import Floats
from vdfmu.base.errors import UsageError

_MOST = 10**9
"""Largest number of communication steps of a run: 11 days at 1 kHz."""
_CLOSE = 1e-9
"""Relative error allowed in a stop that must be a multiple of the step; rounding causes 1e-16."""


class Grid(NamedTuple):
    """Start, end and communication step of a run [s], and the number of its steps: times are counted, never summed."""

    begin: float
    end: float
    step: float
    n: int

    def time(self, k: int) -> float:
        """Return the time of point k, from 0 to n [s]."""
        return self.end if k == self.n else self.begin + k * self.step

    def times(self, first: int, after: int) -> Floats:
        """Return the times of the points from `first` to before `after`; the last is not rounded to the end."""
        return self.begin + self.step * np.arange(first, after, dtype=np.float64)

    @property
    def last(self) -> float:
        """Length of the last step [s], which never exceeds the end, whatever the rounding."""
        time = self.begin + (self.n - 1) * self.step
        return self.step if time + self.step == self.end else largest_step(time, self.end)


def count_steps(step: float, stop: float, start: float = 0.0) -> int:
    """Return the number of communication steps of a run; UsageError if its times [s] do not fit together."""
    for name, value in (("step", step), ("stop - start" if start else "stop", stop - start)):
        if not 0.0 < value < math.inf:
            raise UsageError(f"{name}: expected a positive finite time, got {value:g} s.")
    ratio, after = (stop - start) / step, f" after start = {start:g} s" if start else ""
    if ratio > _MOST:
        text = f"stop: expected at most {_MOST:g} steps of {step:g} s, got {stop:g} s"
        raise UsageError(f"{text}. Give an earlier end or a longer step.")
    n = max(1, round(ratio))
    if abs(ratio - n) > _CLOSE * n:
        text = f"stop: expected a multiple of step = {step:.12g} s{after}, got {stop:.12g} s"
        raise UsageError(f"{text}. The nearest is {start + n * step:.12g} s.")
    return n


def largest_step(time: float, stop: float) -> float:
    """Return the step from `time` to `stop` whose sum with `time` does not exceed `stop` because of rounding."""
    step = stop - time
    while time + step > stop:
        step = math.nextafter(step, 0.0)
    return step
