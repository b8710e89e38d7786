"""The pythonfmu slave that all units share: phases, values, state, errors.

pythonfmu's own getters and setters call one Python function a variable; here a whole call is one slice of
the unit's memory. An exception is the only way in which a Python slave can make a call fail, and its text is
all that a user sees: it says unit, call, time, what was expected, what came and the way out.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager
from functools import cache, partial, wraps
from pathlib import Path
from struct import Struct
from typing import Any, ClassVar
from xml.etree.ElementTree import Element

import numpy as np
from pythonfmu import Fmi2Slave
from pythonfmu.enums import Fmi2Status

from vdfmu.base.arrays import Floats
from vdfmu.base.errors import FmuError, VdfmuError
from vdfmu.base.text import kind_text
from vdfmu.compiler.fmu.content import Content
from vdfmu.compiler.fmu.description import LOG_CATEGORIES, model_description
from vdfmu.compiler.fmu.python.behaviour import Behaviour
from vdfmu.compiler.fmu.python.wrapper import hold, hold_all_for_ever, hold_for_ever, loaded_from, plain, refusal
from vdfmu.compiler.unit.variable import Variable

_PHASES = ("instantiated", "initialization", "step", "terminated")
Read = Callable[[], list[float]]
Write = Callable[..., None]
_WHEN = {
    "instantiated": "before enterInitializationMode",
    "initialization": "between enterInitializationMode and exitInitializationMode",
    "step": "after exitInitializationMode and before terminate",
}
"""Names in messages of the phases in which something can be allowed."""


def _call(name: str) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Make every error of a call say unit, call and time, once; an interrupt from the keyboard too."""

    def decorate(method: Callable[..., Any]) -> Callable[..., Any]:
        @wraps(method)
        def guarded(self: UnitSlave, *args: Any) -> Any:
            try:
                return method(self, *args)
            except BaseException as error:
                hold_for_ever(self)
                time = f" at t = {self.time:.9g} s" if self.phase == "step" else ""
                raise refusal(f"{self.instance_name}: {name}{time} failed: {_words(error)}") from None

        return guarded

    return decorate


def _getter(kind: str, cast: Callable[[float], Any] | None = None) -> Callable[..., Any]:
    """Return the method that gets the values of variables of a type."""

    @_call(f"get{kind}")
    def get(self: UnitSlave, vrs: list[int]) -> list[Any]:
        values = self._get(kind, vrs)  # pyright: ignore[reportPrivateUsage]
        return values if cast is None else [cast(value) for value in values]

    return get


def _setter(kind: str) -> Callable[..., Any]:
    """Return the method that sets inputs or parameters of a type: all of a call, or none."""

    @_call(f"set{kind}")
    def put(self: UnitSlave, vrs: list[int], values: list[Any]) -> None:
        self._set(kind, vrs, values)  # pyright: ignore[reportPrivateUsage]

    return put


def _words(error: BaseException) -> str:
    if isinstance(error, KeyboardInterrupt):
        return "it was interrupted from the keyboard."
    if isinstance(error, VdfmuError):
        return str(error)
    return kind_text(error)


@contextmanager
def _told(name: str, words: str) -> Generator[None]:
    """Tell of an error of a call that has no slave; `words` may take it."""
    try:
        yield
    except (TypeError, ValueError) as error:
        hold_all_for_ever()
        raise refusal(f"{name} failed: {words.format(error)}") from None


