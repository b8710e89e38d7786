"""Chunks of a parameter study on the processors of this machine."""

from __future__ import annotations

import os
import queue
import threading
from collections.abc import Callable, Generator

from vdfmu.base.errors import UsageError
from vdfmu.study.options import WorkerOptions
from vdfmu.study.sweeps.chunks import Chunks
from vdfmu.study.sweeps.job import Row
from vdfmu.study.sweeps.worker import Worker

_TICK = 0.2
"""Interval [s] at which Ctrl-C is checked."""


def processors() -> int:
    """Return the number of processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def check_workers(options: WorkerOptions) -> None:
    """Raise UsageError for options of workers out of their range."""
    workers, time_limit = options["workers"], options["time_limit"]
    if workers is not None and workers < 1:
        raise UsageError(f"workers: expected at least 1, got {workers}.")
    if time_limit is not None and not time_limit > 0.0:
        raise UsageError(f"time_limit: expected a positive time, got {time_limit:g} s.")


def run_here(
    job: bytes, chunks: Chunks, workers: int, time_limit: float | None, advance: Callable[[int], None]
) -> Generator[list[Row]]:
    """Yield the rows of chunks as they are done, even of an interrupted chunk.

    A thread for each worker waits for its process; all files are written by the thread that calls this. `advance` is
    called with the number of points done since the last time.
    """
    done: queue.SimpleQueue[list[Row] | BaseException | int | None] = queue.SimpleQueue()
    team = [Worker(job, time_limit) for _ in range(workers)]

    def work(worker: Worker) -> None:
        rows: list[Row] = []
        try:
            while (chunk := chunks.take(2 * workers)) is not None:
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
            worker.close()
            done.put(None)

    threads = [threading.Thread(target=work, args=(worker,), daemon=True) for worker in team]
    for thread in threads:
        thread.start()
    busy, failure = len(team), None
    try:
        while busy:
            try:
                message = done.get(timeout=_TICK)
            except queue.Empty:
                continue
            if isinstance(message, list):
                yield message
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
        for worker in team:
            worker.stop()
        for thread in threads:
            thread.join()
        while not done.empty():
            rows = done.get()
            if isinstance(rows, list) and rows:
                chunks.left.append(rows)
