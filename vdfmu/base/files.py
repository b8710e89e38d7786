"""Atomic file writes, reproducible zip files, temporary folders, data files of the package."""

from __future__ import annotations

import atexit
import errno
import hashlib
import json
import os
import secrets
import shutil
import stat
import tempfile
import zipfile
import zlib
from collections.abc import Generator, Iterable, Mapping
from contextlib import contextmanager, nullcontext, suppress
from contextvars import ContextVar
from pathlib import Path
from typing import IO, Any, BinaryIO, Literal

from vdfmu.base.errors import LOG, StorageError, UsageError, VdfmuError
from vdfmu.base.interrupt import InterruptGuard

_EPOCH = (1980, 1, 1, 0, 0, 0)
MARK = b'generationTool="vdfmu'
"""Marker of files that vdfmu wrote for other tools."""
PAGE_MARK = b'<meta name="generator" content="vdfmu">'
"""Marker of pages that vdfmu wrote."""
_HEAD = 8192
"""Number of bytes in which a marker is searched for."""


def pack_zip(path: Path, members: Mapping[str, bytes]) -> None:
    """Write a zip file whose bytes depend only on its members: sorted names, fixed time stamp and mode."""
    with storing(path), replacing(path) as stream, zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        for name in sorted(members):
            entry = zipfile.ZipInfo(name, _EPOCH)
            packed = name.endswith((".fmu", ".ssp", ".png"))  # already compressed
            entry.compress_type = zipfile.ZIP_STORED if packed else zipfile.ZIP_DEFLATED
            entry.create_system = 3
            entry.external_attr = 0o644 << 16
            archive.writestr(entry, members[name])


@contextmanager
def replacing(path: Path) -> Generator[BinaryIO]:
    """Write to a temporary file and rename it to `path` on success. On an error delete it and leave `path` unchanged.

    After the block the file is flushed to the disk, so that it survives a power failure. Follows symbolic links. The
    file gets the default mode. StorageError if `path` is not a regular file. OSError with the file's name if it cannot
    be written.
    """
    target = regular_target(path)
    temporary = target.with_name(f"{secrets.token_hex(8)}.tmp")
    handle = os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0), 0o666)
    try:
        with os.fdopen(handle, "wb") as stream:
            yield stream
            stream.flush()
            os.fsync(stream.fileno())
        os.replace(temporary, target)
        sync(target.parent)
        LOG.info("written: %s", target)
    except BaseException as error:
        temporary.unlink(missing_ok=True)
        if isinstance(error, OSError) and error.filename is None:  # from a write, or from closing the file
            error.filename = str(path)
        raise


def sync(path: Path) -> None:
    """Flush a file, or the entries of a folder, to the disk. OSError if the disk reports a fault."""
    if os.name == "nt" and path.is_dir():  # Windows cannot open folders, and flushes their names itself
        return
    handle = os.open(path, os.O_RDWR if os.name == "nt" else os.O_RDONLY)
    try:
        os.fsync(handle)
    except OSError as error:
        if error.errno not in (errno.EINVAL, errno.ENOTSUP):  # the file system does not support it
            error.filename = str(path)
            raise
    finally:
        closed(handle)


def closed(handle: int) -> None:
    """Close a handle through which nothing was written. Ignore errors: a full disk may report its fault again."""
    with suppress(OSError):
        os.close(handle)


def make_folder(path: Path) -> None:
    """Make a folder and its missing parents, and flush them to the disk. OSError if that fails."""
    if not path.is_dir():
        make_folder(path.parent)
        path.mkdir(exist_ok=True)
        sync(path.parent)


def write_whole(path: Path, blocks: Iterable[bytes]) -> None:
    """Write a file atomically. UsageError if its folder is missing or not writable, VdfmuError for other reasons."""
    try:
        with replacing(path) as stream:
            stream.writelines(blocks)
    except OSError as error:
        kind = UsageError if isinstance(error, (FileNotFoundError, PermissionError)) else VdfmuError
        raise kind(f"cannot write {path}: {error.strerror or error}") from None


def write_all(file: Any, content: bytes) -> None:
    """Write bytes to an unbuffered file in parts."""
    rest = memoryview(content)
    while rest:
        rest = rest[file.write(rest) :]


