"""The pythonfmu slave that all four units share: phases, values, state, errors.

pythonfmu's own getters and setters call one Python function a variable; here a whole call is one slice of the unit's
memory. Its wrapper turns every exception into fmi2Fatal with the exception's text, the only way a Python slave can make
a call fail, so the text is all that a user sees: it says unit, call, time, what was expected, what came and the way out.
"""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Callable, Sequence
from functools import wraps
from pathlib import Path
from typing import Any, ClassVar
from xml.etree.ElementTree import Element

import numpy as np
from pythonfmu import Boolean, Fmi2Causality, Fmi2Slave, Integer, Real
from pythonfmu._version import __version__ as PYTHONFMU_VERSION
from pythonfmu.enums import Fmi2Status

from vdfmu.errors import FmuError, VdfmuError
from vdfmu.fmu.behaviour import BEHAVIOURS
from vdfmu.fmu.content import Content
from vdfmu.fmu.description import LOG_CATEGORIES, model_description
from vdfmu.fmu.interface import Variable, interface, start_values
from vdfmu.kernel import Kernel

__all__ = ["UnitSlave"]

_TYPES = {"Real": Real, "Integer": Integer, "Boolean": Boolean}
_failed: list[Any] = []
"""Slaves that raised. pythonfmu releases its slave before it reports the error, and again when the importer frees the
instance; the references kept here make the second release harmless."""

_script_dictionaries: list[dict[str, Any]] = []


