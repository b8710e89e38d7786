"""Check of the shared libraries of an FMU by their first bytes: none of their code is run."""

from __future__ import annotations

import posixpath
import struct

import fmpy

_MAGIC = {
    ".so": (b"\x7fELF",),
    ".dll": (b"MZ",),
    ".wasm": (b"\0asm",),
    ".dylib": (b"\xcf\xfa\xed\xfe", b"\xce\xfa\xed\xfe", b"\xca\xfe\xba\xbe", b"\xca\xfe\xba\xbf"),
}
"""First bytes of a shared library."""
ENDINGS = tuple(_MAGIC)
_ELF = {3: "x86", 40: "arm", 62: "x86_64", 183: "aarch64", 243: "riscv"}
_PE = {0x14C: "x86", 0x1C0: "arm", 0x8664: "x86_64", 0xAA64: "aarch64"}


def library_fault(name: str, data: bytes) -> str | None:
    """Return the fault of a file that is named as a shared library, or None."""
    if data.startswith(_MAGIC[posixpath.splitext(name)[1]]):
        return None
    return f"{name}: is not a shared library of the kind its name says"


def architecture_fault(name: str, data: bytes) -> str | None:
    """Return why a library in a folder of this platform cannot be loaded by its processor, or None."""
    has = _architecture(data)
    if has is None or has == fmpy.architecture:
        return None
    return f"{name}: is compiled for {has}, this platform needs {fmpy.architecture}; build the FMU for it"


def _architecture(data: bytes) -> str | None:
    """Return the processor of an ELF or PE library; None where the header does not say."""
    try:
        if data.startswith(b"\x7fELF"):
            (number,) = struct.unpack_from("<H" if data[5] == 1 else ">H", data, 18)
            return _ELF.get(number, f"processor {number} (e_machine)")
        if data.startswith(b"MZ"):
            (head,) = struct.unpack_from("<I", data, 0x3C)
            (number,) = struct.unpack_from("<H", data, head + 4)
            return (
                _PE.get(number, f"processor {number:#x} (PE machine)") if data[head : head + 4] == b"PE\0\0" else None
            )
    except (struct.error, IndexError):  # truncated; loading reports it
        pass
    return None
