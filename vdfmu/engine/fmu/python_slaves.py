"""Errors of Python FMUs with their places, which the library that pythonfmu puts into each FMU does not pass on.

The library reports the text of an exception, and not even this if the slave has logged something in the same call. The
slave runs in the interpreter of this process, though. Its calls are wrapped and note the exception on its way. While it
is made there is no call to wrap, so its lines are traced.
"""

from __future__ import annotations

import sys
import threading
import traceback
from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager
from functools import wraps
from pathlib import Path
from typing import Any, NamedTuple

_CALLS = (
    "setup_experiment", "enter_initialization_mode", "exit_initialization_mode", "do_step", "terminate",
    *(f"{verb}_{kind}" for verb in ("get", "set") for kind in ("real", "integer", "boolean", "string")),
)  # fmt: skip
"""Methods of a slave that FMI calls call."""


class PythonError(NamedTuple):
    """An exception of a slave."""

    reason: str
    """Its type, text and place: ``IndexError: list index out of range (mypd.py, line 14)``."""
    logged: list[str]
    """Messages of the slave in the same call."""
    trace: str


_raised: dict[int, PythonError] = {}
"""The last exception by thread."""


def taken_error() -> PythonError | None:
    """Return the exception that a slave has raised in this thread since the last call, if there is one."""
    return _raised.pop(threading.get_ident(), None)


@contextmanager
def watched_slave(resources: Path) -> Generator[None]:
    """Watch a slave while it is made of the files in a folder, then all of its calls."""

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
    taken_error()  # exceptions that the slave has caught
    _watch()


def _watch() -> None:
    """Wrap the calls of all classes of slaves, except of this package, whose errors have their places."""
    base = getattr(sys.modules.get("pythonfmu"), "Fmi2Slave", None)
    for slave in () if base is None else _below(base):
        for name in () if slave.__module__.startswith("vdfmu.") else _CALLS:
            method = getattr(slave, name, None)
            if method is not None and not hasattr(method, "_watched"):
                setattr(slave, name, _watched(method))


def _below(base: type) -> Iterator[type]:
    for slave in base.__subclasses__():
        yield slave
        yield from _below(slave)


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
    """Note an exception, and take what the slave has logged: the library would lose the exception of a full log."""
    queue: list[Any] = getattr(slave, "log_queue", [])
    logged = [" ".join(str(message.msg).split()) for message in queue]
    trace = "".join(traceback.format_exception(error)).rstrip()
    _raised[threading.get_ident()] = PythonError(_reason(error, resources), logged, trace)
    queue.clear()


def _reason(error: BaseException, resources: str) -> str:
    """Return type and text of an exception, and the place where the files of the FMU have raised it."""
    frames = traceback.extract_tb(error.__traceback__)
    own = [frame for frame in frames if Path(frame.filename).is_relative_to(resources)] or list(frames)
    text = traceback.format_exception_only(error)[-1].strip()
    return f"{text} ({Path(own[-1].filename).name}, line {own[-1].lineno})" if own else text
