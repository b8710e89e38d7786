"""Costs of values: a study of the runs of all robots."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import count

import numpy as np

from vdfmu.base.arrays import Floats
from vdfmu.study.options import TuneOptions
from vdfmu.study.sweeps.job import Row
from vdfmu.study.sweeps.ledger import Ledger
from vdfmu.study.sweeps.study import Study
from vdfmu.study.tuning.problem import Problem

_STEEP = 0.1
"""Excess for each 1/s of a growth, where margins are 0."""
Values = tuple[float, ...]


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


class Evaluations(Study):
    """Costs of values. A search asks for them, and `budget` of them may be run.

    Runs that the ledger has are not run again. Points have the numbers that an undisturbed search gives them. `report`
    is called with the number of evaluations.
    """

    def __init__(self, problem: Problem, ledger: Ledger, options: TuneOptions, report: Callable[[int], None]) -> None:
        known = ledger.reopen()
        super().__init__(problem.plan.job, ledger, options, max(problem.robots, 2))
        self.problem, self.budget = problem, options["evaluations"]
        self.scores: list[Score] = []
        """Scores of all evaluations that were run, in order."""
        self.missed = 0
        """Values that were not run, since they miss the margin."""
        self._report = report
        self._by_values: dict[Values, Score] = {}
        self._margins: dict[Values, tuple[Floats, float]] = {}
        self._rows = {(tuple(row[n] for n in problem.names), int(row["robot"])): row for row in known}
        taken = {row["point"] for row in known}
        self._free = (point for point in count() if point not in taken)
        self._asked: dict[int, tuple[Values, int]] = {}

    def scores_of(self, several: Sequence[Floats], always: bool = False) -> list[Score]:
        """Return the scores of values; values that miss the margin are not run, unless `always` and stable.

        SpentError when the budget does not suffice for all new ones; as many as it allows are run and kept first.
        """
        keys = [tuple(map(float, values)) for values in several]
        new: list[Values] = []
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

    def _run(self, keys: Sequence[Values]) -> None:
        robots = range(self.problem.robots)
        wanted = [(key, robot) for key in keys for robot in robots if (key, robot) not in self._rows]
        self._asked = {next(self._free): each for each in wanted}
        self.ask([*self._asked], lambda point: (point, 0, self._columns(*self._asked[point])))
        for key in keys:
            score = self._score(key, len(self.scores), [self._rows[key, robot] for robot in robots])
            self.scores.append(score)
            self._by_values[key] = score
        self._report(len(self.scores))

    def _columns(self, key: Values, robot: int) -> dict[str, float]:
        """Return the values of the axes for a robot."""
        spread = {target: column[robot].item() for target, column in self.problem.spread.items()}
        return spread | dict(zip(self.problem.names, key, strict=True))

    def tell(self, rows: list[Row]) -> None:
        """Keep rows, with the values and the robot that they are of."""
        for row in rows:
            key, robot = self._asked[row["point"]]
            row |= self._columns(key, robot) | {"robot": float(robot)}
            self._rows[key, robot] = row
        super().tell(rows)

    def _score(self, key: Values, number: int | None, rows: Sequence[Row]) -> Score:
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
