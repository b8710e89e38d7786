"""Results in CSV: a line of names, a line of units, then a line for each communication point."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator, Mapping, Sequence
from ctypes import CDLL, c_size_t, c_void_p
from functools import cache
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vdfmu.base.arrays import Floats
from vdfmu.base.csv_file import MOST_FAULTS, CsvFile, open_csv, repeated
from vdfmu.base.errors import UsageError
from vdfmu.base.files import read_json, write_whole
from vdfmu.engine.results.arrays import joined
from vdfmu.engine.results.formats import Format, Stream
from vdfmu.engine.results.results import KINDS, TYPES, Recorded, Signal

_BLOCK = 512
_LONGEST = 25
"""Largest number of characters of a number and its separator: -1.2345678901234567E-308."""
_TYPES = c_void_p, c_size_t, c_size_t, c_void_p, c_void_p
"""Types of the arguments of ``write_lines``."""


def write_csv(results: Recorded, path: Path) -> None:
    """Write all signals."""
    blocks = (csv_lines(block.time, results.signals, block.data, slice(None)) for block in results.blocks(_BLOCK))
    write_whole(path, (text.encode() for text in chain([csv_head(results.signals)], blocks)))


def read_csv(path: Path) -> Recorded:
    """Read a file of `write_csv` or a run, or another CSV file with ``time`` in the first column."""
    with open_csv(path) as file:
        return csv_results(path, file)


def csv_results(path: Path, file: CsvFile) -> Recorded:
    """Return the results in an open CSV file. Without a line of units all signals are real."""
    names, units = (file.headings, file.unit_row) if file.unit_row else (file.names, file.units)
    if names[:1] != ["time"] or units[:1] not in (["s"], [""]) or len(units) != len(names):
        raise UsageError(
            f"{path}: expected 'time' in s as the first column, and a unit for each name if the second line has units; "
            f"got {', '.join(names[:3]) or 'nothing'}, with {len(units)} units for {len(names)} columns."
        )
    if twice := repeated(names[1:]):
        raise UsageError(f"{path}: {', '.join(twice)}: more than one column has this name.")
    signals: list[Signal] = []
    chosen: dict[str, list[int]] = {kind: [] for kind in KINDS}
    for index, (name, unit) in enumerate(zip(names[1:], units[1:], strict=True), start=1):
        kind = unit if unit in KINDS[1:] else "real"
        signals.append(Signal(name, kind, unit if kind == "real" else "", len(chosen[kind])))
        chosen[kind].append(index)
    blocks = (
        (table[:, 0].copy(), {kind: table[:, columns].astype(TYPES[kind]) for kind, columns in chosen.items()})
        for table in _tables(path, file)
    )
    return joined(path, blocks, signals, summary_beside(path))


def _tables(path: Path, file: CsvFile) -> Iterator[Floats]:
    """Yield the numbers of blocks of lines, at least one block."""
    yield np.empty((0, len(file.names)))
    faults: list[str] = []
    for _, table in file.blocks(faults):
        if faults:
            raise UsageError("\n".join(f"{path}: {fault}." for fault in faults[:MOST_FAULTS]))
        yield table


def summary_beside(path: Path) -> dict[str, Any]:
    """Return the ``summary.json`` next to a CSV file if it lists the file; else an empty mapping."""
    try:
        summary = read_json(path.with_name("summary.json"))
        return summary if path.name in [*summary["files"]] else {}
    except (OSError, ValueError, KeyError, TypeError):
        return {}


def csv_head(signals: Sequence[Signal]) -> str:
    """Return the line of names and the line of units."""
    head, units = "", [s.unit if s.kind == "real" else s.kind for s in signals]
    for row in (["time", *(s.name for s in signals)], ["s", *units]):
        line = io.StringIO()
        csv.writer(line, lineterminator="\r\n").writerow(row)  # quotes both characters in names
        head += line.getvalue().removesuffix("\r\n") + "\n"
    return head


def csv_lines(time: Floats, signals: Sequence[Signal], data: Mapping[str, NDArray[Any]], rows: slice) -> str:
    """Return a line for each `time` and its row of `data`; numbers have their shortest form with the same bits."""
    if not len(time):
        return ""
    if all(signal.kind == "real" for signal in signals):
        return _lines(np.column_stack([time, data["real"][rows][:, [signal.column for signal in signals]]]))
    texts = {kind: _texts(array[rows]) for kind, array in data.items()}
    columns = [*_texts(time[:, None]), *(texts[s.kind][s.column] for s in signals)]
    return "".join(line + "\n" for line in map(",".join, zip(*columns, strict=True)))


def _texts(array: NDArray[Any]) -> list[list[str]]:
    """Return the texts of the numbers of each column of an array (m, n)."""
    if array.dtype.kind != "f" or not array.size:
        return [list(map(str, column)) for column in array.T.tolist()]
    return [line.split(",") for line in _lines(array.T).splitlines()]


def _lines(table: Floats) -> str:
    """Return a line for each row of a table (m, n), numbers in their shortest form, ten times faster than Python."""
    library = _library()
    if library is None:
        return _lines_of_scipy(table)
    numbers, text = np.ascontiguousarray(table, np.float64), np.empty(_LONGEST * table.size, np.uint8)
    size = library.write_lines(numbers.ctypes.data, *numbers.shape, _powers().ctypes.data, text.ctypes.data)
    return text[:size].tobytes().decode()


def _lines_of_scipy(table: Floats) -> str:
    """Return the text of `_lines` without a compiler; scipy.io takes 0.2 s to import."""
    from scipy.io import mmwrite

    stream = io.BytesIO()
    mmwrite(stream, table.T, symmetry="general")  # a line per number, after a head of three lines
    numbers = stream.getvalue().decode().splitlines()[3:]
    n = table.shape[1]
    return "".join(",".join(numbers[first : first + n]) + "\n" for first in range(0, table.size, n))


@cache
def _library() -> CDLL | None:
    """Return the compiled ``shortest.c``; None without a compiler or disk space."""
    from vdfmu.base.compile import own_library

    library = own_library(Path(__file__).with_name("shortest.c"))
    if library is not None:
        library.write_lines.argtypes, library.write_lines.restype = _TYPES, c_size_t
    return library


@cache
def _powers() -> NDArray[np.uint64]:
    """Return 10^k for k from -292 to 324, (617, 2): the leading 128 bits, rounded up, as high and low half."""

    def power(k: int) -> int:
        number = 10 ** abs(k)
        bits = number.bit_length()
        return -(-(number << 128) >> bits) if k >= 0 else -(-(1 << (127 + bits)) // number)

    return np.array([divmod(power(k), 2**64) for k in range(-292, 325)], np.uint64)


FORMAT = Format(lambda: None, write_csv, read_csv, Stream(csv_head, csv_lines))
