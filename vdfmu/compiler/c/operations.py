"""Derivatives of long functions along directions, exact: a table of operations that one C function runs both ways.

A line of the table is an operation of the trace, or of its loops over the joints. Each value has a place of its own in
a memory, which arguments, results and constants are in too. Forward, a value's change is calculated beside it;
backward, the derivative by a value is shared out to its operands. A table compiles in a hundredth of the time of C
text, and does not grow with the joints.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from itertools import accumulate
from typing import NamedTuple

import casadi as ca

from vdfmu.compiler.c.expressions import EXPRESSIONS, c_prototype, slopes
from vdfmu.compiler.c.loop_text import STACK
from vdfmu.compiler.c.loops import Loops, Operand, Segment
from vdfmu.compiler.c.text import array, cell, head, wrapped
from vdfmu.compiler.functions.derivatives import DIRECTIONS, derivative_names

_CODES = {operation: code for code, operation in enumerate(EXPRESSIONS)}
_CODE = 6
"""Bits of a code."""

_HEADER = """\
#ifndef OPERATIONS_H
#define OPERATIONS_H

#include <stdint.h>

/* a loop over the indices from first to last, also down, of what is from begin to end */
typedef struct {
    int first, last, begin, end;
} Span;

/* A function as operations of loops over an index. Places move with it, each by its slope. */
typedef struct {
    const int64_t *lines; /* four numbers each: code and slopes, places of the result and of both operands */
    const Span *blocks;   /* of lines */
    const Span *passes;   /* of blocks */
    int n_passes;
    int slope_bits;                  /* of the number of a slope */
    void (*move)(int i, int *moved); /* how far the places of each slope have moved at an index */
    const int *begins;               /* of arguments and results, and their end */
    int n_arguments, n_results;
    const double *constants;
    int n_constants, n;
} Operations;

/* Work of n numbers each: the values w; their changes or the derivatives by them d. */
typedef struct {
    double *w, *d;
    int *moved;
} Work;

/* Set what a function changes along a direction or, back, what a direction of its results is by its arguments; given
 * are arguments and direction. What is 0 times what is infinite is 0. */
void run_operations(const Operations *of, const double *const *given, double *const *made, const Work *work, int back);

#endif
"""
_RUN = f"""\
#include <math.h>
#include <string.h>

#include "operations.h"

/* a value and its slopes along its operands */
static inline void operate(int code, double a, double b, double *value, double *by_a, double *by_b)
{{
    switch (code) {{
CASES
    default: *value = *by_a = *by_b = 0.0; return;
    }}
}}

static double times(double slope, double d)
{{
    return slope == 0.0 || d == 0.0 ? 0.0 : slope * d;
}}

static void run_block(const Operations *of, const Span *block, const Work *work, int back)
{{
    const int bits = of->slope_bits, *moved = work->moved;
    const int64_t mask = ((int64_t)1 << bits) - 1;
    double *w = work->w, *d = work->d;
    for (int k = block->begin; k < block->end; k++) {{
        const int64_t *line = of->lines + 4 * (back ? block->begin + block->end - 1 - k : k);
        const int64_t word = line[0] >> {_CODE};
        const int64_t t = line[1] + moved[word & mask];
        const int64_t a = line[2] + moved[word >> bits & mask], b = line[3] + moved[word >> 2 * bits];
        double value, by_a, by_b;
        if (back && d[t] == 0.0)
            continue;
        operate(line[0] & {2**_CODE - 1}, w[a], w[b], &value, &by_a, &by_b);
        if (back) {{
            d[a] += times(by_a, d[t]);
            d[b] += times(by_b, d[t]);
        }} else {{
            w[t] = value;
            d[t] = times(by_a, d[a]) + times(by_b, d[b]);
        }}
    }}
}}

static void run_passes(const Operations *of, const Work *work, int back)
{{
    for (int k = 0; k < of->n_passes; k++) {{
        const Span *pass = of->passes + (back ? of->n_passes - 1 - k : k);
        const int first = back ? pass->last : pass->first, last = back ? pass->first : pass->last;
        const int change = first <= last ? 1 : -1;
        for (int i = first; i != last + change; i += change) {{
            of->move(i, work->moved);
            for (int m = pass->begin; m < pass->end; m++) {{
                const Span *block = of->blocks + (back ? pass->begin + pass->end - 1 - m : m);
                if (i >= block->first && i <= block->last)
                    run_block(of, block, work, back);
            }}
        }}
    }}
}}

static size_t size_of(const Operations *of, int k)
{{
    return (size_t)(of->begins[k + 1] - of->begins[k]) * sizeof(double);
}}

