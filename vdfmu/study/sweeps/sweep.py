"""`sweep`: runs of a system at many points, whatever happens in between."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Unpack

from vdfmu.base.errors import UsageError, VdfmuError
from vdfmu.base.interrupt import InterruptGuard
from vdfmu.base.once import one_job
from vdfmu.base.option import pick, with_options
from vdfmu.base.progress import report
from vdfmu.base.show_progress import with_progress
from vdfmu.study.options import PlanOptions, SweepOptions
from vdfmu.study.sweeps.chunks import Chunks
from vdfmu.study.sweeps.ledger import Ledger
from vdfmu.study.sweeps.local import check_workers, processors, run_here
from vdfmu.study.sweeps.plan import Plan, make_plan, name_of
from vdfmu.study.sweeps.study import Sweep
from vdfmu.study.sweeps.worker import KILLED


@with_progress
@one_job()
@with_options
def sweep(scenario: Any, vary: Mapping[str, Any] | Sequence[str] = (), **options: Unpack[SweepOptions]) -> Sweep:
    """Run a scenario or a system package at many points, and keep a row for each.

    Finished points are kept: after Ctrl-C, a kill or a full disk the same call continues where it stopped. A point that
    fails, crashes its process or hangs is a row with its reason.

    Parameters
    ----------
    scenario : Scenario, str or path
        Loaded, the name of a shipped one, a file, or a system package, ``.ssp``.
    vary : mapping, or sequence of "TARGET=FORM"
        What varies: ``component.parameter``, ``robot.parameter``, or ``robot``, ``master``, ``step``, ``stop`` and
        ``unit:COMPONENT``. Its form is ``lin(a, b)``, ``log(a, b)``, with the number of values as a third for a grid,
        ``normal(mean, deviation)``, ``lognormal(median, deviation of the logarithm)``, or values, ``"1, 2, 5"`` or a
        sequence. A star before it makes them factors of the scenario's values: ``*lin(0.9, 1.1)``.
    **options
        :class:`vdfmu.study.options.SweepOptions`; options of a run are the same for all points.

    Returns
    -------
    Sweep
        The table of points, which stays on disk.

    Raises
    ------
    UsageError, ModelError, SspError
        Before the first point, for all faults.
    VdfmuError
        The disk is full, or no worker can be started. Finished points are kept.
    KeyboardInterrupt
        After finished points are kept.
    """
    chunk = options["chunk"]
    if chunk is not None and not 1 <= chunk:
        raise UsageError(f"chunk: expected a number of points of at least 1, got {chunk}.")
    check_workers(options)
    plan = make_plan(scenario, vary, **pick(PlanOptions, options))
    study = run_plan(plan, default_folder(scenario) if options["out"] is None else Path(options["out"]), options)
    study.notes += study.undefined()
    return study


def run_plan(plan: Plan, folder: Path, options: SweepOptions) -> Sweep:
    """Run the points of a plan that the folder does not have yet; see :func:`sweep`."""
    chunk, time_limit, scheduler = options.get("chunk"), options["time_limit"], options.get("scheduler")
    job = plan.job.packed()
    with Ledger(folder, plan.facts, plan.key, plan.points, options["overwrite"]) as ledger:
        done = ledger.done(again="" if options.get("retry") else KILLED)
        finished, total = int(done.sum()), len(plan)
        missing = total - finished

        def advance(points: int) -> None:
            nonlocal finished
            finished += points
            report("points", finished, total)

        chunks = Chunks(done, plan.task, chunk, max(plan.job.together))
        report("points", finished, total)
        if scheduler is None:
            runs = run_here(job, chunks, min(options["workers"] or processors(), missing), time_limit, advance)
        else:
            from vdfmu.study.sweeps.cluster import run_there

            runs = run_there(job, chunks, scheduler, time_limit, advance)
        try:
            for rows in runs:
                ledger.add(rows)
                missing -= len(rows)
        finally:
            runs.close()
            with InterruptGuard():
                for rows in chunks.left:
                    ledger.add(rows)
        if missing:
            raise VdfmuError(f"{folder}: {missing} points are missing: give the same command again to run them.")
        return Sweep(ledger.finish(), notes=ledger.notes)


def default_folder(scenario: Any) -> Path:
    """Return ``results/sweep_NAME``."""
    return Path("results") / f"sweep_{name_of(scenario)}"
