"""Packages that unpack to very much: small files, read by a process with little memory."""

import struct
import subprocess
import sys
import zlib
from functools import lru_cache
from pathlib import Path

from tests.engine.texts import SPACES
from tests.hostile.packages import pack
from tests.hostile.table import Corpus
from vdfmu.base.errors import SspError

MEMORY = 2**30
"""Address space of the process [byte]; Python and lxml take a third of it, the largest XML in memory the next."""
_MIB = 2**20


@lru_cache
def _zeros(mebibytes: int, byte: bytes = b"\0") -> tuple[bytes, int]:
    """Return so many MiB of one byte, deflated, and their check sum: one block of 1 MiB again and again."""
    packer = zlib.compressobj(9, zlib.DEFLATED, -15)
    block = packer.compress(byte * _MIB) + packer.flush(zlib.Z_FULL_FLUSH)
    crc = 0
    for _ in range(mebibytes):
        crc = zlib.crc32(byte * _MIB, crc)
    return block * mebibytes + packer.flush(), crc


def _zip(members: list[tuple[str, bytes, int, int]]) -> bytes:
    """Return a zip file of deflated members: name, what is stored, check sum, declared size."""
    files, directory = b"", b""
    for name, data, crc, size in members:
        head = struct.pack("<HHHHHIIIHH", 20, 0, 8, 0, 33, crc, len(data), size, len(name), 0)
        directory += b"PK\x01\x02\x14\0" + head + struct.pack("<HHHII", 0, 0, 0, 0, len(files)) + name.encode()
        files += b"PK\x03\x04" + head + name.encode() + data
    end = struct.pack("<HHHHIIH", 0, 0, len(members), len(members), len(directory), len(files), 0)
    return files + directory + b"PK\x05\x06" + end


def _ssd(inside: str) -> bytes:
    return (
        f'<ssd:SystemStructureDescription {SPACES} version="1.0" name="b"><ssd:System name="b">{inside}</ssd:System>'
        "</ssd:SystemStructureDescription>"
    ).encode()


def _elements(names: list[str], kind: str = "application/x-ssp-package") -> str:
    items = "".join(f'<ssd:Component name="c{i}" type="{kind}" source="{n}"/>' for i, n in enumerate(names))
    return f"<ssd:Elements>{items}</ssd:Elements>"


def _member(name: str, text: bytes) -> tuple[str, bytes, int, int]:
    packer = zlib.compressobj(9, zlib.DEFLATED, -15)
    return name, packer.compress(text) + packer.flush(), zlib.crc32(text), len(text)


def _nested(levels: int, fan: int, mebibytes: int) -> bytes:
    """Return packages in packages, each with a large member."""
    data, crc = _zeros(mebibytes)
    filler = ("resources/zeros", data, crc, mebibytes * _MIB)
    inner = _zip([_member("SystemStructure.ssd", _ssd("")), filler])
    for _ in range(levels):
        names = [f"{i}.ssp" for i in range(fan)]
        head = _member("SystemStructure.ssd", _ssd(_elements(names)))
        inner = _zip([head, *(_member(name, inner) for name in names), filler])
    return inner


def _fmus(count: int, mebibytes: int) -> bytes:
    """Return FMUs whose library is large, twice packed."""
    data, crc = _zeros(mebibytes)
    fmu = _zip(
        [
            _member("modelDescription.xml", b'<fmiModelDescription fmiVersion="2.0"/>'),
            ("binaries/linux64/x.so", data, crc, mebibytes * _MIB),
        ]
    )
    names = [f"resources/{i}.fmu" for i in range(count)]
    head = _member("SystemStructure.ssd", _ssd(_elements(names, "application/x-fmu-sharedlibrary")))
    return _zip([head, *(_member(name, fmu) for name in names)])


def _zip_in_zip(mebibytes: int) -> bytes:
    """Return a package with one inside that unpacks to a large one, whose only member is as large again."""
    data, crc = _zeros(mebibytes)
    inner = _zip([_member("SystemStructure.ssd", _ssd("")), ("zeros", data, crc, mebibytes * _MIB)]) + bytes(8)
    return _zip([_member("SystemStructure.ssd", _ssd(_elements(["a.ssp"]))), _member("a.ssp", inner)])


