"""Series in a trace: operations that are counterparts from joint to joint.

The trace of a chain of joints repeats its operations for each joint, see :mod:`.counterparts`. A series has an index,
its joint. It belongs to a pass, a loop over the joints up or down, as its recursion runs from base to tip or back. An
operation without counterpart is a series of one member.
"""

from __future__ import annotations

import math
from collections import Counter, defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from graphlib import TopologicalSorter

import numpy as np

from vdfmu.compiler.c.counterparts import Counterparts, Trace

_MOVES = 4
"""Most lengths of the longest series that an index may move, so that series that read each other run one way."""

BEFORE = -1
"""Pass of operations before all loops."""


@dataclass
class Series:
    """Operations of the same kind, one for each joint."""

    members: list[int]
    first: int = 0
    """Index of the first member."""
    turn: int = BEFORE
    """Number of its pass. Even passes run up, odd passes down."""
    reads: dict[int, dict[int, int]] = field(default_factory=lambda: defaultdict(lambda: defaultdict(int)))
    """Series that it reads to the distance from reader to member, and its count."""

    @property
    def alone(self) -> bool:
        """Whether it is a single operation."""
        return len(self.members) == 1

    @property
    def last(self) -> int:
        """Index of the last member."""
        return self.first + len(self.members) - 1


@dataclass
class Layout:
    """A trace in series."""

    trace: Trace
    series: list[Series]
    places: dict[int, tuple[int, int]]
    """Series and position of each operation that is not a leaf."""
    ordered: bool = False
    """Whether each series has a pass. Series that read each other may lack a common direction."""

    def offset(self, reader: int, read: int, ahead: int) -> int:
        """Index of the read member less the index of the reader, for an entry of `reads`."""
        return self.series[read].first + ahead - self.series[reader].first


def find_series(trace: Trace, joints: int, period: int, alike: Sequence[int], most: float = math.inf) -> Layout | None:
    """Return the series of a trace, or None for `most` series or more.

    A vector with a number for each joint has `joints` elements. Members of a series are `period` joints apart.
    Counterparts have the same number in `alike`. The best layout so far has `most` lines, one or more for each series.
    """
    layout = _grouped(trace, Counterparts(trace, joints, period, alike).after)
    if len(layout.series) >= most:
        return None
    _set_reads(layout)
    _number(layout, joints, period)
    layout.ordered = _order(layout)
    return layout


def _grouped(trace: Trace, after: dict[int, int]) -> Layout:
    """Return the series of counterparts. Their `reads` are empty."""
    series: list[Series] = []
    places: dict[int, tuple[int, int]] = {}
    following = set(after.values())
    # an operation of a ring, its own counterpart some joints later, is alone
    for head in sorted(range(len(trace.operations)), key=following.__contains__):
        if trace.leaves[head] is not None or head in places:
            continue
        members = [head]
        while head not in following and members[-1] in after:
            members.append(after[members[-1]])
        for k, operation in enumerate(members):
            places[operation] = len(series), k
        series.append(Series(members))
    return Layout(trace, series, places)


def _set_reads(layout: Layout) -> None:
    for operation, (reader, k) in layout.places.items():
        reads = layout.series[reader].reads
        for read in layout.trace.operands[operation]:
            if read in layout.places:
                other, at = layout.places[read]
                reads[other][at - k] += 1


