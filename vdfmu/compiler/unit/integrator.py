"""Integration of a unit with continuous states between communication points: steps of Rodas4."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from vdfmu.base.errors import KernelError
from vdfmu.compiler.functions.rodas import ORDER
from vdfmu.compiler.unit.declaration import SOLVER_TOLERANCE
from vdfmu.compiler.unit.evaluate import Evaluation, holds
from vdfmu.compiler.unit.solver import Solver, margin

MINIMUM_STEP = 1e-12
"""Smallest internal step [s]: 1e4 times rounding of a time of about 1 s."""
MAXIMUM_STEPS = 1_000_000
"""Internal steps, rejected ones too, in one call: 10 s of the six-joint arm at 150 rad/s take 300,000."""
FIRST_STEP = 1e-4
"""Step that is tried first [s]."""
_ADVICE = "Check its inputs and the gains behind them, its start and its parameters, or loosen the tolerance."
_SAFETY, _SHRINK, _GROW = 0.9, 0.2, 5.0


class Integrator(Solver):
    """The solver of FMUs.

    The local error of every internal step is kept below `tolerance` times (1 SI unit + the state's
    magnitude), in the root mean square over all states; or the unit's `solver` fixes the number of internal steps,
    whatever their error. Everything that decides the next step is in the memory and
    `h`: a copy of the two restores the solver to the bit.

    Attributes
    ----------
    x : (n_x,) continuous states, in the unit's memory
    h : float [s] step to try next
    steps, rejected : int, internal steps made and rejected since the start
    """

    def __init__(self, unit: Evaluation) -> None:
        super().__init__(unit)
        self.x = unit.x
        self._h, self._tolerance = np.zeros(1), np.full(1, SOLVER_TOLERANCE)
        self._x_new, self._norm, self._ratio = np.zeros_like(unit.x), np.zeros(1), np.zeros_like(unit.x)
        shared = {
            "h": self._h, "tolerance": self._tolerance, "x_new": self._x_new, "norm": self._norm, "ratio": self._ratio
        }  # fmt: skip
        self._steps = [
            (unit.conditions(call), unit.bound(call.function, **shared)) for call in unit.interface.program.step
        ]
        self.h = FIRST_STEP
        self.steps = self.rejected = 0

    @property
    def tolerance(self) -> float:
        """Bound of the local error, relative and absolute in SI units."""
        return float(self._tolerance[0])

    @tolerance.setter
    def tolerance(self, value: float) -> None:
        self._tolerance[0] = value

    def advance(self, t: float, duration: float) -> None:
        """Move the state from `t` to `t + duration` [s] with the inputs held.

        Raises
        ------
        KernelError
            If the state is no longer finite or, under error control, the tolerance cannot be met at the smallest
            step, or `MAXIMUM_STEPS` do not reach the end. The message says where; the state is that before the call.
        """
        x, x_new, norm = self.x, self._x_new, self._norm
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
            end = rest <= (ahead := left - close if left > 2.0 * close else left + close)
            rest = rest if end else ahead  # a switching is approached, then crossed
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
            factor = _SAFETY * error ** (-1.0 / ORDER) if error > 0.0 else _GROW
            if error <= 1.0:
                self.steps += 1
                done = duration if last and end else done + h
                x[:] = x_new
                # a step cut short by the communication point says little about the next one: it never shrinks
                # h
                grown = h * min(_GROW, max(factor, _SHRINK))
                self.h = max(grown, self.h) if last and h < self.h else grown
            else:
                self.rejected += 1
                self.h = h * (min(0.9, max(factor, _SHRINK)) if math.isfinite(error) else _SHRINK)
                if self.h < MINIMUM_STEP:
                    failure = (
                        f"at t = {t + done:.9g} s {self._problem(error)}, and the internal step reached its minimum "
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
        """Take `fixed` internal steps of one length: the same work in each communication step."""
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
        bad = np.flatnonzero(~np.isfinite(self._x_new))
        if len(bad):
            return f"state {self._name(int(bad[0]))} is not finite"
        worst = int(np.argmax(np.abs(self._ratio)))
        return f"the local error of state {self._name(worst)} is {error:.3g} times the tolerance {self.tolerance:.3g}"

    def _name(self, i: int) -> str:
        """FMI name of component `i` of the state."""
        interface = self.unit.interface
        return interface.memory[interface.states.start + i].name
