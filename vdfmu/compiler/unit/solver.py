"""Integrates the states of a unit between samples: with Rodas4 in FMUs, with scipy for references."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from vdfmu.base.arrays import Floats, odeint
from vdfmu.base.errors import SHORTEST_STEP, KernelError
from vdfmu.compiler.unit.declaration import SOLVER_TOLERANCE
from vdfmu.compiler.unit.evaluate import Evaluation, holds
from vdfmu.compiler.unit.events import UnitEvents, margin, parts_of, steps_of

TOLERANCE = 1e-12
_MOST_CALLS = 1_000_000
"""Limit of calls of the right-hand side, ten times what shipped robots need. Odd values might need any number."""
_CLOSE = 1e-9
"""Distance from a sample, relative to the period, within which a time counts as the sample's."""
MINIMUM_STEP = 1e-12
"""Smallest internal step [s]: 1e4 times the rounding error of times around 1 s."""
MAXIMUM_STEPS = 1_000_000
"""Limit of internal steps per call, including rejected ones: 10 s of the six-joint arm at 150 rad/s take 300,000."""
FIRST_STEP = 1e-4
"""First step to try [s]."""
_ADVICE = "Check its inputs and the gains behind them, its start and its parameters, or loosen the tolerance."
_SAFETY, _SHRINK, _GROW = 0.9, 0.2, 5.0


_KEPT = 20
"""How often LSODA gets the same Jacobian. It requests one about every 20 steps; that of an arm can be reused for 10
ms."""
_DIFFERENCE = 1.5e-8
"""Step of finite differences, relative to 1 + the state's magnitude: the square root of the machine precision."""


class _RunawayError(ArithmeticError):
    """The motion cannot be integrated to its end."""


class Solver:
    """Integrates the states of a unit in its memory with held inputs. The first sample is at `start` [s]."""

    def __init__(self, unit: Evaluation) -> None:
        self.unit, self.start = unit, 0.0
        self.events = UnitEvents([unit], self._place, lambda: unit.x.copy())

    def move(self, t: float, end: float, duration: float | None = None) -> None:
        """Move from `t` to `end` [s]; outputs are not calculated.

        `duration` is the exact communication step, from which the difference of the times may differ by rounding.
        """
        for begin, to, sampled in samples(self.unit, self.start, t, end):
            if sampled:
                self.sample(begin)
            whole = (begin, to) == (t, end)
            if self.unit.at_events:
                self._advance_by_events(begin, to)
            else:
                self.advance(begin, duration if duration is not None and whole else to - begin, to)
        self.unit.memory[-1] = end

    def _advance_by_events(self, t: float, end: float) -> None:
        """Move from `t` to `end` [s] with events. Without continuous states they are only checked at the end."""
        x = self.unit.x
        if x.size:
            *_, x[:] = self.events.move(steps_of(self.advance, x), t, x.copy(), parts_of([t, end]))
        else:
            self.events.take(end, x)

    def _place(self, t: float, x: Floats) -> None:
        self.unit.place(t, x)

    def sample(self, t: float) -> None:
        """Update the sampled states at `t` [s]."""
        self.unit.memory[-1] = t
        self.unit.update()

    def advance(self, t: float, duration: float, end: float | None = None) -> None:
        """Move the continuous states from `t` by `duration` [s], to `end` if the sum is not exact."""
        x = self.unit.x
        for begin, to, crossing in switchings(self.left, t, t + duration if end is None else end) if x.size else ():
            if crossing:
                before = x.copy()
                x[:] = before + (to - begin) * self.rate(begin, before)
            else:
                self.solve(begin, to)

    def left(self, t: float) -> float:
        """Return the time until the unit switches by time."""
        return self.unit.left(t)

    def rate(self, t: float, x: Floats) -> Floats:
        """Return the rates of the continuous states."""
        raise NotImplementedError

    def solve(self, t: float, to: float) -> None:
        """Move the continuous states from `t` to `to` [s], between which nothing switches."""
        raise NotImplementedError


