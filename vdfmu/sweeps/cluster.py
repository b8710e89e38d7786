"""Chunks of a parameter study on the workers of a Dask scheduler."""

from __future__ import annotations

import asyncio
import threading
import time
from collections.abc import Callable, Generator, Sequence
from concurrent import futures
from typing import Any

from vdfmu.errors import UsageError, VdfmuError
from vdfmu.sweeps.chunks import Chunks
from vdfmu.sweeps.job import Row, Task
from vdfmu.sweeps.worker import Worker

_PATIENCE = 300.0
"""Time [s] that a scheduler, or all of its workers, may be gone."""
_ASKED = 0.5
"""Interval [s] at which lost connections are looked for."""
_TRIES = 10
"""Times that a chunk is sent out: each time its worker was killed."""
_own = threading.local()


def run_there(
    job: bytes,
    chunks: Chunks,
    address: str,
    time_limit: float | None,
    advance: Callable[[int], None],
) -> Generator[list[Row]]:
    """Yield the rows of chunks as they are done.

    The scheduler sends the chunks of a worker that is gone to another. If it is gone itself, this waits for another one
    at its address, and sends out again what had not come back.

    Raises
    ------
    UsageError
        If there is no scheduler at the address, or Dask is not installed.
    VdfmuError
        If scheduler or workers are gone for longer than `_PATIENCE`, or a chunk kills all workers that run it.
    """
    try:
        from distributed import Client
        from distributed.comm.addressing import get_address_host_port
    except ImportError as error:
        raise UsageError(
            f"scheduler: needs Dask, of which this is missing: {error}. Install it: pip install 'vdfmu[sweep]'."
        ) from None
    try:
        get_address_host_port(address)  # a client of what is no address complains when Python ends
        client = Client(address, timeout=10, set_as_default=False)
    except (OSError, ValueError, TimeoutError) as error:
        raise UsageError(f"scheduler: no Dask scheduler answers at {address}: {error}.") from None
    waiting: list[tuple[list[Task], int]] = []
    while client is not None:
        try:
            yield from _rounds(client, job, chunks, waiting, time_limit, advance)
            return
        except _LostError:
            pass
        finally:
            client.close(timeout=1)
        client = _connected(Client, address)
    raise VdfmuError(
        f"the scheduler at {address} is gone for {_PATIENCE:g} s. What was done is kept: start it, and give the same "
        "command again."
    )


def _connected(kind: Any, address: str) -> Any:
    """Return a client of the scheduler as soon as there is one; None if it takes too long."""
    end = time.monotonic() + _PATIENCE
    while time.monotonic() < end:
        try:
            return kind(address, timeout=5, set_as_default=False)
        except (OSError, TimeoutError):
            time.sleep(_ASKED)
    return None


class _LostError(Exception):
    """The scheduler is gone."""


_LOST = (
    _LostError,
    asyncio.CancelledError,
    futures.CancelledError,
    OSError,
    TimeoutError,
    AttributeError,
    RuntimeError,
)
"""What a client raises that has lost its scheduler."""


def _rounds(
    client: Any,
    job: bytes,
    chunks: Chunks,
    waiting: list[tuple[list[Task], int]],
    time_limit: float | None,
    advance: Callable[[int], None],
) -> Generator[list[Row]]:
    """As `run_there`, with one scheduler; `waiting` has what is to be sent out, with the number of tries."""
    from distributed import KilledWorker
    from distributed.comm.core import CommClosedError

    out: dict[Any, tuple[list[Task], int]] = {}
    seen = time.monotonic()
    try:
        sent = None
        while True:
            places = 2 * sum(client.nthreads().values())
            if client.status != "running":
                raise _LostError
            if places:
                seen = time.monotonic()
            elif time.monotonic() - seen > _PATIENCE:
                raise VdfmuError(
                    f"the scheduler has had no worker for {_PATIENCE:g} s. What was done is kept."
                )
            if sent is None and places:
                sent = client.scatter(job, broadcast=False, hash=False, direct=False)
            while sent is not None and len(out) < places:
                again = waiting.pop() if waiting else None
                chunk = chunks.take(places) if again is None else again[0]
                if chunk is None:
                    break
                tries = 1 if again is None else again[1] + 1
                try:
                    future = client.submit(run_chunk, sent, chunk, time_limit, pure=False)
                except BaseException:
                    waiting.append((chunk, tries))
                    raise
                out[future] = (chunk, tries)
            if not out and places:
                return
            if any(future.status in ("lost", "cancelled") for future in out):
                raise _LostError  # or the job, with the worker that had it
            for future in [f for f in out if f.status != "pending"]:
                chunk, tries = out[future]
                if future.status == "finished":
                    rows = future.result()
                    del out[future]
                    for row in rows:
                        chunks.note(row["wall_s"])
                    yield rows
                    advance(len(rows))
                elif future.status == "error" and not isinstance(
                    future.exception(), (KilledWorker, CommClosedError)
                ):
                    raise _explained(future.exception())
                elif tries == _TRIES:
                    raise VdfmuError(
                        f"points {chunk[0][0]} to {chunk[-1][0]}: the workers that ran them were lost {_TRIES} times. "
                        "What was done is kept."
                    )
                else:
                    del out[future]
                    waiting.append((chunk, tries))
                future.release()
            time.sleep(0.01)
    except (*_LOST, CommClosedError) as error:
        if client.status == "running" and isinstance(error, (AttributeError, RuntimeError)):
            raise
        waiting += list(out.values())
        raise _LostError from None


def _explained(error: BaseException) -> BaseException:
    if isinstance(error, ImportError):
        return UsageError(f"scheduler: its workers cannot import what they need: {error}.")
    return error


def run_chunk(job: bytes, tasks: Sequence[Task], time_limit: float | None) -> list[Row]:
    """Run points on a worker of Dask, in a process that lives from chunk to chunk."""
    if getattr(_own, "job", None) != job:
        if hasattr(_own, "worker"):
            _own.worker.close()
        _own.job, _own.worker = job, Worker(job, time_limit)
    return list(_own.worker.run(tasks))
