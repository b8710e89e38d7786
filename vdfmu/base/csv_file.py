"""CSV files of any tool: separator, decimal comma, names and units are recognised, and rows are read in blocks."""

from __future__ import annotations

import csv
import io
import re
from collections import Counter
from collections.abc import Generator, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from itertools import chain, islice
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vdfmu.base.arrays import Floats
from vdfmu.base.errors import UsageError
from vdfmu.base.files import open_regular

_QUOTED = re.compile(r'"[^"]*"')
TIME_UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
"""Units of times, in s."""
_CELLS, _ROWS = 2**18, 512
"""Number of cells of a block, and its least number of rows if there are many columns."""
MOST_FAULTS = 8
"""Number of faulty rows that are listed."""


class CsvError(ValueError):
    """A text that is not CSV."""


def split_unit(heading: str) -> tuple[str, str]:
    """Return the name and the unit of a heading such as ``q_1 [deg]`` or ``q_1 (deg)``; the unit may be empty."""
    text = heading.strip()
    match = re.search(r"\s[\[(]", text) if text.endswith((")", "]")) else None
    if match is None or match.end() == len(text) - 1:
        return text, ""
    return text[: match.start()].rstrip(), text[match.end() : -1]


def repeated(names: Iterable[str]) -> list[str]:
    """Return the names that occur more than once, sorted."""
    return sorted(name for name, count in Counter(names).items() if count > 1)


