"""External signals for unconnected inputs: read from CSV files or arrays, checked, connected."""

from __future__ import annotations

import dataclasses
import math
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from vdfmu.base.arrays import Floats, element_name
from vdfmu.base.csv_file import CsvColumns, read_columns, repeated
from vdfmu.base.errors import UsageError
from vdfmu.base.measure import BASE_UNITS, coherent, measure
from vdfmu.base.text import close_to
from vdfmu.engine.fmu.description import Description
from vdfmu.engine.fmu.variables import FmuVariable
from vdfmu.engine.package.system import UnitFactor
from vdfmu.engine.plan.conversion import SOURCE, Conversion, Link, Port, between

_CLOSE = 1e-12
"""Largest difference between a time and the time of its row that is rounding, relative to the largest time."""
_STRAIGHT = 1e-9
"""Largest change of a slope that is rounding and not a bend, relative to the largest slope."""


@dataclass(frozen=True, eq=False)
class InputTable:
    """Signals from one file or array: the inputs that they feed, and their values over time."""

    where: str
    """The file, or the name of the array, for messages."""
    names: tuple[str, ...]
    """``component.variable`` of each column."""
    units: tuple[str, ...]
    """Unit of measurement of each column; empty for the input's unit."""
    t: Floats
    """Increasing times (m,) [s]."""
    values: Floats
    """(m, n)."""
    held: bool
    """Whether a value is held until the next row instead of being interpolated linearly."""
    chosen: bool = True
    """Whether every column must name an input; in a results file other columns are ignored."""
    group: str = ""
    """Input whose elements are all columns; empty for a file."""

    @property
    def digest(self) -> str:
        """Digest of everything that a run depends on: names, units, times, values, interpolation."""
        head = repr((self.names, self.units, self.values.shape, self.held, self.chosen)).encode()
        return sha256(head + self.t.tobytes() + self.values.tobytes()).hexdigest()[:16]


Inputs = str | os.PathLike[str] | Sequence[str | os.PathLike[str] | InputTable] | Mapping[str, tuple[Any, Any]] | None
"""One or more CSV files, or a mapping of signals to times and values."""


class Course:
    """Columns (m, n) of a table over times (m,) [s], held before the first and after the last row."""

    def __init__(self, t: Floats, values: Floats, held: bool) -> None:
        self.held, self.t, self.values = held, t, values
        self.tolerance = _CLOSE * float(np.abs(t).max())
        """Largest difference [s] between a time and the row that it equals."""
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

    A mapping contains, by signal, times (m,) [s] and values: (m,) of ``component.variable``, or (m, n) of
    ``component.variable[1]`` to ``[n]``. With `hold`, real values are held until the next row; other values always are.
    UsageError for files or arrays in another form, with every problem and its row.
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
    that cannot be read are skipped. None for a file in another form.
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
    """Note the first row of each column that is not finite, and the first row whose time does not increase."""
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
    """Return a note for each table that does not cover a run from `begin` to `end` [s]."""
    slack = _CLOSE * max(abs(begin), abs(end), math.ulp(0.0))
    return [
        f"{table.where}: its times are {table.t[0]:g} to {table.t[-1]:g} s, the run's are {begin:g} to {end:g} s; "
        "before the first row and after the last its values are held"
        for table in tables
        if table.t[0] > begin + slack or table.t[-1] < end - slack
    ]


class Fed(NamedTuple):
    """Signals of one FMI type, named as outputs of the source."""

    kind: str
    names: tuple[str, ...]
    course: Course


class Feed(NamedTuple):
    """The source of external signals: signals, description for schedule and exchange, connections, and notes."""

    courses: tuple[Fed, ...]
    description: Description
    links: tuple[Link, ...]
    notes: tuple[str, ...]


