"""The user's cache on disk, seals made with its key, and a cache in memory for one job.

Entries are executed when they are loaded, so only files that nobody but the user may write are trusted. Each starts
with a digest of its name and content. Beyond a total size the least recently used entries are removed.

Traced functions and their objects depend only on the structure of a robot, which is in their keys, so an entry is valid
for all parameter values. An FMU and its library contain the values, so each value makes new entries.

A wheel for one platform contains the entries that the first run needs. They are read if the user's cache lacks them, so
that the first run compiles nothing.
"""

from __future__ import annotations

import hmac
import json
import os
import re
import secrets
import stat
import tempfile
from collections.abc import Callable, Generator, Hashable
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from functools import lru_cache, wraps
from hashlib import sha256
from pathlib import Path
from typing import IO, Any, NamedTuple, TypeVar, TypeVarTuple, overload

from vdfmu.base.errors import LOG, UsageError
from vdfmu.base.files import PACKAGE, digest_of, open_regular
from vdfmu.base.interrupt import InterruptGuard
from vdfmu.base.progress import warn_once

_LINE = 65
"""Length of the digest and its newline before the content."""
_HEAD = re.compile(rb"[0-9a-f]{64}\n")
COMPILER = "zig"
"""Folder of the cache that the compiler manages, with its own locks."""
PREBUILT = PACKAGE / "_data" / "prebuilt"
"""Entries shipped with the package, an archive for each kind, trusted like its code. A source tree has none."""
_NEW_KEY = secrets.token_bytes(32)
"""Key that this process stores if the cache has none, and uses even if it cannot be stored."""
_PROCESSES = 8
"""Processes that may share the free space of a cache before one of them measures it. A full one takes 70 ms to
measure."""
_built: dict[str, str] = {}
"""Digest to GUID of the FMUs that this process built, for caches that cannot be written."""
_room: dict[Path, float] = {}
"""Bytes that this process may still store in a cache before it measures its size again."""
_made: ContextVar[dict[Hashable, Any] | None] = ContextVar("_made", default=None)
Arguments = TypeVarTuple("Arguments")
Made = TypeVar("Made")


def cache_folder() -> Path:
    """Return the folder of the cache: ``VDFMU_CACHE_DIR``, else ``vdfmu`` in the user's cache folder.

    A folder is skipped if other users may write to it. The last resort is a temporary folder of this process.
    UsageError: see :func:`limit`.
    """
    from platformdirs import user_cache_path  # the help works without a cache

    limit()  # reports a wrong limit before any work
    chosen = os.environ.get("VDFMU_CACHE_DIR")
    for folder in [*([Path(chosen)] if chosen else []), user_cache_path("vdfmu", appauthor=False)]:
        if trusted(folder):
            return folder
    return Path(_private().name)


def limit() -> float:
    """Return the limit [byte] of a cache: ``VDFMU_CACHE_MB`` or 512 MB, for FMUs of some 200 different robots."""
    text = os.environ.get("VDFMU_CACHE_MB") or "512"
    with suppress(ValueError):
        if float(text) >= 0.0:
            return float(text) * 2**20
    raise UsageError(f"VDFMU_CACHE_MB: expected the maximum size of the cache, a number >= 0 in MB, got {text!r}.")


def trusted(folder: Path) -> bool:
    """Return whether a folder belongs to the user and nobody else may write to it. If not, warn once.

    A missing folder is trusted: `store` makes it for the user alone. Windows has no such modes, but the profile is
    closed to other users.
    """
    try:
        fault = _fault(folder.stat())
    except OSError:  # an unreadable folder is not loaded from
        return True
    if fault:
        warn_once(
            f"the cache {str(folder)!r} is not used: {fault}, and its files would be executed; expected a folder of "
            "the user that nobody else may write to. Remove it, or choose another with VDFMU_CACHE_DIR"
        )
    return not fault


