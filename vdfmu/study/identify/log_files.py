"""Columns of the files that logs come in: CSV of any tool, MATLAB, Parquet, and results of a run in any form."""

from __future__ import annotations

import csv
import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from vdfmu.base.arrays import Floats
from vdfmu.base.errors import UsageError
from vdfmu.base.files import read_text
from vdfmu.base.plugins import Plugins, PluginTable
from vdfmu.base.unpack import mat_variables
from vdfmu.engine.results.parquet import read_table
from vdfmu.engine.results.results import Results

_HEADING = re.compile(r"(.*?)(?:\s+[\[(](.+)[\])])?\s*")
"""A name, and a unit in brackets behind a space."""
_TIME = re.compile(r"(?:.*\.)?(?:t|(?:time|stamp|timestamp)(?:_\w+)?)", re.IGNORECASE)
_SECONDS = {"": 1.0, "s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}


class LogColumn(NamedTuple):
    """Values at times [s], and their unit; empty if the file has none."""

    t: Floats
    values: Floats
    unit: str


def split_unit(heading: str) -> tuple[str, str]:
    """Return the name and the unit of a heading such as ``q_1 [deg]``."""
    match = _HEADING.fullmatch(heading)
    return (match[1], match[2] or "") if match else (heading, "")


def read_columns(path: Path, time: str, notes: list[str]) -> dict[str, LogColumn]:
    """Return the columns of a file, of which `time` names that of the times; what was assumed is noted."""
    suffix = path.suffix.lower()
    found = READERS[suffix](path) if suffix in READERS else _csv(path)
    if isinstance(found, Results):
        return {name: LogColumn(found.time, np.asarray(found[name], float), found.units[name]) for name in found}
    if found and all(len(column) == 3 for column in found.values()):
        times: dict[bytes, Floats] = {}  # columns with the same times share them
        timed: dict[str, LogColumn] = {}
        for name, (t, values, unit) in found.items():
            t = np.asarray(t, float)
            timed[name] = LogColumn(times.setdefault(t.tobytes(), t), np.asarray(values, float), unit)
        return timed
    name, unit = split_unit(time)
    name = name or next((each for each in found if _TIME.fullmatch(each)), "")
    if name not in found:
        there = f"there are {', '.join(found)}. Name it by --time" if found else "the file has no columns"
        raise UsageError(f"{path}: expected a column {name or 'time'}; {there}.")
    stamps, own = found[name]
    unit = unit or own or (match[1] if (match := re.fullmatch(r".*_(m?s|us|ns)", name)) else "")
    if unit not in _SECONDS:
        raise UsageError(
            f"{path}: {name}: expected the unit s, ms, us or ns, got {unit!r}. Give it: --time '{name} [s]'."
        )
    whole = stamps.dtype.kind in "iu"  # times since 1970 in ns have more digits than a float
    t = np.asarray(stamps - stamps[0] if whole and len(stamps) else stamps, float).reshape(-1) * _SECONDS[unit]
    if name != "time":
        notes.append(f"times are those of {name}, in {unit or 's'}")
    return {
        each: LogColumn(t, np.asarray(values, float).reshape(-1), unit)
        for each, (values, unit) in found.items()
        if each != name and np.size(values) == len(t)
    }


_Found = Mapping[str, tuple[Any, ...]]


def _csv(path: Path) -> Results | _Found:
    try:
        lines = read_text(path).splitlines()
        delimiter = max(";\t,", key=lines[0].count) if lines else ","
        delimiter = delimiter if lines and delimiter in lines[0] else " "
        rows = [[cell.strip() for cell in row] for row in csv.reader(lines, delimiter=delimiter) if any(row)]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        why = getattr(error, "strerror", None) or error
        known = ", ".join(READERS.names())
        text = f"{path}: expected a CSV file, got what cannot be read: {why}. Readers: {known}; a package can add one."
        raise UsageError(text) from None
    if len(rows) > 1 and rows[0][0] == "time" and rows[1][0] == "s":
        return Results.read(path)
    headings = [split_unit(cell) for cell in rows[0]] if rows else []
    if len(rows) > 1 and all(np.isnan(_number(cell, delimiter)) for cell in rows[1]):  # a line of units
        headings = [(name, unit) for (name, _), unit in zip(headings, rows.pop(1), strict=False)]
    names = [name for name, _ in headings]
    if problems := [
        *(f"{name}: more than one column has this name" for name in sorted({n for n in names if names.count(n) > 1})),
        *(f"row {i}: expected {len(names)} cells, got {len(row)}" for i, row in enumerate(rows[1:], 1)
          if len(row) != len(names)),
    ]:  # fmt: skip
        raise UsageError("\n".join(f"{path}: {problem}." for problem in problems[:8]))
    columns = zip(*rows[1:], strict=True) if len(rows) > 1 else ((),) * len(names)
    return {
        name: (np.array([_number(cell, delimiter) for cell in column]), unit)
        for (name, unit), column in zip(headings, columns, strict=True)
    }


def _number(cell: str, delimiter: str) -> float:
    try:
        return float(cell if delimiter == "," else cell.replace(",", "."))
    except ValueError:
        return np.nan


def _mat(path: Path) -> Results | _Found:
    variables = mat_variables(path)
    if "vdfmu" in variables:
        return Results.read(path)
    found: dict[str, tuple[Any, str]] = {}
    for name, value in variables.items():
        array = np.squeeze(np.asarray(value))
        if array.dtype.kind not in "fiub" or array.ndim > 2:
            continue
        if array.ndim < 2:
            found[name] = np.atleast_1d(array), ""
        else:  # of MATLAB's arrays, some have a row for each time, some a column
            for i, each in enumerate(array if array.shape[0] < array.shape[1] else array.T, 1):
                found[f"{name}[{i}]"] = each, ""
    return found


def _parquet(path: Path) -> Results | _Found:
    schema, table = read_table(path)
    if b"vdfmu" in (schema.metadata or {}):
        return Results.read(path)
    found: dict[str, tuple[Any, str]] = {}
    for field in table.schema:
        name, unit = split_unit(field.name)
        values = table[field.name].to_numpy()
        if values.dtype.kind == "M":
            values, unit = values.astype("datetime64[ns]").astype(np.int64), "ns"
        if values.dtype.kind in "fiub":
            found[name] = values, (field.metadata or {}).get(b"unit", unit.encode()).decode()
    return found


PLUGINS = Plugins("logs", "reader of logs", "a function of the path of a log", callable)
READERS: PluginTable[Callable[[Path], Results | _Found]] = PluginTable(
    PLUGINS, {".csv": _csv, ".txt": _csv, ".mat": _mat, ".parquet": _parquet}, prefix="."
)
"""Readers by suffix. Each returns results, or columns: name to numbers and unit, "" for none. Columns have one length,
or each has times of its own [s] before its numbers."""
