"""The problem of a tuning, with varied numbers, cost, limits, robots and margin, and the evaluation of values."""

from __future__ import annotations

import dataclasses
import math
import os
import re
import weakref
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from itertools import count
from typing import Any, Unpack

import numpy as np

from vdfmu.base.arrays import Floats
from vdfmu.base.errors import UsageError
from vdfmu.base.option import check_type, pick, with_options
from vdfmu.compiler.unit.declaration import NO_LIMIT
from vdfmu.engine.linear.growth import Along, Poses
from vdfmu.engine.linear.linearise import can_change
from vdfmu.extras.tune.options import ProblemOptions, TuneOptions
from vdfmu.study.analysis.loops import judged, run_along
from vdfmu.study.options import ScenarioOptions
from vdfmu.study.run.prepare import prepare
from vdfmu.study.sweeps.axes import Axis, is_option, read_axes
from vdfmu.study.sweeps.job import Row
from vdfmu.study.sweeps.ledger import Ledger
from vdfmu.study.sweeps.plan import TRACKING, Plan, make_plan
from vdfmu.study.sweeps.study import Study
from vdfmu.system.scenario import Scenario
from vdfmu.system.scenario.values import present_values, system_values

_RANGE = "*log(0.1, 10)"
"""Default range of a varied number."""
_LIMIT = re.compile(r"(.+?)\s*(<=|>=|<|>)\s*([^<>=]+)")


@dataclass(frozen=True)
class Problem:
    """The problem of a tuning."""

    axes: tuple[Axis, ...]
    """An axis for each varied number, ``lin`` or ``log``, of values, or of factors of all elements together."""
    start: Floats
    """Values of the scenario, (d,); 1 for a factor."""
    limits: dict[str, tuple[Any, float]]
    """Measure whose largest value over all robots must not be positive, to its text or function, and the magnitude of
    its right-hand side."""
    over: str
    """``mean`` or ``worst``: how the costs of the robots are combined."""
    plan: Plan
    """Plan of a sweep whose points are the robots."""
    poses: Poses | None
    """The loops along the run at the start; None without a required margin."""
    margin: Floats
    """Required modulus margin of each loop, (n,), or empty."""
    rate: float
    """Largest growth rate [1/s] of a mode: 0, or that at the start if the margin must be the same as there."""

    @property
    def names(self) -> list[str]:
        """Varied variables, ``component.variable``."""
        return [axis.target for axis in self.axes]

    @property
    def robots(self) -> int:
        """Number of robots."""
        return len(self.plan)

    @property
    def spread(self) -> dict[str, Floats]:
        """Variables that differ between robots: target to values, (robots,)."""
        return {target: column for target, column in self.plan.points.items() if target not in self.names}

    def values(self, u: Floats) -> Floats:
        """Return the values (d,) at a point of the unit cube, rounded to four digits."""
        at = np.array([axis.at(share) for axis, share in zip(self.axes, u, strict=True)])
        return np.array([float(f"{value:.4g}") for value in at])

    def place(self, values: Floats) -> Floats:
        """Return the point of the unit cube for values, or the point nearest to it."""
        ends = np.array([axis.numbers for axis in self.axes]).T
        log = np.array([axis.form == "log" for axis in self.axes])
        low, high, x = (np.where(log, np.log(np.where(log, np.abs(v), 1.0)), v) for v in (*ends, values))
        return np.clip((x - low) / (high - low), 0.0, 1.0)

    def parameters(self, values: Floats) -> dict[str, float]:
        """Return the parameters for values by ``component.variable``."""
        return self.plan.job.systems[0].parameters(dict(zip(self.names, values.tolist(), strict=True)))

    def loops(self, values: Floats) -> Along | None:
        """Return the loops along the run at the start with other values; None without a required margin."""
        if self.poses is None:
            return None
        changes: dict[str, dict[str, float]] = {}
        for name, value in self.parameters(values).items():
            component, _, variable = name.partition(".")
            changes.setdefault(component, {})[variable] = value
        return self.poses.changed(changes)


