"""One FMI 2.0 co-simulation unit: its library, its calls and its messages."""

from __future__ import annotations

import itertools
import logging
import math
import re
import threading
from collections import deque
from collections.abc import Callable
from contextlib import nullcontext
from ctypes import CDLL, byref, c_char_p, c_double, c_int, c_size_t, c_uint, c_void_p, string_at
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import fmpy
from fmpy import fmi2

from vdfmu.engine.cosim.description import Description, Variable, library_name
from vdfmu.errors import CosimError
from vdfmu.text import shown

try:
    from fmpy.logging import addLoggerProxy
except Exception:  # no proxy library for this platform: messages come without their arguments
    addLoggerProxy = None

Value = float | int | bool | str
STATUS = ("ok", "warning", "discard", "error", "fatal", "pending")
C_TYPE = {"Real": c_double, "Integer": c_int, "Boolean": c_int, "String": c_void_p}
Watch = Callable[[str, str, Any], Any]
"""Returns a function that notes component and call before it calls the given function."""
_RETURNS = {"fmi2Instantiate": c_void_p, "fmi2FreeInstance": None}
"""Of the functions that return no status."""
_LAST_SUCCESSFUL_TIME, _TERMINATED = 2, 3
"""Of fmi2StatusKind."""
_CO_SIMULATION = 1
"""Of fmi2Type."""
_PASSED = ("ok", "warning", "discard", "pending")
"""Of a message in fmi2FreeInstance, which has no status of its own: no failure."""
_FAILURE = re.compile("error|fatal|discard", re.IGNORECASE)
"""In the category of a message that is worse than its status says."""
_LENGTH = 10_000
"""Bytes of a message that are kept."""
_LEVEL = {"ok": logging.DEBUG, "note": logging.INFO, "warning": logging.WARNING}


@dataclass(frozen=True)
class LogMessage:
    """A message of a unit, or (status ``note``) of the check before the run.

    Attributes
    ----------
    unit : str
        Component name; empty for notes.
    time : float
        Communication point at which it came [s].
    status : str
        ``ok``, ``warning``, ``discard``, ``error``, ``fatal``, ``pending`` or ``note``.
    category, text : str
    """

    unit: str
    time: float
    status: str
    category: str
    text: str

    def __str__(self) -> str:
        named = not self.unit or self.text.startswith(f"{self.unit}: ")  # some units name themselves
        return self.text if named else f"{self.unit}: {self.text}"


def log_to_logging(message: LogMessage) -> None:
    """Hand a message to the logger ``vdfmu.engine.cosim``."""
    logger = logging.getLogger("vdfmu.engine.cosim")
    logger.log(_LEVEL.get(message.status, logging.ERROR), "%s", message)


class MessageBox:
    """Collects the messages of the units of one run.

    `pending` holds what came since the last `flush`; the master flushes after each step, so that it holds
    what a failing unit said of it. `ended` holds the units that have ended the simulation, with the time of the end.
    """

    def __init__(self, log: Callable[[LogMessage], None] | None, limit: int = 10_000) -> None:
        self.pending: list[LogMessage] = []
        self.kept: deque[LogMessage] = deque(maxlen=limit)
        self.ended: dict[str, float] = {}
        self.time = 0.0
        self._log = log or log_to_logging
        self._limit = limit

    def add(self, message: LogMessage) -> None:
        """Take a message; of a flood between two flushes the last are kept."""
        self.pending.append(message)
        if len(self.pending) >= 2 * self._limit:
            del self.pending[: self._limit]

    def flush(self) -> None:
        """Show and keep what is pending."""
        messages = self.pending[:]
        self.pending.clear()
        for message in messages:
            self.kept.append(message)
            self._log(message)

    def reason(self, unit: str) -> str:
        """Return the reason that a unit gave since the last flush: its errors, else warnings, else its last message."""
        own = [m for m in self.pending if m.unit == unit]
        failed = [m for m in own if m.status not in ("ok", "warning") or _FAILURE.search(m.category)]
        worst = failed or [m for m in own if m.status == "warning"]
        text = " ".join(" ".join(m.text.split()) for m in worst)
        if not worst:
            return "the unit gave no reason" + (f"; its last message: {own[-1].text.strip()}" if own else "")
        text = re.sub(r"Fatal py exception encountered: \[\w+\] \w+ ?", "", text)  # pythonfmu's own prefix
        # a unit that names itself and the call: the error that quotes it does so already
        text = re.sub(rf"^{re.escape(unit)}: \w+( at t = \S+ s)? failed: ", "", text)
        return text or "the unit gave no reason"


