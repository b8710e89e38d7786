"""Writes WebAssembly modules of traced functions without a compiler, bit-identical to their C.

They call functions of a compiled module. Source: WebAssembly Core 2.0, sections 5.4 (instructions) and 5.5
(modules).
"""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator, Mapping, Sequence
from functools import cache

import casadi as ca

from vdfmu.base.errors import KernelError
from vdfmu.compiler.c.calls import Vector, VectorText
from vdfmu.compiler.c.text import EXPRESSIONS
from vdfmu.compiler.functions.derivatives import lookup_table
from vdfmu.compiler.functions.operations import instructions
from vdfmu.compiler.scalar.symbol import LOOKUP, MATRIX

INTEGER, NUMBER = b"\x7f", b"\x7c"
"""Types: i32, f64."""
LOAD, STORE = b"\x2b\x03", b"\x39\x03"
"""Load and store a number at an address and an offset. The offset follows."""
SET = b"\x21"
"""Set a local. Its number follows."""
COPY = b"\xfc\x0a\0\0"
"""Copy bytes: target, source, number."""
_ADD, _TEE, _LOOP = b"\x6a", b"\x22", b"\x03\x40"
"""Add integers; set a local and keep its value; begin a loop."""
_REPEAT_BELOW = b"\x49\x0d\0\x0b"
"""Repeat the loop while an integer is below another, then end it."""
_PAGE = 65536
BASE_PAGES, BASE_SLOTS = 2, 1
"""Pages of memory and slots of the table in the shipped module without units."""


@cache
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


@cache
def local(k: int) -> bytes:
    """Return the instruction that pushes a local."""
    return b"\x20" + unsigned(k)


def call(k: int) -> bytes:
    """Return the instruction that calls a function."""
    return b"\x10" + unsigned(k)


def return_if_not(n: int) -> bytes:
    """Return the instructions that end a function with an integer if the number on the stack is 0."""
    return b"\x45\x04\x40" + constant(n) + b"\x0f\x0b"


_ZERO = number(0.0)
_WORDS = {
    "+": b"\xa0", "-": b"\xa1", "*": b"\xa2", "/": b"\xa3", "<": b"\x63\xb7", "<=": b"\x65\xb7", "==": b"\x61\xb7",
    "!=": b"\x62\xb7", "sqrt": b"\x9f", "floor": b"\x9c", "ceil": b"\x9b", "fabs": b"\x99", "copysign": b"\xa6",
}  # fmt: skip
"""C functions that are one instruction. Others are called, even fmin and fmax, whose instructions propagate NaN."""
_PATTERN = re.compile(r"(\w+)\(\{0\}(?:, (\{1\}))?\)|\{0\} (\S+) (\{1\})(?: \? 1\.0 : 0\.0)?")
"""C text that calls a function, or has an operator between operands. A comparison results in 1 or 0."""


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
"""Functions of the shipped module to the types of their arguments and results."""


