"""Exact derivatives of long functions along directions: a table of operations for a C function that runs both ways.

A line of the table is an operation of the trace, or of its loops over the joints. Each argument, result, constant and
value has a separate place in a memory. Forward, the change of a value is calculated beside it. Backward, the derivative
by a value is shared out to its operands. A table compiles in a hundredth of the time of C text, and does not grow with
the joints.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from itertools import accumulate
from typing import NamedTuple

import casadi as ca

from vdfmu.compiler.c.loop_text import STACK
from vdfmu.compiler.c.loops import Loops, Operand, Segment
from vdfmu.compiler.c.text import EXPRESSIONS, array, c_prototype, cell, definition, head, slopes, source_text, wrapped
from vdfmu.compiler.functions.derivatives import DIRECTIONS, derivative_names

_CODES = {operation: code for code, operation in enumerate(EXPRESSIONS)}
_CODE = 6
"""Bits of a code."""


def c_operations() -> dict[str, str]:
    """Return file name to text of the runner of tables, the same for all units."""
    cases: list[str] = []
    for operation, code in _CODES.items():
        value, by_a, by_b, *_ = (x.format("a", "b") for x in (EXPRESSIONS[operation], *slopes(operation), "0.0"))
        cases.append(f"    case {code}: *value = {value}; *by_a = {by_a}; *by_b = {by_b}; return;")
    runner = source_text("operations.c").replace("    /* CASES */", "\n".join(cases)).replace("CODE_BITS", str(_CODE))
    return {
        "operations.h": head("Tables of operations.") + source_text("operations.h"),
        "operations.c": head("What runs tables of operations.") + runner,
    }


class _Place(NamedTuple):
    """Place in the memory at index 0, and its change to the next index."""

    at: int
    slope: int = 0


class _Line(NamedTuple):
    """An operation with the places of its result and its operands."""

    operation: int
    places: list[_Place]


def c_derivatives(loops: Loops) -> str:
    """Return both derivatives of a function (:mod:`vdfmu.compiler.functions.derivatives`) as C for ``operations.h``."""
    return _OperationTable(loops).text()


class _OperationTable:
    """The table of a function."""

    def __init__(self, loops: Loops) -> None:
        self._loops, self._function = loops, loops.trace.function
        self._arguments, self._made = self._function.name_in(), self._function.name_out()
        sizes = [self._function.numel_in(name) for name in self._arguments]
        sizes += [self._function.numel_out(name) for name in self._made]
        sizes += [len(series.members) for series in loops.series]
        self._begins = list(accumulate(sizes, initial=0))
        """Places of each argument, result and series, and of the constants."""
        self._constants: dict[str, int] = {}
        before = [self._line(segment) for segment in loops.before]
        self._passes = [(0, 0, [(0, 0, before)])] if before else []
        for turn, loop in loops.passes.items():
            first, last = (loop.low, loop.high) if turn % 2 == 0 else (loop.high, loop.low)
            blocks = [(*span, [self._line(segment) for segment in segments]) for span, segments in loop.blocks]
            self._passes.append((first, last, blocks))
        self._passes.append(self._results())

    def _results(self) -> tuple[int, int, list[tuple[int, int, list[_Line]]]]:
        """Return the pass that copies the results."""
        blocks: dict[tuple[int, int], list[_Line]] = defaultdict(list)
        for k, stores in self._loops.stores.items():
            for store in stores:
                first = self._loops.series[k].first + store.begin
                begin = self._begins[len(self._arguments) + store.result] + store.base
                target = _Place(begin - store.slope * first, store.slope)
                blocks[first, first + store.end - store.begin].append(_Line(ca.OP_ASSIGN, [target, self._value(k)]))
        low, high = min(first for first, _ in blocks), max(last for _, last in blocks)
        return low, high, [(*span, lines) for span, lines in blocks.items()]

    def _line(self, segment: Segment) -> _Line:
        operands = [self._operand(segment, operand) for operand in segment.operands]
        return _Line(self._loops.operation(segment), [self._value(segment.series), *operands])

    def _value(self, k: int, offset: int = 0) -> _Place:
        """Return the place of a series at an offset from the index of the loop."""
        series, begin = self._loops.series[k], self._begins[len(self._arguments) + len(self._made) + k]
        return _Place(begin) if series.alone else _Place(begin - series.first + offset, 1)

    def _operand(self, segment: Segment, operand: Operand) -> _Place:
        if operand.number:
            return _Place(self._begins[-1] + self._constants.setdefault(operand.number, len(self._constants)))
        if operand.argument < 0:
            return self._value(operand.series, self._loops.offset(segment, operand))
        slope = operand.slope or 0
        return _Place(self._begins[operand.argument] + operand.base - slope * self._loops.at(segment), slope)

    def text(self) -> str:
        """Return the table and the functions that run it."""
        name, size = self._function.name(), self._begins[-1] + len(self._constants)
        listed = [line for *_, blocks in self._passes for *_, lines in blocks for line in lines]
        slopes = {slope: k for k, slope in enumerate(sorted({place.slope for line in listed for place in line.places}))}
        bits = (len(slopes) - 1).bit_length()
        rows: list[str] = []
        for operation, places in listed:
            word = _CODES[operation]
            for k, place in enumerate(places):
                word |= slopes[place.slope] << _CODE + k * bits
            rows.append(", ".join(map(str, (word, *(place.at for place in places), *[0] * (3 - len(places))))))
        moves = "".join(f"    moved[{k}] = {slope} * i;\n" for slope, k in slopes.items())
        n_given, n_made = len(self._arguments), len(self._made)
        fields = f"{name}_lines, {name}_blocks, {name}_passes, {len(self._passes)}, {bits}, {name}_move"
        fields += f", {name}_begins, {n_given}, {n_made}, {name}_constants, {len(self._constants)}, {size}"
        blocks = [block for *_, listed in self._passes for block in listed]
        arrays = {"int64_t lines": rows, "Span blocks": _spans(blocks), "Span passes": _spans(self._passes)}
        arrays |= {"int begins": map(str, self._begins[: n_given + n_made + 1]), "double constants": self._constants}
        parts = [
            *(_array(kind.replace(" ", f" {name}_"), items) for kind, items in arrays.items()),
            f"static void {name}_move(int i, int *moved)\n{{\n    (void)i;\n{moves}}}\n",
            f"""static void {name}_run(const double *const *given, double *const *made, int back)
{{
    static const Operations operations = {{{fields}}};
    int moved[{len(slopes)}];
#if {2 * size} > {STACK}
    static _Thread_local
#endif
    double w[{size}], d[{size}];
    const Work work = {{w, d, moved}};
    run_operations(&operations, given, made, &work, back);
}}
""",
        ]
        for ending in DIRECTIONS:
            arguments, made = derivative_names(self._function, ending)
            lines = [
                f"const double *const given[] = {{{', '.join(arguments)}}};",
                f"double *const made[] = {{{', '.join(f'{result}_out' for result in made)}}};",
                f"{name}_run(given, made, {DIRECTIONS.index(ending)});",
            ]
            parts.append(definition(wrapped(c_prototype(self._function, ending)), lines))
        return "\n".join(parts)


def _array(declared: str, items: Iterable[str]) -> str:
    """Return a constant array, four items a line for any length: numbers alone grow with the joints."""
    kind, name = declared.split()
    listed = list(items)
    return array(kind, name, (", ".join(listed[i : i + 4]) for i in range(0, len(listed), 4)), one_a_line=True)


def _spans(listed: Iterable[tuple[int, int, Sequence[object]]]) -> Iterator[str]:
    """Yield first and last index of each part, and begin and end of its content in all contents."""
    begin = 0
    for first, last, content in listed:
        yield cell(first, last, begin, begin + len(content))
        begin += len(content)
