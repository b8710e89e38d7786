"""Files of other tools, read with the libraries of their formats in a process with limited memory and time.

Given a damaged file, these libraries may crash, hang or take all memory. Then only the reading process ends, and this
one reports it. It returns arrays in files, and names and texts as JSON, and serves until this process ends.
"""

from __future__ import annotations

import atexit
import math
import os
import threading
from collections.abc import Mapping, Sequence
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vdfmu.base.errors import UsageError
from vdfmu.base.files import no_temporary, open_regular, temporary_folder
from vdfmu.base.process import Child, ending

LEAST, RATIO = 256 * 2**20, 20
"""Bytes that any file may unpack to, and the largest ratio for a larger one: logs of float64 compress 2 to 4 times."""
SECONDS, RATE = 60.0, 10e6
"""Time limit [s] of reading a file, and the bytes for which the limit grows by a second."""
_IN_MEMORY = 2**25
"""Largest size [byte] of arrays kept in memory; larger ones are memory-mapped."""
TITLES = {
    ".mat": "MATLAB file",
    ".npz": "file of numpy",
    ".h5": "HDF5 file",
    ".hdf5": "HDF5 file",
    ".parquet": "Parquet file",
}
"""Suffix of each format to the name of its files in messages."""
ARROW = "table.arrow"
"""File name of a table that is returned whole."""


class NamedArray(NamedTuple):
    """An array of a file, or columns (m, k) of one type."""

    names: list[str]
    """Name of the array, or the names of the columns."""
    values: NDArray[Any]
    kind: str
    """Type of columns in Arrow, such as ``double``; empty for an array."""


class Foreign(NamedTuple):
    """Numbers of a file of another tool."""

    path: Path
    names: Sequence[str]
    """Names of the arrays, in their order in the file; fields of structs as ``rec.position``."""
    blocks: list[NamedArray]
    texts: Mapping[str, str]
    """Texts by variable name."""
    units: Mapping[str, str]
    """Units by column, of columns that state one."""
    left_out: Sequence[str]
    """Variables that are neither numbers nor texts, with their kind in brackets."""

    @property
    def arrays(self) -> dict[str, NDArray[Any]]:
        """Arrays by name."""
        arrays = {
            name: block.values[:, i] if block.kind else block.values
            for block in self.blocks
            for i, name in enumerate(block.names)
        }
        return {name: arrays[name] for name in self.names}

    def listed(self) -> str:
        """Return the names of the arrays and of the ignored content, for a message."""
        there = f"there are {', '.join(self.names)}" if self.blocks else "it has no arrays of numbers"
        return f"{there}; ignored: {', '.join(self.left_out)}" if self.left_out else there


class _Reader(NamedTuple):
    child: Child
    thread: threading.Thread
    """Thread that started the process: on Linux both end together."""
    process: int
    """ID of the starting process; after a fork the ID differs."""


_LOCK = threading.Lock()
_READERS: list[_Reader] = []
"""The reading process, if it has been started."""


def imported(feature: str, package: str, extra: str, *modules: str) -> tuple[ModuleType, ...]:
    """Import modules of the optional package of a format. UsageError if it is not installed."""
    try:
        return tuple(import_module(module) for module in modules)
    except ImportError as error:
        raise UsageError(
            f"{feature} needs the package {package}, which cannot be imported: {error}. Install it with "
            f"'pip install vdfmu[{extra}]'. Runs can also write CSV, which needs no package: --format csv."
        ) from None


def read_foreign(path: Path) -> Foreign:
    """Read the numbers of a file of one of the formats in `TITLES`, by its suffix.

    Links to other files, objects, cells and other content without numbers are ignored. UsageError if the file cannot be
    read, unpacks to more than its limit, or crashes the reading process. StorageError if the temporary folder is too
    small for its numbers.
    """
    with temporary_folder("vdfmu_read_") as folder:
        reply = _answer(path, TITLES[path.suffix.lower()], folder, None)
        blocks = _blocks(Path(folder), reply["blocks"])
    return Foreign(path, reply["names"], blocks, reply["texts"], reply["units"], reply["left_out"])


def read_arrow(path: Path, columns: Sequence[str] | None = None) -> bytes:
    """Return a Parquet file, or some of its columns, as a file of Arrow's format; errors as `read_foreign`."""
    with temporary_folder("vdfmu_read_") as folder:
        _answer(path, "Parquet file", folder, "all" if columns is None else [*columns])
        return Path(folder, ARROW).read_bytes()


def _answer(path: Path, title: str, folder: str, columns: Any) -> dict[str, Any]:
    """Return the answer of the reading process."""
    try:
        with open_regular(path) as file:
            size = os.fstat(file.fileno()).st_size
    except OSError as error:
        raise UsageError(f"cannot read {path}: {error.strerror or error}") from None
    most = max(LEAST, RATIO * size)
    with _LOCK:
        child = _child()
        child.limit = SECONDS + size / RATE
        try:
            child.send((str(path.absolute()), folder, most, columns))
            reply = child.take()
        except EOFError:
            raise UsageError(f"{path}: expected a {title}, but {_lost(child)}") from None
        except BaseException:
            _end()
            raise
    if reply["full"]:
        raise no_temporary(str(path), reply["full"])
    if reply["fault"]:
        got = "" if reply["said"] else f"expected a {title}, got unreadable content: "
        raise UsageError(f"{path}: {got}{reply['fault']}")
    return reply


def _blocks(folder: Path, listed: Sequence[Any]) -> list[NamedArray]:
    """Return the arrays in the files of a folder, in memory or mapped."""
    blocks: list[NamedArray] = []
    for names, kind, number, shape, file, offset in listed:
        place, dtype = folder / os.path.basename(file), np.dtype(number)
        count = math.prod(shape)
        if count * dtype.itemsize > _IN_MEMORY and os.name == "posix":  # Windows cannot remove mapped files
            values: NDArray[Any] = np.memmap(place, dtype, "c", offset, tuple(shape))
        else:
            values = np.fromfile(place, dtype, count, offset=offset).reshape(shape)
        blocks.append(NamedArray(names, values, kind))
    return blocks


def _child() -> Child:
    """Return the reading process; start it if there is none."""
    for reader in [*_READERS]:
        if reader.process == os.getpid() and reader.thread.is_alive() and reader.child.alive:
            return reader.child
        _end()
    child = Child("vdfmu.base.foreign_reader", limit=SECONDS)
    _READERS.append(_Reader(child, threading.current_thread(), os.getpid()))
    return child


@atexit.register
def _end() -> None:
    """End the reading process if this process started one."""
    while _READERS:
        reader = _READERS.pop()
        if reader.process == os.getpid():
            reader.child.kill()
            reader.child.end()


def _lost(child: Child) -> str:
    """Return why the reading process has ended."""
    _READERS.clear()
    code, peak, output = child.end()
    how, killed = ending(code)
    if child.late:
        return f"it could not be read within {child.limit:g} s. Export a shorter part of it."
    if killed:
        return f"the process that reads it was killed ({how}). Repeat the command."
    last = "".join(f": {line.strip()[:200]}" for line in output.strip().splitlines()[-1:])
    memory = f", with {peak:.0f} MB of memory" if peak > 2**9 else ""
    return f"its content crashed the library that reads it ({how}{memory}{last}). Save it again, or a part of it."