class Slopes:
    """The Jacobian of a right-hand side f(t, x) by differences, as LSODA requests it.

    It affects the iterations of a step, not the error, so an old one is reused until a step fails. Then LSODA requests
    it again at the same or an earlier time.
    """

    def __init__(self, rate: Callable[[float, Floats], Floats]) -> None:
        self._rate = rate
        self._slopes, self._asked, self._times = np.empty((0, 0)), math.inf, 0

    def __call__(self, t: float, x: Floats) -> Floats:
        """Return the Jacobian, a row for each state that changes."""
        if t <= self._asked or self._times == _KEPT:
            differences = _DIFFERENCE * (1.0 + np.abs(x))
            here, *beside = (self._rate(t, each).copy() for each in (x, *(x + np.diag(differences))))
            self._slopes, self._times = (np.array(beside) - here) / differences[:, None], 0
        self._asked, self._times = t, self._times + 1
        return self._slopes


class ScipySolver(Solver):
    """Integrates the states with scipy within a relative and absolute tolerance. States that diverge become NaN.

    `drive` sets the inputs at a time [s], if they change.
    """

    def __init__(
        self, unit: Evaluation, tolerance: float = TOLERANCE, drive: Callable[[float], None] = lambda t: None
    ) -> None:
        super().__init__(unit)
        self.tolerance, self._drive, self._calls = tolerance, drive, 0

    def sample(self, t: float) -> None:
        """Update the sampled states with the inputs at `t` [s]."""
        self._drive(t)
        super().sample(t)

    def _place(self, t: float, x: Floats) -> None:
        self._drive(t)
        super()._place(t, x)

    def advance(self, t: float, duration: float, end: float | None = None) -> None:
        """Move the continuous states from `t` by `duration` [s]."""
        if self.unit.x.size and np.isfinite(self.unit.x).all():
            try:
                super().advance(t, duration)
            except _RunawayError:
                self.unit.x[:] = math.nan
            self._drive(t + duration)

    def left(self, t: float) -> float:
        """Return the time until the unit switches by time, with the inputs at `t` [s]."""
        self._drive(t)
        return super().left(t)

    def solve(self, t: float, to: float) -> None:
        """Move the continuous states from `t` to `to` [s]; _RunawayError if that is not possible."""
        options: dict[str, Any] = {"rtol": max(self.tolerance, 1e-13), "atol": self.tolerance, "mxstep": _MOST_CALLS}
        options |= {"Dfun": Slopes(self.rate), "col_deriv": 1}
        self._calls, end = 0, t + (to - t)
        states, fault = odeint(self.rate, self.unit.x.copy(), np.array([t, end]), tcrit=[end], **options)
        if fault:
            raise _RunawayError
        self.unit.x[:] = states[-1]

    def rate(self, t: float, x: Floats) -> Floats:
        """Return the rates with the inputs at `t` [s]; _RunawayError for values that are not finite, or many calls."""
        self._calls += 1
        self._drive(t)
        rate = self.unit.rate(t, x)
        if self._calls > _MOST_CALLS or not math.isfinite(rate @ rate):  # a sum of squares takes one call
            raise _RunawayError
        return rate


