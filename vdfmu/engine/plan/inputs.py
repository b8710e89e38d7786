"""Signals from outside for inputs that nothing is connected to: read from CSV files or given as arrays."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np

from vdfmu.base.arrays import Floats, element_name
from vdfmu.base.csv_file import CsvColumns, read_columns, repeated
from vdfmu.base.errors import UsageError

_CLOSE = 1e-12
"""Rounding of a time and of a row's time, relative to the largest time."""
_STRAIGHT = 1e-9
"""Rounding of slopes, relative to the largest: no bend."""


@dataclass(frozen=True, eq=False)
class InputTable:
    """Signals of one file, or one array: their targets, and their values at times."""

    where: str
    """The file, or the name of the array, for messages."""
    names: tuple[str, ...]
    """``component.variable`` of each column."""
    units: tuple[str, ...]
    """Unit of measurement of each; empty for the input's unit."""
    t: Floats
    """(m,) [s], increasing."""
    values: Floats
    """(m, n)."""
    held: bool
    """Whether a value holds until the next row; else it is interpolated linearly."""
    chosen: bool = True
    """Whether every column must name an input; of a results file other columns are ignored."""
    group: str = ""
    """Input whose elements are the columns, all of them; empty for columns of a file."""

    @property
    def digest(self) -> str:
        """Digest of all that decides a run: names, units, times, values, interpolation."""
        head = repr((self.names, self.units, self.values.shape, self.held, self.chosen)).encode()
        return sha256(head + self.t.tobytes() + self.values.tobytes()).hexdigest()[:16]


Inputs = str | os.PathLike[str] | Sequence[str | os.PathLike[str] | InputTable] | Mapping[str, tuple[Any, Any]] | None
"""A CSV file, several of them, or signal to its times and values."""


class Course:
    """Columns (m, n) of a table over times (m,) [s]; before the first row and after the last its values hold."""

    def __init__(self, t: Floats, values: Floats, held: bool) -> None:
        self.held, self.t, self.values = held, t, values
        self.tolerance = _CLOSE * float(np.abs(t).max())
        """Difference [s] within which a time counts as a row's."""
        change, least = np.diff(values, axis=0), 0.0
        if not held:
            slope = change / np.diff(t)[:, None]
            change = np.diff(slope, axis=0, prepend=0.0, append=0.0)
            least = _STRAIGHT * np.abs(slope).max(0, initial=0.0)
        self.breaks: Floats = t[len(t) - len(change) :][np.any(np.abs(change) > least, axis=1)]
        """Times [s] at which a value jumps or a line bends."""

    def at(self, time: float) -> Floats:
        """Return the values (n,) at a time."""
        t, values = self.t, self.values
        i = int(t.searchsorted(time + self.tolerance, "right")) - 1
        if i < 0:
            return values[0]
        if self.held or i == len(t) - 1:
            return values[i]
        part = max((time - t[i]) / (t[i + 1] - t[i]), 0.0)
        return values[i] + part * (values[i + 1] - values[i])


def read_inputs(inputs: Inputs, hold: bool = False) -> tuple[InputTable, ...]:
    """Read signals for inputs.

    The first column of a CSV file is the time in seconds. Other columns have the names of inputs, and a unit in
    brackets is checked: ``time,plant.F_e[1] [N]``. A second line of units, as in ``results.csv``, does the same, and
    columns of such a file that name no free input are ignored.

    A mapping has times (m,) [s], and values (m,) of ``component.variable``, or (m, n) of ``component.variable[1]`` to
    ``[n]``. With `hold`, real values hold until the next row; other values always do. UsageError for files or arrays in
    another form, with every problem and its row.
    """
    problems: list[str] = []
    tables: list[InputTable | None] = []
    if isinstance(inputs, Mapping):
        tables += [_from_arrays(name, pair, hold, problems) for name, pair in inputs.items()]
    else:
        several: Any = () if inputs is None else inputs
        several = [*several] if isinstance(several, Iterable) and not isinstance(several, str) else [several]
        for each in several:
            if not isinstance(each, (str, os.PathLike, InputTable)):
                expected = "expected a path, several, or a mapping of signals to arrays"
                raise UsageError(f"inputs: {expected}, got {each!r:.60}.")
            tables.append(each if isinstance(each, InputTable) else _from_csv(Path(each), hold, problems))
    if problems:
        raise UsageError("\n".join(problems))
    return tuple(table for table in tables if table is not None)


