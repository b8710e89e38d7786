"""C text of a trace as loops over the joints, from its series.

Text and compiled code do not grow with the number of joints, and the values are the same bits: each operation of the
trace runs once, with its operands.
"""

from __future__ import annotations

import heapq
from collections import defaultdict
from collections.abc import Iterator
from typing import Any, NamedTuple

import casadi as ca

from vdfmu.compiler.c.expressions import EXPRESSIONS, c_constant, c_prototype
from vdfmu.compiler.c.series import BEFORE, Layout, Trace, find_series

_PERIODS = (1, 2, 4)
"""Joints after which a chain may repeat; signs that cancel double its own period."""
_DEPTHS = (0, 1, 2, 3)
"""How far below an operation another must be alike to be its counterpart: the first at which all runs in loops."""
_GOOD, _WORTH = 0.35, 0.6
"""Lines an operation at which the search ends, and up to which loops are worth it."""
_LONG = 10
"""Members of a series from which loops are worth it."""
_STACK = 32_768
"""Numbers of the memory from which it is not on the stack, which threads have 512 kB of on some systems."""


def c_loops(function: ca.Function, joints: int) -> str | None:
    """Return a C11 function of a trace in loops, see :func:`~vdfmu.compiler.c.functions.c_texts`.

    None if its joints are few or have too little in common, or it calls functions.
    """
    known = {ca.OP_INPUT, ca.OP_OUTPUT, ca.OP_CONST, *EXPRESSIONS}
    if joints < _LONG or not known.issuperset(map(function.instruction_id, range(function.n_instructions()))):
        return None
    trace = Trace(function)
    best: _Text | None = None
    for period in _PERIODS:
        if joints >= _LONG * period:
            layouts = (find_series(trace, joints, period, trace.digests(depth)) for depth in _DEPTHS)
            texts = (_Text(layout) for layout in layouts if layout is not None)
            text = next((one for one in texts if one.complete), None)
            if text and (best is None or text.lines < best.lines):
                best = text
            if best and best.lines < _GOOD * len(trace.operations):
                break
    return best.text() if best and best.lines < _WORTH * len(trace.operations) else None


class _Operand(NamedTuple):
    """What the members of a segment read: ``[base + slope k]`` of an argument for its k-th, a number, or a series."""

    argument: int = -1
    base: int = 0
    slope: int | None = None
    number: str = ""
    series: int = -1
    ahead: int = 0


class _Segment(NamedTuple):
    """Members `begin` to `end` of a series, which are one line of C."""

    series: int
    begin: int
    end: int
    operands: list[_Operand]


class _Store(NamedTuple):
    """Elements ``base + slope k`` of a result, which the members from `begin` to `end` are."""

    begin: int
    end: int
    result: int
    base: int
    slope: int


class _Pass(NamedTuple):
    """A loop over the indices from `low` to `high`: segments in their order, in blocks of the same indices.

    `shared` are the series that more than one block sets or reads.
    """

    low: int
    high: int
    blocks: list[tuple[tuple[int, int], list[_Segment]]]
    shared: set[int]
    complete: bool


