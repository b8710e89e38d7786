"""C text of functions of vectors: calls, slices and columns of vectors, and elementwise arithmetic in loops."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from vdfmu.base.errors import KernelError
from vdfmu.compiler.c.rolled import rolled
from vdfmu.compiler.c.text import EXPRESSIONS, c_constant
from vdfmu.compiler.functions.operations import instructions

STACK = 32_768
"""Largest memory on the stack, in numbers: threads have 512 kB on some systems."""


_KEEPING = (ca.OP_OUTPUT, ca.OP_VERTCAT, ca.OP_VERTSPLIT, ca.OP_RESHAPE, ca.OP_GETNONZEROS)


@dataclass
class Vector:
    """A vector of a function: its place is an array and an offset in it."""

    size: int
    array: str = ""
    offset: int = 0
    is_made: bool = False
    """Whether an operation writes it, so that its place can be chosen."""
    after: Vector | None = None
    """Vector whose place it reuses, for an operation in place."""

    def place(self) -> str:
        """Return the place as C."""
        return f"{self.array} + {self.offset}" if self.offset else self.array

    @property
    def root(self) -> Vector:
        """The vector whose place it finally uses."""
        root = self
        while root.after is not None:
            root = root.after
        return root

    def put(self, array: str, offset: int) -> bool:
        """Choose the place; return whether it was still free."""
        root = self.root
        if not root.is_made or root.array:
            return False
        vector: Vector | None = self
        while vector is not None:
            vector.array, vector.offset = array, offset
            vector = vector.after
        return True


@dataclass
class VectorOperation:
    """An operation of a function of vectors; unused results are None."""

    code: int
    reads: list[Vector]
    writes: list[Vector | None]
    number: int
    argument: int = 0
    """Argument of an input, or result of an output."""
    begin: int = 0
    """First element of a result's part."""


