"""Modules of WebAssembly that call functions of a compiled module.

Specification: WebAssembly Core 2.0, sections 5.4 (instructions) and 5.5 (modules).
"""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence

from vdfmu.base.files import data_path

INTEGER, NUMBER = b"\x7f", b"\x7c"
"""Types: i32, f64."""
LOAD, STORE = b"\x2b\x03", b"\x39\x03"
"""Load and store a number at an address and an offset. The offset follows."""
SET = b"\x21"
"""Set a local. Its number follows."""
COPY = b"\xfc\x0a\0\0"
"""Copy bytes: target, source, number."""
_PAGE = 65536
BASE_PAGES, BASE_SLOTS = 2, 1
"""Pages of memory and slots of the table that the shipped module has by itself."""


def unsigned(n: int) -> bytes:
    """Return an unsigned integer in LEB128."""
    found = bytearray()
    while n > 0x7F:
        found.append(n & 0x7F | 0x80)
        n >>= 7
    return bytes([*found, n])


def constant(n: int) -> bytes:
    """Return the instruction that pushes an integer, in signed LEB128."""
    found = bytearray(b"\x41")
    while not -0x40 <= n < 0x40:
        found.append(n & 0x7F | 0x80)
        n >>= 7
    return bytes([*found, n & 0x7F])


def number(x: float) -> bytes:
    """Return the instruction that pushes a number."""
    return b"\x44" + struct.pack("<d", x)


def local(k: int) -> bytes:
    """Return the instruction that pushes a local."""
    return b"\x20" + unsigned(k)


def call(k: int) -> bytes:
    """Return the instruction that calls a function."""
    return b"\x10" + unsigned(k)


def return_if_not(n: int) -> bytes:
    """Return the instructions that end a function with an integer if the number on the stack is 0."""
    return b"\x45\x04\x40" + constant(n) + b"\x0f\x0b"


def base_module() -> bytes:
    """Return the shipped module: the solver in a communication step, and functions of the C library."""
    return (data_path("fmu_src") / "batch" / "module.wasm").read_bytes()


class Assembler:
    """A module that works in memory and table of another, ``base``, and calls functions of it.

    Parameters
    ----------
    imported : mapping of str to (bytes, bytes)
        Names of these functions to the types of arguments and results.

    Attributes
    ----------
    functions : dict of str to int
        Names of these functions to their indices.
    """

    def __init__(self, imported: Mapping[str, tuple[bytes, bytes]]) -> None:
        self.functions = {name: k for k, name in enumerate(imported)}
        self._types: dict[bytes, int] = {}
        kinds = {name: b"\0" + self._type(*kind) for name, kind in imported.items()}
        kinds |= {"memory": b"\2\0\0", "__indirect_function_table": b"\1\x70\0\0"}
        self._imports = [_sized(b"base") + _sized(name.encode()) + kind for name, kind in kinds.items()]
        self._kinds: list[bytes] = []
        self._bodies: list[bytes] = []
        self._data: list[bytes] = []
        self._indirect: list[bytes] = []
        self._end = BASE_PAGES * _PAGE

    @property
    def growth(self) -> tuple[int, int]:
        """Pages and slots by which memory and table of the base must grow before."""
        return -(-self._end // _PAGE) - BASE_PAGES, len(self._indirect)

    def _type(self, arguments: bytes, results: bytes) -> bytes:
        kind = b"\x60" + _sized(arguments) + _sized(results)
        return unsigned(self._types.setdefault(kind, len(self._types)))

    def function(self, arguments: bytes, results: bytes, locals_: Sequence[tuple[int, bytes]], code: bytes) -> int:
        """Add a function, with `locals_` a number of each type; return its index."""
        self._kinds.append(self._type(arguments, results))
        declared = _list([unsigned(n) + type_ for n, type_ in locals_])
        self._bodies.append(_sized(declared + code + b"\x0b"))
        return len(self.functions) + len(self._bodies) - 1

    def slot(self, function: int) -> int:
        """Put a function into the table; return its place, a pointer in C."""
        self._indirect.append(unsigned(function))
        return BASE_SLOTS + len(self._indirect) - 1

    def room(self, size: int) -> int:
        """Return the address of so many bytes, 0 at first, on a multiple of 8."""
        address = self._end
        self._end += -(-size // 8) * 8
        return address

    def data(self, content: bytes) -> int:
        """Return the address of a content."""
        address = self.room(len(content))
        self._data.append(b"\0" + constant(address) + b"\x0b" + _sized(content))
        return address

    def module(self, exported: Mapping[str, int]) -> bytes:
        """Return the module with these functions exported."""
        exports = [_sized(name.encode()) + b"\0" + unsigned(k) for name, k in exported.items()]
        elements = [b"\0" + constant(BASE_SLOTS) + b"\x0b" + _list(self._indirect)]
        sections = {1: [*self._types], 2: self._imports, 3: self._kinds, 7: exports, 9: elements}
        sections |= {10: self._bodies, 11: self._data}
        return b"\0asm\x01\0\0\0" + b"".join(bytes([kind]) + _sized(_list(own)) for kind, own in sections.items())


def _sized(content: bytes) -> bytes:
    return unsigned(len(content)) + content


def _list(items: Sequence[bytes]) -> bytes:
    return unsigned(len(items)) + b"".join(items)
