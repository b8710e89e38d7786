"""A parameter study: its table, and the figures, indices and page made from it."""

from __future__ import annotations

import os
from pathlib import Path

from vdfmu.study.sweeps.indices import Indices, indices
from vdfmu.study.sweeps.page import write_page
from vdfmu.study.sweeps.plots import plot
from vdfmu.study.sweeps.table import StudyTable


class Sweep(StudyTable):
    """The results of a parameter study; columns are read from disk when they are needed.

    Parameters
    ----------
    path : path
        ``sweep.parquet``, or its folder. An incomplete study has its finished points.
    notes : sequence of str
        Remarks on the study.

    Raises
    ------
    UsageError
        If it cannot be read.

    Examples
    --------
    >>> sweep["controller.K_p"]        # values of an axis, (n,)
    >>> sweep["error[1]"]              # a measure, NaN where the run failed
    >>> sweep.failed                   # why points failed, by their number
    """

    def indices(self, measure: str | None = None) -> Indices:
        """Return Sobol or Morris indices of a measure, see `vdfmu.study.sweeps.indices.indices`."""
        return indices(self, measure)

    def plot(
        self, kind: str | None = None, measure: str | None = None, out: str | os.PathLike[str] | None = None
    ) -> list[Path]:
        """Draw figures of a measure, see `vdfmu.study.sweeps.plots.plot`; return their files.

        Kinds are scatter, surface, parallel, tornado and indices.
        """
        return plot(self, kind, measure, None if out is None else Path(out))

    def report(self, out: str | os.PathLike[str] | None = None, *, simulate: bool = True) -> Path:
        """Write a page of all points and measures, default ``report.html`` in the folder; return its path.

        With `simulate` it has a run of the scenario, if it can be run, and runs any point again.
        """
        return write_page(self, None if out is None else Path(out), simulate=simulate)
