"""`tune`: searches by differential evolution and a trust region, and writes values and tables."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Unpack

import numpy as np

from vdfmu.base.arrays import Floats
from vdfmu.base.cache import one_job
from vdfmu.base.errors import UsageError, VdfmuError
from vdfmu.base.files import replacing
from vdfmu.base.option import pick, with_options
from vdfmu.base.progress import report, with_progress
from vdfmu.base.toml_file import toml_text
from vdfmu.engine.linear.loops import Margins
from vdfmu.extras.tune.options import METHODS, ProblemOptions, TuneOptions
from vdfmu.extras.tune.problem import Evaluations, Score, SpentError, make_problem
from vdfmu.study.analysis.loops import Judged
from vdfmu.study.limits import OF_SCENARIO, read_limits
from vdfmu.study.options import ScenarioOptions
from vdfmu.study.run.prepare import prepare
from vdfmu.study.sweeps.ledger import Ledger
from vdfmu.study.sweeps.study import check_workers
from vdfmu.study.sweeps.table import TUNED
from vdfmu.study.verdict import loop_sentences
from vdfmu.system.scenario.values import group_value

_MISSED = 10.0
"""Objective at the boundary of the constraints; the start has 1."""
_INSIDE = 0.005
"""Distance inside the constraints at which COBYQA ends, because it approaches a boundary from either side."""
_PULLED = 5
"""Final evaluations between the best values that respect the margin and those with the lowest cost."""
_TRUST = (0.1, 1e-3)
"""Initial and final radius of the trust region in the unit cube."""


def objective(score: Score, start: Score) -> float:
    """Mean of the cost's elements relative to those at the start; more than 10 if a constraint is violated."""
    if score.failed:
        return math.inf
    if (score.excess > 0.0).any():
        return _MISSED + float(np.sum(np.maximum(score.excess, 0.0)))
    return relative(score, start)


def relative(score: Score, start: Score) -> float:
    """Mean of the cost's elements relative to those at the start, whether or not constraints are met."""
    return float(np.mean(score.cost / start.cost))


def search(evaluations: Evaluations, method: str, seed: int) -> tuple[Score, Score]:
    """Return the scores of the start and of the best values within the budget, or of the start if none is better."""
    problem, budget = evaluations.problem, evaluations.budget
    (start,) = evaluations.scores_of([problem.start])

    def at(points: Floats, always: bool = False) -> list[Score]:
        return evaluations.scores_of([problem.values(u) for u in points], always)

    def best() -> Score:
        return min(evaluations.scores, key=lambda score: objective(score, start))

    kept = _PULLED if problem.poses is not None else 0
    for stage, part in {"both": (("global", 0.5), ("local", 1.0))}.get(method, ((method, 1.0),)):
        evaluations.budget = max(round(part * (budget - kept)), 1)
        with suppress(SpentError):
            _SEARCHES[stage](at, problem.place(best().values), start, seed, evaluations.budget)
    evaluations.budget = budget
    with suppress(SpentError):
        for other in sorted(evaluations.scores, key=lambda score: relative(score, start))[:_PULLED]:
            _pull(evaluations, best(), other)
    return start, best()


def _pull(evaluations: Evaluations, inner: Score, outer: Score) -> None:
    """Evaluate the last point between two values that respects the margin; finding it needs no run."""
    problem = evaluations.problem
    ends = problem.place(inner.values), problem.place(outer.values)
    low, high = 0.0, 1.0
    for _ in range(8):
        share = (low + high) / 2.0
        loops = problem.loops(problem.values(ends[0] + share * (ends[1] - ends[0])))
        if loops is None or not (loops.modulus >= problem.margin).all():
            high = share
        else:
            low = share
    if low > 0.0:
        evaluations.scores_of([problem.values(ends[0] + low * (ends[1] - ends[0]))])