def feed_inputs(
    tables: Sequence[InputTable],
    descriptions: Mapping[str, Description],
    links: Sequence[Link],
    unit_of: Callable[[Port, FmuVariable], UnitFactor | None],
    units: Mapping[str, UnitFactor],
) -> tuple[Feed | None, list[str]]:
    """Connect columns of tables to the inputs of the same names; None without tables. Also return all problems.

    `links` are the connections of the system, `unit_of` returns the unit of an input, `units` are the definitions of
    the SSD.
    """
    if not tables:
        return None, []
    connected = {link.end: ".".join(link.start) for link in links}
    variables = {
        f"{component}.{variable.name}": (component, variable)
        for component, description in descriptions.items()
        for variable in description.variables.values()
    }
    free = [name for name, (unit, v) in variables.items() if v.causality == "input" and (unit, v.name) not in connected]
    problems: list[str] = []
    notes: list[str] = []
    made: dict[str, tuple[FmuVariable, Link]] = {}
    courses: list[Fed] = []
    for table in tables:
        groups: dict[tuple[str, bool], list[int]] = {}
        left = 0
        for i, (name, unit) in enumerate(zip(table.names, table.units, strict=True)):
            if not table.chosen and name not in free:
                left += 1
                continue
            where = f"{table.where}: {name}"
            if name not in free:
                problems.append(f"{where}: {_why_not(name, variables, connected, free)}")
                continue
            if name in made:
                problems.append(f"{where}: is given twice; give each input one signal")
                continue
            component, sink = variables[name]
            port = component, sink.name
            try:
                conversion = _conversion(unit, unit_of(port, sink), sink, units)
                _check_values(table.values[:, i], sink, conversion)
            except (ValueError, UsageError) as error:
                problems.append(f"{where}: {error}")
                continue
            held = table.held or sink.type != "Real" or sink.variability == "discrete"
            source = dataclasses.replace(
                sink, name=name, causality="output", initial="exact", variability="discrete" if held else "continuous"
            )
            made[name] = source, Link((SOURCE, name), port, source, sink, conversion, stepped=True)
            groups.setdefault((sink.kind, held), []).append(i)
        elements = [name for name in variables if table.group and name.startswith(f"{table.group}[")]
        if not {*elements} <= {*table.names}:
            problems.append(
                f"{table.where}: expected {len(elements)} columns, a value for each of {elements[0]} to "
                f"{elements[-1]}, got {len(table.names)}"
            )
        for (kind, held), columns in groups.items():
            course = Course(table.t, table.values[:, columns], held)
            courses.append(Fed(kind, tuple(table.names[i] for i in columns), course))
        if left == len(table.names):
            problems.append(f"{table.where}: no column names an unconnected input{_list(free)}")
        elif left:
            feeding = f"{len(table.names) - left} columns feed inputs"
            notes.append(f"{table.where}: {feeding}; the other {left} do not name an unconnected input")
    sources = {name: source for name, (source, _) in made.items()}
    none: dict[str, frozenset[str] | None] = dict.fromkeys(sources, frozenset())
    description = Description("", "", "", False, sources, none, none)
    return Feed(tuple(courses), description, tuple(link for _, link in made.values()), tuple(notes)), problems


def _why_not(
    name: str, variables: Mapping[str, tuple[str, FmuVariable]], connected: Mapping[Port, str], free: Sequence[str]
) -> str:
    if name not in variables:
        return "no component has such an input" + (close_to(name, free) or _list(free))
    component, variable = variables[name]
    if variable.causality != "input":
        return f"expected an input, got a variable of causality {variable.causality}{_list(free)}"
    return f"expected an unconnected input; {connected[component, variable.name]} is connected to it"


def _list(free: Sequence[str]) -> str:
    more = f" and {len(free) - 8} more" if len(free) > 8 else ""
    return f". Free inputs: {', '.join(free[:8]) or 'none'}{more}"


def _conversion(name: str, target: UnitFactor | None, sink: FmuVariable, units: Mapping[str, UnitFactor]) -> Conversion:
    """Return the conversion from a unit of measurement by its name; an empty name means the input's unit."""
    if not name or (target is not None and target.name == name):
        return Conversion()
    unit = units.get(name)
    if unit is None:
        base_name, factor = coherent(name)
        exponents = measure(base_name).exponents
        unit = UnitFactor(name, tuple(exponents.get(base, 0) for base in BASE_UNITS), factor)
    if sink.type != "Real":
        raise ValueError(f"expected no unit of measurement for a variable of type {sink.type}, got {name!r}")
    return Conversion(*between(unit, target, sink.relative)) if target is not None else Conversion()


def _check_values(values: np.ndarray, sink: FmuVariable, conversion: Conversion) -> None:
    if sink.type == "String":
        raise ValueError("text cannot be given as a signal; set a value")
    allowed = values == (values != 0.0) if sink.type == "Boolean" else values == np.rint(values)
    if sink.type != "Real" and not allowed.all():
        expected = "0 or 1" if sink.type == "Boolean" else "whole numbers"
        raise ValueError(f"expected {expected} for a variable of type {sink.type}, got {values[np.argmin(allowed)]:g}")
    for value in (values.min(), values.max()):
        if fault := sink.domain.fault(float(conversion.factor * value + conversion.offset)):
            raise ValueError(fault)
