"""`sweep`: runs of a system at many points, whatever happens in between."""

from __future__ import annotations

import os
import pickle
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from vdfmu.base.errors import UsageError, VdfmuError
from vdfmu.base.interrupt import InterruptGuard
from vdfmu.base.once import one_job
from vdfmu.base.progress import report
from vdfmu.base.show_progress import Shown, with_progress
from vdfmu.engine.plan.inputs import Inputs
from vdfmu.study.sweeps.chunks import Chunks
from vdfmu.study.sweeps.job import Job
from vdfmu.study.sweeps.ledger import Ledger
from vdfmu.study.sweeps.local import processors, run_here
from vdfmu.study.sweeps.plan import make_plan, name_of
from vdfmu.study.sweeps.study import Sweep
from vdfmu.study.sweeps.worker import KILLED


@with_progress
@one_job()
def sweep(
    scenario: Any,
    over: Mapping[str, Any] | Sequence[str] = (),
    *,
    sample: str | os.PathLike[str] = "grid",
    n: int | None = None,
    seed: int = 0,
    measure: Mapping[str, Any] | Sequence[str] | None = None,
    keep: Sequence[str] = (),
    settings: Mapping[str, Any] | None = None,
    robot: Any = None,
    units: Mapping[str, Any] | None = None,
    step: float | None = None,
    stop: float | None = None,
    master: str | None = None,
    adaptive: float | None = None,
    inputs: Inputs = None,
    input_hold: bool | None = None,
    backend: str | None = None,
    engine: str | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
    chunk: int | None = None,
    time_limit: float | None = None,
    out: str | os.PathLike[str] | None = None,
    overwrite: bool = False,
    retry: bool = False,
    progress: Shown = None,
) -> Sweep:
    """Run a scenario or a system package at many points, and keep a row for each.

    What was done stays done: after Ctrl-C, a kill or a full disk the same call goes on where it was. A point that
    fails, crashes its process or hangs is a row with its reason.

    Parameters
    ----------
    scenario : Scenario, str or path
        Loaded, the name of a shipped one, a file, or a system package, ``.ssp``.
    over : mapping, or sequence of "TARGET=FORM"
        What varies: ``component.parameter``, ``robot.parameter``, or ``robot``, ``master``, ``step``, ``stop`` and
        ``unit:COMPONENT``. Its form is ``lin(a, b)``, ``log(a, b)``, with the number of values as a third for a grid,
        ``normal(mean, deviation)``, ``lognormal(median, deviation of the logarithm)``, or values, ``"1, 2, 5"`` or a
        sequence. A star before it makes them factors of the scenario's values: ``*lin(0.9, 1.1)``.
    sample : {"grid", "lhs", "sobol", "random", "saltelli", "morris"} or path
        How the axes' values are combined; see :func:`vdfmu.study.sweeps.points.draw`. A CSV file has them all.
    n : int, optional
        Number of points, but of a grid or file; of ``saltelli`` and ``morris`` that of base points or trajectories.
    seed : int
        Of what is drawn.
    measure : mapping of str to str or callable, or sequence of "NAME=EXPRESSION", optional
        What is kept of a run: ``rms(trajectory.q_d - plant.q)``, see :mod:`vdfmu.study.sweeps.measures`, or a
        function of the :class:`vdfmu.Results`. Default for the loop of trajectory, controller and plant: RMS and peak
        position error and peak torque of each joint.
    keep : sequence of str
        Signals to keep whole, such as ``plant.q[*]``: a list a point.
    settings, robot, units, step, stop, master, adaptive, inputs, input_hold, backend
        The same for all points; see :func:`vdfmu.run`.
    engine : {"fmu", "batch"}, optional
        What runs the points: the FMUs, or one program of all units that steps several points at once. Default the
        program, where all units are ours and there are points enough, see :mod:`vdfmu.study.batch`.
    workers : int, optional
        Processes; default one a processor.
    scheduler : str, optional
        Address of a Dask scheduler, whose workers are taken instead.
    chunk : int, optional
        Points that a worker takes at a time, and a file has; default as many as take some seconds, at most 50, or 56
        that are run side by side.
    time_limit : float [s], optional
        Time that a point has; default 600.
    out : path, optional
        Folder; default ``results/sweep_NAME``.
    overwrite : bool
        Whether to replace another study in it.
    retry : bool
        Whether points that failed are run again.
    progress : callable or bool, optional
        Called with stage, done, total; True shows bars, on the terminal or in the notebook.

    Returns
    -------
    Sweep
        The table of points, which stays on disk.

    Raises
    ------
    UsageError, ModelError, SspError
        Before the first point, for what is wrong.
    VdfmuError
        The disk is full, or no worker can be started. What was done is kept.
    KeyboardInterrupt
        After what was done is kept.
    """
    if chunk is not None and not 1 <= chunk:
        raise UsageError(f"chunk: expected a number of points of at least 1, got {chunk}.")
    workers = processors() if workers is None else workers
    if workers < 1:
        raise UsageError(f"workers: expected at least 1, got {workers}.")
    if time_limit is not None and not time_limit > 0.0:
        raise UsageError(f"time_limit: expected a positive time, got {time_limit:g} s.")
    options = {
        "robot": robot, "units": units, "step": step, "stop": stop, "master": master, "adaptive": adaptive,
        "inputs": inputs, "input_hold": input_hold,
    }  # fmt: skip
    plan = make_plan(
        scenario, over, sample=os.fspath(sample), n=n, seed=seed, measure=measure, keep=keep, settings=settings,
        options={name: value for name, value in options.items() if value is not None}, backend=backend,
        engine=engine,
    )  # fmt: skip
    folder = default_folder(scenario) if out is None else Path(out)
    job = packed(plan.job)
    with Ledger(folder, plan.facts, plan.key, plan.points, overwrite) as ledger:
        done = ledger.done(again="" if retry else KILLED)
        finished, total = int(done.sum()), len(plan)
        missing = total - finished

        def advance(points: int) -> None:
            nonlocal finished
            finished += points
            report("points", finished, total)

        chunks = Chunks(done, plan.task, chunk, max(plan.job.together))
        report("points", finished, total)
        if scheduler is None:
            runs = run_here(job, chunks, min(workers, total - finished), time_limit, advance)
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
            raise VdfmuError(
                f"{folder}: {missing} points are missing: give the same command again to run them."
            )
        return Sweep(ledger.finish(), notes=ledger.notes)


def default_folder(scenario: Any) -> Path:
    """Return ``results/sweep_NAME``."""
    return Path("results") / f"sweep_{name_of(scenario)}"


def packed(job: Job) -> bytes:
    """Return a job as a worker gets it; functions of a script go with their text.

    Raises
    ------
    UsageError
        If a function among the measures cannot be sent to another process.
    """
    functions = [m.function for m in job.measures if m.function is not None]
    if not functions:
        return pickle.dumps(job)
    try:
        import cloudpickle

        return cloudpickle.dumps(job)
    except ImportError:
        raise UsageError(
            "measure: a function is sent to the workers by cloudpickle, which is not installed: "
            "pip install 'vdfmu[sweep]', or write it as an expression."
        ) from None
    except (TypeError, pickle.PicklingError) as error:
        raise UsageError(f"measure: a function cannot be sent to another process: {error}.") from None