def _global(at: Callable[[Floats], list[Score]], u: Floats, start: Score, seed: int, budget: int) -> None:
    """Differential evolution, in which a generation is evaluated together."""
    from scipy.optimize import differential_evolution
    from scipy.stats import qmc

    d = len(u)
    size = max(8, 2 * d)
    drawn: Any = {"seed": seed}  # rng from SciPy 1.15 on, which accepts both
    population: Any = qmc.LatinHypercube(d, **drawn).random(size)
    # half of the population is near the start, which is better than most points
    near = size // 2
    population[:near] = np.clip(u + 0.3 * (population[:near] - 0.5), 0.0, 1.0)
    population[0] = u
    differential_evolution(
        lambda points: np.array([min(objective(score, start), 1e6) for score in at(points.T)]),
        [(0.0, 1.0)] * d, init=population, vectorized=True, updating="deferred", polish=False, tol=0.0,
        maxiter=20 * budget, **drawn,
    )  # fmt: skip


def _local(at: Callable[..., list[Score]], u: Floats, start: Score, seed: int, budget: int) -> None:
    """COBYQA, which models the cost and each constraint."""
    from scipy.optimize import NonlinearConstraint, minimize

    def score(u: Floats) -> Score:
        (scored,) = at(np.clip(u, 0.0, 1.0)[None], True)
        return scored

    def cost(u: Floats) -> float:
        scored = score(u)
        return min(relative(scored, start), _MISSED) if scored.number is not None else _MISSED

    def excess(u: Floats) -> Floats:
        values = np.minimum(score(u).excess, _MISSED)
        return np.concatenate([values, np.full(constraints - len(values), _MISSED)])

    constraints = len(score(u).excess)
    minimize(
        cost, u, method="COBYQA", bounds=[(0.0, 1.0)] * len(u),
        constraints=[NonlinearConstraint(excess, -np.inf, -_INSIDE)] if constraints else (),
        options={"initial_tr_radius": _TRUST[0], "final_tr_radius": _TRUST[1], "maxfev": 20 * budget},
    )  # fmt: skip


_SEARCHES: dict[str, Callable[..., None]] = {"global": _global, "local": _local}


@dataclass(frozen=True)
class Tuned:
    """The results of a search."""

    folder: Path
    """Folder with ``tuned.toml``, sections for a scenario; ``tune.json``, the comparison; and the table of all runs."""
    parameters: dict[str, Any]
    """The values, as `vdfmu.run` accepts them."""
    before: Score
    """Score of the scenario's values."""
    after: Score
    """Score of the best values."""
    evaluations: int
    """Number of values that were run."""
    failed: int
    missed: int
    """Number of values that were not run, because they miss the margin."""
    margins: tuple[Margins, ...]
    """Smallest margin of each loop over the run, before and after; empty if no margin is required."""
    notes: list[str] = field(default_factory=list)

    def table(self) -> list[tuple[str, float, float]]:
        """Rows of name, before, after: cost, measures, margins of each loop."""
        rows: list[tuple[str, float, float]] = []
        names = [f"cost[{i}]" for i in range(1, len(self.after.cost) + 1)] if len(self.after.cost) > 1 else ["cost"]
        rows += list(zip(names, self.before.cost.tolist(), self.after.cost.tolist(), strict=True))
        rows += [(name, self.before.measures.get(name, math.nan), value) for name, value in self.after.measures.items()]
        if self.margins:
            for name in ("modulus", "gain", "phase", "delay"):
                pair = (getattr(margins, name).tolist() for margins in self.margins)
                rows += [(f"{name}[{i}]", *both) for i, both in enumerate(zip(*pair, strict=True), 1)]
            rows.append(("rate", self.margins[0].rate, self.margins[1].rate))
        return rows


