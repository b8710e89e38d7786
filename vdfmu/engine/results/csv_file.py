"""Results in CSV: a line of names, a line of units, then a line a communication point."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Mapping, Sequence
from itertools import chain
from pathlib import Path
from typing import Any, TextIO

import numpy as np
from numpy.typing import NDArray

from vdfmu.base.arrays import Floats
from vdfmu.base.errors import UsageError
from vdfmu.base.files import write_whole
from vdfmu.base.scipy_parts import scipy_part
from vdfmu.engine.results.formats import Format, Stream
from vdfmu.engine.results.recorded import KINDS, Recorded, Signal, copies_in, with_copies

_BLOCK = 512


def write_csv(results: Recorded, path: Path) -> None:
    """Write all signals."""
    blocks = (csv_lines(block.time, results.signals, block.data, slice(None)) for block in results.blocks(_BLOCK))
    write_whole(path, (text.encode() for text in chain([csv_head(results.signals)], blocks)))


def read_csv(path: Path) -> Recorded:
    """Read what `write_csv` or a run wrote."""
    try:
        with path.open(encoding="utf-8", newline="") as stream:
            names, units, table = _read_table(path, stream)
    except (OSError, UnicodeDecodeError) as error:
        raise UsageError(f"cannot read {path}: {getattr(error, 'strerror', None) or error}") from None
    if table.shape[1] != len(names):
        raise UsageError(f"{path}: expected {len(names)} columns, got {table.shape[1]}")
    signals: list[Signal] = []
    chosen: dict[str, list[int]] = {kind: [] for kind in KINDS}
    for index, (name, unit) in enumerate(zip(names[1:], units[1:], strict=True), start=1):
        kind = unit if unit in KINDS[1:] else "real"
        signals.append(Signal(name, kind, unit if kind == "real" else "", len(chosen[kind])))
        chosen[kind].append(index)
    data = {
        kind: table[:, columns].astype(np.float64 if kind == "real" else np.int32) for kind, columns in chosen.items()
    }
    time = table[:, 0].copy()
    del table  # a run of hours is in memory once
    summary = summary_beside(path)
    signals, data = with_copies(signals, data, copies_in(summary))
    return Recorded(time, signals, data, summary)


def _read_table(path: Path, stream: TextIO) -> tuple[list[str], list[str], Floats]:
    """Return names, units, and the numbers below them, read line by line."""
    reader = csv.reader(stream)
    try:
        names, units = next(reader), next(reader)
    except (StopIteration, csv.Error):
        raise UsageError(f"{path}: expected a line of names and a line of units") from None
    if len(names) != len(units) or names[:1] != ["time"]:
        raise UsageError(f"{path}: expected as many units as names, and 'time' as the first column")
    first = next((line for line in stream if line.strip()), None)
    if first is None:
        return names, units, np.empty((0, len(names)))
    try:
        lines = chain([first], stream)
        return names, units, np.loadtxt(lines, delimiter=",", ndmin=2, comments=None)
    except UnicodeDecodeError:
        raise
    except ValueError as error:
        raise UsageError(f"{path}: {error}") from None


def summary_beside(path: Path) -> dict[str, Any]:
    """Return the ``summary.json`` next to a CSV file; nothing unless the same run wrote both."""
    try:
        found = json.loads(path.with_name("summary.json").read_bytes())
        return found if "copies" in found and found["csv_bytes"] == path.stat().st_size else {}
    except (OSError, ValueError, KeyError, TypeError):
        return {}


def csv_head(signals: Sequence[Signal]) -> str:
    """Return the lines of names and of units."""
    head = ""
    for row in (
        ["time", *(s.name for s in signals)],
        ["s", *(s.unit if s.kind == "real" else s.kind for s in signals)],
    ):
        line = io.StringIO()
        csv.writer(line, lineterminator="\r\n").writerow(row)  # both are then quoted in names
        head += line.getvalue().removesuffix("\r\n") + "\n"
    return head


def csv_lines(time: Floats, signals: Sequence[Signal], data: Mapping[str, NDArray[Any]], rows: slice) -> str:
    """Return a line for each `time` and its row of `data`; numbers in their shortest form of the same bits."""
    if not len(time):
        return ""
    if all(signal.kind == "real" for signal in signals):
        table = np.column_stack([time, data["real"][rows][:, [signal.column for signal in signals]]])
        characters = np.frombuffer(bytearray(_numbers(table.T)), np.uint8)
        ends = np.flatnonzero(characters == ord("\n"))
        characters[np.delete(ends, np.s_[table.shape[1] - 1 :: table.shape[1]])] = ord(",")
        return characters.tobytes().decode()
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
    """Return a line for each number of an array (m, n), column by column, in a fifth of the time of Python's texts.

    By the part of `scipy.io.mmwrite` that is compiled, without the rest of scipy.io, which takes 0.2 s to import.
    """
    stream = io.BytesIO()
    try:
        core = scipy_part("scipy.io._fast_matrix_market._fmm_core")
        core.write_body_array(core.open_write_stream(stream, core.header(comment="", symmetry="general"), 1, -1), array)
    except (AttributeError, ImportError, RuntimeError, TypeError, ValueError):  # a scipy whose parts are others
        from scipy.io import mmwrite

        stream = io.BytesIO()
        mmwrite(stream, array, symmetry="general")
    return stream.getvalue().split(b"\n", 3)[-1]  # below its head


FORMAT = Format(lambda: None, write_csv, read_csv, Stream(csv_head, csv_lines))
