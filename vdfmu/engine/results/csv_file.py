"""Results in CSV: a line of names, a line of units, then a line a communication point."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator, Mapping, Sequence
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vdfmu.base.arrays import Floats, scipy_part
from vdfmu.base.csv_file import MOST_FAULTS, CsvFile, open_csv, repeated
from vdfmu.base.errors import UsageError
from vdfmu.base.files import read_json, write_whole
from vdfmu.engine.results.arrays import joined
from vdfmu.engine.results.formats import Format, Stream
from vdfmu.engine.results.results import KINDS, TYPES, Recorded, Signal

_BLOCK = 512


def write_csv(results: Recorded, path: Path) -> None:
    """Write all signals."""
    blocks = (csv_lines(block.time, results.signals, block.data, slice(None)) for block in results.blocks(_BLOCK))
    write_whole(path, (text.encode() for text in chain([csv_head(results.signals)], blocks)))


def read_csv(path: Path) -> Recorded:
    """Read what `write_csv` or a run wrote, or another CSV file with ``time`` in the first column."""
    with open_csv(path) as file:
        return csv_results(path, file)


def csv_results(path: Path, file: CsvFile) -> Recorded:
    """Return the results in an open CSV file. Without a line of units all signals are real."""
    names, units = (file.headings, file.unit_row) if file.unit_row else (file.names, file.units)
    if names[:1] != ["time"] or units[:1] not in (["s"], [""]) or len(units) != len(names):
        raise UsageError(
            f"{path}: expected 'time' in s as the first column, and as many units as names if the second line has "
            f"units; got {', '.join(names[:3]) or 'nothing'} and {len(units)} units of {len(names)} columns."
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
    """Yield the numbers of stretches of lines, at least one."""
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
    """Return the lines of names and of units."""
    head, units = "", [s.unit if s.kind == "real" else s.kind for s in signals]
    for row in (["time", *(s.name for s in signals)], ["s", *units]):
        line = io.StringIO()
        csv.writer(line, lineterminator="\r\n").writerow(row)  # quotes both characters in names
        head += line.getvalue().removesuffix("\r\n") + "\n"
    return head


def csv_lines(time: Floats, signals: Sequence[Signal], data: Mapping[str, NDArray[Any]], rows: slice) -> str:
    """Return a line for each `time` and its row of `data`; numbers in their shortest form of the same bits."""
    if not len(time):
        return ""
    if all(signal.kind == "real" for signal in signals):
        table = np.column_stack([time, data["real"][rows][:, [signal.column for signal in signals]]])
        characters = np.frombuffer(text := bytearray(_numbers(table.T)), np.uint8)
        ends = np.flatnonzero(characters == ord("\n")).reshape(table.shape)
        characters[ends[:, :-1]] = ord(",")
        return text.decode()
    texts = {kind: _texts(array[rows]) for kind, array in data.items()}
    columns = [*_texts(time[:, None]), *(texts[s.kind][s.column] for s in signals)]
    return "".join(line + "\n" for line in map(",".join, zip(*columns, strict=True)))


def _texts(array: NDArray[Any]) -> list[list[str]]:
    """Return the texts of the numbers of each column of an array (m, n)."""
    if array.dtype.kind != "f" or not array.size:
        return [list(map(str, column)) for column in array.T.tolist()]
    texts = _numbers(array).decode().splitlines()
    return [texts[first : first + len(array)] for first in range(0, array.size, len(array))]


def _numbers(array: Floats) -> bytes:
    """Return a line for each number of an array (m, n), column by column, five times as fast as Python.

    Uses the compiled part of `scipy.io.mmwrite`, since scipy.io takes 0.2 s to import.
    """
    stream = io.BytesIO()
    try:
        core = scipy_part("scipy.io._fast_matrix_market._fmm_core")
        core.write_body_array(core.open_write_stream(stream, core.header(comment="", symmetry="general"), 1, -1), array)
    except (AttributeError, ImportError, RuntimeError, TypeError, ValueError):  # another version of scipy
        from scipy.io import mmwrite

        stream = io.BytesIO()
        mmwrite(stream, array, symmetry="general")
    stream.seek(0)
    for _ in range(3):  # its head
        stream.readline()
    return stream.read()


FORMAT = Format(lambda: None, write_csv, read_csv, Stream(csv_head, csv_lines))