class UnitSlave(Fmi2Slave):
    """The slave of all units; the subclasses of :func:`slave_class` have the model name in `unit`."""

    unit: ClassVar[str] = ""
    log_categories = LOG_CATEGORIES
    # of an instance that the wrapper has released, should it be called again
    instance_name, phase, time = "a unit that is free", "freed", 0.0

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        if "logger" in kwargs:  # the native wrapper calls, not the builder
            loaded_from(kwargs["resources"], self.unit)
        try:
            self._load(Path(kwargs["resources"]))
        except BaseException as error:
            hold_all_for_ever()
            raise refusal(f"{self.instance_name}: instantiate failed: {_words(error)}") from None
        hold(self)

    def _load(self, resources: Path) -> None:
        self.phase = "instantiated"
        self.time = 0.0
        self._content = content = Content.read(resources, self.unit)
        self.modelName = content.model_name
        self._interface = interface = content.interface
        self._variables = interface.variables
        self._memory = interface.memory_of({})
        self._behaviour = Behaviour(interface, self._memory)
        self._start_time = 0.0
        self._tolerance: float | None = None
        self._stale = True  # outputs and state are not those of the values set
        self._unchecked = True  # parameters were set since the last check
        # How to get and set what the last call of a type named: importers repeat themselves at every step.
        self._reads: dict[str, tuple[list[int], Read]] = {}
        self._writes: dict[str, tuple[list[int], Write, list[Variable], bool]] = {}

    def to_xml(self, model_options: dict[str, str] | None = None) -> Element:
        """Model description of the unit, with units, dependencies and InitialUnknowns."""
        content = self._content
        return model_description(content.interface, content.guid, content.generation_tool, content.made_by or {})

    def log(
        self, msg: str, status: Fmi2Status = Fmi2Status.ok, category: str | None = None, debug: bool | None = None
    ) -> None:
        """Send a message to the importer's logger."""
        super().log(plain(msg), status, category)

    # ---------------------------------------------------------------- life cycle

    @_call("setupExperiment")
    def setup_experiment(
        self, start_time: float, stop_time: float | None = None, tolerance: float | None = None
    ) -> None:
        """Take start time and tolerance of the experiment."""
        self._require("instantiated")
        if not math.isfinite(start_time):
            raise FmuError(f"expected a finite start time, got {start_time} s.")
        if tolerance is not None and not (math.isfinite(tolerance) and tolerance > 0.0):
            raise FmuError(f"expected a finite positive tolerance, got {tolerance}.")
        if tolerance is not None and "tolerance" in self._interface.groups:  # the unit has a solver
            problem = self._interface.find("tolerance").problem(tolerance)
            if problem:
                raise FmuError(f"tolerance: {problem}.")
        self._start_time = self.time = start_time
        self._tolerance = tolerance
        self._stale = True

    @_call("enterInitializationMode")
    def enter_initialization_mode(self) -> None:
        """Check the parameters and start."""
        self._require("instantiated")
        self._refresh()
        self._enter("initialization")

    @_call("exitInitializationMode")
    def exit_initialization_mode(self) -> None:
        """End the time in which fixed parameters can be set."""
        self._require("initialization")
        self._refresh()
        self._enter("step")
        self.log(f"{self.instance_name}: starts at t = {self.time:g} s", Fmi2Status.ok, "logEvents")

    @_call("doStep")
    def do_step(self, current_time: float, step_size: float) -> bool:
        """Move from `current_time` by `step_size` [s]."""
        if self.phase != "step":
            self._require("step")
        if not (math.isfinite(step_size) and step_size > 0.0):
            raise FmuError(f"expected a finite positive communication step, got {step_size} s.")
        if not abs(current_time - self.time) <= 1e-6 * step_size + 1e-12 * abs(self.time):
            raise FmuError(
                f"expected the communication point t = {self.time!r} s, where the last step ended, got "
                f"t = {current_time!r} s."
            )
        self._behaviour.step(current_time, step_size)
        self.time = current_time + step_size
        return True

    @_call("terminate")
    def terminate(self) -> None:
        """End the run; values can still be read."""
        self._require("step")
        self._enter("terminated")

    def _enter(self, phase: str) -> None:
        self.phase = phase
        self._reads.clear()
        self._writes.clear()

    def _require(self, *phases: str) -> None:
        if self.phase not in phases:
            raise FmuError(f"it is allowed only {' or '.join(_WHEN[phase] for phase in phases)}.")

    def _refresh(self) -> None:
        """Calculate state and outputs from what is set, until the initialization ends."""
        if not self._stale:
            return
        if self._unchecked:
            problems = self._behaviour.check()
            if problems:
                raise FmuError(" ".join(problems))
            self._unchecked = False
        self._behaviour.start(self._start_time, self._tolerance)
        self._behaviour.outputs(self._start_time)
        self._stale = False

    # ---------------------------------------------------------------- values

    get_real, get_integer, get_boolean = _getter("Real"), _getter("Integer", int), _getter("Boolean", bool)
    set_real, set_integer, set_boolean = map(_setter, ("Real", "Integer", "Boolean"))
    get_string, set_string = _getter("String"), _setter("String")  # there are no string variables

    def _get(self, kind: str, vrs: list[int]) -> list[float]:
        last = self._reads.get(kind)
        if last is None or last[0] != vrs:
            last = self._reads[kind] = (vrs, self._reader(kind, vrs))
        if self._stale and self.phase == "initialization":
            self._refresh()
        return last[1]()

    def _set(self, kind: str, vrs: list[int], values: list[Any]) -> None:
        last = self._writes.get(kind)
        if last is None or last[0] != vrs:
            last = self._writes[kind] = (vrs, *self._writer(kind, vrs))
        _, write, variables, any_number = last
        # of inputs without limits only the sum is looked at: it is not finite if one of them is not
        if not (any_number and math.isfinite(sum(values))):
            for variable, value in zip(variables, values, strict=True):
                problem = variable.problem(value)
                if problem:
                    raise FmuError(f"{variable.name}: {problem}.")
            self._unchecked = self._unchecked or not any_number
        write(*values)
        self._stale = True

    def _reader(self, kind: str, vrs: list[int]) -> Read:
        for variable in self._resolve(kind, vrs):
            if variable.causality == "output" and self.phase == "instantiated":
                raise FmuError(f"{variable.name} is an output: it has no value before enterInitializationMode.")
        return _reader(self._memory, vrs)

    def _writer(self, kind: str, vrs: list[int]) -> tuple[Write, list[Variable], bool]:
        variables = self._resolve(kind, vrs)
        for variable in variables:
            self._refuse(variable)
        any_number = all(v.causality == "input" and v.minimum is v.maximum is None for v in variables)
        return _writer(self._memory, vrs), variables, any_number

    def _resolve(self, kind: str, vrs: Sequence[int]) -> list[Variable]:
        """Variables of value references, which must exist and be of the type."""
        found: list[Variable] = []
        for vr in vrs:
            if not 0 <= vr < len(self._variables):
                last = len(self._variables) - 1
                raise FmuError(f"there is no value reference {vr}; they go from 0 to {last}.")
            variable = self._variables[vr]
            if variable.type != kind:
                raise FmuError(
                    f"expected variables of type {kind}, got {variable.name} (value reference {vr}) of type "
                    f"{variable.type}."
                )
            found.append(variable)
        return found

    def _refuse(self, variable: Variable) -> None:
        """Raise if a variable cannot be set now."""
        if variable.causality == "output":
            raise FmuError(f"{variable.name} is an output and cannot be set.")
        if variable.variability == "fixed" and self.phase == "step":
            raise FmuError(
                f"{variable.name} is a fixed parameter and can be set only before exitInitializationMode. "
                "Reset the unit to set it."
            )
        self._require("instantiated", "initialization", "step")

    # ---------------------------------------------------------------- state

    @_call("getFMUstate")
    def _get_fmu_state(self) -> dict[str, Any]:
        return {
            "guid": self._content.guid,
            "phase": _PHASES.index(self.phase),
            "time": self.time,
            "start_time": self._start_time,
            "experiment_tolerance": self._tolerance,
            "stale": self._stale,
            "memory": self._memory.tolist(),
            "behaviour": self._behaviour.state(),
        }

    @_call("setFMUstate")
    def _set_fmu_state(self, state: Any) -> None:
        known: dict[str, Any] = state if isinstance(state, dict) else {}
        guid = known.get("guid")
        if guid != self._content.guid:
            raise FmuError(
                f"expected a state of {self._content.model_name} with GUID {self._content.guid}, got "
                f"{f'one with GUID {guid}' if guid else 'something else'}."
            )
        try:
            phase, stale = _PHASES[known["phase"]], bool(known["stale"])
            times = known["time"], known["start_time"], known["experiment_tolerance"]
            memory = np.array(known["memory"], dtype=float).reshape(len(self._memory))
            self._behaviour.restore(known["behaviour"])  # the last that may fail: nothing has changed yet
        except (LookupError, TypeError, ValueError) as error:
            raise FmuError(f"the state is damaged: {kind_text(error)}.") from None
        self._memory[:] = memory
        self.time, self._start_time, self._tolerance = times
        self._stale, self._unchecked = stale, True
        self._enter(phase)

    @staticmethod
    def _fmu_state_to_bytes(state: Any) -> bytes:
        with _told("serializeFMUstate", "this is not a state of a vdfmu unit: {}."):
            return json.dumps(state).encode()

    @staticmethod
    def _fmu_state_from_bytes(state: bytes) -> Any:
        with _told("deSerializeFMUstate", f"expected the bytes of a state, got {len(state)} other bytes."):
            return json.loads(state.decode())


