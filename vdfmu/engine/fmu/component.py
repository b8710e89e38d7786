"""One FMU of a run: its library, its calls and its messages, whatever its version of FMI."""

from __future__ import annotations

import itertools
import math
import threading
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from ctypes import CDLL, byref, c_double, c_int, c_size_t, c_uint, c_void_p
from pathlib import Path
from typing import Any, Protocol

import fmpy
import numpy as np
from numpy.typing import NDArray

from vdfmu.base.arrays import Floats
from vdfmu.base.errors import CosimError
from vdfmu.engine.fmu.access import DTYPES, Call, Transfer, held, shown
from vdfmu.engine.fmu.description import Description, library_name
from vdfmu.engine.fmu.messages import STATUS, MessageBox, boxes
from vdfmu.engine.fmu.variables import FmuVariable, Value

Starts = Sequence[tuple[FmuVariable, Value]]
"""Variables, and the values that they are set to."""
Watch = Callable[[str, str, Any], Any]
"""Returns a function that notes component and call before it calls the given function."""
_PASSED = ("ok", "warning", "discard", "pending")
"""Of a message in freeInstance, which has no status of its own: no failure."""
_UPDATES = 1000
"""Updates of discrete states at one event at most."""
_tokens = itertools.count(1)
_MAKING = threading.Lock()
"""Held while pythonfmu makes an instance: it changes ``sys.path`` and runs a script, for all threads."""


class Steps(Protocol):
    """Steps a component of model exchange; see :class:`vdfmu.engine.fmu.integrator.ModelExchangeIntegrator`."""

    def step_call(self, clock: c_double, size: c_double) -> Call:
        """Return the call of a step from `clock` by `size` [s]."""
        ...

    def differences(
        self, time: float, inputs: Sequence[FmuVariable], outputs: Sequence[FmuVariable]
    ) -> Floats:
        """Return the derivatives of rates and outputs by states and inputs."""
        ...


