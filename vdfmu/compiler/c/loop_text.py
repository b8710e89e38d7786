"""C text of a trace as loops over the joints.

Text and compiled code do not grow with the number of joints. The values are the same bits as those of the trace: each
operation runs once, with its operands. The text is indented by one blank a level: most of its lines are three levels
deep.
"""

from __future__ import annotations

import heapq
import re
from collections import Counter
from collections.abc import Iterator

from vdfmu.compiler.c.loops import Loops, Operand, Pass, Segment
from vdfmu.compiler.c.text import EXPRESSIONS, c_prototype

STACK = 32_768
"""Numbers of the memory from which it is not on the stack, which threads have 512 kB of on some systems."""

_INDEX = re.compile(r"\b([ir])\b")
"""What the loops count with: arguments of these names have others in the definition."""
_OPERAND = re.compile(r"{(\d)}")
_WORDS = 16
"""Words of an expression from which it has a line of its own; digits would grow with the joints."""


def c_loops(loops: Loops) -> str:
    """Return a C11 function of a trace, see :func:`~vdfmu.compiler.c.functions.c_texts`."""
    return _Text(loops).text()


class _Text:
    """The text of the function."""

    def __init__(self, loops: Loops) -> None:
        self.loops, self.series = loops, loops.series
        function = loops.trace.function
        self._prototype = _INDEX.sub(r"own_\1", c_prototype(function))
        self._name_of_all, _, arguments = self._prototype.removeprefix("void ").partition("(")
        self._arguments = arguments.removesuffix(")").split(", ")
        self.given = [_INDEX.sub(r"own_\1", name) for name in function.name_in()]
        self.made = function.name_out()
        self._reserve()
        self._read = Counter(
            segment.operands[int(k)].series
            for segments in loops.segments
            for segment in segments
            for k in _OPERAND.findall(EXPRESSIONS[loops.operation(segment)])
        )
        self._inside: dict[int, str] = {}
        """Series that are read once, in the block that calculates them: their expressions."""

    def text(self) -> str:
        """Return the definitions of the function and of one for each pass."""
        body = [line for segment in self.loops.before for line in self._statements(segment, "double ")]
        given = [argument.rpartition(" ")[2] for argument in self._arguments]
        texts: list[str] = []
        for turn, found in self.loops.passes.items():
            name = f"{self._name_of_all}_pass_{turn}"
            texts.append(f"{self._part(name)};\n{_block(self._part(name), list(self._loop(turn, found)))}")
            body.append(f"{name}({', '.join([*given, 'w'])});")
        size = max(self._size, 1)
        memory = [f"#if {size} > {STACK}", "static _Thread_local", "#endif"] if self._size else []
        body = [*memory, f"double w[{size}];", *self._unused(), *body]
        return "\n".join([*texts, _block(self._prototype, body)])

    def _part(self, name: str) -> str:
        return f"void {name}({', '.join([*self._arguments, 'double *restrict w'])})"

    def _unused(self) -> list[str]:
        return [f"(void){argument.rpartition(' ')[2]};" for argument in self._arguments]

    def _loop(self, turn: int, found: Pass) -> Iterator[str]:
        """Yield the lines of a pass."""
        yield from (*self._unused(), "(void)w;")
        first, last, ahead, change = (
            (found.low, found.high, "<=", "i++") if turn % 2 == 0 else (found.high, found.low, ">=", "i--")
        )
        yield f"for (int i = {first}; i {ahead} {last}; {change}) {{"
        yield f" const int r = {_affine(self._width, -self._width * self._base)};"
        yield " (void)r;"
        if shared := sorted(found.shared & self._named):
            yield f" double {', '.join(f'{self._name(k)} = 0.0' for k in shared)};"
        for span, segments in found.blocks:
            yield self._guard(found, span)
            for segment in segments:
                declared = "" if segment.series in found.shared else "double "
                yield from (f"  {line}" for line in self._statements(segment, declared))
            yield " }"
        yield "}"

    def _guard(self, found: Pass, span: tuple[int, int]) -> str:
        begin, end = span
        limits = [f"i >= {begin}"] * (begin > found.low) + [f"i <= {end}"] * (end < found.high)
        condition = f"i == {begin}" if begin == end else " && ".join(limits)
        return f" if ({condition}) {{" if limits else " {"

    # ---------------------------------------------------------------- memory

    def _reserve(self) -> None:
        """Give places in the memory to what is read at another index or in another pass than its own.

        It has a row for each index; a column is used again once the pass is over in which it is read last.
        """
        loops, series = self.loops, self.series
        self._named = set(loops.stores)
        until: dict[int, int] = {}
        for segment in (one for segments in loops.segments for one in segments):
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
        """Place in the memory of a series at the index of the loop and an offset; None without one."""
        if k in self._cells:
            return str(self._cells[k])
        if k not in self._columns:
            return None
        return f"r + {offset * self._width + self._columns[k]}"

    # ---------------------------------------------------------------- statements

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
                yield f"{guard}{self.made[store.result]}_out[{element}] = {name};"

    def _operand(self, segment: Segment, operand: Operand) -> str:
        """Return the value that a segment reads."""
        read = operand.series
        if operand.number:
            return f"({operand.number})" if operand.number.startswith("-") else operand.number
        if operand.argument >= 0:
            slope = operand.slope or 0
            return f"{self.given[operand.argument]}[{_affine(slope, operand.base - slope * self.loops.at(segment))}]"
        if self.loops.is_local(segment, operand):
            return self._inside.get(read) or self._name(read)
        offset = 0 if self.series[read].alone else self.loops.offset(segment, operand)
        return f"w[{self._place(read, offset)}]"

    def _name(self, k: int) -> str:
        return f"{'s' if self.series[k].alone else 'v'}{k}"


def _block(prototype: str, lines: list[str]) -> str:
    return "\n".join([prototype, "{", *(f" {line}" for line in lines), "}\n"])


def _affine(slope: int, constant: int) -> str:
    """Return ``slope * i + constant`` as C text, whose form does not depend on the constant."""
    if slope == 0:
        return str(constant)
    return f"{'i' if slope == 1 else f'{slope} * i'} + {constant}"
