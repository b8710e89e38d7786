"""Ctrl-C, SIGTERM and SIGHUP end a command, at once or after a guarded step."""

from __future__ import annotations

import _signal as c_signal  # pyright: ignore[reportMissingImports]
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

_set_handler: Any = c_signal.signal  # pyright: ignore[reportUnknownMemberType]
_handler_of: Any = c_signal.getsignal  # pyright: ignore[reportUnknownMemberType]
"""The functions behind `signal`; its conversion to enumerations takes 2 us per call."""
SIGNALS = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name))
"""Signals that end a command."""
_RETRY = 0.005
"""Time [s] after which a signal is sent again, if it came during a call of CasADi or if a library dropped it."""
_PATIENCE = 1.0
"""Time [s] after a signal in which further signals are ignored, so that the command can end."""
_TWICE = 0.1
"""Time [s] within which a second signal to a guard counts as the first one: a terminal sends Ctrl-C to both processes
of a command, and the first also forwards it to the second, see `vdfmu.cli.own_process`."""
_last, _deferred = -math.inf, -math.inf
_command, _ended = False, False
_guards: list[InterruptGuard] = []


class Stopped(KeyboardInterrupt):
    """A signal of this `number` stopped the command."""

    def __init__(self, number: int) -> None:
        super().__init__()
        self.number = number

    def __del__(self) -> None:
        """Send the signal again if a library drops it while a command runs, as a bare ``except`` does."""
        global _last
        if _command:
            _last = -math.inf
            _come_again(self.number)


@contextmanager
def listening(*signals: int) -> Generator[None]:
    """Let signals (Ctrl-C, SIGTERM and SIGHUP) raise `Stopped` in the main thread, unless ignored or handled."""
    taken = _listen(*signals)
    try:
        yield
    finally:
        _give_back(taken)


def _in_main_thread() -> bool:
    return threading.get_ident() == threading.main_thread().ident


def _listen(*signals: int) -> list[tuple[int, Any]]:
    """Handle signals as `listening` does. Return each number and its former handler."""
    taken: list[tuple[int, Any]] = []
    if _in_main_thread():
        for number in signals or SIGNALS:
            before = _handler_of(number)
            if before in (signal.SIG_DFL, signal.default_int_handler):
                _set_handler(number, _stop)
                taken.append((number, before))
    return taken


def _give_back(taken: list[tuple[int, Any]]) -> None:
    for number, before in taken:
        _set_handler(number, before)


def command_begins() -> None:
    """Let signals end the command of this process, even if a library drops the exception."""
    global _command
    taken = _listen()
    _command = True
    # the default handlers would end Python without a message while it frees its modules
    atexit.register(_give_back, [(number, int(signal.SIG_IGN)) for number, _ in taken])


def command_ended() -> None:
    """Ignore signals while Python ends. After a second a signal ends the process at once."""
    global _last, _command, _ended
    _last, _command, _ended = time.monotonic(), False, True


def _stop(number: int, frame: FrameType | None) -> None:
    """Raise `Stopped`, delegate it to guards, or send the signal again.

    CasADi calls Python to find the types of its arguments and drops exceptions raised in these calls. Python drops
    exceptions raised in ``__del__``, and in the callback with which an import frees its lock. The signal would then be
    lost.
    """
    global _last, _deferred
    if _guards and not _guards[-1].number:
        for guard in _guards:
            guard.number = number
        _deferred = time.monotonic()
        return
    if _guards and time.monotonic() < _deferred + _TWICE:
        return
    while frame is not None:
        within, code = frame.f_globals.get("__name__", ""), frame.f_code
        frees_lock = (code.co_filename, code.co_name) == ("<frozen importlib._bootstrap>", "cb")
        if within.startswith("casadi") or code is Stopped.__del__.__code__ or frees_lock:
            _come_again(number)
            return
        frame = frame.f_back
    if time.monotonic() > _last + _PATIENCE:
        if _ended:
            os._exit(128 + number)
        _last = time.monotonic()
        raise Stopped(number)


def _come_again(number: int) -> None:
    started = threading.Event()
    threading.Thread(target=_send, args=(number, started), daemon=True).start()
    started.set()  # before, the signal would meet the same frames: the start of a thread may take longer than its wait


def _send(number: int, started: threading.Event) -> None:
    """Send a signal to the main thread, to wake it up."""
    started.wait()
    time.sleep(_RETRY)
    if hasattr(signal, "pthread_kill"):
        main = threading.main_thread().ident
        assert main is not None
        signal.pthread_kill(main, number)
    else:
        signal.raise_signal(number)


class InterruptGuard:
    """Defers a signal until a file, or a step of units in Python, is complete, and raises it at the exit.

    A second signal acts at once. Does nothing outside the main thread or under another signal handler.
    """

    def __init__(self) -> None:
        self.number = 0
        """Deferred signal, or 0."""
        self._taken: list[tuple[int, Any]] = []

    def __enter__(self) -> InterruptGuard:
        # a guard in `_guards` may be stale: a generator that nobody closed keeps its guard
        if _in_main_thread():
            self._taken = [] if _command else _listen(signal.SIGINT)
            _guards.append(self)
        return self

    def refuse(self) -> None:
        """Raise the deferred signal."""
        if self.number:
            raise Stopped(self.number)

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if self in _guards:
            _guards.remove(self)
            _give_back(self._taken)
        if kind is None:
            self.refuse()