@with_progress
@one_job()
@with_options
def tune(scenario: Any, vary: Mapping[str, Any] | Sequence[str], cost: Any, **options: Unpack[TuneOptions]) -> Tuned:
    """Search for the parameter values with the lowest cost, over a spread of robots and within limits.

    Every run is stored, so after Ctrl-C or a kill the same call resumes. A call with more evaluations or another method
    reuses earlier runs.

    Parameters
    ----------
    scenario : Scenario, str or path
        A loaded scenario, the name of a shipped one, or a file. The search starts at its values.
    vary : mapping, or sequence of "TARGET" or "TARGET=FORM"
        Parameters, element by element: ``controller.K_p``. The form is ``lin(a, b)`` or ``log(a, b)``, with a star for
        factors of the scenario's values. The default is ``*log(0.1, 10)``.
    cost : str or callable
        An expression of the signals as in a sweep, such as ``worst(rms(trajectory.q_d - plant.q))``, or a function of
        the results. If it has several elements, the cost is the mean of their ratios to the start, none of which may
        exceed 1.
    **options
        :class:`vdfmu.study.options.TuneOptions`.

    Returns
    -------
    Tuned

    Raises
    ------
    UsageError, ModelError
        Before the first run, for all faults.
    VdfmuError
        If the runs of the start fail, or nothing can be written.
    """
    method, budget, out = options["method"], options["evaluations"], options["out"]
    if method not in METHODS:
        raise UsageError(f"method: expected {', '.join(METHODS)}, got {method}.")
    for name, value in (("evaluations", budget), ("spread_points", options["spread_points"])):
        if value < 1:
            raise UsageError(f"{name}: expected at least 1, got {value}.")
    check_workers(options)
    import scipy

    problem = make_problem(scenario, vary, cost, **pick(ProblemOptions, options))
    plan = problem.plan
    plan.facts["search"] = {"method": method, "budget": budget, "scipy": scipy.__version__}
    folder = Path("results") / f"tune_{plan.facts['scenario']}" if out is None else Path(out)
    with Ledger(folder, plan.facts, plan.key, {}, options["overwrite"]) as ledger:
        with Evaluations(problem, ledger, options, lambda done: report("evaluations", done, budget)) as evaluations:
            before, after = search(evaluations, method, options["seed"])
        ledger.finish()
        loaded = prepare(scenario, **pick(ScenarioOptions, options))
        values = {**(options["parameters"] or {}), **problem.parameters(after.values)}
        groups = list(dict.fromkeys(name.partition("[")[0] for name in problem.names))
        tuned = Tuned(
            folder,
            {group: group_value(loaded, group, values) for group in groups},
            before, after, len(evaluations.scores),
            sum(score.failed for score in evaluations.scores), evaluations.missed,
            tuple(loops.margins() for score in (before, after) if (loops := problem.loops(score.values))),
            list(ledger.notes),
        )  # fmt: skip
        if before.failed:
            tuned.notes.append(f"{before.failed} of the runs with the scenario's values failed.")
        if options["margin"] == "same" and not problem.margin.all():
            tuned.notes.append("margin: a mode grows at the start, so 'same' requires that none grows faster.")
        loops = problem.loops(after.values)
        if not after.feasible:
            tuned.notes.append("no values within the limits and the margin were found; more evaluations may find some.")
        if loops is not None:
            growth = loops.growth(loops.poses[0].time, loops.poses[-1].time)
            limits = read_limits(loaded.limits, OF_SCENARIO)
            tuned.notes.extend(loop_sentences(Judged(loops, growth).figures, limits)[1])
        late = [] if loops is None else [pose.loop.later() for pose in loops.poses if pose.loop and pose.loop.sampled]
        if late:
            least, rate = min(loop.least for loop in late), max(loop.rate for loop in late)
            result = f"the modulus margin is {least:.2g}" if least else f"a mode grows by {rate:.2g} 1/s"
            tuned.notes.append(f"with one more sample of delay in all loops, as in most importers, {result}.")
        _write(tuned, evaluations.scores)
    return tuned


def _write(tuned: Tuned, scores: Sequence[Score]) -> None:
    """Write the values and the comparison."""
    sections: dict[str, dict[str, Any]] = {}
    for name, value in tuned.parameters.items():
        component, _, group = name.partition(".")
        sections.setdefault(component, {})[group] = value if isinstance(value, float) else value.tolist()
    rows = [dict(zip(("name", "before", "after"), row, strict=True)) for row in tuned.table()]
    content = {
        "values": sections, "comparison": rows, "evaluations": tuned.evaluations, "failed": tuned.failed,
        "missed_margin": tuned.missed, "notes": tuned.notes,
        "points": {
            "start": tuned.before.points, "chosen": tuned.after.points,
            "infeasible": [point for score in scores if not score.feasible for point in score.points],
        },
    }  # fmt: skip
    try:
        for name, text in (("tuned.toml", toml_text(sections)), (TUNED, json.dumps(content, indent=1) + "\n")):
            with replacing(tuned.folder / name) as file:
                file.write(text.encode())
    except OSError as error:
        raise VdfmuError(
            f"{tuned.folder}: cannot be written: {error.strerror or error}. All runs are kept: free space, and "
            f"repeat the command."
        ) from None
