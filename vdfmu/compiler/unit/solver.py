"""The states of a unit over time: a solver between the samples, and sampled states that change at each.

:class:`ScipySolver` makes references; the solver of FMUs is in :mod:`.integrator`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

import numpy as np

from vdfmu.base.arrays import Floats, odeint
from vdfmu.compiler.unit.evaluate import Evaluation

TOLERANCE = 1e-12
_MOST_CALLS = 1_000_000
"""Calls of the right-hand side in one go, ten times what the shipped robots take; odd values may find no end."""
_CLOSE = 1e-9
"""Part of a period within which a time counts as a sample's."""


class _RunawayError(ArithmeticError):
    """No end of the motion can be found."""


class Solver:
    """Moves the states of a unit in its memory, with the inputs held.

    Attributes
    ----------
    unit : Evaluation
        Its memory holds inputs and states.
    start : float [s]
        Time of the first sample.
    """

    def __init__(self, unit: Evaluation, start: float = 0.0) -> None:
        self.unit, self.start = unit, start

    def move(self, t: float, end: float, duration: float | None = None) -> None:
        """Move from `t` to `end` [s]; outputs are not calculated.

        `duration` is the step between them where the times have its rounding.
        """
        for begin, to, sampled in samples(self.unit, self.start, t, end):
            if sampled:
                self.sample(begin)
            whole = (begin, to) == (t, end)
            self.advance(begin, duration if duration is not None and whole else to - begin)
        self.unit.memory[-1] = end

    def sample(self, t: float) -> None:
        """Update the sampled states at `t` [s]."""
        self.unit.memory[-1] = t
        self.unit.update()

    def advance(self, t: float, duration: float) -> None:
        """Move the continuous states from `t` by `duration` [s]."""
        raise NotImplementedError


class ScipySolver(Solver):
    """Moves the states by scipy; from where they run away on they are not numbers.

    Parameters
    ----------
    unit, start : see :class:`Solver`
    tolerance : float
        Absolute, and relative, of scipy's solver.
    """

    def __init__(self, unit: Evaluation, start: float = 0.0, tolerance: float = TOLERANCE) -> None:
        super().__init__(unit, start)
        self.tolerance = tolerance
        self._calls = 0

    def advance(self, t: float, duration: float) -> None:
        """Move the continuous states from `t` by `duration` [s]."""
        if not self.unit.x.size:
            return
        self.drive(t)
        for begin, to, crossing in switchings(self.unit.left, t, t + duration):
            if not np.isfinite(self.unit.x).all():
                return
            self._calls = 0
            if crossing:
                x = self.unit.x.copy()
                self.unit.x[:] = x + (to - begin) * self._rate(begin, x)
            else:
                self._solve(begin, to - begin)
            self.drive(to)

    def drive(self, t: float) -> None:
        """Set inputs that change in time."""

    def _solve(self, t: float, duration: float) -> None:
        end = t + duration
        if end == t:
            return
        tolerances = {"rtol": max(self.tolerance, 1e-13), "atol": self.tolerance, "mxstep": _MOST_CALLS}
        try:
            states, fault = odeint(self._rate, self.unit.x, np.array([t, end]), tcrit=[end], **tolerances)
            self.unit.x[:] = math.nan if fault else states[-1]
        except _RunawayError:
            self.unit.x[:] = math.nan

    def _rate(self, t: float, x: Floats) -> Floats:
        self._calls += 1
        rate = self.unit.rate(t, x)
        if self._calls > _MOST_CALLS or not math.isfinite(rate @ rate):  # the square: one call
            raise _RunawayError
        return rate


def margin(t: float) -> float:
    """Time before and after a switching at `t` [s] within which it may be, by rounding: 18 units in the last place."""
    return 4e-15 * abs(t) + 1e-17


def switchings(left: Callable[[float], float], t: float, end: float) -> Iterator[tuple[float, float, bool]]:
    """Yield the parts of the time from `t` to `end` between switchings: begin, end, and whether it is crossed there.

    `left` tells the time until the next one; the states have been moved to the end of a part before the next is asked
    for. What crosses one is so short that a straight line has no error.
    """
    while t < end:
        rest, close = left(t), margin(t)
        crossing = rest <= 2.0 * close
        to = min(end, t + (rest + close if crossing else rest - close))
        yield t, to, crossing
        t = to


def samples(unit: Evaluation, start: float, t: float, end: float) -> Iterator[tuple[float, float, bool]]:
    """Yield the parts of the time from `t` to `end` between samples: begin, end, and whether a sample is at the begin.

    The sample at `end` is left to what follows. A unit without sampled states has one part.
    """
    if not unit.interface.is_sampled:
        yield t, end, False
        return
    period = float(unit.group("period")[0])
    close = _CLOSE * period
    while t < end:
        k = math.ceil((t - start - close) / period)
        sample = start + k * period
        sampled = sample <= t + close
        if sampled:
            sample = start + (k + 1) * period
        to = sample if sample < end - close else end
        yield t, to, sampled
        t = to
