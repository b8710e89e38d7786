"""The pythonfmu slave of all units: phases, values, state and errors around the evaluation of a unit.

A Python slave can only fail with an exception, and users see only its text, so it contains unit, call, time, expected
and actual value, and the fix.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Sequence
from functools import cache, lru_cache, partial, wraps
from pathlib import Path
from typing import Any, ClassVar
from xml.etree.ElementTree import Element

import numpy as np
from pythonfmu import Fmi2Slave
from pythonfmu.enums import Fmi2Status

from vdfmu.base.errors import FmuError, KernelError, UnitError, VdfmuError
from vdfmu.base.files import read_json, read_text
from vdfmu.base.text import kind_text
from vdfmu.base.version import __version__
from vdfmu.compiler.fmu.content import CONTENT_FILE, Content
from vdfmu.compiler.fmu.description import LOG_CATEGORIES, model_description
from vdfmu.compiler.fmu.python.wrapper import hold, loaded_from, plain, refusal
from vdfmu.compiler.unit.evaluate import Traced, evaluation, unmet
from vdfmu.compiler.unit.solver import FIRST_STEP, Integrator, ScipySolver
from vdfmu.compiler.unit.variable import Variable

_WHEN = {
    "instantiated": "before enterInitializationMode",
    "initialization": "between enterInitializationMode and exitInitializationMode",
    "step": "after exitInitializationMode and before terminate",
    "terminated": "after terminate",
}
"""Phases to their names in messages."""
_SAVED = ("h", "tolerance", "start")
"""Attributes of a solver that determine how it continues."""


def _call(name: str) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Add unit, call and time, once, to every error of a call and to an interrupt from the keyboard."""

    def decorate(method: Callable[..., Any]) -> Callable[..., Any]:
        @wraps(method)
        def guarded(self: UnitSlave, *args: Any) -> Any:
            try:
                return method(self, *args)
            except BaseException as error:
                time = f" at t = {self.time:.9g} s" if self.phase == "step" else ""
                raise refusal(f"{self.instance_name}: {name}{time} failed: {_words(error)}", self) from None

        return guarded

    return decorate


def _words(error: BaseException) -> str:
    if isinstance(error, KeyboardInterrupt):
        return "it was interrupted from the keyboard."
    return str(error) if isinstance(error, VdfmuError) else kind_text(error)


