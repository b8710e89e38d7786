"""Results as tables: contents, differences, and the forms of pandas and xarray."""

from __future__ import annotations

import importlib
from html import escape
from typing import Any, NamedTuple

import numpy as np

from vdfmu.base.errors import UsageError
from vdfmu.engine.results.recorded import Recorded


class Listing(NamedTuple):
    """A table that shows itself, as text and as HTML in a notebook; `rows` has its contents."""

    title: str
    head: tuple[str, ...]
    rows: list[tuple[Any, ...]]
    notes: tuple[str, ...] = ()

    def __repr__(self) -> str:
        cells = [self.head, *(tuple(map(_cell, row)) for row in self.rows)]
        widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
        right = [bool(self.rows) and isinstance(value, float) for value in (self.rows or [self.head])[0]]
        lines = [
            "  ".join(
                cell.rjust(width) if end else cell.ljust(width)
                for cell, width, end in zip(row, widths, right, strict=True)
            ).rstrip()
            for row in cells
        ]
        return "\n".join([self.title, *lines, *self.notes])

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


def contents(results: Recorded) -> Listing:
    """Return the table of contents; see `Results.contents`."""
    rows: list[tuple[Any, ...]] = []
    copies = {signal.name for signal in results.signals if signal.of}
    for group, elements in results.groups.items():
        if copies.issuperset(elements.values()):
            continue
        columns = [results[name] for name in elements.values()]
        ends = (float(min(map(np.min, columns))), float(max(map(np.max, columns)))) if len(results) else ("", "")
        rows.append((group, _shape(results.shape_of(group)), _unit(results, group), *ends))
    about = results.summary.get("scenario") or results.summary.get("system")
    of = f" of {about}" if about else ""
    span = f" from {results.time[0]:g} to {results.time[-1]:g} s" if len(results) else ""
    title = f"Results{of}: {len(results.names) - len(copies)} signals, {len(results)} rows{span}"
    note = (f"{len(copies)} more copy one of these: inputs that have the values of an output.",) if copies else ()
    return Listing(title, ("signal", "shape", "unit", "least", "largest"), rows, note)


def compare(one: Recorded, other: Recorded) -> Listing:
    """Return the differences of two results; see `Results.compare`."""
    common = [name for name in one.names if other.kinds.get(name) == one.kinds[name]]
    if not common:
        raise UsageError("the results have no signals of the same names and kinds, so there is nothing to compare")
    begin, end = max(one.time[0], other.time[0]), min(one.time[-1], other.time[-1])
    rows_of_both = np.flatnonzero((one.time >= begin) & (one.time <= end))
    if not len(rows_of_both):
        raise UsageError(
            f"the results have no time in common: {one.time[0]:g} to {one.time[-1]:g} s, "
            f"{other.time[0]:g} to {other.time[-1]:g} s"
        )
    time = one.time[rows_of_both]
    same = np.array_equal(time, other.time)
    before = np.searchsorted(other.time, time, side="right") - 1
    found: dict[str, tuple[Any, ...]] = {}
    squares: dict[str, list[float]] = {}
    groups = {name: group for group, names in one.groups.items() for name in names.values()}
    for name in common:
        column, theirs = one[name][rows_of_both].astype(float), other[name].astype(float)
        if one.kinds[name] != "real":
            theirs = theirs[before]
        elif not same:
            theirs = np.interp(time, other.time, theirs)
        difference = np.abs(column - theirs)
        place = int(np.argmax(difference))
        largest, group = float(difference[place]), groups[name]
        squares.setdefault(group, []).append(float(np.mean(difference**2)))
        if group not in found or not largest <= found[group][2]:
            found[group] = (group, one.units[name], largest, 0.0, name, float(time[place]))
    rows = [
        (group, unit, largest, float(np.sqrt(np.mean(squares[group]))), name, at)
        for group, unit, largest, _, name, at in found.values()
    ]
    rows.sort(key=lambda row: (row[1], -row[2]))
    apart = [
        f"only in {whose}: {', '.join(names)}"
        for whose, names in (
            ("the first", [name for name in one.names if name not in common]),
            ("the other", [name for name in other.names if name not in common]),
        )
        if names
    ]
    title = f"Differences from {begin:g} to {end:g} s, {len(time)} rows"
    return Listing(title, ("signal", "unit", "largest", "RMS", "of", "at [s]"), rows, tuple(apart))


def _needed(package: str) -> Any:
    try:
        return importlib.import_module(package)
    except ImportError as error:
        raise UsageError(
            f"this needs the package {package}, which cannot be imported: {error}. Install it with "
            "'pip install vdfmu[notebook]'."
        ) from None


def to_pandas(results: Recorded) -> Any:
    """Return a DataFrame; see `Results.to_pandas`."""
    pandas = _needed("pandas")
    columns = {name: results[name] for name in results.names}
    frame = pandas.DataFrame(columns, index=pandas.Index(results.time, name="time"), copy=False)
    frame.attrs["units"] = results.units
    return frame


def to_xarray(results: Recorded) -> Any:
    """Return a Dataset; see `Results.to_xarray`."""
    xarray = _needed("xarray")
    dataset = xarray.Dataset(coords={"time": ("time", results.time, {"units": "s"})})
    for group in results.groups:
        shape = results.shape_of(group)
        for name in [group] if shape is not None else results.groups[group].values():
            dimensions = [f"{name}_{axis}" for axis in range(1, len(shape or ()) + 1)]
            unit = _unit(results, group) if shape is not None else results.units[name]
            values = xarray.Variable(["time", *dimensions], results[name], {"units": unit})
            indices = {d: np.arange(1, n + 1) for d, n in zip(dimensions, shape or (), strict=True)}
            dataset = dataset.assign({name: values}).assign_coords(indices)
    dataset.attrs.update({key: value for key, value in results.summary.items() if isinstance(value, str | float)})
    return dataset
