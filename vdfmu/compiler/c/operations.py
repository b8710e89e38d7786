"""Exact directional derivatives of long functions: tables of operations that a C function runs forward and backward.

Each line of the table is an operation of the trace. Each argument, result, constant and intermediate value has its own
address in memory. In the forward pass the tangent of each value is calculated together with it. In the backward pass
the adjoint of each value is distributed to its operands. Compiling a table takes a hundredth of the time of C code.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import accumulate

import casadi as ca

from vdfmu.compiler.c.calls import STACK
from vdfmu.compiler.c.text import (
    EXPRESSIONS,
    array,
    c_constant,
    c_prototype,
    definition,
    head,
    slopes,
    source_text,
    wrapped,
)
from vdfmu.compiler.functions.derivatives import DIRECTIONS, derivative_names
from vdfmu.compiler.functions.operations import Operations

_CODES = {operation: code for code, operation in enumerate(EXPRESSIONS)}


def c_operations() -> dict[str, str]:
    """Return the C files that run the tables, by name; they are the same for all units."""
    cases: list[str] = []
    for operation, code in _CODES.items():
        value, by_a, by_b, *_ = (x.format("a", "b") for x in (EXPRESSIONS[operation], *slopes(operation), "0.0"))
        cases.append(f"    case {code}: *value = {value}; *by_a = {by_a}; *by_b = {by_b}; return;")
    return {
        "operations.h": head("Tables of operations.") + source_text("operations.h"),
        "operations.c": head("The interpreter of tables of operations.")
        + source_text("operations.c").replace("    /* CASES */", "\n".join(cases)),
    }


def has_table(function: ca.Function) -> bool:
    """Return whether every operation of an SX function can be a line, because it calls no other function."""
    codes = {function.instruction_id(k) for k in range(function.n_instructions())}
    return codes <= {*_CODES, ca.OP_INPUT, ca.OP_OUTPUT, ca.OP_CONST}


def c_derivatives(function: ca.Function) -> str:
    """Return both derivatives of a function (:mod:`vdfmu.compiler.functions.derivatives`) as C for ``operations.h``."""
    return _OperationTable(function).text()


class _OperationTable:
    """The table of one function."""

    def __init__(self, function: ca.Function) -> None:
        self._function, self._operations = function, Operations(function)
        self._arguments, self._made = function.name_in(), function.name_out()
        sizes = [function.numel_in(name) for name in self._arguments]
        sizes += [function.numel_out(name) for name in self._made]
        self._begins = list(accumulate(sizes, initial=0))
        """Places of the arguments and results, then of the values, then of the constants."""
        listed = self._operations.listed
        leaves = [operation.leaf for operation in listed]
        values = [k for k, leaf in enumerate(leaves) if leaf is None]
        self._place = {k: self._begins[-1] + i for i, k in enumerate(values)}
        self._constants: dict[str, int] = {}
        begin = self._begins[-1] + len(values)
        for k, leaf in enumerate(leaves):
            if isinstance(leaf, tuple):
                self._place[k] = self._begins[leaf[0]] + leaf[1]
            elif leaf is not None:
                self._place[k] = begin + self._constants.setdefault(c_constant(leaf), len(self._constants))
        self._size = begin + len(self._constants)

    def _lines(self) -> Iterator[str]:
        """Yield the lines: code, and the places of the value and of both operands."""
        for k, operation in enumerate(self._operations.listed):
            if operation.leaf is None:
                places = [self._place[i] for i in (k, *operation.reads)]
                yield ", ".join(map(str, (_CODES[operation.code], *places, *[0] * (3 - len(places)))))
        for begin, elements in zip(self._begins[len(self._arguments) :], self._operations.results, strict=False):
            for i, k in enumerate(elements):
                yield f"{_CODES[ca.OP_ASSIGN]}, {begin + i}, {self._place[k]}, 0"

    def text(self) -> str:
        """Return the table and the functions that run it."""
        name, lines = self._function.name(), list(self._lines())
        n, m = len(self._arguments), len(self._made)
        fields = f"{name}_lines, {len(lines)}, {name}_begins, {n}, {m}"
        fields += f", {name}_constants, {len(self._constants)}, {self._size}"
        parts = [
            array("int", f"{name}_lines", lines),
            array("int", f"{name}_begins", map(str, self._begins)),
            array("double", f"{name}_constants", self._constants),
            f"""static void {name}_run(const double *const *given, double *const *made, int back)
{{
    static const Operations operations = {{{fields}}};
#if {2 * self._size} > {STACK}
    static _Thread_local
#endif
    double w[{self._size}], d[{self._size}];
    run_operations(&operations, given, made, w, d, back);
}}
""",
        ]
        for ending in DIRECTIONS:
            arguments, made = derivative_names(self._function, ending)
            body = [
                f"const double *const given[] = {{{', '.join(arguments)}}};",
                f"double *const made[] = {{{', '.join(f'{result}_out' for result in made)}}};",
                f"{name}_run(given, made, {DIRECTIONS.index(ending)});",
            ]
            parts.append(definition(wrapped(c_prototype(self._function, ending)), body))
        return "\n".join(parts)
