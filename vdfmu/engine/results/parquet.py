"""Results in Parquet: the numbers of CSV in a third of the space, and the run's summary in the same file.

Columns are ``time`` and the signals. A column's metadata contains its ``unit``, the file's metadata ``vdfmu``, the
summary as JSON. Columns are compressed, and bytes of reals are split (BYTE_STREAM_SPLIT). pyarrow is imported on use.
"""

from __future__ import annotations

from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vdfmu.base.errors import UsageError
from vdfmu.base.files import read_json, replacing
from vdfmu.base.foreign import Foreign, NamedArray, imported, read_foreign
from vdfmu.base.text import to_json
from vdfmu.engine.results.arrays import no_rows
from vdfmu.engine.results.formats import Format
from vdfmu.engine.results.results import KINDS, TYPES, Recorded, Signal

_GROUP = 2**16
"""Rows of a compressed group, which is the part of a long run in memory."""
_KEY = b"vdfmu"
_KINDS = {"double": "real", "int32": "integer", "bool": "boolean"}
"""Kinds of signals by the type of their column."""


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
    """Return a column of pyarrow without its own conversion, which would import pandas slowly."""
    kinds = {"f": pa.float64(), "i": pa.int32(), "b": pa.bool_()}
    values = np.packbits(column, bitorder="little") if column.dtype.kind == "b" else np.ascontiguousarray(column)
    return pa.Array.from_buffers(kinds[column.dtype.kind], len(column), [None, pa.py_buffer(values)])


def read_parquet(path: Path) -> Recorded:
    """Read a file of `write_parquet`, or another Parquet file with ``time`` in the first column."""
    return parquet_results(read_foreign(path))


def parquet_results(content: Foreign) -> Recorded:
    """Return the results in the content of a Parquet file."""
    time, *columns = content.blocks or [NamedArray([], np.empty(0), "")]
    unfit = [name for block in columns if block.kind not in _KINDS for name in block.names]
    if time.names != ["time"] or time.kind != "double" or unfit or content.left_out:
        got = [*map(repr, unfit), *content.left_out] or [repr(name) for name in time.names]
        raise UsageError(
            f"{content.path}: expected 'time' as the first column, and columns of float64, int32 and bool; "
            f"got {', '.join(got) or 'no columns of numbers'}."
        )
    try:
        summary = dict(read_json(content.texts.get(_KEY.decode(), "{}")))
    except (TypeError, ValueError):  # not ours
        summary = {}
    data = {kind: np.empty((len(time.values), 0), TYPES[kind]) for kind in KINDS}
    places: dict[str, tuple[str, int]] = {}
    for block in columns:
        kind = _KINDS[block.kind]
        data[kind] = block.values
        places |= {name: (kind, i) for i, name in enumerate(block.names)}
    signals = [
        Signal(name, places[name][0], content.units.get(name, ""), places[name][1]) for name in content.names[1:]
    ]
    return Recorded(time.values[:, 0], signals, data, summary)


FORMAT = Format(needed, write_parquet, read_parquet)