class VectorText:
    """The lines of C of an MX function. `names` are the C names of the functions that it calls."""

    def __init__(self, function: ca.Function, names: Mapping[str, str]) -> None:
        self._function, self._names = function, names
        self.zeros = 0
        self._size = 0
        self._end = 0
        """End of the memory, including unused results."""
        self.operations = self._read()
        self._place()

    def _read(self) -> list[VectorOperation]:
        """Return the operations, each with separate vectors."""
        function = self._function
        held: dict[int, Vector] = {}
        written = [0] * function.n_out()
        made: list[VectorOperation] = []
        self._last: dict[int, int] = {}  # vector to the last operation that reads it
        self._kept: set[int] = set()  # vectors that contain parts of others, or are such parts
        for k, code, source, target in instructions(function):
            reads = [held[i] for i in source] if code != ca.OP_INPUT else []
            for vector in reads:
                self._last[id(vector)] = k
            if code in _KEEPING:
                self._kept |= set(map(id, reads))
            if code == ca.OP_OUTPUT:
                made.append(VectorOperation(code, reads, [], k, target[0], written[target[0]]))
                written[target[0]] += reads[0].size  # the parts of a result are in order
                continue
            writes = [
                Vector(size) if place >= 0 else None for place, size in zip(target, self._sizes(k, code), strict=True)
            ]
            operation = VectorOperation(code, reads, writes, k, source[0] if code == ca.OP_INPUT else 0)
            made.append(operation)
            held |= {place: vector for place, vector in zip(target, writes, strict=True) if vector is not None}
        for operation in made:
            self._bind(operation)
        return made

    def _sizes(self, k: int, code: int) -> Iterator[int]:
        if code == ca.OP_CALL:
            callee = self._function.instruction_MX(k).which_function()
            yield from (callee.nnz_out(i) for i in range(callee.n_out()))
        elif code == ca.OP_VERTSPLIT:
            yield from np.diff(self._info(k)["offset"]).tolist()
        else:
            yield self._function.instruction_MX(k).nnz()

    def _info(self, k: int) -> dict[str, Any]:
        return self._function.instruction_MX(k).info()

    def _bind(self, operation: VectorOperation) -> None:
        """Assign places to vectors that are parts of others, and mark those that are computed."""
        code, reads = operation.code, operation.reads
        first = next((vector for vector in operation.writes if vector is not None), None)
        if first is None:
            return
        if code == ca.OP_INPUT:
            first.array = self._function.name_in(operation.argument)
        elif code == ca.OP_CONST:
            if any(self.values(operation.number)):
                first.is_made = True
            else:
                first.array = "zeros" if first.size else "0"
                self.zeros = max(self.zeros, first.size)
        elif code in (ca.OP_SETNONZEROS, ca.OP_ADDNONZEROS):
            first.is_made = True
            changed = reads[0]
            if changed.is_made and id(changed) not in self._kept and self._last[id(changed)] == operation.number:
                first.after = changed
        elif code != ca.OP_RESHAPE and self.parts_of(operation) is None:
            for vector in operation.writes:
                if vector is not None:
                    vector.is_made = True

    def parts_of(self, operation: VectorOperation) -> list[int] | None:
        """Return, for each vector that is a plain slice, where it begins in the vector that is read."""
        if operation.code == ca.OP_VERTSPLIT:
            return list(self._info(operation.number)["offset"][:-1])
        if operation.code == ca.OP_RESHAPE:
            return [0]
        if operation.code == ca.OP_GETNONZEROS:
            taken = self.elements(operation)
            if taken == list(range(taken[0], taken[0] + len(taken))):
                return [taken[0]]
        return None

    def values(self, k: int) -> list[float]:
        """Return the numbers of a constant, operation `k`."""
        return self._function.instruction_MX(k).to_DM().nonzeros()

    def _place(self) -> None:
        """Choose the places of the vectors: in a result or a column if they become a part of it, else in the memory."""
        for operation in reversed(self.operations):
            if operation.code == ca.OP_OUTPUT:
                operation.reads[0].put(self._result(operation), operation.begin)
            elif operation.code == ca.OP_VERTCAT:
                (column,) = operation.writes
                assert column is not None
                self._reserve(column)
                begin = column.offset
                for vector in operation.reads:
                    vector.put(column.array, begin)
                    begin += vector.size
        for operation in self.operations:
            begins = self.parts_of(operation)
            for k, vector in enumerate(operation.writes):
                if vector is None:
                    continue
                if begins is not None:
                    vector.array = operation.reads[0].array
                    vector.offset = operation.reads[0].offset + begins[k]
                elif not vector.array:
                    self._reserve(vector)

    def _result(self, operation: VectorOperation) -> str:
        return f"{self._function.name_out(operation.argument)}_out"

    def _reserve(self, vector: Vector) -> None:
        root = vector.root
        if root.array:
            vector.array, vector.offset = root.array, root.offset
        elif vector.put("w", self._size):
            self._size += vector.size

    def lines(self) -> list[str]:
        """Return the lines of the definition."""
        body = rolled([line for operation in self.operations for line in self._lines(operation)])
        declared = [f"static const double zeros[{self.zeros}] = {{0.0}};"] if self.zeros else []
        size = max(self._size, self._end)
        if size:
            declared += [*([f"#if {size} > {STACK}", "static _Thread_local", "#endif"]), f"double w[{size}];"]
        text = "\n".join(body)
        unused = [f"(void){name};" for name in self._function.name_in() if name not in text]
        return [*declared, *unused, *body]

    def _lines(self, operation: VectorOperation) -> Iterator[str]:
        code, reads = operation.code, operation.reads
        if code == ca.OP_OUTPUT:
            target = self.result(operation)
            if reads[0].place() != target.place():
                yield from _copy(target.place(), reads[0].place(), target.size)
        elif code == ca.OP_CALL:
            yield self._call(operation)
        elif code == ca.OP_VERTCAT:
            (column,) = operation.writes
            assert column is not None
            target = Vector(0, column.array, column.offset)
            for vector in reads:
                if vector.place() != target.place():
                    yield from _copy(target.place(), vector.place(), vector.size)
                target.offset += vector.size
        elif code == ca.OP_CONST:
            yield from self._numbers(operation)
        elif code == ca.OP_INPUT or self.parts_of(operation) is not None:
            return
        else:
            yield from self._loops(operation)

    def _numbers(self, operation: VectorOperation) -> Iterator[str]:
        (vector,) = operation.writes
        if vector is not None and vector.is_made:
            for k, value in enumerate(self.values(operation.number)):
                yield f"{_element(vector, str(k))} = {c_constant(value)};"

    @property
    def size(self) -> int:
        """Size of the memory ``w``, without unused results."""
        return self._size

    def callee(self, operation: VectorOperation) -> ca.Function:
        """Return the function of a call."""
        return self._function.instruction_MX(operation.number).which_function()

    def elements(self, operation: VectorOperation) -> list[int]:
        """Return the elements that an operation reads or sets."""
        return _elements(self._info(operation.number))

    def result(self, operation: VectorOperation) -> Vector:
        """Return the part of a result to which an output is copied."""
        return Vector(operation.reads[0].size, self._result(operation), operation.begin)

    def _call(self, operation: VectorOperation) -> str:
        callee = self.callee(operation)
        places = [vector.place() for vector in operation.reads]
        end = self._size
        for k, vector in enumerate(operation.writes):
            if vector is None:
                places.append(f"w + {end}")
                end += callee.nnz_out(k)
                self._end = max(self._end, end)
            else:
                places.append(vector.place())
        return f"{self._names[callee.name()]}({', '.join(places)});"

    def _loops(self, operation: VectorOperation) -> Iterator[str]:
        code, reads = operation.code, operation.reads
        (target,) = operation.writes
        assert target is not None
        if code == ca.OP_GETNONZEROS:
            yield from _moves(target, reads[0], self.elements(operation))
        elif code in (ca.OP_SETNONZEROS, ca.OP_ADDNONZEROS):
            if reads[0].place() != target.place():
                yield from _copy(target.place(), reads[0].place(), target.size)
            yield from _added(target, reads[1], self.elements(operation), code == ca.OP_ADDNONZEROS)
        elif code == ca.OP_DOT:
            yield f"{_element(target, '0')} = 0.0;"
            terms = f"{_element(reads[0], 'i')} * {_element(reads[1], 'i')}"
            yield f"for (int i = 0; i < {reads[0].size}; i++) {_element(target, '0')} += {terms};"
        elif code in EXPRESSIONS:
            yield from _each(code, target, reads)
        else:
            raise KernelError(f"{self._function.name()}: expected calls and vectors, got operation {code}.")


