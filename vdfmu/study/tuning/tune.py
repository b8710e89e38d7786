"""`tune`: search, and what it leaves: values for a scenario, the table of all runs, a comparison and a picture."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from vdfmu.base.errors import UsageError, VdfmuError
from vdfmu.base.files import replacing
from vdfmu.base.once import one_job
from vdfmu.base.progress import doing, report
from vdfmu.base.show_progress import Shown, with_progress
from vdfmu.engine.plan.inputs import Inputs
from vdfmu.study.run.scenario_run import prepare
from vdfmu.study.sweeps.ledger import Ledger
from vdfmu.study.sweeps.local import processors
from vdfmu.study.tuning.evaluate import Evaluations, Score
from vdfmu.study.tuning.problem import make_problem
from vdfmu.study.tuning.search import METHODS, objective, search
from vdfmu.system.scenario.values import group_value


@dataclass(frozen=True)
class Tuned:
    """What a search found."""

    folder: Path
    """It has ``tuned.toml``, sections for a scenario; ``tune.json``, the comparison; ``sweep.parquet``, all runs; and
    ``tuning.png``."""
    settings: dict[str, Any]
    """The values, as `vdfmu.run` takes them."""
    before: Score
    """Of the scenario's values."""
    after: Score
    """Of the best."""
    evaluations: int
    """Values that were run."""
    failed: int
    missed: int
    """Values that were not run, since they miss the margin."""
    notes: list[str] = field(default_factory=list)

    def table(self) -> list[tuple[str, float, float]]:
        """Rows of name, before, after: cost, measures, margins of each joint with one sample of delay."""
        rows: list[tuple[str, float, float]] = []
        names = (
            [f"cost[{i}]" for i in range(1, len(self.after.cost) + 1)]
            if len(self.after.cost) > 1
            else ["cost"]
        )
        rows += list(zip(names, self.before.cost.tolist(), self.after.cost.tolist(), strict=True))
        rows += [
            (name, self.before.measures.get(name, math.nan), value)
            for name, value in self.after.measures.items()
        ]
        if self.before.margins is not None and self.after.margins is not None:
            for name in ("modulus", "gain", "phase", "delay"):
                pair = (
                    getattr(margins, name).tolist() for margins in (self.before.margins, self.after.margins)
                )
                rows += [(f"{name}[{i}]", *both) for i, both in enumerate(zip(*pair, strict=True), 1)]
            rows.append(("radius", self.before.margins.radius, self.after.margins.radius))
        return rows


