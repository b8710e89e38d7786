"""Progress of what takes long far below the caller that can show it, and the option `progress`: a function, or bars."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable
from contextlib import contextmanager
from contextvars import ContextVar
from functools import cache, partial, wraps
from typing import ParamSpec, TypeVar, cast

from vdfmu.base.errors import LOG

Progress = Callable[[str, int, int], None]
"""Called with the stage, the number of finished steps and their total."""
_T = TypeVar("_T")
_show: ContextVar[Progress | None] = ContextVar("progress", default=None)


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


Steps = Callable[[int, int], None]
"""Called with the number of finished steps and their total."""
Shown = Progress | bool | None
"""How a user wants progress: a function to call, True for bars on the terminal or in the notebook, or nothing."""
_P = ParamSpec("_P")


@contextmanager
def shown_steps(progress: Steps | bool | None, stage: str) -> Generator[Steps | None]:
    """Yield what to call with the steps of a stage; True shows them as a bar."""
    if progress is not True:
        yield progress or None
        return
    from vdfmu.base.bars import Bars  # rich takes long to import

    with Bars() as bars:
        yield partial(bars.update, stage)


def with_progress(function: Callable[_P, _T]) -> Callable[_P, _T]:
    """Let the option `progress` of a function have what is reported while it runs; True shows bars."""

    @wraps(function)
    def wrapper(*args: _P.args, **kwargs: _P.kwargs) -> _T:
        progress = cast("Shown", kwargs.get("progress"))
        if callable(progress):
            with showing(progress):
                return function(*args, **kwargs)
        if not progress:
            return function(*args, **kwargs)
        from vdfmu.base.bars import Bars  # rich takes long to import

        with Bars() as bars, showing(bars.update):
            return function(*args, **kwargs)

    return wrapper
