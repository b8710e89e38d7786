"""Series in a trace: operations that are one another's counterpart at one joint after the other.

The trace of a chain of joints repeats its operations for each joint. Series find them again: pairs of results that lie
a joint apart lead, operand by operand, to pairs of operations that do the same. A series has an index, its joint, and
belongs to a pass, a loop over the joints up or down, as the recursions that it is part of run from base to tip or back.
What has no counterpart is a series of one.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from graphlib import TopologicalSorter

import casadi as ca
import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

_DEPTH = 4
"""Operations below a result that must be alike for two results to be a pair."""
_ROUNDS = 200
"""Changes of the indices after which series that use each other are taken to have no common direction."""

BEFORE = -1
"""Pass of what needs no loop and comes before all."""


class Trace:
    """The operations of a function without the memory that they share: each has a value of its own.

    Attributes
    ----------
    operations : list of int
        CasADi's codes.
    operands : list of tuple of int
        Operations that each reads.
    given : list
        Of an input (argument, element), of a constant its value, else None.
    results : list of (result, element, operation)
    """

    def __init__(self, function: ca.Function) -> None:
        self.function = function
        self.operations: list[int] = []
        self.operands: list[tuple[int, ...]] = []
        self.given: list[tuple[int, int] | float | None] = []
        self.results: list[tuple[int, int, int]] = []
        self._digests: list[list[int]] = []  # by depth
        held: dict[int, int] = {}  # place in CasADi's memory to the operation whose value is there
        for k in range(function.n_instructions()):
            operation, target = function.instruction_id(k), function.instruction_output(k)
            if operation == ca.OP_OUTPUT:
                self.results.append((target[0], target[1], held[function.instruction_input(k)[0]]))
                continue
            read: tuple[int, ...] = ()
            given: tuple[int, int] | float | None = None
            if operation == ca.OP_CONST:
                given = function.instruction_constant(k)
            elif operation == ca.OP_INPUT:
                argument, element = function.instruction_input(k)
                given = argument, element
            else:
                read = tuple(held[place] for place in function.instruction_input(k))
            held[target[0]] = len(self.operations)
            self.operations.append(operation)
            self.operands.append(read)
            self.given.append(given)

    def is_leaf(self, k: int) -> bool:
        """Whether an operation is an input or a constant."""
        return self.given[k] is not None

    def digests(self, depth: int) -> list[int]:
        """Return a number for each operation, the same for those that are alike with all that is `depth` below."""
        if not self._digests:
            arguments = (given[0] if isinstance(given, tuple) else -1 for given in self.given)
            self._digests.append(list(map(hash, zip(self.operations, arguments, strict=True))))
        while len(self._digests) <= depth:
            found = self._digests[-1]
            self._digests.append(
                [hash((f, *(found[a] for a in read))) for f, read in zip(found, self.operands, strict=True)]
            )
        return self._digests[depth]


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

    def offset(self, reader: int, read: int, ahead: int) -> int:
        """Index of what is read less the index of the reader, for an entry of `reads`."""
        return self.series[read].first + ahead - self.series[reader].first


def find_series(trace: Trace, joints: int, period: int, alike: Sequence[int]) -> Layout | None:
    """Return the series of a trace; None where they do not run in one direction.

    Parameters
    ----------
    joints : int
        Elements of a vector that has a number for each joint.
    period : int
        Joints from one member to the next.
    alike : sequence of int
        Number of each operation; counterparts have the same.
    """
    layout = _grouped(trace, _counterparts(trace, joints, period, alike))
    _number(layout, joints, period)
    return layout if _order(layout) else None


# ---------------------------------------------------------------- counterparts


def _counterparts(trace: Trace, joints: int, period: int, alike: Sequence[int]) -> dict[int, int]:
    """Return operation to its counterpart at the next joint."""
    columns: dict[int, dict[int, int]] = defaultdict(dict)
    for result, element, operation in trace.results:
        columns[result][element] = operation
    deep = trace.digests(_DEPTH)
    size = trace.function.numel_out
    after: dict[int, int] = {}
    taken: set[int] = set()
    steps: dict[int, dict[int, int]] = defaultdict(dict)  # argument to element to that of the next joint
    # vectors with so many numbers for each joint, one after the other, show where the next joint is in others
    for result in sorted(columns, key=lambda result: size(result) % joints != 0):
        if size(result) >= joints:
            next_element = _next_elements(trace, result, columns[result], joints, period, steps, deep)
            waiting = [
                (operation, columns[result][next_element[element]])
                for element, operation in sorted(columns[result].items(), reverse=True)
                if next_element.get(element) in columns[result]
                and deep[operation] == deep[columns[result][next_element[element]]]
            ]
            _pair(
                trace, waiting if _rises(trace, waiting) else [(b, a) for a, b in waiting], alike, after, taken, steps
            )
    return after


def _next_elements(
    trace: Trace,
    result: int,
    column: dict[int, int],
    joints: int,
    period: int,
    steps: dict[int, dict[int, int]],
    deep: list[int],
) -> dict[int, int]:
    """Return element of a result to that of the next joint."""
    function, size = trace.function, trace.function.numel_out(result)
    if size % joints == 0:
        return {e: e + period for e in range(size) if e % joints + period < joints}
    same = [a for a in steps if function.numel_in(a) == size]  # as derivatives by the parameters are laid out
    if same:
        return steps[same[0]]
    away = _distance(column, deep, size, period * size / joints)
    return {e: e + away for e in range(size - away)}


def _pair(
    trace: Trace,
    waiting: list[tuple[int, int]],
    alike: Sequence[int],
    after: dict[int, int],
    taken: set[int],
    steps: dict[int, dict[int, int]],
) -> None:
    """Go down from pairs of operations to those of their operands."""
    while waiting:
        a, b = waiting.pop()
        if a == b or alike[a] != alike[b] or a in after or b in taken:
            continue
        one, other = trace.given[a], trace.given[b]
        if one is not None:
            if isinstance(one, tuple) and isinstance(other, tuple):
                steps[one[0]].setdefault(one[1], other[1])
            continue
        after[a] = b
        taken.add(b)
        waiting.extend(zip(trace.operands[a], trace.operands[b], strict=True))


def _distance(column: dict[int, int], deep: list[int], size: int, about: float) -> int:
    """Return the number of elements after which the operations of a result repeat."""
    digests = np.zeros(size, dtype=np.int64)
    digests[list(column)] = [deep[operation] for operation in column.values()]
    tried = range(max(1, int(0.75 * about)), min(size // 2, int(1.35 * about)) + 1)
    score = {k: np.count_nonzero((digests[k:] == digests[:-k]) & (digests[k:] != 0)) for k in tried}
    return min((k for k in tried if score[k] >= 0.95 * max(score.values())), default=1)


def _rises(trace: Trace, pairs: list[tuple[int, int]]) -> bool:
    """Whether the inputs below pairs have higher elements in the second."""
    middle = len(pairs) // 2
    seen: set[tuple[int, int]] = set()
    waiting = pairs[middle : middle + max(1, len(pairs) // 8)]
    risen = Counter[int]()
    while waiting:
        a, b = pair = waiting.pop()
        if a == b or pair in seen or trace.operations[a] != trace.operations[b]:
            continue
        seen.add(pair)
        one, other = trace.given[a], trace.given[b]
        if isinstance(one, tuple) and isinstance(other, tuple) and one[0] == other[0]:
            risen[one[0]] += int(np.sign(other[1] - one[1]))
        waiting.extend(zip(trace.operands[a], trace.operands[b], strict=True))
    return sum(np.sign(count) for count in risen.values()) >= 0


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
    series = layout.series
    edges = [(k, r, ahead) for k in part for r in series[k].reads if r in inside for ahead in series[k].reads[r]]
    for direction in (1, -1):
        if all(layout.offset(*edge) * direction <= 0 for edge in edges):
            return direction
    for direction in (1, -1):
        first = {k: series[k].first for k in part}
        for _ in range(_ROUNDS):
            late = any((first[r] + ahead - first[k]) * direction > 0 for k, r, ahead in edges)
            if not late:
                for k in part:
                    series[k].first = first[k]
                return direction
            for k, r, ahead in edges:
                step = (first[r] + ahead - first[k]) * direction
                first[k] += max(step, 0) * direction
    return None