def _from_arrays(name: str, pair: tuple[Any, Any], hold: bool, problems: list[str]) -> InputTable | None:
    where = f"inputs[{name!r}]"
    try:
        t, values = (np.array(each, np.float64) for each in pair)
    except (TypeError, ValueError):
        problems.append(f"{where}: expected a pair of arrays of numbers, times and values")
        return None
    if t.ndim != 1 or not t.size or values.shape[:1] != t.shape:
        problems.append(f"{where}: expected times (m,) and values (m,) or (m, n), got {t.shape} and {values.shape}")
        return None
    names = [element_name(name, index) for index in np.ndindex(values.shape[1:])]
    columns = values.reshape(len(t), -1)
    _check_rows(where, lambda i: f"element {i}", names, t, columns, problems)
    return InputTable(where, tuple(names), ("",) * len(names), t, columns, hold, group=name)


def csv_columns(path: Path, problems: list[str], *, timed: bool = True) -> CsvColumns | None:
    """Read a CSV file of named columns of numbers with increasing ``time``, the first column if `timed`.

    Units are in brackets or in a second row, as in ``results.csv``. Faults of rows are added to `problems`, and rows
    that cannot be read are left out. None for a file in another form.
    """
    try:
        columns = read_columns(path)
    except UsageError as error:
        problems.append(str(error))
        return None
    names, units = columns.file.names, columns.file.units
    fault = ""
    if timed and (names[:1] != ["time"] or units[:1] not in ([""], ["s"])):
        got = repr(columns.file.headings[0].strip()) if names else "an empty file"
        fault = f"row 1: expected 'time' as the first column, in s, got {got}"
    elif (timed and len(names) == 1) or not all(names):
        fault = "row 1: expected an input in each column, such as 'plant.F_e[1] [N]'"
    elif twice := repeated(names):
        fault = f"row 1: {', '.join(twice)}: more than one column has this name"
    elif len(units) != len(names):
        fault = f"row 2: expected {len(names)} units of measurement, got {len(units)}"
    elif not columns.lines.size and not columns.faults:
        fault = "expected rows of numbers below the names, got none"
    if fault:
        problems.append(f"{path}: {fault}")
        return None
    problems += [f"{path}: {text}" for text in columns.faults]
    table, numbers = columns.values, columns.lines
    t = table[:, names.index("time")] if "time" in names else np.arange(float(len(table)))
    signals = [i for i, name in enumerate(names) if name != "time"]
    _check_rows(str(path), lambda i: f"row {numbers[i]}", [names[i] for i in signals], t, table[:, signals], problems)
    return columns


def _from_csv(path: Path, hold: bool, problems: list[str]) -> InputTable | None:
    before = len(problems)
    columns = csv_columns(path, problems)
    if columns is None or len(problems) > before:
        return None
    names, table, results = columns.file.names[1:], columns.values, bool(columns.file.unit_row)
    units = ["" if unit in ("integer", "boolean") else unit for unit in columns.file.units[1:]]
    return InputTable(str(path), tuple(names), tuple(units), table[:, 0].copy(), table[:, 1:], hold, not results)


def _check_rows(
    where: str, row: Callable[[int], str], names: Sequence[str], t: Floats, values: Floats, problems: list[str]
) -> None:
    """Note the first row of each column that is not finite, and the first with a time that does not increase."""
    for name, column in zip(("time", *names), (t, *values.T), strict=True):
        bad = np.flatnonzero(~np.isfinite(column))
        if bad.size:
            problems.append(f"{where}: {row(bad[0])}: {name}: expected a finite number, got {column[bad[0]]}")
    late = np.flatnonzero(np.diff(t) <= 0.0)
    if late.size:
        i = int(late[0])
        problems.append(
            f"{where}: {row(i + 1)}: time: expected more than the {t[i]:g} s of the row before, got {t[i + 1]:g} s"
        )


def outside(tables: Sequence[InputTable], begin: float, end: float) -> list[str]:
    """Return a note for each table that does not reach over a run from `begin` to `end` [s]."""
    slack = _CLOSE * max(abs(begin), abs(end), math.ulp(0.0))
    return [
        f"{table.where}: its times are {table.t[0]:g} to {table.t[-1]:g} s, the run's are {begin:g} to {end:g} s; "
        "before the first row and after the last its values hold"
        for table in tables
        if table.t[0] > begin + slack or table.t[-1] < end - slack
    ]
