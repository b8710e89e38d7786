"""A component that calls C's ``exit`` in this process: it is named and its rows are kept before the process is gone."""

from __future__ import annotations

import ctypes
import inspect
import os
import platform
import sys
from collections.abc import Callable, Generator
from contextlib import contextmanager, suppress

from vdfmu.engine.fmu.instance import Instance
from vdfmu.engine.fmu.messages import MessageBox


@contextmanager
def report_exits(box: MessageBox, save: Callable[[], str]) -> Generator[None]:
    """Report which component ends the process, save the rows, and make the exit code 1; `save` returns a text on them.

    With the C libraries of Linux (glibc) and macOS; nothing is said with others, which cannot take a handler back.
    """
    if platform.libc_ver()[0] != "glibc" and sys.platform != "darwin":
        yield
        return
    process, over = os.getpid(), False

    @ctypes.CFUNCTYPE(None, ctypes.c_void_p)
    def at_exit(_: int | None) -> None:
        if over or os.getpid() != process:  # in a process that the component has forked
            return
        with suppress(BaseException):
            where = save()
            sys.stderr.write(f"error: {_caller()} ended the process at t = {box.time:.9g} s.{where}\n")
            sys.stderr.flush()
        os._exit(1)

    library, key = ctypes.CDLL(None), ctypes.byref(ctypes.c_char())
    library.__cxa_atexit(at_exit, None, key)
    try:
        yield
    finally:
        over = True
        library.__cxa_finalize(key)  # calls it, and takes it back


def _caller() -> str:
    """Return the names of the components that the code above in this thread is at, by what its local variables hold."""
    frame = inspect.currentframe()
    while frame is not None:
        values = [(value, getattr(value, "instance", None)) for value in frame.f_locals.values()]
        if names := dict.fromkeys(one.name for pair in values for one in pair if isinstance(one, Instance)):
            return f"component {' or '.join(names)}"
        frame = frame.f_back
    return "a component"
