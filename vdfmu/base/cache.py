"""The user's cache: files behind the digest of name and content, the least recently used removed beyond a total size.

What is loaded from it runs: only what belongs to the user, and nobody else may write, is taken.

What depends on the structure of a robot alone, such as traced functions and their objects, has a key of that structure
and serves all values. An FMU and its library state the values of their robot, so each value makes new ones.
"""

from __future__ import annotations

import logging
import os
import re
import stat
import tempfile
from contextlib import suppress
from functools import lru_cache
from hashlib import sha256
from pathlib import Path
from typing import NamedTuple

from platformdirs import user_cache_path

from vdfmu.base.errors import LOG, UsageError
from vdfmu.base.interrupt import InterruptGuard

_LINE = 65
"""Length of the digest and its end of line, which come before the content."""
_HEAD = re.compile(rb"[0-9a-f]{64}\n")
COMPILER = "zig"
"""Folder of the cache that the compiler keeps itself, with locks of its own."""


def cache_folder() -> Path:
    """Folder of the cache: ``VDFMU_CACHE_DIR``, else ``vdfmu`` in the user's cache folder.

    One that others may write to is not used: the next is, at last a temporary one of this process.

    Raises
    ------
    UsageError
        See :func:`limit`.
    """
    limit()  # one that is wrong is said before any work
    chosen = os.environ.get("VDFMU_CACHE_DIR")
    own = user_cache_path("vdfmu", appauthor=False)
    for folder in (Path(chosen), own) if chosen else (own,):
        if trusted(folder):
            return folder
    return Path(_private().name)


def limit() -> float:
    """Bytes that the entries of a cache may have together: ``VDFMU_CACHE_MB``, else 512 MB, some 200 values of a robot.

    Raises
    ------
    UsageError
        If the variable is not a number of at least 0.
    """
    given = os.environ.get("VDFMU_CACHE_MB") or "512"
    with suppress(ValueError):
        if float(given) >= 0.0:
            return float(given) * 2**20
    raise UsageError(f"VDFMU_CACHE_MB: expected the most that the cache may hold, a number >= 0 in MB, got {given!r}.")


def trusted(folder: Path) -> bool:
    """Whether a folder belongs to the user and nobody else may write to it; if not, a message says so, once.

    One that does not exist is trusted: it is made for the user alone. Windows has no such modes; there the user's
    profile is closed to others.
    """
    try:
        fault = _fault(folder.stat())
    except OSError:  # what cannot be read is not loaded from
        return True
    if fault:
        _say(
            f"the cache {str(folder)!r} is not used: {fault}, and what is in it would be run; expected a folder of the "
            "user that nobody else may write to. Remove it and what is in it, or choose another with VDFMU_CACHE_DIR"
        )
    return not fault


def _fault(status: os.stat_result) -> str:
    """Return why a file or folder may hold what somebody else wrote; empty if it may not."""
    if os.name != "posix":
        return ""
    if status.st_uid != os.geteuid():
        return f"it belongs to user {status.st_uid}, not to {os.geteuid()}"
    if status.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
        return f"others may write to it (mode {stat.S_IMODE(status.st_mode):o})"
    return ""


@lru_cache
def _say(text: str) -> None:
    logging.getLogger("vdfmu.cache").warning("%s", text)


@lru_cache
def _private() -> tempfile.TemporaryDirectory[str]:
    """Return a cache for this process alone, removed at its end."""
    with InterruptGuard():
        return tempfile.TemporaryDirectory(prefix="vdfmu_cache_", ignore_cleanup_errors=True)


def load(path: Path) -> bytes | None:
    """Content of a file of the cache; None if there is none, or not the one that the user wrote under this name."""
    try:
        with path.open("rb") as file:
            if _fault(os.fstat(file.fileno())):
                return None
            data = file.read()
    except OSError:
        return None
    LOG.info("from the cache: %s/%s", path.parent.name, path.name[:16])
    digest, content = data[:_LINE], data[_LINE:]
    if digest != _digest(path, content):
        return None
    with suppress(OSError):  # another process may have removed it
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
        for folder in (path.parent.parent, path.parent):
            folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        handle, temporary = tempfile.mkstemp(dir=path.parent, suffix=".tmp")
        with os.fdopen(handle, "wb") as stream:
            stream.write(_digest(path, content) + content)
        os.replace(temporary, path)
        temporary = None
        _evict(path.parent.parent, path)
    except OSError:
        pass
    finally:
        if temporary is not None:
            Path(temporary).unlink(missing_ok=True)


class CachedFile(NamedTuple):
    """A file of the cache: when it was last used [s], and its size [bytes]."""

    used: float
    size: int
    path: Path

    def remove(self) -> bool:
        """Remove the file, and its folder if that is empty then; return whether it is gone."""
        with suppress(OSError):
            self.path.unlink()
            with suppress(OSError):  # not empty
                self.path.parent.rmdir()
            return True
        return False


def entries(cache: Path) -> list[CachedFile]:
    """Return the entries of a cache; what is not, in a folder that is used for more, is none."""
    found: list[CachedFile] = []
    for path in cache.glob("*/*"):
        with suppress(OSError):  # removed by another process
            if path.parent.name != COMPILER and path.is_file():
                with path.open("rb") as file:
                    head, status = file.read(_LINE), os.fstat(file.fileno())
                if _HEAD.fullmatch(head):
                    found.append(CachedFile(status.st_mtime, status.st_size, path))
    return found


def clear(cache: Path) -> list[CachedFile]:
    """Remove the entries of a cache, and return them."""
    return [entry for entry in entries(cache) if entry.remove()]


def _evict(cache: Path, new: Path) -> None:
    """Remove the entries that were not used for longest, until `new` and the rest have three quarters of the limit.

    Any process may do so at any time: a reader has the whole file open or makes its content anew.
    """
    most = limit()
    if sum(_size(path) for path in cache.glob("*/*")) <= most:  # without a look into them
        return
    found = entries(cache)
    total = sum(entry.size for entry in found)
    if total <= most:
        return
    for entry in sorted(found):
        if total <= 0.75 * most:
            break
        if entry.path != new and entry.remove():
            total -= entry.size


def _size(path: Path) -> int:
    """Return the size of a file; 0 of one that another process has removed."""
    with suppress(OSError):
        return path.stat().st_size
    return 0


def _digest(path: Path, content: bytes) -> bytes:
    """Return the first line of a file: it holds for this name alone, so that no entry can stand for another."""
    return sha256(f"{path.parent.name}/{path.name}\n".encode() + content).hexdigest().encode() + b"\n"
