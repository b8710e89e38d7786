"""Safe reading and unpacking of zip packages."""

from __future__ import annotations

import stat
import tempfile
import zipfile
from bisect import bisect
from collections.abc import Callable, Generator, Iterator
from contextlib import ExitStack, closing, contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import IO, Any
from urllib.parse import unquote, urlsplit

from vdfmu.base.errors import SspError, UsageError, disk_error
from vdfmu.base.files import storing
from vdfmu.base.interrupt import InterruptGuard
from vdfmu.engine.rules import Finding, breach, finding

XML_LIMIT = 64 * 2**20
"""Largest member that is read into memory [byte], such as XML."""
MEMBER_LIMIT = 512 * 2**20
"""Largest member of any kind [byte]."""
TOTAL_LIMIT = 2 * 2**30
"""Most unpacked bytes of a package, including its FMUs; `package_limit` changes it."""
MEMORY_LIMIT = 256 * 2**20
"""Limit of these bytes in memory."""
COUNT_LIMIT = 65_535
"""Most members of a package: more would need the ZIP64 format, which SSP 1.0 excludes."""
DIRECTORY_LIMIT = 16 * 2**20
"""Largest directory of a zip file [byte]: about 250 per member."""
PACKAGE_LIMIT = 256
"""Most FMUs of a package from which parameter sets are read; each is an open file."""
ELEMENT_LIMIT = 10_000
"""Most elements of a system and its nested systems."""
DEPTH_LIMIT = 32
"""Deepest nesting of systems."""
_WAY = "that is the limit. If you trust the file: --unpack-limit, or package_limit of vdfmu.engine.package.archive"

_chosen: ContextVar[int | None] = ContextVar("_chosen", default=None)


@contextmanager
def package_limit(total: int | None) -> Generator[None]:
    """Limit how much of each package opened in a ``with`` block may be unpacked.

    Parameters
    ----------
    total : int or None [byte]
        Replaces `TOTAL_LIMIT`; None keeps it. The limits of single members and of memory change in proportion.
    """
    token = _chosen.set(_chosen.get() if total is None else total)
    try:
        yield
    finally:
        _chosen.reset(token)


def unpack_limit() -> int:
    """Return the number of bytes that may be unpacked from a package opened now."""
    return _chosen.get() or TOTAL_LIMIT


@dataclass
class Budget:
    """Counts the bytes actually unpacked from a package and its contents."""

    label: str
    scale: float
    unpacked: int = 0
    kept: int = 0
    packages: int = 0

    def spend(self, count: int, kept: bool) -> None:
        """Count bytes that were unpacked; SspError beyond the limit."""
        self.unpacked += count
        self.kept += count if kept else 0
        totals = (self.unpacked, TOTAL_LIMIT, "bytes unpacked"), (self.kept, MEMORY_LIMIT, "bytes of XML")
        for spent, limit, unit in totals:
            if spent > limit * self.scale:
                text = f"{self.label}: has more than {limit * self.scale:.0f} {unit}, including FMUs inside it"
                raise breach("PKG004", f"{text} and repeated members; {_WAY}")


_SHOWN = 50
"""Most faulty members in a message."""
_BLOCK = 2**18
"""Number of bytes unpacked at a time."""


def stamp_of(path: Path) -> tuple[int, ...]:
    """Return numbers that change with a file's content; empty for a missing file."""
    try:
        state = path.stat()
    except OSError:
        return ()
    return state.st_dev, state.st_ino, state.st_size, state.st_mtime_ns


