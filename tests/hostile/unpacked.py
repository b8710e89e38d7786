"""Corpus: logs and matrices that unpack to gigabytes, never end, or take in other files."""

import struct
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pyarrow as pa
import pyarrow.parquet as parquet
from scipy.io import savemat

from tests.hostile.table import Corpus
from vdfmu.base.errors import UsageError
from vdfmu.base.foreign import read_foreign

_MIB = 2**20


def _tree(path: Path, fill: Callable[[h5py.File], object]) -> Path:
    """Write a MATLAB file of version 7.3."""
    path = path / "log.mat"
    with h5py.File(path, "w", userblock_size=512) as file:
        file["time"] = np.arange(5.0)
        fill(file)
    with path.open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\0\2IM")
    return path


def doubled_links(path: Path, mebibytes: int) -> Path:
    """Write groups with two links each to the next: 2^40 ways to the last."""

    def fill(group: h5py.Group) -> None:
        for _ in range(40):
            inner = group.create_group("a")
            group["b"] = inner
            group = inner

    return _tree(path, fill)


def circle(path: Path, mebibytes: int) -> Path:
    """Write a group that is in itself."""
    return _tree(path, lambda file: file.create_group("a").__setitem__("a", file["a"]))


def many_links(path: Path, mebibytes: int) -> Path:
    """Write very many links to one array."""
    return _tree(path, lambda file: [file.__setitem__(f"x{k}", file["time"]) for k in range(10_000)])


def outer_link(path: Path, mebibytes: int) -> Path:
    """Write a link to an array of another file."""
    return _tree(path, lambda file: file.__setitem__("x", h5py.ExternalLink("/etc/passwd", "x")))


def outer_bytes(path: Path, mebibytes: int) -> Path:
    """Write an array whose numbers are the bytes of another file."""
    return _tree(path, lambda file: file.create_dataset("x", (5,), "f8", external=[("/etc/passwd", 0, 40)]))


def outer_array(path: Path, mebibytes: int) -> Path:
    """Write an array that is put together from arrays of other files."""
    layout = h5py.VirtualLayout((5,), "f8")
    layout[:] = h5py.VirtualSource("other.h5", "x", (5,))
    return _tree(path, lambda file: file.create_virtual_dataset("x", layout))


def large_array(path: Path, mebibytes: int) -> Path:
    """Write an array of which nothing is stored."""
    return _tree(path, lambda file: file.create_dataset("x", (mebibytes, _MIB), "u1", chunks=(1, _MIB)))


def small_chunks(path: Path, mebibytes: int) -> Path:
    """Write an array of very many chunks, of which none is stored."""
    return _tree(path, lambda file: file.create_dataset("x", (mebibytes * 1024,), "u1", chunks=(1,)))


def large_chunk(path: Path, mebibytes: int) -> Path:
    """Write an array of 40 bytes, whose only chunk unpacks to more."""

    def fill(file: h5py.File) -> None:
        array = file.create_dataset("x", (5,), "f8", chunks=(5,), compression="gzip")
        array.id.write_direct_chunk((0,), zlib.compress(bytes(mebibytes * _MIB)))

    return _tree(path, fill)


def other_filter(path: Path, mebibytes: int) -> Path:
    """Write an array that is packed by another method."""
    return _tree(path, lambda file: file.create_dataset("x", data=np.zeros(1000), compression="lzf"))


def element(kind: int, content: bytes) -> bytes:
    return struct.pack("<II", kind, len(content)) + content + bytes(-len(content) % 8)


def _matrix(kind: int, name: bytes, inside: bytes) -> bytes:
    head = element(6, struct.pack("<II", kind, 0)) + element(5, struct.pack("<ii", 1, 1)) + element(1, name)
    return element(14, head + inside)


def _version_5(path: Path, matrix: bytes) -> Path:
    path, packed = path / "log.mat", zlib.compress(matrix)
    path.write_bytes(b"MATLAB 5.0 MAT-file".ljust(124) + b"\0\1IM" + struct.pack("<II", 15, len(packed)) + packed)
    return path


def zeros(path: Path, mebibytes: int) -> Path:
    """Write zeros, packed."""
    return _version_5(path, _matrix(6, b"x", element(9, bytes(mebibytes * _MIB))))


