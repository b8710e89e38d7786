"""An instance of an FMU of FMI 2.0."""

from __future__ import annotations

import math
from collections.abc import Sequence
from ctypes import byref, c_double, c_int, c_size_t, c_uint
from typing import Any

import numpy as np
from fmpy import fmi2

from vdfmu.base.arrays import Floats
from vdfmu.base.errors import CosimError
from vdfmu.engine.fmu.access import Call, Transfer
from vdfmu.engine.fmu.instance import Instance, Starts
from vdfmu.engine.fmu.messages import on_message
from vdfmu.engine.fmu.variables import FmuVariable

try:
    from fmpy.logging import addLoggerProxy
except Exception:  # no proxy library for this platform: messages come without their arguments
    addLoggerProxy = None

_LAST_SUCCESSFUL_TIME, _TERMINATED = 2, 3
"""Values of fmi2StatusKind."""


def _on_message(token: int | None, instance: bytes, status: int, category: bytes, text: bytes) -> None:
    on_message(token, status, category, text)


_RECEIVER = fmi2.fmi2CallbackLoggerTYPE(_on_message)


class Instance2(Instance):
    """An instance of an FMU of FMI 2.0."""

    kinds = fmi2.FMU2Slave, fmi2.FMU2Model
    prefix, sized, derivatives_name = "fmi2", False, "GetDerivatives"
    dtypes = {"Real": np.float64, "Integer": np.int32, "Boolean": np.int32, "String": np.uintp}  # noqa: RUF012

    def make(self) -> None:
        """See `Instance.make`."""
        default = fmi2.defaultCallbacks
        callbacks = fmi2.fmi2CallbackFunctions(
            _RECEIVER, default.allocateMemory, default.freeMemory, default.stepFinished, self.token
        )
        # pythonfmu passes its text as the format, without arguments: a percent sign must not be formatted.
        if addLoggerProxy is not None and not self.python:
            addLoggerProxy(byref(callbacks))
        # FMPy's container would log every call to its units, in a millisecond a step; their errors come anyway
        talkative = self.description.identifier == "container_fmu"
        self.fmu.instantiate(callbacks=callbacks, loggingOn=not talkative)

    def prepare(self, tolerance: float | None, start: float, stop: float, values: Starts) -> None:
        """See `Instance.prepare`."""
        self.tolerance = tolerance
        self.fmu.setupExperiment(tolerance, start, stop)
        self.set_all(values)

    def value_call(self, moved: Transfer) -> Call:
        """See `Instance.value_call`."""
        count, _ = moved.counts
        function = moved.around(self.function(moved.verb + moved.native))
        return function, (self.argument, byref(moved.references), count, moved.pointer), moved.name

    def simulation_call(self, clock: c_double, size: c_double) -> Call:
        """See `Instance.simulation_call`."""
        return self.function("DoStep"), (self.argument, clock, size, c_int.from_param(1)), "doStep"

    def rate_call(self, variables: Sequence[FmuVariable], starts: Floats, slopes: Floats, clock: c_double) -> Call:
        """See `Instance.rate_call`."""
        if self.integrator:
            return super().rate_call(variables, starts, slopes, clock)
        references = (c_uint * len(variables))(*(v.reference for v in variables))
        values = byref(c_double.from_buffer(slopes))  # pyright: ignore[reportArgumentType]
        return self._first_order("SetRealInputDerivatives", len(variables), references, values)

    def slope_call(self, moved: Transfer) -> Call:
        """See `Instance.slope_call`."""
        function, arguments, name = self._first_order(
            "GetRealOutputDerivatives", len(moved.references), moved.references, moved.pointer
        )
        return moved.around(function), arguments, name

    def _first_order(self, name: str, n: int, references: Any, values: Any) -> Call:
        """Return the call that gets or sets n first derivatives by time."""
        arguments = self.argument, references, c_size_t.from_param(n), (c_int * n)(*([1] * n)), values
        return self.function(name), arguments, name[0].lower() + name[1:]

    def sizes(self) -> tuple[int, int]:
        """See `Instance.sizes`."""
        return self.description.sizes

    def discrete_states(self) -> tuple[bool, bool, bool, bool, bool, float]:
        """See `Instance.discrete_states`."""
        return self.fmu.newDiscreteStates()

    def has_ended(self) -> bool:
        """See `Instance.has_ended`."""
        before, ended, time = len(self.box.pending), c_int(), c_double(math.nan)
        try:
            status = self.function("GetBooleanStatus")(self.argument, c_int(_TERMINATED), byref(ended))
            if status == 0 and ended.value:
                self.function("GetRealStatus")(self.argument, c_int(_LAST_SUCCESSFUL_TIME), byref(time))
                self.box.ended[self.name] = time.value
                return True
        except CosimError:  # a library without them
            pass
        del self.box.pending[before:]  # messages on these calls do not explain why it discarded the step
        return False
