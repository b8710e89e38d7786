"""Results in Parquet: the numbers of CSV in a third of the room, with the summary of the run in the same file.

Columns are ``time`` and the signals. The metadata of a column has its ``unit``, the file's metadata has ``vdfmu``, the
summary as JSON. Columns are compressed, reals as split bytes (BYTE_STREAM_SPLIT). pyarrow is imported on use.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vdfmu.base.arrays import Floats
from vdfmu.base.errors import UsageError
from vdfmu.base.files import replacing
from vdfmu.base.text import to_json
from vdfmu.base.unpack import UnpackBudget, imported
from vdfmu.engine.results.arrays import grouped, joined, no_rows, placed_arrays
from vdfmu.engine.results.formats import Format
from vdfmu.engine.results.results import Recorded, Signal

_GROUP = 2**16
"""Rows of a compressed group, the part of a long run in memory."""
_KEY = b"vdfmu"
_WIDTHS = {"BOOLEAN": 1, "INT32": 4, "INT64": 8, "INT96": 12, "FLOAT": 4, "DOUBLE": 8}
"""Bytes of a number in memory, by its type in the file; the file states the size of texts and lists."""


def needed() -> tuple[ModuleType, ...]:
    """Return pyarrow and its module for Parquet; UsageError if it is not installed."""
    return imported("Parquet", "pyarrow", "parquet", "pyarrow", "pyarrow.parquet")


def write_parquet(results: Recorded, path: Path) -> None:
    """Write the signals and the summary."""
    pa, parquet = needed()
    signals = [Signal("time", "real", "s", 0), *results.signals]
    types = {"real": pa.float64(), "integer": pa.int32(), "boolean": pa.bool_()}
    fields = [pa.field(s.name, types[s.kind], nullable=False, metadata={"unit": s.unit}) for s in signals]
    schema = pa.schema(fields, metadata={_KEY: to_json(results.summary)})
    reals = {s.name: "BYTE_STREAM_SPLIT" for s in signals if s.kind == "real"}
    options = {"use_dictionary": [s.name for s in signals if s.kind != "real"], "column_encoding": reals}
    try:
        with replacing(path) as file, parquet.ParquetWriter(file, schema, **options) as writer:
            for block in results.blocks(_GROUP):
                columns = [block.time, *(block[s.name] for s in signals[1:])]
                arrays = [_array(pa, column) for column in columns]
                writer.write_table(pa.Table.from_arrays(arrays, schema=schema))
    except OSError as error:
        raise no_rows(path, error) from None


def _array(pa: ModuleType, column: NDArray[Any]) -> Any:
    """Return a column of pyarrow, without the slow import of pandas by its own conversion."""
    kinds = {"f": pa.float64(), "i": pa.int32(), "b": pa.bool_()}
    values = np.packbits(column, bitorder="little") if column.dtype.kind == "b" else np.ascontiguousarray(column)
    return pa.Array.from_buffers(kinds[column.dtype.kind], len(column), [None, pa.py_buffer(values)])


def checked(path: Path, file: Any) -> Any:
    """Return a ``ParquetFile``; UsageError, before it is read, if its columns unpack to more than a budget."""
    budget, facts = UnpackBudget(path), file.metadata
    for group in map(facts.row_group, range(facts.num_row_groups)):
        for column in map(group.column, range(facts.num_columns)):
            size = _WIDTHS.get(column.physical_type, 0) * max(group.num_rows, column.num_values)
            budget.spend(max(size, column.total_uncompressed_size))
    return file


def read_table(path: Path) -> tuple[Any, Any]:
    """Return the schema of a Parquet file of any tool, and a ``pyarrow.Table`` of its columns of numbers and times."""
    pa, parquet = needed()
    try:
        with open(path, "rb") as stream:
            file = checked(path, parquet.ParquetFile(stream))
            columns = [field.name for field in file.schema_arrow if pa.types.is_primitive(field.type)]
            return file.schema_arrow, file.read(columns, use_threads=False)  # threads hang where memory is short
    except (OSError, pa.ArrowException) as error:
        raise UsageError(f"cannot read {path}: {getattr(error, 'strerror', None) or error}") from None


def read_parquet(path: Path) -> Recorded:
    """Read what `write_parquet` wrote."""
    pa, parquet = needed()
    try:
        with open(path, "rb") as file:
            table = checked(path, parquet.ParquetFile(file))
            schema = table.schema_arrow
            kinds = {pa.float64(): "real", pa.int32(): "integer", pa.bool_(): "boolean"}
            _require(path, schema.names, [f.name for f in schema if f.type not in kinds])
            try:
                summary = json.loads((schema.metadata or {}).get(_KEY, b"{}"))
            except (ValueError, RecursionError):  # not ours
                summary = {}
            signals = [
                Signal(f.name, kinds[f.type], (f.metadata or {}).get(b"unit", b"").decode(), 0)
                for f in list(schema)[1:]
            ]
            placed, empty = placed_arrays(signals, [np.empty((0, len(each))) for each in grouped(signals).values()])

            def blocks() -> Iterator[tuple[Floats, dict[str, NDArray[Any]]]]:
                yield np.empty(0), empty
                for batch in table.iter_batches(_GROUP, use_threads=False):  # threads hang where memory is short
                    _require(path, schema.names, [name for name in schema.names if batch[name].null_count])
                    columns = {name: batch[name].to_numpy(zero_copy_only=False) for name in schema.names}
                    arrays = [np.column_stack([columns[s.name] for s in each]) for each in grouped(signals).values()]
                    yield columns["time"], placed_arrays(signals, arrays)[1]

            return joined(path, blocks(), placed, summary)
    except (OSError, pa.ArrowException) as error:
        raise UsageError(f"cannot read {path}: {getattr(error, 'strerror', None) or error}") from None


def _require(path: Path, names: Sequence[str], wrong: Sequence[str]) -> None:
    if names[:1] != ["time"] or wrong:
        raise UsageError(
            f"{path}: expected 'time' as the first column, and columns of float64, int32 and bool without gaps; "
            f"got {', '.join(f'{name!r}' for name in wrong or names[:1])}"
        )


FORMAT = Format(needed, write_parquet, read_parquet)
