"""Modules of WebAssembly, written without a compiler: traced functions with the bits of their C.

They call functions of a compiled module. Specification: WebAssembly Core 2.0, sections 5.4 (instructions) and 5.5
(modules).
"""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator, Mapping, Sequence

import casadi as ca

from vdfmu.base.errors import KernelError
from vdfmu.base.files import data_path
from vdfmu.compiler.c.text import EXPRESSIONS
from vdfmu.compiler.functions.derivatives import instructions, lookup_table
from vdfmu.compiler.scalar.symbol import LOOKUP

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
    return bytes([n & 0x7F | 0x80]) + unsigned(n >> 7) if n > 0x7F else bytes([n])


def constant(n: int) -> bytes:
    """Return the instruction that pushes an integer, in signed LEB128."""
    code = bytearray(b"\x41")
    while not -0x40 <= n < 0x40:
        code.append(n & 0x7F | 0x80)
        n >>= 7
    return bytes([*code, n & 0x7F])


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


_ZERO = number(0.0)
_WORDS = {
    "+": b"\xa0", "-": b"\xa1", "*": b"\xa2", "/": b"\xa3", "<": b"\x63\xb7", "<=": b"\x65\xb7", "==": b"\x61\xb7",
    "!=": b"\x62\xb7", "sqrt": b"\x9f", "floor": b"\x9c", "ceil": b"\x9b", "fabs": b"\x99", "copysign": b"\xa6",
}  # fmt: skip
"""Words of the C with an instruction. Other functions are called, also fmin and fmax: their instructions keep NaN."""
_PATTERN = re.compile(r"(\w+)\(\{0\}(?:, (\{1\}))?\)|\{0\} (\S+) (\{1\})(?: \? 1\.0 : 0\.0)?")
"""C that calls a function, or has a word between operands. A comparison gives 1 or 0."""


def _operations() -> Iterator[tuple[int, tuple[int | bytes | str, ...]]]:
    for operation, text in EXPRESSIONS.items():
        if match := _PATTERN.fullmatch(text):
            word = match[1] or match[3]
            yield operation, (0, *([1] if match[2] or match[4] else []), _WORDS.get(word, word))


OPERATIONS: dict[int, tuple[int | bytes | str, ...]] = dict(_operations()) | {
    ca.OP_ASSIGN: (0,),
    ca.OP_NEG: (0, b"\x9a"),
    ca.OP_SQ: (0, 0, b"\xa2"),
    ca.OP_TWICE: (number(2.0), 0, b"\xa2"),
    ca.OP_INV: (number(1.0), 0, b"\xa3"),
    ca.OP_SIGN: (0, _ZERO, b"\x64\xb7", 0, _ZERO, b"\x63\xb7\xa1"),
    ca.OP_NOT: (0, _ZERO, b"\x61\xb7"),
    ca.OP_AND: (0, _ZERO, b"\x62", 1, _ZERO, b"\x62\x71\xb7"),
    ca.OP_OR: (0, _ZERO, b"\x62", 1, _ZERO, b"\x62\x72\xb7"),
    ca.OP_IF_ELSE_ZERO: (1, _ZERO, 0, _ZERO, b"\x62\x1b"),
}
"""Operation to its code: operands, instructions, functions of the C library."""

IMPORTED = {
    pieces[-1]: (NUMBER * (len(pieces) - 1), NUMBER) for pieces in OPERATIONS.values() if isinstance(pieces[-1], str)
} | {"table_row": (2 * INTEGER + NUMBER, INTEGER), "move_unit": (3 * INTEGER + 2 * NUMBER, INTEGER)}
"""Functions of the shipped module, to types of arguments and results."""


_CALLING = (ca.OP_INPUT, ca.OP_OUTPUT, ca.OP_CALL)


