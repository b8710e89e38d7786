"""Results of a co-simulation: recorded signals, their files, tables and pictures."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping
from html import escape
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vdfmu.base.errors import UsageError
from vdfmu.base.extras import module_of_extra
from vdfmu.base.text import amount
from vdfmu.engine.results.formats import format_of
from vdfmu.engine.results.recorded import KINDS, TYPES, Recorded, Signal, group_of
from vdfmu.engine.results.verdict import SIGNS, headline_of, state_of

__all__ = ["KINDS", "TYPES", "Listing", "Recorded", "Results", "Signal", "group_of"]


class Listing(NamedTuple):
    """A table that is displayed as text, or as HTML in a notebook; `rows` has its contents."""

    title: str
    head: tuple[str, ...]
    rows: list[tuple[Any, ...]]
    notes: tuple[str, ...] = ()

    def __repr__(self) -> str:
        cells = [self.head, *(tuple(map(_cell, row)) for row in self.rows)]
        widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
        right = [bool(self.rows) and isinstance(value, float) for value in (self.rows or [self.head])[0]]
        form = "  ".join(f"{{:{'>' if end else '<'}{width}}}" for end, width in zip(right, widths, strict=True))
        return "\n".join([self.title, *(form.format(*row).rstrip() for row in cells), *self.notes])

    def to_html(self) -> str:
        """Return the table for a notebook."""
        head = "".join(f"<th>{escape(text)}</th>" for text in self.head)
        rows = "".join(
            "<tr>" + "".join(f"<td>{escape(_cell(value))}</td>" for value in row) + "</tr>" for row in self.rows
        )
        notes = "".join(f"<p>{escape(note)}</p>" for note in self.notes)
        table = f"<table><thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table>"
        return f"<p><strong>{escape(self.title)}</strong></p>{table}{notes}"

    _repr_html_ = to_html


def _cell(value: Any) -> str:
    return f"{value + 0.0:.4g}" if isinstance(value, float) else str(value)  # -0 is 0


def _shape(shape: tuple[int, ...] | None) -> str:
    return "" if shape == () else "apart" if shape is None else " x ".join(map(str, shape))


def _unit(results: Recorded, group: str) -> str:
    units = {name: results.units[name] for name in results.groups[group].values()}
    return ", ".join(dict.fromkeys(units.values()))


def _needed(package: str) -> Any:
    try:
        return importlib.import_module(package)
    except ImportError as error:
        raise UsageError(
            f"the package {package} cannot be imported: {error}. Install it with 'pip install vdfmu[notebook]'."
        ) from None


class Results(Recorded):
    """Recorded signals at the communication points.

    A row contains the outputs at its communication point, and for inputs the value that the unit used in the step that
    ended there (first row: as set during initialization).

    Parameters
    ----------
    time : (m,) array [s]
    signals : sequence of Signal
        In the order of tables and files.
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
        """Return the verdict's headline, the diagram of the system and the contents, as far as they exist."""
        headline, sign = headline_of(self.summary), SIGNS.get(state_of(self.summary), "")
        verdict = f"<p><strong>{sign} {escape(headline)}</strong></p>" if headline else ""
        return verdict + (self._draw(self) if self._draw is not None else "") + self.contents().to_html()

    def draw_by(self, draw: Callable[[Any], str]) -> None:
        """Set the function that draws the system that was run, as HTML for a notebook."""
        self._draw = draw

    def contents(self) -> Listing:
        """Return the contents as a table: groups with their shapes, units and extremes."""
        rows: list[tuple[Any, ...]] = []
        for group, elements in self.groups.items():
            columns = [self[name] for name in elements.values()]
            ends = (float(min(map(np.min, columns))), float(max(map(np.max, columns)))) if len(self) else ("", "")
            if len(self) and (named := self._named(group)):
                ends = tuple(named.get(int(end), str(end)) for end in ends)
            rows.append((group, _shape(self.shape_of(group)), _unit(self, group), *ends))
        about = self.summary.get("scenario") or self.summary.get("system")
        of = f" of {about}" if about else ""
        span = f" from {self.time[0]:g} to {self.time[-1]:g} s" if len(self) else ""
        title = f"Results{of}: {amount(len(self.names), 'signal')}, {amount(len(self), 'row')}{span}"
        return Listing(title, ("signal", "shape", "unit", "least", "largest"), rows)

    def _named(self, name: str) -> dict[int, str]:
        """Return the value names of an enumeration or a mode by value; empty for other signals."""
        return {value: text for text, value in self.summary.get("names", {}).get(name, {}).items()}

    def texts(self, name: str) -> NDArray[np.str_]:
        """Return the values of an enumeration or a mode by their names, (m,).

        UsageError for a signal whose values have no names.
        """
        named = self._named(name)
        if not named:
            raise UsageError(
                f"texts: {name} must be an enumeration or a mode, got a signal without names of its values."
            )
        return np.array([named.get(value, str(value)) for value in self[name].tolist()])

    def to_pandas(self) -> Any:
        """Return a DataFrame with a column for each signal and the time as index; ``attrs["units"]`` has the units.

        UsageError without pandas: ``pip install vdfmu[notebook]``.
        """
        pandas = _needed("pandas")
        columns = {name: self[name] for name in self.names}
        frame = pandas.DataFrame(columns, index=pandas.Index(self.time, name="time"), copy=False)
        frame.attrs["units"] = self.units
        return frame

    def to_xarray(self) -> Any:
        """Return a Dataset with a variable for each group, its unit as the attribute ``units``.

        The dimensions are ``time`` and, with indices from 1, ``plant.q_1``, or ``plant.R_O_1`` and ``plant.R_O_2``.
        UsageError without xarray: ``pip install vdfmu[notebook]``.
        """
        xarray = _needed("xarray")
        dataset = xarray.Dataset(coords={"time": ("time", self.time, {"units": "s"})})
        for group in self.groups:
            shape = self.shape_of(group)
            for name in [group] if shape is not None else self.groups[group].values():
                dimensions = [f"{name}_{axis}" for axis in range(1, len(shape or ()) + 1)]
                unit = _unit(self, group) if shape is not None else self.units[name]
                values = xarray.Variable(["time", *dimensions], self[name], {"units": unit})
                indices = {d: np.arange(1, n + 1) for d, n in zip(dimensions, shape or (), strict=True)}
                dataset = dataset.assign({name: values}).assign_coords(indices)
        dataset.attrs.update({key: value for key, value in self.summary.items() if isinstance(value, str | float)})
        return dataset

    def compare(self, other: Results) -> Listing:
        """Return the differences from other results over their common time by group, the largest of each unit first.

        Values of `other` are interpolated between its rows; integers and booleans are held. Raises UsageError if the
        results have no signals or time in common.
        """
        common = [name for name in self.names if other.kinds.get(name) == self.kinds[name]]
        if not common:
            raise UsageError("compare: expected results with signals of the same names and kinds.")
        begin, end = max(self.time[0], other.time[0]), min(self.time[-1], other.time[-1])
        rows_of_both = np.flatnonzero((self.time >= begin) & (self.time <= end))
        if not len(rows_of_both):
            times = (f"{t[0]:g} to {t[-1]:g} s" for t in (self.time, other.time))
            raise UsageError(f"compare: expected results that overlap in time, got {' and '.join(times)}.")
        time = self.time[rows_of_both]
        same = np.array_equal(time, other.time)
        before = np.searchsorted(other.time, time, side="right") - 1
        worst: dict[str, tuple[Any, ...]] = {}
        squares: dict[str, list[float]] = {}
        groups = {name: group for group, names in self.groups.items() for name in names.values()}
        for name in common:
            column, theirs = self[name][rows_of_both].astype(float), other[name].astype(float)
            if self.kinds[name] != "real":
                theirs = theirs[before]
            elif not same:
                theirs = np.interp(time, other.time, theirs)
            difference = np.abs(column - theirs)
            place = int(np.argmax(difference))
            largest, group = float(difference[place]), groups[name]
            squares.setdefault(group, []).append(float(np.mean(difference**2)))
            if group not in worst or not largest <= worst[group][1]:
                worst[group] = (self.units[name], largest, name, float(time[place]))
        rows = [
            (group, unit, largest, float(np.sqrt(np.mean(squares[group]))), name, at)
            for group, (unit, largest, name, at) in worst.items()
        ]
        rows.sort(key=lambda row: (row[1], -row[2]))
        both = (
            ("the first", [name for name in self.names if name not in common]),
            ("the other", [name for name in other.names if name not in common]),
        )
        apart = tuple(f"only in {whose}: {', '.join(names)}" for whose, names in both if names)
        title = f"Differences from {begin:g} to {end:g} s, {len(time)} rows"
        return Listing(title, ("signal", "unit", "largest", "RMS", "of", "at [s]"), rows, apart)

    def plot(self, *names: str, over: Mapping[str, Results] | None = None, path: str | Path | None = None) -> Any:
        """Draw signals over time, a panel for each group.

        Parameters
        ----------
        *names : str
            Signals or groups; by default as many as fit into a picture.
        over : mapping of str to Results, optional
            Other runs to draw over this run, by label.
        path : path, optional
            File to write: PNG, SVG or PDF by its suffix.

        Returns
        -------
        matplotlib.figure.Figure

        Raises
        ------
        UsageError
            For an unknown signal, or a file that cannot be written.
        """
        return module_of_extra("picture", "pictures", "plot").plot(self, names, over or {}, path)

    def write(self, path: str | Path) -> None:
        """Write a file of results in the format of its suffix, see ``--format``; CSV by default.

        The first line of CSV has the names, the second the units (``integer`` and ``boolean`` for these kinds), then
        there is a line for each communication point. Numbers have the shortest form that is read back to the same bits.
        The write is atomic. Parquet and MATLAB files have the same bits in a third of the space, the units and the
        summary; see their modules.

        UsageError if a package is missing, ``pip install vdfmu[parquet]``; VdfmuError if the file cannot be written.
        """
        format_of(Path(path)).write(self, Path(path))

    @classmethod
    def read(cls, path: str | Path) -> Results:
        """Read a file of `write` or a run.

        Files contain their summary, except that the summary of CSV is the ``summary.json`` next to it. UsageError if
        the file or a package is missing, or if the file has another form.
        """
        recorded = format_of(Path(path)).read(Path(path))
        return cls(recorded.time, recorded.signals, recorded.data, recorded.summary)
