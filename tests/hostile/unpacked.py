"""Corpus: logs and matrices that unpack to very much, never end, or take in other files."""

import struct
import zlib
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pyarrow as pa
import pyarrow.parquet as parquet

from tests.hostile.results import planar
from tests.hostile.table import Corpus
from vdfmu.base import unpack
from vdfmu.compiler.unit.new import unit_from
from vdfmu.study.identify.log import read_log

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
    return _tree(path, lambda file: [file.__setitem__(f"x{k}", file["time"]) for k in range(unpack.COUNT)])


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


def _element(kind: int, content: bytes) -> bytes:
    return struct.pack("<II", kind, len(content)) + content + bytes(-len(content) % 8)


def _matrix(kind: int, name: bytes, inside: bytes) -> bytes:
    head = _element(6, struct.pack("<II", kind, 0)) + _element(5, struct.pack("<ii", 1, 1)) + _element(1, name)
    return _element(14, head + inside)


def _version_5(path: Path, matrix: bytes) -> Path:
    path, packed = path / "log.mat", zlib.compress(matrix)
    path.write_bytes(b"MATLAB 5.0 MAT-file".ljust(124) + b"\0\1IM" + struct.pack("<II", 15, len(packed)) + packed)
    return path


def zeros(path: Path, mebibytes: int) -> Path:
    """Write zeros, packed."""
    return _version_5(path, _matrix(6, b"x", _element(9, bytes(mebibytes * _MIB))))


def wider(path: Path, mebibytes: int) -> Path:
    """Write zeros of one byte of an array of doubles."""
    return _version_5(path, _matrix(6, b"x", _element(2, bytes(mebibytes * _MIB // 4))))


def nested(path: Path, mebibytes: int) -> Path:
    """Write structs within structs."""
    field = struct.pack("<HHI", 5, 4, 2) + _element(1, b"x\0")
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
    doubled_links: "hold b once, got a second link", circle: "hold a once, got a second link",
    many_links: "have at most 10* variables", outer_link: r"hold x itself, got a link \(ExternalLink\)",
    outer_bytes: "hold the numbers of /x itself", outer_array: "hold the numbers of /x itself",
    large_array: "unpack to at most", small_chunks: "unpack to at most", large_chunk: "have chunks of 40 bytes in /x",
    other_filter: "have /x packed by gzip", zeros: "unpack to at most", wider: "unpack to at most",
    nested: "recursion", columns: "unpack to at most", matrices: "unpack to at most",
}  # fmt: skip
"""Functions that write a file, to words by which it is refused."""


def read(number: int, folder: Path, mebibytes: int = 400) -> None:
    """Read a file, which must be refused."""
    path = [*MAKERS][number % len(MAKERS)](folder, mebibytes)
    if path.suffix == ".npz":
        unit_from(str(path), out=folder / "unit.py")
    else:
        read_log(path, planar())
    raise AssertionError("it was read")


CORPORA = [Corpus("logs and matrices that unpack to very much", len(MAKERS), read, quick=len(MAKERS), seconds=60.0)]