def _number(layout: Layout, joints: int, period: int) -> None:
    """Choose the indices so that most operations read members of the same index."""
    series = layout.series
    numbered = {k for k, s in enumerate(series) if len(s.members) >= joints // period}  # from 0 on
    readers: dict[int, list[int]] = defaultdict(list)
    for k, s in enumerate(series):
        for read in s.reads:
            readers[read].append(k)
    waiting = [k for k, s in enumerate(series) if not s.alone and k not in numbered]
    while waiting:
        left: list[int] = []
        for k in waiting:
            votes = _votes(layout, k, numbered, readers[k])
            votes.update(_votes_of_inputs(layout, k, joints, period))
            if votes:
                series[k].first = min(votes, key=lambda index: (-votes[index], abs(index), index))
                numbered.add(k)
            else:
                left.append(k)
        if len(left) == len(waiting):
            numbered.add(left.pop(0))
        waiting = left


def _votes(layout: Layout, k: int, numbered: set[int], readers: Iterable[int]) -> Counter[int]:
    series = layout.series
    votes = Counter[int]()
    for read in numbered.intersection(series[k].reads):
        for ahead, count in series[k].reads[read].items():
            votes[series[read].first + ahead] += count
    for reader in numbered.intersection(readers):
        for ahead, count in series[reader].reads[k].items():
            votes[series[reader].first - ahead] += count
    return votes


def _votes_of_inputs(layout: Layout, k: int, joints: int, period: int) -> Counter[int]:
    trace, (a, b, *_) = layout.trace, layout.series[k].members
    votes = Counter[int]()
    for operands in zip(trace.operands[a], trace.operands[b], strict=True):
        first, second = (trace.leaves[operand] for operand in operands)
        if isinstance(first, tuple) and isinstance(second, tuple) and first[0] == second[0]:
            per_joint = trace.function.numel_in(first[0]) % joints == 0
            if per_joint and second[1] - first[1] == period:
                votes[first[1] % joints // period] += len(layout.series[k].members)
    return votes


def _order(layout: Layout) -> bool:
    """Choose the pass of each series. Return whether each series has a pass."""
    series = layout.series
    readers, read = [k for k, s in enumerate(series) for _ in s.reads], [r for s in series for r in s.reads]
    shape = (len(series), len(series))
    from scipy.sparse import coo_matrix  # takes long to import, and only long functions have series
    from scipy.sparse.csgraph import connected_components

    _, label = connected_components(coo_matrix((np.ones(len(read)), (readers, read)), shape), connection="strong")
    parts: dict[int, list[int]] = defaultdict(list)
    for k, part in enumerate(label):
        parts[int(part)].append(k)
    needed = {
        part: {int(label[r]) for k in members for r in series[k].reads} - {part} for part, members in parts.items()
    }
    wanted: dict[int, list[int]] = defaultdict(list)  # indices of readers of a single operation
    for s in series:
        for r, ahead in s.reads.items():
            if series[r].alone and not s.alone:
                wanted[r] += [s.first - a for a in ahead]
    for part in TopologicalSorter(needed).static_order():
        if not _place(layout, parts[part], wanted):
            return False
    return True


def _place(layout: Layout, part: list[int], wanted: dict[int, list[int]]) -> bool:
    """Choose the pass of series that read each other: the first pass with all their operands."""
    series = layout.series
    inside = set(part)
    outside = [(k, r) for k in part for r in series[k].reads if r not in inside]
    recursive = len(part) > 1 or part[0] in series[part[0]].reads
    direction = _direction(layout, part, inside) if recursive else 0
    if direction is None:
        return False
    turn = max((series[r].turn for _, r in outside), default=BEFORE)
    single = not recursive and series[part[0]].alone
    if single and turn == BEFORE:
        return True  # before the loops
    turn = max(turn, 0)
    while True:
        up = 1 - 2 * (turn % 2)
        if direction in (0, up):
            if single:
                _choose_index(layout, part[0], turn, wanted[part[0]])
            steps = (
                layout.offset(k, r, ahead) * up
                for k, r in outside
                if series[r].turn == turn
                for ahead in series[k].reads[r]
            )
            if all(step <= 0 for step in steps):
                break
        turn += 1
    for k in part:
        series[k].turn = turn
    return True


def _choose_index(layout: Layout, k: int, turn: int, wanted: list[int]) -> None:
    """Put a single operation at the index at which its operands in a pass are there, else at its first reader."""
    series = layout.series
    read = [series[r].first + max(ahead) for r, ahead in series[k].reads.items() if series[r].turn == turn]
    earliest, latest = (max, min) if turn % 2 == 0 else (min, max)
    series[k].first = earliest(read) if read else latest(wanted, default=0)


def _direction(layout: Layout, part: list[int], inside: set[int]) -> int | None:
    """Return 1 if series that read each other run up, -1 for down, None for neither. Move their indices accordingly."""
    series, places = layout.series, {k: i for i, k in enumerate(part)}
    read_inside = ((k, r) for k in part for r in series[k].reads if r in inside)
    edges = [(places[k], places[r], ahead) for k, r in read_inside for ahead in series[k].reads[r]]
    reader, read, ahead = np.array(edges).T
    first = np.array([series[k].first for k in part])
    for direction in (1, -1):
        if (direction * (first[read] + ahead - first[reader]) <= 0).all():
            return direction
    most = _MOVES * max(len(series[k].members) for k in part)
    for direction in (1, -1):
        moved = first.copy()
        while np.abs(moved - first).max() <= most:
            late = moved.copy()
            (np.maximum if direction == 1 else np.minimum).at(late, reader, moved[read] + ahead)
            if np.array_equal(late, moved):
                for k, index in zip(part, moved.tolist(), strict=True):
                    series[k].first = index
                return direction
            moved = late
    return None
