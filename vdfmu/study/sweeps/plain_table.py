"""The table of a study in CSV, for studies without pyarrow, with the methods of pyarrow's table that studies use."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import compress
from typing import Any

import numpy as np
from numpy.typing import NDArray

TEXTS = ("failed", "failed_in", "kind")
"""Columns of texts; the type of another column is the first of `_READERS` that reads all of its values."""
_TRUTHS = {"True": True, "False": False}
_READERS: tuple[Callable[[str], Any], ...] = (int, float, _TRUTHS.__getitem__, json.loads)


class Column(list[Any]):
    """Values of a column; None for a point without one."""

    def to_pylist(self) -> list[Any]:
        """Return the values."""
        return list(self)

    def to_numpy(self, zero_copy_only: bool = True) -> NDArray[Any]:
        """Return an array, with NaN for numbers that are missing; of objects for texts and lists."""
        kinds = {type(value) for value in self} - {type(None)}
        if kinds <= {int, float}:
            values = [np.nan if value is None else value for value in self]
            return np.array(values, int if kinds == {int} and None not in self else float)
        if kinds == {bool} and None not in self:
            return np.array(self)
        values = np.empty(len(self), object)
        values[:] = [np.array(value) if isinstance(value, list) else value for value in self]
        return values

    @property
    def null_count(self) -> int:
        """Number of points without a value."""
        return sum(value is None for value in self)


class PlainTable:
    """Columns of the same length, by name."""

    metadata = None
    """The facts of the study are in a file of their own."""

    def __init__(self, columns: Mapping[str, Iterable[Any]]) -> None:
        self._columns = {name: Column(values) for name, values in columns.items()}

    @classmethod
    def of_rows(cls, rows: Sequence[Mapping[str, Any]], names: Iterable[str]) -> PlainTable:
        """Return the table of rows, with columns of these names, then of all others."""
        every = dict.fromkeys([*names, *(name for row in rows for name in row)])
        return cls({name: [_plain(row.get(name)) for row in rows] for name in every})

    @classmethod
    def joined(cls, tables: Sequence[PlainTable]) -> PlainTable:
        """Return the rows of all tables, in their order."""
        return cls.of_rows([row for table in tables for row in table.to_pylist()], ())

    @classmethod
    def read(cls, content: bytes, columns: Sequence[str] | None = None) -> PlainTable:
        """Return the table that `packed` wrote, or some columns; all without rows for []. ValueError if damaged."""
        names, *rows = csv.reader(io.StringIO(content.decode(), newline=""), strict=True)
        if not content.endswith(b"\n") or any(len(row) != len(names) for row in rows):
            raise ValueError("its last line is not whole")
        if columns == []:
            return cls(dict.fromkeys(names, ()))
        chosen = names if columns is None else [name for name in columns if name in names]
        return cls({name: _read(name, [row[names.index(name)] for row in rows]) for name in chosen})

    def packed(self) -> bytes:
        """Return it as CSV: an empty field for a missing value, a list as JSON."""
        text = io.StringIO(newline="")
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(self.names)
        writer.writerows([map(_text, row) for row in zip(*self._columns.values(), strict=True)])
        return text.getvalue().encode()

    @property
    def schema(self) -> PlainTable:
        """The table itself, because it has the names of the columns."""
        return self

    @property
    def names(self) -> list[str]:
        """The names of the columns."""
        return list(self._columns)

    @property
    def columns(self) -> list[Column]:
        """The columns."""
        return list(self._columns.values())

    @property
    def num_rows(self) -> int:
        """Number of rows."""
        return len(next(iter(self._columns.values()), ()))

    def __getitem__(self, name: str) -> Column:
        return self._columns[name]

    def filter(self, chosen: Sequence[bool]) -> PlainTable:
        """Return the chosen rows."""
        return PlainTable({name: compress(column, chosen) for name, column in self._columns.items()})

    def take(self, places: Iterable[int]) -> PlainTable:
        """Return the rows at some places, in their order."""
        listed = list(places)
        return PlainTable({name: [column[i] for i in listed] for name, column in self._columns.items()})

    def slice(self, first: int, length: int) -> PlainTable:
        """Return `length` rows from `first` on."""
        return self.take(range(first, first + length))

    def sort_by(self, name: str) -> PlainTable:
        """Return the rows in the order of a column's values."""
        return self.take(np.argsort(self[name].to_numpy(), kind="stable").tolist())

    def to_pylist(self) -> list[dict[str, Any]]:
        """Return the rows."""
        return [dict(zip(self._columns, row, strict=True)) for row in zip(*self._columns.values(), strict=True)]

    def to_pandas(self) -> Any:
        """Return a ``pandas.DataFrame``."""
        import pandas as pd  # pyright: ignore[reportMissingImports]

        return pd.DataFrame(self._columns)


def _plain(value: Any) -> Any:
    return value.tolist() if isinstance(value, np.ndarray | np.generic) else value


def _text(value: Any) -> str:
    if value is None:
        return ""
    return json.dumps(value) if isinstance(value, list) else str(value)


def _read(name: str, texts: Sequence[str]) -> list[Any]:
    for read in () if name in TEXTS else _READERS:
        try:
            return [read(text) if text else None for text in texts]
        except (ValueError, KeyError):
            continue
    return [text or None for text in texts]
