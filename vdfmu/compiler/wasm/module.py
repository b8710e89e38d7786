"""Modules of WebAssembly: functions, tables and room added to a module that a compiler has made.

Specification: WebAssembly Core 2.0, sections 5.4 (instructions) and 5.5 (modules).
"""

from __future__ import annotations

import struct
from collections.abc import Iterator, Sequence

from vdfmu.base.files import data_path

INTEGER, NUMBER = b"\x7f", b"\x7c"
"""Types: i32, f64."""
LOAD, STORE = b"\x2b\x03", b"\x39\x03"
"""Of a number at an address and an offset, which follows."""
SET = b"\x21"
"""Sets a local, whose number follows."""
COPY = b"\xfc\x0a\0\0"
"""Copies bytes: address to write to, address to read from, number."""
_PAGE = 65536
_TYPES, _IMPORTS, _FUNCTIONS, _TABLES, _MEMORIES, _EXPORTS, _ELEMENTS, _BODIES, _DATA = 1, 2, 3, 4, 5, 7, 9, 10, 11
"""Sections that are kept; others are not needed."""
_HEAD = b"\0asm\x01\0\0\0"


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
    """A module that grows.

    Parameters
    ----------
    base : bytes
        A module with one memory and one table, that imports functions at most. These keep their indices.

    Attributes
    ----------
    functions : dict of str to int
        Names of the functions of `base` to their indices.
    """

    def __init__(self, base: bytes) -> None:
        self._sections = dict(_sections(base))
        self.functions = dict(_exported(self._sections[_EXPORTS]))
        self._next = sum(_read(self._sections.get(kind, b"\0"), 0)[0] for kind in (_IMPORTS, _FUNCTIONS))
        self._end = _PAGE * _read(self._sections[_MEMORIES], 2)[0]
        self._slots = _read(self._sections[_TABLES], 3)[0]
        self._types: dict[bytes, int] = {}
        self._added: dict[int, list[bytes]] = {}
        self._indirect: list[int] = []

    def _add(self, section: int, item: bytes) -> None:
        self._added.setdefault(section, []).append(item)

    def function(self, arguments: bytes, results: bytes, locals_: Sequence[tuple[int, bytes]], code: bytes) -> int:
        """Add a function, with `locals_` a number of each type; return its index."""
        kind = b"\x60" + unsigned(len(arguments)) + arguments + unsigned(len(results)) + results
        if kind not in self._types:
            self._types[kind] = _read(self._sections[_TYPES], 0)[0] + len(self._types)
            self._add(_TYPES, kind)
        self._add(_FUNCTIONS, unsigned(self._types[kind]))
        declared = unsigned(len(locals_)) + b"".join(unsigned(n) + type_ for n, type_ in locals_)
        self._add(_BODIES, _sized(declared + code + b"\x0b"))
        self._next += 1
        return self._next - 1

    def slot(self, function: int) -> int:
        """Return the place in the table of a function, which C sees as a pointer to it."""
        self._indirect.append(function)
        return self._slots + len(self._indirect) - 1

    def room(self, size: int) -> int:
        """Return the address of so many bytes, 0 at first, on a multiple of 8."""
        address = self._end
        self._end += -(-size // 8) * 8
        return address

    def data(self, content: bytes) -> int:
        """Return the address of a content."""
        address = self.room(len(content))
        self._add(_DATA, b"\0" + constant(address) + b"\x0b" + _sized(content))
        return address

    def module(self, exported: dict[str, int]) -> bytes:
        """Return the module; of its functions it exports some, with its memory."""
        names = {**exported, "memory": 0}
        exports = [_sized(name.encode()) + bytes([2 * (name == "memory")]) + unsigned(k) for name, k in names.items()]
        sections = {
            **self._sections,
            _MEMORIES: b"\x01" + b"\0" + unsigned(-(-self._end // _PAGE)),
            _TABLES: b"\x01\x70\0" + unsigned(self._slots + len(self._indirect)),
            _EXPORTS: unsigned(len(exports)) + b"".join(exports),
        }
        if self._indirect:
            listed = unsigned(len(self._indirect)) + b"".join(map(unsigned, self._indirect))
            self._added[_ELEMENTS] = [b"\0" + constant(self._slots) + b"\x0b" + listed]
        for section, items in self._added.items():
            count, begin = _read(sections.get(section, b"\0"), 0)
            sections[section] = unsigned(count + len(items)) + sections.get(section, b"")[begin:] + b"".join(items)
        return _HEAD + b"".join(bytes([kind]) + _sized(sections[kind]) for kind in sorted(sections))


def _sized(content: bytes) -> bytes:
    return unsigned(len(content)) + content


def _sections(module: bytes) -> Iterator[tuple[int, bytes]]:
    """Yield number and content of the sections of a module that are kept."""
    at = len(_HEAD)
    while at < len(module):
        kind = module[at]
        size, begin = _read(module, at + 1)
        at = begin + size
        if kind in range(_TYPES, _DATA + 1):
            yield kind, module[begin:at]


def _exported(section: bytes) -> Iterator[tuple[str, int]]:
    """Yield name and index of the exported functions."""
    count, at = _read(section, 0)
    for _ in range(count):
        size, begin = _read(section, at)
        index, at = _read(section, begin + size + 1)
        if section[begin + size] == 0:
            yield section[begin : begin + size].decode(), index


def _read(content: bytes, at: int) -> tuple[int, int]:
    """Return an unsigned integer, and where the next begins."""
    value = shift = 0
    while True:
        byte = content[at]
        value |= (byte & 0x7F) << shift
        at, shift = at + 1, shift + 7
        if byte < 0x80:
            return value, at