class UnitSlave(Fmi2Slave):
    """The slave of all units; the subclasses of :func:`slave_class` have the model name in `unit`."""

    unit: ClassVar[str] = ""
    standard: ClassVar[partial[Content] | None] = None
    """Makes the content of an FMU without a content file, such as pythonfmu builds from a file of ``fmu_src``."""
    log_categories = LOG_CATEGORIES
    # for an instance that the wrapper has released, in case it is called again
    instance_name, phase, time = "a unit that is free", "freed", 0.0

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        if "logger" in kwargs:  # the native wrapper calls this, not the builder
            loaded_from(kwargs["resources"], self.unit)
        try:
            self._content = content = self._read(Path(kwargs["resources"]), built="logger" in kwargs)
            self._unit = unit = evaluation(content.interface)
            rodas = content.interface.has_states and isinstance(unit, Traced)
            self._solver = Integrator(unit) if rodas else ScipySolver(unit)
        except BaseException as error:
            raise refusal(f"{self.instance_name}: instantiate failed: {_words(error)}") from None
        self.modelName, self._interface = content.model_name, content.interface
        self.phase, self.time, self._start_time = "instantiated", 0.0, 0.0
        self._tolerance: float | None = None
        self._stale = True  # values were set since the last calculation of outputs and state
        self._unchecked = True  # parameters were set since the last check
        # importers repeat calls at every step; a reference to the slave would keep it alive
        self._variables = lru_cache(16)(partial(_checked, content.interface.variables))
        hold(self)

    def _read(self, resources: Path, built: bool) -> Content:
        if self.standard is None or (resources / CONTENT_FILE).is_file():
            return Content.read(resources, self.unit)
        content = self.standard()
        description = resources.parent / "modelDescription.xml"
        described = built and description.is_file()  # some importers do not unpack the file
        if described and content.guid not in read_text(description):
            raise FmuError(
                f"{self.unit}.fmu does not match the vdfmu of this Python, {__version__}: it was built with another "
                "version or other sources, or its content file is missing. Build the FMU again."
            )
        return content

    def to_xml(self, model_options: dict[str, str] | None = None) -> Element:
        """Return the model description of the unit, with units, dependencies and InitialUnknowns."""
        content = self._content
        return model_description(content.interface, content.guid, content.generation_tool, content.made_by)

    @_call("setupExperiment")
    def setup_experiment(
        self, start_time: float, stop_time: float | None = None, tolerance: float | None = None
    ) -> None:
        """Set the start time and tolerance of the experiment."""
        self._require("instantiated")
        if not math.isfinite(start_time):
            raise FmuError(f"expected a finite start time, got {start_time} s.")
        if tolerance is not None and not (math.isfinite(tolerance) and tolerance > 0.0):
            raise FmuError(f"expected a finite positive tolerance, got {tolerance}.")
        solved = tolerance is not None and "tolerance" in self._interface.groups
        if solved and (problem := self._interface.find("tolerance").problem(tolerance)):
            raise FmuError(f"tolerance: {problem}.")
        self._start_time = self.time = start_time
        self._tolerance, self._stale = tolerance, True

    @_call("enterInitializationMode")
    def enter_initialization_mode(self) -> None:
        """Check the parameters and start the simulation."""
        self._require("instantiated")
        self._refresh()
        self.phase = "initialization"

    @_call("exitInitializationMode")
    def exit_initialization_mode(self) -> None:
        """End the initialization: fixed parameters can no longer be set."""
        self._require("initialization")
        self._refresh()
        self._solver.events.begin()
        self.phase = "step"
        self._say(f"starts at t = {self.time:g} s")

    def _say(self, text: str) -> None:
        self.log(plain(f"{self.instance_name}: {text}"), Fmi2Status.ok, "logEvents")

    @_call("doStep")
    def do_step(self, current_time: float, step_size: float) -> bool:
        """Move from `current_time` by `step_size` [s], with the inputs held."""
        self._require("step")
        if not (math.isfinite(step_size) and step_size > 0.0):
            raise FmuError(f"expected a finite positive communication step, got {step_size} s.")
        if not abs(current_time - self.time) <= 1e-6 * step_size + 1e-12 * abs(self.time):
            raise FmuError(
                f"expected the communication point t = {self.time!r} s, where the last step ended, got "
                f"t = {current_time!r} s."
            )
        unit, end = self._unit, current_time + step_size
        before, above = unit.memory.copy(), self._solver.events.above
        happened = self._solver.events.happened = []
        try:
            self._solver.move(current_time, end, step_size)
            if unit.x.size and not np.isfinite(unit.x).all():
                raise KernelError(f"the states are not finite before t = {end:.9g} s. Check the parameters.")
            unit.outputs()
        except (KernelError, UnitError):
            unit.memory[:], self._solver.events.above = before, above
            raise
        for name, time in happened:
            self._say(f"event {name} at t = {time!r} s")
        self.time = end
        return True

    @_call("terminate")
    def terminate(self) -> None:
        """End the run; values can still be read."""
        self._require("step")
        self.phase = "terminated"

    def _require(self, *phases: str) -> None:
        if self.phase not in phases:
            raise FmuError(f"it is allowed only {' or '.join(_WHEN[phase] for phase in phases)}.")

    def _refresh(self) -> None:
        """Calculate state and outputs from the values set, as long as the initialization lasts."""
        if not self._stale:
            return
        unit, solver = self._unit, self._solver
        if self._unchecked and (problems := unmet(self._interface, unit.memory)):
            raise FmuError(" ".join(problems))
        self._unchecked = False
        if self._interface.has_states:
            tolerance = float(unit.group("tolerance")[0])
            solver.tolerance = tolerance if self._tolerance is None else min(tolerance, self._tolerance)
        if isinstance(solver, Integrator):
            solver.h = FIRST_STEP
        solver.start = unit.memory[-1] = self._start_time
        unit.start()
        unit.outputs()
        self._stale = False

    def values(self, kind: str, vrs: list[int]) -> list[float]:
        """Return the values of variables of a type."""
        variables, _ = self._variables(kind, *vrs)
        for variable in variables if self.phase == "instantiated" else ():
            if variable.causality == "output":
                raise FmuError(f"{variable.name} is an output: it has no value before enterInitializationMode.")
        if self.phase == "initialization":
            self._refresh()
        return self._unit.memory[vrs].tolist()

    def take(self, kind: str, vrs: list[int], values: list[Any]) -> None:
        """Set inputs and parameters of a type, either all values of a call or none."""
        variables, free = self._variables(kind, *vrs)
        self._require("instantiated", "initialization", "step")
        # inputs without limits are checked through their sum, which is not finite if one of them is not
        checked = () if free and math.isfinite(sum(values)) else zip(variables, values, strict=True)
        for variable, value in checked:
            if variable.causality == "output":
                raise FmuError(f"{variable.name} is an output and cannot be set.")
            if variable.variability == "fixed" and self.phase == "step":
                raise FmuError(
                    f"{variable.name} is a fixed parameter and can be set only before exitInitializationMode. "
                    "Reset the unit to set it."
                )
            if problem := variable.problem(value):
                raise FmuError(f"{variable.name}: {problem}.")
            self._unchecked = self._unchecked or variable.causality == "parameter"
        self._unit.memory[vrs] = values
        self._stale = True

    @_call("getFMUstate")
    def _get_fmu_state(self) -> dict[str, Any]:
        return {
            "guid": self._content.guid,
            "phase": self.phase,
            "times": [self.time, self._start_time, self._tolerance],
            "stale": self._stale,
            "memory": self._unit.memory.tolist(),
            "solver": {name: getattr(self._solver, name) for name in _SAVED if hasattr(self._solver, name)},
            "above": self._solver.events.above.tolist(),
        }

    @_call("setFMUstate")
    def _set_fmu_state(self, state: Any) -> None:
        saved: dict[str, Any] = state if isinstance(state, dict) else {}
        guid = saved.get("guid")
        if guid != self._content.guid:
            raise FmuError(
                f"expected a state of {self._content.model_name} with GUID {self._content.guid}, got "
                f"{f'one with GUID {guid}' if guid else 'something else'}."
            )
        try:
            phase, stale, (time, start_time, tolerance) = str(saved["phase"]), bool(saved["stale"]), saved["times"]
            _ = _WHEN[phase]
            memory = np.array(saved["memory"], dtype=float).reshape(self._interface.size)
            solver = {name: float(saved["solver"][name]) for name in _SAVED if hasattr(self._solver, name)}
            above = np.array(saved["above"], dtype=np.bool_).reshape(self._solver.events.above.shape)
        except (LookupError, TypeError, ValueError) as error:
            raise FmuError(f"the state is damaged: {kind_text(error)}.") from None
        for name, value in solver.items():
            setattr(self._solver, name, value)
        self._unit.memory[:], self._solver.events.above = memory, above
        self.time, self._start_time, self._tolerance = time, start_time, tolerance
        self.phase, self._stale, self._unchecked = phase, stale, True

    @staticmethod
    def _fmu_state_to_bytes(state: Any) -> bytes:
        try:
            return json.dumps(state).encode()
        except (TypeError, ValueError) as error:
            raise refusal(f"serializeFMUstate failed: this is not a state of a vdfmu unit: {error}.") from None

    @staticmethod
    def _fmu_state_from_bytes(state: bytes) -> Any:
        try:
            return read_json(state)
        except (TypeError, ValueError):
            text = f"deSerializeFMUstate failed: expected the bytes of a state, got {len(state)} other bytes."
            raise refusal(text) from None


