"""Behaviour that the native wrapper of pythonfmu 0.7 requires of a slave, read in its source (PySlaveInstance.cpp).

- Every exception becomes fmi2Fatal. Its ``repr`` is the message, which importers use as a printf format.
- If a message is waiting in the queue while an exception is reported, the wrapper loses the exception.
- When a call fails, the wrapper releases the slave, its class and its message queue, and again at the next
  failure, in fmi2Reset and in fmi2FreeInstance.
- fmi2Reset releases the slave before it makes a new one. If that fails, it still uses the old one's queue. - At each
instantiation it runs the script again and then releases the globals of its module, once too often. - At each
instantiation it puts the FMU's resources folder in front of ``sys.path`` and leaves it there. - A library that is still
loaded when the process exits frees its data twice, and the process may abort. The first one of a process always is;
others are if an importer did not free an instance that failed.

So this module holds additional references to all objects that the wrapper releases, and makes the libraries free their
data before the exit. A slave that seems unused is emptied and kept.
"""

from __future__ import annotations

import _ctypes
import atexit
import contextlib
import ctypes
import logging
import os
import sys
import threading
from pathlib import Path
from typing import Any

from vdfmu.base.errors import FmuError

_logger = logging.getLogger("vdfmu.compiler.fmu")

_SPARE = 8
"""References held to the objects of an instance: the number of failures unseen by Python that it survives."""
_held: list[tuple[Any, ...]] = []
_for_ever: list[Any] = []
_libraries: set[str] = set()
"""Native libraries that made slaves, by their names in the loader."""


class RefusalError(FmuError):
    """The error that ends an FMI call. The wrapper shows its ``repr``: the bare message."""

    def __repr__(self) -> str:
        return str(self)


def refusal(text: str, slave: Any = None) -> RefusalError:
    """Return the error of a slave's failed call; the slave is None if it is unknown or being made.

    Its text also goes to the logger ``vdfmu.compiler.fmu``, because many importers switch the FMI logger off by default
    and then show only "fatal".
    """
    if slave is not None:
        slave.log_queue.clear()
    for each in [entry[0] for entry in _held] if slave is None else [slave]:
        _for_ever.append(_references(each, 2))
    text = plain(text)
    _logger.error("%s", text)
    return RefusalError(text)


def plain(text: str) -> str:
    """Return a text in one line that is safe as a printf format and in UTF-8."""
    text = " ".join(text.split()).replace("%", " percent").replace("\0", " ")
    return text.encode("utf-8", "replace").decode("utf-8")


def hold(slave: Any) -> None:
    """Keep a new slave, and empty slaves that the wrapper has released."""
    # a slave is released if only its entry and the argument of getrefcount refer to it
    for entry in [entry for entry in _held if sys.getrefcount(entry[0]) <= _SPARE + 1]:
        vars(entry[0]).clear()
        _held.remove(entry)
        _for_ever.append(entry)
    _held.append(_references(slave, _SPARE))


def hold_globals(script: dict[str, Any]) -> None:
    """Keep the globals of a script that runs."""
    _for_ever.append(script)


def loaded_from(resources: str, model_name: str) -> None:
    """Note the library that makes a slave, and remove its folder from ``sys.path``."""
    if resources in sys.path:
        sys.path.remove(resources)
    if sys.platform == "linux":
        with contextlib.suppress(OSError):  # a library other than pythonfmu's made the slave
            _libraries.add(_loader_name(Path(resources).parent / "binaries" / "linux64" / f"{model_name}.so"))


def _loader_name(path: Path) -> str:
    """Return the name of a library in the loader, by which it is found even if its file no longer exists."""
    library = ctypes.CDLL(str(path), os.RTLD_LAZY | os.RTLD_NOLOAD)
    try:
        # in glibc and musl the handle is a struct link_map: an address, then the name
        return os.fsdecode((ctypes.c_char_p * 2).from_address(library._handle)[1])
    finally:
        _ctypes.dlclose(library._handle)


def _references(slave: Any, count: int) -> tuple[Any, ...]:
    return (slave,) * count + (slave.log_queue,) * count + (type(slave),) * count


@atexit.register
def _free_libraries() -> None:
    if sys.platform != "linux" or threading.get_native_id() != os.getpid():
        return  # Windows does not need this; in another thread a library would end the interpreter
    for path in _libraries:
        try:
            library = ctypes.CDLL(path, os.RTLD_LAZY | os.RTLD_NOLOAD)
        except OSError:  # it is no longer loaded
            continue
        library.finalizePythonInterpreter()