class Integrator(Solver):
    """The solver of FMUs, Rodas4.

    It keeps the local error of every internal step below `tolerance` times (1 SI unit + the state's magnitude), in the
    root mean square over all states. Alternatively the unit's `solver` fixes the number of internal steps, whatever
    their error. The memory and the step to try next, `h` [s], restore the solver exactly. `steps` and `rejected` count
    internal steps since the start.
    """

    def __init__(self, unit: Evaluation) -> None:
        super().__init__(unit)
        self.x = unit.x
        self.h, self.tolerance = FIRST_STEP, SOLVER_TOLERANCE
        self._h, self._tolerance = np.zeros(1), np.zeros(1)
        self._x_new, self._norm, self._ratio = np.zeros_like(unit.x), np.zeros(1), np.zeros_like(unit.x)
        shared = {name: getattr(self, f"_{name}") for name in ("h", "tolerance", "x_new", "norm", "ratio")}
        program = unit.interface.program
        self._steps = [(unit.conditions(call), unit.bound(call.function, **shared)) for call in program.step]
        self.steps = self.rejected = 0

    def advance(self, t: float, duration: float, end: float | None = None) -> None:
        """Move the state from `t` to `t + duration` [s] with the inputs held.

        KernelError if the state is no longer finite or, under error control, the tolerance cannot be met at the
        smallest step, or `MAXIMUM_STEPS` do not reach the end. The message names the time and the state, and the memory
        is unchanged.
        """
        x, x_new, norm = self.x, self._x_new, self._norm
        self._tolerance[0] = self.tolerance
        step = next(s.run for conditions, s in self._steps if holds(conditions))
        if fixed := int(self.unit.group("solver")[0]):
            self._advance_fixed(step, fixed, t, duration)
            return
        time = self.unit.argument("t")
        before, h_before = x.copy(), self.h
        done, tried, failure = 0.0, 0, ""
        while done < duration:
            tried += 1
            rest, left, close = duration - done, self.unit.left(t + done), margin(t + done)
            whole = rest <= (ahead := left - close if left > 2.0 * close else left + close)
            rest = rest if whole else ahead  # the time of a switching is approached, then crossed
            h = self.h
            last = h >= rest * (1.0 - 1e-10)
            if last:
                h = rest
            elif 2.0 * h > rest:  # two equal steps instead of a long and a short one
                h = 0.5 * rest
            self._h[0] = h
            time[0] = t + done
            step()
            error = float(norm[0])
            factor = _SAFETY / math.sqrt(math.sqrt(error)) if error > 0.0 else _GROW
            if error <= 1.0:
                self.steps += 1
                done = duration if last and whole else done + h
                x[:] = x_new
                # a step cut short by the communication point says little about the next, so it never shrinks h
                grown = h * min(_GROW, max(factor, _SHRINK))
                self.h = max(grown, self.h) if last and h < self.h else grown
            else:
                self.rejected += 1
                self.h = h * (min(0.9, max(factor, _SHRINK)) if math.isfinite(error) else _SHRINK)
                if self.h < MINIMUM_STEP:
                    failure = (
                        f"at t = {t + done:.9g} s {self._problem(error)}, and {SHORTEST_STEP} "
                        f"{MINIMUM_STEP:g} s. {_ADVICE}"
                    )
            if not failure and tried == MAXIMUM_STEPS and done < duration:
                failure = (
                    f"at t = {t + done:.9g} s the communication step of {duration:.6g} s is not done after "
                    f"{MAXIMUM_STEPS} internal steps, the last of {h:.3g} s. Take shorter communication steps. "
                    f"{_ADVICE}"
                )
            if failure:
                x[:] = before
                self.h = h_before
                raise KernelError(failure)

    def _advance_fixed(self, step: Callable[[], None], fixed: int, t: float, duration: float) -> None:
        """Make `fixed` internal steps of equal length, so that every communication step takes the same work."""
        before, time, size, done = self.x.copy(), self.unit.argument("t"), duration / fixed, 0.0
        for k in range(1, fixed + 1):
            to = k * size if k < fixed else duration
            self._h[0] = to - done
            time[0] = t + done
            step()
            if not math.isfinite(error := float(self._norm[0])):
                self.x[:] = before
                raise KernelError(
                    f"at t = {t + done:.9g} s {self._problem(error)}, and the number of internal steps is fixed, "
                    f"{fixed}. Take shorter communication steps, or solver adaptive."
                )
            self.steps += 1
            self.x[:] = self._x_new
            done = to

    def _problem(self, error: float) -> str:
        interface = self.unit.interface
        bad = np.flatnonzero(~np.isfinite(self._x_new))
        name = interface.memory[interface.states][bad[0] if len(bad) else np.argmax(np.abs(self._ratio))].name
        if len(bad):
            return f"state {name} is not finite"
        return f"the local error of state {name} is {error:.3g} times the tolerance {self.tolerance:.3g}"


def switchings(left: Callable[[float], float], t: float, end: float) -> Iterator[tuple[float, float, bool]]:
    """Yield the parts of the time from `t` to `end` between switchings: start, end, and whether a switching is crossed.

    `left` returns the time until the next switching. Move the states to the end of a part before requesting the next
    one. The part across a switching is short enough that a straight line is exact.
    """
    while t < end:
        rest, close = left(t), margin(t)
        crossing = rest <= 2.0 * close
        to = min(end, t + (rest + close if crossing else rest - close))
        yield t, to, crossing
        t = to


def samples(unit: Evaluation, start: float, t: float, end: float) -> Iterator[tuple[float, float, bool]]:
    """Yield the parts of the time from `t` to `end` between samples: start, end, and whether a sample is at the start.

    A sample at `end` belongs to the next move. Without sampled states there is one part.
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
