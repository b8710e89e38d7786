"""Loops over the joints, from the series of a trace. :mod:`.loop_text` writes them as C."""

from __future__ import annotations

import heapq
from collections import defaultdict
from collections.abc import Iterator, Mapping
from typing import NamedTuple

import casadi as ca

from vdfmu.compiler.c.counterparts import Trace
from vdfmu.compiler.c.series import BEFORE, Layout, Series, find_series
from vdfmu.compiler.c.text import EXPRESSIONS, c_constant

_PERIODS = (1, 2, 4)
"""Joints after which a chain may repeat. Signs that cancel double the period."""
_DEPTHS = (0, 1, 2, 3)
"""Depths of operands that must be alike in counterparts. The first with all operations in loops is taken."""
_GOOD = 3.0
"""Segments by operations of a joint at which the search ends."""
_WORTH = 0.6
"""Most segments by operations of a trace in loops."""
_LONG = 10
"""Fewest members of a series in loops."""


def find_loops(function: ca.Function, joints: int) -> Loops | None:
    """Return a trace in loops; None if its joints are few or too different, or if it calls functions."""
    if joints < _LONG or _calls(function):
        return None
    trace = Trace(function)
    best: Loops | None = None
    most = _WORTH * len(trace.operations)
    for period in _PERIODS:
        if joints >= _LONG + 2 * (period - 1):
            for depth in _DEPTHS:
                layout = find_series(trace, joints, period, trace.digests(depth), most)
                if layout is None:  # deeper layouts have more series
                    break
                if layout.ordered and (loops := Loops(layout)).complete:
                    if loops.lines < most:
                        best, most = loops, loops.lines
                    break
            if most < _GOOD * len(trace.operations) / joints:
                break
    return best


def straight(function: ca.Function) -> Loops | None:
    """Return a trace without loops, all before them; None if it calls functions."""
    if _calls(function):
        return None
    trace = Trace(function)
    inner = [k for k in range(len(trace.operations)) if not trace.is_leaf(k)]
    return Loops(Layout(trace, [Series([k]) for k in inner], {k: (i, 0) for i, k in enumerate(inner)}))


def _calls(function: ca.Function) -> bool:
    """Whether a function calls others, or has an operation without C."""
    inline = {ca.OP_INPUT, ca.OP_OUTPUT, ca.OP_CONST, *EXPRESSIONS}
    return not inline.issuperset(map(function.instruction_id, range(function.n_instructions())))


class Operand(NamedTuple):
    """Operand of a segment: ``[base + slope k]`` of an argument for the k-th member, a number, or a series."""

    argument: int = -1
    base: int = 0
    slope: int | None = None
    number: str = ""
    series: int = -1
    ahead: int = 0


class Segment(NamedTuple):
    """Members `begin` to `end` of a series, a line of C."""

    series: int
    begin: int
    end: int
    operands: list[Operand]


class Store(NamedTuple):
    """Members `begin` to `end` of a series as elements ``base + slope k`` of a result."""

    begin: int
    end: int
    result: int
    base: int
    slope: int


class Pass(NamedTuple):
    """A loop over the indices from `low` to `high`: segments in order, in blocks of the same indices."""

    low: int
    high: int
    blocks: list[tuple[tuple[int, int], list[Segment]]]
    shared: set[int]
    """Series that more than one block sets or reads."""
    complete: bool


