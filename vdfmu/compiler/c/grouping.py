"""Groups calls of an elementary function, because ``elementary.h`` evaluates four in the time of one.

In the trace of an arm the joints come one after the other. Independent operations are reordered so that calls of the
same function become neighbours. The values are bit-identical.
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Sequence
from typing import NamedTuple

LANES = 4
"""Numbers per call, as in ``elementary.h``."""
_MANY = 16
"""From this number on calls are made in a loop, because each copy of a function takes 1 kB."""
_CALL = re.compile(r"w\d+ = (exp|expm1|tanh|atan|sin|cos)\(w\d+\);")
_VALUE = re.compile(r"\bw(\d+)\b( = )?")
"""A value, and whether the text writes it."""


class Operation(NamedTuple):
    """A line of code: its text, the values ``w`` that it reads and writes, and its arguments."""

    text: str
    reads: tuple[int, ...] = ()
    writes: tuple[int, ...] = ()
    arguments: tuple[str, ...] = ()


def grouped(operations: list[Operation]) -> list[Operation]:
    """Return operations with calls of the same function grouped, or the same list if no calls match."""
    single = _written_once(operations)
    makers = {i: k for k, operation in enumerate(single) for i in operation.writes}
    calls = [_CALL.fullmatch(operation.text) for operation in single]
    levels: list[int] = []  # number of calls before it on the longest path
    groups: defaultdict[tuple[int, str], dict[int, list[int]]] = defaultdict(dict)  # level and name to operand to calls
    for k, (operation, call) in enumerate(zip(single, calls, strict=True)):
        before = (makers[i] for i in operation.reads)
        levels.append(max((levels[j] + (calls[j] is not None) for j in before), default=0))
        if call is not None:
            name = "sin_cos" if call[1] in ("sin", "cos") else call[1]
            groups[levels[k], name].setdefault(operation.reads[0], []).append(k)
    if all(sum(map(len, operands.values())) < 2 for operands in groups.values()):
        return operations
    ordered: list[tuple[Operation, Operation]] = []  # with values written once, and with those in its text
    left = dict.fromkeys(range(len(single)))
    for (_, name), operands in sorted(groups.items()):
        needed: set[int] = set()
        missing = [makers[i] for i in operands]
        while missing:
            if (k := missing.pop()) in left and k not in needed:
                needed.add(k)
                missing += [makers[i] for i in single[k].reads]
        ordered += [(single[k], operations[k]) for k in sorted(needed)]
        items = list(operands.items())
        length = len(items) if len(items) >= _MANY else LANES
        for i in range(0, len(items), length):
            call = _call(name, [(operand, [single[k] for k in each]) for operand, each in items[i : i + length]])
            ordered.append((call, call))
        for k in (*needed, *(k for each in operands.values() for k in each)):
            del left[k]
    return _in_few_places([*ordered, *((single[k], operations[k]) for k in left)])


def _call(name: str, calls: Sequence[tuple[int, list[Operation]]]) -> Operation:
    """Return the operation for calls, given by operand and its calls, two for sin and cos."""
    names = ("v0", "v1") if name == "sin_cos" else ("v0",)  # no argument of a function has this name
    writes: list[int] = []
    taken: list[str] = []
    for j, (_, operations) in enumerate(calls):
        for operation in operations:
            writes += operation.writes
            taken.append(f"w{operation.writes[0]} = {'v1' if ' = cos(' in operation.text else 'v0'}[{j}];")
    reads = tuple(operand for operand, _ in calls)
    values = ", ".join(f"w{i}" for i in reads)
    room = -(-len(calls) // LANES) * LANES
    declared = f"double v0[{room}] = {{{values}}}{f', v1[{room}]' if len(names) > 1 else ''};"
    text = f"{{ {declared} each_{name}({', '.join(names)}, {len(calls)}); {' '.join(taken)} }}"
    return Operation(text, reads, tuple(writes))


def _written_once(operations: list[Operation]) -> list[Operation]:
    """Return operations that write each value once; their texts are unchanged."""
    now: dict[int, int] = {}
    made: list[Operation] = []
    count = 0
    for text, reads, writes, *names in operations:
        new = range(count, count := count + len(writes))
        made.append(Operation(text, tuple([now[i] for i in reads]), tuple(new), *names))
        now.update(zip(writes, new, strict=True))
    return made


def _in_few_places(operations: list[tuple[Operation, Operation]]) -> list[Operation]:
    """Return operations in which values that are not needed at the same time share a place."""
    last = {i: k for k, (operation, _) in enumerate(operations) for i in (*operation.writes, *operation.reads)}
    places: dict[int, int] = {}
    free: list[int] = []
    made: list[Operation] = []
    count = 0
    for k, ((_, reads, writes, *names), named) in enumerate(operations):
        read = {i: places[i] for i in reads}
        free += [places.pop(i) for i in read if last[i] == k]
        new: dict[int, int] = {}
        for i in writes:
            if not free:
                free.append(count)
                count += 1
            new[i] = free.pop()
        places |= new
        free += [places.pop(i) for i in new if last[i] == k]
        at = tuple([read[i] for i in reads]), tuple([new[i] for i in writes])
        text = _renumbered(named.text, *(dict(zip(*pair, strict=True)) for pair in zip(named[1:3], at, strict=True)))
        made.append(Operation(text, *at, *names))
    return made


def _renumbered(text: str, read: dict[int, int], written: dict[int, int]) -> str:
    """Return a text with its values renumbered."""
    return _VALUE.sub(lambda m: f"w{written[int(m[1])]} = " if m[2] else f"w{read[int(m[1])]}", text)
