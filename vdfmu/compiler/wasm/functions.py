"""Traced functions as WebAssembly, operation by operation: the bits are those of their C."""

from __future__ import annotations

import re
import struct
from collections import Counter
from collections.abc import Iterator, Sequence

import casadi as ca

from vdfmu.base.errors import KernelError
from vdfmu.compiler.c.expressions import EXPRESSIONS
from vdfmu.compiler.c.functions import lookup_table
from vdfmu.compiler.scalar.symbol import LOOKUP
from vdfmu.compiler.wasm.module import (
    COPY,
    INTEGER,
    LOAD,
    NUMBER,
    STORE,
    Assembler,
    call,
    constant,
    local,
    number,
    unsigned,
)

Pieces = tuple[int | bytes, ...]
"""Code, with numbers of values in it."""
_ZERO = number(0.0)
_WORDS = {
    "+": b"\xa0", "-": b"\xa1", "*": b"\xa2", "/": b"\xa3", "<": b"\x63\xb7", "<=": b"\x65\xb7", "==": b"\x61\xb7",
    "!=": b"\x62\xb7", "sqrt": b"\x9f", "floor": b"\x9c", "ceil": b"\x9b", "fabs": b"\x99", "copysign": b"\xa6",
}  # fmt: skip
"""Words of the C that are instructions; other functions are called, fmin and fmax too: the instructions pass NaN on."""
_PATTERN = re.compile(r"(\w+)\(\{0\}(?:, (\{1\}))?\)|\{0\} (\S+) (\{1\})(?: \? 1\.0 : 0\.0)?")
"""C that calls a function, or has a word between operands; what is compared gives 1 or 0."""


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
"""Operation to its code: operands, instructions, and functions of the C library; most are read off their C."""
_LONGEST = 120
"""Bytes of code from which a value goes into a local though it is read once: longer code would be copied too often."""


class WrittenFunctions:
    """The functions of an assembler that come from traces: each once, with an address for each argument and result."""

    def __init__(self, assembler: Assembler) -> None:
        self._assembler = assembler
        self._known: dict[int, tuple[ca.Function, int]] = {}
        self._codes: dict[int, Pieces] = {}
        self._tables: dict[str, tuple[int, int, int]] = {}

    def index(self, function: ca.Function) -> int:
        """Return the index of a function, which is added when it is asked for first.

        Raises
        ------
        KernelError
            If the trace has an operation that there is no code of.
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
        body = _TraceCode(function, self)
        code = b"".join(body.statements())
        groups = [(body.rows, INTEGER), (body.numbers, NUMBER)]
        return self._assembler.function(INTEGER * body.pointers, b"", groups, code)

    def _called(self, name: str) -> bytes:
        return call(self._assembler.functions[name])

    def code(self, operation: int, where: str) -> Pieces:
        """Return the code of an operation, with the numbers of its operands; `where` names the function of it."""
        if operation not in self._codes:
            if operation not in OPERATIONS:
                raise KernelError(f"{where}: CasADi's operation {operation} has no code in WebAssembly.")
            pieces = OPERATIONS[operation]
            self._codes[operation] = tuple(self._called(piece) if isinstance(piece, str) else piece for piece in pieces)
        return self._codes[operation]

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
    """Code of a trace. A value that is read once is calculated where it is read, others go into locals.

    Attributes
    ----------
    pointers, rows, numbers : int
        Locals, in this order: addresses of arguments and results, addresses of rows of tables, values.
    """

    def __init__(self, function: ca.Function, functions: WrittenFunctions) -> None:
        self._function, self._functions = function, functions
        self.pointers = function.n_in() + function.n_out()
        self.rows = self.numbers = 0
        self._lines: list[tuple[Pieces, bool]] = []
        """Code of each value, which its place in the list numbers, and of stores, which give none."""
        self._held: dict[int, int] = {}
        """Places of the trace's memory to the values in them."""
        for k in range(function.n_instructions()):
            self._take(k)
        self._left = Counter(piece for pieces, _ in self._lines for piece in pieces if isinstance(piece, int))
        """How often values are still read."""
        self._waiting: dict[int, tuple[bytes, list[int]]] = {}
        """Values that are calculated where they are read: their code, and the values in locals that it reads."""
        self._locals: dict[int, int] = {}
        self._free: list[int] = []

    def _take(self, k: int) -> None:
        """Note the code of an instruction of the trace."""
        function, operation = self._function, self._function.instruction_id(k)
        source, target = function.instruction_input(k), function.instruction_output(k)
        if operation == ca.OP_INPUT:
            self._hold(target[0], (local(source[0]), LOAD + unsigned(8 * source[1])))
        elif operation == ca.OP_CONST:
            self._hold(target[0], (number(function.instruction_constant(k)),))
        elif operation == ca.OP_OUTPUT:
            address = local(function.n_in() + target[0])
            self._lines.append(((address, self._held[source[0]], STORE + unsigned(8 * target[1])), False))
        elif operation == ca.OP_CALL:
            self._look_up(function.instructions_sx()[k].which_function(), source[0], target)
        else:
            code = self._functions.code(operation, function.name())
            self._hold(target[0], tuple(self._held[source[p]] if isinstance(p, int) else p for p in code))

    def _hold(self, place: int, pieces: Pieces) -> None:
        self._held[place] = len(self._lines)
        self._lines.append((pieces, True))

    def _look_up(self, called: ca.Function, source: int, target: Sequence[int]) -> None:
        """Look up a row; what else a trace calls is a derivative of that, which is 0."""
        looks = called.name().startswith(LOOKUP)
        row = self.pointers + self.rows
        if looks:
            self.rows += 1
            first, last = self._functions.row(called)
            self._lines.append(((first, self._held[source], last, b"\x21" + unsigned(row)), False))
        for j, place in enumerate(target):
            if place >= 0:
                self._hold(place, (local(row), LOAD + unsigned(8 * j)) if looks else (number(0.0),))

    def statements(self) -> Iterator[bytes]:
        """Yield the code."""
        first = self.pointers + self.rows
        for value, (pieces, gives) in enumerate(self._lines):
            code, read = self._joined(pieces, first)
            if gives and self._left[value] == 1 and len(code) <= _LONGEST:
                self._waiting[value] = code, read
                continue
            for one in read:
                self._left[one] -= 1
                if not self._left[one]:
                    self._free.append(self._locals.pop(one))
            if not gives:
                yield code
            elif self._left[value]:
                if not self._free:
                    self._free.append(self.numbers)
                    self.numbers += 1
                self._locals[value] = place = self._free.pop()
                yield code + b"\x21" + unsigned(first + place)

    def _joined(self, pieces: Pieces, first: int) -> tuple[bytes, list[int]]:
        """Return the code of pieces, and the values in locals that it reads."""
        code, read = bytearray(), list[int]()
        for piece in pieces:
            if isinstance(piece, bytes):
                code += piece
            elif piece in self._waiting:
                own, more = self._waiting.pop(piece)
                code += own
                read += more
            else:
                code += local(first + self._locals[piece])
                read.append(piece)
        return bytes(code), read
