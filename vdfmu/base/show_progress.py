"""The option `progress` of functions that take long: what to call, or bars."""

from __future__ import annotations

from collections.abc import Callable, Generator
from contextlib import contextmanager
from functools import partial, wraps
from typing import ParamSpec, TypeVar, cast

from vdfmu.base.progress import Progress, showing

Steps = Callable[[int, int], None]
"""Called with the number of finished steps and their total."""
Shown = Progress | bool | None
"""How a user wants progress: a function to call, True for bars on the terminal or in the notebook, or nothing."""
_P = ParamSpec("_P")
_T = TypeVar("_T")


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