class _Text:
    """The text of a function whose series are known."""

    def __init__(self, layout: Layout) -> None:
        self.layout, self.series, self.trace = layout, layout.series, layout.trace
        self.segments = [list(_segments(layout, k)) for k in range(len(self.series))]
        self.lines = sum(len(segments) for segments in self.segments)
        function = self.trace.function
        self._given, self._made = function.name_in(), [f"{name}_out" for name in function.name_out()]
        self._stores, self._copies = _stores(layout)
        self._passes = {turn: self._pass(turn) for turn in sorted({one.turn for one in self.series} - {BEFORE})}
        self._reserve()

    @property
    def complete(self) -> bool:
        """Whether each operation has a place; segments that read each other at different indices have none."""
        return all(one.complete for one in self._passes.values())

    def _reserve(self) -> None:
        """Give places in the memory ``w`` to what is read at another index or in another pass than its own.

        It has a row for each index; a column is used again once the pass is over in which it is read last.
        """
        until: dict[int, int] = {}
        for segment in (one for segments in self.segments for one in segments):
            reader = self.series[segment.series]
            for operand in segment.operands:
                if operand.series >= 0 and not self._is_local(segment, operand):
                    until[operand.series] = max(until.get(operand.series, 0), reader.turn)
        rows = [self.series[k] for k in until if not self.series[k].alone]
        self._base = min((one.first for one in rows), default=0)
        height = max((one.last for one in rows), default=-1) - self._base + 1
        self._columns: dict[int, int] = {}
        free: list[int] = []
        width = 0
        waiting = sorted((k for k in until if not self.series[k].alone), key=lambda k: self.series[k].turn)
        used: list[tuple[int, int]] = []  # last pass, column
        for k in waiting:
            while used and used[0][0] < self.series[k].turn:
                heapq.heappush(free, heapq.heappop(used)[1])
            if not free:
                free.append(width)
                width += 1
            self._columns[k] = heapq.heappop(free)
            heapq.heappush(used, (until[k], self._columns[k]))
        self._width = width
        single = [k for k in until if self.series[k].alone]
        self._cells = {k: width * height + i for i, k in enumerate(single)}
        self._size = width * height + len(single)

    def _is_local(self, segment: _Segment, operand: _Operand) -> bool:
        """Whether a segment reads what its own turn of the loop, or the part before all loops, has calculated."""
        reader, read = self.series[segment.series], self.series[operand.series]
        if read.turn == BEFORE:
            return True
        if read.alone:
            return read.turn == reader.turn and segment.begin == segment.end and self._at(segment) == read.first
        return read.turn == reader.turn and self.layout.offset(segment.series, operand.series, operand.ahead) == 0

    def _at(self, segment: _Segment) -> int:
        return self.series[segment.series].first + segment.begin

    def text(self) -> str:
        """Return the definition of the function."""
        kept = "static _Thread_local " * (self._size > _STACK)
        body = [f"{kept}double w[{self._size}];"] if self._size else []
        body += [f"(void){name};" for name in self._given]
        before = [k for k, one in enumerate(self.series) if one.turn == BEFORE]
        for k in sorted(before, key=lambda k: self.series[k].members[0]):
            (segment,) = self.segments[k]
            body.append(f"const double {self._name(k)} = {self._expression(segment)};")
            body += [f"{self._made[s.result]}[{s.base}] = {self._name(k)};" for s in self._stores[k]]
        for turn, found in self._passes.items():
            body += self._loop(turn, found)
        for result, element, operation in self._copies:
            given = self.trace.given[operation]
            value = f"{self._given[given[0]]}[{given[1]}]" if isinstance(given, tuple) else c_constant(given or 0.0)
            body.append(f"{self._made[result]}[{element}] = {value};")
        return "\n".join([c_prototype(self.trace.function), "{", *(f"    {line}" for line in body), "}\n"])

    def _loop(self, turn: int, found: _Pass) -> Iterator[str]:
        """Yield the lines of a pass."""
        low, high = found.low, found.high
        first, last, ahead, change = (low, high, "<=", "i++") if turn % 2 == 0 else (high, low, ">=", "i--")
        yield f"for (int i = {first}; i {ahead} {last}; {change}) {{"
        shared = sorted(found.shared)
        if shared:
            yield f"    double {', '.join(f'{self._name(k)} = 0.0' for k in shared)};"
        if self._width:
            yield f"    const int r = {_affine(self._width, -self._width * self._base)};"
            yield "    (void)r;"
        for (begin, end), segments in found.blocks:
            limits = [f"i >= {begin}"] * (begin > low) + [f"i <= {end}"] * (end < high)
            condition = f"i == {begin}" if begin == end else " && ".join(limits)
            yield f"    if ({condition}) {{" if limits else "    {"
            for segment in segments:
                declared = "" if segment.series in found.shared else "const double "
                yield from (f"        {line}" for line in self._statements(segment, declared))
            yield "    }"
        yield "}"

    def _pass(self, turn: int) -> _Pass:
        """Order the segments of a pass: those for the same indices together as far as the operands allow."""
        found = [s for k, one in enumerate(self.series) if one.turn == turn for s in self.segments[k]]
        spans = [(self._at(s), self._at(s) + s.end - s.begin) for s in found]
        of: dict[int, list[int]] = defaultdict(list)
        for k, segment in enumerate(found):
            of[segment.series].append(k)
        missing = [0] * len(found)
        readers: dict[int, list[int]] = defaultdict(list)
        for k, segment in enumerate(found):
            for operand in segment.operands:
                if operand.series < 0 or self.series[operand.series].turn != turn:
                    continue
                if self.series[operand.series].alone or self._is_local(segment, operand):
                    for other in of[operand.series]:
                        if spans[other][0] <= spans[k][1] and spans[k][0] <= spans[other][1]:
                            readers[other].append(k)
                            missing[k] += 1
        ready: dict[tuple[int, int], list[tuple[int, int]]] = defaultdict(list)

        def add(k: int) -> None:
            heapq.heappush(ready[spans[k]], (self.series[found[k].series].members[0], k))

        for k in range(len(found)):
            if not missing[k]:
                add(k)
        blocks: list[tuple[tuple[int, int], list[_Segment]]] = []
        block_of: dict[int, int] = {}  # segment to its block
        while any(ready.values()):
            span = max(ready, key=lambda one: len(ready[one]))
            blocks.append((span, []))
            while ready[span]:
                _, k = heapq.heappop(ready[span])
                blocks[-1][1].append(found[k])
                block_of[k] = len(blocks) - 1
                for reader in readers[k]:
                    missing[reader] -= 1
                    if not missing[reader]:
                        add(reader)
        shared = {
            found[k].series
            for k, block in block_of.items()
            if len(of[found[k].series]) > 1 or any(block_of.get(reader) != block for reader in readers[k])
        }
        low, high = min(a for a, _ in spans), max(b for _, b in spans)
        return _Pass(low, high, blocks, shared, len(block_of) == len(found))

    def _statements(self, segment: _Segment, declared: str) -> Iterator[str]:
        k, name = segment.series, self._name(segment.series)
        yield f"{declared}{name} = {self._expression(segment)};"
        if k in self._cells:
            yield f"w[{self._cells[k]}] = {name};"
        elif k in self._columns:
            yield f"w[r + {self._columns[k]}] = {name};"
        first = self.series[k].first
        for store in self._stores[k]:
            begin, end = max(store.begin, segment.begin), min(store.end, segment.end)
            if begin <= end:
                element = _affine(store.slope, store.base - store.slope * (first + store.begin))
                whole = (begin, end) == (segment.begin, segment.end)
                guard = "" if whole else f"if (i >= {first + begin} && i <= {first + end}) "
                yield f"{guard}{self._made[store.result]}[{element}] = {name};"

    def _expression(self, segment: _Segment) -> str:
        code = self.trace.operations[self.series[segment.series].members[0]]
        return EXPRESSIONS[code].format(*(self._operand(segment, operand) for operand in segment.operands))

    def _operand(self, segment: _Segment, operand: _Operand) -> str:
        if operand.number:
            return f"({operand.number})" if operand.number.startswith("-") else operand.number
        if operand.argument >= 0:
            slope = operand.slope or 0
            return f"{self._given[operand.argument]}[{_affine(slope, operand.base - slope * self._at(segment))}]"
        if self._is_local(segment, operand):
            return self._name(operand.series)
        if operand.series in self._cells:
            return f"w[{self._cells[operand.series]}]"
        offset = self.layout.offset(segment.series, operand.series, operand.ahead)
        place = offset * self._width + self._columns[operand.series]
        return f"w[r {'-' if place < 0 else '+'} {abs(place)}]"

    def _name(self, k: int) -> str:
        return f"{'s' if self.series[k].alone else 'v'}{k}"