class Loops:
    """A trace in loops."""

    def __init__(self, layout: Layout) -> None:
        self.layout, self.series, self.trace = layout, layout.series, layout.trace
        leaves = {k: _leaf(leaf) for k, leaf in enumerate(self.trace.leaves) if leaf is not None}
        self.segments = [list(_segments(layout, k, leaves)) for k in range(len(self.series))]
        """Segments of each series."""
        self.lines = sum(map(len, self.segments))
        self.stores = _stores(layout)
        """Series to its elements of results."""
        before = sorted((s.members[0], k) for k, s in enumerate(self.series) if s.turn == BEFORE)
        self.before = [self.segments[k][0] for _, k in before]
        """Segments before the loops, in order."""
        self.passes = {turn: self._pass(turn) for turn in sorted({s.turn for s in self.series} - {BEFORE})}
        """Number to pass. Even passes run up, odd passes down."""

    @property
    def complete(self) -> bool:
        """Whether each segment has a place. Segments that read each other at different indices lack it."""
        return all(loop.complete for loop in self.passes.values())

    def is_local(self, segment: Segment, operand: Operand) -> bool:
        """Whether a segment reads a value of the same turn of its loop, or of the part before all loops."""
        reader, read = self.series[segment.series], self.series[operand.series]
        if read.turn != reader.turn or read.turn == BEFORE:
            return read.turn == reader.turn
        if read.alone:
            return segment.begin == segment.end and self.at(segment) == read.first
        return self.offset(segment, operand) == 0

    def offset(self, segment: Segment, operand: Operand) -> int:
        """Index of a series that a segment reads less the index of the segment."""
        return self.layout.offset(segment.series, operand.series, operand.ahead)

    def operation(self, segment: Segment) -> int:
        """Code of CasADi for the operations of a segment."""
        return self.trace.operations[self.series[segment.series].members[0]]

    def at(self, segment: Segment) -> int:
        """Index at which a segment begins."""
        return self.series[segment.series].first + segment.begin

    def _pass(self, turn: int) -> Pass:
        """Order the segments of a pass. Segments for the same indices come together as far as operands allow."""
        segments = [segment for k, s in enumerate(self.series) if s.turn == turn for segment in self.segments[k]]
        spans = [(self.at(s), self.at(s) + s.end - s.begin) for s in segments]
        of: dict[int, list[int]] = defaultdict(list)  # series to segments
        for k, segment in enumerate(segments):
            of[segment.series].append(k)
        missing = [0] * len(segments)  # operands that are not yet ordered
        readers: dict[int, list[int]] = defaultdict(list)
        for k, segment in enumerate(segments):
            for operand in segment.operands:
                if operand.series < 0 or self.series[operand.series].turn != turn:
                    continue
                if self.series[operand.series].alone or self.is_local(segment, operand):
                    for other in of[operand.series]:
                        if spans[other][0] <= spans[k][1] and spans[k][0] <= spans[other][1]:
                            readers[other].append(k)
                            missing[k] += 1
        ready: dict[tuple[int, int], list[tuple[int, int]]] = defaultdict(list)

        def add(k: int) -> None:
            heapq.heappush(ready[spans[k]], (self.series[segments[k].series].members[0], k))

        for k in range(len(segments)):
            if not missing[k]:
                add(k)
        blocks: list[tuple[tuple[int, int], list[Segment]]] = []
        block_of: dict[int, int] = {}  # segment to its block
        while any(ready.values()):
            span = max(ready, key=lambda span: len(ready[span]))
            blocks.append((span, []))
            while ready[span]:
                _, k = heapq.heappop(ready[span])
                blocks[-1][1].append(segments[k])
                block_of[k] = len(blocks) - 1
                for reader in readers[k]:
                    missing[reader] -= 1
                    if not missing[reader]:
                        add(reader)
        shared = {
            segments[k].series
            for k, block in block_of.items()
            if len(of[segments[k].series]) > 1 or any(block_of.get(reader) != block for reader in readers[k])
        }
        low, high = min(a for a, _ in spans), max(b for _, b in spans)
        return Pass(low, high, blocks, shared, len(block_of) == len(segments))


def _segments(layout: Layout, k: int, leaves: Mapping[int, Operand]) -> Iterator[Segment]:
    """Yield the members of a series in runs with a common rule for the operands."""
    members = layout.series[k].members
    begin = 0
    operands = _operands(layout, members[0], leaves)
    for i in range(1, len(members)):
        following = _operands(layout, members[i], leaves)
        joined = [_joined(*pair, i - begin) for pair in zip(operands, following, strict=True)]
        kept = [operand for operand in joined if operand is not None]
        if len(kept) < len(joined):
            yield Segment(k, begin, i - 1, operands)
            begin, operands = i, following
        else:
            operands = kept
    yield Segment(k, begin, len(members) - 1, operands)


def _leaf(leaf: tuple[int, int] | float) -> Operand:
    return Operand(argument=leaf[0], base=leaf[1]) if isinstance(leaf, tuple) else Operand(number=c_constant(leaf))


def _operands(layout: Layout, operation: int, leaves: Mapping[int, Operand]) -> list[Operand]:
    operands: list[Operand] = []
    for read in layout.trace.operands[operation]:
        if read in leaves:
            operands.append(leaves[read])
        else:
            series, at = layout.places[read]
            ahead = 0 if layout.series[series].alone else at - layout.places[operation][1]
            operands.append(Operand(series=series, ahead=ahead))
    return operands


def _joined(first: Operand, other: Operand, k: int) -> Operand | None:
    """Return the operand of a run and of the member `k` after its first; None without a common rule."""
    if first.argument < 0 or first.argument != other.argument:
        return first if first == other else None
    slope = other.base - first.base if first.slope is None else first.slope
    return first._replace(slope=slope) if other.base == first.base + slope * k else None


def _stores(layout: Layout) -> dict[int, list[Store]]:
    """Return the elements of results in each series, in runs."""
    elements: dict[tuple[int, int], dict[int, list[int]]] = defaultdict(lambda: defaultdict(list))
    for result, element, operation in layout.trace.results:
        k, at = layout.places[operation]
        elements[k, result][at].append(element)
    stores: dict[int, list[Store]] = defaultdict(list)
    for (k, result), at in elements.items():
        for rank in range(max(map(len, at.values()))):
            row = sorted((member, listed[rank]) for member, listed in at.items() if len(listed) > rank)
            begin = 0
            for i in range(1, len(row) + 1):
                slope = row[begin + 1][1] - row[begin][1] if i > begin + 1 else 0
                expected = (row[begin][0] + i - begin, row[begin][1] + slope * (i - begin))
                if i == len(row) or (i > begin + 1 and row[i] != expected) or row[i][0] != expected[0]:
                    stores[k].append(Store(row[begin][0], row[i - 1][0], result, row[begin][1], slope))
                    begin = i
    return stores