def _fault(status: os.stat_result) -> str:
    """Return why another user may have written a file or folder, else an empty text."""
    if os.name != "posix":
        return ""
    if status.st_uid != os.geteuid():
        return f"it belongs to user {status.st_uid}, not to {os.geteuid()}"
    if status.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
        return f"other users may write to it (mode {stat.S_IMODE(status.st_mode):o})"
    return ""


@lru_cache
def _private() -> tempfile.TemporaryDirectory[str]:
    """Return a cache for only this process, removed at its end."""
    with InterruptGuard():
        return tempfile.TemporaryDirectory(prefix="vdfmu_cache_", ignore_cleanup_errors=True)


@overload
def load(path: Path) -> bytes | None: ...
@overload
def load(path: Path, read: Callable[[bytes], Made]) -> Made | None: ...
def load(path: Path, read: Callable[[bytes], Any] = bytes) -> Any:
    """Return the content of an entry as `read` gives it.

    None if the entry is missing, untrusted, damaged, stored under another name, or not what `read` expects: whatever
    `read` raises, the entry is made again.
    """
    brought = False
    try:
        with open_regular(path) as file:
            if _fault(os.fstat(file.fileno())):
                return None
            data = file.read()
    except OSError:
        data, brought = _prebuilt(path.parent.name).get(path.name), True
        if data is None:
            return None
    LOG.info("from the cache: %s/%s", path.parent.name, path.name[:16])
    if data[:_LINE] != _digest(path, data[_LINE:]):
        return None
    if brought:
        store(path, data[_LINE:])  # later commands read it there
    try:
        content = read(data[_LINE:])
    except Exception as error:
        LOG.info("made again, because the cache has other content: %s: %s", path, error)
        return None
    with suppress(OSError):  # another process may have removed it
        os.utime(path)
    return content


@lru_cache
def _prebuilt(kind: str) -> dict[str, bytes]:
    """Return the entries of a kind that were shipped with the package, by name; none if their archive is damaged."""
    archive = PREBUILT / f"{kind}.tar.xz"
    if not archive.is_file():
        return {}
    import tarfile  # takes time to import

    try:
        with tarfile.open(archive) as packed:
            return {member.name: file.read() for member in packed if (file := packed.extractfile(member))}
    except Exception as error:  # xz's errors have no common base, and some builds of Python have no xz
        LOG.info("made again, because the package has other content: %s: %s", archive, error)
        return {}


def load_or_make(path: Path, make: Callable[[], bytes], read: Callable[[bytes], Made]) -> Made:
    """Return the content of an entry as `read` gives it, made and stored if it is not there."""
    if (loaded := load(path, read)) is not None:
        return loaded
    store(path, content := make())
    return read(content)


def store(path: Path, content: bytes) -> None:
    """Write an entry ``cache / kind / name`` atomically and evict old entries. Warn once if the disk fails."""
    temporary = None
    try:
        for folder in (path.parent.parent, path.parent):
            folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        handle, temporary = tempfile.mkstemp(dir=path.parent, suffix=".tmp")
        with os.fdopen(handle, "wb") as stream:
            stream.write(_digest(path, content) + content)
        os.replace(temporary, path)
        temporary = None
        _evict(path.parent.parent, path, _LINE + len(content))
    except OSError as error:
        warn_once(
            f"the cache {path.parent.parent} cannot be written: {error.strerror or error}. Later commands compile and "
            "trace everything again, and 'vdfmu report' makes pages without sliders. Free space, or choose another "
            "folder with VDFMU_CACHE_DIR."
        )
    finally:
        if temporary is not None:
            Path(temporary).unlink(missing_ok=True)


class _CachedFile(NamedTuple):
    """An entry: time of its last use [s], its size [byte] and its path."""

    used: float
    size: int
    path: Path

    def remove(self) -> bool:
        """Remove the file, and its folder if empty. Return whether the file no longer exists."""
        with suppress(OSError):
            self.path.unlink()
            with suppress(OSError):  # not empty
                self.path.parent.rmdir()
            return True
        return False


