"""Messages and events of the units of a run, and exceptions of Python FMUs with their places."""

from __future__ import annotations

import logging
import re
import sys
import threading
import traceback
from collections import deque
from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager, suppress
from ctypes import c_double, c_int
from functools import wraps
from pathlib import Path
from typing import Any, NamedTuple

from vdfmu.base.text import shown

STATUS = ("ok", "warning", "discard", "error", "fatal", "pending")
_LENGTH = 10_000
"""Number of bytes kept of a message."""
_FAILURE = re.compile("error|fatal|discard", re.IGNORECASE)
"""Part of a category that marks an error, even if the status is lower."""
EVENT = "event"
"""Status of a message that reports an event: its text is the name of the event, its time that of the event."""
_SAID = re.compile(r".*: event (\S+) at t = (\S+) s")
"""Message of category ``logEvents`` in which units of this package report an event."""
_LEVEL = {"ok": logging.DEBUG, "note": logging.INFO, "warning": logging.WARNING}


class LogMessage(NamedTuple):
    """A message of a unit, or of what comes before the run: a note or a table of connections."""

    unit: str
    """Component name; empty before the run."""
    time: float
    """Communication point, or time of an event [s]."""
    status: str
    """``ok``, ``warning``, ``discard``, ``error``, ``fatal``, ``pending``, ``note``, ``connections`` or ``event``."""
    category: str
    text: str

    def __str__(self) -> str:
        named = not self.unit or self.text.startswith(f"{self.unit}: ")  # some units include their own name
        return self.text if named else f"{self.unit}: {self.text}"


_LOGGER = logging.getLogger("vdfmu.engine.run")


def _log(message: LogMessage) -> None:
    _LOGGER.log(_LEVEL.get(message.status, logging.ERROR), "%s", message)


class EventLog:
    """The events of a run: their number, the first times and the last, by component or ``component.event``."""

    TIMES = 500
    """Most times that are kept of each."""

    def __init__(self) -> None:
        self.facts: dict[str, dict[str, Any]] = {}
        """For the summary: ``count``, ``last`` [s] and ``times`` [s] of each."""

    def add(self, message: LogMessage) -> None:
        """Count an event."""
        name = f"{message.unit}.{message.text}" if message.text else message.unit
        fact = self.facts.setdefault(name, {"count": 0, "last": message.time, "times": []})
        fact["count"] += 1
        fact["last"] = message.time
        if len(fact["times"]) < self.TIMES:
            fact["times"].append(message.time)


class MessageBox:
    """Collects the messages of the units of a run.

    `pending` holds the messages since the last `flush`. The master flushes after each step, so the pending messages
    explain a failure. `ended` maps units that have ended the simulation to the time of the end [s]. `log` receives each
    message, by default the logger ``vdfmu.engine.run``. `take` receives each event, by default that of `events`. An
    event of a step that is undone is removed from `pending` with its messages.
    """

    def __init__(self, log: Callable[[LogMessage], None] | None, limit: int = 10_000) -> None:
        self.pending: list[LogMessage] = []
        self.kept: deque[LogMessage] = deque(maxlen=limit)
        self.ended: dict[str, float] = {}
        self.events = EventLog()
        self.take: Callable[[LogMessage], None] | None = None
        self.clock, self.waiting = c_double(), c_int()
        """Memory shared with compiled steps: the communication point [s], and whether there was a message since
        `flush`."""
        self._log = log or _log
        self._limit = limit

    @property
    def time(self) -> float:
        """The communication point [s]."""
        return self.clock.value

    @time.setter
    def time(self, time: float) -> None:
        self.clock.value = time

    def add(self, message: LogMessage) -> None:
        """Receive a message. Between two flushes at least the last `limit` messages are kept."""
        self.waiting.value = 1
        self.pending.append(message)
        if len(self.pending) >= 2 * self._limit:
            del self.pending[: self._limit]

    def event(self, unit: str, time: float, name: str = "") -> None:
        """Take an event of a unit at a time [s]; unlike a message it does not end steps in C."""
        self.pending.append(LogMessage(unit, time, EVENT, "", name))

    def flush(self) -> None:
        """Log and keep the pending messages, and count the events."""
        if not self.pending:
            return
        messages, self.pending, self.waiting.value = self.pending, [], 0
        for message in messages:
            if message.status == EVENT:
                (self.take or self.events.add)(message)
                continue
            self.kept.append(message)
            self._log(message)

    def reason(self, unit: str) -> str:
        """Return the reason that a unit logged since the last flush: errors, else warnings, else its last message."""
        messages = [m for m in self.pending if m.unit == unit and m.status != EVENT]
        failed = [m for m in messages if m.status not in ("ok", "warning") or _FAILURE.search(m.category)]
        worst = failed or [m for m in messages if m.status == "warning"]
        text = " ".join(" ".join(m.text.split()) for m in worst)
        if not worst:
            return "the unit gave no reason" + (f"; its last message: {messages[-1].text.strip()}" if messages else "")
        text = re.sub(r"Fatal py exception encountered: \[\w+\] \w+ ?", "", text)  # pythonfmu's prefix
        # the error that quotes the message already names the unit and the call
        text = re.sub(rf"^{re.escape(unit)}: \w+( at t = \S+ s)? failed: ", "", text)
        return text or "the unit gave no reason"


