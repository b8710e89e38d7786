"""Chunks of a study: points that are run together, and the workers of this machine that run them."""

from __future__ import annotations

import os
import queue
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor, wait

import numpy as np
from numpy.typing import NDArray

from vdfmu.base.interrupt import InterruptGuard
from vdfmu.study.sweeps.job import Row, Task
from vdfmu.study.sweeps.worker import Worker

LARGEST = 50
"""Most points in a chunk."""
_SECONDS = 10.0
"""Time [s] that a chunk should take: the most that is lost when all is killed."""


class Chunks:
    """Hands out consecutive `points` in their order, as many as take some seconds, fewer towards the end.

    A chunk has the tasks of `size` points, by default by the time that they take, at most `LARGEST`; and a multiple of
    those that are run side by side, `together`.
    """

    def __init__(
        self, points: NDArray[np.intp], task: Callable[[int], Task], size: int | None = None, together: int = 1
    ) -> None:
        self._open = points
        self._task, self._size, self._next, self._together = task, size, 0, together
        self._lock = threading.Lock()
        self._points, self._seconds = 0, 0.0

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


_TICK = 0.2
"""Interval [s] at which Ctrl-C is checked."""


def processors() -> int:
    """Return the number of processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


class LocalWorkers:
    """Processes on this machine. They live from one set of chunks to the next."""

    def __init__(self, job: bytes, count: int, time_limit: float | None) -> None:
        self._team = [Worker(job, time_limit) for _ in range(count)]
        # a thread waits for each process, which ends with the thread that started it
        self._threads = ThreadPoolExecutor(count)

    def run(self, chunks: Chunks, tell: Callable[[list[Row]], None], advance: Callable[[int], None]) -> None:
        """Run chunks, and tell their rows as they are done, even of a chunk that is interrupted.

        `advance` is called with the number of points done since the last time.
        """
        done: queue.SimpleQueue[list[Row] | BaseException | int | None] = queue.SimpleQueue()

        def work(worker: Worker) -> None:
            rows: list[Row] = []
            try:
                while (chunk := chunks.take(2 * len(self._team))) is not None:
                    rows = []
                    for row in worker.run(chunk):
                        rows.append(row)
                        chunks.note(row["wall_s"])
                        done.put(1)
                    done.put(rows)
                    if len(rows) < len(chunk):
                        break
            except BaseException as error:
                done.put(rows)
                done.put(error)
            finally:
                done.put(None)

        at_work = [self._threads.submit(work, worker) for worker in self._team]
        busy, failure = len(self._team), None
        try:
            while busy:
                try:
                    message = done.get(timeout=_TICK)
                except queue.Empty:
                    continue
                if isinstance(message, list):
                    tell(message)
                elif isinstance(message, int):
                    advance(message)
                elif message is None:
                    busy -= 1
                else:
                    failure = failure or message
                    chunks.stop()
            if failure is not None:
                raise failure
        finally:
            chunks.stop()
            if busy:
                for worker in self._team:
                    worker.stop()
            wait(at_work)
            with InterruptGuard():
                while not done.empty():
                    if isinstance(rows := done.get(), list):
                        tell(rows)

    def close(self) -> None:
        """Let the processes end."""
        for closed in [self._threads.submit(worker.close) for worker in self._team]:
            closed.result()
        self._threads.shutdown()
