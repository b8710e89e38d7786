"""One FMU of a run: its library, its calls and its messages, whatever its version of FMI."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Sequence
from ctypes import c_double, c_size_t, c_void_p
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from vdfmu.base.arrays import Floats
from vdfmu.base.errors import CosimError
from vdfmu.engine.fmu.access import DTYPES, Call, Transfer, held, shown
from vdfmu.engine.fmu.library import Library
from vdfmu.engine.fmu.messages import boxes
from vdfmu.engine.fmu.python_slaves import watched_slave
from vdfmu.engine.fmu.variables import FmuVariable
from vdfmu.engine.package.system import Value

Starts = Sequence[tuple[FmuVariable, Value]]
"""Variables, and the values that they are set to."""
_PASSED = ("ok", "warning", "discard", "pending")
"""Status of a message in freeInstance, which returns none: not a failure."""
_UPDATES = 1000
"""Most updates of discrete states at one event."""
_MAKING = threading.Lock()
"""Held while pythonfmu makes an instance: it changes ``sys.path`` and runs a script, for all threads."""


class Steps(Protocol):
    """Steps a component of model exchange; see :class:`vdfmu.engine.fmu.integrator.ModelExchangeIntegrator`."""

    def step_call(self, clock: c_double, size: c_double) -> Call:
        """Return the call of a step from `clock` by `size` [s]."""
        ...

    def differences(self, time: float, inputs: Sequence[FmuVariable], outputs: Sequence[FmuVariable]) -> Floats:
        """Return the derivatives of rates and outputs by states and inputs."""
        ...


class Instance(Library):
    """An instance of an FMU; the classes for the versions of FMI are `Instance2` and `Instance3`."""

    sized: bool
    """Whether the directional derivative takes the number of its values."""
    derivatives_name = ""
    """Function that gets the derivatives of the states."""
    dtypes: dict[str, Any] = {}  # noqa: RUF012
    """NumPy types by the types in the names of the functions."""

    tolerance: float | None = None
    integrator: Steps | None = None
    in_event = False
    next_event = math.inf
    event_mode = False
    """Whether the master handles events of its co-simulation."""
    updates = False
    """Whether its inputs run on lines, in its intermediate updates."""
    _values: dict[int, list[Value]] | None = None

    def line(self, time: float) -> None:
        """Set the inputs that run over the step to their values at a time."""

    # ------------------------------------------------------------------ for each version of FMI

    def make(self) -> None:
        """Create the instance, with messages switched on."""
        raise NotImplementedError

    def prepare(self, tolerance: float | None, start: float, stop: float, values: Starts) -> None:
        """State the experiment, and set values before the initialization."""
        raise NotImplementedError

    def value_call(self, moved: Transfer) -> Call:
        """Return the call that gets or sets values of one type."""
        raise NotImplementedError

    def simulation_call(self, clock: c_double, size: c_double) -> Call:
        """Return the call of a step of co-simulation from `clock` by `size` [s]."""
        raise NotImplementedError

    def slope_call(self, moved: Transfer) -> Call:
        """Return the call that gets the derivatives of real outputs by time."""
        raise NotImplementedError

    def sizes(self) -> tuple[int, int]:
        """Return the numbers of continuous states and of event indicators, for model exchange."""
        raise NotImplementedError

    def discrete_states(self) -> tuple[bool, bool, bool, bool, bool, float]:
        """Update the discrete states once; return whether to repeat it, to end, ..., and the next event."""
        raise NotImplementedError

    # ------------------------------------------------------------------ steps and events

    def step_call(self, clock: c_double, size: c_double) -> Call:
        """Return the call of a step from `clock` by `size` [s]."""
        return (self.integrator.step_call if self.integrator else self.simulation_call)(clock, size)

    def rate_call(self, variables: Sequence[FmuVariable], starts: Floats, slopes: Floats, clock: c_double) -> Call:
        """Return the call that lets real inputs run over a step, from their `starts` with their `slopes`."""
        values = np.zeros(len(variables))
        calls = self.access("Set", variables, values)

        def run() -> int:
            begin, first, slope = clock.value, starts.copy(), slopes.copy()

            def line(time: float) -> None:
                np.add(first, slope * (time - begin), values)
                self.run(calls)

            self.line = line
            return 0

        return run, (), "setRealInputDerivatives"

    def slopes(self, variables: Sequence[FmuVariable], values: Floats) -> Call:
        """Return the call that gets the derivatives of real outputs by time into `values`, in place."""
        places = range(len(variables))
        return self.slope_call(Transfer("Get", variables, places, values, np.float64, self._known, self._failure))

    def set_time(self, time: float) -> None:
        """Set the time of a model-exchange component, and the inputs that run."""
        self.call("SetTime", c_double(time))
        self.line(time)

    def transfer(self, name: str, values: Floats) -> None:
        """Get or set states, their derivatives or event indicators, in place, by the name of the function."""
        if values.size:
            self.call(name, c_void_p(values.ctypes.data), c_size_t(values.size))

    def update(self, time: float) -> None:
        """Update the discrete states at an event until they settle."""
        for _ in range(_UPDATES):
            again, end, _, _, defined, after = self.discrete_states()
            self.next_event = after if defined else math.inf
            if end:
                self.box.ended[self.name] = time
            if end or not again:
                return
        reason = f"its discrete states do not settle: they need more than {_UPDATES} updates"
        raise CosimError(self.name, "updateDiscreteStates", time, reason)

    def completed_step(self) -> bool:
        """Tell a model-exchange component that its solver has done a step; return whether that is an event."""
        event, end = self.fmu.completedIntegratorStep()
        if end:
            self.box.ended[self.name] = self.box.time
        return event or end

    def enter_event(self) -> None:
        """Enter event mode."""
        if not self.in_event:
            self.fmu.enterEventMode()
            self.in_event = True

    def leave_event(self) -> None:
        """Leave event mode to do steps."""
        if self.in_event:
            (self.fmu.enterContinuousTimeMode if self.integrator else self.fmu.enterStepMode)()
            self.in_event = False

    # ------------------------------------------------------------------ FMU state

    def saved_state(self) -> c_void_p:
        """Return a copy of the FMU state, to be freed with `free_state`."""
        return self.fmu.getFMUState()

    def restore_state(self, state: c_void_p) -> None:
        """Take the instance back to a saved state."""
        self.fmu.setFMUState(state)
        self.stage = "initialized"
        self.box.ended.pop(self.name, None)

    def free_state(self, state: c_void_p) -> None:
        """Free a saved state."""
        if not self.dead:
            self.fmu.freeFMUState(state)

    # ------------------------------------------------------------------ values

    def differentiate(self, unknowns: Sequence[int], size: int, knowns: Sequence[int], seeds: Floats) -> Floats:
        """Return the directional derivatives of unknowns, `size` numbers, by value references: a row for each of seeds.

        Parameters
        ----------
        seeds : (k, m) array
            Changes of the knowns.
        """
        found, seeds = np.zeros((len(seeds), size)), np.ascontiguousarray(seeds, np.float64)
        references = [np.array(each, np.uint32) for each in (unknowns, knowns)]
        head = [part for each in references for part in (c_void_p(each.ctypes.data), c_size_t(each.size))]
        given, rows = ([c_size_t(each.shape[1])][: self.sized] for each in (seeds, found))
        function, ends = self.function("GetDirectionalDerivative"), (seeds.ctypes.data, found.ctypes.data)
        for k in range(len(seeds)):
            seed, row = (c_void_p(end + k * each.strides[0]) for end, each in zip(ends, (seeds, found), strict=True))
            status = function(self.argument, *head, seed, *given, row, *rows)
            if status:
                self.judge(status, "GetDirectionalDerivative")
        return found

    def get(self, variable: FmuVariable) -> Value:
        """Get one variable."""
        values = np.zeros(1, DTYPES[variable.kind])
        self.run(self.access("Get", [variable], values))
        return shown(variable.kind, values[0])

    def set_all(self, values: Starts) -> None:
        """Set many variables with one call a type."""
        for variable, value in values:
            self._known(variable.reference)[variable.index] = value
        for kind, dtype in DTYPES.items():
            group = [(v, held(kind, x)) for v, x in values if v.kind == kind]
            if group:
                numbers = np.array([x for _, x in group], dtype)
                self.run(self.access("Set", [v for v, _ in group], numbers))

    def access(
        self,
        verb: str,
        variables: Sequence[FmuVariable],
        values: NDArray[Any],
        chosen: Callable[[FmuVariable], bool] = lambda v: True,
    ) -> list[Call]:
        """Return the calls that get or set the chosen variables of one kind, whose values are `values`, in place."""
        calls: list[Call] = []
        for native in dict.fromkeys(v.native for v in variables if chosen(v)):
            places = [i for i, v in enumerate(variables) if v.native == native and chosen(v)]
            own = [variables[i] for i in places]
            moved = Transfer(verb, own, places, values, self.dtypes[native], self._known, self._failure)
            calls.append(self.value_call(moved))
        return calls

    def between_events(self, variable: FmuVariable) -> bool:
        """Whether a variable is got or set between events, too."""
        return True

    def _failure(self, call: str, reason: str) -> CosimError:
        return CosimError(self.name, call, self.box.time, reason)

    def _known(self, reference: int) -> list[Value]:
        """Return the values of all elements of an input or parameter, as last set."""
        if self._values is None:
            self._values = {}
            for v in self.description.variables.values():
                self._values.setdefault(v.reference, [0] * v.length)[v.index] = v.start
        return self._values[reference]

    # ------------------------------------------------------------------ for all versions

    def instantiate(self) -> None:
        """Create the instance."""
        boxes[self.token] = (self.name, self.box)
        if self.python:
            with _MAKING, watched_slave(self.folder / "resources"):
                self.make()
        else:
            self.make()
        self.argument = c_void_p.from_param(self.fmu.component)
        self.stage = "instantiated"

    def enter_initialization(self) -> None:
        """Enter initialization mode."""
        self.fmu.enterInitializationMode()

    def exit_initialization(self, integrate: Callable[[Instance, float | None], Steps]) -> None:
        """Leave initialization mode; `integrate` makes the integrator of a model-exchange component, to a tolerance."""
        self.fmu.exitInitializationMode()
        self.stage = "initialized"
        if self.description.exchange:
            self.in_event = True
            self.integrator = integrate(self, self.tolerance)
            self.update(self.box.time)

    def reset(self) -> None:
        """Return the instance to its state after creation."""
        if self.stage == "initialized":
            self.fmu.terminate()
        self.fmu.reset()
        self.stage = "instantiated"
        self.integrator, self.in_event, self.next_event, self._values = None, False, math.inf, None

    def close(self) -> CosimError | None:
        """Terminate and free the instance as far as FMI allows in its state; return any failure."""
        failure = None
        try:
            if self.stage == "initialized" and not self.dead:
                try:
                    self.fmu.terminate()
                except CosimError as error:
                    self.stage, failure = "failed", error
            if self.fmu.component and not self.dead:
                self.box.flush()
                self.fmu.freeInstance()
                self.fmu.component = None
                if any(m.unit == self.name and m.status not in _PASSED for m in self.box.pending):
                    reason = self.box.reason(self.name)
                    failure = failure or CosimError(self.name, "freeInstance", self.box.time, reason)
        finally:
            self.box.flush()
            if not self.dead:  # a dead instance keeps its callbacks: nothing may free what it may still use
                boxes.pop(self.token, None)
            else:
                _unfreed.append(self)
        return failure


_unfreed: list[Instance] = []
"""Instances that may not be freed; kept so that their callbacks stay valid."""
