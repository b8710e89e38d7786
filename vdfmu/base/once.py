"""Objects that are made once in a job: the units of a file, and their traces.

A job is a command, or a call of :func:`vdfmu.run` or :func:`vdfmu.build_fmus`. Nothing is kept for the next one: files
and classes may change in between.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Hashable
from contextlib import contextmanager
from contextvars import ContextVar
from functools import wraps
from typing import Any, TypeVar, TypeVarTuple

_made: ContextVar[dict[Hashable, Any] | None] = ContextVar("_made", default=None)
Arguments = TypeVarTuple("Arguments")
Made = TypeVar("Made")


@contextmanager
def one_job() -> Generator[None]:
    """Begin a job, or go on with the one that is under way."""
    made = _made.get()
    token = _made.set({} if made is None else made)
    try:
        yield
    finally:
        _made.reset(token)


def cached_per_command(make: Callable[[*Arguments], Made]) -> Callable[[*Arguments], Made]:
    """Decorate a function that is called once in a job for the same arguments, and each time outside of a job."""

    @wraps(make)
    def made(*arguments: *Arguments) -> Made:
        found = _made.get()
        if found is None:
            return make(*arguments)
        key = (make, *arguments)
        if key not in found:
            found[key] = make(*arguments)
        return found[key]

    return made