class Slave:
    """An instance of an FMU; the classes for the versions of FMI are `Slave2` and `Slave3`.

    After a fatal error neither it nor any other instance of the same FMU is called again (FMI 2.0, table of
    statuses), not even to free it.

    Parameters
    ----------
    name : str
        Component name.
    description : Description
    folder : Path
        Where the FMU is unpacked.
    box : MessageBox
    corrupt : set of str
        Sources of FMUs with a fatal error, shared by the units of a run.
    watch : callable, optional
        Around all that runs code of the FMU: its functions, and the loading of its library.
    """

    prefix = ""
    """Of the functions."""
    state_name = ""
    """Of a saved state in their names."""
    counted = True
    """Whether their arrays of numbers come with their sizes."""
    derivatives_name = ""
    """Function that gets the derivatives of the states."""
    results: dict[str, Any] = {}  # noqa: RUF012
    """Types of what the functions return that return no status."""
    dtypes: dict[str, Any] = {}  # noqa: RUF012
    """By the types in the names of the functions."""

    def __init__(
        self,
        name: str,
        description: Description,
        folder: Path,
        box: MessageBox,
        corrupt: set[str],
        watch: Watch | None = None,
    ) -> None:
        self.name = name
        self.description = description
        self.folder = folder
        self.box = box
        self.stage = "loaded"
        self._corrupt = corrupt
        self._functions: dict[str, Any] = {}
        self.token = next(_tokens)
        self._watch = watch or (lambda unit, call, function: function)
        # not by fmpy's class: it changes the working directory of the process, which all threads share
        try:
            path = str(folder / library_name(description.identifier, description.version))
            self._library: Any = self._watch(name, "load", CDLL)(path)
        except OSError as error:
            raise CosimError(name, "load", box.time, str(error)) from None
        self.python = (folder / "resources" / "slavemodule.txt").is_file()
        self.component = c_void_p()
        self.tolerance: float | None = None
        self.integrator: Steps | None = None
        self.in_event = False
        self.next_event = math.inf
        self.line: Callable[[float], None] = lambda time: None
        """Sets the inputs that run over the step to their values at a time."""
        self._values: dict[int, list[Value]] = {}

    # ------------------------------------------------------------------ of a version of FMI

    def make(self) -> int | None:
        """Create the instance, with messages switched on; return its address."""
        raise NotImplementedError

    def prepare(self, tolerance: float | None, start: float, stop: float, values: Starts) -> None:
        """Say what is to be simulated, and set values before the initialization."""
        raise NotImplementedError

    def enter_initialization(self) -> None:
        """Enter initialization mode."""
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

    def update(self, time: float) -> None:
        """Update the discrete states at an event."""
        raise NotImplementedError

    # ------------------------------------------------------------------ steps and events

    def step_call(self, clock: c_double, size: c_double) -> Call:
        """Return the call of a step from `clock` by `size` [s]."""
        return (self.integrator.step_call if self.integrator else self.simulation_call)(clock, size)

    def rate_call(
        self, variables: Sequence[FmuVariable], starts: Floats, slopes: Floats, clock: c_double
    ) -> Call:
        """Return the call that lets real inputs run over a step, from their `starts` with their `slopes`."""
        values = np.zeros(len(variables))
        calls = self.access("Set", variables, values)

        def run(*_: Any) -> int:
            begin, first, slope = clock.value, starts.copy(), slopes.copy()

            def line(time: float) -> None:
                np.add(first, slope * (time - begin), values)
                self.run(calls)

            self.line = line
            return 0

        return run, None, None, None, None, "setRealInputDerivatives"

    def slopes(self, variables: Sequence[FmuVariable], values: Floats) -> Call:
        """Return the call that gets the derivatives of real outputs by time into `values`, in place."""
        places = range(len(variables))
        return self.slope_call(
            Transfer("Get", variables, places, values, np.float64, self._known, self._failure)
        )

    def updated(self, time: float, update: Callable[[], tuple[bool, bool, float]]) -> None:
        """Update discrete states until they settle; `update` returns whether to go on, to end, and the next event."""
        for _ in range(_UPDATES):
            again, end, self.next_event = update()
            if end:
                self.box.ended[self.name] = time
            if end or not again:
                return
        reason = f"its discrete states do not settle: they need more than {_UPDATES} updates"
        raise CosimError(self.name, "updateDiscreteStates", time, reason)

    def completed_step(self) -> bool:
        """Tell a model-exchange component that its solver has done a step; return whether that is an event."""
        raise NotImplementedError

    def ended_step(self, event: bool, end: bool) -> bool:
        """Take the answers to that."""
        if end:
            self.box.ended[self.name] = self.box.time
        return event or end

    def enter_event(self) -> None:
        """Enter event mode."""
        if not self.in_event:
            self.call("EnterEventMode")
            self.in_event = True

    def leave_event(self) -> None:
        """Go on to steps."""
        if self.in_event:
            self.call("EnterContinuousTimeMode" if self.integrator else "EnterStepMode")
            self.in_event = False

    # ------------------------------------------------------------------ FMU state

    def saved_state(self) -> c_void_p:
        """Return a copy of the FMU state, to be freed with `free_state`."""
        state = c_void_p()
        self.call(f"Get{self.state_name}", byref(state))
        return state

    def restore_state(self, state: c_void_p) -> None:
        """Take the instance back to a saved state."""
        self.call(f"Set{self.state_name}", state)
        self.stage = "initialized"
        self.box.ended.pop(self.name, None)

    def free_state(self, state: c_void_p) -> None:
        """Free a saved state."""
        if not self.dead:
            self.call(f"Free{self.state_name}", byref(state))

    # ------------------------------------------------------------------ values

    def differentiate(
        self, unknowns: Sequence[int], size: int, knowns: Sequence[int], seed: Floats
    ) -> Floats:
        """Return the directional derivatives of unknowns, `size` numbers, by value references; seed: of the knowns."""
        found = np.zeros(size)
        arguments: list[Any] = []
        for references in (unknowns, knowns):
            arguments += (c_uint * len(references))(*references), c_size_t(len(references))
        for numbers in (seed, found):
            arguments += [c_void_p(numbers.ctypes.data), c_size_t(numbers.size)][: 1 + self.counted]
        self.call("GetDirectionalDerivative", *arguments)
        return found

    def get(self, variable: FmuVariable) -> Value:
        """Get one variable."""
        values = np.zeros(1, DTYPES[variable.kind])
        self.run(self.access("Get", [variable], values))
        return shown(variable.kind, values[0])

    def set(self, variable: FmuVariable, value: Value) -> None:
        """Set one variable."""
        self.set_all([(variable, value)])

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
        """Whether a variable is got or set between the events, too."""
        return True

    def run(self, calls: Sequence[Call]) -> None:
        """Make calls one after the other."""
        for function, a, b, c, d, name in calls:
            status = function(a, b, c, d)
            if status:
                self.judge(status, name)

    def _failure(self, call: str, reason: str) -> CosimError:
        return CosimError(self.name, call, self.box.time, reason)

    def _known(self, reference: int) -> list[Value]:
        """Return the values of all elements of an input or parameter, as they were set."""
        if not self._values:
            for v in self.description.variables.values():
                self._values.setdefault(v.reference, [0] * v.length)[v.index] = v.start
        return self._values[reference]

    # ------------------------------------------------------------------ of all

    def instantiate(self) -> None:
        """Create the instance."""
        boxes[self.token] = (self.name, self.box)
        with _MAKING if self.python else nullcontext():
            component = self.make()
        if not component:
            self.stage = "failed"
            raise CosimError(self.name, "instantiate", self.box.time, self.box.reason(self.name))
        self.component = c_void_p(component)
        self.stage = "instantiated"

    def exit_initialization(self, integrate: Callable[[Slave, float | None], Steps]) -> None:
        """Leave initialization mode; `integrate` makes what steps a component of model exchange, to a tolerance."""
        self.call("ExitInitializationMode")
        self.stage = "initialized"
        if self.description.exchange:
            self.in_event = True
            self.integrator = integrate(self, self.tolerance)
            self.update(self.box.time)

    def function(self, name: str) -> Any:
        """Return an FMI function, without its prefix, as a ctypes object; CosimError if the library has none."""
        if name not in self._functions:
            call = name[0].lower() + name[1:]
            try:
                function = self._library[self.prefix + name]
            except AttributeError:
                reason = f"the library has no function {self.prefix}{name}"
                raise CosimError(self.name, call, self.box.time, reason) from None
            function.restype = self.results.get(name, c_int)
            self._functions[name] = self._watch(self.name, call, function)
        return self._functions[name]

    def call(self, name: str, *arguments: Any) -> None:
        """Call a function with ctypes arguments; CosimError when its status is above warning."""
        status = self.function(name)(self.component, *arguments)
        if status:
            self.judge(status, name)

    def judge(self, status: int, call: str) -> None:
        """Pass over a warning, and over a step in which the unit ends the simulation; else raise CosimError."""
        if status == 1 or (status == 2 and call == "doStep" and self.has_ended()):
            return
        version = f"{self.description.version}"
        label = STATUS[status] if 0 <= status < len(STATUS) else f"{status}, not of FMI {version}"
        self.stage = "failed" if self.stage != "initialized" or status != 2 else self.stage
        if status == 4:
            self._corrupt.add(self.description.source)
        reason = "asynchronous steps are not supported" if status == 5 else self.box.reason(self.name)
        raise CosimError(self.name, call[0].lower() + call[1:], self.box.time, f"{reason} (status {label})")

    def has_ended(self) -> bool:
        """Whether the unit has discarded a step because the simulation is to end; note when."""
        return False

    @property
    def argument(self) -> Any:
        """The instance as an argument that is made ready once: ctypes would do it anew in each call."""
        return c_void_p.from_param(self.component.value)  # pyright: ignore[reportArgumentType]

    @property
    def dead(self) -> bool:
        """Whether the FMU has had a fatal error."""
        return self.description.source in self._corrupt

    def reset(self) -> None:
        """Take the instance back to what it was after its making."""
        if self.stage == "initialized":
            self.call("Terminate")
        self.call("Reset")
        self.stage = "instantiated"
        self.integrator, self.in_event, self.next_event = None, False, math.inf
        self._values.clear()

    def close(self) -> CosimError | None:
        """Terminate and free the instance as far as FMI allows in its state; return what failed in that."""
        failure = None
        try:
            if self.stage == "initialized" and not self.dead:
                try:
                    self.call("Terminate")
                except CosimError as error:
                    self.stage, failure = "failed", error
            if self.component and not self.dead:
                self.box.flush()
                self.function("FreeInstance")(self.component)
                self.component = c_void_p()
                if any(m.unit == self.name and m.status not in _PASSED for m in self.box.pending):
                    reason = self.box.reason(self.name)
                    failure = failure or CosimError(self.name, "freeInstance", self.box.time, reason)
                self._watch(self.name, "freeLibrary", fmpy.freeLibrary)(self._library._handle)
        finally:
            self.box.flush()
            if not self.dead:  # a dead instance keeps its callbacks: nothing may free what it may still use
                boxes.pop(self.token, None)
            else:
                _unfreed.append(self)
        return failure


_unfreed: list[Slave] = []
"""Instances that may not be freed; kept so that their callbacks stay valid."""
