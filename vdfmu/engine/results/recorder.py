"""Rows of a run in memory or on disk: as text that survives a crash, and as numbers for memory maps."""

from __future__ import annotations

import math
import tempfile
import time as clock
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from vdfmu.base.arrays import Floats
from vdfmu.base.errors import LOG
from vdfmu.base.files import write_all
from vdfmu.engine.masters.exchange import row_store
from vdfmu.engine.plan.grid import Grid
from vdfmu.engine.results.arrays import no_rows
from vdfmu.engine.results.formats import Stream, format_of
from vdfmu.engine.results.results import Signal

ROWS = 512
"""Most rows in memory, except in a run in real time."""
SECONDS = 2.0
"""Longest time [s] that a row stays in memory if another follows."""


class RowsInMemory:
    """Keeps all rows in memory.

    `columns` are the places of the signals in their bank by kind, and `data` their rows. `put` stores a row.
    """

    seconds = 0.0
    """Wall time that writing took [s]."""

    def __init__(
        self, data: Mapping[str, NDArray[Any]], columns: Mapping[str, Sequence[int]], put: Callable[[int], None]
    ) -> None:
        self.data, self.columns, self._put = data, columns, put

    def keep(self, k: int) -> None:
        """Store the next row, `k`."""
        self._put(k - self.room(k)[0])

    def room(self, k: int) -> tuple[int, int]:
        """Make room for the next row, `k`; return the first row in memory, and the first that does not fit."""
        return 0, k + ROWS

    def finish(self, time: Floats) -> Mapping[str, NDArray[Any]]:
        """Return the rows up to the last `time` by kind."""
        return {kind: array[: len(time)] for kind, array in self.data.items()}


class Tap:
    """Reads the components of a run in some rows, and signals in all rows, without changing the run."""

    wanted: Sequence[str] = ()
    """Names of real signals for `block`, with ``*`` for any text; they need not exist."""
    size = 1024
    """Number of rows of a block."""

    def begin(self, grid: Grid, names: Sequence[str]) -> None:
        """Begin a run; `names` are the existing signals of `wanted`."""

    def due(self, k: int) -> float:
        """Return the next row for `take`, `k` or a later one; by default none."""
        return math.inf

    def take(self, k: int, time: float, components: Any) -> None:
        """Read the components in row `k`, at a time [s]."""

    def block(self, times: Floats, values: Floats) -> None:
        """Read the signals (m, names) in the next m rows: `size` of them, or the last ones."""


class Blocks(RowsInMemory):
    """Passes the rows of the requested signals to a tap, block by block."""

    def __init__(self, tap: Tap, grid: Grid, names: Sequence[str], memory: Floats, places: Sequence[int]) -> None:
        rows = np.empty((tap.size, len(names)))
        super().__init__({"real": rows}, {"real": places}, row_store(rows, memory, places))
        self._tap, self._rows, self._times, self._first = tap, rows, grid.times, 0

    def room(self, k: int) -> tuple[int, int]:
        """See `RowsInMemory.room`."""
        if k - self._first == len(self._rows):
            self.flush(k)
        return self._first, self._first + len(self._rows)

    def flush(self, end: int) -> None:
        """Pass the remaining rows before row `end` to the tap."""
        if end > self._first:
            self._tap.block(self._times(self._first, end), self._rows[: end - self._first])
            self._first = end


_LARGE = 1_000_000_000
"""Size [bytes] from which a file is announced before it is written."""
_REAL, _OTHER = 20, 3
"""Bytes of a value in CSV with its comma: a real number mostly has 16 or 17 digits, with point, exponent and sign."""