boxes: dict[int, tuple[str, MessageBox]] = {}
"""Unit name and message box by the token of an instance, which FMI 2.0 passes as environment of its callbacks."""


def on_message(token: int | None, status: int, category: bytes, text: bytes) -> None:
    """Receive a message of any unit of the process."""
    message = shown(text[:_LENGTH].decode("utf-8", "replace")) if text else ""
    if text and len(text) > _LENGTH:
        message += f" ... ({len(text) - _LENGTH} bytes more)"
    label = STATUS[status] if 0 <= status < len(STATUS) else str(status)
    entry = boxes.get(token or 0)
    if entry is None:  # from fmpy's own instance: its proxy library has one receiver per process, now this function
        print(f"[{label.upper()}] {message}")
        return
    name, box = entry
    kind = shown(category[:_LENGTH].decode("utf-8", "replace")) if category else ""
    if kind == "logEvents" and (said := _SAID.fullmatch(message)):
        with suppress(ValueError):  # a text of another tool that is no number
            return box.event(name, float(said[2]), said[1])
    box.add(LogMessage(name, box.time, label, kind, message))


# Python FMUs. The library that pythonfmu puts into each FMU reports the text of an exception without its place, and not
# even the text if the slave has logged in the same call. Because slaves run in this process's interpreter, their calls
# can be wrapped to note the exception. During the creation no call can be wrapped yet, so its lines are traced.

_CALLS = (
    "setup_experiment",
    "enter_initialization_mode",
    "exit_initialization_mode",
    "do_step",
    "terminate",
    *(f"{verb}_{kind}" for verb in ("get", "set") for kind in ("real", "integer", "boolean", "string")),
)
"""Methods of a slave behind FMI functions."""


class PythonError(NamedTuple):
    """An exception of a slave."""

    reason: str
    """Type, text and place: ``IndexError: list index out of range (mypd.py, line 14)``."""
    logged: list[str]
    """Messages of the slave in the same call."""
    trace: str


_raised: dict[int, PythonError] = {}
"""The last exception by thread."""


def taken_error() -> PythonError | None:
    """Return and forget the last exception of a slave in this thread, or None."""
    return _raised.pop(threading.get_ident(), None)


@contextmanager
def watched_slave(resources: Path) -> Generator[None]:
    """Watch the creation of a slave from the files in a folder, and then all of its calls."""

    def lines(frame: Any, event: str, value: Any) -> Any:
        if event == "exception":
            _note(value[1].with_traceback(value[2]), None, str(resources))
        return lines

    def calls(frame: Any, event: str, value: Any) -> Any:
        return lines if frame.f_code.co_filename.startswith(str(resources)) else None

    before = sys.gettrace()
    sys.settrace(before or calls)
    try:
        yield
    finally:
        sys.settrace(before)
    taken_error()  # exceptions that the slave itself has caught
    for slave in _subclasses(getattr(sys.modules.get("pythonfmu"), "Fmi2Slave", None)):
        for name in () if slave.__module__.startswith("vdfmu.") else _CALLS:  # errors of this package name their place
            method = getattr(slave, name, None)
            if method is not None and not hasattr(method, "_watched"):
                setattr(slave, name, _watched(method))


def _subclasses(base: type | None) -> Iterator[type]:
    for slave in () if base is None else base.__subclasses__():
        yield slave
        yield from _subclasses(slave)


def _watched(method: Callable[..., Any]) -> Callable[..., Any]:
    @wraps(method)
    def call(self: Any, *args: Any) -> Any:
        try:
            return method(self, *args)
        except BaseException as error:
            _note(error, self, str(self.resources))
            raise

    call.__dict__["_watched"] = True
    return call


def _note(error: BaseException, slave: Any, resources: str) -> None:
    """Note an exception, and remove the messages of the slave, because with them the library loses the exception."""
    queue: list[Any] = getattr(slave, "log_queue", [])
    logged = [" ".join(str(message.msg).split()) for message in queue]
    trace = "".join(traceback.format_exception(error)).rstrip()
    _raised[threading.get_ident()] = PythonError(_reason(error, resources), logged, trace)
    queue.clear()


def _reason(error: BaseException, resources: str) -> str:
    """Return type and text of an exception, and its last place in the files of the FMU."""
    frames = traceback.extract_tb(error.__traceback__)
    inside = [frame for frame in frames if Path(frame.filename).is_relative_to(resources)] or list(frames)
    text = traceback.format_exception_only(error)[-1].strip()
    return f"{text} ({Path(inside[-1].filename).name}, line {inside[-1].lineno})" if inside else text