def wider(path: Path, mebibytes: int) -> Path:
    """Write zeros of one byte of an array of doubles."""
    return _version_5(path, _matrix(6, b"x", element(2, bytes(mebibytes * _MIB // 4))))


def nested(path: Path, mebibytes: int) -> Path:
    """Write structs within structs."""
    field = struct.pack("<HHI", 5, 4, 2) + element(1, b"x\0")
    head, matrix = _matrix(2, b"", field)[8:], b""
    heads: list[bytes] = []
    size = len(matrix)
    for _ in range(5_000):
        size += len(head)
        heads.append(struct.pack("<II", 14, size) + head)
        size += 8
    return _version_5(path, b"".join(reversed(heads)))


def columns(path: Path, mebibytes: int) -> Path:
    """Write a Parquet file of one number, again and again."""
    path = path / "log.parquet"
    table = pa.table({"time": np.zeros(_MIB // 8)})
    with parquet.ParquetWriter(path, table.schema, compression="zstd") as writer:
        for _ in range(mebibytes):
            writer.write_table(table)
    return path


def matrices(path: Path, mebibytes: int) -> Path:
    """Write matrices of zeros."""
    path = path / "system.npz"
    np.savez_compressed(path, A=np.zeros((mebibytes, _MIB), np.uint8), B=0.0, C=0.0, D=0.0)
    return path


MAKERS = {
    doubled_links: "", circle: "", many_links: "", outer_link: "", outer_bytes: "", outer_array: "", other_filter: "",
    large_chunk: "", large_array: "unpack to at most", small_chunks: "memory allocation failed", zeros: "reshape",
    wider: "reshape", nested: "unreadable content", columns: "unpack to at most", matrices: "unpack to at most",
}  # fmt: skip
"""Functions that write a file, to words by which it is refused; empty if it is read without what is outside."""


def read(number: int, folder: Path, mebibytes: int = 400) -> None:
    """Read a file, which is refused, or read without numbers of other files."""
    make = [*MAKERS][number % len(MAKERS)]
    path = make(folder, mebibytes)
    try:
        content = read_foreign(path)
    except UsageError as error:
        assert MAKERS[make] and MAKERS[make] in str(error), error
        raise
    assert not MAKERS[make], "it was read"
    assert make.__name__.startswith("outer") == ("x" in str(content.left_out))


def _plain(kind: str, folder: Path) -> Path:
    """Write an undamaged file of a log."""
    path = folder / f"log.{kind}"
    t = 1e-3 * np.arange(600.0)
    log: dict[str, Any] = {"time": t, **{f"{name}[{i}]": np.sin(t + i) for name in ("kappa", "tau") for i in (1, 2)}}
    if kind == "parquet":
        parquet.write_table(pa.table(log), path)
    elif kind == "npz":
        np.savez_compressed(path, **log)
    elif kind == "h5":
        with h5py.File(path, "w") as file:
            for name, values in log.items():
                file.create_dataset(name, data=values, chunks=(100,), compression="gzip")
    else:
        content = {"time": t, "rec": {"kappa": np.ones((2, 600)), "name": "x"}, "c": np.array([[1, "a"]], object)}
        savemat(path, content, do_compression=kind == "packed.mat")
    return path


def damaged(number: int, folder: Path) -> None:
    """Read a log with changed, lost or doubled bytes. It must be read or refused in words, and end no process."""
    rng = np.random.default_rng(number)
    path = _plain(("plain.mat", "packed.mat", "parquet", "npz", "h5")[number % 5], folder)
    content = bytearray(path.read_bytes())
    ends = (number // 5) % 2  # the tables of contents are at the ends
    for _ in range(rng.integers(1, 9)):
        place = int(rng.integers(len(content)))
        place = min(place % 400, len(content) - 1) * (1 - 2 * int(rng.integers(2))) if ends else place
        content[place] = int(rng.integers(256))
    if rng.random() < 0.2:
        first, last = sorted(rng.integers(len(content), size=2).tolist())
        content[first:last] = content[first:last] * int(rng.integers(0, 3))
    path.write_bytes(content)
    try:
        read_foreign(path)
    except UsageError as error:
        assert path.name in str(error)
        raise


CORPORA = [
    Corpus("logs and matrices that unpack to gigabytes", len(MAKERS), read, quick=len(MAKERS), seconds=60.0),
    Corpus("files of MATLAB, HDF5, numpy and Parquet with changed bytes", 1000, damaged, quick=50, seconds=60.0),
]
