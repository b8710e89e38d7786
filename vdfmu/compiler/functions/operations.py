"""The operations of a traced function, each with a separate value, and their evaluation on other symbols."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import casadi as ca


def instructions(function: ca.Function) -> Iterator[tuple[int, int, list[int], list[int]]]:
    """Yield the number, operation, inputs and outputs of each instruction of a function."""
    for k in range(function.n_instructions()):
        yield k, function.instruction_id(k), function.instruction_input(k), function.instruction_output(k)


class TracedOperation(NamedTuple):
    """An SX operation: its code and the operations that it reads."""

    code: int
    reads: tuple[int, ...] = ()
    leaf: tuple[int, int] | float | None = None
    """Argument and element of an input, or the value of a constant."""
    callee: ca.Function | None = None
    """Called function; the value is `element` of all its results."""
    element: int = 0


class Operations:
    """The operations of an SX function in order."""

    def __init__(self, function: ca.Function) -> None:
        self.listed: list[TracedOperation] = []
        self.results: list[list[int]] = [[-1] * function.numel_out(i) for i in range(function.n_out())]
        """Operation of each element of each result."""
        held: dict[int, int] = {}
        for k, code, source, target in instructions(function):
            if code == ca.OP_OUTPUT:
                self.results[target[0]][target[1]] = held[source[0]]
            elif code == ca.OP_CALL:
                callee = function.instructions_sx()[k].which_function()
                reads = tuple([held[place] for place in source])
                for element, place in enumerate(target):
                    if place >= 0:
                        held[place] = self._append(TracedOperation(code, reads, None, callee, element))
            elif code == ca.OP_INPUT:
                held[target[0]] = self._append(TracedOperation(code, (), (source[0], source[1])))
            elif code == ca.OP_CONST:
                held[target[0]] = self._append(TracedOperation(code, (), function.instruction_constant(k)))
            else:
                held[target[0]] = self._append(TracedOperation(code, tuple([held[place] for place in source])))

    def _append(self, operation: TracedOperation) -> int:
        self.listed.append(operation)
        return len(self.listed) - 1

    def value(self, k: int, operands: list[ca.SX]) -> ca.SX:
        """Return an operation, not an input, applied to the values of its operands."""
        operation = self.listed[k]
        if operation.callee is not None:
            return ca.vertcat(*operation.callee.call([ca.vertcat(*operands)]))[operation.element]
        if operation.code == ca.OP_CONST:
            assert isinstance(operation.leaf, float)
            return ca.SX(operation.leaf)
        return ca.SX.unary(operation.code, *operands) if len(operands) == 1 else ca.SX.binary(operation.code, *operands)

    def values(
        self, arguments: Sequence[ca.SX], replace: Callable[[int, list[ca.SX]], ca.SX | None] = lambda k, operands: None
    ) -> list[ca.SX]:
        """Return the value of each operation on other arguments.

        `replace` is called with the number and the operands of each operation, not input, and returns another value or
        None.
        """
        values: list[ca.SX] = []
        for k, operation in enumerate(self.listed):
            if isinstance(operation.leaf, tuple):
                values.append(arguments[operation.leaf[0]][operation.leaf[1]])
                continue
            operands = [values[i] for i in operation.reads]
            made = replace(k, operands)
            values.append(self.value(k, operands) if made is None else made)
        return values
