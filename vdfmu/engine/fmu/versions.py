"""Instances of FMUs in FMI 1.0, 2.0 and 3.0."""

from __future__ import annotations

import math
from collections.abc import Sequence
from ctypes import byref, c_bool, c_double, c_int, c_size_t, c_ubyte, c_uint, c_uint32
from typing import Any

import numpy as np
from fmpy import fmi1, fmi2, fmi3

from vdfmu.base.arrays import Floats
from vdfmu.base.errors import CosimError
from vdfmu.base.standards import FMI_1, FMI_2
from vdfmu.engine.fmu.access import Call, shared
from vdfmu.engine.fmu.instance import Instance, Starts
from vdfmu.engine.fmu.library import Library, status_of
from vdfmu.engine.fmu.messages import boxes, on_message
from vdfmu.engine.fmu.variables import INTEGERS, FmuVariable
from vdfmu.engine.package.system import Value

try:
    from fmpy.logging import addLoggerProxy
except Exception:  # without a proxy library for this platform messages lack their arguments
    addLoggerProxy = None

_LAST_SUCCESSFUL_TIME, _TERMINATED = 2, 3
"""Values of fmi2StatusKind."""


@fmi2.fmi2CallbackLoggerTYPE
def _RECEIVER(token: int | None, instance: bytes | None, *message: Any) -> None:
    if token not in boxes:  # FMI 1.0 passes the instance, which is unknown while it is made
        token = next((key for key, (name, _) in boxes.items() if name.encode() == instance), token)
    on_message(token, *message)


class Instance2(Instance):
    """An instance of an FMU of FMI 2.0."""

    kinds = fmi2.FMU2Slave, fmi2.FMU2Model
    prefix, sized, derivatives_name = "fmi2", False, "GetDerivatives"
    slopes_name, state_name, deserialize = "GetRealOutputDerivatives", "FMUstate", "DeSerializeFMUstate"
    dtypes = {"Real": np.float64, "Integer": np.int32, "Boolean": np.int32, "String": np.uintp}  # noqa: RUF012
    module = fmi2

    def _make(self) -> None:
        default = fmi2.defaultCallbacks
        memory = default.allocateMemory, default.freeMemory
        callbacks = fmi2.fmi2CallbackFunctions(_RECEIVER, *memory, default.stepFinished, self.token)
        # pythonfmu passes its text as the format, without arguments: a percent sign must not be formatted
        if addLoggerProxy is not None and not self.python:
            addLoggerProxy(byref(callbacks))
        # FMPy's container would log every call of its units, a millisecond per step; it reports errors in any case
        self.fmu.instantiate(callbacks=callbacks, loggingOn=self.description.identifier != "container_fmu")

    def prepare(self, tolerance: float | None, start: float, stop: float, values: Starts) -> None:
        """See `Instance.prepare`."""
        self.tolerance = tolerance = tolerance or self.description.tolerance
        self.call("SetupExperiment", tolerance is not None, tolerance or 0.0, start, True, stop)
        self.set_all(values)

    def _simulation_call(self, clock: c_double, size: c_double) -> Call:
        self.step = clock, size
        return self.function("DoStep"), (self.fmu.component, clock, size, _KEEP), "doStep"

    def rate_call(self, variables: Sequence[FmuVariable], starts: Floats, slopes: Floats, clock: c_double) -> Call:
        """See `Instance.rate_call`."""
        if self.integrator:
            return super().rate_call(variables, starts, slopes, clock)
        references = (c_uint * len(variables))(*(v.reference for v in variables))
        orders = (c_int * len(variables))(*([1] * len(variables)))
        arguments = self.fmu.component, references, len(variables), orders, shared(c_double, slopes)
        return self.function("SetRealInputDerivatives"), arguments, "setRealInputDerivatives"

    def has_ended(self) -> bool:
        """See `Instance.has_ended`."""
        before, ended, time = len(self.box.pending), c_int(), c_double(math.nan)
        status = status_of(self.function("GetBooleanStatus"), self.fmu.component, _TERMINATED, byref(ended))
        if status or not ended.value:
            del self.box.pending[before:]  # messages of these calls do not explain the discarded step
            return False
        status_of(self.function("GetRealStatus"), self.fmu.component, _LAST_SUCCESSFUL_TIME, byref(time))
        if not math.isnan(time.value):  # otherwise it does not report the time
            begin, size = self.step
            self.check_end(begin.value, size.value, time.value)
        self.box.ended[self.name] = time.value
        return True

    def updated(self) -> tuple[bool, bool, float]:
        """See `Instance.updated`."""
        info = fmi2.fmi2EventInfo()
        self.call("NewDiscreteStates", byref(info))
        after = info.nextEventTime if info.nextEventTimeDefined else math.inf
        return bool(info.newDiscreteStatesNeeded), bool(info.terminateSimulation), after


