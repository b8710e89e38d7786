"""Progress of what takes long far below the caller that can show it."""

from __future__ import annotations

import logging
from collections.abc import Callable, Generator, Iterable
from contextlib import contextmanager
from contextvars import ContextVar
from functools import cache
from typing import TypeVar

Progress = Callable[[str, int, int], None]
"""Called with the stage, the number of finished steps and their total."""
_T = TypeVar("_T")
_show: ContextVar[Progress | None] = ContextVar("progress", default=None)
LOG = logging.getLogger("vdfmu")
"""Details of the work: ``--verbose`` of a command shows it; warnings are shown without it too."""


@cache
def warn_once(text: str) -> None:
    """Warn of what holds for the whole process."""
    LOG.warning("%s", text)


@contextmanager
def showing(progress: Progress | None) -> Generator[None]:
    """Let a callable have the progress of what this thread does in the block."""
    before = _show.set(progress)
    try:
        yield
    finally:
        _show.reset(before)


def report(stage: str, done: int, total: int) -> None:
    """Say how far a stage is, to what this thread shows progress with."""
    progress = _show.get()
    if progress is not None:
        progress(stage, done, total)


@contextmanager
def doing(stage: str) -> Generator[None]:
    """Report a stage that has no steps: it moves while the block runs."""
    report(stage, 0, 1)
    yield
    report(stage, 1, 1)


def counted(stage: str, items: Iterable[_T], total: int) -> Generator[_T]:
    """Yield items, and report how many are dealt with."""
    if total:
        report(stage, 0, total)
    for done, item in enumerate(items, 1):
        yield item
        report(stage, done, total)
