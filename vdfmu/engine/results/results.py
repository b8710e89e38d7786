"""Results of a co-simulation: signals, their files, tables and pictures."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from vdfmu.engine.results.formats import format_of
from vdfmu.engine.results.frames import Listing, compare, contents, to_pandas, to_xarray
from vdfmu.engine.results.recorded import Recorded


class Results(Recorded):
    """Recorded signals on the communication points.

    A row holds the outputs at its communication point; an input has the value that its unit used in the step
    that ended there (first row: as set during initialization).

    Parameters
    ----------
    time : (m,) array [s]
    signals : sequence of Signal
        In the order in which they are shown and written.
    data : mapping of str to (m, columns) array
        Columns by kind: ``real`` float64, ``integer`` and ``boolean`` int32.
    summary : dict, optional
        Facts about the run.
    messages : sequence, optional
        The messages of the units (`vdfmu.engine.run.LogMessage`).

    Examples
    --------
    >>> results["plant.q[1]"]            # one signal, (m,)
    >>> results["plant.q"]               # plant.q[1] ... plant.q[n], (m, n)
    >>> results["plant.R_O"]             # plant.R_O[1,1] ... plant.R_O[3,3], (m, 3, 3)
    >>> results.to_pandas()              # or to_xarray()
    >>> results.plot("plant.q", over={"soft": other})
    """

    def __repr__(self) -> str:
        return repr(self.contents())

    def _repr_html_(self) -> str:
        return self.contents().to_html()

    def contents(self) -> Listing:
        """Return what is there, as a table that shows itself: groups, their shapes, units and extremes."""
        return contents(self)

    def to_pandas(self) -> Any:
        """Return a DataFrame with a column for each signal and the time as index; ``attrs["units"]`` has the units.

        Raises
        ------
        UsageError
            pandas is not installed, ``pip install vdfmu[notebook]``.
        """
        return to_pandas(self)

    def to_xarray(self) -> Any:
        """Return a Dataset with a variable for each group, its unit as the attribute ``units``.

        The dimensions are ``time`` and, with indices from 1, ``plant.q_1``, or ``plant.R_O_1`` and ``plant.R_O_2``.

        Raises
        ------
        UsageError
            xarray is not installed, ``pip install vdfmu[notebook]``.
        """
        return to_xarray(self)

    def compare(self, other: Results) -> Listing:
        """Return the differences to other results, group by group, the largest in its unit first.

        Values of `other` between its rows are interpolated; integers and booleans hold. Only the time common to both
        counts.

        Raises
        ------
        UsageError
            They have no time or no signals in common.
        """
        return compare(self, other)

    def plot(self, *names: str, over: Mapping[str, Results] | None = None, path: str | Path | None = None) -> Any:
        """Draw signals over time, a panel for each group.

        Parameters
        ----------
        *names : str
            Signals or groups; default as many of all as a picture holds.
        over : mapping of str to Results, optional
            Other runs to draw over this one, by what they are called.
        path : path, optional
            File to write: PNG, SVG or PDF by its suffix.

        Returns
        -------
        matplotlib.figure.Figure

        Raises
        ------
        UsageError
            There is no such signal, or the file cannot be written.
        """
        from vdfmu.engine.results.picture import plot  # takes long to import

        return plot(self, names, over or {}, path)

    def write(self, path: str | Path) -> None:
        """Write a file of results in the format of its suffix: Parquet of ``.parquet``, else CSV.

        The first line of CSV has the names, the second the units (``integer`` and ``boolean`` for these kinds), then
        follows a line a communication point. Numbers have the shortest form that reads back to the same bits. The file
        appears under its name only when it is complete. A Parquet file has the same bits in a third of the room, the
        units and the summary as metadata, and no signal that copies another; see `vdfmu.engine.results.parquet`.

        Raises
        ------
        UsageError
            Parquet needs the package pyarrow, ``pip install vdfmu[parquet]``.
        VdfmuError
            The file cannot be written.
        """
        format_of(Path(path)).write(self, Path(path))

    @classmethod
    def read(cls, path: str | Path) -> Results:
        """Read what `write` or a run wrote, with the copies of signals in the file.

        A Parquet file has its summary too; the summary of a CSV file is the ``summary.json`` next to it.

        Raises
        ------
        UsageError
            The file is missing or of another form, or pyarrow is.
        """
        found = format_of(Path(path)).read(Path(path))
        return cls(found.time, found.signals, found.data, found.summary)
