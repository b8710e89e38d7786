"""Costs of values: runs of all robots on workers that live as long as the search, each run kept."""

from __future__ import annotations

import queue
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import chain
from time import monotonic
from typing import Any

import numpy as np

from vdfmu.base.arrays import Floats
from vdfmu.base.interrupt import InterruptGuard
from vdfmu.study.sweeps.job import Row
from vdfmu.study.sweeps.ledger import Ledger
from vdfmu.study.sweeps.worker import Worker
from vdfmu.study.tuning.problem import Problem

_STEEP = 0.1
"""Excess for each 1/s of a growth, where margins are 0."""
_SECONDS = 5.0
"""Time [s] between two files of runs: the most that is lost when all is killed."""


class SpentError(Exception):
    """The budget of evaluations is used up."""


@dataclass(frozen=True)
class Score:
    """Score of values."""

    values: Floats
    """(d,)."""
    number: int | None
    """Number of the evaluation; None where the margin was missed and nothing was run."""
    cost: Floats
    """(k,): Elements of the cost over all robots; infinite where a run failed."""
    failed: int
    """Runs that failed."""
    excess: Floats
    """(m,): How far each constraint is missed, of the order of 1; positive if missed."""
    modulus: Floats
    """(n,): Smallest modulus margin of each loop over the run; empty without a required one."""
    measures: dict[str, float]
    """Largest of each other measure over all robots."""

    @property
    def feasible(self) -> bool:
        """Whether no run failed and all constraints hold."""
        return self.number is not None and not self.failed and not (self.excess > 0.0).any()


class Evaluations:
    """Costs of values, including costs `known` from a search that was stopped; a `budget` of evaluations may be run.

    A run has the time `time_limit` [s]; `report` is called with the number of evaluations.
    """

    def __init__(
        self, problem: Problem, ledger: Ledger, known: Sequence[Row], workers: int, budget: int,
        time_limit: float | None, report: Callable[[int], None],
    ) -> None:  # fmt: skip
        self.problem, self.budget = problem, budget
        self.scores: list[Score] = []
        """Scores of all evaluations that were run, in order."""
        self.missed = 0
        """Values that were not run, since they miss the margin."""
        self._ledger, self._report = ledger, report
        self._by_values: dict[tuple[float, ...], Score] = {}
        self._margins: dict[tuple[float, ...], tuple[Floats, float]] = {}
        self._rows = {(tuple(row[n] for n in problem.names), int(row["robot"])): row for row in known}
        self._next = 1 + max((row["point"] for row in known), default=-1)
        self._fresh: list[Row] = []
        self._kept_at = monotonic()
        self._team = [Worker(problem.plan.job.packed(), time_limit) for _ in range(workers)]
        self._idle: queue.SimpleQueue[Worker] = queue.SimpleQueue()
        for worker in self._team:
            self._idle.put(worker)
        # a process ends with the thread that started it, and these live as long as the search
        self._pool = ThreadPoolExecutor(workers)

    def __enter__(self) -> Evaluations:
        return self

    def __exit__(self, *_: object) -> None:
        with InterruptGuard():
            self._keep()
            for worker in self._team:
                worker.stop()
            self._pool.shutdown(cancel_futures=True)
            for worker in self._team:
                worker.close()

    def scores_of(self, several: Sequence[Floats], always: bool = False) -> list[Score]:
        """Return the scores of values; values that miss the margin are not run, unless `always` and stable.

        SpentError when the budget does not suffice for all new ones; as many as it allows are run and kept first.
        """
        keys = [tuple(map(float, values)) for values in several]
        new: list[tuple[float, ...]] = []
        for key in dict.fromkeys(keys):
            if key in self._by_values and not (always and self._by_values[key].number is None):
                continue
            loops = self.problem.loops(np.array(key))
            modulus, rate = self._margins[key] = (np.zeros(0), 0.0) if loops is None else (loops.modulus, loops.rate)
            unstable = not modulus.all() and rate > self.problem.rate
            missing = unstable or (not always and bool((modulus < self.problem.margin).any()))
            if missing and self.scores:  # the start is run in any case, to compare with
                self.missed += key not in self._by_values
                self._by_values[key] = self._score(key, None, [])
            else:
                new.append(key)
        held = new[: max(self.budget - len(self.scores), 0)]
        if held:
            self._run(held)
        if len(held) < len(new):
            raise SpentError
        return [self._by_values[key] for key in keys]

    def _run(self, keys: Sequence[tuple[float, ...]]) -> None:
        robots = self.problem.robots
        spread = {target: column.tolist() for target, column in self.problem.spread.items()}
        wanted = [(key, robot) for key in keys for robot in range(robots) if (key, robot) not in self._rows]
        columns = [
            {target: column[robot] for target, column in spread.items()}
            | dict(zip(self.problem.names, key, strict=True))
            for key, robot in wanted
        ]
        tasks = [(point, 0, own) for point, own in enumerate(columns, self._next)]
        self._next += len(tasks)
        together = self.problem.plan.job.together[0]
        groups = [tasks[first : first + together] for first in range(0, len(tasks), together)]
        rows = chain.from_iterable(self._pool.map(self._some, groups))
        for (key, robot), own, row in zip(wanted, columns, rows, strict=True):
            self._rows[key, robot] = row = {**row, **own, "robot": float(robot)}
            self._fresh.append(row)
        if monotonic() - self._kept_at > _SECONDS:
            self._keep()
        for key in keys:
            score = self._score(key, len(self.scores), [self._rows[key, robot] for robot in range(robots)])
            self.scores.append(score)
            self._by_values[key] = score
        self._report(len(self.scores))

    def _some(self, tasks: Sequence[Any]) -> list[Row]:
        worker = self._idle.get()
        try:
            rows = list(worker.run(tasks))
            stopped = {"failed": "stopped", "failed_at": None, "wall_s": 0.0}
            return rows + [{"point": task[0], **stopped} for task in tasks[len(rows) :]]
        finally:
            self._idle.put(worker)

    def _keep(self) -> None:
        rows, self._fresh = self._fresh, []
        self._ledger.add(rows)
        self._kept_at = monotonic()

    def _score(self, key: tuple[float, ...], number: int | None, rows: Sequence[Row]) -> Score:
        problem, (modulus, rate) = self.problem, self._margins[key]
        failed = sum(row["failed"] is not None for row in rows)
        names = list(dict.fromkeys(name for row in rows if row["failed"] is None for name in row))
        of = {name: [row[name] for row in rows if row["failed"] is None] for name in names}
        columns = [name for name in names if name.partition("[")[0] == "cost"]
        over = np.mean if problem.over == "mean" else np.max
        cost = np.array([np.inf if failed else over(of[name]) for name in columns] or [np.inf])
        excess: list[float] = []
        for limit, (_, size) in problem.limits.items():
            worst = max((max(of[n]) for n in names if n.partition("[")[0] == limit), default=np.inf)
            excess.append(np.inf if failed else worst / size)
        excess += (problem.margin - modulus + _STEEP * (rate - problem.rate) * (modulus == 0.0)).tolist()
        if len(cost) > 1:
            start = self.scores[0].cost if self.scores else cost
            excess += (cost / start - 1.0).tolist()
        measures = {
            name: float(np.max(of[name]))
            for name in names
            if name.partition("[")[0] in problem.plan.facts["measures"] and name not in columns
        }
        return Score(
            np.array(key), number, cost, failed, np.nan_to_num(excess, nan=np.inf, posinf=np.inf), modulus, measures
        )
