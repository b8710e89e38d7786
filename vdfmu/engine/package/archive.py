"""Safe reading and unpacking of zip packages."""

from __future__ import annotations

import stat
import tempfile
import zipfile
from collections.abc import Callable, Generator, Iterator
from contextlib import ExitStack, closing, contextmanager
from pathlib import Path, PurePosixPath
from typing import IO, Any
from urllib.parse import unquote, urlsplit

from vdfmu.base.errors import SspError, UsageError, disk_error
from vdfmu.base.interrupt import InterruptGuard
from vdfmu.engine.package import limits
from vdfmu.engine.rules import Finding, breach, finding

INSIDE = "!/"
"""Between the name of a package inside a package and the name of a member of it."""
_SHOWN = 50
"""Most faulty members that one message lists."""
_BLOCK = 2**18
"""Bytes that are unpacked at once."""


def stamp_of(path: Path) -> tuple[int, ...]:
    """Return numbers of a file that change with its content; none for a missing one."""
    try:
        found = path.stat()
    except OSError:
        return ()
    return found.st_dev, found.st_ino, found.st_size, found.st_mtime_ns


class Archive:
    """A zip file whose member names and sizes have been checked; ``package.ssp!/member`` names one of a package inside.

    `label` is its name in messages, `outer` the package in which it lies: they share one limit of what may be unpacked.

    Raises
    ------
    SspError
        The file is missing or not a zip, or a member points outside the package, occurs twice with different
        contents, differs from another in case only, is a link, is encrypted, is packed by another method than
        deflation or is larger than the limits of `vdfmu.engine.package.limits`.
    """

    def __init__(self, source: Path | IO[bytes], label: str, outer: Archive | None = None) -> None:
        self.label = label
        self._depth = 0 if outer is None else outer._depth + 1
        self._budget = outer._budget if outer else limits.Budget(label, limits.unpack_limit() / limits.TOTAL_LIMIT)
        self._inner: dict[str, Archive] = {}
        self.doubled: list[str] = []
        """Members that occur more than once, with the same content."""
        with ExitStack() as opened:
            if isinstance(source, Path) and source.exists() and not (source.is_file() or source.is_dir()):
                special = "is a pipe, a device or another special file; expected a regular one"
                raise breach("PKG001", f"{label}: {special}")
            try:
                self.file: IO[bytes] = source.open("rb") if isinstance(source, Path) else source
                opened.push(closing(self.file))
                self._zip = self._directory()
            except FileNotFoundError:
                raise breach("PKG001", f"{label}: there is no such file") from None
            except (OSError, NotImplementedError, ValueError, zipfile.BadZipFile) as error:
                _blame_disk(label, error)
                text = f"{label}: cannot be read as a zip package: {error}. It may be cut off; "
                raise breach("PKG001", f"{text}export or copy it again") from None
            self._members = self._check()
            opened.pop_all()

    def _directory(self) -> zipfile.ZipFile:
        """Read the directory of the file, whose size is known before: each entry of it takes memory."""
        end: Any = zipfile._EndRecData(self.file)  # pyright: ignore[reportAttributeAccessIssue]
        size = end[zipfile._ECD_SIZE] if end else 0  # pyright: ignore[reportAttributeAccessIssue]
        if size > limits.DIRECTORY_LIMIT:
            text = f"{self.label}: has a directory of {size} bytes; the limit is {limits.DIRECTORY_LIMIT}. "
            raise breach("PKG004", f"{text}Pack fewer files")
        return zipfile.ZipFile(self.file)

    def _check(self) -> dict[str, zipfile.ZipInfo]:
        problems: list[Finding] = []

        def fault(rule: str, text: str) -> None:
            problems.append(finding(rule, f"{self.label}: {text}"))

        members: dict[str, zipfile.ZipInfo] = {}
        folded: dict[str, str] = {}
        twice: list[tuple[zipfile.ZipInfo, zipfile.ZipInfo]] = []
        infos, limit = self._zip.infolist(), limits.MEMBER_LIMIT * self._budget.scale
        if len(infos) > limits.COUNT_LIMIT:
            fault("PKG004", f"has {len(infos)} entries; the limit is {limits.COUNT_LIMIT}")
            raise SspError(problems)
        for info in infos:
            name = info.filename
            if not is_inside(name) or "\\" in info.orig_filename:
                outside = f"entry {info.orig_filename!r} points outside the package"
                fault("PKG002", f"{outside}; expected a relative path with '/' between folders")
            elif stat.S_ISLNK(info.external_attr >> 16):
                fault("PKG003", f"entry {name!r} is a symbolic link; pack the file itself")
            elif info.file_size > limit:
                fault("PKG004", f"entry {name!r} has {info.file_size} bytes; the limit is {limit:.0f}")
            elif info.flag_bits & 0x1:
                fault("PKG005", f"entry {name!r} is encrypted; pack it without a password")
            elif info.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
                method = f"entry {name!r} is packed by method {info.compress_type}"
                fault("PKG005", f"{method}; SSP and FMI allow 0 (stored) and 8 (deflated)")
            elif name in members:
                twice.append((members[name], info))
            elif (other := folded.setdefault(name.rstrip("/").lower(), name)) != name:
                one = f"entries {other!r} and {name!r} are one file"
                fault("PKG006", f"{one} where case or a final '/' does not count; rename one")
            members[name] = info
        above: dict[str, list[str]] = {}
        for name in members:
            folder = name.rstrip("/").rpartition("/")[0]
            if folder not in above:
                path = PurePosixPath(folder)
                above[folder] = [str(each) for each in (path, *path.parents)]
            if clash := next((f for f in above[folder] if f in members and not members[f].is_dir()), None):
                fault("PKG006", f"entry {clash!r} is a file and the folder of {name!r}")
        total, limit = sum(info.file_size for info in infos), limits.TOTAL_LIMIT * self._budget.scale
        if not problems and total > limit:
            fault("PKG004", f"holds {total} bytes unpacked; the limit is {limit:.0f} (--unpack-limit)")
        unpack = not problems  # what is unpacked is bounded then
        for one, other in twice:
            if (one.file_size, one.CRC) == (other.file_size, other.CRC) and (not unpack or self._same(one, other)):
                self.doubled.append(one.filename)
            else:
                fault("PKG006", f"entry {one.filename!r} occurs twice, with different contents")
        if len(problems) > _SHOWN:
            more = f"{self.label}: and {len(problems) - _SHOWN} more such entries"
            problems[_SHOWN:] = [problems[_SHOWN].reworded(more)]
        if problems:
            raise SspError(problems)
        return {name: info for name, info in members.items() if not info.is_dir()}

    def _same(self, one: zipfile.ZipInfo, other: zipfile.ZipInfo) -> bool:
        """Whether two entries have the same content; False if one cannot be unpacked."""
        try:
            with self._zip.open(one) as first, self._zip.open(other) as second:
                while block := first.read(_BLOCK):
                    self._budget.spend(2 * len(block), False)
                    if second.read(_BLOCK) != block:
                        return False
                return not second.read(1)
        except SspError:
            raise
        except Exception:  # zlib.error and its like have no common base
            return False

    @property
    def names(self) -> list[str]:
        """The names of all files in the package."""
        return list(self._members)

    def __contains__(self, name: str) -> bool:
        return name in self._members or self._split(name) is not None

    def _split(self, name: str) -> tuple[Archive, str] | None:
        """Return the package inside this one and the member of it that a name means, or None."""
        outer, mark, rest = name.partition(INSIDE)
        if not mark or outer not in self._members:
            return None
        inner = self.inside(outer)
        return (inner, rest) if rest in inner else None

    def inside(self, name: str) -> Archive:
        """Return a package inside the package; it is closed with this one."""
        if name not in self._inner:
            if self._budget.packages >= limits.PACKAGE_LIMIT:
                many = f"has more than {limits.PACKAGE_LIMIT} packages inside it; that is the limit"
                raise breach("PKG004", f"{self._budget.label}: {many}")
            self._inner[name] = self._open(name)
            self._budget.packages += 1
        return self._inner[name]

    @contextmanager
    def opened(self, name: str, label: str = "") -> Generator[Archive]:
        """Open a package or FMU inside the package, for a ``with`` block."""
        archive, name = self._split(name) or (self, name)
        with archive._open(name, label) as inner:
            yield inner

    def _open(self, name: str, label: str = "") -> Archive:
        """Unpack a package into a file without a name, which is gone when it is closed."""
        if self._depth >= limits.NESTING_LIMIT:
            text = f"{name!r} is a package inside {limits.NESTING_LIMIT} others; that is the limit"
            raise breach("PKG004", f"{self.label}: {text}")
        with InterruptGuard():  # the first look for the temporary folder tries it with a file
            file = tempfile.TemporaryFile(prefix="vdfmu_")
        try:
            self.copy(name, file)
        except BaseException:
            file.close()
            raise
        return Archive(file, label or f"{self.label}: {name}", self)

    def read(self, name: str) -> bytes:
        """Return the content of one member; SspError when it is missing, damaged or too large for the memory."""
        archive, name = self._split(name) or (self, name)
        return b"".join(archive._blocks(name, limits.XML_LIMIT, kept=True))

    def head(self, name: str) -> bytes:
        """Return the first bytes of one member, 256 KiB at most; the rest is unpacked to verify its checksum."""
        blocks = self._blocks(name)
        head = next(blocks, b"")
        for _ in blocks:
            pass
        return head

    def copy(self, name: str, target: IO[bytes]) -> None:
        """Write one member to a file, piece by piece."""
        archive, name = self._split(name) or (self, name)
        for block in archive._blocks(name):
            target.write(block)

    def _blocks(self, name: str, limit: int | None = None, kept: bool = False) -> Iterator[bytes]:
        """Yield one member piece by piece: its actual bytes are counted, never more than it declares."""
        info = self._members.get(name)
        if info is None:
            raise breach("SSP011", f"{self.label}: the package has no {name!r}")
        if limit is not None and info.file_size > limit * self._budget.scale:
            most = f"{limit * self._budget.scale:.0f}"
            raise breach("PKG004", f"{self.label}: {name!r} has {info.file_size} bytes; the limit is {most}")
        try:
            with self._zip.open(info) as stream:
                while block := stream.read(_BLOCK):
                    self._budget.spend(len(block), kept)
                    yield block
        except SspError:
            raise
        except (OSError, zipfile.BadZipFile, EOFError, NotImplementedError, ValueError) as error:
            _blame_disk(self.label, error)
            raise breach("PKG001", f"{self.label}: {name!r} cannot be unpacked: {error}") from None
        except Exception as error:  # zlib.error and its like have no common base
            raise breach("PKG001", f"{self.label}: {name!r} is damaged: {error}") from None

    def extract(self, folder: Path, keep: Callable[[str], bool]) -> None:
        """Write the members for which `keep(name)` holds below `folder`."""
        for name in self._members:
            if keep(name):
                target = folder / name
                target.parent.mkdir(parents=True, exist_ok=True)
                with target.open("wb") as file:
                    self.copy(name, file)

    def close(self) -> None:
        """Close the file."""
        for inner in self._inner.values():
            inner.close()
        self._zip.close()
        self.file.close()

    def __enter__(self) -> Archive:
        return self

    def __exit__(self, *args: object) -> None:
        self.close()


def _blame_disk(label: str, error: Exception) -> None:
    """Raise UsageError for an error of the disk, which is not the fault of a package."""
    if reason := disk_error(error):
        text = f"{label}: cannot be read: {reason.strerror}. Give the same command again once it can be read."
        raise UsageError(text) from error


def is_inside(name: str) -> bool:
    """Whether a member name or relative path stays inside its package."""
    return bool(name) and not (name[0] == "/" or ".." in name.split("/") or "\\" in name or ":" in name or "\0" in name)


def resolve(source: str, where: str, at: Any = ("", 0)) -> str:
    """Turn a URI of an SSD into the name of a member; SspError when it leaves the package."""
    parts = urlsplit(source)
    name = unquote(parts.path)
    if parts.scheme or parts.netloc or parts.query or parts.fragment or not is_inside(name):
        text = f"{where}: source {source!r} is not a relative path inside the package; "
        raise breach("SSP012", f"{text}put the file into the package and name it by its path there", at)
    return str(PurePosixPath(name))
