"""Steps of a model-exchange component: integration of its states, and location of its events.

The component is in event mode at communication points, for the exchange of values. Every step begins with an update of
its discrete states.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from ctypes import c_double
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vdfmu.base.arrays import Floats
from vdfmu.base.errors import CosimError
from vdfmu.engine.fmu.access import Call
from vdfmu.engine.fmu.variables import FmuVariable

TOLERANCE = 1e-6
"""Default relative tolerance. The absolute tolerance is its product with the nominal values of the states."""
_STIFF = 200
"""Number of explicit steps in a communication step after which the method becomes implicit."""
_DIFFERENCE = 1e-6
"""Increment of finite differences, relative to the values and nominal values."""
_EVENTS = 1000
"""Largest number of events in a communication step."""
_MOST = 10_000_000
"""Largest number of continuous states and of event indicators: 80 MB each."""


def excess_of(states: int, indicators: int) -> str:
    """Return a text with the numbers of states and event indicators and their limit if either exceeds it."""
    text = f"{states} continuous states and {indicators} event indicators; expected {_MOST} at most of each"
    return text if max(states, indicators) > _MOST else ""


class ModelExchangeIntegrator:
    """Integrates the states of a component over communication steps, after its initialization.

    The method is DOP853, and Radau once a communication step takes many steps. A change of sign of an event indicator
    is located by bisection down to rounding, and the event is at the first time after the change.
    """

    def __init__(self, instance: Any, tolerance: float | None) -> None:
        self.instance, self.tolerance = instance, tolerance or TOLERANCE
        n_x, n_z = instance.sizes()
        if excess := excess_of(n_x, n_z):
            raise self._failure(f"it has {excess}")
        self._x, self._rates, self._z = np.zeros(n_x), np.zeros(n_x), np.zeros(n_z)
        self._changed = np.zeros(n_z, np.bool_)
        """Which event indicators have changed their sign at the last event."""
        self._nominals = np.ones(n_x)
        from scipy.integrate import DOP853, Radau  # import takes a third of a second

        self._method: Any = DOP853
        self._stiff: Any = Radau
        self._h: float | None = None
        instance.transfer("GetNominalsOfContinuousStates", self._nominals)

    def step_call(self, clock: c_double, size: c_double) -> Call:
        """Return the call of a step from `clock` by `size` [s]."""
        return lambda: self._step(clock.value, clock.value + size.value), (), "doStep"

    def _step(self, time: float, end: float) -> int:
        """Step from `time` to `end`; return the status ok."""
        instance = self.instance
        instance.update(time)
        steps, events = 0, 0
        while True:
            instance.leave_event()
            time, at_event, taken = self._continue(time, min(max(instance.next_event, time), end))
            steps += taken
            if steps > _STIFF:
                self._method = self._stiff
            instance.enter_event()
            at_event = at_event or time >= instance.next_event
            if at_event or time >= end:
                instance.update(time)
            if at_event:
                instance.happened(time, self._changed)
                events += 1
            if time >= end or instance.name in instance.box.ended:
                return 0
            if events > _EVENTS:
                reason = f"there are more than {_EVENTS} events in a step, the last at t = {time:.9g} s"
                raise self._failure(f"{reason}; choose a shorter step")

    def _failure(self, reason: str) -> CosimError:
        return CosimError(self.instance.name, "doStep", self.instance.box.time, reason)

    def _continue(self, time: float, end: float) -> tuple[float, bool, int]:
        """Integrate to an event or to `end`; return the time, whether it is an event, and the number of steps."""
        self._changed[:] = False
        if end <= time:
            return time, False, 0
        self.instance.transfer("GetContinuousStates", self._x)
        signs = self._signs(time, self._x)
        x = self._x.copy()
        state: Any = lambda _: x  # noqa: E731  # without states
        solver = None
        if x.size:
            first = None if self._h is None else min(self._h, end - time)
            tolerances = {"rtol": self.tolerance, "atol": self.tolerance * self._nominals}
            solver = self._method(self._derivatives, time, x, end, first_step=first, **tolerances)
        steps = 0
        while True:
            before, time, steps = time, end, steps + 1
            if solver is not None:
                why = solver.step()
                if solver.status == "failed":
                    reason = f"the states cannot be integrated beyond t = {solver.t:.9g} s: {why}. Loosen the tolerance"
                    raise self._failure(f"{reason}, or look for values that become infinite")
                time, x = solver.t, solver.y
                if self._z.size:  # evaluates the derivatives
                    state = solver.dense_output()
                self._h = solver.step_size if solver.status == "running" else self._h or solver.step_size
            if self._z.size and np.any(self._signs(time, state(time)) != signs):
                time = self._crossing(before, time, state, signs)
                self._changed = self._signs(time, state(time)) != signs
                self._set(time, np.asarray(state(time)))
                return time, True, steps
            self._set(time, x)
            if self.instance.completed_step():
                return time, True, steps
            if time >= end:
                return time, False, steps

    def _crossing(self, low: float, high: float, state: Callable[[float], Any], signs: NDArray[np.bool_]) -> float:
        """Return the first time after a change of sign [s]."""
        while low < (middle := 0.5 * (low + high)) < high:
            if np.any(self._signs(middle, state(middle)) != signs):
                high = middle
            else:
                low = middle
        return high

    def differences(self, time: float, inputs: Sequence[FmuVariable], outputs: Sequence[FmuVariable]) -> Floats:
        """Return the derivatives of rates and outputs with respect to states and inputs, by central differences."""
        instance, n = self.instance, self._x.size
        instance.leave_event()
        self.instance.transfer("GetContinuousStates", self._x)
        center = np.array([*self._x, *instance.get_all(inputs)], np.float64)

        def both(at: Floats) -> Floats:
            instance.set_all(list(zip(inputs, at[n:].tolist(), strict=True)))
            rates = self._derivatives(time, at[:n])
            return np.array([*rates, *instance.get_all(outputs)], np.float64)

        sizes = np.maximum(np.abs(center), [*self._nominals, *(v.size for v in inputs)])
        steps = np.diag(_DIFFERENCE * sizes)
        columns = [(both(center + d) - both(center - d)) / (2.0 * d.sum()) for d in steps]
        both(center)
        instance.enter_event()
        return np.array(columns).reshape(len(steps), n + len(outputs)).T

    def _set(self, time: float, x: Floats) -> None:
        self.instance.set_time(time)
        if x.size:
            np.copyto(self._x, x)
            self.instance.transfer("SetContinuousStates", self._x)

    def _derivatives(self, time: float, x: Floats) -> Floats:
        self._set(time, x)
        self.instance.transfer(self.instance.derivatives_name, self._rates)
        return self._rates.copy()

    def _signs(self, time: float, x: Floats) -> NDArray[np.bool_]:
        if self._z.size:
            self._set(time, np.asarray(x))
            self.instance.transfer("GetEventIndicators", self._z)
        return self._z > 0.0
