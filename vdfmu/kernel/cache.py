"""The user's cache: files behind the digest of their content, the least recently used removed beyond a total size.

What depends on the structure of a robot alone, such as traced functions and their objects, has a key of that structure
and serves all values. An FMU and its library state the values of their robot, so each value makes new ones.
"""

from __future__ import annotations

import os
import tempfile
from contextlib import suppress
from hashlib import sha256
from pathlib import Path

from platformdirs import user_cache_path

__all__ = ["COMPILER", "cache_folder", "load", "store"]

_LINE = 65
"""Length of the digest and its end of line, which come before the content."""
_LIMIT = 512 * 2**20
"""Bytes that the files of a cache may have together: some 200 values of a robot."""
COMPILER = "zig"
"""Folder of the cache that the compiler keeps itself, with locks of its own."""


def cache_folder() -> Path:
    """Folder of the cache: ``VDFMU_CACHE_DIR``, else ``vdfmu`` in the user's cache folder."""
    chosen = os.environ.get("VDFMU_CACHE_DIR")
    return Path(chosen) if chosen else user_cache_path("vdfmu", appauthor=False)


def load(path: Path) -> bytes | None:
    """Content of a file of the cache; None if there is none, or not the one that was written."""
    try:
        data = path.read_bytes()
    except OSError:
        return None
    digest, content = data[:_LINE], data[_LINE:]
    if digest != _digest(content):
        return None
    with suppress(OSError):  # another process may have removed it, or may own it
        os.utime(path)
    return content


def store(path: Path, content: bytes) -> None:
    """Write a file under a temporary name and rename it: nobody reads half a file. A full disk only costs time.

    Parameters
    ----------
    path : Path
        ``cache / kind / name``: the folder above the file's is the cache that is kept below its size.
    content : bytes
    """
    temporary = None
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, temporary = tempfile.mkstemp(dir=path.parent, suffix=".tmp")
        with os.fdopen(handle, "wb") as stream:
            stream.write(_digest(content) + content)
        os.replace(temporary, path)
        temporary = None
        _evict(path.parent.parent, path)
    except OSError:
        pass
    finally:
        if temporary is not None:
            Path(temporary).unlink(missing_ok=True)


def _evict(cache: Path, new: Path) -> None:
    """Remove the files that were not used for longest, until `new` and the rest have three quarters of the limit.

    Any process may do so at any time: a reader has the whole file open or makes its content anew.
    """
    files: list[tuple[float, int, Path]] = []
    for path in cache.glob("*/*"):
        with suppress(OSError):  # removed by another process
            if path.parent.name != COMPILER and path.is_file():
                status = path.stat()
                files.append((status.st_mtime, status.st_size, path))
    total = sum(size for _, size, _ in files)
    if total <= _LIMIT:
        return
    for _, size, path in sorted(files):
        if total <= 0.75 * _LIMIT:
            break
        if path == new:
            continue
        with suppress(OSError):
            path.unlink()
            total -= size
        with suppress(OSError):  # not empty
            path.parent.rmdir()


def _digest(content: bytes) -> bytes:
    return sha256(content).hexdigest().encode() + b"\n"
