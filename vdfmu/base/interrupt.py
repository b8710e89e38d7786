"""Ctrl-C, SIGTERM and SIGHUP: how they end a command, and what holds them back until it is complete."""

from __future__ import annotations

import atexit
import math
import os
import signal
import threading
import time
from collections.abc import Generator
from contextlib import contextmanager
from types import FrameType
from typing import Any

_SIGNALS = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name))
_RETRY = 0.005
"""Time [s] after which a signal that came while CasADi was called, or that a library dropped, comes again."""
_PATIENCE = 1.0
"""Time [s] after a signal in which others do not disturb the end of the command."""
_last = -math.inf
_command, _ended = False, False
_guards: list[InterruptGuard] = []


class Stopped(KeyboardInterrupt):
    """A signal stopped the command; `number` is that of the signal."""

    def __init__(self, number: int) -> None:
        super().__init__()
        self.number = number

    def __del__(self) -> None:
        """Come again if a library has dropped it, as a bare ``except`` does, while a command runs."""
        global _last
        if _command:
            _last = -math.inf
            _come_again(self.number)


@contextmanager
def listening(*signals: int) -> Generator[None]:
    """Let signals raise `Stopped`, by default Ctrl-C, SIGTERM and SIGHUP; each that is not ignored or taken already.

    Does nothing outside the main thread, where Python does not allow it.
    """
    taken = _listen(*signals)
    try:
        yield
    finally:
        _give_back(taken)


def _listen(*signals: int) -> list[tuple[int, Any]]:
    """Take signals as `listening` does, without giving them back; return each number and its former handler."""
    taken: list[tuple[int, Any]] = []
    if threading.current_thread() is threading.main_thread():
        for number in signals or _SIGNALS:
            before = signal.getsignal(number)
            if before in (signal.SIG_DFL, signal.default_int_handler):
                signal.signal(number, _stop)
                taken.append((number, before))
    return taken


def _give_back(taken: list[tuple[int, Any]]) -> None:
    for number, before in taken:
        signal.signal(number, before)


def command_begins() -> None:
    """Let signals end the command that the process is for, even if a library drops what they raise."""
    global _command
    taken = _listen()
    _command = True
    atexit.register(_ignore, taken)


def _ignore(taken: list[tuple[int, Any]]) -> None:
    """Ignore signals from here on: while Python frees its modules, their defaults would end it without a word."""
    for number, _ in taken:
        signal.signal(number, signal.SIG_IGN)


def command_ended() -> None:
    """Let signals change nothing while Python ends, except for one after a second, which ends the process at once."""
    global _last, _command, _ended
    _last, _command, _ended = time.monotonic(), False, True


def _stop(number: int, frame: FrameType | None) -> None:
    """Raise `Stopped`, or let a guard do so, or come again.

    CasADi calls Python to find the types of its arguments and drops what that raises, as Python does of what the end of
    a dropped `Stopped` raises: a signal that comes then would be lost, and the command go on.
    """
    global _last
    if _guards and not _guards[0].number:
        for guard in _guards:
            guard.number = number
        return
    while frame is not None:
        within = frame.f_globals.get("__name__", "")
        if within.startswith("casadi") or frame.f_code is Stopped.__del__.__code__ or _frees_lock(frame):
            _come_again(number)
            return
        frame = frame.f_back
    if time.monotonic() > _last + _PATIENCE:
        if _ended:
            os._exit(128 + number)
        _last = time.monotonic()
        raise Stopped(number)


def _frees_lock(frame: FrameType) -> bool:
    """Whether an import frees the lock of a module: Python prints what a callback of a weak reference raises."""
    code = frame.f_code
    return code.co_filename == "<frozen importlib._bootstrap>" and code.co_name == "cb"


def _come_again(number: int) -> None:
    started = threading.Event()
    threading.Thread(target=_send, args=(number, started), daemon=True).start()
    started.set()  # before, the signal would meet the same frames: the start of a thread may take longer than its wait


def _send(number: int, started: threading.Event) -> None:
    """Send a signal to the main thread, which may wait for something: it is to wake up."""
    started.wait()
    time.sleep(_RETRY)
    if hasattr(signal, "pthread_kill"):
        main = threading.main_thread().ident
        assert main is not None
        signal.pthread_kill(main, number)
    else:
        signal.raise_signal(number)


class InterruptGuard:
    """Holds back signals until a step is complete, of which units written in Python would die, or a file.

    Leaving it raises what it held back. A second signal acts at once. Does nothing outside the main thread or under
    another signal handler.
    """

    def __init__(self) -> None:
        self.number = 0
        """The signal that is held back; 0 if none is."""
        self._taken: list[tuple[int, Any]] = []

    def __enter__(self) -> InterruptGuard:
        self._taken = [] if _command else _listen(signal.SIGINT)  # a command has taken it
        if threading.current_thread() is threading.main_thread():
            _guards.append(self)
        return self

    def refuse(self) -> None:
        """Raise what is held back."""
        if self.number:
            raise Stopped(self.number)

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if self in _guards:
            _guards.remove(self)
        _give_back(self._taken)
        if kind is None:
            self.refuse()
