"""Messages of a unit while FMPy runs it."""

from __future__ import annotations

import contextlib
import ctypes
import re
from typing import Any

from fmpy import fmi2
from fmpy.fmi1 import FMICallException

_MOST = 20
"""Most messages of a unit that are kept, from the first."""
_TEXT = 1000
"""Most characters of one of them."""


class Said:
    """The first messages of a unit that are worse than a warning: a logger for FMPy."""

    def __init__(self) -> None:
        self.messages: list[str] = []

    def __call__(self, *given: Any) -> None:
        """Keep a message; before its status FMI 3.0 has one argument, FMI 1.0 and 2.0 have two."""
        status, _, message = given[-3:]
        if status not in (0, 1) and len(self.messages) <= _MOST:
            text = message if isinstance(message, str) else message.decode(errors="replace")
            text = text if len(text) <= _TEXT else f"{text[:_TEXT]} ... ({len(text) - _TEXT} characters more)"
            self.messages.append(text if len(self.messages) < _MOST else f"more than {_MOST} messages")

    def with_error(self, error: Exception) -> str:
        """Return its messages before an error, and the error, as one text."""
        return "; ".join([*self.messages, str(error)])

    def stay(self) -> None:
        """Take messages of FMI 1.0 and 2.0 from now on.

        FMPy has one place for all loggers of the process. The logger of its last simulation stays there after its
        memory has been freed.
        """
        fmi2.defaultCallbacks.logger = fmi2.fmi2CallbackLoggerTYPE(self)
        with contextlib.suppress(ImportError, OSError):  # as FMPy: there is a library for some platforms
            from fmpy.logging import addLoggerProxy

            addLoggerProxy(ctypes.byref(fmi2.defaultCallbacks))


def refuse_negative(call: str) -> None:
    """Raise for a call, as fmpy logs it, that returned a status below 0. fmpy takes such a status for success."""
    if match := re.fullmatch(r"(\w+)\(.*\) -> (-\d+)", call, re.DOTALL):
        raise FMICallException(function=match[1], status=int(match[2]))