class Assembler:
    """A module that works in memory and table of the shipped module, ``base``, and calls its functions."""

    def __init__(self) -> None:
        self.functions = {name: k for k, name in enumerate(IMPORTED)}
        """Index of each imported function."""
        self._codes = {
            operation: tuple(call(self.functions[piece]) if isinstance(piece, str) else piece for piece in pieces)
            for operation, pieces in OPERATIONS.items()
        }
        self._traced: dict[int, tuple[ca.Function, int]] = {}
        self._tables: dict[str, tuple[int, int, int]] = {}
        self._types: dict[bytes, int] = {}
        kinds = {name: b"\0" + self._type(*kind) for name, kind in IMPORTED.items()}
        kinds |= {"memory": b"\2\0\0", "__indirect_function_table": b"\1\x70\0\0"}
        self._imports = [_sized(b"base") + _sized(name.encode()) + kind for name, kind in kinds.items()]
        self._kinds: list[bytes] = []
        self._bodies: list[bytes] = []
        self._data: list[bytes] = []
        self._indirect: list[bytes] = []
        self._end = BASE_PAGES * _PAGE

    @property
    def growth(self) -> tuple[int, int]:
        """Pages and slots to add to memory and table of the base before the module is loaded."""
        return -(-self._end // _PAGE) - BASE_PAGES, len(self._indirect)

    def _type(self, arguments: bytes, results: bytes) -> bytes:
        kind = b"\x60" + _sized(arguments) + _sized(results)
        return unsigned(self._types.setdefault(kind, len(self._types)))

    def function(self, arguments: bytes, results: bytes, locals_: Sequence[tuple[int, bytes]], code: bytes) -> int:
        """Add a function with `locals_`, a count for each type. Return its index."""
        self._kinds.append(self._type(arguments, results))
        declared = _list([unsigned(n) + type_ for n, type_ in locals_])
        self._bodies.append(_sized(declared + code + b"\x0b"))
        return len(self.functions) + len(self._bodies) - 1

    def slot(self, function: int) -> int:
        """Put a function into the table. Return its place, a pointer in C."""
        self._indirect.append(unsigned(function))
        return BASE_SLOTS + len(self._indirect) - 1

    def room(self, size: int) -> int:
        """Reserve bytes, 0 at first. Return their address, a multiple of 8."""
        address = self._end
        self._end += -(-size // 8) * 8
        return address

    def data(self, content: bytes) -> int:
        """Add content. Return its address."""
        address = self.room(len(content))
        self._data.append(b"\0" + constant(address) + b"\x0b" + _sized(content))
        return address

    def traced(self, function: ca.Function) -> int:
        """Return the index of a traced function with an address for each argument and result. The first call adds it.

        KernelError for an operation without code.
        """
        key = function.__hash__()
        if key not in self._traced:
            if function.is_a("SXFunction"):
                self._traced[key] = function, self._straight(function)
            elif all(operation in _CALLING for _, operation, *_ in instructions(function)):
                self._traced[key] = function, self._calling(function)
            else:
                self._traced[key] = function, self._straight(function.expand(function.name()))
        return self._traced[key][1]

    def _calling(self, function: ca.Function) -> int:
        """Add a function of calls."""
        code = bytearray()
        places: dict[int, bytes] = {}
        for k, operation, source, target in instructions(function):
            if operation == ca.OP_INPUT:
                places[target[0]] = local(source[0])
            elif operation == ca.OP_OUTPUT:
                size = constant(8 * function.numel_out(target[0]))
                code += local(function.n_in() + target[0]) + places[source[0]] + size + COPY
            elif operation == ca.OP_CALL:
                callee = function.instruction_MX(k).which_function()
                read = [places[i] for i in source]
                for i, place in enumerate(target):
                    places[place] = constant(self.room(8 * callee.numel_out(i)))
                code += b"".join([*read, *(places[i] for i in target), call(self.traced(callee))])
            else:
                raise KernelError(f"{function.name()}: expected calls only, got operation {operation}.")
        return self.function(INTEGER * (function.n_in() + function.n_out()), b"", (), bytes(code))

    def _straight(self, function: ca.Function) -> int:
        """Add a function of operations.

        Locals are addresses of arguments and results, the address of a table's row, then the memory of the trace. Each
        operation sets a local.
        """
        row, places = function.n_in() + function.n_out(), 0
        code = bytearray()

        def get(place: int) -> bytes:
            return local(row + 1 + place)

        def keep(place: int, value: bytes) -> None:
            nonlocal code, places
            places = max(places, place + 1)
            code += value + SET + unsigned(row + 1 + place)

        for k, operation, source, target in instructions(function):
            if operation == ca.OP_INPUT:
                keep(target[0], local(source[0]) + LOAD + unsigned(8 * source[1]))
            elif operation == ca.OP_CONST:
                keep(target[0], number(function.instruction_constant(k)))
            elif operation == ca.OP_OUTPUT:
                code += local(function.n_in() + target[0]) + get(source[0]) + STORE + unsigned(8 * target[1])
            elif operation == ca.OP_CALL:
                table = function.instructions_sx()[k].which_function()
                looks = table.name().startswith(LOOKUP)  # any other call is the derivative of a lookup: 0
                if looks:
                    code += self._row(table, get(source[0])) + SET + unsigned(row)
                for j, place in enumerate(target):
                    if place >= 0:
                        keep(place, local(row) + LOAD + unsigned(8 * j) if looks else _ZERO)
            elif operation in self._codes:
                pieces = self._codes[operation]
                keep(target[0], b"".join(get(source[p]) if isinstance(p, int) else p for p in pieces))
            else:
                raise KernelError(f"{function.name()}: CasADi's operation {operation} has no code in WebAssembly.")
        return self.function(INTEGER * row, b"", [(1, INTEGER), (places, NUMBER)], bytes(code))

    def _row(self, table: ca.Function, value: bytes) -> bytes:
        """Return the code for the address of the row of a value."""
        name, width = table.name(), table.numel_out(0)
        if name not in self._tables:
            edges, rows = lookup_table(table)
            first, second = (self.data(struct.pack(f"<{len(each)}d", *each)) for each in (edges, rows))
            self._tables[name] = first, len(edges) - 1, second
        edges, count, rows = self._tables[name]
        place = call(self.functions["table_row"]) + constant(8 * width) + b"\x6c" + constant(rows) + b"\x6a"
        return constant(edges) + constant(count) + value + place

    def module(self, exported: Mapping[str, int]) -> bytes:
        """Return the module with exported functions."""
        exports = [_sized(name.encode()) + b"\0" + unsigned(k) for name, k in exported.items()]
        elements = [b"\0" + constant(BASE_SLOTS) + b"\x0b" + _list(self._indirect)]
        sections = {1: [*self._types], 2: self._imports, 3: self._kinds, 7: exports, 9: elements}
        sections |= {10: self._bodies, 11: self._data}
        return b"\0asm\x01\0\0\0" + b"".join(bytes([kind]) + _sized(_list(items)) for kind, items in sections.items())


def _sized(content: bytes) -> bytes:
    return unsigned(len(content)) + content


def _list(items: Sequence[bytes]) -> bytes:
    return unsigned(len(items)) + b"".join(items)