@with_progress
@one_job()
def tune(
    scenario: Any,
    vary: Mapping[str, Any] | Sequence[str],
    cost: str,
    *,
    limit: Sequence[str] = (),
    spread: Mapping[str, Any] | Sequence[str] = (),
    spread_n: int = 8,
    over: str = "mean",
    margin: float | str | None = None,
    growth: float = 0.0,
    method: str = "both",
    budget: int = 300,
    seed: int = 0,
    settings: Mapping[str, Any] | None = None,
    robot: Any = None,
    units: Mapping[str, Any] | None = None,
    step: float | None = None,
    stop: float | None = None,
    master: str | None = None,
    inputs: Inputs = None,
    input_hold: bool | None = None,
    backend: str | None = None,
    engine: str = "fmu",
    workers: int | None = None,
    time_limit: float | None = None,
    out: str | os.PathLike[str] | None = None,
    overwrite: bool = False,
    progress: Shown = None,
) -> Tuned:
    """Search the values of parameters that make a cost smallest, over a spread of robots and within limits.

    Every run is kept: after Ctrl-C or a kill the same call goes on where it was; so does one with a larger budget or
    another method, which takes the runs that it needs and finds.

    Parameters
    ----------
    scenario : Scenario, str or path
        Loaded, the name of a shipped one, or a file. Its values are where the search begins.
    vary : mapping, or sequence of "TARGET" or "TARGET=FORM"
        What varies, element by element: ``controller.K_p``. Its form is ``lin(a, b)`` or ``log(a, b)``; after a star
        factors of the scenario's values. Default ``*log(0.1, 10)``.
    cost : str
        An expression of the signals as of a sweep, such as ``worst(rms(trajectory.q_d - plant.q))``. Of one with
        several elements, the mean of their ratios to those of the start counts, and none may exceed 1.
    limit : sequence of str
        Such as ``worst(peak(controller.tau)) < 2.5``, for every robot.
    spread : mapping, or sequence of "TARGET=FORM"
        What is uncertain, as the axes of a sweep: ``plant.mass[3]=*normal(1, 0.1)``.
    spread_n : int
        Number of robots, a Latin hypercube of the spread.
    over : "mean" or "worst"
        What counts of the robots' costs.
    margin : float or "same", optional
        Modulus margin, min abs(1 + L), that every joint's loop of the nominal robot has at least along the motion,
        with one sample of delay; or that which it has at the start.
    growth : float [1/s]
        Rate up to which what grows counts as stable for the margin, see :class:`vdfmu.study.analysis.margins.ArmLoops`.
    method : "both", "global" or "local"
        Differential evolution over the whole range, then COBYQA from the best, or one of them.
    budget : int
        Evaluations: values that are run with all robots.
    seed : int
        Of the robots and of the search.
    settings, robot, units, step, stop, master, inputs, input_hold, backend
        See :func:`vdfmu.run`.
    engine : {"fmu", "batch"}
        See :func:`vdfmu.sweep`; ``batch`` runs the robots of several values side by side.
    workers : int, optional
        Processes; default one a processor.
    time_limit : float [s], optional
        Time that a run has; default 600.
    out : path, optional
        Folder; default ``results/tune_NAME``.
    overwrite : bool
        Whether to replace another search in it.
    progress : callable or bool, optional
        Called with stage, done, total; True shows bars, on the terminal or in the notebook.

    Returns
    -------
    Tuned

    Raises
    ------
    UsageError, ModelError
        Before the first run, for what is wrong.
    VdfmuError
        If the runs of the start fail, or nothing can be written.
    """
    if method not in METHODS:
        raise UsageError(f"method: expected {', '.join(METHODS)}, got {method}.")
    for name, value in (("budget", budget), ("spread_n", spread_n), ("workers", workers)):
        if value is not None and value < 1:
            raise UsageError(f"{name}: expected at least 1, got {value}.")
    if time_limit is not None and not time_limit > 0.0:
        raise UsageError(f"time_limit: expected a positive time, got {time_limit:g} s.")
    if not math.isfinite(growth):
        raise UsageError(f"growth: expected a finite rate, got {growth:g} 1/s.")
    import scipy

    given: dict[str, Any] = {
        "robot": robot, "units": units, "step": step, "stop": stop, "master": master, "inputs": inputs,
        "input_hold": input_hold,
    }  # fmt: skip
    options: dict[str, Any] = {name: value for name, value in given.items() if value is not None}
    problem = make_problem(
        scenario, vary, cost, limit=limit, spread=spread, spread_n=spread_n, over=over, margin=margin,
        growth=growth, seed=seed,
        settings=settings, options=options, backend=backend, engine=engine,
    )  # fmt: skip
    plan = problem.plan
    plan.facts["search"] = {"method": method, "budget": budget, "scipy": scipy.__version__}
    folder = Path("results") / f"tune_{plan.facts['scenario']}" if out is None else Path(out)
    with Ledger(folder, plan.facts, plan.key, {}, overwrite) as ledger:
        known = ledger.reopen()
        with Evaluations(
            problem, ledger, known, min(workers or processors(), max(problem.robots, 2)), budget, time_limit,
            lambda done: report("evaluations", done, budget),
        ) as evaluations:  # fmt: skip
            before, after = search(evaluations, method, seed)
        ledger.finish()
        loaded = prepare(scenario, **options, settings=settings)
        tuned = {**(settings or {}), **dict(zip(problem.names, after.values.tolist(), strict=True))}
        groups = list(dict.fromkeys(name.partition("[")[0] for name in problem.names))
        found = Tuned(
            folder,
            {group: group_value(loaded, group, tuned) for group in groups},
            before, after, len(evaluations.scores),
            sum(score.failed for score in evaluations.scores), evaluations.missed, list(ledger.notes),
        )  # fmt: skip
        if before.failed:
            found.notes.append(f"{before.failed} of the runs with the scenario's own values failed.")
        if margin == "same" and not problem.margin.all():
            found.notes.append(
                "margin: with one sample of delay the loop of the start is unstable, so that same asks for stability "
                "only; growth lets slow instability count as stable."
            )
        if not after.feasible:
            found.notes.append(
                "no values within the limits and the margin were found; a larger budget may find some."
            )
        with doing("picture"):
            _write(found, evaluations.scores)
    return found


def _write(found: Tuned, scores: Sequence[Score]) -> None:
    """Write the values, the comparison and the picture."""
    from vdfmu.base.style import save
    from vdfmu.study.report.tuning import draw_tuning

    sections: dict[str, dict[str, Any]] = {}
    for name, value in found.settings.items():
        component, _, group = name.partition(".")
        sections.setdefault(component, {})[group] = value if isinstance(value, float) else value.tolist()
    lines = [
        line
        for component, values in sections.items()
        for line in (
            f"[{component}]",
            *(f"{group} = {json.dumps(value)}" for group, value in values.items()),
            "",
        )
    ]
    rows = [dict(zip(("name", "before", "after"), row, strict=True)) for row in found.table()]
    content = {
        "values": sections, "comparison": rows, "evaluations": found.evaluations, "failed": found.failed,
        "missed_margin": found.missed, "notes": found.notes,
    }  # fmt: skip
    start = scores[0]
    history = [objective(score, start) for score in scores]
    try:
        for name, text in (
            ("tuned.toml", "\n".join(lines)),
            ("tune.json", json.dumps(content, indent=1) + "\n"),
        ):
            with replacing(found.folder / name) as file:
                file.write(text.encode())
        save(draw_tuning(history, found.table()), found.folder / "tuning.png")
    except OSError as error:
        raise VdfmuError(
            f"{found.folder}: cannot be written: {error.strerror or error}. All runs are kept: free space, and give "
            "the same command again."
        ) from None
