"""Series in a trace: operations that are one another's counterpart at one joint after the other.

The trace of a chain of joints repeats its operations for each joint. Series find them again: pairs of results that lie
a joint apart lead, operand by operand, to pairs of operations that do the same. A series has an index, its joint, and
belongs to a pass, a loop over the joints up or down, as the recursions that it is part of run from base to tip or back.
What has no counterpart is a series of one.
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
"""Lengths of the longest series by which an index may move for series that use each other to go one way."""

BEFORE = -1
"""Pass of what needs no loop and comes before all."""


@dataclass
class Series:
    """Operations of the same kind, one a joint; `first` is the index of the first."""

    members: list[int]
    first: int = 0
    turn: int = BEFORE
    """Its pass: even ones run up, odd ones down."""
    reads: dict[int, Counter[int]] = field(default_factory=lambda: defaultdict(Counter))
    """Series that it reads to how far on in them the member is that a member reads, and how often."""

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
    """A trace in series; `places` has series and position of each operation that is not a leaf."""

    trace: Trace
    series: list[Series]
    places: dict[int, tuple[int, int]]
    ordered: bool = False
    """Whether each series has a pass; series that use each other may have no common direction."""

    def offset(self, reader: int, read: int, ahead: int) -> int:
        """Index of what is read less the index of the reader, for an entry of `reads`."""
        return self.series[read].first + ahead - self.series[reader].first


def find_series(trace: Trace, joints: int, period: int, alike: Sequence[int], most: float = math.inf) -> Layout | None:
    """Return the series of a trace; None where they are as many as `most`.

    Parameters
    ----------
    joints : int
        Elements of a vector that has a number for each joint.
    period : int
        Joints from one member to the next.
    alike : sequence of int
        Number of each operation; counterparts have the same.
    most : float
        Lines of the best layout so far: another has at least one for each of its series.
    """
    layout = _grouped(trace, Counterparts(trace, joints, period, alike).after)
    if len(layout.series) >= most:
        return None
    _number(layout, joints, period)
    layout.ordered = _order(layout)
    return layout


def _grouped(trace: Trace, after: dict[int, int]) -> Layout:
    heads = set(range(len(trace.operations))) - set(after.values())
    series: list[Series] = []
    places: dict[int, tuple[int, int]] = {}
    ring = set(range(len(trace.operations))) - heads  # what is its own counterpart some joints later is in no series
    for head in [*sorted(heads), *sorted(ring)]:
        if trace.is_leaf(head) or head in places:
            continue
        members = [head]
        while members[-1] in after and head in heads:
            members.append(after[members[-1]])
        places.update({operation: (len(series), k) for k, operation in enumerate(members)})
        series.append(Series(members))
    for operation, (reader, k) in places.items():
        for read in trace.operands[operation]:
            if not trace.is_leaf(read):
                other, at = places[read]
                series[reader].reads[other][at - k] += 1
    return Layout(trace, series, places)


# ---------------------------------------------------------------- indices


def _number(layout: Layout, joints: int, period: int) -> None:
    """Choose the indices so that most operations read what has their own index."""
    series = layout.series
    known = {k for k, one in enumerate(series) if len(one.members) >= joints // period}  # from 0 on
    readers: dict[int, list[int]] = defaultdict(list)
    for k, one in enumerate(series):
        for read in one.reads:
            readers[read].append(k)
    waiting = [k for k, one in enumerate(series) if not one.alone and k not in known]
    while waiting:
        left: list[int] = []
        for k in waiting:
            votes = _votes(layout, k, known, readers[k])
            votes.update(_votes_of_inputs(layout, k, joints, period))
            if votes:
                series[k].first = min(votes, key=lambda index: (-votes[index], abs(index), index))
                known.add(k)
            else:
                left.append(k)
        if len(left) == len(waiting):
            known.add(left.pop(0))
        waiting = left


def _votes(layout: Layout, k: int, known: set[int], readers: Iterable[int]) -> Counter[int]:
    series = layout.series
    votes = Counter[int]()
    for read in known.intersection(series[k].reads):
        for ahead, count in series[k].reads[read].items():
            votes[series[read].first + ahead] += count
    for reader in readers:
        if reader in known:
            for ahead, count in series[reader].reads[k].items():
                votes[series[reader].first - ahead] += count
    return votes


def _votes_of_inputs(layout: Layout, k: int, joints: int, period: int) -> Counter[int]:
    trace, (a, b, *_) = layout.trace, layout.series[k].members
    votes = Counter[int]()
    for one, other in zip(trace.operands[a], trace.operands[b], strict=True):
        first, second = trace.given[one], trace.given[other]
        if isinstance(first, tuple) and isinstance(second, tuple) and first[0] == second[0]:
            per_joint = trace.function.numel_in(first[0]) % joints == 0
            if per_joint and second[1] - first[1] == period:
                votes[first[1] % joints // period] += len(layout.series[k].members)
    return votes


# ---------------------------------------------------------------- passes


def _order(layout: Layout) -> bool:
    """Choose the pass of each series; return whether there is one for all."""
    series = layout.series
    readers, read = [k for k, s in enumerate(series) for _ in s.reads], [r for s in series for r in s.reads]
    shape = (len(series), len(series))
    from scipy.sparse import coo_matrix  # takes long to import, and long functions alone have series
    from scipy.sparse.csgraph import connected_components

    _, label = connected_components(coo_matrix((np.ones(len(read)), (readers, read)), shape), connection="strong")
    parts: dict[int, list[int]] = defaultdict(list)
    for k, part in enumerate(label):
        parts[int(part)].append(k)
    needed = {
        part: {int(label[r]) for k in members for r in series[k].reads} - {part} for part, members in parts.items()
    }
    wanted: dict[int, list[int]] = defaultdict(list)  # indices of what reads a single operation
    for one in series:
        for r, ahead in one.reads.items():
            if series[r].alone and not one.alone:
                wanted[r] += [one.first - a for a in ahead]
    for part in TopologicalSorter(needed).static_order():
        if not _place(layout, parts[part], wanted):
            return False
    return True


def _place(layout: Layout, part: list[int], wanted: dict[int, list[int]]) -> bool:
    """Choose the pass of series that need each other: the first in which all that they read is there."""
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
    """Put a single operation where what it reads in a pass is there, else where it is read first."""
    series = layout.series
    read = [series[r].first + max(ahead) for r, ahead in series[k].reads.items() if series[r].turn == turn]
    earliest, latest = (max, min) if turn % 2 == 0 else (min, max)
    series[k].first = earliest(read) if read else latest(wanted, default=0)


def _direction(layout: Layout, part: list[int], inside: set[int]) -> int | None:
    """Return 1 if series that read each other run up, -1 for down, None for neither, and move their indices to that."""
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
