"""C text of a trace as loops over the joints.

Text and compiled code do not grow with the number of joints. Each operation runs once with its operands, so the values
are the same bits. A level is indented by one blank, because most lines are three levels deep.
"""

from __future__ import annotations

import heapq
import re
from collections import Counter
from collections.abc import Iterator

from vdfmu.compiler.c.loops import Loops, Operand, Pass, Segment
from vdfmu.compiler.c.text import EXPRESSIONS, c_prototype

STACK = 32_768
"""Most numbers of a memory on the stack: threads have 512 kB on some systems."""

_INDEX = re.compile(r"\b([ir])\b")
"""Indices of the loops. Arguments with these names are renamed in the definition."""
_OPERAND = re.compile(r"{(\d)}")
_WORDS = 16
"""Fewest words of an expression in a separate line. A count of digits would grow with the joints."""


def c_loops(loops: Loops) -> str:
    """Return a C11 function of a trace, see :func:`~vdfmu.compiler.c.functions.c_texts`."""
    return _Text(loops).text()


class _Text:
    """The text of the function."""

    def __init__(self, loops: Loops) -> None:
        self.loops, self.series = loops, loops.series
        function, self._n_in = loops.trace.function, loops.trace.function.n_in()
        self._prototype = _INDEX.sub(r"own_\1", c_prototype(function))
        self._function_name, _, arguments = self._prototype.removeprefix("void ").partition("(")
        self._arguments = arguments.removesuffix(")").split(", ")
        self._pointers = [argument.rpartition(" ")[2] for argument in self._arguments]
        self._reserve()
        self._read = Counter(
            segment.operands[int(k)].series
            for segments in loops.segments
            for segment in segments
            for k in _OPERAND.findall(EXPRESSIONS[loops.operation(segment)])
        )
        self._inside: dict[int, str] = {}
        """Expressions of series that are read once, in the block that calculates them."""

    def text(self) -> str:
        """Return the definitions of the function and of one for each pass."""
        body = [line for segment in self.loops.before for line in self._statements(segment, "double ")]
        texts: list[str] = []
        for turn, loop in self.loops.passes.items():
            name = f"{self._function_name}_pass_{turn}"
            prototype = f"void {name}({', '.join([*self._arguments, 'double *restrict w'])})"
            texts.append(f"{prototype};\n{_block(prototype, list(self._loop(turn, loop)))}")
            body.append(f"{name}({', '.join([*self._pointers, 'w'])});")
        size = max(self._size, 1)
        memory = [f"#if {size} > {STACK}", "static _Thread_local", "#endif"] if self._size else []
        body = [*memory, f"double w[{size}];", *(f"(void){name};" for name in self._pointers), *body]
        return "\n".join([*texts, _block(self._prototype, body)])

    def _loop(self, turn: int, loop: Pass) -> Iterator[str]:
        """Yield the lines of a pass."""
        yield from (f"(void){name};" for name in (*self._pointers, "w"))
        if turn % 2 == 0:
            yield f"for (int i = {loop.low}; i <= {loop.high}; i++) {{"
        else:
            yield f"for (int i = {loop.high}; i >= {loop.low}; i--) {{"
        yield f" const int r = {_affine(self._width, -self._width * self._base)};"
        yield " (void)r;"
        if shared := sorted(loop.shared & self._named):
            yield f" double {', '.join(f'{self._name(k)} = 0.0' for k in shared)};"
        for span, segments in loop.blocks:
            yield self._guard(loop, span)
            for segment in segments:
                declared = "" if segment.series in loop.shared else "double "
                yield from (f"  {line}" for line in self._statements(segment, declared))
            yield " }"
        yield "}"

    def _guard(self, loop: Pass, span: tuple[int, int]) -> str:
        begin, end = span
        limits = [f"i >= {begin}"] * (begin > loop.low) + [f"i <= {end}"] * (end < loop.high)
        condition = f"i == {begin}" if begin == end else " && ".join(limits)
        return f" if ({condition}) {{" if limits else " {"

    def _reserve(self) -> None:
        """Give places in the memory to values that are read at another index or in another pass.

        The memory has a row for each index. A column is free again after the last pass that reads it.
        """
        loops, series = self.loops, self.series
        self._named = set(loops.stores)
        until: dict[int, int] = {}  # series to its last pass
        for segment in (segment for segments in loops.segments for segment in segments):
            for operand in segment.operands:
                if operand.series < 0:
                    continue
                if loops.is_local(segment, operand):
                    self._named.add(operand.series)
                else:
                    until[operand.series] = max(until.get(operand.series, 0), series[segment.series].turn)
        rows = sorted((k for k in until if not series[k].alone), key=lambda k: series[k].turn)
        self._base = min((series[k].first for k in rows), default=0)
        height = max((series[k].last for k in rows), default=-1) - self._base + 1
        self._columns: dict[int, int] = {}
        free: list[int] = []
        used: list[tuple[int, int]] = []  # last pass, column
        self._width = 0
        for k in rows:
            while used and used[0][0] < series[k].turn:
                heapq.heappush(free, heapq.heappop(used)[1])
            if not free:
                free.append(self._width)
                self._width += 1
            self._columns[k] = heapq.heappop(free)
            heapq.heappush(used, (until[k], self._columns[k]))
        single = [k for k in until if series[k].alone]
        self._cells = {k: self._width * height + i for i, k in enumerate(single)}
        self._size = self._width * height + len(single)

    def _place(self, k: int, offset: int = 0) -> str | None:
        """Return the place of a series in the memory, at an offset from the index of the loop, or None."""
        if k in self._cells:
            return str(self._cells[k])
        if k not in self._columns:
            return None
        return f"r + {offset * self._width + self._columns[k]}"

    def _statements(self, segment: Segment, declared: str) -> Iterator[str]:
        k, place = segment.series, self._place(segment.series)
        name, operands = self._name(k), [self._operand(segment, operand) for operand in segment.operands]
        value = EXPRESSIONS[self.loops.operation(segment)].format(*operands)
        if (
            declared
            and place is None
            and self._read[k] == 1
            and k not in self.loops.stores
            and value.count(" ") < _WORDS
        ):
            self._inside[k] = f"({value})"
            return
        targets = [f"{declared}{name}"] * (k in self._named) + [f"w[{place}]"] * (place is not None)
        yield " = ".join([*targets, f"{value};"])
        first = self.series[segment.series].first
        for store in self.loops.stores.get(k, ()):
            begin, end = max(store.begin, segment.begin), min(store.end, segment.end)
            if begin <= end:
                whole = (begin, end) == (segment.begin, segment.end)
                guard = "" if whole else f"if (i >= {first + begin} && i <= {first + end}) "
                element = _affine(store.slope, store.base - store.slope * (first + store.begin))
                yield f"{guard}{self._pointers[self._n_in + store.result]}[{element}] = {name};"

    def _operand(self, segment: Segment, operand: Operand) -> str:
        """Return an operand of a segment as C."""
        read = operand.series
        if operand.number:
            return f"({operand.number})" if operand.number.startswith("-") else operand.number
        if operand.argument >= 0:
            slope = operand.slope or 0
            return (
                f"{self._pointers[operand.argument]}[{_affine(slope, operand.base - slope * self.loops.at(segment))}]"
            )
        if self.loops.is_local(segment, operand):
            return self._inside.get(read) or self._name(read)
        offset = 0 if self.series[read].alone else self.loops.offset(segment, operand)
        return f"w[{self._place(read, offset)}]"

    def _name(self, k: int) -> str:
        return f"{'s' if self.series[k].alone else 'v'}{k}"


def _block(prototype: str, lines: list[str]) -> str:
    return "\n".join([prototype, "{", *(f" {line}" for line in lines), "}\n"])


def _affine(slope: int, constant: int) -> str:
    """Return ``slope * i + constant`` as C text, in the same form for each constant."""
    if slope == 0:
        return str(constant)
    return f"{'i' if slope == 1 else f'{slope} * i'} + {constant}"
