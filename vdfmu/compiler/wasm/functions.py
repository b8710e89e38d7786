"""Traced functions as WebAssembly, operation by operation, with the bits of their C."""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator, Sequence

import casadi as ca

from vdfmu.base.errors import KernelError
from vdfmu.compiler.c.functions import lookup_table
from vdfmu.compiler.c.text import EXPRESSIONS
from vdfmu.compiler.scalar.symbol import LOOKUP
from vdfmu.compiler.wasm.module import (
    COPY,
    INTEGER,
    LOAD,
    NUMBER,
    SET,
    STORE,
    Assembler,
    call,
    constant,
    local,
    number,
    unsigned,
)

_ZERO = number(0.0)
_WORDS = {
    "+": b"\xa0", "-": b"\xa1", "*": b"\xa2", "/": b"\xa3", "<": b"\x63\xb7", "<=": b"\x65\xb7", "==": b"\x61\xb7",
    "!=": b"\x62\xb7", "sqrt": b"\x9f", "floor": b"\x9c", "ceil": b"\x9b", "fabs": b"\x99", "copysign": b"\xa6",
}  # fmt: skip
"""Words of the C with an instruction. Other functions are called. So are fmin and fmax: their instructions keep NaN."""
_PATTERN = re.compile(r"(\w+)\(\{0\}(?:, (\{1\}))?\)|\{0\} (\S+) (\{1\})(?: \? 1\.0 : 0\.0)?")
"""C that calls a function, or has a word between operands. A comparison gives 1 or 0."""


def _operations() -> Iterator[tuple[int, tuple[int | bytes | str, ...]]]:
    for operation, text in EXPRESSIONS.items():
        if found := _PATTERN.fullmatch(text):
            word = found[1] or found[3]
            yield operation, (0, *([1] if found[2] or found[4] else []), _WORDS.get(word, word))


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
"""Functions of the shipped module: types of arguments and results."""


class WrittenFunctions:
    """The functions of an assembler that come from traces: each once, with an address for each argument and result."""

    def __init__(self, assembler: Assembler) -> None:
        self._assembler = assembler
        self._known: dict[int, tuple[ca.Function, int]] = {}
        self.codes = {
            operation: tuple(self._called(piece) if isinstance(piece, str) else piece for piece in pieces)
            for operation, pieces in OPERATIONS.items()
        }
        """Operations to their code, with the numbers of operands in it."""
        self._tables: dict[str, tuple[int, int, int]] = {}

    def index(self, function: ca.Function) -> int:
        """Return the index of a function. The first call adds it.

        Raises
        ------
        KernelError
            For an operation without code.
        """
        key = function.__hash__()
        if key not in self._known:
            add = self._straight if function.is_a("SXFunction") else self._calling
            self._known[key] = function, add(function)
        return self._known[key][1]

    def _calling(self, function: ca.Function) -> int:
        """Add a function that only calls others."""
        code = bytearray()
        places: dict[int, bytes] = {}
        given = function.n_in()
        for k in range(function.n_instructions()):
            operation = function.instruction_id(k)
            source, target = function.instruction_input(k), function.instruction_output(k)
            if operation == ca.OP_INPUT:
                places[target[0]] = local(source[0])
            elif operation == ca.OP_OUTPUT:
                size = constant(8 * function.numel_out(target[0]))
                code += local(given + target[0]) + places[source[0]] + size + COPY
            elif operation == ca.OP_CALL:
                callee = function.instruction_MX(k).which_function()
                read = [places[i] for i in source]
                for i, place in enumerate(target):
                    places[place] = constant(self._assembler.room(8 * callee.numel_out(i)))
                code += b"".join([*read, *(places[i] for i in target), call(self.index(callee))])
            else:
                raise KernelError(f"{function.name()}: expected calls only, got operation {operation}.")
        return self._assembler.function(INTEGER * (given + function.n_out()), b"", (), bytes(code))

    def _straight(self, function: ca.Function) -> int:
        """Add a function of operations."""
        trace = _TraceCode(function, self)
        groups = [(1, INTEGER), (trace.numbers, NUMBER)]
        return self._assembler.function(INTEGER * (function.n_in() + function.n_out()), b"", groups, bytes(trace.code))

    def _called(self, name: str) -> bytes:
        return call(self._assembler.functions[name])

    def row(self, function: ca.Function) -> tuple[bytes, bytes]:
        """Return the code before and after a value that gives the address of its row in a table."""
        name, width = function.name(), function.numel_out(0)
        if name not in self._tables:
            edges, rows = lookup_table(function)
            first, second = (self._assembler.data(struct.pack(f"<{len(each)}d", *each)) for each in (edges, rows))
            self._tables[name] = first, len(edges) - 1, second
        edges, count, rows = self._tables[name]
        place = self._called("table_row") + constant(8 * width) + b"\x6c" + constant(rows) + b"\x6a"
        return constant(edges) + constant(count), place


class _TraceCode:
    """Code of a trace. Each place of the trace's memory is a local. Each operation sets its local.

    Locals are addresses of arguments and results, then the address of a table's row, then `numbers` numbers.
    """

    def __init__(self, function: ca.Function, functions: WrittenFunctions) -> None:
        self._function, self._functions = function, functions
        self._row = function.n_in() + function.n_out()
        self.numbers = 0
        self.code = bytearray()
        for k in range(function.n_instructions()):
            self._write(k)

    def _get(self, place: int) -> bytes:
        return local(self._row + 1 + place)

    def _set(self, place: int, code: bytes) -> None:
        self.numbers = max(self.numbers, place + 1)
        self.code += code + SET + unsigned(self._row + 1 + place)

    def _write(self, k: int) -> None:
        """Write an instruction of the trace."""
        function, operation = self._function, self._function.instruction_id(k)
        source, target = function.instruction_input(k), function.instruction_output(k)
        if operation == ca.OP_INPUT:
            self._set(target[0], local(source[0]) + LOAD + unsigned(8 * source[1]))
        elif operation == ca.OP_CONST:
            self._set(target[0], number(function.instruction_constant(k)))
        elif operation == ca.OP_OUTPUT:
            address = local(function.n_in() + target[0])
            self.code += address + self._get(source[0]) + STORE + unsigned(8 * target[1])
        elif operation == ca.OP_CALL:
            self._look_up(function.instructions_sx()[k].which_function(), source[0], target)
        else:
            if operation not in self._functions.codes:
                raise KernelError(f"{function.name()}: CasADi's operation {operation} has no code in WebAssembly.")
            pieces = self._functions.codes[operation]
            code = b"".join(self._get(source[piece]) if isinstance(piece, int) else piece for piece in pieces)
            self._set(target[0], code)

    def _look_up(self, called: ca.Function, source: int, target: Sequence[int]) -> None:
        """Look up a row. Any other call is the derivative of one: 0."""
        looks = called.name().startswith(LOOKUP)
        if looks:
            first, last = self._functions.row(called)
            self.code += first + self._get(source) + last + SET + unsigned(self._row)
        for j, place in enumerate(target):
            if place >= 0:
                self._set(place, local(self._row) + LOAD + unsigned(8 * j) if looks else number(0.0))