def entries(cache: Path) -> list[_CachedFile]:
    """Return the entries of a cache; other files in its folders are ignored."""
    listed: list[_CachedFile] = []
    for path in cache.glob("*/*"):
        with suppress(OSError):  # removed by another process
            if path.parent.name != COMPILER and path.is_file():
                with open_regular(path) as file:
                    head, status = file.read(_LINE), os.fstat(file.fileno())
                if _HEAD.fullmatch(head):
                    listed.append(_CachedFile(status.st_mtime, status.st_size, path))
    return listed


def _evict(cache: Path, new: Path, size: int) -> None:
    """Remove the least recently used entries except `new` until three quarters of the limit are in use.

    Safe while other processes read: a reader has the file open, or makes its content again.
    """
    most = limit()
    _room[cache] = _room.get(cache, 0.0) - size
    if _room[cache] > 0.0:
        return
    with suppress(OSError):  # another process removes files
        total = sum(path.stat().st_size for path in cache.glob("*/*"))  # without opening them
        _room[cache] = (most - total) / _PROCESSES
        if total <= most:
            return
    listed = sorted(entries(cache))
    total = sum(entry.size for entry in listed)
    for entry in listed if total > most else ():
        if total <= 0.75 * most:
            break
        if entry.path != new and entry.remove():
            total -= entry.size


def _digest(path: Path, content: bytes) -> bytes:
    """Return the first line of an entry, a digest that includes its name, so that no entry can replace another."""
    return sha256(f"{path.parent.name}/{path.name}\n".encode() + content).hexdigest().encode() + b"\n"


def seal(*content: Any) -> str:
    """Return an HMAC of JSON, and of the files whose paths are in it, with the key in the user's cache."""
    return _sealed(_keys()[0], content)


def is_own(text: object, *content: Any) -> bool:
    """Whether a text is the `seal` of some content by this user, on this machine and with this cache."""
    return any(hmac.compare_digest(_sealed(key, content).encode(), str(text).encode()) for key in _keys())


def keep_built(path: Path, guid: str) -> None:
    """Remember the bytes of an FMU that was built here, by their digest, with its GUID or instantiation token."""
    digest = digest_of(path)
    _built[digest] = guid
    store(cache_folder() / "built" / digest, guid.encode())


def built_as(file: Path | IO[bytes]) -> str | None:
    """Return the GUID or token with which this user built an FMU here; None for any other file.

    The GUID in an FMU does not prove its origin, because it stays the same when a library is changed.
    """
    digest = digest_of(file)
    content = load(cache_folder() / "built" / digest)
    return _built.get(digest) if content is None else content.decode()


def _sealed(key: bytes, content: Any) -> str:
    return hmac.new(key, json.dumps(content, sort_keys=True, default=digest_of).encode(), "sha256").hexdigest()


def _keys() -> list[bytes]:
    """Return the keys. There are several if processes started at once with an empty cache."""
    folder = cache_folder() / "seals"
    stored = [key for path in sorted(folder.glob("*")) if (key := load(path))]
    if not stored:
        store(folder / secrets.token_hex(8), _NEW_KEY)
    return [*stored, _NEW_KEY]


@contextmanager
def one_job() -> Generator[None]:
    """Begin a job or continue the current one: a command, or a call such as :func:`vdfmu.run`.

    Results of `cached_per_command` are dropped at its end, because files and classes may change before the next job.
    """
    made = _made.get()
    token = _made.set({} if made is None else made)
    try:
        yield
    finally:
        _made.reset(token)


def cached_per_command(make: Callable[[*Arguments], Made]) -> Callable[[*Arguments], Made]:
    """Cache a function by its arguments during a job. Outside of a job call it each time."""

    @wraps(make)
    def cached(*arguments: *Arguments) -> Made:
        made = _made.get()
        if made is None:
            return make(*arguments)
        key = (make, *arguments)
        if key not in made:
            made[key] = make(*arguments)
        return made[key]

    return cached
