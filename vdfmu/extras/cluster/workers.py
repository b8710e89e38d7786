"""Runs chunks of a study on the workers of a Dask scheduler."""

from __future__ import annotations

import asyncio
import math
import queue
import threading
import time
from collections.abc import Callable, Generator, Sequence
from concurrent import futures
from typing import Any

from vdfmu.base.errors import UsageError, VdfmuError
from vdfmu.study.sweeps.job import Row, Task
from vdfmu.study.sweeps.worker import Chunks, Worker

_PATIENCE = 300.0
"""Time [s] for which a scheduler, or all of its workers, may be unreachable."""
_CONNECTING = 30.0
"""Time limit of a connection [s]; on a loaded machine a scheduler took 10 s to start."""
_ASKED = 0.5
"""Interval [s] at which a scheduler is asked for its workers."""
_TRIES = 10
"""How often a chunk is sent out if its worker is killed each time."""
_local = threading.local()


class DaskWorkers:
    """Workers of a Dask scheduler.

    The scheduler sends the chunks of a lost worker to another one. If the scheduler itself is lost, this waits for a
    new one at the same address and sends the unfinished chunks again. UsageError without a scheduler or Dask.
    """

    def __init__(self, job: bytes, address: str, time_limit: float | None) -> None:
        try:
            from distributed import Client
            from distributed.comm.addressing import get_address_host_port
        except ImportError as error:
            raise UsageError(f"scheduler: needs Dask, got: {error}. Install it: pip install 'vdfmu[sweep]'.") from None
        self._kind, self._job, self._address, self._time_limit = Client, job, address, time_limit
        try:
            get_address_host_port(address)  # a client with a wrong address complains when Python ends
            self._client: Any = Client(address, timeout=_CONNECTING, set_as_default=False)
        except (OSError, ValueError, TimeoutError) as error:
            raise UsageError(f"scheduler: no Dask scheduler answers at {address}: {error}.") from None

    def run(self, chunks: Chunks, tell: Callable[[list[Row]], None], advance: Callable[[int], None]) -> None:
        """Run chunks as `LocalWorkers.run`; VdfmuError if scheduler or workers stay unreachable or crash repeatedly."""
        waiting: list[tuple[list[Task], int]] = []
        while True:
            try:
                for rows in _rounds(self._client, self._job, chunks, waiting, self._time_limit):
                    tell(rows)
                    advance(len(rows))
                return
            except _LostError:
                self.close()
            self._connect()

    def _connect(self) -> None:
        """Connect as soon as there is a scheduler."""
        end = time.monotonic() + _PATIENCE
        while (left := end - time.monotonic()) > 0.0:
            try:
                self._client = self._kind(self._address, timeout=min(left, _CONNECTING), set_as_default=False)
                return
            except (OSError, TimeoutError):
                time.sleep(_ASKED)
        raise VdfmuError(
            f"the scheduler at {self._address} could not be reached for {_PATIENCE:g} s. Finished points are kept: "
            f"start it, and "
            f"repeat the command."
        )

    def close(self) -> None:
        """Close the connection."""
        self._client.close(timeout=1)


class _LostError(Exception):
    """The scheduler cannot be reached."""


_LOST = (OSError, futures.CancelledError, asyncio.CancelledError)
"""Errors of a client whose connection ends, even while it reconnects automatically."""


def _rounds(
    client: Any, job: bytes, chunks: Chunks, waiting: list[tuple[list[Task], int]], time_limit: float | None
) -> Generator[list[Row]]:
    """Yield the rows of chunks from one scheduler. `waiting` are the chunks to send out, with the number of tries."""
    from distributed import KilledWorker
    from distributed.comm.core import CommClosedError

    def ask(function: Callable[..., Any], *arguments: Any, **options: Any) -> Any:
        """Call a function of the client, whose connection may have ended, which raises various errors."""
        try:
            return function(*arguments, **options)
        except (Exception, asyncio.CancelledError) as error:
            if client.status == "running" and not isinstance(error, _LOST):
                raise
            raise _LostError from None

    out: dict[Any, tuple[list[Task], int]] = {}
    done: queue.SimpleQueue[Any] = queue.SimpleQueue()
    sent, places, asked, seen = None, 0, -math.inf, time.monotonic()
    try:
        while True:
            if time.monotonic() > asked + _ASKED:
                places, asked = 2 * sum(ask(client.nthreads).values()), time.monotonic()
                if client.status != "running":
                    raise _LostError
                if places:
                    seen = asked
                elif asked > seen + _PATIENCE:
                    raise VdfmuError(f"the scheduler has had no worker for {_PATIENCE:g} s. Finished points are kept.")
            if sent is None and places:
                sent = ask(client.scatter, job, broadcast=False, hash=False, direct=False)
            while len(out) < places:
                chunk, tries = waiting.pop() if waiting else (chunks.take(places), 0)
                if chunk is None:
                    break
                try:
                    future = ask(client.submit, run_chunk, sent, chunk, time_limit, pure=False)
                except BaseException:
                    waiting.append((chunk, tries))
                    raise
                out[future] = (chunk, tries + 1)
                future.add_done_callback(done.put)
            if not out and places:
                return
            try:
                future = done.get(timeout=_ASKED)
            except queue.Empty:
                continue
            if future.status not in ("finished", "error"):
                raise _LostError  # or the job, with the worker that had it
            chunk, tries = out[future]
            error = future.exception() if future.status == "error" else None
            if error is None:
                rows = ask(future.result)
                del out[future]
                for row in rows:
                    chunks.note(row["wall_s"])
                yield rows
            elif not isinstance(error, (KilledWorker, CommClosedError)):
                if isinstance(error, ImportError):
                    raise UsageError(f"scheduler: its workers cannot import what they need: {error}.")
                raise error
            elif tries == _TRIES:
                raise VdfmuError(
                    f"points {chunk[0][0]} to {chunk[-1][0]}: the workers that ran them were lost {_TRIES} times. "
                    "Finished points are kept."
                )
            else:
                del out[future]
                waiting.append((chunk, tries))
            future.release()
    except _LostError:
        waiting += list(out.values())
        raise


def run_chunk(job: bytes, tasks: Sequence[Task], time_limit: float | None) -> list[Row]:
    """Run points on a Dask worker, in a process that is kept from chunk to chunk."""
    if getattr(_local, "job", None) != job:
        if hasattr(_local, "worker"):
            _local.worker.close()
        _local.job, _local.worker = job, Worker(job, time_limit)
    return list(_local.worker.run(tasks))
