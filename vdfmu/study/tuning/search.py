"""Searches: over the whole range by differential evolution, from the best by a trust region (COBYQA)."""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import suppress
from typing import Any

import numpy as np

from vdfmu.base.arrays import Floats
from vdfmu.study.tuning.evaluate import Evaluations, Score, SpentError

_MISSED = 10.0
"""Objective at the border of the constraints; the start has 1."""
_INSIDE = 0.005
"""How far inside the constraints COBYQA ends: it comes to a border from either side."""
_PULLED = 5
"""Evaluations at the end, between the best that keeps the margin and the values with the lowest cost."""
_TRUST = (0.1, 1e-3)
"""First and last radius of the trust region, in the unit cube."""


def objective(score: Score, start: Score) -> float:
    """Mean of the elements of the cost relative to the start's; more than 10 where a constraint is missed."""
    if score.failed:
        return math.inf
    if (score.excess > 0.0).any():
        return _MISSED + float(np.sum(np.maximum(score.excess, 0.0)))
    return relative(score, start)


def relative(score: Score, start: Score) -> float:
    """Mean over the elements of the cost relative to the start's, whether constraints hold or not."""
    return float(np.mean(score.cost / start.cost))


def search(evaluations: Evaluations, method: str, seed: int) -> tuple[Score, Score]:
    """Return the scores of the start and of the best values within the budget, the start where none is better."""
    problem, budget = evaluations.problem, evaluations.budget
    (start,) = evaluations.scores_of([problem.start])

    def at(points: Floats, always: bool = False) -> list[Score]:
        return evaluations.scores_of([problem.values(u) for u in points], always)

    def best() -> Score:
        return min(evaluations.scores, key=lambda score: objective(score, start))

    kept = _PULLED if problem.loops is not None else 0
    for one, part in {"both": (("global", 0.5), ("local", 1.0))}.get(method, ((method, 1.0),)):
        evaluations.budget = max(round(part * (budget - kept)), 1)
        with suppress(SpentError):
            _SEARCHES[one](at, problem.place(best().values), start, seed, evaluations.budget)
    evaluations.budget = budget
    with suppress(SpentError):
        for other in sorted(evaluations.scores, key=lambda score: relative(score, start))[:_PULLED]:
            _pull(evaluations, best(), other)
    return start, best()


def _pull(evaluations: Evaluations, inner: Score, outer: Score) -> None:
    """Evaluate the last point between two that keeps the margin. Finding it takes no run."""
    problem = evaluations.problem
    ends = problem.place(inner.values), problem.place(outer.values)
    low, high = 0.0, 1.0
    for _ in range(8):
        share = (low + high) / 2.0
        margins = problem.margins(problem.values(ends[0] + share * (ends[1] - ends[0])))
        if margins is None or not (margins.modulus >= problem.margin).all():
            high = share
        else:
            low = share
    if low > 0.0:
        evaluations.scores_of([problem.values(ends[0] + low * (ends[1] - ends[0]))])


def _global(at: Callable[[Floats], list[Score]], u: Floats, start: Score, seed: int, budget: int) -> None:
    """Differential evolution; a generation is evaluated together."""
    from scipy.optimize import differential_evolution
    from scipy.stats import qmc

    d = len(u)
    size = max(8, 2 * d)
    drawn: Any = {"seed": seed}  # rng from SciPy 1.15 on, which takes both
    population: Any = qmc.LatinHypercube(d, **drawn).random(size)
    # a half of it around the start, which is better than most
    near = size // 2
    population[:near] = np.clip(u + 0.3 * (population[:near] - 0.5), 0.0, 1.0)
    population[0] = u
    differential_evolution(
        lambda points: np.array([min(objective(score, start), 1e6) for score in at(points.T)]),
        [(0.0, 1.0)] * d, init=population, vectorized=True, updating="deferred", polish=False, tol=0.0,
        maxiter=20 * budget, **drawn,
    )  # fmt: skip


def _local(at: Callable[..., list[Score]], u: Floats, start: Score, seed: int, budget: int) -> None:
    """COBYQA, with models of the cost and of each constraint."""
    from scipy.optimize import NonlinearConstraint, minimize

    def score(u: Floats) -> Score:
        (found,) = at(np.clip(u, 0.0, 1.0)[None], True)
        return found

    def cost(u: Floats) -> float:
        found = score(u)
        return min(relative(found, start), _MISSED) if found.number is not None else _MISSED

    def excess(u: Floats) -> Floats:
        found = np.minimum(score(u).excess, _MISSED)
        return np.concatenate([found, np.full(constraints - len(found), _MISSED)])

    constraints = len(score(u).excess)
    minimize(
        cost, u, method="COBYQA", bounds=[(0.0, 1.0)] * len(u),
        constraints=[NonlinearConstraint(excess, -np.inf, -_INSIDE)] if constraints else (),
        options={"initial_tr_radius": _TRUST[0], "final_tr_radius": _TRUST[1], "maxfev": 20 * budget},
    )  # fmt: skip


_SEARCHES: dict[str, Callable[..., None]] = {"global": _global, "local": _local}