class Instance1(Instance2):
    """An instance of an FMU of FMI 1.0 for co-simulation.

    FMI 1.0 has no initialization mode, so the instance is initialized when a value is first read, after all values set
    before.
    """

    kinds = fmi1.FMU1Slave, fmi1.FMU1Model
    prefix, end_name = "fmi1", "TerminateSlave"
    dtypes = Instance2.dtypes | {"Boolean": np.int8}
    module = fmi1
    has_ended = Library.has_ended

    def symbol(self, name: str) -> str:
        """See `Library.symbol`."""
        return f"{self.description.identifier}_fmi{name}"

    @staticmethod
    def mend(fmu: Any) -> None:
        """See `Library.mend`; fmpy 0.3.32 declares statuses as texts, and would read a warning as an address."""
        if isinstance(fmu, fmi1.FMU1Slave):
            for name in ("InitializeSlave", "DoStep", "GetRealOutputDerivatives", "SetRealInputDerivatives"):
                function = getattr(fmu.dll, f"{fmu.modelIdentifier}_fmi{name}")
                function.restype = c_int
            fmu.fmi1SetRealInputDerivatives = function  # fmpy 0.3.32 calls InitializeSlave

    def _make(self) -> None:
        default = fmi1.defaultCallbacks
        callbacks = fmi1.fmi1CallbackFunctions(_RECEIVER, default.allocateMemory, default.freeMemory, None)
        if addLoggerProxy is not None:
            addLoggerProxy(byref(callbacks))
        self.fmu.instantiate(functions=callbacks, loggingOn=True)
        if self.fmu.component:
            boxes[self.fmu.component] = boxes.pop(self.token)
            self.token = self.fmu.component

    def prepare(self, tolerance: float | None, start: float, stop: float, values: Starts) -> None:
        """See `Instance.prepare`; FMI 1.0 has no tolerance."""
        self._span = start, stop
        self.set_all(values)

    def enter_initialization(self) -> None:
        """See `Instance.enter_initialization`."""

    def get_all(self, variables: Sequence[FmuVariable]) -> list[Value]:
        """See `Instance.get_all`."""
        self.exit_initialization()
        return super().get_all(variables)

    def exit_initialization(self, stepped: bool = True) -> None:
        """Initialize the instance, once."""
        if self.stage == "instantiated":
            start, stop = self._span
            self.call("InitializeSlave", start, fmi1.fmi1True, stop)
            self.stage = "initialized"

    def reset(self) -> None:
        """See `Instance.reset`; FMI 1.0 resets without terminating."""
        self.call("ResetSlave")
        self.stage, self._values = "instantiated", None


_EVENT, _END, _EARLY = range(3)
"""Output flags of doStep."""
_CLOSE = 1e-9
"""Fraction of a step by which an early return may miss the end because of rounding."""
_RETURNS = 1000
"""Largest number of early returns in a communication step."""
_KEEP = True
"""Argument of doStep: no state before the step will be restored."""
_CHANGED = 2
"""Value of fmi3IntervalQualifier."""