def announce_size(paths: Sequence[Path], signals: Sequence[Signal], rows: int) -> None:
    """Warn of a text file that will be larger than 1 GB before its first row."""
    reals = sum(signal.kind == "real" for signal in signals) + 1  # and the time
    size = rows * (_REAL * reals + _OTHER * (len(signals) + 1 - reals))
    for path in paths:
        if size > _LARGE and format_of(path).streams:
            LOG.warning(
                "%s will be about %.2g GB (%d signals at %d times). --format parquet takes about a third of that; "
                "--record writes fewer signals.", path.name, 1e-9 * size, len(signals), rows,
            )  # fmt: skip


class Recorder(RowsInMemory):
    """Writes rows to disk block by block, at least every `longest` [s].

    Existing result files `paths` are replaced. A file whose format does not stream is written after the run; until then
    the numbers are in its folder. `data` is the block by kind, (rows, columns). ``put(i)`` stores the current signals
    in its row i, and ``times(first, end)`` returns the times [s] of rows.

    Every method raises VdfmuError if a file cannot be written; then the file has all complete blocks.
    """

    def __init__(
        self,
        paths: Sequence[Path],
        signals: Sequence[Signal],
        data: Mapping[str, NDArray[Any]],
        columns: Mapping[str, Sequence[int]],
        put: Callable[[int], None],
        times: Callable[[int, int], Floats],
        longest: float = SECONDS,
    ) -> None:
        super().__init__(data, columns, put)
        streams = [(path, stream) for path in paths if (stream := format_of(path).streams)]
        self._path = streams[0][0] if streams else paths[0]
        self._signals = signals
        self._times = times
        self._first, self._rows, self._longest = 0, min(map(len, data.values()), default=ROWS), longest
        self._due = clock.perf_counter() + longest
        self._files: dict[str, BinaryIO] = {}
        self._texts: list[tuple[BinaryIO, Stream]] = []
        try:
            for path, stream in streams:
                file = open(path, "wb", buffering=0)  # noqa: SIM115 - closed with the recorder
                self._texts.append((file, stream))
                write_all(file, stream.head(self._signals).encode())
            for kind, block in data.items():
                if block.shape[1]:
                    self._files[kind] = tempfile.TemporaryFile(dir=self._path.parent, buffering=0)  # noqa: SIM115
        except OSError as error:
            raise no_rows(self._path, error) from error

    def room(self, k: int) -> tuple[int, int]:
        """See `RowsInMemory.room`."""
        if k - self._first == self._rows or clock.perf_counter() > self._due:
            self._flush(self._times(self._first, k))
        return self._first, self._first + self._rows

    def finish(self, time: Floats) -> dict[str, NDArray[Any]]:
        """Write the remaining rows, up to the last `time`; return all rows by kind, mapped from disk."""
        self._flush(time[self._first :])
        rows: dict[str, NDArray[Any]] = {}
        try:
            for file, _ in self._texts:
                file.close()
            for kind, block in self.data.items():
                shape = len(time), block.shape[1]
                if 0 in shape:
                    rows[kind] = np.empty(shape, block.dtype)
                else:
                    rows[kind] = np.memmap(self._files[kind], block.dtype, "c", shape=shape)
                    self._files[kind].close()  # the mapping stays valid
        except OSError as error:
            raise no_rows(self._path, error) from error
        return rows

    def _flush(self, time: Floats) -> None:
        began = clock.perf_counter()
        rows = slice(0, len(time))
        texts = (file for file, _ in self._texts)
        before = [(file, file.tell()) for file in (*texts, *self._files.values())]
        try:
            for file, stream in self._texts:
                write_all(file, stream.lines(time, self._signals, self.data, rows).encode())
            for kind, file in self._files.items():
                write_all(file, self.data[kind][rows].tobytes())
        except BaseException as error:  # even after a second Ctrl-C
            for file, position in before:
                with suppress(OSError):  # on the same disk
                    file.truncate(position)
                    file.seek(position)
            if isinstance(error, OSError):
                raise no_rows(self._path, error) from error
            raise
        self._first += len(time)
        now = clock.perf_counter()
        self.seconds += now - began
        self._due = now + self._longest
