"""Decides whether code that files and options name may run, and in which process.

`before_code` must be called before any code of a user or of an installed plugin runs. Calls from Python run the code,
because the caller chose to. A command that only reads a file runs no code, and a command that calculates runs it in a
separate process; see `vdfmu.cli.own_process`.
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import NoReturn


class CodeNotRunError(Exception):
    """Code would have to run within `reading_only`."""

    def __init__(self, code: object) -> None:
        super().__init__(code)
        self.code = code
        """The code's file, or the plugin's package."""


def reading_only(code: object) -> NoReturn:
    """Refuse to run code, with ``with announced_to(reading_only)``."""
    raise CodeNotRunError(code)


_listener: ContextVar[Callable[[object], None] | None] = ContextVar("_listener", default=None)


@contextmanager
def announced_to(tell: Callable[[object], None]) -> Generator[None]:
    """Call a function with the name of each file or plugin whose code is about to run. The function may raise."""
    token = _listener.set(tell)
    try:
        yield
    finally:
        _listener.reset(token)


def is_reading_only() -> bool:
    """Return whether running code is forbidden."""
    return _listener.get() is reading_only


def before_code(code: object) -> None:
    """Announce that code of a file or plugin is about to run. CodeNotRunError if running code is forbidden."""
    if (tell := _listener.get()) is not None:
        tell(code)
