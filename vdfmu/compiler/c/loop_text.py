"""C text of a trace as loops over the joints, and of its derivatives along directions.

Text and compiled code do not grow with the number of joints. The function's values are the same bits as those of the
trace: each operation runs once, with its operands. The derivatives need no trace of their own: `forward` calculates
each operation's change beside its value; `reverse` keeps the values, then runs the loops backwards. The text is
indented by one blank a level: most of its lines are three levels deep.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Callable, Iterable, Iterator

from vdfmu.compiler.c.expressions import EXPRESSIONS, c_prototype, slopes
from vdfmu.compiler.c.loops import Loops, Operand, Pass, Segment

_STACK = 32_768
"""Numbers of the memory from which it is not on the stack, which threads have 512 kB of on some systems."""


def c_loops(loops: Loops, derivative: str = "") -> str:
    """Return a C11 function of a trace, see :func:`~vdfmu.compiler.c.functions.c_texts`, or its derivative."""
    return {"": _Text, "forward": _Forward, "reverse": _Reverse}[derivative](loops).text()


class _Text:
    """The text of the function."""

    ending = ""
    kind = ""
    """Beginning of the names of what the results are: of values nothing, of changes `d`."""
    memories: tuple[str, ...] = ("w",)
    whole = False
    """Whether the memory has all values, which then have no names."""

    def __init__(self, loops: Loops) -> None:
        self.loops, self.series = loops, loops.series
        function = loops.trace.function
        self._prototype = c_prototype(function, self.ending)
        self._name_of_all, _, arguments = self._prototype.removeprefix("void ").partition("(")
        self._arguments = arguments.removesuffix(")").split(", ")
        self.given, self.made = function.name_in(), function.name_out()
        self._prefix = f"{self.kind}_" if self.kind else ""
        self._moving = set[int]()
        self._needed = set(range(len(self.series)))
        if self.ending:
            self._choose()
        self._reserve()

    def text(self) -> str:
        """Return the definitions of the function and of one for each pass."""
        parts: dict[str, list[str]] = {}
        body = self._body(parts)
        size = max(self._size, 1)
        memory = [f"#if {size} > {_STACK}", "static _Thread_local", "#endif"] if self._size else []
        memory = [line for name in self.memories for line in (*memory, f"double {name}[{size}];")]
        texts = [f"{self._part(name)};\n{_block(self._part(name), lines)}" for name, lines in parts.items()]
        return "\n".join([*texts, _block(self._prototype, [*memory, *self._unused(), *body])])

    def _body(self, parts: dict[str, list[str]]) -> list[str]:
        """Return the lines of the function, and put those of the functions that it calls into `parts`."""
        body = [line for segment in self.loops.before for line in self._statements(segment, "double ")]
        for turn, found in self.loops.passes.items():
            parts[f"{self._name_of_all}_pass_{turn}"] = list(self._loop(turn, found))
        return [*body, *self._calls(parts)]

    def _calls(self, names: Iterable[str]) -> list[str]:
        given = [argument.rpartition(" ")[2] for argument in self._arguments]
        return [f"{name}({', '.join([*given, *self.memories])});" for name in names]

    def _part(self, name: str) -> str:
        memory = [f"double *restrict {name}" for name in self.memories]
        return f"void {name}({', '.join([*self._arguments, *memory])})"

    def _unused(self) -> list[str]:
        return [f"(void){argument.rpartition(' ')[2]};" for argument in self._arguments]

    def _loop(self, turn: int, found: Pass) -> Iterator[str]:
        """Yield the lines of a pass."""
        yield from self._head(found, turn % 2 == 0)
        kinds = {"": self._needed} | ({self.kind: self._moving} if self.kind else {})
        shared = [self._name(k, kind) for kind, used in kinds.items() for k in sorted(found.shared & used)]
        if shared and not self.whole:
            yield f" double {', '.join(f'{name} = 0.0' for name in shared)};"
        for span, segments in found.blocks:
            yield self._guard(found, span)
            for segment in segments:
                declared = "" if segment.series in found.shared else "double "
                yield from (f"  {line}" for line in self._statements(segment, declared))
            yield " }"
        yield "}"

    def _head(self, found: Pass, up: bool) -> Iterator[str]:
        yield from (*self._unused(), *(f"(void){name};" for name in self.memories))
        first, last, ahead, change = (
            (found.low, found.high, "<=", "i++") if up else (found.high, found.low, ">=", "i--")
        )
        yield f"for (int i = {first}; i {ahead} {last}; {change}) {{"
        yield f" const int r = {_affine(self._width, -self._width * self._base)};"
        yield " (void)r;"

    def _guard(self, found: Pass, span: tuple[int, int]) -> str:
        begin, end = span
        limits = [f"i >= {begin}"] * (begin > found.low) + [f"i <= {end}"] * (end < found.high)
        condition = f"i == {begin}" if begin == end else " && ".join(limits)
        return f" if ({condition}) {{" if limits else " {"

    def _choose(self) -> None:
        """Choose what a derivative calculates: the series that results change with, and the values in their slopes."""
        loops = self.loops
        self._moving = _below(loops, list(loops.stores), lambda one: [operand for operand, _ in _sloping(loops, one)])
        read: list[int] = []
        for segment in (one for k in self._moving for one in loops.segments[k]):
            used = "".join(slope for _, slope in _sloping(loops, segment))
            read += [operand.series for k, operand in enumerate(segment.operands) if f"{{{k}}}" in used]
        self._needed = _below(loops, read, lambda one: one.operands)

    # ---------------------------------------------------------------- memory

    def _reserve(self) -> None:
        """Give places in the memory to what is read at another index or in another pass than its own, or to all.

        It has a row for each index; a column is used again once the pass is over in which it is read last.
        """
        loops, series = self.loops, self.series
        until: dict[int, float] = dict.fromkeys(range(len(series)), math.inf) if self.whole else {}
        for segment in (one for segments in loops.segments for one in segments if not self.whole):
            for operand in segment.operands:
                if operand.series >= 0 and not loops.is_local(segment, operand):
                    until[operand.series] = max(until.get(operand.series, 0), series[segment.series].turn)
        rows = sorted((k for k in until if not series[k].alone), key=lambda k: series[k].turn)
        self._base = min((series[k].first for k in rows), default=0)
        height = max((series[k].last for k in rows), default=-1) - self._base + 1
        self._columns: dict[int, int] = {}
        free: list[int] = []
        used: list[tuple[float, int]] = []  # last pass, column
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

    def _kept(self, segment: Segment, operand: Operand, kind: str = "") -> str:
        read = operand.series
        offset = 0 if self.series[read].alone else self.loops.offset(segment, operand)
        return f"{kind}w[{self._place(read, offset)}]"

    # ---------------------------------------------------------------- statements

    def _statements(self, segment: Segment, declared: str) -> Iterator[str]:
        yield from self._value(segment, declared)
        yield from self._results(segment)

    def _set(self, kind: str, segment: Segment, value: str, declared: str) -> Iterator[str]:
        name, place = self._name(segment.series, kind), self._place(segment.series)
        if self.whole:
            yield f"{kind}w[{place}] = {value};"
            return
        yield f"{declared}{name} = {value};"
        if place is not None:
            yield f"{kind}w[{place}] = {name};"

    def _value(self, segment: Segment, declared: str) -> Iterator[str]:
        if segment.series in self._needed:
            value = EXPRESSIONS[self.loops.operation(segment)].format(*self._operands(segment))
            yield from self._set("", segment, value, declared)

    def _results(self, segment: Segment) -> Iterator[str]:
        for guard, name, element in self._elements(segment):
            yield f"{guard}{self._prefix}{name}_out[{element}] = {self._name(segment.series, self.kind)};"

    def _elements(self, segment: Segment) -> Iterator[tuple[str, str, str]]:
        """Yield condition, result and element of what a segment is."""
        first = self.series[segment.series].first
        for store in self.loops.stores[segment.series]:
            begin, end = max(store.begin, segment.begin), min(store.end, segment.end)
            if begin <= end:
                whole = (begin, end) == (segment.begin, segment.end)
                guard = "" if whole else f"if (i >= {first + begin} && i <= {first + end}) "
                element = _affine(store.slope, store.base - store.slope * (first + store.begin))
                yield guard, self.made[store.result], element

    def _operands(self, segment: Segment) -> list[str]:
        """Return the values that a segment reads."""
        return [self._operand(segment, operand) for operand in segment.operands]

    def _operand(self, segment: Segment, operand: Operand, kind: str = "") -> str:
        if operand.number:
            return f"({operand.number})" if operand.number.startswith("-") else operand.number
        if operand.argument >= 0:
            return f"{self._prefix if kind else ''}{self._element(segment, operand)}"
        if not self.whole and self.loops.is_local(segment, operand):
            return self._name(operand.series, kind)
        return self._kept(segment, operand, kind)

    def _element(self, segment: Segment, operand: Operand, ending: str = "") -> str:
        slope = operand.slope or 0
        element = _affine(slope, operand.base - slope * self.loops.at(segment))
        return f"{self.given[operand.argument]}{ending}[{element}]"

    def _name(self, k: int, kind: str) -> str:
        return f"{kind}{'s' if self.series[k].alone else 'v'}{k}"


class _Forward(_Text):
    """The product of the Jacobian with a direction: each operation's change beside its value."""

    ending = "forward"
    kind = "d"
    memories = ("w", "dw")

    def _statements(self, segment: Segment, declared: str) -> Iterator[str]:
        yield from self._value(segment, declared)
        if segment.series in self._moving:
            yield from self._set("d", segment, self._change(segment), declared)
        yield from self._results(segment)

    def _change(self, segment: Segment) -> str:
        values, terms = self._operands(segment), ""
        for operand, slope in _sloping(self.loops, segment):
            sign, factor = _factor(slope.format(*values))
            terms += f" {sign} {factor}{self._operand(segment, operand, 'd')}"
        return terms.removeprefix(" + ").strip() or "0.0"


