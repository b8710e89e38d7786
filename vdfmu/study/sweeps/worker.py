"""Workers of a parameter study: processes that run chunks of points and are replaced if a point crashes or hangs."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, suppress
from itertools import takewhile
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vdfmu.base.errors import FailureKind, VdfmuError
from vdfmu.base.files import temporary_folder
from vdfmu.base.process import SIZE, Child
from vdfmu.base.text import elided, shown
from vdfmu.study.sweeps.job import Row, Task

TIME_LIMIT = 600.0
"""Time limit [s] of a point."""
_START = 120.0
"""Time limit [s] for the start of the process."""
_TRIES = 3
"""How many processes may be killed from outside at the same point."""
KILLED = "the process was killed (SIGKILL)"
"""Start of the reason for a point that ran out of memory or was killed, which is no fault of the model."""
_WRITTEN = "a component wrote to the worker's pipe"
_HEAD = {
    "point": int,
    "failed": (str, type(None)),
    "failed_at": (float, int, type(None)),
    "wall_s": (float, int),
    "failed_in": (str, type(None)),
    "kind": (str, type(None)),
}
"""Keys of each row and their types; others are measures."""


LARGEST = 50
"""Most points in a chunk."""
_SECONDS = 10.0
"""Time [s] that a chunk should take, which is the most that is lost if everything is killed."""


class Chunks:
    """Hands out consecutive `points` in order, as many as take some seconds, and fewer towards the end.

    A chunk has the tasks of `size` points, by default chosen by the time that they take, at most `LARGEST`; it is a
    multiple of `together`, the number of points that run side by side.
    """

    def __init__(
        self, points: NDArray[np.intp], task: Callable[[int], Task], size: int | None = None, together: int = 1
    ) -> None:
        self._open = points
        self._task, self._size, self._next, self._together = task, size, 0, together
        self._lock = threading.Lock()
        self._points, self._seconds = 0, 0.0

    def note(self, seconds: float) -> None:
        """Record how long a point took."""
        with self._lock:
            self._points += 1
            self._seconds += seconds

    def take(self, parts: int) -> list[Task] | None:
        """Return the next chunk, by default at most 1 / `parts` of the rest; None at the end."""
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
        """Stop handing out chunks."""
        with self._lock:
            self._next = len(self._open)


class Worker:
    """Runs points of a pickled `Job` in one process; a point that takes longer than `time_limit` [s] ends it."""

    def __init__(self, job: bytes, time_limit: float | None = None) -> None:
        self._job = job
        self._limit = TIME_LIMIT if time_limit is None else time_limit
        self._child: Child | None = None
        self._stopped = threading.Event()
        self._together: list[int] = []
        self._folders = ExitStack()
        self._late = False

    def run(self, tasks: Sequence[Task]) -> Iterator[Row]:
        """Yield a row for each point, in order; nothing more after `stop`. VdfmuError if no process can be started.

        Points that a program runs side by side are sent together. If that ends the process, or takes longer than one
        point may, they are run one by one with their FMUs.
        """
        left = list(tasks)
        apart = 0  # number of the next points
        killed = failures = 0
        while left and not self._stopped.is_set():
            if self._child is None:
                self._begin()
                if self._stopped.is_set():
                    return
            number = left[0][1]
            most = 1 if apart else self._together[number]
            group = list(takewhile(lambda task, number=number: task[1] == number, left[:most]))
            begin = perf_counter()
            assert self._child is not None
            self._child.send((group, apart > 0))
            rows = self._reply(self._child)
            if isinstance(rows, dict):
                self._end(self._child)
                failures += 1
                if failures < _TRIES:
                    continue
                why = elided(shown(str(rows.get("disk"))))
                raise VdfmuError(
                    f"point {left[0][0]}: the disk fails: {why}. Finished points are kept. Free space, or set "
                    "TMPDIR to another folder, and repeat the command."
                )
            if not isinstance(rows, str):
                rows = _rows(rows, [point for point, *_ in group])
                if rows == _WRITTEN:
                    self._end(self._child)
            if not isinstance(rows, list):
                if self._stopped.is_set():
                    return
                if rows == KILLED:
                    killed += 1
                    if killed < _TRIES:
                        continue
                    rows = (
                        f"{KILLED} {killed} times: memory may be short, so use fewer workers; a new start tries again"
                    )
                if most > 1:
                    apart, killed = len(group), 0
                    continue
                kind = str(FailureKind.TIME_LIMIT if self._late else FailureKind.LOST)
                seconds = perf_counter() - begin
                head = dict.fromkeys(_HEAD) | {"point": group[0][0], "failed": rows, "kind": kind, "wall_s": seconds}
                rows = [head]
            killed = failures = 0
            del left[: len(group)]
            apart = max(apart - 1, 0)
            yield from rows

    def stop(self) -> None:
        """End the process at once, from any thread."""
        self._stopped.set()
        if (child := self._child) is not None:
            child.kill()

    def close(self) -> None:
        """End the process gracefully, and remove its temporary folder."""
        with self._folders:
            if self._child is not None:
                self._end(self._child)

    def _begin(self) -> None:
        folder = self._folders.enter_context(temporary_folder("vdfmu_sweep_"))
        self._child = child = Child("vdfmu.study.sweeps.child", folder, limit=_START)
        child.post(SIZE.pack(len(self._job)) + self._job)
        ready = self._reply(child)
        child.limit = self._limit
        if isinstance(ready, list):
            self._together = ready
        elif not self._stopped.is_set():
            raise VdfmuError(f"a worker could not be started: {ready}. Check that its measures can be imported.")

    def _reply(self, child: Child) -> Any:
        """Return the next message or, as text, why there is none."""
        with suppress(EOFError):
            return child.take()
        code, said = self._end(child)
        self._late = child.late
        if child.late:
            return f"no result within {child.limit:g} s, the time limit of a point"
        if code < 0:
            if code == -signal.SIGKILL:
                return KILLED
            with suppress(ValueError):
                return f"a component crashed the process ({signal.Signals(-code).name})"
        last = said.strip().rpartition("\n")[2]
        return f"a component ended the process (exit code {code}){f': {shown(last)}' if last else ''}"

    def _end(self, child: Child) -> tuple[int, str]:
        """End the process; return its exit code and the end of its output."""
        self._child = None
        code, _, said = child.end()
        self._folders.close()
        return code, said


def _rows(message: Any, points: Sequence[int]) -> list[Row] | str:
    """Return the rows of points, with lists as arrays, or a text if they do not come from the worker."""
    good = isinstance(message, list) and len(message) == len(points)
    good = good and all(
        isinstance(row, dict)
        and row.get("point") == point
        and all(isinstance(row.get(key, ()), kinds) for key, kinds in _HEAD.items())
        and all(isinstance(value, (float, int, list, type(None))) for key, value in row.items() if key not in _HEAD)
        for row, point in zip(message, points, strict=True)
    )
    if not good:
        return _WRITTEN
    try:
        return [{k: np.array(v, float) if isinstance(v, list) else v for k, v in row.items()} for row in message]
    except (ValueError, TypeError):
        return _WRITTEN
