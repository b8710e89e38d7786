"""An FMU instance of a run, of any version of FMI."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Sequence
from ctypes import byref, c_double, c_int, c_size_t, c_uint, c_void_p
from itertools import groupby
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vdfmu.base.arrays import Floats
from vdfmu.base.errors import CosimError
from vdfmu.engine.fmu.access import DTYPES, Call, Transfer, held, shared, shown_all
from vdfmu.engine.fmu.integrator import ModelExchangeIntegrator
from vdfmu.engine.fmu.library import Library
from vdfmu.engine.fmu.messages import boxes, watched_slave
from vdfmu.engine.fmu.variables import FmuVariable
from vdfmu.engine.package.system import Value

Starts = Sequence[tuple[FmuVariable, Value]]
"""Variables and their new values."""
_Access = tuple[NDArray[Any], list[int], list[Call]]
_PASSED = ("ok", "warning", "discard", "pending")
"""Highest status of messages in freeInstance that is not a failure; the call itself returns no status."""
_UPDATES = 1000
"""Largest number of updates of discrete states at an event."""
_DRIFT = 1e-9
"""Relative error of a time that is the sum of 10 million steps: each addition rounds by at most 2^-53."""
_MAKING = threading.Lock()
"""Lock held while pythonfmu makes an instance, because it changes ``sys.path`` and runs a script for all threads."""


class Instance(Library):
    """An instance of an FMU; `vdfmu.engine.fmu.versions` has its classes for each version of FMI."""

    sized: bool
    """Whether functions with arrays accept the number of their values."""
    end_name = "Terminate"
    """Function that terminates a simulation."""
    derivatives_name = slopes_name = state_name = deserialize = ""
    """Functions that get the derivatives of states and of outputs, the word for the FMU state in names of functions,
    and the function that makes a state from bytes."""
    dtypes: dict[str, Any] = {}  # noqa: RUF012
    """NumPy types by the type in a function's name."""
    module: Any
    """Module of fmpy with the types of the version."""

    tolerance: float | None = None
    integrator: ModelExchangeIntegrator | None = None
    in_event = False
    next_event = math.inf
    event_mode = False
    """Whether the master handles events of the co-simulation."""
    event_needed = False
    """Whether a step has ended at an event."""
    step: tuple[c_double, c_double]
    """Start and length of the last step [s]."""
    updates = False
    """Whether the inputs are ramped by intermediate updates."""
    _values: dict[int, list[Value]] | None = None

    def line(self, time: float) -> None:
        """Set the ramped inputs to their values at a time."""

    def kind_of(self, name: str) -> Any:
        """Return the ctypes type of an FMI type by its name, such as ``Boolean``."""
        return getattr(self.module, self.prefix + name)

    # ------------------------------------------------------------------ for each version of FMI

    def _make(self) -> None:
        """Create the instance, with messages switched on."""
        raise NotImplementedError

    def prepare(self, tolerance: float | None, start: float, stop: float, values: Starts) -> None:
        """Set the experiment, and values before the initialization."""
        raise NotImplementedError

    def _simulation_call(self, clock: c_double, size: c_double) -> Call:
        """Return the call of a step of co-simulation from `clock` by `size` [s]."""
        raise NotImplementedError

    def updated(self) -> tuple[bool, bool, float]:
        """Update the discrete states; return whether to repeat that, whether the simulation ends, and the next event.

        The time of the next event is infinite if there is none [s].
        """
        raise NotImplementedError

    def sizes(self) -> tuple[int, int]:
        """Return the numbers of continuous states and of event indicators, for model exchange."""
        return self.description.sizes

    def check_end(self, begin: float, size: float, end: float) -> None:
        """Check the reported time [s] at which a step from `begin` ended; CosimError if it is not within the step."""
        close = _DRIFT * (abs(begin) + size)
        if not begin - close <= end <= begin + size + close:
            step = f"the step from t = {begin:.9g} s to t = {begin + size:.9g} s"
            raise self._failure("doStep", f"it reports that {step} ended at t = {end:.9g} s")

    # ------------------------------------------------------------------ steps and events

    def step_call(self, clock: c_double, size: c_double) -> Call:
        """Return the call of a step from `clock` by `size` [s]."""
        return (self.integrator.step_call if self.integrator else self._simulation_call)(clock, size)

    def rate_call(self, variables: Sequence[FmuVariable], starts: Floats, slopes: Floats, clock: c_double) -> Call:
        """Return the call that ramps real inputs over a step, from their `starts` with their `slopes`."""
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
        """Return the call that writes the time derivatives of real outputs to `values`, in place."""
        places = range(len(variables))
        moved = Transfer("Get", variables, places, values, np.float64, self._last_set, self._failure)
        orders = [(c_int * len(moved.references))(*([1] * len(moved.references)))]
        return self._call_of(moved, self.slopes_name, c_double, orders)

    def set_time(self, time: float) -> None:
        """Set the time of a model-exchange component, and its ramped inputs."""
        self.call("SetTime", c_double(time))
        self.line(time)

    def transfer(self, name: str, values: Floats) -> None:
        """Get or set states, their derivatives or event indicators in place, by the function of this name."""
        if values.size:
            self.call(name, shared(c_double, values), values.size)

    def update(self, time: float) -> None:
        """Update the discrete states at an event until they settle."""
        for _ in range(_UPDATES):
            again, end, self.next_event = self.updated()
            if not self.next_event >= time - _DRIFT * abs(time):
                reason = f"its next event must not be before this time, got t = {self.next_event:.9g} s"
                raise CosimError(self.name, "updateDiscreteStates", time, reason)
            if end:
                self.box.ended[self.name] = time
            if end or not again:
                return
        reason = f"its discrete states do not settle: they need more than {_UPDATES} updates"
        raise CosimError(self.name, "updateDiscreteStates", time, reason)

    def completed_step(self) -> bool:
        """Report a solver step to a model-exchange component; return whether an event follows."""
        event, end = (self.kind_of("Boolean")() for _ in range(2))
        self.call("CompletedIntegratorStep", True, byref(event), byref(end))
        if end:
            self.box.ended[self.name] = self.box.time
        return bool(event or end)

    def happened(self, time: float, changed: NDArray[np.bool_]) -> None:
        """Note an event of model exchange; `changed` are the event indicators whose signs have changed."""
        self.box.event(self.name, time)

    def enter_event(self) -> None:
        """Enter event mode."""
        self.event_needed = False
        if not self.in_event:
            self.call("EnterEventMode")
            self.in_event = True

    def leave_event(self) -> None:
        """Leave event mode to do steps."""
        if self.in_event:
            self.call("EnterContinuousTimeMode" if self.integrator else "EnterStepMode")
            self.in_event = False

    def saved_state(self) -> c_void_p:
        """Return a copy of the FMU state, which must be freed with `free_state`."""
        state = c_void_p()
        self.call(f"Get{self.state_name}", byref(state))
        return state

    def restore_state(self, state: c_void_p) -> None:
        """Restore a saved state."""
        self.call(f"Set{self.state_name}", state)
        self.stage = "initialized"
        self.box.ended.pop(self.name, None)

    def free_state(self, state: c_void_p) -> None:
        """Free a saved state."""
        if not self.dead:
            self.call(f"Free{self.state_name}", byref(state))

    def copied_state(self, state: c_void_p) -> c_void_p:
        """Return a copy of a saved state, made from its bytes; free the state."""
        size, copy = c_size_t(), c_void_p()
        self.call(f"Serialized{self.state_name}Size", state, byref(size))
        content = (self.kind_of("Byte") * size.value)()
        self.call(f"Serialize{self.state_name}", state, content, size)
        self.free_state(state)
        self.call(self.deserialize, content, size, byref(copy))
        return copy

    def derivative(
        self, unknowns: Sequence[int], size: int, knowns: Sequence[int], seeds: Floats
    ) -> Callable[[], Floats]:
        """Return a function from seeds of the knowns, (k, m), to directional derivatives of unknowns, (k, size).

        Variables are given by their value references. The function returns the same array each time.
        """
        arrays = np.zeros((len(seeds), size)), np.array(seeds, np.float64)
        head = [part for each in (unknowns, knowns) for part in ((c_uint * len(each))(*each), len(each))]
        n_values, n_seeds = ([each.shape[1]][: self.sized] for each in arrays)
        name = "GetDirectionalDerivative"
        calls: list[Call] = []
        for k in range(len(seeds)):
            row, seed = (shared(c_double, each[k]) for each in arrays)
            calls.append((self.function(name), (self.fmu.component, *head, seed, *n_seeds, row, *n_values), name))

        def calculate() -> Floats:
            self.run(calls)
            return arrays[0]

        return calculate

    def get_all(self, variables: Sequence[FmuVariable]) -> list[Value]:
        """Get many variables with one call per type."""
        values: list[Value] = [0] * len(variables)
        for numbers, places, calls in self._accesses("Get", tuple(variables)):
            self.run(calls)
            kind = variables[places[0]].kind
            for number, place in zip(shown_all(kind, numbers), places, strict=True):
                values[place] = number
        return values

    def set_all(self, values: Starts) -> None:
        """Set many variables with one call per type."""
        arrays = [(variable, value) for variable, value in values if variable.length > 1]
        for reference, elements in groupby(arrays, lambda pair: pair[0].reference):
            last = self._last_set(reference)
            for variable, value in elements:
                last[variable.index] = value
        for numbers, places, calls in self._accesses("Set", tuple(v for v, _ in values)):
            kind = values[places[0]][0].kind
            numbers[:] = [held(kind, values[i][1]) for i in places]
            self.run(calls)

    def _accesses(self, verb: str, variables: tuple[FmuVariable, ...]) -> list[_Access]:
        """Return memory, places in `variables` and calls of each kind; cached unless there are elements of arrays."""
        key = verb, *map(id, variables)
        if key in self._kept:
            return self._kept[key][1]
        made: list[_Access] = []
        for kind, dtype in DTYPES.items():
            if places := [i for i, v in enumerate(variables) if v.kind == kind]:
                memory = np.zeros(len(places), dtype)
                made.append((memory, places, self.access(verb, [variables[i] for i in places], memory)))
        if verb == "Get" or all(v.length == 1 for v in variables):
            self._kept[key] = variables, made
        return made

    def access(
        self,
        verb: str,
        variables: Sequence[FmuVariable],
        values: NDArray[Any],
        chosen: Callable[[FmuVariable], bool] = lambda v: True,
    ) -> list[Call]:
        """Return the calls that get or set the chosen variables of one kind, with the values `values`, in place."""
        return self.calls_of(self.transfers(verb, variables, values, chosen))

    def calls_of(self, transfers: Sequence[Transfer]) -> list[Call]:
        """Return the calls of transfers."""
        return [
            self._call_of(
                moved,
                moved.verb + moved.native,
                self.kind_of(moved.native),
                [shared(c_size_t, moved.sizes)] if moved.native == "Binary" else [],
            )
            for moved in transfers
        ]

    def _call_of(self, moved: Transfer, name: str, kind: Any, more: Sequence[Any]) -> Call:
        """Return the call of a function that gets or sets values, with `more` arguments before them."""
        values = shared(kind, moved.memory), *[moved.memory.size][: self.sized]
        arguments = self.fmu.component, moved.references, len(moved.references), *more, *values
        return moved.around(self.function(name)), arguments, name[0].lower() + name[1:]

    def transfers(
        self, verb: str, variables: Sequence[FmuVariable], values: NDArray[Any], chosen: Callable[[FmuVariable], bool]
    ) -> list[Transfer]:
        """Return the transfers of these calls."""
        by_type: dict[str, list[int]] = {}
        for i, v in enumerate(variables):
            if chosen(v):
                by_type.setdefault(v.native, []).append(i)
        transfers: list[Transfer] = []
        for native, places in by_type.items():
            alike = [variables[i] for i in places]
            dtype = self.dtypes[native]
            transfers.append(Transfer(verb, alike, places, values, dtype, self._last_set, self._failure))
        return transfers

    def between_events(self, variable: FmuVariable) -> bool:
        """Return whether a variable is read or set between events; clocked ones and discrete inputs need event mode."""
        held = variable.causality not in ("output", "local") and variable.variability == "discrete"
        return not self.event_mode or not (variable.clocks or held)

    def _failure(self, call: str, reason: str) -> CosimError:
        return CosimError(self.name, call, self.box.time, reason)

    def _last_set(self, reference: int) -> list[Value]:
        """Return the values last set of all elements of an input or parameter."""
        if self._values is None:
            self._values = {}
            for v in self.description.variables.values():
                if v.reference not in self._values:
                    self._values[v.reference] = [0] * v.length
                self._values[v.reference][v.index] = v.start
        return self._values[reference]

    def instantiate(self) -> None:
        """Create the instance."""
        self._kept: dict[tuple[str | int, ...], tuple[tuple[FmuVariable, ...], list[_Access]]] = {}
        """Accesses by the ids of their variables."""
        boxes[self.token] = (self.name, self.box)
        if self.python:
            with _MAKING, watched_slave(self.folder / "resources"):
                try:
                    self._made()
                finally:
                    self.let_go()
        else:
            self._made()
        self.stage = "instantiated"

    def _made(self) -> None:
        try:
            self._make()
        except Exception as error:
            if type(error) is not Exception:  # fmpy raises a bare exception without an instance, and none for FMI 1.0
                raise
        if not self.fmu.component:
            self.stage = "failed"
            raise CosimError(self.name, "instantiate", self.box.time, self._reason())

    def enter_initialization(self) -> None:
        """Enter initialization mode."""
        self.call("EnterInitializationMode")

    def exit_initialization(self, stepped: bool = True) -> None:
        """Leave initialization mode; a model-exchange component gets an integrator if it is `stepped`."""
        self.call("ExitInitializationMode")
        self.stage, self.event_needed = "initialized", False
        self.in_event = self.event_mode or self.description.exchange
        if self.description.exchange:
            self.integrator = ModelExchangeIntegrator(self, self.tolerance) if stepped else None
            self.update(self.box.time)

    def reset(self) -> None:
        """Return the instance to its state after creation."""
        if failure := self.terminate():
            raise failure
        self.call("Reset")
        self.stage = "instantiated"
        self.integrator, self.in_event, self.next_event, self._values = None, False, math.inf, None

    def terminate(self) -> CosimError | None:
        """Terminate the instance if it is initialized; return any failure."""
        if self.stage == "initialized" and not self.dead:
            try:
                self.call(self.end_name)
                self.stage = "terminated"
            except CosimError as error:
                self.stage = "failed"
                return error
        return None

    def close(self) -> CosimError | None:
        """Terminate and free the instance as far as FMI allows in its state; return any failure."""
        failure = None
        try:
            failure = self.terminate()
            if self.fmu.component and not self.dead:
                self.box.flush()
                self.fmu.freeInstance()
                self.fmu.component = None
                if any(m.unit == self.name and m.status not in _PASSED for m in self.box.pending):
                    reason = self.box.reason(self.name)
                    failure = failure or CosimError(self.name, "freeInstance", self.box.time, reason)
        finally:
            self.box.flush()
            if self.dead:
                _unfreed.append(self)
            else:
                boxes.pop(self.token, None)
        return failure


_unfreed: list[Instance] = []
"""Instances after a fatal error: they must not be freed, and may still use their callbacks."""