void run_operations(const Operations *of, const double *const *given, double *const *made, const Work *work, int back)
{{
    const int n = of->n_arguments, m = of->n_results, *begins = of->begins;
    const double *const *direction = given + n;
    for (int k = 0; k < n; k++)
        memcpy(work->w + begins[k], given[k], size_of(of, k));
    memcpy(work->w + of->n - of->n_constants, of->constants, (size_t)of->n_constants * sizeof(double));
    memset(work->d, 0, (size_t)of->n * sizeof(double));
    if (back)
        run_passes(of, work, 0);
    for (int k = back ? n : 0; k < (back ? n + m : n); k++)
        memcpy(work->d + begins[k], *direction++, size_of(of, k));
    run_passes(of, work, back);
    for (int k = back ? 0 : n; k < (back ? n : n + m); k++)
        memcpy(*made++, work->d + begins[k], size_of(of, k));
}}
"""


def c_operations() -> dict[str, str]:
    """Return file name to text of what runs tables, the same for all units."""
    cases: list[str] = []
    for operation, code in _CODES.items():
        value, by_a, by_b, *_ = (x.format("a", "b") for x in (EXPRESSIONS[operation], *slopes(operation), "0.0"))
        cases.append(f"    case {code}: *value = {value}; *by_a = {by_a}; *by_b = {by_b}; return;")
    return {
        "operations.h": head("Tables of operations.") + _HEADER,
        "operations.c": head("What runs tables of operations.") + _RUN.replace("CASES", "\n".join(cases)),
    }


class _Place(NamedTuple):
    """Place in the memory at index 0, and how far on it is at the next index."""

    at: int
    slope: int = 0


class _Line(NamedTuple):
    """An operation with the places of its result and its operands."""

    operation: int
    places: list[_Place]


def c_derivatives(loops: Loops) -> str:
    """Return the C text of both derivatives of a function, see :mod:`vdfmu.compiler.functions.derivatives`.

    It needs ``operations.h``.
    """
    return _OperationTable(loops).text()


class _OperationTable:
    """The table of a function."""

    def __init__(self, loops: Loops) -> None:
        self._loops, self._function = loops, loops.trace.function
        self._given, self._made = self._function.name_in(), self._function.name_out()
        sizes = [self._function.numel_in(name) for name in self._given]
        sizes += [self._function.numel_out(name) for name in self._made]
        sizes += [len(one.members) for one in loops.series]
        self._begins = list(accumulate(sizes, initial=0))
        """Of each argument, result and series, and of the constants."""
        self._constants: dict[str, int] = {}
        before = [self._line(segment) for segment in loops.before]
        self._passes = [(0, 0, [(0, 0, before)])] if before else []
        for turn, found in loops.passes.items():
            first, last = (found.low, found.high) if turn % 2 == 0 else (found.high, found.low)
            blocks = [(*span, [self._line(segment) for segment in segments]) for span, segments in found.blocks]
            self._passes.append((first, last, blocks))
        self._passes.append(self._results())

    def _results(self) -> tuple[int, int, list[tuple[int, int, list[_Line]]]]:
        """Return the pass that copies what is a result."""
        blocks: dict[tuple[int, int], list[_Line]] = defaultdict(list)
        for k, stores in self._loops.stores.items():
            for store in stores:
                first = self._loops.series[k].first + store.begin
                begin = self._begins[len(self._given) + store.result] + store.base
                target = _Place(begin - store.slope * first, store.slope)
                blocks[first, first + store.end - store.begin].append(_Line(ca.OP_ASSIGN, [target, self._value(k)]))
        low, high = min(first for first, _ in blocks), max(last for _, last in blocks)
        return low, high, [(*span, lines) for span, lines in blocks.items()]

    def _line(self, segment: Segment) -> _Line:
        operands = [self._operand(segment, operand) for operand in segment.operands]
        return _Line(self._loops.operation(segment), [self._value(segment.series), *operands])

    def _value(self, k: int, offset: int = 0) -> _Place:
        """Return the place of a series at the index of the loop and an offset."""
        one, begin = self._loops.series[k], self._begins[len(self._given) + len(self._made) + k]
        return _Place(begin) if one.alone else _Place(begin - one.first + offset, 1)

    def _operand(self, segment: Segment, operand: Operand) -> _Place:
        if operand.number:
            return _Place(self._begins[-1] + self._constants.setdefault(operand.number, len(self._constants)))
        if operand.argument < 0:
            return self._value(operand.series, self._loops.offset(segment, operand))
        slope = operand.slope or 0
        return _Place(self._begins[operand.argument] + operand.base - slope * self._loops.at(segment), slope)

    # ---------------------------------------------------------------- text

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
        n_given, n_made = len(self._given), len(self._made)
        fields = f"{name}_lines, {name}_blocks, {name}_passes, {len(self._passes)}, {bits}, {name}_move"
        fields += f", {name}_begins, {n_given}, {n_made}, {name}_constants, {len(self._constants)}, {size}"
        blocks = [block for *_, found in self._passes for block in found]
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
            given, made = derivative_names(self._function, ending)
            parts.append(f"""{wrapped(c_prototype(self._function, ending))}
{{
    const double *const given[] = {{{", ".join(given)}}};
    double *const made[] = {{{", ".join(f"{one}_out" for one in made)}}};
    {name}_run(given, made, {DIRECTIONS.index(ending)});
}}
""")
        return "\n".join(parts)


def _array(what: str, items: Iterable[str]) -> str:
    """Text of a constant array, four items a line whatever their length: numbers alone grow with the joints."""
    kind, name = what.split()
    listed = list(items)
    return array(kind, name, (", ".join(listed[i : i + 4]) for i in range(0, len(listed), 4)), one_a_line=True)


def _spans(listed: Iterable[tuple[int, int, Sequence[object]]]) -> Iterator[str]:
    """Yield first and last index of each part, and where its content begins and ends in all of them."""
    begin = 0
    for first, last, content in listed:
        yield cell(first, last, begin, begin + len(content))
        begin += len(content)