@with_options
def make_problem(
    scenario: Any, vary: Mapping[str, Any] | Sequence[str], cost: Any, **options: Unpack[ProblemOptions]
) -> Problem:
    """Read and check the problem; for arguments see `tune`. Errors are raised before anything runs."""
    over, limit, margin = options["combine"], options["limit"], options["margin"]
    changes, parameters = pick(ScenarioOptions, options), options["parameters"] or {}
    if over not in ("mean", "worst"):
        raise UsageError(f"combine: expected mean or worst, got {over}.")
    if isinstance(scenario, (str, os.PathLike)) and os.fspath(scenario).endswith(".ssp"):
        raise UsageError(f"{scenario}: expected a scenario: a package has no values to start from. Sweep it instead.")
    loaded = prepare(scenario, **changes)
    axes, start = _elements(loaded, vary, parameters, options["together"])
    spread_axes = read_axes(options["spread"])
    if wrong := [str(axis) for axis in spread_axes if is_option(axis.target) or isinstance(axis.at(0.0).item(), str)]:
        raise UsageError("\n".join(f"spread: expected parameters with numbers, got {text}." for text in wrong))
    targets = [axis.target for axis in (*axes, *spread_axes)]
    if len(set(targets)) < len(targets):
        raise UsageError(
            f"vary: expected each number once, got {', '.join(sorted({t for t in targets if targets.count(t) > 1}))}"
            " several times."
        )
    if isinstance(limit, Mapping):
        limits: dict[str, tuple[Any, float]] = {name: (function, 1.0) for name, function in limit.items()}
    else:
        limits = dict(_limit(number, text) for number, text in enumerate(limit, 1))
    measures = {"cost": cost, **{name: text for name, (text, _) in limits.items()}}
    if {"trajectory", "controller", "plant"} <= loaded.system.parts.keys():
        measures |= {name: text for name, text in TRACKING.items() if name not in measures}
    over_all = {axis.target: str(axis).partition("=")[2] for axis in (*axes, *spread_axes)}
    n = options["spread_points"] if spread_axes else 1
    plan = make_plan(
        scenario,
        over_all,
        sample="lhs",
        points=n,
        seed=options["seed"],
        measure=measures,
        engine=options["engine"],
        **changes,
    )
    facts = {**plan.facts, "tune": {"limits": list(limit), "over": over, "start": start}}
    poses, required, rate = None, np.zeros(0), 0.0
    if margin is not None:
        poses = _poses(loaded, parameters, [axis.target.partition(".")[0] for axis in axes])
        loops = judged(poses, 0.0, loaded.stop).loops
        required, same = loops.modulus, margin == "same"
        required, rate = (required, max(loops.rate, 0.0)) if same else (np.full(len(required), _number(margin)), 0.0)
        facts["tune"] |= {"margin": required.tolist()}
    plan = dataclasses.replace(plan, facts=facts, job=dataclasses.replace(plan.job, compared=()))
    return Problem(tuple(axes), np.array(start), limits, over, plan, poses, required, rate)


def _poses(scenario: Scenario, parameters: Mapping[str, Any], varied: Sequence[str]) -> Poses:
    """Return the loops along the run of a scenario, whose components stay loaded until nothing refers to them."""
    if "plant" in varied:
        raise UsageError("margin: the parameters to vary must not belong to the plant. Omit those that do.")
    stack = ExitStack()
    try:
        poses, *_ = stack.enter_context(run_along(scenario, again=True, parameters=parameters))
        assert poses.components is not None
        if fixed := [name for name in dict.fromkeys(varied) if not can_change(poses.components.exchange.checked, name)]:
            raise UsageError(
                f"margin: {', '.join(fixed)}: expected native FMUs without sampled states, because only their loops "
                "are known for other values. Tune without a margin; the verdict of a run reports it."
            )
    except BaseException:
        stack.close()
        raise
    weakref.finalize(poses, stack.close)
    return poses


def _elements(
    scenario: Any, vary: Mapping[str, Any] | Sequence[str], parameters: Mapping[str, Any], together: bool
) -> tuple[list[Axis], list[float]]:
    """Return an axis and the scenario's value for each number or, if `together`, an axis of factors per parameter."""
    check_type("vary", "Mapping[str, Any] | Sequence[str]", vary)
    axes = vary if isinstance(vary, Mapping) else [t if "=" in t else f"{t}={_RANGE}" for t in vary]
    values = system_values(scenario, parameters)
    elements: list[Axis] = []
    starts: list[float] = []
    problems: list[str] = []
    for axis in read_axes(axes):
        if axis.form not in ("lin", "log"):
            problems.append(f"{axis.target}: expected lin(FROM, TO) or log(FROM, TO), got {axis}.")
            continue
        if together:
            if not axis.factor or not min(axis.numbers) <= 1.0 <= max(axis.numbers):
                problems.append(f"{axis.target}: together: expected factors around 1, *log(0.1, 10), got {axis}.")
            elements.append(axis)
            starts.append(1.0)
            continue
        number = 1.0 if axis.factor else axis.numbers[0]
        for name, start in present_values(scenario, values, axis.target, number).items():
            low, high = sorted(axis.numbers)
            if not isinstance(start, float) or start == NO_LIMIT:
                problems.append(f"{name}: expected a finite number to vary, got {start}.")
                continue
            if axis.factor:
                low, high = sorted((low * start, high * start))
            if not low < high or (axis.form == "log" and not low * high > 0.0):
                problems.append(f"{name}: expected a range, got {low:g} to {high:g}.")
                continue
            if not low <= start <= high:
                problems.append(f"{name}: expected a range that has the scenario's {start:g}, got {low:g} to {high:g}.")
            elements.append(Axis(name, axis.form, (low, high)))
            starts.append(start)
    if not elements and not problems:
        problems.append("vary: expected at least one parameter, such as controller.K_p.")
    if problems:
        raise UsageError("\n".join(problems))
    return elements, starts


