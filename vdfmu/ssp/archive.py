"""Safe reading of zip packages and of the XML inside them."""

from __future__ import annotations

import io
import stat
import zipfile
from functools import lru_cache
from pathlib import Path, PurePosixPath
from typing import Any
from urllib.parse import unquote, urlsplit

import fmpy.ssp
from lxml import etree  # pyright: ignore[reportAttributeAccessIssue]

from vdfmu.errors import SspError

XML_LIMIT = 64 * 2**20
"""Largest XML member that is parsed [byte]."""
MEMBER_LIMIT = 512 * 2**20
"""Largest member of any kind [byte]."""
TOTAL_LIMIT = 2 * 2**30
"""Largest sum of all members of one package [byte]."""
COUNT_LIMIT = 65_535
"""Most members of one package: more need the ZIP64 format, which SSP 1.0 excludes."""
NESTING_LIMIT = 8
"""Most packages inside each other."""
ELEMENT_LIMIT = 10_000
"""Most elements of a system and the systems in it, each counted as often as it is referred to."""
DEPTH_LIMIT = 32
"""Most systems inside each other, written there or referred to."""
INSIDE = "!/"
"""Between the name of a package inside a package and the name of a member of it."""
_SHOWN = 50
"""Most faulty members that one message lists."""

NAMESPACES = {
    prefix: f"http://ssp-standard.org/SSP1/{name}"
    for prefix, name in {
        "ssc": "SystemStructureCommon",
        "ssd": "SystemStructureDescription",
        "ssv": "SystemStructureParameterValues",
        "ssm": "SystemStructureParameterMapping",
        "ssb": "SystemStructureSignalDictionary",
    }.items()
}


class Archive:
    """A zip file whose member names and sizes have been checked.

    Parameters
    ----------
    source : path or bytes
        The file, or its content.
    label : str
        The name used in messages.

    Raises
    ------
    SspError
        The file is missing or no zip, or a member points outside the package, occurs twice with different
        contents, differs from another in case only, is a link, is encrypted, is packed by another method than
        deflation or is larger than the limits of this module.

    Attributes
    ----------
    doubled : list of str
        Members that occur more than once, with the same content.

    Notes
    -----
    ``package.ssp!/member`` names a member of a package inside the package.
    """

    def __init__(self, source: Path | bytes, label: str, depth: int = 0) -> None:
        self.label = label
        self._depth = depth
        self._inner: dict[str, Archive] = {}
        self.doubled: list[str] = []
        try:
            self._zip = zipfile.ZipFile(io.BytesIO(source) if isinstance(source, bytes) else source)
        except FileNotFoundError:
            raise SspError(f"{label}: there is no such file") from None
        except (OSError, zipfile.BadZipFile) as error:
            raise SspError(
                f"{label}: cannot be read as a zip package: {error}. "
                "It may be cut off; export or copy it again"
            ) from None
        try:
            self._members = self._check()
        except SspError:
            self._zip.close()
            raise

    def _check(self) -> dict[str, zipfile.ZipInfo]:
        problems: list[str] = []
        members: dict[str, zipfile.ZipInfo] = {}
        folded: dict[str, str] = {}
        twice: list[tuple[zipfile.ZipInfo, zipfile.ZipInfo]] = []
        infos = self._zip.infolist()
        if len(infos) > COUNT_LIMIT:
            raise SspError(f"{self.label}: has {len(infos)} entries; the limit is {COUNT_LIMIT}")
        for info in infos:
            if not is_inside(info.filename) or "\\" in info.orig_filename:
                problems.append(
                    f"{self.label}: entry {info.orig_filename!r} points outside the package; "
                    "expected a relative path with '/' between folders"
                )
            elif stat.S_ISLNK(info.external_attr >> 16):
                problems.append(
                    f"{self.label}: entry {info.filename!r} is a symbolic link; pack the file itself"
                )
            elif info.file_size > MEMBER_LIMIT:
                problems.append(
                    f"{self.label}: entry {info.filename!r} has {info.file_size} bytes; "
                    f"the limit is {MEMBER_LIMIT}"
                )
            elif info.flag_bits & 0x1:
                problems.append(
                    f"{self.label}: entry {info.filename!r} is encrypted; pack it without a password"
                )
            elif info.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
                problems.append(
                    f"{self.label}: entry {info.filename!r} is packed by method {info.compress_type}; "
                    "SSP and FMI allow 0 (stored) and 8 (deflated)"
                )
            elif info.filename in members:
                twice.append((members[info.filename], info))
            elif (
                other := folded.setdefault(info.filename.rstrip("/").lower(), info.filename)
            ) != info.filename:
                problems.append(
                    f"{self.label}: entries {other!r} and {info.filename!r} are one file where case or a final "
                    "'/' does not count; rename one"
                )
            members[info.filename] = info
        for name, info in members.items():
            above = [str(folder) for folder in PurePosixPath(name).parents]
            if clash := next((f for f in above if f in members and not members[f].is_dir()), None):
                problems.append(
                    f"{self.label}: entry {clash!r} is a file and the folder of {info.filename!r}"
                )
        total = sum(info.file_size for info in self._zip.infolist())
        if not problems and total > TOTAL_LIMIT:
            problems.append(f"{self.label}: holds {total} bytes unpacked; the limit is {TOTAL_LIMIT}")
        unpack = not problems  # what is unpacked is bounded then
        for one, other in twice:
            if (one.file_size, one.CRC) == (other.file_size, other.CRC) and (
                not unpack or self._same(one, other)
            ):
                self.doubled.append(one.filename)
            else:
                problems.append(f"{self.label}: entry {one.filename!r} occurs twice, with different contents")
        if len(problems) > _SHOWN:
            problems[_SHOWN:] = [f"{self.label}: and {len(problems) - _SHOWN} more such entries"]
        if problems:
            raise SspError(problems)
        return {name: info for name, info in members.items() if not info.is_dir()}

    def _same(self, one: zipfile.ZipInfo, other: zipfile.ZipInfo) -> bool:
        """Whether two entries have the same content; what cannot be unpacked has not."""
        try:
            return self._zip.read(one) == self._zip.read(other)
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
        if self._depth >= NESTING_LIMIT:
            raise SspError(
                f"{self.label}: {name!r} is a package inside {NESTING_LIMIT} others; that is the limit"
            )
        if name not in self._inner:
            self._inner[name] = Archive(self.read(name), f"{self.label}: {name}", self._depth + 1)
        return self._inner[name]

    def read(self, name: str, limit: int = MEMBER_LIMIT) -> bytes:
        """Return the content of one member; SspError when it is missing, damaged or too large."""
        info = self._members.get(name)
        if info is None and (found := self._split(name)) is not None:
            return found[0].read(found[1], limit)
        if info is None:
            raise SspError(f"{self.label}: the package has no {name!r}")
        if info.file_size > limit:
            raise SspError(f"{self.label}: {name!r} has {info.file_size} bytes; the limit is {limit}")
        try:
            return self._zip.read(info)  # never returns more than file_size
        except (OSError, zipfile.BadZipFile, EOFError, NotImplementedError, ValueError) as error:
            raise SspError(f"{self.label}: {name!r} cannot be unpacked: {error}") from None
        except Exception as error:  # zlib.error and its like have no common base
            raise SspError(f"{self.label}: {name!r} is damaged: {error}") from None

    def extract(self, folder: Path, keep: Any = None) -> None:
        """Write the members for which `keep(name)` holds (all without it) below `folder`."""
        for name in self._members:
            if keep is None or keep(name):
                target = folder / name
                target.parent.mkdir(parents=True, exist_ok=True)
                target.write_bytes(self.read(name))

    def close(self) -> None:
        """Close the file."""
        for inner in self._inner.values():
            inner.close()
        self._zip.close()

    def __enter__(self) -> Archive:
        return self

    def __exit__(self, *args: object) -> None:
        self.close()