class Instance3(Instance):
    """An instance of an FMU of FMI 3.0."""

    kinds = fmi3.FMU3Slave, fmi3.FMU3Model
    prefix, sized, derivatives_name = "fmi3", True, "GetContinuousStateDerivatives"
    slopes_name, state_name, deserialize = "GetOutputDerivatives", "FMUState", "DeserializeFMUState"
    dtypes = {  # noqa: RUF012
        "Float64": np.float64,
        "Float32": np.float32,
        "Boolean": np.bool_,
        "String": np.uintp,
        "Binary": np.uintp,
        **{name: np.dtype(name.lower()) for name in INTEGERS},
    }
    module = fmi3

    _begin, _end, _at, _held = math.nan, 0.0, 0.0, 0.0
    """Start and end of a step, its last update, and the time whose values on the ramp the inputs hold [s]."""
    _piece, _late = math.inf, 0.0
    """Length of the last internal step [s], and `_lag` up to the last update."""
    _opening = _piece, _late
    """Both of them at the start of the step."""
    _failed: CosimError | None = None
    """Error of an intermediate update."""

    def _make(self) -> None:
        token = self.token

        def receive(_: int | None, *message: Any) -> None:
            on_message(token, *message)

        if self.description.exchange:
            return self.fmu.instantiate(loggingOn=True, logMessage=receive)
        updated = self._updated if self.updates else None
        self.fmu.instantiate(False, True, self.event_mode, self.event_mode, receive, updated)

    def prepare(self, tolerance: float | None, start: float, stop: float, values: Starts) -> None:
        """See `Instance.prepare`."""
        self.tolerance = tolerance = tolerance or self.description.tolerance
        self._experiment = tolerance is not None, tolerance or 0.0, start, True, stop
        structure = [(v, x) for v, x in values if v.causality == "structuralParameter"]
        if structure:
            self.call("EnterConfigurationMode")
            self.set_all(structure)
            self.call("ExitConfigurationMode")
        self.set_all([pair for pair in values if pair not in structure])

    def enter_initialization(self) -> None:
        """See `Instance.enter_initialization`."""
        self.call("EnterInitializationMode", *self._experiment)

    def _simulation_call(self, clock: c_double, size: c_double) -> Call:
        step = self.function("DoStep")
        self.flags, self.reached = (c_ubyte * 4)(), c_double()
        """Results of doStep: output flags, in which an FMU may set any bit, and the last successful time [s]."""
        flags = (c_bool.from_buffer(self.flags, i) for i in (_EVENT, _END, _EARLY))
        self._answers = *map(byref, flags), byref(self.reached)

        def do_step(component: Any, clock: c_double, size: c_double, keep: Any) -> int:
            if self.updates:
                self._run_line(clock.value, clock.value + size.value)
            status = status_of(step, component, clock, size, keep, *self._answers)
            return self.complete(status, clock, size)

        return do_step, (self.fmu.component, clock, size, _KEEP), "doStep"

    def complete(self, status: int, clock: c_double, size: c_double) -> int:
        """Complete a step, given its status, `flags` and the time `reached`; return the last status."""
        if self._failed is not None:
            raise self._failed
        begin, end, any_flag = clock.value, clock.value + size.value, c_uint32.from_buffer(self.flags)
        close = end - _CLOSE * size.value
        for _ in range(_RETURNS):
            if not any_flag.value or status >= 2:
                return status
            last = self.reached.value
            if self.flags[_END] or self.flags[_EARLY]:
                self.check_end(begin, end - begin, last)
            if self._answered(self.flags, last, last >= close):
                return status
            if not (last > begin or self.flags[_EVENT]):
                reason = f"it returned early at t = {begin:.9g} s, where it began, without an event"
                raise self._failure("doStep", reason)
            begin, rest = last, (c_double(last), c_double(end - last))
            status = status_of(self.function("DoStep"), self.fmu.component, *rest, _KEEP, *self._answers)
        raise self._failure("doStep", f"it returned early {_RETURNS} times in a step, the last at t = {begin:.9g} s")

    def _run_line(self, begin: float, end: float) -> None:
        """Begin a step with ramped inputs; a repeated step begins as before."""
        if begin != self._begin:
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
        """Set the inputs for an internal step of a guessed length, so that their integral equals the ramp's.

        The value also corrects the error of the previous guess.
        """
        self._held = self._at + 0.5 * length + self._late / length
        self.line(self._held)

    def _answered(self, flags: Any, last: float, done: bool) -> bool:
        """Evaluate the output flags of a step; return False if more of the step remains than a rounding error."""
        self.event_needed = bool(flags[_EVENT])
        if flags[_END]:
            self.box.ended[self.name] = last
            return True
        if done or not flags[_EARLY]:
            return True
        if not self.event_mode:
            raise self._failure("doStep", f"it returned early, at t = {last:.9g} s, without permission")
        if self.event_needed:  # it alone: other components may be ahead
            self.box.event(self.name, last)
            self.enter_event()
            if any(self.clocks([v.reference for v in self.description.named("output") if v.clock])):
                reason = f"a clock ticks at t = {last:.9g} s, between two communication points"
                raise self._failure("getClock", f"{reason}, unseen by other components. Choose a step that ends there")
            self.update(last)
            self.leave_event()
        return self.name in self.box.ended

    def sizes(self) -> tuple[int, int]:
        """See `Instance.sizes`."""
        states, indicators = c_size_t(), c_size_t()
        self.call("GetNumberOfContinuousStates", byref(states))
        self.call("GetNumberOfEventIndicators", byref(indicators))
        return states.value, indicators.value

    def updated(self) -> tuple[bool, bool, float]:
        """See `Instance.updated`."""
        flags, after = [c_bool() for _ in range(5)], c_double()
        self.call("UpdateDiscreteStates", *map(byref, flags), byref(after))
        again, end, _, _, defined = (flag.value for flag in flags)
        return again, end, after.value if defined else math.inf

    def set_clocks(self, references: Sequence[int]) -> None:
        """Activate input clocks."""
        if n := len(references):
            self.call("SetClock", (c_uint32 * n)(*references), n, (c_bool * n)(*[True] * n))

    def clocks(self, references: Sequence[int]) -> list[bool]:
        """Return whether each output clock ticks."""
        if n := len(references):
            ticks = (c_bool * n)()
            self.call("GetClock", (c_uint32 * n)(*references), n, ticks)
            return list(ticks)
        return []

    def intervals(self, references: Sequence[int]) -> list[float | None]:
        """Return the intervals of clocks [s]; None if unchanged."""
        n = len(references)
        intervals, qualifiers = (c_double * n)(), (c_int * n)()
        self.call("GetIntervalDecimal", (c_uint32 * n)(*references), n, intervals, qualifiers)
        new = [x if q == _CHANGED else None for x, q in zip(intervals, qualifiers, strict=True)]
        if not all(x is None or 0.0 <= x < math.inf for x in new):
            raise self._failure("getIntervalDecimal", f"expected the interval of a clock, got {new} s")
        return new


def class_of(version: str) -> type[Instance]:
    """Return the class of instances of FMUs of a version of FMI."""
    return {FMI_1.name: Instance1, FMI_2.name: Instance2}.get(version, Instance3)