def _reader(memory: Floats, vrs: list[int]) -> Read:
    """Return a function that reads the elements `vrs`."""
    if _consecutive(vrs):
        return memory[vrs[0] : vrs[0] + len(vrs)].tolist
    index = np.array(vrs, dtype=np.intp)
    return lambda: memory[index].tolist()


def _writer(memory: Floats, vrs: list[int]) -> Write:
    """Return a function that writes its arguments to the elements `vrs`."""
    if _consecutive(vrs):  # twice as fast as numpy, which looks at the type of each number
        return partial(Struct(f"{len(vrs)}d").pack_into, memory.data, vrs[0] * memory.itemsize)
    index = np.array(vrs, dtype=np.intp)
    return lambda *values: memory.__setitem__(index, values)


def _consecutive(vrs: list[int]) -> bool:
    """Whether references count up by one, and so are a slice of the memory."""
    return bool(vrs) and vrs == list(range(vrs[0], vrs[0] + len(vrs)))


@cache
def slave_class(model_name: str) -> type[UnitSlave]:
    """Return the class of the slaves of a model.

    There is one in a process: the wrapper runs the script of the FMU at each instantiation, and releases the class of a
    slave more often than it takes it.
    """
    return type(f"{model_name}Slave", (UnitSlave,), {"unit": model_name})