def _accessors(kind: str, cast: Callable[[float], Any]) -> None:
    """Add the calls that get and set variables of a type."""

    @_call(f"get{kind}")
    def get(self: UnitSlave, vrs: list[int]) -> list[Any]:
        values = self.values(kind, vrs)
        return values if cast is float else list(map(cast, values))

    @_call(f"set{kind}")
    def put(self: UnitSlave, vrs: list[int], values: list[Any]) -> None:
        self.take(kind, vrs, values)

    setattr(UnitSlave, f"get_{kind.lower()}", get)
    setattr(UnitSlave, f"set_{kind.lower()}", put)


for _kind, _cast in {"Real": float, "Integer": int, "Boolean": bool, "String": str}.items():  # no unit has a string
    _accessors(_kind, _cast)


def _checked(variables: Sequence[Variable], kind: str, *vrs: int) -> tuple[list[Variable], bool]:
    """Return the variables of value references, which must have the type, and whether all are inputs without limits."""
    for vr in vrs:
        if not 0 <= vr < len(variables):
            raise FmuError(f"there is no value reference {vr}; they go from 0 to {len(variables) - 1}.")
        if (v := variables[vr]).type != kind:
            raise FmuError(f"expected variables of type {kind}, got {v.name} (value reference {vr}) of type {v.type}.")
    chosen = [variables[vr] for vr in vrs]
    return chosen, all(v.causality == "input" and v.minimum is v.maximum is None for v in chosen)


@cache
def slave_class(model_name: str, standard: partial[Content] | None = None) -> type[UnitSlave]:
    """Return the class of a model's slaves, one per process; for `standard` see :class:`UnitSlave`.

    The wrapper runs the FMU's script at each instantiation, and releases the class more often than it acquires it.
    """
    return type(f"{model_name}Slave", (UnitSlave,), {"unit": model_name, "standard": standard})