_boxes: dict[int, tuple[str, MessageBox]] = {}
"""Unit name and message box by the componentEnvironment of the callbacks."""
_tokens = itertools.count(1)


def _on_message(token: int | None, instance: bytes, status: int, category: bytes, text: bytes) -> None:
    """Receive a message of any unit of the process."""
    message = shown(text[:_LENGTH].decode("utf-8", "replace")) if text else ""
    if text and len(text) > _LENGTH:
        message += f" ... ({len(text) - _LENGTH} bytes more)"
    entry = _boxes.get(token or 0)
    if (
        entry is None
    ):  # an instance that fmpy made itself: its proxy knows one receiver only, and now it is this one
        label = STATUS[status].upper() if 0 <= status < len(STATUS) else str(status)
        print(f"[{label}] {message}")
        return
    name, box = entry
    label = STATUS[status] if 0 <= status < len(STATUS) else str(status)
    kind = shown(category[:_LENGTH].decode("utf-8", "replace")) if category else ""
    box.add(LogMessage(name, box.time, label, kind, message))


_MAKING = threading.Lock()
"""Held while pythonfmu makes an instance: it changes ``sys.path`` and runs a script, for all threads."""
_RECEIVER = fmi2.fmi2CallbackLoggerTYPE(_on_message)
_ALLOCATE = fmi2.fmi2CallbackAllocateMemoryTYPE(fmpy.calloc)
_FREE = fmi2.fmi2CallbackFreeMemoryTYPE(fmpy.free)


