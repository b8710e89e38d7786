"""Code that files and options name: whether it may run, and in which process.

Whatever is about to run code of a user, or of an installed plugin, calls `before_code` first. A call from Python runs
it, since its author asked for it. A command that only looks at a file runs nothing, and a command that computes runs it
in a process of its own, see `vdfmu.cli.own_process`.
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from contextlib import contextmanager
from contextvars import ContextVar

_reading: ContextVar[bool] = ContextVar("_reading", default=False)
_watching: list[Callable[[str], None]] = []


class CodeNotRunError(Exception):
    """Code was to run within `reading_only`."""

    def __init__(self, code: object) -> None:
        self.code = code
        """Its file, or the package of a plugin."""
        super().__init__(code)


@contextmanager
def reading_only() -> Generator[None]:
    """Run no code in the block: `before_code` raises CodeNotRunError."""
    token = _reading.set(True)
    try:
        yield
    finally:
        _reading.reset(token)


def is_reading_only() -> bool:
    """Whether this is within `reading_only`."""
    return _reading.get()


@contextmanager
def watched(watch: Callable[[str], None]) -> Generator[None]:
    """Call a function with the name of each file, or plugin, before its code runs in this process."""
    _watching.append(watch)
    try:
        yield
    finally:
        _watching.remove(watch)


def before_code(code: object) -> None:
    """Announce that code of a file, or of a plugin, is about to run. CodeNotRunError within `reading_only`."""
    if _reading.get():
        raise CodeNotRunError(code)
    for watch in _watching:
        watch(str(code))