@contextmanager
def storing(path: Path) -> Generator[None]:
    """Turn an OSError in the block into a StorageError for `path`."""
    try:
        yield
    except OSError as error:
        why = error.strerror or error
        raise StorageError(f"{path}: cannot be written: {why}. Choose another folder or free space.") from error


def exists(path: Path) -> bool:
    """Whether there is a file, a folder or a link, even if broken. OSError if this cannot be determined."""
    try:
        path.lstat()
    except (FileNotFoundError, NotADirectoryError):
        return False
    return True


def regular_target(path: Path) -> Path:
    """Return the target of `path` after its links. StorageError if it exists and is not a regular file."""
    try:
        target = path.resolve()
        if not exists(target):
            return target
        mode = target.lstat().st_mode
    except (OSError, RuntimeError) as error:  # RuntimeError: links in a circle, before Python 3.13
        raise StorageError(f"{path}: cannot be written: {error}. Choose another folder.") from None
    if stat.S_ISDIR(mode):
        raise StorageError(f"{path}: is a folder; expected the name of a file to write")
    if not stat.S_ISREG(mode):
        raise StorageError(
            f"{path}: is a device, a pipe or another special file; expected a regular file or a new name"
        )
    return target


_REPLACING = ContextVar("_REPLACING", default=False)


@contextmanager
def replacing_foreign(wanted: bool) -> Generator[None]:
    """Let `require_ours` accept foreign files within the block, if `wanted`."""
    token = _REPLACING.set(wanted)
    try:
        yield
    finally:
        _REPLACING.reset(token)


def require_ours(*paths: Path) -> None:
    """Raise UsageError for existing files that vdfmu did not write."""
    foreign = [] if _REPLACING.get() else [str(path) for path in paths if path.is_file() and not _is_ours(path)]
    if foreign:
        raise UsageError(
            f"{', '.join(foreign)}: expected no file of this name, or one that vdfmu wrote. Move it away, choose "
            "another name or folder with --out, or replace it with --overwrite."
        )


def _is_ours(path: Path) -> bool:
    """Whether a file is empty or names vdfmu as its generation tool."""
    described = (read_member(path, name) for name in ("modelDescription.xml", "SystemStructure.ssd"))
    try:
        with path.open("rb") as file:
            head = file.read(_HEAD)
    except OSError:
        return False
    return not head or PAGE_MARK in head or any(MARK in text[:_HEAD] for text in (*described, head) if text)


def inside(folder: Path, file: Path) -> Path:
    """Return a file to write in a folder. UsageError if its name, or a link, leads out of the folder."""
    place = Path(os.path.realpath(file))
    if not place.is_relative_to(os.path.realpath(folder)):
        raise UsageError(f"{file} must be in {folder}, got {place}. Choose the place with --out.")
    return file


def open_regular(path: str | os.PathLike[str]) -> BinaryIO:
    """Open a file, whose name may come from a data file, for reading in binary mode.

    A pipe, a device, a socket or a folder is refused before it is opened, because opening a pipe waits for its writer
    and reading a device may never end.

    Raises
    ------
    OSError
        With the reason in ``strerror``: EINVAL for a special file, EISDIR for a folder, or what the system raises.
    """
    _require_regular(os.stat(path), path)
    stream = open(path, "rb", opener=_without_waiting)  # noqa: SIM115 - the caller closes it
    try:
        _require_regular(os.fstat(stream.fileno()), path)  # another process may have replaced it
    except OSError:
        stream.close()
        raise
    return stream


def _without_waiting(path: str, flags: int) -> int:
    return os.open(path, flags | getattr(os, "O_NONBLOCK", 0))


def _require_regular(status: os.stat_result, path: str | os.PathLike[str]) -> None:
    if stat.S_ISDIR(status.st_mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), os.fspath(path))
    if not stat.S_ISREG(status.st_mode):
        reason = "it is a pipe, a device or another special file, not a regular file"
        raise OSError(errno.EINVAL, reason, os.fspath(path))