class Slave:
    """An instance of an FMU.

    After fmi2Fatal neither it nor any other instance of the same FMU is called again (FMI 2.0, table of
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
        self.box = box
        self.stage = "loaded"
        self._corrupt = corrupt
        self._functions: dict[str, Any] = {}
        self._token = next(_tokens)
        self._watch = watch or (lambda unit, call, function: function)
        self._resources = (folder / "resources").as_uri()
        # not by fmpy's class: it changes the working directory of the process, which all threads share
        try:
            path = str(folder / library_name(description.identifier))
            self._library: Any = self._watch(name, "load", CDLL)(path)
        except OSError as error:
            raise CosimError(name, "load", box.time, str(error)) from None
        self._callbacks = fmi2.fmi2CallbackFunctions()
        self._callbacks.logger = _RECEIVER
        self._callbacks.allocateMemory = _ALLOCATE
        self._callbacks.freeMemory = _FREE
        self._callbacks.componentEnvironment = self._token
        self._python = (folder / "resources" / "slavemodule.txt").is_file()
        # pythonfmu passes its text as the format, without arguments: a percent sign must not be formatted.
        if addLoggerProxy is not None and not self._python:
            addLoggerProxy(byref(self._callbacks))
        self.component = c_void_p()

    def instantiate(self) -> None:
        """Create the instance, with messages switched on."""
        _boxes[self._token] = (self.name, self.box)
        # FMPy's container would log every call to its units, in a millisecond a step; their errors come anyway
        talkative = self.description.identifier == "container_fmu"
        make = self.function("fmi2Instantiate")
        with _MAKING if self._python else nullcontext():
            component = make(
                self.name.encode(), c_int(_CO_SIMULATION), self.description.guid.encode(), self._resources.encode(),
                byref(self._callbacks), c_int(0), c_int(not talkative),
            )  # fmt: skip
        if not component:
            self.stage = "failed"
            raise CosimError(self.name, "instantiate", self.box.time, self.box.reason(self.name))
        self.component = c_void_p(component)
        self.stage = "instantiated"

    def function(self, name: str) -> Any:
        """Return an FMI function of the library as a ctypes object; CosimError if there is none."""
        if name not in self._functions:
            call = name[4].lower() + name[5:]
            try:
                function = self._library[name]
            except AttributeError:
                reason = f"the library has no function {name}"
                raise CosimError(self.name, call, self.box.time, reason) from None
            function.restype = _RETURNS.get(name, c_int)
            self._functions[name] = self._watch(self.name, call, function)
        return self._functions[name]

    def call(self, name: str, *arguments: Any) -> None:
        """Call ``fmi2<name>`` with ctypes arguments; CosimError when its status is above warning."""
        status = self.function("fmi2" + name)(self.component, *arguments)
        if status:
            self.judge(status, name)

    def judge(self, status: int, call: str) -> None:
        """Pass over a warning, and over a step in which the unit ends the simulation; else raise CosimError."""
        if status == 1 or (status == 2 and call == "doStep" and self._terminated()):
            return
        label = STATUS[status] if 0 <= status < len(STATUS) else f"{status}, not of FMI 2.0"
        self.stage = "failed" if self.stage != "initialized" or status != 2 else self.stage
        if status == 4:
            self._corrupt.add(self.description.source)
        reason = "asynchronous steps are not supported" if status == 5 else self.box.reason(self.name)
        raise CosimError(self.name, call[0].lower() + call[1:], self.box.time, f"{reason} (status {label})")

    def _terminated(self) -> bool:
        """Whether the unit has discarded a step because the simulation is to end; keep when."""
        before, ended, time = len(self.box.pending), c_int(), c_double(math.nan)
        try:
            status = self.function("fmi2GetBooleanStatus")(self.component, c_int(_TERMINATED), byref(ended))
            if status == 0 and ended.value:
                self.function("fmi2GetRealStatus")(self.component, c_int(_LAST_SUCCESSFUL_TIME), byref(time))
                self.box.ended[self.name] = time.value
                return True
        except CosimError:  # a library without them
            pass
        del self.box.pending[before:]  # what it says of these calls is not why it discarded the step
        return False

    def setup(self, tolerance: float | None, start: float, stop: float) -> None:
        """Call fmi2SetupExperiment."""
        self.call(
            "SetupExperiment", c_int(tolerance is not None), c_double(tolerance or 0.0), c_double(start),
            c_int(1), c_double(stop),
        )  # fmt: skip

    def set(self, variable: Variable, value: Value) -> None:
        """Set one variable."""
        reference = (c_uint * 1)(variable.reference)
        if variable.type == "String":
            text = (c_char_p * 1)(str(value).encode("utf-8", "surrogateescape"))
            self.call("SetString", reference, c_size_t(1), text)
            return
        kind = variable.fmi_type
        self.call("Set" + kind, reference, c_size_t(1), (C_TYPE[kind] * 1)(value))  # type: ignore[arg-type]

    def get(self, variable: Variable) -> Value:
        """Get one variable."""
        kind = variable.fmi_type
        value = (C_TYPE[kind] * 1)()
        self.call("Get" + kind, (c_uint * 1)(variable.reference), c_size_t(1), value)
        return string_at(value[0] or b"").decode("utf-8", "surrogateescape") if kind == "String" else value[0]

    def set_all(self, values: list[tuple[Variable, Value]]) -> None:
        """Set many variables with one call a type."""
        for kind in ("Real", "Integer", "Boolean"):
            group = [(v.reference, x) for v, x in values if v.fmi_type == kind]
            if group:
                n = len(group)
                references = (c_uint * n)(*(r for r, _ in group))
                self.call("Set" + kind, references, c_size_t(n), (C_TYPE[kind] * n)(*(x for _, x in group)))
        for variable, value in values:
            if variable.type == "String":
                self.set(variable, value)

    @property
    def dead(self) -> bool:
        """Whether the FMU has had a fatal error."""
        return self.description.source in self._corrupt

    def reset(self) -> None:
        """Call fmi2Reset: the instance is as after its making."""
        if self.stage == "initialized":
            self.call("Terminate")
        self.call("Reset")
        self.stage = "instantiated"

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
                self.function("fmi2FreeInstance")(self.component)
                self.component = c_void_p()
                if any(m.unit == self.name and m.status not in _PASSED for m in self.box.pending):
                    reason = self.box.reason(self.name)
                    failure = failure or CosimError(self.name, "freeInstance", self.box.time, reason)
                self._watch(self.name, "freeLibrary", fmpy.freeLibrary)(self._library._handle)
        finally:
            self.box.flush()
            if not self.dead:  # a dead instance keeps its callbacks: nothing may free what it may still use
                _boxes.pop(self._token, None)
            else:
                _unfreed.append(self)
        return failure


_unfreed: list[Slave] = []
"""Instances that may not be freed; kept so that their callbacks stay valid."""
