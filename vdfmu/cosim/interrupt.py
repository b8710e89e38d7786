"""Ctrl-C, held back until what must not be cut off is complete."""

from __future__ import annotations

import signal
import threading

__all__ = ["InterruptGuard"]


class InterruptGuard:
    """Holds back Ctrl-C until a step is complete, of which units written in Python would die, or a file.

    A second Ctrl-C acts at once. Does nothing outside the main thread or under another signal handler.
    """

    def __init__(self) -> None:
        self.pressed = False
        self._active = False

    def __enter__(self) -> InterruptGuard:
        self._active = (
            threading.current_thread() is threading.main_thread()
            and signal.getsignal(signal.SIGINT) is signal.default_int_handler
        )
        if self._active:
            signal.signal(signal.SIGINT, self._press)
        return self

    def _press(self, *_: object) -> None:
        if self.pressed:
            raise KeyboardInterrupt
        self.pressed = True

    def __exit__(self, *_: object) -> None:
        if self._active:
            signal.signal(signal.SIGINT, signal.default_int_handler)
