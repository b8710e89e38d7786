"""The operations of a trace, and which of them are counterparts at one joint and the next.

Pairs of results that lie a joint apart lead, operand by operand, to pairs of operations that do the same. Where a
recursion ends in no such result, as the pose of the last link or a sum over the joints, pairs of its operations are
found by what is below them.
"""

from __future__ import annotations

from collections import Counter, defaultdict, deque
from collections.abc import Iterable, Iterator, Sequence

import casadi as ca
import numpy as np

_DEPTH = 4
"""Operations below two that must be alike for these to be tried as a pair."""
_TRIED = 3
"""Operations that are tried as the counterpart of one in a recursion."""
_FAILED = 200
"""Operations in a row without a counterpart in a recursion after which no more are tried."""
_LOOK = 1000
"""Pairs below two operations that are looked at."""
_GLANCE = 20
"""The same of two elements of a result."""


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
        What is an input or a constant has an operation too, which copies it.
    away : dict of (operation, operation) to int
        See :class:`Counterparts`.
    """

    def __init__(self, function: ca.Function) -> None:
        self.function = function
        self.operations: list[int] = []
        self.operands: list[tuple[int, ...]] = []
        self.given: list[tuple[int, int] | float | None] = []
        self.results: list[tuple[int, int, int]] = []
        self.away: dict[tuple[int, int], int] = {}
        self._digests: list[list[int]] = []  # by depth
        held: dict[int, int] = {}  # place in CasADi's memory to the operation whose value is there
        for k in range(function.n_instructions()):
            operation, target = function.instruction_id(k), function.instruction_output(k)
            if operation == ca.OP_OUTPUT:
                made = held[function.instruction_input(k)[0]]
                if self.is_leaf(made):
                    made = self._append(ca.OP_ASSIGN, (made,))
                self.results.append((target[0], target[1], made))
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
            held[target[0]] = self._append(operation, read, given)

    def _append(self, operation: int, read: tuple[int, ...], given: tuple[int, int] | float | None = None) -> int:
        self.operations.append(operation)
        self.operands.append(read)
        self.given.append(given)
        return len(self.operations) - 1

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


class Counterparts:
    """Counterparts of a trace.

    Parameters
    ----------
    trace, joints, period, alike
        See :func:`~vdfmu.compiler.c.series.find_series`.

    Attributes
    ----------
    after : dict of int to int
        Operation to its counterpart at the next joint.
    """

    def __init__(self, trace: Trace, joints: int, period: int, alike: Sequence[int]) -> None:
        self._trace, self._joints, self._period, self._alike = trace, joints, period, alike
        self._deep = trace.digests(_DEPTH)
        function = trace.function
        self._by_joint = [function.numel_in(k) % joints == 0 for k in range(function.n_in())]
        self._taken: set[int] = set()
        self._steps: dict[int, dict[int, int]] = defaultdict(dict)  # argument to element to that of the next joint
        self.after: dict[int, int] = {}
        columns: dict[int, dict[int, int]] = defaultdict(dict)
        for result, element, operation in trace.results:
            columns[result][element] = operation
        size = function.numel_out
        # vectors with so many numbers for each joint, one after the other, show where the next joint is in others
        for result in sorted(columns, key=lambda result: size(result) % joints != 0):
            if size(result) >= joints:
                self._pair(self._of_results(columns[result], self._next_elements(result, columns[result])))
        self._pair_recursions()

    def _of_results(self, column: dict[int, int], following: dict[int, int]) -> list[tuple[int, int]]:
        """Return the pairs of operations of a result."""
        pairs = [
            (operation, column[following[element]])
            for element, operation in sorted(column.items(), reverse=True)
            if following.get(element) in column and self._deep[operation] == self._deep[column[following[element]]]
        ]
        pairs = [pair for pair in pairs if not self._is_further_apart(pair)]
        middle = len(pairs) // 2
        risen = Counter[int]()
        for argument, one, other in self._inputs_below(pairs[middle : middle + 20], _LOOK):
            risen[argument] += int(np.sign(other - one))
        return pairs if sum(map(np.sign, risen.values())) >= 0 else [(b, a) for a, b in pairs]

    def _is_further_apart(self, pair: tuple[int, int]) -> bool:
        """Whether what is just below two operations is that of joints that are not a period apart."""
        return any(
            abs(other - one) != self._period
            for argument, one, other in self._inputs_below([pair], _GLANCE)
            if self._by_joint[argument]
        )

    def _next_elements(self, result: int, column: dict[int, int]) -> dict[int, int]:
        """Return element of a result to that of the next joint."""
        function, size, joints = self._trace.function, self._trace.function.numel_out(result), self._joints
        if size % joints == 0:
            by_vector = {e: e + self._period for e in range(size) if e % joints + self._period < joints}
            each = size // joints * self._period
            by_joint = {e: e + each for e in range(size - each)}
            return max(by_vector, by_joint, key=lambda following: self._alike_in(column, following))
        same = [a for a in self._steps if function.numel_in(a) == size]  # as derivatives by the parameters are laid out
        if same:
            return self._steps[same[0]]
        away = self._distance(column, size, self._period * size / joints)
        return {e: e + away for e in range(size - away)}

    def _alike_in(self, column: dict[int, int], following: dict[int, int]) -> int:
        """Return how many elements of a result are alike with the following ones."""
        return sum(self._deep[column[e]] == self._deep[column[f]] for e, f in following.items())

    def _distance(self, column: dict[int, int], size: int, about: float) -> int:
        """Return the number of elements after which the operations of a result repeat."""
        digests = np.zeros(size, dtype=np.int64)
        digests[list(column)] = [self._deep[operation] for operation in column.values()]
        tried = range(max(1, int(0.75 * about)), min(size // 2, int(1.35 * about)) + 1)
        score = {k: np.count_nonzero((digests[k:] == digests[:-k]) & (digests[k:] != 0)) for k in tried}
        return min((k for k in tried if score[k] >= 0.95 * max(score.values())), default=1)

    def _inputs_below(self, waiting: Iterable[tuple[int, int]], limit: int) -> Iterator[tuple[int, int, int]]:
        """Yield pairs of inputs below pairs of operations, the nearest first: argument and both elements."""
        operations, operands, given = self._trace.operations, self._trace.operands, self._trace.given
        waiting = deque(waiting)
        seen: set[tuple[int, int]] = set()
        while waiting and len(seen) < limit:
            a, b = pair = waiting.popleft()
            if a == b or pair in seen or operations[a] != operations[b]:
                continue
            seen.add(pair)
            one, other = given[a], given[b]
            if one is None:
                waiting.extend(zip(operands[a], operands[b], strict=True))
            elif isinstance(one, tuple) and isinstance(other, tuple) and one[0] == other[0]:
                yield one[0], one[1], other[1]

    def _away(self, a: int, b: int) -> int:
        """Joints from the nearest number of a joint below an operation to its counterpart below another; 0: none."""
        if a > b:
            return -self._away(b, a)
        known = self._trace.away
        if (a, b) not in known:
            below = self._inputs_below([(a, b)], _LOOK)
            known[a, b] = next((other - one for argument, one, other in below if self._by_joint[argument]), 0)
        return known[a, b]

    def _pair_recursions(self) -> None:
        """Pair operations that are in no pair with those before them that have the same below, one joint earlier."""
        trace = self._trace
        failed = 0
        by_digest: dict[int, list[int]] = defaultdict(list)
        for k, digest in enumerate(self._deep):
            if not trace.is_leaf(k):
                by_digest[digest].append(k)
        least = self._joints // self._period // 2  # which a recursion over all joints has in its middle
        rank = {k: i for listed in by_digest.values() for i, k in enumerate(listed)}
        for b in reversed(range(len(trace.operations))):
            if (b in self._taken and b in self.after) or b not in rank:
                continue
            listed, i = by_digest[self._deep[b]], rank[b]
            if len(listed) < least:
                continue
            if failed > _FAILED:
                break
            failed += 1
            for a in reversed(listed[max(0, i - _TRIED) : i]):
                free = [pair for pair in ((a, b), (b, a)) if pair[0] not in self.after and pair[1] not in self._taken]
                found = next(filter(self._is_a_joint_apart, free), None)
                if found is not None:
                    self._pair([found])
                    failed = 0
                    break

    def _is_a_joint_apart(self, pair: tuple[int, int]) -> bool:
        """Whether what is below the second of two operations is that of the next joint."""
        if self._away(*pair) != self._period:
            return False
        for argument, one, other in self._inputs_below([pair], _LOOK):
            known = one + self._period if self._by_joint[argument] else self._steps[argument].get(one)
            if known is not None and known != other:
                return False
        return True

    def _pair(self, waiting: list[tuple[int, int]]) -> None:
        """Go down from pairs of operations to those of their operands."""
        trace, alike = self._trace, self._alike
        while waiting:
            a, b = waiting.pop()
            if a == b or alike[a] != alike[b] or a in self.after or b in self._taken:
                continue
            one, other = trace.given[a], trace.given[b]
            if one is not None:
                if isinstance(one, tuple) and isinstance(other, tuple):
                    self._steps[one[0]].setdefault(one[1], other[1])
                continue
            self.after[a] = b
            self._taken.add(b)
            waiting.extend(zip(trace.operands[a], trace.operands[b], strict=True))