def _affine(slope: int, constant: int) -> str:
    """Return ``slope * i + constant`` as C text."""
    if slope == 0:
        return str(constant)
    term = "i" if slope == 1 else f"{slope} * i"
    return term if constant == 0 else f"{term} {'+' if constant > 0 else '-'} {abs(constant)}"


def _segments(layout: Layout, k: int) -> Iterator[_Segment]:
    """Yield the members of a series in runs whose operands follow one rule."""
    members = layout.series[k].members
    begin = 0
    operands = _operands(layout, members[0])
    for i in range(1, len(members)):
        found = _operands(layout, members[i])
        joined = [_joined(*pair, i - begin) for pair in zip(operands, found, strict=True)]
        kept = [operand for operand in joined if operand is not None]
        if len(kept) < len(joined):
            yield _Segment(k, begin, i - 1, operands)
            begin, operands = i, found
        else:
            operands = kept
    yield _Segment(k, begin, len(members) - 1, operands)


def _operands(layout: Layout, operation: int) -> list[_Operand]:
    trace, found = layout.trace, []
    for read in trace.operands[operation]:
        given: Any = trace.given[read]
        if isinstance(given, tuple):
            found.append(_Operand(argument=given[0], base=given[1]))
        elif given is not None:
            found.append(_Operand(number=c_constant(given)))
        else:
            series, at = layout.places[read]
            ahead = 0 if layout.series[series].alone else at - layout.places[operation][1]
            found.append(_Operand(series=series, ahead=ahead))
    return found


def _joined(first: _Operand, one: _Operand, k: int) -> _Operand | None:
    """Return the operand of a run and of the member `k` after its first; None if they follow no rule."""
    if first.argument < 0 or first.argument != one.argument:
        return first if first == one else None
    slope = one.base - first.base if first.slope is None else first.slope
    return first._replace(slope=slope) if one.base == first.base + slope * k else None


def _stores(layout: Layout) -> tuple[dict[int, list[_Store]], list[tuple[int, int, int]]]:
    """Return the results that each series is, in runs, and those that are an input or a constant."""
    copies: list[tuple[int, int, int]] = []
    elements: dict[tuple[int, int], dict[int, list[int]]] = defaultdict(lambda: defaultdict(list))
    for result, element, operation in layout.trace.results:
        if layout.trace.is_leaf(operation):
            copies.append((result, element, operation))
        else:
            k, at = layout.places[operation]
            elements[k, result][at].append(element)
    stores: dict[int, list[_Store]] = defaultdict(list)
    for (k, result), at in elements.items():
        for rank in range(max(map(len, at.values()))):
            row = sorted((member, found[rank]) for member, found in at.items() if len(found) > rank)
            begin = 0
            for i in range(1, len(row) + 1):
                slope = row[begin + 1][1] - row[begin][1] if i > begin + 1 else 0
                expected = (row[begin][0] + i - begin, row[begin][1] + slope * (i - begin))
                if i == len(row) or (i > begin + 1 and row[i] != expected) or row[i][0] != expected[0]:
                    stores[k].append(_Store(row[begin][0], row[i - 1][0], result, row[begin][1], slope))
                    begin = i
    return stores, copies
