"""A study: points, workers that run them in chunks, and a ledger that stores their rows."""

from __future__ import annotations

import os
import queue
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from typing import Self

import numpy as np
from numpy.typing import NDArray

from vdfmu.base.errors import UsageError, VdfmuError
from vdfmu.base.extras import module_of_extra
from vdfmu.base.interrupt import InterruptGuard
from vdfmu.study.options import WorkerOptions
from vdfmu.study.sweeps.job import Job, Row, Task
from vdfmu.study.sweeps.ledger import Ledger
from vdfmu.study.sweeps.worker import Chunks, Worker

_TICK = 0.2
"""Interval [s] at which Ctrl-C is checked."""


def processors() -> int:
    """Return the number of processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


class LocalWorkers:
    """Processes on this machine, which are kept from one set of chunks to the next."""

    def __init__(self, job: bytes, count: int, time_limit: float | None) -> None:
        self._team = [Worker(job, time_limit) for _ in range(count)]
        # a thread waits for each process, which ends with the thread that started it
        self._threads = ThreadPoolExecutor(count)

    def run(self, chunks: Chunks, tell: Callable[[list[Row]], None], advance: Callable[[int], None]) -> None:
        """Run chunks. Call `tell` with their rows, even if interrupted, and `advance` with the number of new points."""
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


class Study:
    """Points of a job, run by at most `most` workers, which exist as long as the study, and stored in a ledger.

    `ask` runs points: a sweep requests all of them, a search one generation. Rows in the ledger survive the process, so
    that the same study only runs the missing points.
    """

    def __init__(
        self, job: Job, ledger: Ledger, options: WorkerOptions, most: int | None = None, chunk: int | None = None
    ) -> None:
        self.ledger, self._together, self._chunk, self._missing = ledger, max(job.together), chunk, 0
        packed, limit = job.packed(), options["time_limit"]
        if (scheduler := options.get("scheduler")) is not None:
            self._workers = module_of_extra("workers", "cluster", "scheduler").DaskWorkers(packed, scheduler, limit)
        else:
            count = options["workers"] or processors()
            self._workers = LocalWorkers(packed, max(min(count, most or count), 1), limit)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        with InterruptGuard():
            self._workers.close()

    def ask(
        self,
        points: Sequence[int] | NDArray[np.intp],
        task: Callable[[int], Task],
        advance: Callable[[int], None] = lambda points: None,
    ) -> None:
        """Run points, in ascending order, and store their rows. VdfmuError if any are missing. `advance`: see `run`."""
        chunks = Chunks(np.array(points, dtype=int), task, self._chunk, self._together)
        self._missing = len(points)
        self._workers.run(chunks, self.tell, advance)
        if self._missing:
            raise VdfmuError(f"{self.ledger.folder}: {self._missing} points are missing: repeat the command.")

    def tell(self, rows: list[Row]) -> None:
        """Store the rows of consecutive points."""
        self.ledger.add(rows)
        self._missing -= len(rows)


def check_workers(options: WorkerOptions) -> None:
    """Raise UsageError for options of workers that are out of range."""
    workers, time_limit = options["workers"], options["time_limit"]
    if workers is not None and workers < 1:
        raise UsageError(f"workers: expected at least 1, got {workers}.")
    if time_limit is not None and not 0.0 < time_limit < np.inf:
        raise UsageError(f"time_limit must be a positive, finite time in s, got {time_limit:g}. The default is 600 s.")
