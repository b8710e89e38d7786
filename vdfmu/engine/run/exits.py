"""Report a component that ends the process by C's ``exit``."""

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
def report_exits(box: MessageBox, save: Callable[[], str], resting: Callable[[], bool]) -> Generator[None]:
    """Report a component that ends the process, save the rows, and make the exit code 1; `save` returns a text on them.

    Between runs, when `resting`, no component does.

    For the C libraries of Linux (glibc) and macOS; no others can remove a handler.
    """
    if platform.libc_ver()[0] != "glibc" and sys.platform != "darwin":
        yield
        return
    process, over = os.getpid(), False

    @ctypes.CFUNCTYPE(None, ctypes.c_void_p)
    def at_exit(_: int | None) -> None:
        if over or resting() or os.getpid() != process:  # in a process that the component has forked
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
        library.__cxa_finalize(key)  # calls and removes the handler


def _caller() -> str:
    """Return the names of the components in the local variables of the calls above in this thread."""
    frame = inspect.currentframe()
    while frame is not None:
        values = [(value, getattr(value, "instance", None)) for value in frame.f_locals.values()]
        if names := dict.fromkeys(each.name for pair in values for each in pair if isinstance(each, Instance)):
            return f"component {' or '.join(names)}"
        frame = frame.f_back
    return "a component"
