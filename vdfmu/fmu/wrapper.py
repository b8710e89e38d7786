"""What the native wrapper of pythonfmu 0.7 asks of a slave, read in its source (PySlaveInstance.cpp).

- Every exception becomes fmi2Fatal. Its ``repr`` is the message, which importers use as a format of printf.
- Before it reports an exception, the wrapper releases the slave, its class and its message queue. It releases them
  again in fmi2Reset and fmi2FreeInstance, after which Python's memory is corrupt.
- A message that waits in the queue while an exception is reported makes the wrapper lose the exception.
- fmi2Reset releases the slave before it makes a new one. If that fails, it still uses the queue of the old one.
- Each instantiation puts the FMU's resources folder in front of ``sys.path`` and leaves it there.

So this module holds extra references to all slaves: until the wrapper has released them, or for ever after an error.
"""

from __future__ import annotations

import logging
import sys
from typing import Any

from vdfmu.errors import FmuError

__all__ = ["Refusal", "forget_search_path", "hold", "hold_all_for_ever", "hold_for_ever", "plain", "refusal"]

_logger = logging.getLogger("vdfmu.fmu")
_held: list[tuple[Any, ...]] = []
_for_ever: list[Any] = []


class Refusal(FmuError):
    """The error that ends an FMI call. Its ``repr`` is the bare message, as the wrapper shows the ``repr``."""

    def __repr__(self) -> str:
        return str(self)


def refusal(text: str) -> Refusal:
    """Return the error of a call that fails.

    Its text goes to the logger ``vdfmu.fmu`` too: the FMI logger is off by default in many importers, and all that
    they show then is "fatal".
    """
    text = plain(text)
    _logger.error("%s", text)
    return Refusal(text)


def plain(text: str) -> str:
    """Return a text in one line that printf and the wrapper's conversion to UTF-8 leave as it is."""
    text = " ".join(text.split()).replace("%", " percent").replace("\0", " ")
    return text.encode("utf-8", "replace").decode("utf-8")


def hold(slave: Any) -> None:
    """Keep a new slave until the wrapper has released it."""
    _held[:] = [entry for entry in _held if not _released(entry)]
    # one release for every way in which it may be wrongly repeated: failed call or reset, then fmi2FreeInstance
    _held.append((slave, slave, *[slave.log_queue] * 3))


def hold_for_ever(slave: Any) -> None:
    """Keep a slave whose call fails, once more for every such call."""
    slave.log_queue.clear()
    _for_ever.append((slave, slave, type(slave), slave.log_queue, slave.log_queue))


def hold_all_for_ever(cls: type) -> None:
    """Keep all slaves: a call failed that does not say whose it was."""
    _for_ever.append(cls)
    _for_ever.extend(_held)


def _released(entry: tuple[Any, ...]) -> bool:
    # the entry's own two references and the argument of getrefcount
    return sys.getrefcount(entry[0]) <= 3


def forget_search_path(folder: str) -> None:
    """Take a folder that the wrapper put in front of ``sys.path`` away: a sweep of many runs would slow imports down."""
    if folder in sys.path:
        sys.path.remove(folder)
