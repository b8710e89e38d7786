"""What the native wrapper of pythonfmu 0.7 asks of a slave, read in its source (PySlaveInstance.cpp).

- Every exception becomes fmi2Fatal. Its ``repr`` is the message, which importers use as a format of printf.
- Before it reports an exception, the wrapper releases the slave, its class and its message queue, and again
  in fmi2Reset and fmi2FreeInstance: without further references Python's memory is corrupt by then.
- fmi2Reset releases the slave before it makes a new one. If that fails, it still uses the old one's queue.
- A message that waits in the queue while an exception is reported makes the wrapper lose the exception.
- At each instantiation it runs the script again and then releases the globals of its module, once too often.
- At each instantiation it puts the FMU's resources folder in front of ``sys.path`` and leaves it there.

So this module holds further references to slaves until the wrapper has released them, and for ever after an
error.
"""

from __future__ import annotations

import logging
import sys
from typing import Any

from vdfmu.errors import FmuError

__all__ = [
    "RefusalError",
    "forget_search_path",
    "hold",
    "hold_all_for_ever",
    "hold_for_ever",
    "hold_globals",
    "plain",
    "refusal",
]

_logger = logging.getLogger("vdfmu.fmu")
_held: list[tuple[Any, ...]] = []
_for_ever: list[Any] = []


class RefusalError(FmuError):
    """The error that ends an FMI call. Its ``repr``, which the wrapper shows, is the bare message."""

    def __repr__(self) -> str:
        return str(self)


def refusal(text: str) -> RefusalError:
    """Return the error of a call that fails.

    Its text goes to the logger ``vdfmu.fmu`` too: in many importers the FMI logger is off unless asked for,
    and then they show nothing but "fatal".
    """
    text = plain(text)
    _logger.error("%s", text)
    return RefusalError(text)


def plain(text: str) -> str:
    """Return a text in one line that printf and the conversion to UTF-8 leave as it is."""
    text = " ".join(text.split()).replace("%", " percent").replace("\0", " ")
    return text.encode("utf-8", "replace").decode("utf-8")


def hold(slave: Any) -> None:
    """Keep a new slave until the wrapper has released it."""
    _held[:] = [entry for entry in _held if not _released(entry)]
    # a failed reset releases the queue three times: before, while it reports, and when the instance is freed
    _held.append((slave, slave, *[slave.log_queue] * 3))


def hold_for_ever(slave: Any) -> None:
    """Keep a slave whose call fails; once more for each such call."""
    slave.log_queue.clear()
    _for_ever.append((slave, slave, type(slave), slave.log_queue, slave.log_queue))


def hold_all_for_ever() -> None:
    """Keep all slaves: a call failed and it is not known whose."""
    _for_ever.extend(_held)


def hold_globals(script: dict[str, Any]) -> None:
    """Keep the globals of a script that runs."""
    _for_ever.append(script)


def forget_search_path(folder: str) -> None:
    """Take the folder of an FMU out of ``sys.path``, which would grow with each of many runs."""
    if folder in sys.path:
        sys.path.remove(folder)


def _released(entry: tuple[Any, ...]) -> bool:
    # nobody has the slave but the entry, twice, and the argument of getrefcount
    return sys.getrefcount(entry[0]) <= 3