def _limit(number: int, text: str) -> tuple[str, tuple[str, float]]:
    """Return a limit as a measure that must not be positive."""
    parts = _LIMIT.fullmatch(text.strip())
    try:
        if parts is None:
            raise ValueError
        bound = float(parts[3])
    except ValueError:
        raise UsageError(f"limit: expected EXPRESSION < NUMBER, or >, got {text}.") from None
    sign = 1 if parts[2].startswith("<") else -1
    return f"limit_{number}", (f"{sign} * (({parts[1]}) - ({bound!r}))", abs(bound) or 1.0)


def _number(margin: float | str) -> float:
    try:
        value = float(margin)
    except ValueError:
        value = math.nan
    if not 0.0 <= value < 1.0:
        raise UsageError(f"margin: expected a modulus margin from 0 to below 1, or same, got {margin}.")
    return value


_STEEP = 0.1
"""Penalty per 1/s by which a mode grows, where margins are 0."""
Values = tuple[float, ...]


class SpentError(Exception):
    """The budget of evaluations is exhausted."""


@dataclass(frozen=True)
class Score:
    """Score of values."""

    values: Floats
    """(d,)."""
    number: int | None
    """Number of the evaluation; None if the margin was violated and nothing was run."""
    cost: Floats
    """Elements of the cost over all robots, (k,); infinite if a run failed."""
    failed: int
    """Number of failed runs."""
    excess: Floats
    """Violation of each constraint, (m,), scaled to the order of 1; positive if violated."""
    modulus: Floats
    """Smallest modulus margin of each loop over the run, (n,); empty without a required one."""
    measures: dict[str, float]
    """Largest value of each other measure over all robots."""
    points: tuple[int, ...] = ()
    """Rows in the table, one per robot."""

    @property
    def feasible(self) -> bool:
        """Whether no run failed and all constraints hold."""
        return self.number is not None and not self.failed and not (self.excess > 0.0).any()


class Evaluations(Study):
    """Evaluates values that a search requests, at most `budget` of them.

    Runs in the ledger are not repeated. Points are numbered as in an uninterrupted search. `report`
    is called with the number of evaluations.
    """

    def __init__(self, problem: Problem, ledger: Ledger, options: TuneOptions, report: Callable[[int], None]) -> None:
        rows = ledger.reopen()
        super().__init__(problem.plan.job, ledger, options, max(problem.robots, 2))
        self.problem, self.budget = problem, options["evaluations"]
        self.scores: list[Score] = []
        """Scores of all evaluations that were run, in order."""
        self.missed = 0
        """Number of values that were not run because they violate the margin."""
        self._report = report
        self._by_values: dict[Values, Score] = {}
        self._margins: dict[Values, tuple[Floats, float]] = {}
        self._rows = {(tuple(row[n] for n in problem.names), int(row["robot"])): row for row in rows}
        taken = {row["point"] for row in rows}
        self._free = (point for point in count() if point not in taken)
        self._asked: dict[int, tuple[Values, int]] = {}

    def scores_of(self, several: Sequence[Floats], always: bool = False) -> list[Score]:
        """Return the scores of values; values that violate the margin are not run, unless `always` and stable.

        SpentError if the budget does not suffice for all new ones; as many as it allows are first run and stored.
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
            if missing and self.scores:  # the start is always run, for comparison
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
        """Store rows with their values and robot."""
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
        missed = np.nan_to_num(excess, nan=np.inf, posinf=np.inf)
        points = tuple(int(row["point"]) for row in rows)
        return Score(np.array(key), number, cost, failed, missed, modulus, measures, points)