def _values(bindings: int, mebibytes: int) -> bytes:
    """Return one large set of parameters, bound again and again."""
    data, crc = _zeros(mebibytes, b" ")
    items = '<ssd:ParameterBinding source="v.ssv"/>' * bindings
    head = _ssd(f"<ssd:ParameterBindings>{items}</ssd:ParameterBindings>")
    return _zip([_member("SystemStructure.ssd", head), ("v.ssv", data, crc, mebibytes * _MIB)])


def _directory(entries: int) -> bytes:
    """Return a package with one inside whose directory has very many entries, all of one member."""
    entry = b"PK\x01\x02\x14\0" + struct.pack("<HHHHHIIIHH", 20, 0, 0, 0, 33, 0, 0, 0, 1, 0) + bytes(14) + b"a"
    end = struct.pack("<HHHHIIH", 0, 0, 65535, 65535, len(entry) * entries, 0, 0)
    inner = entry * entries + b"PK\x05\x06" + end
    return pack({"SystemStructure.ssd": _ssd(_elements(["a.ssp"])), "a.ssp": inner})


def _false_size(declared: int, mebibytes: int, name: str) -> bytes:
    data, crc = _zeros(mebibytes)
    kind = "application/x-ssp-package" if name.endswith(".ssp") else "application/x-fmu-sharedlibrary"
    head = _member("SystemStructure.ssd", _ssd(_elements([name], kind)))
    return _zip([head, (name, data, crc, declared)])


MAKERS = [
    lambda: _false_size(100, 2200, "a.ssp"),  # 3 MB that declare 100 bytes
    lambda: _false_size(100, 2200, "resources/a.fmu"),
    lambda: _false_size(2**32 - 2, 1, "a.ssp"),
    lambda: _zip_in_zip(500),
    lambda: _nested(3, 1, 400),
    lambda: _nested(2, 6, 60),
    lambda: _nested(12, 1, 1),
    lambda: _fmus(40, 400),
    lambda: _values(200, 60),
    lambda: _values(3, 500),
    lambda: _directory(5_000_000),
    lambda: _zip([(n, *_zeros(500, b" "), 500 * _MIB) for n in ("SystemStructure.ssd", "a", "b")]),
    lambda: _zip([(n, *_zeros(500, b" "), 500 * _MIB) for n in ("SystemStructure.ssd", "a", "b", "c", "d")]),
    lambda: _zip([("SystemStructure.ssd", *_zeros(63, b" "), 63 * _MIB)]),
    lambda: _zip([("SystemStructure.ssd", *_zeros(63, b"<"), 63 * _MIB)]),
    lambda: pack({"SystemStructure.ssd": b"<a>" * 3_000_000}),
    lambda: pack({"SystemStructure.ssd": _ssd("<ssd:Elements>" + "<a/>" * 500_000 + "</ssd:Elements>")}),
]
_CHECK = (
    "import resource, sys; from vdfmu.cli import main; "
    "resource.setrlimit(resource.RLIMIT_AS, (int(sys.argv[1]),) * 2); sys.argv[1:] = sys.argv[2:]; main()"
)


def bomb(number: int, folder: Path) -> None:
    """Check a bomb in a process that has 1 GiB; it must be refused in words."""
    path = folder / "x.ssp"
    path.write_bytes(MAKERS[number % len(MAKERS)]())
    done = subprocess.run(
        [sys.executable, "-c", _CHECK, str(MEMORY), "check", str(path), "--no-run"], capture_output=True, text=True,
        timeout=300,
    )  # fmt: skip
    if done.returncode != 1 or "problem: " not in done.stdout or "Traceback" in done.stderr:
        raise AssertionError(f"exit code {done.returncode}: {(done.stdout + done.stderr)[-500:]}")
    raise SspError(done.stdout)


CORPORA = [Corpus("decompression bombs", len(MAKERS), bomb, quick=4, seconds=60.0)]