def _call(name: str) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Make every error of a call say unit, call and time, once."""

    def decorate(method: Callable[..., Any]) -> Callable[..., Any]:
        @wraps(method)
        def guarded(self: UnitSlave, *args: Any) -> Any:
            try:
                return method(self, *args)
            except Exception as error:
                _failed.append((self, self, self.vars, self.log_queue))
                where = f"{self.instance_name}: {name}" + (f" at t = {self.time:.9g} s" if self.phase == "step" else "")
                what = str(error) if isinstance(error, VdfmuError) else f"{type(error).__name__}: {error}"
                # Not logged here: pythonfmu loses the text of an exception that follows a message of the same call.
                # A percent sign would be read as a format by importers that pass the text to printf.
                self.log_queue.clear()
                raise FmuError(f"{where} failed: {what}".replace("%", " percent")) from None

        return guarded

    return decorate


class UnitSlave(Fmi2Slave):
    """Base of the slaves in ``fmu_src/python``; a subclass names its `unit`."""

    unit: ClassVar[str] = ""

    def __init_subclass__(cls, **kwargs: Any) -> None:
        """Keep one more reference to the script's module dictionary.

        pythonfmu 0.7.0 gives away a reference to it that it does not own, at every instantiation, right after it runs
        the script again and so this method. Without the reference the third instance of an FMU crashes the process.
        """
        super().__init_subclass__(**kwargs)
        module = sys.modules.get(cls.__module__)
        if module is not None:
            _script_dictionaries.append(module.__dict__)

    log_categories: ClassVar[dict[str, str]] = LOG_CATEGORIES

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.phase = "instantiated"
        self.time = 0.0
        content = Content.read(Path(kwargs["resources"]))
        content.check_unit(self.unit)
        content.check_version()
        self.modelName = content.model_name
        self._content = content
        self._table = table = interface(self.unit, content.robot)
        self._variables = table.variables
        self._memory = start_values(table)
        for name, value in content.start_values.items():
            self._memory[table.reference[name]] = value
        for variable in table:
            self.register_variable(_TYPES[variable.type](variable.name, causality=Fmi2Causality[variable.causality]))
        self._behaviour = BEHAVIOURS[self.unit](table, self._memory, Kernel(content.robot))
        self._start_time = 0.0
        self._tolerance: float | None = None
        self._dirty = True
        self._gets: dict[tuple[int, ...], slice | np.ndarray] = {}
        self._sets: dict[tuple[str, str, tuple[int, ...]], tuple[Any, ...]] = {}

    def to_xml(self, model_options: dict[str, str] | None = None) -> Element:
        """Model description from the variable table; pythonfmu's own lacks units, dependencies and InitialUnknowns."""
        return model_description(self._content.table(), self._content.guid, f"pythonfmu {PYTHONFMU_VERSION}")

    # ---------------------------------------------------------------- life cycle

    @_call("setupExperiment")
    def setup_experiment(self, start_time: float, stop_time: float | None = None, tolerance: float | None = None) -> None:
        """Take start time and tolerance of the experiment."""
        self._require("instantiated")
        if not math.isfinite(start_time):
            raise FmuError(f"the start time must be finite, got {start_time}.")
        if tolerance is not None and not (math.isfinite(tolerance) and tolerance > 0.0):
            raise FmuError(f"the tolerance must be a finite positive number, got {tolerance}.")
        self._start_time = self.time = start_time
        self._tolerance = tolerance

    @_call("enterInitializationMode")
    def enter_initialization_mode(self) -> None:
        """Check the parameters and start."""
        self._require("instantiated")
        self.phase = "initialization"
        self._refresh()

    @_call("exitInitializationMode")
    def exit_initialization_mode(self) -> None:
        """End the time in which fixed parameters can be set."""
        self._require("initialization")
        self._refresh()
        self.phase = "step"
        self.log(f"{self.instance_name}: starts at t = {self.time:g} s", Fmi2Status.ok, "logEvents")

    @_call("doStep")
    def do_step(self, current_time: float, step_size: float) -> bool:
        """Move from `current_time` by `step_size` [s]."""
        self._require("step")
        if not (math.isfinite(step_size) and step_size > 0.0):
            raise FmuError(f"the communication step must be finite and positive, got {step_size} s.")
        if not abs(current_time - self.time) <= 1e-6 * step_size + 1e-12 * abs(self.time):
            raise FmuError(
                f"expected the communication point t = {self.time!r} s, where the last step ended, got {current_time!r} s."
            )
        self._behaviour.step(current_time, step_size)
        self.time = current_time + step_size
        return True

    @_call("terminate")
    def terminate(self) -> None:
        """End the run; outputs can still be read."""
        self._require("step", "initialization")
        self.phase = "terminated"

    def _require(self, *phases: str) -> None:
        if self.phase not in phases:
            raise FmuError(f"not allowed in phase {self.phase!r}, only in {' or '.join(map(repr, phases))}.")

    def _refresh(self) -> None:
        """Calculate state and outputs from what is set, during initialization."""
        if self._dirty and self.phase == "initialization":
            problems = self._behaviour.check()
            if problems:
                raise FmuError("; ".join(problems))
            self._behaviour.start(self._start_time, self._tolerance)
            self._behaviour.outputs(self._start_time)
            self._dirty = False

    # ---------------------------------------------------------------- values

    @_call("getReal")
    def get_real(self, vrs: list[int]) -> list[float]:
        """Values of real variables."""
        return self._get("Real", vrs)

    @_call("getInteger")
    def get_integer(self, vrs: list[int]) -> list[int]:
        """Values of integer variables."""
        return [int(v) for v in self._get("Integer", vrs)]

    @_call("getBoolean")
    def get_boolean(self, vrs: list[int]) -> list[bool]:
        """Values of boolean variables."""
        return [bool(v) for v in self._get("Boolean", vrs)]

    @_call("getString")
    def get_string(self, vrs: list[int]) -> list[str]:
        """Refuse: there are no string variables."""
        return self._get("String", vrs)

    @_call("setReal")
    def set_real(self, vrs: list[int], values: list[float]) -> None:
        """Set real inputs or parameters: all of a call, or none."""
        self._set("Real", vrs, values)

    @_call("setInteger")
    def set_integer(self, vrs: list[int], values: list[int]) -> None:
        """Set integer parameters."""
        self._set("Integer", vrs, values)

    @_call("setBoolean")
    def set_boolean(self, vrs: list[int], values: list[bool]) -> None:
        """Set boolean parameters."""
        self._set("Boolean", vrs, values)

    @_call("setString")
    def set_string(self, vrs: list[int], values: list[str]) -> None:
        """Refuse: there are no string variables."""
        self._set("String", vrs, values)

    def _get(self, kind: str, vrs: Sequence[int]) -> list[Any]:
        key = tuple(vrs)
        where = self._gets.get(key)
        if where is None:
            self._resolve(kind, key)
            where = self._gets[key] = _slice_or_index(key)
        elif key and self._variables[key[0]].type != kind:
            self._resolve(kind, key)
        if self._dirty:
            self._refresh()
        return self._memory[where].tolist()

    def _set(self, kind: str, vrs: Sequence[int], values: Sequence[Any]) -> None:
        key = (kind, self.phase, tuple(vrs))
        known = self._sets.get(key)
        if known is None:
            variables = self._resolve(kind, key[2])
            for variable in variables:
                self._refuse_fixed(variable)
            bounded = any(v.minimum is not None or v.maximum is not None for v in variables)
            known = self._sets[key] = (_slice_or_index(key[2]), variables, bounded)
        where, variables, bounded = known
        if not math.isfinite(sum(values)) or bounded:
            for variable, value in zip(variables, values, strict=True):
                _check_value(variable, value)
        self._memory[where] = values
        self._dirty = True

    def _resolve(self, kind: str, vrs: Sequence[int]) -> list[Variable]:
        found: list[Variable] = []
        for vr in vrs:
            if not 0 <= vr < len(self._variables):
                raise FmuError(f"there is no value reference {vr}; they go from 0 to {len(self._variables) - 1}.")
            if self._variables[vr].type != kind:
                raise FmuError(f"{self._variables[vr].name} (value reference {vr}) is {self._variables[vr].type}, not {kind}.")
            found.append(self._variables[vr])
        return found

    def _refuse_fixed(self, variable: Variable) -> None:
        if variable.causality == "output":
            raise FmuError(f"{variable.name} is an output and cannot be set.")
        if variable.variability == "fixed" and self.phase not in ("instantiated", "initialization"):
            raise FmuError(
                f"{variable.name} is a fixed parameter: it can be set until the initialization ends, not in phase "
                f"{self.phase!r}. Reset the unit, or choose a tunable parameter."
            )
        self._require("instantiated", "initialization", "step")

    # ---------------------------------------------------------------- state

    @_call("getFMUstate")
    def _get_fmu_state(self) -> dict[str, Any]:
        return {
            "guid": self._content.guid,
            "phase": self.phase,
            "time": self.time,
            "start_time": self._start_time,
            "experiment_tolerance": self._tolerance,
            "dirty": self._dirty,
            "memory": self._memory.tolist(),
            "behaviour": self._behaviour.state(),
        }

    @_call("setFMUstate")
    def _set_fmu_state(self, state: dict[str, Any]) -> None:
        if not isinstance(state, dict) or state.get("guid") != self._content.guid:
            raise FmuError(f"this is not a state of {self._content.model_name} with GUID {self._content.guid}.")
        self.phase, self.time, self._start_time = state["phase"], state["time"], state["start_time"]
        self._tolerance, self._dirty = state["experiment_tolerance"], state["dirty"]
        self._memory[:] = state["memory"]
        if state["behaviour"] is not None:
            self._behaviour.restore(state["behaviour"])

    @staticmethod
    def _fmu_state_to_bytes(state: dict[str, Any]) -> bytes:
        return json.dumps(state).encode()

    @staticmethod
    def _fmu_state_from_bytes(state: bytes) -> dict[str, Any]:
        return json.loads(state.decode())


def _slice_or_index(vrs: Sequence[int]) -> slice | np.ndarray:
    """Slice for references that count up by one, else an index array."""
    if vrs and list(vrs) == list(range(vrs[0], vrs[0] + len(vrs))):
        return slice(vrs[0], vrs[0] + len(vrs))
    return np.array(vrs, dtype=np.intp)


def _check_value(variable: Variable, value: Any) -> None:
    unit = f" {variable.unit}" if variable.unit and variable.unit != "1" else ""
    if not math.isfinite(value):
        raise FmuError(f"{variable.name}: expected a finite number, got {value}{unit}.")
    if variable.minimum is not None and value < variable.minimum:
        raise FmuError(f"{variable.name}: expected at least {variable.minimum:g}{unit}, got {value:g}{unit}.")
    if variable.maximum is not None and value > variable.maximum:
        raise FmuError(f"{variable.name}: expected at most {variable.maximum:g}{unit}, got {value:g}{unit}.")