def is_inside(name: str) -> bool:
    """Tell whether a member name or relative path stays inside its package."""
    path = PurePosixPath(name)
    return bool(name) and not (
        path.is_absolute() or ".." in path.parts or "\\" in name or ":" in name or "\0" in name
    )


def resolve(source: str, where: str) -> str:
    """Turn a URI of an SSD into the name of a member; SspError when it leaves the package."""
    parts = urlsplit(source)
    name = unquote(parts.path)
    if parts.scheme or parts.netloc or parts.query or parts.fragment or not is_inside(name):
        raise SspError(
            f"{where}: source {source!r} is not a relative path inside the package; "
            "put the file into the package and name it by its path there"
        )
    return str(PurePosixPath(name))


def parse_xml(data: bytes, where: str) -> Any:
    """Parse XML without entities, external files or network, and return its root.

    Raises
    ------
    SspError
        The text is not well-formed XML, or has a document type declaration or an XInclude.
    """
    if len(data) > XML_LIMIT:
        raise SspError(f"{where}: has {len(data)} bytes of XML; the limit is {XML_LIMIT}")
    parser = etree.XMLParser(
        resolve_entities=False, no_network=True, load_dtd=False, dtd_validation=False, huge_tree=False,
        remove_comments=True, remove_pis=True,
    )  # fmt: skip
    try:
        root = etree.fromstring(data, parser)
    except (etree.XMLSyntaxError, ValueError) as error:
        if b"<!DOCTYPE" in data:  # entities may be what the parser stumbles over
            raise SspError(f"{where}: {_DOCTYPE}") from None
        raise SspError(f"{where}: is not well-formed XML: {error}") from None
    if root.getroottree().docinfo.doctype or root.getroottree().docinfo.internalDTD is not None:
        raise SspError(f"{where}: {_DOCTYPE}")
    include = next(root.iter(f"{{{_XINCLUDE}}}*"), None)
    if include is not None:
        raise SspError(
            f"{where}, line {include.sourceline}: has an XInclude, which is refused; write the text in its place"
        )
    return root


_DOCTYPE = "has a document type declaration, which is refused (entities); remove it"
_XINCLUDE = "http://www.w3.org/2001/XInclude"


@lru_cache
def _schema(kind: str) -> Any:
    name = NAMESPACES[kind].rsplit("/", 1)[1]
    return etree.XMLSchema(file=str(Path(fmpy.ssp.__file__).parent / "schema" / f"{name}.xsd"))


def validate(root: Any, kind: str, where: str) -> None:
    """Check a tree against a schema of SSP 1.0.

    Parameters
    ----------
    root : element
    kind : str
        ``ssd``, ``ssv``, ``ssm`` or ``ssb``.
    where : str
        The name used in messages.
    """
    schema = _schema(kind)
    if not schema.validate(root):
        raise SspError([f"{where}, line {entry.line}: {entry.message}" for entry in schema.error_log])


def parse_ssp_xml(data: bytes, kind: str, where: str) -> Any:
    """Parse and validate one SSP file; `kind` as in `validate`."""
    root = parse_xml(data, where)
    space = etree.QName(root).namespace
    if space != NAMESPACES[kind]:
        raise SspError(f"{where}: expected namespace {NAMESPACES[kind]} (SSP 1.0), got {space}")
    validate(root, kind, where)
    return root
