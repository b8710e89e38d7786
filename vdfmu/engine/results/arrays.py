"""Arrays and names of result files: signals by group, the summary as JSON, and rows that are read block by block."""

from __future__ import annotations

import tempfile
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from vdfmu.base.arrays import Floats
from vdfmu.base.errors import VdfmuError
from vdfmu.base.files import no_temporary, write_all
from vdfmu.engine.results.results import KINDS, TYPES, Recorded, Signal, group_of

_MOST = 2**25
"""Bytes of numbers kept in memory."""


def joined(
    path: Path, blocks: Iterable[tuple[Floats, Mapping[str, NDArray[Any]]]], signals: Sequence[Signal], summary: Any
) -> Recorded:
    """Return the rows of one or more blocks of times and data; StorageError if the temporary folder is too small."""
    times: list[Floats] = []
    kept: dict[str, list[NDArray[Any]]] = {kind: [] for kind in KINDS}
    files: dict[str, IO[bytes]] = {}
    try:
        for time, data in blocks:
            times.append(time)
            for kind, array in data.items():
                kept[kind].append(array)
            if sum(array.nbytes for arrays in kept.values() for array in arrays) > _MOST:
                _move(path, kept, files)
        if files:
            _move(path, kept, files)
        time = np.concatenate(times)
        rows: dict[str, NDArray[Any]] = {
            kind: np.memmap(files[kind], arrays[0].dtype, "c", shape=(len(time), arrays[0].shape[1]))
            if kind in files
            else np.concatenate(arrays)
            for kind, arrays in kept.items()
        }
        return Recorded(time, signals, rows, summary)
    finally:
        for file in files.values():
            file.close()  # a mapping stays valid


def _move(path: Path, kept: Mapping[str, list[NDArray[Any]]], files: dict[str, IO[bytes]]) -> None:
    """Move blocks to the files of their kinds; an empty block of each remains, for the number of its columns."""
    try:
        for kind, arrays in kept.items():
            if arrays[0].shape[1]:
                file = files[kind] = files.get(kind) or tempfile.TemporaryFile(buffering=0)  # noqa: SIM115
                for array in arrays:
                    write_all(file, array.tobytes())
            arrays[:] = [arrays[0][:0].copy()]
    except OSError as error:
        raise no_temporary(str(path), error) from None


def grouped(signals: Sequence[Signal]) -> dict[tuple[str, str], list[Signal]]:
    """Return the signals of each array by its name and kind."""
    groups: dict[tuple[str, str], list[Signal]] = {}
    for signal in signals:
        groups.setdefault((group_of(signal.name)[0], signal.kind), []).append(signal)
    return groups


def placed_arrays(
    signals: Sequence[Signal], arrays: Sequence[NDArray[Any]]
) -> tuple[list[Signal], dict[str, NDArray[Any]]]:
    """Return signals with their columns, and the data by kind, from one array (m, n) per group of `grouped`."""
    columns = {
        signal.name: array[:, i]
        for members, array in zip(grouped(signals).values(), arrays, strict=True)
        for i, signal in enumerate(members)
    }
    placed: list[Signal] = []
    chosen: dict[str, list[NDArray[Any]]] = {kind: [] for kind in KINDS}
    for signal in signals:
        placed.append(signal._replace(column=len(chosen[signal.kind])))
        chosen[signal.kind].append(columns[signal.name])
    empty = np.empty((len(arrays[0]) if arrays else 0, 0))
    return placed, {kind: np.column_stack([empty, *each]).astype(TYPES[kind]) for kind, each in chosen.items()}


def no_rows(path: Path, error: OSError) -> VdfmuError:
    """Return the error for rows that cannot be written."""
    return VdfmuError(
        f"{path}: the rows cannot be written: {error.strerror or error}. Free space, or choose another folder with "
        "--out."
    )