class CsvFile:
    """Rows of a CSV text below its names and units. They can be read once, by iteration or with `blocks`.

    The separator is the first of tab, semicolon and comma that is in the heading, else a blank. If it is not a comma,
    numbers may have decimal commas. Units are in brackets after the names, or in a second row. A second row contains
    units if its first cell is a unit of time with a number below it; or if its first cell is a text, another text has a
    number below it, and its only number is 1, the unit of ratios. Rows of empty cells are skipped.

    Parameters
    ----------
    lines : iterable of str

    Raises
    ------
    CsvError
        At once, or while rows are read.
    """

    def __init__(self, lines: Iterable[str]) -> None:
        stream, first = iter(lines), list[str]()
        for line in stream:
            first.append(line)
            if line.strip():
                break
        heading = _QUOTED.sub("", first[-1]) if first else ""
        self.separator = next((mark for mark in "\t;," if mark in heading), " " if heading.strip() else ",")
        padded = bool(first) and re.search(rf'{self.separator} +"', first[-1]) is not None
        self._rows = self._read(chain(first, stream), padded)
        head, second, third = ([*islice(self._rows, 1)] for _ in range(3))
        self.headings: list[str] = head[0][1] if head else []
        """Cells of the first row, unchanged."""
        are_units = bool(second) and self._are_units(second[0][1], third[0][1] if third else [])
        self.unit_row = second[0][1] if are_units else []
        """Cells of the row of units, unchanged; empty without a row of units."""
        split = [(cell.strip(), "") if are_units else split_unit(cell) for cell in self.headings]
        self.names = [name for name, _ in split]
        """Names without units, stripped."""
        self.units = [*map(str.strip, self.unit_row)] if are_units else [unit for _, unit in split]
        """Units, stripped."""
        self._rows = chain([] if are_units else second, third, self._rows)

    def _read(self, lines: Iterable[str], padded: bool) -> Iterator[tuple[int, list[str]]]:
        spaced = self.separator == " "
        stream = (line.strip() for line in lines) if spaced else lines
        reader = csv.reader(stream, delimiter=self.separator, skipinitialspace=spaced or padded, strict=True)
        try:
            for row in reader:
                if any(map(str.strip, row)):
                    yield reader.line_num, row
        except csv.Error as error:
            raise CsvError(f"line {reader.line_num}: {error}") from None

    def _are_units(self, row: Sequence[str], following: Sequence[str]) -> bool:
        if row[0].strip() in TIME_UNITS:
            return not following or self._is_number(following[0])
        texts = [not self._is_number(cell) for cell in row]
        if not texts[0] or not all(text or cell.strip() == "1" for text, cell in zip(texts, row, strict=True)):
            return False
        named = [text and cell.strip() != "" for text, cell in zip(texts, row, strict=True)]
        return any(text and self._is_number(cell) for text, cell in zip(named, following, strict=False))

    def _is_number(self, cell: str) -> bool:
        try:
            float(self.pointed(cell))
        except ValueError:
            return False
        return True

    def pointed(self, cell: str) -> str:
        """Return a cell with its decimal comma replaced by a decimal point."""
        return cell if self.separator == "," else cell.replace(",", ".")

    def __iter__(self) -> Iterator[tuple[int, list[str]]]:
        """Yield the line number and the cells of each row below names and units."""
        return iter(self._rows)

    def blocks(self, faults: list[str], texts: bool = False) -> Iterator[tuple[NDArray[np.int64], Floats]]:
        """Yield the line numbers (m,) and values (m, n) of blocks of rows.

        Rows with another number of cells, or with a cell that is not a number, are skipped and added to `faults`. With
        `texts`, such a cell is NaN.
        """
        width = len(self.names)
        while block := list(islice(self._rows, max(_ROWS, _CELLS // max(1, width)))):
            rows = {line: row for line, row in block if len(row) == width}
            faults += [f"row {line}: expected {width} cells, got {len(row)}" for line, row in block if line not in rows]
            try:
                values = self._floats([cell for row in rows.values() for cell in row]).reshape(-1, width)
            except ValueError:
                if texts:
                    values = np.column_stack(
                        [self._floats(column, texts) for column in zip(*rows.values(), strict=True)]
                    )
                else:
                    wrong = {line: self._fault(row) for line, row in rows.items()}
                    faults += [f"row {line}: {fault}" for line, fault in wrong.items() if fault]
                    rows = {line: row for line, row in rows.items() if not wrong[line]}
                    values = self._floats([cell for row in rows.values() for cell in row]).reshape(-1, width)
            yield np.array([*rows], np.int64), values

    def _floats(self, cells: Sequence[str], texts: bool = False) -> Floats:
        """Return the cells as numbers. A cell that is not a number becomes NaN with `texts`, else raises ValueError."""
        for written in (cells, map(self.pointed, cells)):
            with suppress(ValueError):
                return np.array([*written], float)
        if not texts:
            raise ValueError
        return np.array([float(self.pointed(cell)) if self._is_number(cell) else np.nan for cell in cells])

    def _fault(self, row: Sequence[str]) -> str:
        """Return what is wrong with a row."""
        bad = next(
            ((name, cell) for name, cell in zip(self.names, row, strict=True) if not self._is_number(cell)), None
        )
        return "" if bad is None else f"{bad[0]}: expected a number, got {bad[1].strip()[:80]!r}"


@contextmanager
def open_csv(path: Path) -> Generator[CsvFile]:
    """Open a CSV file in UTF-8. UsageError if it cannot be read, at once or while rows are read in the block."""
    try:
        with io.TextIOWrapper(open_regular(path), encoding="utf-8-sig", newline="") as stream:
            yield CsvFile(stream)
    except (OSError, UnicodeDecodeError, CsvError) as error:
        why = getattr(error, "strerror", None) or error
        raise UsageError(f"{path}: expected a CSV file in UTF-8, but it cannot be read: {why}.") from None


class CsvColumns(NamedTuple):
    """A CSV file of numbers."""

    file: CsvFile
    """Headings, names and units."""
    lines: NDArray[np.int64]
    """Line number of each row (m,)."""
    values: Floats
    """(m, n)."""
    faults: list[str]
    """Faults of rows: at most `MOST_FAULTS`, then the number of further ones."""


def columns_of(file: CsvFile, texts: bool = False) -> CsvColumns:
    """Read the rows of an open CSV file of numbers; see `CsvFile.blocks`."""
    faults: list[str] = []
    blocks = [(np.empty(0, np.int64), np.empty((0, len(file.names)))), *file.blocks(faults, texts)]
    if len(faults) > MOST_FAULTS:
        faults[MOST_FAULTS:] = [f"{len(faults) - MOST_FAULTS} more rows like these"]
    lines, values = map(np.concatenate, zip(*blocks, strict=True))
    return CsvColumns(file, lines, values, faults)


def read_columns(path: Path) -> CsvColumns:
    """Read a CSV file of numbers. UsageError if it cannot be read. Faulty rows are in `faults`."""
    with open_csv(path) as file:
        return columns_of(file)