def _elements(info: Mapping[str, Any]) -> list[int]:
    """Return the elements of a slice."""
    if "slice" in info:
        part = info["slice"]
        return list(range(part["start"], part["stop"], part["step"]))
    if "nz" in info:
        return list(info["nz"])
    inner, outer = info["inner"], info["outer"]
    return [
        i + j
        for j in range(outer["start"], outer["stop"], outer["step"])
        for i in range(inner["start"], inner["stop"], inner["step"])
    ]


def _element(vector: Vector, index: str) -> str:
    return f"{vector.array}[{f'{vector.offset} + ' if vector.offset else ''}{index}]"


def _copy(target: str, source: str, size: int) -> Iterator[str]:
    if size:
        yield f"memcpy({target}, {source}, {size} * sizeof(double));"


def _moves(target: Vector, source: Vector, elements: Sequence[int]) -> Iterator[str]:
    for k, element in enumerate(elements):
        yield f"{_element(target, str(k))} = {_element(source, str(element))};"


def _added(target: Vector, source: Vector, elements: Sequence[int], is_sum: bool) -> Iterator[str]:
    sign = "+=" if is_sum else "="
    if len(elements) > 2 and elements == [*range(elements[0], elements[0] + len(elements))]:
        place = _element(target, f"{elements[0]} + i" if elements[0] else "i")
        yield f"for (int i = 0; i < {len(elements)}; i++) {place} {sign} {_element(source, 'i')};"
        return
    for k, element in enumerate(elements):
        if element >= 0:
            yield f"{_element(target, str(element))} {sign} {_element(source, str(k))};"


def _each(code: int, target: Vector, reads: Sequence[Vector]) -> Iterator[str]:
    """Yield the loop of an elementwise operation; a vector of one element is broadcast."""
    index = "i" if target.size > 1 else "0"
    operands = [_element(vector, index if vector.size > 1 else "0") for vector in reads]
    line = f"{_element(target, index)} = {EXPRESSIONS[code].format(*operands)};"
    yield f"for (int i = 0; i < {target.size}; i++) {line}" if target.size > 1 else line
