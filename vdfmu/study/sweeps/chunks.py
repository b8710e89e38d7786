"""Which points of a parameter study are run together."""

from __future__ import annotations

import threading
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from vdfmu.study.sweeps.job import Row, Task

LARGEST = 50
"""Most points in a chunk."""
_SECONDS = 10.0
"""Time [s] that a chunk should take: the most that is lost when all is killed."""


class Chunks:
    """Hands out consecutive points that are not `done`, (n,), as many as take some seconds, fewer towards the end.

    A chunk has the tasks of `size` points, by default by the time that they take, at most `LARGEST`; and a multiple of
    those that are run side by side, `together`.
    """

    def __init__(
        self, done: NDArray[np.bool_], task: Callable[[int], Task], size: int | None = None, together: int = 1
    ) -> None:
        self._open = np.flatnonzero(~done)
        self._task, self._size, self._next, self._together = task, size, 0, together
        self._lock = threading.Lock()
        self._points, self._seconds = 0, 0.0
        self.left: list[list[Row]] = []
        """Rows that were done when the study was stopped."""

    def note(self, seconds: float) -> None:
        """Take into account how long a point took."""
        with self._lock:
            self._points += 1
            self._seconds += seconds

    def take(self, parts: int) -> list[Task] | None:
        """Return the next chunk, by default at most one of `parts` of the rest; None if there is none."""
        with self._lock:
            size = self._size
            if size is None:
                mean = self._seconds / self._points if self._points else np.inf
                size = int(np.clip(_SECONDS / mean, 1, LARGEST)) if mean > 0.0 else LARGEST
                size = min(size, -(-(len(self._open) - self._next) // parts))
                size = -(-size // self._together) * self._together
            part = self._open[self._next : self._next + size]
            if not len(part):
                return None
            gaps = np.flatnonzero(np.diff(part) > 1)
            part = part[: gaps[0] + 1] if len(gaps) else part
            self._next += len(part)
        return [self._task(int(point)) for point in part]

    def stop(self) -> None:
        """Hand out no more chunks."""
        with self._lock:
            self._next = len(self._open)
