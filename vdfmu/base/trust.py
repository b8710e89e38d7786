"""Code that files and options name: whether it may run, and in which process.

Whatever is about to run code of a user, or of an installed plugin, calls `before_code` first. A call from Python runs
the code, because the caller wants it. A command that only reads a file runs no code, and a command that calculates
runs it in a separate process, see `vdfmu.cli.own_process`.
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import NoReturn


class CodeNotRunError(Exception):
    """Code was to run within `reading_only`."""

    def __init__(self, code: object) -> None:
        super().__init__(code)
        self.code = code
        """Its file, or the package of a plugin."""


def reading_only(code: object) -> NoReturn:
    """Refuse code, in ``with announced_to(reading_only)``."""
    raise CodeNotRunError(code)


_listener: ContextVar[Callable[[object], None] | None] = ContextVar("_listener", default=None)


@contextmanager
def announced_to(tell: Callable[[object], None]) -> Generator[None]:
    """Call a function with the name of each file, or plugin, whose code is about to run; it may raise."""
    token = _listener.set(tell)
    try:
        yield
    finally:
        _listener.reset(token)


def is_reading_only() -> bool:
    """Whether no code may run."""
    return _listener.get() is reading_only


def before_code(code: object) -> None:
    """Announce that code of a file, or of a plugin, is about to run. CodeNotRunError if none may run."""
    if (tell := _listener.get()) is not None:
        tell(code)