def read_regular(path: str | os.PathLike[str], largest: int | None = None) -> bytes:
    """Return the content of a file. OSError: see `open_regular`; EFBIG for more than `largest` bytes."""
    with open_regular(path) as stream:
        try:
            content = stream.read(-1 if largest is None else largest + 1)
        except OSError as error:
            error.filename = os.fspath(path)  # an error of reading has none
            raise
    if largest is not None and len(content) > largest:
        raise OSError(errno.EFBIG, f"it has more than the {largest / 2**20:g} MiB that are read", os.fspath(path))
    return content


def digest_of(file: Path | IO[bytes]) -> str:
    """Return the SHA-256 of a file, in hexadecimal digits. OSError with its name."""
    with file.open("rb") if isinstance(file, Path) else nullcontext(file) as stream:
        try:
            stream.seek(0)
            return hashlib.file_digest(stream, "sha256").hexdigest()  # pyright: ignore[reportArgumentType]
        except OSError as error:
            error.filename = str(file) if isinstance(file, Path) else stream.name  # an error of reading has none
            raise


def read_text(path: Path, largest: int | None = None) -> str:
    """Return the content of a file in UTF-8, without its byte order mark. OSError: see `open_regular`."""
    return read_regular(path, largest).decode("utf-8-sig")


def read_json(source: Path | bytes | str) -> Any:
    """Return the value in a JSON file, or of JSON text. ValueError for other content, OSError if unreadable."""
    try:
        return json.loads(read_text(source) if isinstance(source, Path) else source)
    except RecursionError:
        raise ValueError("lists or tables are nested too deeply") from None


def read_member(path: Path, name: str) -> bytes | None:
    """Return the content of a member of a zip file. None if it is missing or unreadable."""
    try:
        with zipfile.ZipFile(path) as archive:
            return archive.read(name)
    except (OSError, KeyError, ValueError, zipfile.BadZipFile, zlib.error):
        return None


def no_temporary(user: str, why: Any) -> StorageError:
    """Return the error for a full or unwritable temporary folder: `user` needed it, `why` is the system's reason."""
    folder = " ".join(filter(None, ("the temporary folder", tempfile.tempdir)))
    reason = getattr(why, "strerror", None) or why
    return StorageError(
        f"{user}: cannot write to {folder}: {reason}. Free space there, or set TMPDIR to another folder."
    )


@contextmanager
def temporary_folder(prefix: str) -> Generator[str]:
    """Make a temporary folder and remove it at the end, even after Ctrl-C at any moment. Ignore errors of removal.

    `tempfile` would leave a folder behind if Ctrl-C comes before it has noted the folder, or during the removal, and
    its first search for a place may leave a trial file. OSError if no place is writable.
    """
    made = None
    try:
        with InterruptGuard():
            made = tempfile.TemporaryDirectory(prefix=prefix, ignore_cleanup_errors=True)
        yield made.name
    finally:
        if made is not None:
            try:
                with InterruptGuard():
                    _remove(made)
            except KeyboardInterrupt:  # the signal may have come before the guard
                _remove(made)
                raise


def _remove(folder: tempfile.TemporaryDirectory[str]) -> None:
    """Remove a folder; try twice, because errors may be transient. If memory is short, remove it when Python exits."""
    for _ in range(2):
        try:
            folder.cleanup()
        except OSError:
            continue
        except MemoryError:
            atexit.register(shutil.rmtree, folder.name, ignore_errors=True)


PACKAGE = Path(__file__).resolve().parents[1]


def data_path(kind: Literal["models", "ssp", "fmu_src", "examples"]) -> Path:
    """Return the folder of a kind of data file. VdfmuError if it is missing.

    A wheel has the folders in ``vdfmu/_data``, a source tree (also of an editable install) at its root.
    """
    places = (PACKAGE / "_data" / kind, PACKAGE.parent / kind)
    for place in places:
        if place.is_dir():
            return place
    raise VdfmuError(f"data folder {kind!r} not found: expected {' or '.join(map(str, places))}. Reinstall vdfmu.")


def source_bytes(file: Path) -> bytes:
    """Return the content of a source file with Unix newlines."""
    return file.read_bytes().replace(b"\r\n", b"\n")
