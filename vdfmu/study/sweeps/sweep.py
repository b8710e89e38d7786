"""`sweep`: runs a system at many points and resumes after any interruption; indices and page."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any, Unpack

import numpy as np

from vdfmu.base.cache import one_job
from vdfmu.base.errors import UsageError
from vdfmu.base.extras import module_of_extra
from vdfmu.base.option import pick, with_options
from vdfmu.base.progress import report, with_progress
from vdfmu.study.options import PlanOptions, SweepOptions
from vdfmu.study.sweeps.answer import Answer, answer_of
from vdfmu.study.sweeps.kept import KeptAnswer
from vdfmu.study.sweeps.ledger import Ledger
from vdfmu.study.sweeps.plan import Plan, make_plan, name_of
from vdfmu.study.sweeps.study import Study, check_workers
from vdfmu.study.sweeps.table import StudyTable
from vdfmu.study.sweeps.worker import KILLED


class Sweep(StudyTable):
    """The results of a parameter study; columns are read from disk when they are needed.

    Parameters
    ----------
    path : path
        ``sweep.parquet`` or ``sweep.csv``, or its folder. An incomplete study has its finished points.
    notes : sequence of str
        Remarks on the study.
    plan : Plan, optional
        The plan of these points. With it the answer, and the page in the folder, are reused until something that
        determines them changes.

    Raises
    ------
    UsageError
        If it cannot be read.

    Examples
    --------
    >>> sweep["controller.K_p"]        # values of an axis, (n,)
    >>> sweep["error[1]"]              # a measure, NaN if the run failed
    >>> sweep.failed                   # why points failed, by their number
    """

    def __init__(self, path: str | os.PathLike[str], notes: Sequence[str] = (), plan: Plan | None = None) -> None:
        super().__init__(path, notes)
        self.unchanged = False
        """Whether `report` left the page unchanged, because it belongs to the same points, scenario and version."""
        self._kept = None if plan is None else KeptAnswer(self, plan)

    @cached_property
    def answer(self) -> Answer:
        """Return sentences on the best point, its margin, the ranking, the axis that matters most, and failures."""
        return (self._kept and self._kept.answer) or answer_of(self)

    def indices(self, measure: str | None = None) -> Any:
        """Return Sobol or Morris indices of a measure; see `vdfmu.extras.sensitivity.indices`."""
        return module_of_extra("sensitivities", "sensitivity", "indices").indices(self, measure)

    def report(self, out: str | os.PathLike[str] | None = None, *, simulate: bool = True, trust: bool = False) -> Path:
        """Write the page, by default ``report.html`` in the folder, and return its path.

        With `simulate` the page can run any point. For this the scenario is run with the code that it names, but only
        if you made the study, or with `trust`. A page of `sweep` in the folder is kept if it would be the same, see
        `unchanged`.
        """
        kept = self._kept if out is None and simulate else None
        self.unchanged = kept is not None and kept.has_page()
        if kept is not None and self.unchanged:
            return kept.page
        from vdfmu.study.sweeps.page import write_page  # takes long to import

        notes = len(self.notes)
        page = write_page(self, self.answer, None if out is None else Path(out), simulate=simulate, trust=trust)
        if kept is not None and (len(self.notes) == notes or self.facts["source"].endswith(".ssp")):
            # not if the scenario could not be run for the page: the next call may succeed
            kept.keep(self.answer)
        return page


@with_progress
@one_job()
@with_options
def sweep(scenario: Any, vary: Mapping[str, Any] | Sequence[str] = (), **options: Unpack[SweepOptions]) -> Sweep:
    """Run a scenario or a system package at many points, and keep a row for each.

    Finished points are kept: after Ctrl-C, a kill or a full disk the same call resumes. A point that fails, crashes its
    process or hangs becomes a row with the reason.

    Parameters
    ----------
    scenario : Scenario, str or path
        A loaded scenario, the name of a shipped one, a file, or a system package, ``.ssp``.
    vary : mapping, or sequence of "TARGET=FORM"
        Targets: ``component.parameter``, ``robot.parameter``, or ``robot``, ``algorithm``, ``step``, ``stop`` and
        ``unit:COMPONENT``. The form is ``lin(a, b)`` or ``log(a, b)``, for a grid with the number of values as third
        argument, ``normal(mean, deviation)``, ``lognormal(median, deviation of the logarithm)``, or values, ``"1, 2,
        5"`` or a sequence. A star before the form makes the values factors of the scenario's: ``*lin(0.9, 1.1)``.
    **options
        :class:`vdfmu.study.options.SweepOptions`; options of a run apply to all points.

    Returns
    -------
    Sweep
        The table of points, on disk.

    Raises
    ------
    UsageError, ModelError, SspError
        Before the first point, for all faults.
    VdfmuError
        The disk is full, or no worker can be started. Finished points are kept.
    KeyboardInterrupt
        After finished points are stored.
    """
    chunk = options["chunk"]
    if chunk is not None and not 1 <= chunk:
        raise UsageError(f"chunk: expected a number of points of at least 1, got {chunk}.")
    check_workers(options)
    plan = make_plan(scenario, vary, **pick(PlanOptions, options))
    folder = Path("results") / f"sweep_{name_of(scenario)}" if options["out"] is None else Path(options["out"])
    with Ledger(folder, plan.facts, plan.key, plan.points, options["overwrite"]) as ledger:
        done = ledger.done(again="" if options["retry"] else KILLED)
        finished, total = int(done.sum()), len(plan)

        def advance(points: int) -> None:
            nonlocal finished
            finished += points
            report("points", finished, total)

        advance(0)
        if finished < total:
            try:
                with Study(plan.job, ledger, options, total - finished, chunk) as study:
                    study.ask(np.flatnonzero(~done), plan.task, advance)
            except KeyboardInterrupt as error:
                error.add_note(f"Finished points are in {folder}: repeat the command to continue.")
                raise
        study_table = Sweep(ledger.finish(), ledger.notes, plan)
    study_table.notes += study_table.undefined()
    return study_table
