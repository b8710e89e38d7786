"""Progress of what takes long far below the caller that can show it."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable
from contextlib import contextmanager
from contextvars import ContextVar
from functools import wraps
from typing import ParamSpec, TypeVar

Progress = Callable[[str, int, int], None]
"""Called with the stage, the number of finished steps and their total."""
Shown = Progress | bool | None
"""What a user says of progress: what to call, True for bars on the terminal or in the notebook, or nothing."""
_P = ParamSpec("_P")
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


def with_bars(function: Callable[_P, _T]) -> Callable[_P, _T]:
    """Let ``progress=True`` of a function show bars while it runs."""

    @wraps(function)
    def wrapper(*args: _P.args, **kwargs: _P.kwargs) -> _T:
        if kwargs.get("progress") is not True:
            return function(*args, **kwargs)
        from vdfmu.bars import Bars  # rich takes long to import

        with Bars() as bars:
            kwargs["progress"] = bars.update
            return function(*args, **kwargs)

    return wrapper


def called(progress: Shown) -> Progress:
    """Return what to call, which may do nothing."""
    return progress if callable(progress) else lambda stage, done, total: None
