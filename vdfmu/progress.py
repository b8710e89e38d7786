"""Progress of what takes long far below the caller that can show it."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable
from contextlib import contextmanager
from contextvars import ContextVar
from typing import TypeVar

Progress = Callable[[str, int, int], None]
"""Called with the stage, the number of finished steps and their total."""
_T = TypeVar("_T")
_show: ContextVar[Progress | None] = ContextVar("progress", default=None)


@contextmanager
def showing(progress: Progress | None) -> Generator[None]:
    """Let a callable have the progress of what this thread does in the block."""
    before = _show.set(progress)
    try:
        yield
    finally:
        _show.reset(before)


def counted(stage: str, items: Iterable[_T], total: int) -> Generator[_T]:
    """Yield items, and report how many are dealt with."""
    progress = _show.get() or (lambda stage, done, total: None)
    if total:
        progress(stage, 0, total)
    for done, item in enumerate(items, 1):
        yield item
        progress(stage, done, total)