class Assembler:
    """A module that uses the memory and table of the shipped module, ``base``, and calls its functions."""

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
        """Pages and slots to add to the memory and table of the base before the module is loaded."""
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
        """Return the index of a traced function, which has an address per argument and result; the first call adds it.

        KernelError for an operation that is not supported.
        """
        key = function.__hash__()
        if key not in self._traced:
            add = self._straight if function.is_a("SXFunction") else self._vectors
            self._traced[key] = function, add(function)
        return self._traced[key][1]

    def _vectors(self, function: ca.Function) -> int:
        """Add a function of vectors: of calls, copies, and loops over elements."""
        text = VectorText(function, {})
        arrays = {name: local(k) for k, name in enumerate(function.name_in())}
        arrays |= {f"{name}_out": local(function.n_in() + k) for k, name in enumerate(function.name_out())}
        arrays |= {"w": constant(self.room(8 * text.size)), "zeros": constant(self.room(8 * text.zeros))}
        index = function.n_in() + function.n_out()

        def address(vector: Vector) -> bytes:
            if not vector.array.isidentifier():  # for an argument without elements
                return constant(0)
            return arrays[vector.array] + (constant(8 * vector.offset) + _ADD if vector.offset else b"")

        def copied(target: Vector, source: Vector) -> bytes:
            if target.place() == source.place():
                return b""
            return address(target) + address(source) + constant(8 * source.size) + COPY

        def element(vector: Vector) -> bytes:
            return address(vector) + (local(index) + _ADD if vector.size > 1 else b"")

        def loop(size: int, body: bytes) -> bytes:
            following = local(index) + constant(8) + _ADD + _TEE + unsigned(index)
            return constant(0) + SET + unsigned(index) + _LOOP + body + following + constant(8 * size) + _REPEAT_BELOW

        code = bytearray()
        for operation in text.operations:
            reads, operands = operation.reads, [element(each) + LOAD + b"\0" for each in operation.reads]
            target = next((vector for vector in operation.writes if vector is not None), None)
            if operation.code == ca.OP_OUTPUT:
                code += copied(text.result(operation), reads[0])
            elif target is None or operation.code == ca.OP_INPUT or text.parts_of(operation) is not None:
                continue
            elif operation.code == ca.OP_CALL:
                callee = text.callee(operation)
                spare = [constant(self.room(8 * callee.nnz_out(k))) for k in range(callee.n_out())]
                made = [b if each is None else address(each) for each, b in zip(operation.writes, spare, strict=True)]
                code += b"".join([*map(address, reads), *made, call(self.traced(callee))])
            elif operation.code == ca.OP_CONST:
                for k, value in enumerate(text.values(operation.number) if target.is_made else ()):
                    code += address(target) + number(value) + STORE + unsigned(8 * k)
            elif operation.code == ca.OP_VERTCAT:
                part = Vector(0, target.array, target.offset)
                for each in reads:
                    code += copied(part, each)
                    part.offset += each.size
            elif operation.code == ca.OP_GETNONZEROS:
                for k, place in enumerate(text.elements(operation)):
                    value = address(reads[0]) + LOAD + unsigned(8 * place)
                    code += address(target) + value + STORE + unsigned(8 * k)
            elif operation.code == ca.OP_SETNONZEROS:
                code += copied(target, reads[0])
                for k, place in enumerate(text.elements(operation)):
                    value = address(reads[1]) + LOAD + unsigned(8 * k)
                    code += address(target) + value + STORE + unsigned(8 * place)
            elif operation.code == ca.OP_DOT:
                code += address(target) + _ZERO + STORE + b"\0"
                added = address(target) + LOAD + b"\0" + b"".join(operands) + b"\xa2\xa0"
                code += loop(reads[0].size, address(target) + added + STORE + b"\0")
            elif operation.code in self._codes:
                pieces = self._codes[operation.code]
                value = b"".join(operands[p] if isinstance(p, int) else p for p in pieces)
                code += loop(target.size, element(target) + value + STORE + b"\0")
            else:
                raise KernelError(f"{function.name()}: operation {operation.code} is not supported in WebAssembly.")
        return self.function(INTEGER * index, b"", [(1, INTEGER)], bytes(code))

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
                if MATRIX in table.name():
                    raise KernelError(
                        f"{function.name()}: a product with a large matrix is not supported in WebAssembly."
                    )
                looks = table.name().startswith(LOOKUP)  # any other call is the derivative of a lookup, which is 0
                if looks:
                    code += self._row(table, get(source[0])) + SET + unsigned(row)
                for j, place in enumerate(target):
                    if place >= 0:
                        keep(place, local(row) + LOAD + unsigned(8 * j) if looks else _ZERO)
            elif operation in self._codes:
                pieces = self._codes[operation]
                keep(target[0], b"".join(get(source[p]) if isinstance(p, int) else p for p in pieces))
            else:
                raise KernelError(f"{function.name()}: CasADi's operation {operation} is not supported in WebAssembly.")
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