class _Reverse(_Text):
    """The product of a direction with the Jacobian: ``bw`` has the derivative by each value."""

    ending = "reverse"
    memories = ("w", "bw")
    whole = True

    def _results(self, segment: Segment) -> Iterator[str]:
        return iter(())

    def _body(self, parts: dict[str, list[str]]) -> list[str]:
        body = super()._body(parts)
        back: dict[str, list[str]] = {}
        for turn, found in reversed(self.loops.passes.items()):
            back[f"{self._name_of_all}_back_{turn}"] = list(self._back(turn, found))
        parts |= back
        function = self.loops.trace.function
        sizes = {f"bar_{name}_out": function.numel_in(name) for name in self.given} | {"bw": self._size}
        body += [f"for (int k = 0; k < {size}; k++) {name}[k] = 0.0;" for name, size in sizes.items() if size]
        body += self._calls(back)
        return body + [line for segment in reversed(self.loops.before) for line in self._adjoint(segment)]

    def _back(self, turn: int, found: Pass) -> Iterator[str]:
        """Yield the lines of a pass backwards."""
        yield from self._head(found, turn % 2 == 1)
        for span, segments in reversed(found.blocks):
            yield self._guard(found, span)
            for segment in reversed(segments):
                yield from (f"  {line}" for line in self._adjoint(segment))
            yield " }"
        yield "}"

    def _adjoint(self, segment: Segment) -> Iterator[str]:
        """Yield the lines that share the derivative by a value out to its operands."""
        sloping = _sloping(self.loops, segment)
        if segment.series not in self._moving or not sloping:
            return
        name, values = self._name(segment.series, "b"), self._operands(segment)
        yield f"double {name} = bw[{self._place(segment.series)}];"
        for guard, result, element in self._elements(segment):
            yield f"{guard}{name} += bar_{result}[{element}];"
        for operand, slope in sloping:
            place = (
                f"bar_{self._element(segment, operand, '_out')}"
                if operand.argument >= 0
                else self._kept(segment, operand, "b")
            )
            sign, factor = _factor(slope.format(*values))
            yield f"{place} {sign}= {factor}{name};"


