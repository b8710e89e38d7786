"""The operations of a trace, and their counterparts from one joint to the next.

Pairs of results a joint apart lead, operand by operand, to pairs of operations that do the same. A recursion may end in
no such result, as the pose of the last link or a sum over the joints. Then the operands below its operations decide.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Container, Iterable, Iterator, Sequence
from math import inf

import casadi as ca
import numpy as np

from vdfmu.compiler.functions.derivatives import instructions

_DEPTH = 4
"""Depth of operands that must be alike before two operations are tried as a pair."""
_TRIED = 3
"""Candidates for the counterpart of an operation in a recursion."""
_FAILED = 200
"""Operations of recursions in a row without a counterpart that end the search."""
_GLANCE = 20
"""Pairs of operands below two elements of a result that are compared."""

Pair = tuple[int, int]
"""An operation and its possible counterpart."""


class Trace:
    """The operations of a function without their shared memory: each has a separate value."""

    def __init__(self, function: ca.Function) -> None:
        self.function = function
        self.operations: list[int] = []
        """Codes of CasADi."""
        self.operands: list[tuple[int, ...]] = []
        """Operations that each operation reads."""
        self.leaves: list[tuple[int, int] | float | None] = []
        """Argument and element of an input, value of a constant, else None."""
        self.results: list[tuple[int, int, int]] = []
        """Result, element and operation. An input or a constant is copied by an operation."""
        self.away: dict[Pair, int] = {}
        """Distances that :class:`Counterparts` of any period have found."""
        self.apart: set[Pair] = set()
        """Pairs for which the search ended without inputs by joint."""
        self._digests: list[list[int]] = []  # by depth
        held: dict[int, int] = {}  # place in CasADi's memory to the operation of its value
        for k, operation, source, target in instructions(function):
            if operation == ca.OP_OUTPUT:
                made = held[source[0]]
                if self.is_leaf(made):
                    made = self._append(ca.OP_ASSIGN, (made,))
                self.results.append((target[0], target[1], made))
                continue
            read: tuple[int, ...] = ()
            leaf: tuple[int, int] | float | None = None
            if operation == ca.OP_CONST:
                leaf = function.instruction_constant(k)
            elif operation == ca.OP_INPUT:
                leaf = source[0], source[1]
            else:
                read = tuple([held[place] for place in source])
            held[target[0]] = self._append(operation, read, leaf)

    def _append(self, operation: int, read: tuple[int, ...], leaf: tuple[int, int] | float | None = None) -> int:
        self.operations.append(operation)
        self.operands.append(read)
        self.leaves.append(leaf)
        return len(self.operations) - 1

    def is_leaf(self, k: int) -> bool:
        """Whether an operation is an input or a constant."""
        return self.leaves[k] is not None

    def digests(self, depth: int) -> list[int]:
        """Return a number for each operation, the same for operations with alike operands down to a depth."""
        if not self._digests:
            arguments = (leaf[0] if isinstance(leaf, tuple) else -1 for leaf in self.leaves)
            self._digests.append(list(map(hash, zip(self.operations, arguments, strict=True))))
        while len(self._digests) <= depth:
            last = self._digests[-1]
            self._digests.append(
                [hash((f, *map(last.__getitem__, read))) for f, read in zip(last, self.operands, strict=True)]
            )
        return self._digests[depth]


class Counterparts:
    """Counterparts of a trace. Parameters: see :func:`~vdfmu.compiler.c.series.find_series`."""

    def __init__(self, trace: Trace, joints: int, period: int, alike: Sequence[int]) -> None:
        self._trace, self._joints, self._period, self._alike = trace, joints, period, alike
        self._deep = trace.digests(_DEPTH)
        function = trace.function
        self._by_joint = [function.numel_in(k) % joints == 0 for k in range(function.n_in())]
        self._taken: set[int] = set()
        self._steps: dict[int, dict[int, int]] = defaultdict(dict)
        """Argument to element to the element of the next joint."""
        self.after: dict[int, int] = {}
        """Operation to its counterpart at the next joint."""
        columns: dict[int, dict[int, int]] = defaultdict(dict)
        for result, element, operation in trace.results:
            columns[result][element] = operation
        size = function.numel_out
        # vectors with the same number of elements for each joint come first: they show the steps of other vectors
        for result in sorted(columns, key=lambda result: size(result) % joints != 0):
            if size(result) >= joints:
                self._pair(self._of_results(columns[result], self._next_elements(result, columns[result])))
        self._pair_recursions()

    def _of_results(self, column: dict[int, int], following: dict[int, int]) -> list[Pair]:
        """Return the pairs of operations of a result."""
        pairs = [
            (operation, column[following[element]])
            for element, operation in sorted(column.items(), reverse=True)
            if following.get(element) in column and self._deep[operation] == self._deep[column[following[element]]]
        ]
        pairs = [pair for pair in pairs if not self._is_further_apart(pair)]
        middle = len(pairs) // 2
        risen = Counter[int]()
        for argument, first, second in self._inputs_below(pairs[middle : middle + 20], 20 * _GLANCE):
            risen[argument] += int(np.sign(second - first))
        return pairs if sum(map(np.sign, risen.values())) >= 0 else [(b, a) for a, b in pairs]

    def _is_further_apart(self, pair: Pair) -> bool:
        """Whether inputs just below two operations belong to joints that are not a period apart."""
        return any(
            abs(second - first) != self._period
            for argument, first, second in self._inputs_below([pair], _GLANCE)
            if self._by_joint[argument]
        )

    def _next_elements(self, result: int, column: dict[int, int]) -> dict[int, int]:
        """Return element of a result to the element of the next joint."""
        function, size, joints = self._trace.function, self._trace.function.numel_out(result), self._joints
        if size % joints == 0:
            by_vector = {e: e + self._period for e in range(size) if e % joints + self._period < joints}
            each = size // joints * self._period
            by_joint = {e: e + each for e in range(size - each)}
            return max(
                by_vector, by_joint,
                key=lambda following: sum(self._deep[column[e]] == self._deep[column[f]] for e, f in following.items()),
            )  # fmt: skip
        same = [a for a in self._steps if function.numel_in(a) == size]  # layout of derivatives by the parameters
        if same:
            return self._steps[same[0]]
        away = self._distance(column, size, self._period * size / joints)
        return {e: e + away for e in range(size - away)}

    def _distance(self, column: dict[int, int], size: int, about: float) -> int:
        """Return the period of the operations of a result, in elements."""
        digests = np.zeros(size, dtype=np.int64)
        digests[list(column)] = [self._deep[operation] for operation in column.values()]
        tried = range(max(1, int(0.75 * about)), min(size // 2, int(1.35 * about)) + 1)
        score = {k: np.count_nonzero((digests[k:] == digests[:-k]) & (digests[k:] != 0)) for k in tried}
        return min((k for k in tried if score[k] >= 0.95 * max(score.values())), default=1)

    def _inputs_below(
        self, pairs: Iterable[Pair], limit: float = inf, passed: Container[Pair] = (), seen: set[Pair] | None = None
    ) -> Iterator[tuple[int, int, int]]:
        """Yield the argument and both elements of pairs of inputs below pairs of operations, the nearest first.

        The search passes over some pairs, puts the others in `seen`, and ends after `limit` of them.
        """
        operations, operands, leaves = self._trace.operations, self._trace.operands, self._trace.leaves
        seen = set() if seen is None else seen
        waiting = list(pairs)
        for pair in waiting:  # it grows meanwhile
            a, b = pair
            if a == b or pair in seen or operations[a] != operations[b] or pair in passed:
                continue
            if len(seen) >= limit:
                return
            seen.add(pair)
            first, second = leaves[a], leaves[b]
            if first is None:
                waiting.extend(zip(operands[a], operands[b], strict=True))
            elif isinstance(first, tuple) and isinstance(second, tuple) and first[0] == second[0]:
                yield first[0], first[1], second[1]

    def _away(self, a: int, b: int) -> int:
        """Return the joints between the nearest inputs below two operations; 0 without inputs by joint."""
        away, apart = self._trace.away, self._trace.apart
        if (a, b) not in away:
            seen: set[Pair] = set()
            below = self._inputs_below([(a, b)], passed=apart, seen=seen)
            away[a, b] = next((second - first for argument, first, second in below if self._by_joint[argument]), 0)
            if not away[a, b]:
                apart |= seen
        return away[a, b]

    def _pair_recursions(self) -> None:
        """Pair the remaining operations with earlier operations whose inputs belong to the joint before."""
        trace = self._trace
        failed = 0
        by_digest: dict[int, list[int]] = defaultdict(list)
        for k, digest in enumerate(self._deep):
            if not trace.is_leaf(k):
                by_digest[digest].append(k)
        least = self._joints // self._period // 2  # a recursion over all joints has as many in its middle
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
                joints = self._away(a, b)
                first, second = pair = (a, b) if joints > 0 else (b, a)
                is_free = first not in self.after and second not in self._taken
                if abs(joints) == self._period and is_free and self._is_a_joint_apart(pair):
                    self._pair([pair])
                    failed = 0
                    break

    def _is_a_joint_apart(self, pair: Pair) -> bool:
        """Whether the inputs below the second of two operations, down to counterparts, belong to the next joint."""
        for argument, first, second in self._inputs_below([pair], passed=self.after.items()):
            expected = first + self._period if self._by_joint[argument] else self._steps[argument].get(first)
            if expected not in (None, second):
                return False
        return True

    def _pair(self, waiting: list[Pair]) -> None:
        """Pair operations, and down from them their operands."""
        trace, alike = self._trace, self._alike
        while waiting:
            a, b = waiting.pop()
            if a == b or alike[a] != alike[b] or a in self.after or b in self._taken:
                continue
            first, second = trace.leaves[a], trace.leaves[b]
            if first is not None:
                if isinstance(first, tuple) and isinstance(second, tuple):
                    self._steps[first[0]].setdefault(first[1], second[1])
                continue
            self.after[a] = b
            self._taken.add(b)
            waiting.extend(zip(trace.operands[a], trace.operands[b], strict=True))
