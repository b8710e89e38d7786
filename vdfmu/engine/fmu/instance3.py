"""An instance of an FMU of FMI 3.0."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from ctypes import byref, c_bool, c_char, c_double, c_int, c_size_t, c_uint32
from typing import Any

import numpy as np
from fmpy.fmi3 import FMU3Model, FMU3Slave

from vdfmu.base.errors import CosimError
from vdfmu.engine.fmu.access import Call, Transfer
from vdfmu.engine.fmu.instance import Instance, Starts, Steps
from vdfmu.engine.fmu.messages import on_message
from vdfmu.engine.fmu.variables import INTEGERS, FmuVariable

_EVENT, _END, _EARLY = range(3)
"""Answers of doStep."""
_CLOSE = 1e-9
"""Part of a step that an early return may leave undone by rounding."""
_CHANGED = 2
"""Value of fmi3IntervalQualifier."""


class Instance3(Instance):
    """An instance of an FMU of FMI 3.0."""

    kinds = FMU3Slave, FMU3Model
    prefix, sized, derivatives_name = "fmi3", True, "GetContinuousStateDerivatives"
    dtypes = {  # noqa: RUF012
        "Float64": np.float64, "Float32": np.float32, "Boolean": np.bool_, "String": np.uintp, "Binary": np.uintp,
        **{name: np.dtype(name.lower()) for name in INTEGERS},
    }  # fmt: skip

    event_needed = False
    """Whether a step has ended at an event."""
    _begin, _end, _at, _held = math.nan, 0.0, 0.0, 0.0
    """Begin and end of a step, the last update in it, and the time on the line whose values the inputs have [s]."""
    _piece, _late = math.inf, 0.0
    """Length of the last internal step [s]; `_lag` up to the last update."""
    _opening = _piece, _late
    """Both at the begin of the step."""
    _failed: CosimError | None = None
    """Failure in an intermediate update."""

    def make(self) -> None:
        """See `Instance.make`."""
        token = self.token

        def receive(_: int | None, *message: Any) -> None:
            on_message(token, *message)

        if self.description.exchange:
            return self.fmu.instantiate(loggingOn=True, logMessage=receive)
        updated = self._updated if self.updates else None
        self.fmu.instantiate(False, True, self.event_mode, self.event_mode, receive, updated)

    def prepare(self, tolerance: float | None, start: float, stop: float, values: Starts) -> None:
        """See `Instance.prepare`."""
        self.tolerance = tolerance
        self._experiment = tolerance, start, stop
        structure = [(v, x) for v, x in values if v.causality == "structuralParameter"]
        if structure:
            self.fmu.enterConfigurationMode()
            self.set_all(structure)
            self.fmu.exitConfigurationMode()
        self.set_all([pair for pair in values if pair not in structure])

    def enter_initialization(self) -> None:
        """See `Instance.enter_initialization`."""
        self.fmu.enterInitializationMode(*self._experiment)

    def value_call(self, moved: Transfer) -> Call:
        """See `Instance.value_call`."""
        count, n = moved.counts
        sizes = [byref(c_char.from_buffer(moved.sizes))] if moved.native == "Binary" else []  # pyright: ignore[reportArgumentType]
        arguments = self.argument, byref(moved.references), count, *sizes, moved.pointer, n
        return moved.around(self.function(moved.verb + moved.native)), arguments, moved.name

    # ------------------------------------------------------------------ steps

    def simulation_call(self, clock: c_double, size: c_double) -> Call:
        """See `Instance.simulation_call`."""
        step, last = self.function("DoStep"), c_double()
        flags = (c_bool * 4)()
        any_flag = c_uint32.from_buffer(flags)
        answers = *(byref(flags, i) for i in (_EVENT, _END, _EARLY)), byref(last)

        def do_step(component: Any, clock: c_double, size: c_double, keep: Any) -> int:
            if self.updates:
                self._run_line(clock.value, clock.value + size.value)
            status = step(component, clock, size, keep, *answers)
            if self._failed is not None:
                raise self._failed
            end = clock.value + size.value
            close = end - _CLOSE * size.value
            while any_flag.value and status < 2:
                if self._answered(flags, last.value, last.value >= close):
                    break
                rest = c_double(last.value), c_double(end - last.value)
                status = step(component, *rest, keep, *answers)
            return status

        return do_step, (self.argument, clock, size, c_bool.from_param(True)), "doStep"

    def _run_line(self, begin: float, end: float) -> None:
        """Begin a step whose inputs run on lines."""
        if begin != self._begin:  # a repeated step begins as it did
            self._begin, self._opening = begin, (self._piece, self._late + self._lag(self._end))
        self._piece, self._late = self._opening
        self._at, self._end, self._failed = begin, end, None
        self._hold(min(self._piece, end - begin))
        self._piece = math.inf

    def _updated(self, _: int | None, time: float, requested: bool, _get: bool, finished: bool, *more: Any) -> None:
        """Set the inputs in an intermediate update, between two internal steps."""
        if requested and finished and self._at < time < self._end:
            self._late += self._lag(time)
            self._piece, self._at = time - self._at, time
            try:
                self._hold(min(self._piece, self._end - time))
            except CosimError as error:
                self._failed = error

    def _lag(self, time: float) -> float:
        """Return the integral of the time minus the integral of the held value, since the last update [s^2]."""
        return (time - self._at) * (0.5 * (self._at + time) - self._held)

    def _hold(self, length: float) -> None:
        """Set the inputs for an internal step of a length that is a guess, so that their integral is the line's.

        It also corrects the error that a wrong guess left in the previous integral.
        """
        self._held = self._at + 0.5 * length + self._late / length
        self.line(self._held)

    def slope_call(self, moved: Transfer) -> Call:
        """See `Instance.slope_call`."""
        orders = (c_int * len(moved.references))(*([1] * len(moved.references)))
        count, size = moved.counts
        arguments = self.argument, byref(moved.references), count, orders, moved.pointer, size
        return moved.around(self.function("GetOutputDerivatives")), arguments, "getOutputDerivatives"

    def _answered(self, flags: Any, last: float, done: bool) -> bool:
        """Take the answers of a step other than its status; False if more of it than rounding remains to be done."""
        self.event_needed = bool(flags[_EVENT])
        if flags[_END]:
            self.box.ended[self.name] = last
            return True
        if done or not flags[_EARLY]:
            return True
        if not self.event_mode:
            reason = f"it returned early, at t = {last:.9g} s, which it was not allowed to"
            raise CosimError(self.name, "doStep", self.box.time, reason)
        if self.event_needed:  # alone: others may have stepped beyond
            self.enter_event()
            own = [v.reference for v in self.description.variables.values() if v.clock and v.causality == "output"]
            if any(self.clocks(own)):
                raise CosimError(
                    self.name, "getClock", self.box.time,
                    f"a clock ticks at t = {last:.9g} s, between two communication points, when others cannot be told; "
                    "choose a step that ends there",
                )  # fmt: skip
            self.update(last)
            self.leave_event()
        return self.name in self.box.ended

    # ------------------------------------------------------------------ events

    def discrete(self, variable: FmuVariable) -> bool:
        """Whether an input is set in event mode only."""
        return self.event_mode and (variable.variability == "discrete" or bool(variable.clocks))

    def between_events(self, variable: FmuVariable) -> bool:
        """See `Instance.between_events`."""
        if not self.event_mode:
            return True
        return not variable.clocks and (variable.causality == "output" or not self.discrete(variable))

    def exit_initialization(self, integrate: Callable[[Instance, float | None], Steps]) -> None:
        """See `Instance.exit_initialization`."""
        self.event_needed = False
        super().exit_initialization(integrate)
        self.in_event = self.event_mode or self.description.exchange

    def enter_event(self) -> None:
        """Enter event mode."""
        self.event_needed = False
        super().enter_event()

    def discrete_states(self) -> tuple[bool, bool, bool, bool, bool, float]:
        """See `Instance.discrete_states`."""
        return self.fmu.updateDiscreteStates()

    def sizes(self) -> tuple[int, int]:
        """See `Instance.sizes`."""
        return self.fmu.getNumberOfContinuousStates(), self.fmu.getNumberOfEventIndicators()

    def set_clocks(self, references: Sequence[int]) -> None:
        """Let input clocks tick."""
        if references:
            self.fmu.setClock(references, [True] * len(references))

    def clocks(self, references: Sequence[int]) -> list[bool]:
        """Return which output clocks tick."""
        return self.fmu.getClock(references) if references else []

    def intervals(self, references: Sequence[int]) -> list[float | None]:
        """Return the intervals of clocks [s]; None for unchanged ones."""
        n = len(references)
        intervals, qualifiers = (c_double * n)(), (c_int * n)()
        self.call("GetIntervalDecimal", (c_uint32 * n)(*references), c_size_t(n), intervals, qualifiers)
        return [x if q == _CHANGED else None for x, q in zip(intervals, qualifiers, strict=True)]
