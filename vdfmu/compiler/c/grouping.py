"""Operations of a trace as few lines of C: calls of an elementary function side by side, and expressions.

``elementary.h`` evaluates four calls in the time of one. In the trace of an arm the calls of each joint follow each
other. Operations that do not depend on each other change places, so that calls of a function meet. An operation that
only one other reads becomes a part of its expression, which is compiled in four fifths of the time. The values are
bit-identical.
"""

from __future__ import annotations

import re
from collections import Counter, defaultdict
from collections.abc import Sequence
from typing import NamedTuple

LANES = 4
"""Numbers per call, as in ``elementary.h``."""
_MANY = 16
"""From this number on calls are made in a loop, because each copy of a function takes 1 kB."""
_LONGEST = 300
"""Most characters of an expression that becomes a part of another: compilers limit how deep they nest."""
_CALL = re.compile(r"\$\d+\$ = (exp|expm1|tanh|atan|sin|cos)\(\$\d+\$\);")
_VALUE = re.compile(r"\$(\d+)\$")
_ASSIGNMENT = re.compile(r"\$\d+\$ = ([^;]+);")


class Operation(NamedTuple):
    """A line of code: its text, the values that it reads, as often as it names them, and writes, and its arguments.

    A value is a number between dollar signs. One operation writes it.
    """

    text: str
    reads: tuple[int, ...] = ()
    writes: tuple[int, ...] = ()
    arguments: tuple[str, ...] = ()


def short_lines(operations: list[Operation], *, group: bool = True) -> list[Operation]:
    """Return the same operations in fewer lines. Without `group`, calls of functions stay where they are."""
    return _nested(_grouped(operations) if group else operations)


def _grouped(single: list[Operation]) -> list[Operation]:
    """Return operations with calls of the same function grouped, or the same list if no calls match."""
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
        return single
    ordered: list[Operation] = []
    left = dict.fromkeys(range(len(single)))
    for (_, name), operands in sorted(groups.items()):
        needed: set[int] = set()
        missing = [makers[i] for i in operands]
        while missing:
            if (k := missing.pop()) in left and k not in needed:
                needed.add(k)
                missing += [makers[i] for i in single[k].reads]
        ordered += [single[k] for k in sorted(needed)]
        items = list(operands.items())
        length = len(items) if len(items) >= _MANY else LANES
        for i in range(0, len(items), length):
            ordered.append(
                _call(name, [(operand, [single[k] for k in each]) for operand, each in items[i : i + length]])
            )
        for k in (*needed, *(k for each in operands.values() for k in each)):
            del left[k]
    return [*ordered, *(single[k] for k in left)]


def _call(name: str, calls: Sequence[tuple[int, list[Operation]]]) -> Operation:
    """Return the operation for calls, given by operand and its calls, two for sin and cos."""
    names = ("v0", "v1") if name == "sin_cos" else ("v0",)  # no argument of a function has this name
    writes: list[int] = []
    taken: list[str] = []
    for j, (_, operations) in enumerate(calls):
        for operation in operations:
            writes += operation.writes
            taken.append(f"${operation.writes[0]}$ = {'v1' if ' = cos(' in operation.text else 'v0'}[{j}];")
    reads = tuple(operand for operand, _ in calls)
    values = ", ".join(f"${i}$" for i in reads)
    room = -(-len(calls) // LANES) * LANES
    declared = f"double v0[{room}] = {{{values}}}{f', v1[{room}]' if len(names) > 1 else ''};"
    text = f"{{ {declared} each_{name}({', '.join(names)}, {len(calls)}); {' '.join(taken)} }}"
    return Operation(text, reads, tuple(writes))


def _nested(operations: list[Operation]) -> list[Operation]:
    """Return operations with values that are read once, elements of arguments and numbers in place of their names.

    A number keeps its name where a function reads it: those of vectors take no numbers (``fmu_src/batch/lanes.h``).
    """
    uses = Counter(i for operation in operations for i in operation.reads)
    called = {i for operation in operations if "(" in operation.text for i in operation.reads}
    parts: dict[int, tuple[str, Operation]] = {}
    made: list[Operation] = []
    for text, reads, writes, names in operations:
        is_leaf = not reads
        for i in {*reads} & parts.keys():
            part, inner = parts[i]
            text = text.replace(f"${i}$", part)
            reads = tuple(k for k in reads if k != i) + inner.reads
            names += inner.arguments
        operation = Operation(text, reads, writes, names)
        assigned = _ASSIGNMENT.fullmatch(text)
        if assigned and (
            names or writes[0] not in called if is_leaf else uses[writes[0]] == 1 and len(text) < _LONGEST
        ):
            part = assigned[1] if is_leaf and assigned[1][0] != "-" else f"({assigned[1]})"
            parts[writes[0]] = part, operation
        else:
            made.append(operation)
    return made


def in_few_places(operations: Sequence[Operation]) -> tuple[list[str], int]:
    """Return texts with names ``w0``, ``w1``, .. of values, and their number.

    Values that are not needed at the same time have the same name.
    """
    last = {i: k for k, operation in enumerate(operations) for i in (*operation.writes, *operation.reads)}
    places: dict[int, int] = {}
    free: list[int] = []
    count = 0
    for k, operation in enumerate(operations):
        free += [places[i] for i in dict.fromkeys(operation.reads) if last[i] == k]
        for i in operation.writes:
            if not free:
                free.append(count)
                count += 1
            places[i] = free.pop()
        free += [places[i] for i in operation.writes if last[i] == k]
    texts = _VALUE.sub(lambda m: f"w{places[int(m[1])]}", "\n".join(operation.text for operation in operations))
    return texts.splitlines(), count
