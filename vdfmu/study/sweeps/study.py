"""A study: points, workers that run them, and a ledger that keeps their rows. Sweeps and searches are studies."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Self

import numpy as np
from numpy.typing import NDArray

from vdfmu.base.errors import UsageError, VdfmuError
from vdfmu.base.interrupt import InterruptGuard
from vdfmu.study.options import WorkerOptions
from vdfmu.study.sweeps.job import Job, Row, Task
from vdfmu.study.sweeps.ledger import Ledger
from vdfmu.study.sweeps.local import Chunks, LocalWorkers, processors


class Study:
    """Points of a job, run by at most `most` workers, which live as long as the study, and kept in a ledger.

    `ask` runs points: a sweep asks for all, a search for a generation. `tell` keeps rows. Rows that a ledger has stay,
    whatever ends the process: the same study asks for the other points.
    """

    def __init__(
        self, job: Job, ledger: Ledger, options: WorkerOptions, most: int | None = None, chunk: int | None = None
    ) -> None:
        self.ledger, self._together, self._chunk, self._missing = ledger, max(job.together), chunk, 0
        packed, limit = job.packed(), options["time_limit"]
        if (scheduler := options.get("scheduler")) is not None:
            from vdfmu.study.sweeps.cluster import DaskWorkers

            self._workers = DaskWorkers(packed, scheduler, limit)
        else:
            count = options["workers"] or processors()
            self._workers = LocalWorkers(packed, max(min(count, most or count), 1), limit)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        with InterruptGuard():
            self._workers.close()

    def ask(
        self, points: Sequence[int] | NDArray[np.intp], task: Callable[[int], Task],
        advance: Callable[[int], None] = lambda points: None,
    ) -> None:  # fmt: skip
        """Run points, in ascending order, by their tasks, and tell their rows, in chunks as they are done.

        `advance` is called with the number of points done since the last time. VdfmuError if points are missing.
        """
        chunks = Chunks(np.array(points, dtype=int), task, self._chunk, self._together)
        self._missing = len(points)
        self._workers.run(chunks, self.tell, advance)
        if self._missing:
            raise VdfmuError(
                f"{self.ledger.folder}: {self._missing} points are missing: give the same command again to run them."
            )

    def tell(self, rows: list[Row]) -> None:
        """Keep the rows of consecutive points."""
        self.ledger.add(rows)
        self._missing -= len(rows)


def check_workers(options: WorkerOptions) -> None:
    """Raise UsageError for options of workers out of their range."""
    workers, time_limit = options["workers"], options["time_limit"]
    if workers is not None and workers < 1:
        raise UsageError(f"workers: expected at least 1, got {workers}.")
    if time_limit is not None and not time_limit > 0.0:
        raise UsageError(f"time_limit: expected a positive time, got {time_limit:g} s.")
