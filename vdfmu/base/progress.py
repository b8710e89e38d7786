"""Progress reports from nested calls to the caller that shows them, and the option `progress`: a function, or bars."""

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
    """Log a warning once per process."""
    LOG.warning("%s", text)


@contextmanager
def showing(progress: Progress | None) -> Generator[None]:
    """Pass the progress of this thread within the block to a callback."""
    before = _show.set(progress)
    try:
        yield
    finally:
        _show.reset(before)


def report(stage: str, done: int, total: int) -> None:
    """Report how far a stage is to the callback of this thread."""
    progress = _show.get()
    if progress is not None:
        progress(stage, done, total)


@contextmanager
def doing(stage: str) -> Generator[None]:
    """Report a stage without steps: its bar moves while the block runs."""
    report(stage, 0, 1)
    yield
    report(stage, 1, 1)


def counted(stage: str, items: Iterable[_T], total: int) -> Generator[_T]:
    """Yield items, and report the number of finished items."""
    if total:
        report(stage, 0, total)
    for done, item in enumerate(items, 1):
        yield item
        report(stage, done, total)


Steps = Callable[[int, int], None]
"""Called with the number of finished steps and their total."""
Shown = Progress | bool | None
"""Option `progress`: a callback, True for bars on the terminal or in the notebook, or None."""
_P = ParamSpec("_P")


@contextmanager
def shown_steps(progress: Steps | bool | None, stage: str) -> Generator[Steps | None]:
    """Yield a callback for the steps of a stage. True shows them as a bar."""
    if progress is not True:
        yield progress or None
        return
    from vdfmu.base.bars import Bars  # rich takes long to import

    with Bars() as bars:
        yield partial(bars.update, stage)


def with_progress(function: Callable[_P, _T]) -> Callable[_P, _T]:
    """Pass the progress of a function to its option `progress`. True shows bars."""

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