def _sloping(loops: Loops, segment: Segment) -> list[tuple[Operand, str]]:
    """Return the operands of a segment along which it has a slope, with that."""
    found = zip(segment.operands, slopes(loops.operation(segment)), strict=True)
    return [(operand, slope) for operand, slope in found if not operand.number and slope != "0.0"]


def _below(loops: Loops, waiting: list[int], read: Callable[[Segment], Iterable[Operand]]) -> set[int]:
    """Return series with all that they need, as `read` has it."""
    found: set[int] = set()
    while waiting:
        k = waiting.pop()
        if k >= 0 and k not in found:
            found.add(k)
            waiting += [operand.series for segment in loops.segments[k] for operand in read(segment)]
    return found


def _factor(slope: str) -> tuple[str, str]:
    """Return sign and text of a factor."""
    return {"1.0": ("+", ""), "-1.0": ("-", "")}.get(slope, ("+", f"{slope} * "))


def _block(prototype: str, lines: list[str]) -> str:
    return "\n".join([prototype, "{", *(f" {line}" for line in lines), "}\n"])


def _affine(slope: int, constant: int) -> str:
    """Return ``slope * i + constant`` as C text, whose form does not depend on the constant."""
    if slope == 0:
        return str(constant)
    return f"{'i' if slope == 1 else f'{slope} * i'} + {constant}"
