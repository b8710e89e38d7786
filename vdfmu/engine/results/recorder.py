"""Rows of a run on their way to disk: as text, which a crash leaves, and as numbers that are read back in place."""

from __future__ import annotations

import tempfile
import time as clock
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from vdfmu.base.arrays import Floats
from vdfmu.engine.masters.observer import Tap
from vdfmu.engine.results.arrays import no_rows
from vdfmu.engine.results.formats import Stream, format_of
from vdfmu.engine.results.results import Signal

ROWS = 512
"""Most rows that are kept in memory, except in a run that is held back to the clock."""
SECONDS = 2.0
"""Longest time that a row is kept in memory, if another follows."""


class RowsInMemory(Tap):
    """Keeps all rows in memory: `put` stores the current signals in a row of `data`, arrays by kind."""

    seconds = 0.0
    """Wall time that writing took [s]."""

    def __init__(self, data: Mapping[str, NDArray[Any]], put: Callable[[int], None]) -> None:
        self._data, self._put = data, put

    def take(self, k: int, time: float, components: Any) -> None:
        """Store row `k`."""
        self._put(k)

    def finish(self, time: Floats) -> Mapping[str, NDArray[Any]]:
        """Return the rows up to the last `time`, by kind."""
        return {kind: array[: len(time)] for kind, array in self._data.items()}


class Recorder(RowsInMemory):
    """Writes rows to disk block by block, at least every two seconds or the time that is given.

    Parameters
    ----------
    paths : sequence of Path
        The files of results; existing ones are replaced. One whose format does not stream is only named in
        messages, and the numbers go to its folder: it is written when all rows are there.
    signals : sequence of Signal
    data : mapping of str to (rows, columns) array
        The block, by kind.
    put : callable
        Called as ``put(i)`` to store the current signals in row `i` of the block.
    times : callable
        Called as ``times(first, end)``: the times [s] of the rows from `first` to before `end`, (end - first,).
    longest : float [s]
        Longest wall time that a row is kept in memory, if another follows.

    Raises
    ------
    VdfmuError
        From every method: the disk is full, or the file cannot be written. All complete blocks are in it.
    """

    def __init__(
        self,
        paths: Sequence[Path],
        signals: Sequence[Signal],
        data: Mapping[str, NDArray[Any]],
        put: Callable[[int], None],
        times: Callable[[int, int], Floats],
        longest: float = SECONDS,
    ) -> None:
        super().__init__(data, put)
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
                self._write(file, stream.head(self._signals).encode())
            for kind, block in data.items():
                if block.shape[1]:
                    self._files[kind] = tempfile.TemporaryFile(dir=self._path.parent, buffering=0)  # noqa: SIM115
        except OSError as error:
            raise no_rows(self._path, error) from error

    def take(self, k: int, time: float, components: Any) -> None:
        """Store row `k`, the one after the last."""
        if k - self._first == self._rows or clock.perf_counter() > self._due:
            self._flush(self._times(self._first, k))
        self._put(k - self._first)

    def finish(self, time: Floats) -> dict[str, NDArray[Any]]:
        """Write the remaining rows, up to the last `time`; return all of them, by kind, from disk."""
        self._flush(time[self._first :])
        for file, _ in self._texts:
            file.close()
        found: dict[str, NDArray[Any]] = {}
        for kind, block in self._data.items():
            shape = len(time), block.shape[1]
            if 0 in shape:
                found[kind] = np.empty(shape, block.dtype)
            else:
                found[kind] = np.memmap(self._files[kind], block.dtype, "c", shape=shape)
                self._files[kind].close()  # the map stays
        return found

    def _flush(self, time: Floats) -> None:
        began = clock.perf_counter()
        rows = slice(0, len(time))
        texts = (file for file, _ in self._texts)
        before = [(file, file.tell()) for file in (*texts, *self._files.values())]
        try:
            for file, stream in self._texts:
                self._write(file, stream.lines(time, self._signals, self._data, rows).encode())
            for kind, file in self._files.items():
                self._write(file, self._data[kind][rows].tobytes())
        except BaseException as error:  # a second Ctrl-C too
            for file, position in before:
                file.truncate(position)
                file.seek(position)
            if isinstance(error, OSError):
                raise no_rows(self._path, error) from error
            raise
        self._first += len(time)
        now = clock.perf_counter()
        self.seconds += now - began
        self._due = now + self._longest

    @staticmethod
    def _write(file: BinaryIO, content: bytes) -> None:
        rest = memoryview(content)
        while rest:
            rest = rest[file.write(rest) :]