class Archive:
    """A zip file with checked names and sizes.

    `label` is its name in messages, `outer` the package around an FMU; both share the limits of unpacked bytes.

    Raises
    ------
    SspError
        The file is missing or not a zip, or a member points outside the package, occurs twice with different contents,
        differs from another only in case, is a link, is encrypted, is compressed with a method other than deflate, or
        exceeds the limits of `package_limit`.
    """

    def __init__(self, source: Path | IO[bytes], label: str, outer: Archive | None = None) -> None:
        self.label = label
        self._budget = outer._budget if outer else Budget(label, unpack_limit() / TOTAL_LIMIT)
        self._inner: dict[str, Archive] = {}
        self.notes: list[Finding] = []
        with ExitStack() as opened:
            if isinstance(source, Path) and source.exists() and not (source.is_file() or source.is_dir()):
                special = "is a pipe, a device or another special file; expected a regular one"
                raise breach("PKG001", f"{label}: {special}")
            try:
                self.file: IO[bytes] = source.open("rb") if isinstance(source, Path) else source
                opened.push(closing(self.file))
                self._zip = self._directory()
            except FileNotFoundError:
                fix = ". Give another path, or write it by 'vdfmu ssp'" if label.endswith(".ssp") else ""
                raise breach("PKG001", f"{label}: there is no such file{fix}") from None
            except (OSError, NotImplementedError, ValueError, zipfile.BadZipFile) as error:
                _blame_disk(label, error)
                text = f"{label}: cannot be read as a zip package: {error}. It may be cut off; "
                raise breach("PKG001", f"{text}export or copy it again") from None
            self._members = self._check()
            opened.pop_all()

    def _directory(self) -> zipfile.ZipFile:
        """Read the directory of the file if its size is within the limit, because each entry takes memory."""
        end: Any = zipfile._EndRecData(self.file)  # pyright: ignore[reportAttributeAccessIssue]
        size = end[zipfile._ECD_SIZE] if end else 0  # pyright: ignore[reportAttributeAccessIssue]
        if size > DIRECTORY_LIMIT:
            text = f"{self.label}: has a directory of {size} bytes; the limit is {DIRECTORY_LIMIT}. "
            raise breach("PKG004", f"{text}Pack fewer files")
        return zipfile.ZipFile(self.file)

    def _check(self) -> dict[str, zipfile.ZipInfo]:
        problems: list[Finding] = []

        def fault(rule: str, text: str) -> None:
            problems.append(finding(rule, f"{self.label}: {text}"))

        members: dict[str, zipfile.ZipInfo] = {}
        folded: dict[str, str] = {}
        twice: list[tuple[zipfile.ZipInfo, zipfile.ZipInfo]] = []
        infos, limit = self._zip.infolist(), MEMBER_LIMIT * self._budget.scale
        if len(infos) > COUNT_LIMIT:
            fault("PKG004", f"has {len(infos)} entries; the limit is {COUNT_LIMIT}")
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
                same = f"entries {other!r} and {name!r} are one file"
                fault("PKG006", f"{same} where case or a final '/' does not count; rename one")
            members[name] = info
        ordered = [*sorted(members), ""]
        for name in (each for each in ordered if each and not each.endswith("/")):
            below = ordered[bisect(ordered, f"{name}/", hi=len(members))]
            if below.startswith(f"{name}/"):
                fault("PKG006", f"entry {name!r} is a file and the folder of {below!r}")
        total, limit = sum(info.file_size for info in infos), TOTAL_LIMIT * self._budget.scale
        if not problems and total > limit:
            fault("PKG004", f"holds {total} bytes unpacked; the limit is {limit:.0f} (--unpack-limit)")
        bounded = not problems  # so that it may be unpacked
        for first, second in twice:
            alike = (first.file_size, first.CRC) == (second.file_size, second.CRC)
            if alike and (not bounded or self._same(first, second)):
                text = f"entry {first.filename!r} occurs more than once, with the same content"
                self.notes.append(finding("PKG007", text))
            else:
                fault("PKG006", f"entry {first.filename!r} occurs twice, with different contents")
        if len(problems) > _SHOWN:
            more = f"{self.label}: and {len(problems) - _SHOWN} more such entries"
            problems[_SHOWN:] = [problems[_SHOWN].reworded(more)]
        if problems:
            raise SspError(problems)
        return {name: info for name, info in members.items() if not info.is_dir()}

    def _same(self, first: zipfile.ZipInfo, second: zipfile.ZipInfo) -> bool:
        """Return whether two entries have the same content; False if either cannot be unpacked."""
        try:
            with self._zip.open(first) as stream, self._zip.open(second) as other:
                while block := stream.read(_BLOCK):
                    self._budget.spend(2 * len(block), False)
                    if other.read(_BLOCK) != block:
                        return False
                return not other.read(1)
        except SspError:
            raise
        except Exception:  # zlib.error and similar errors have no common base
            return False

    @property
    def names(self) -> list[str]:
        """The names of all files in the package."""
        return list(self._members)

    def __contains__(self, name: str) -> bool:
        return name in self._members

    def inside(self, name: str) -> Archive:
        """Return an FMU inside the package, which is closed with the package."""
        if name not in self._inner:
            if self._budget.packages >= PACKAGE_LIMIT:
                many = f"has more than {PACKAGE_LIMIT} FMUs with parameter sets; that is the limit"
                raise breach("PKG004", f"{self._budget.label}: {many}")
            self._inner[name] = self._open(name)
            self._budget.packages += 1
        return self._inner[name]

    def opened(self, name: str, label: str) -> Archive:
        """Open an FMU inside the package, for a ``with`` block."""
        return self._open(name, label)

    def _open(self, name: str, label: str = "") -> Archive:
        """Unpack an FMU into an anonymous temporary file."""
        with InterruptGuard():  # the first search for the temporary folder creates a file in it
            file = tempfile.TemporaryFile(prefix="vdfmu_")
        try:
            with storing(Path(tempfile.gettempdir())):
                self.copy(name, file)
        except BaseException:
            file.close()
            raise
        return Archive(file, label or f"{self.label}: {name}", self)

    def read(self, name: str) -> bytes:
        """Return the content of a member; SspError if it is missing, damaged or too large for the memory."""
        return b"".join(self._blocks(name, XML_LIMIT, kept=True))

    def head(self, name: str) -> bytes:
        """Return at most the first 256 KiB of a member; the rest is unpacked only to verify the checksum."""
        blocks = self._blocks(name)
        head = next(blocks, b"")
        for _ in blocks:
            pass
        return head

    def copy(self, name: str, target: IO[bytes]) -> None:
        """Write a member to a file in blocks."""
        target.writelines(self._blocks(name))

    def _blocks(self, name: str, limit: int | None = None, kept: bool = False) -> Iterator[bytes]:
        """Yield a member in blocks, counting the actual bytes, and never more than it declares."""
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
        except Exception as error:  # zlib.error and similar errors have no common base
            raise breach("PKG001", f"{self.label}: {name!r} is damaged: {error}") from None

    def extract(self, folder: Path, keep: Callable[[str], bool]) -> None:
        """Write the members for which `keep(name)` is true below `folder`."""
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
    """Raise UsageError for an error of the disk, which is no fault of the package."""
    if reason := disk_error(error):
        text = f"{label}: cannot be read: {reason.strerror}. Repeat the command once it can be read."
        raise UsageError(text) from error


def is_inside(name: str) -> bool:
    """Whether a member name or relative path stays inside its package."""
    return bool(name) and not (name[0] == "/" or ".." in name.split("/") or "\\" in name or ":" in name or "\0" in name)


def resolve(source: str, where: str, at: Any = ("", 0)) -> str:
    """Return the member named by a URI in an SSD; SspError if it is outside the package."""
    parts = urlsplit(source)
    name = unquote(parts.path)
    if parts.scheme or parts.netloc or parts.query or parts.fragment or not is_inside(name):
        text = f"{where}: source {source!r} is not a relative path inside the package; "
        raise breach("SSP012", f"{text}put the file into the package and name it by its path there", at)
    return str(PurePosixPath(name))
