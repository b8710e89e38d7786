"""Dependencies of calculated variables on inputs, parameters and states: structural nonzeros of traced Jacobians."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Any

import casadi as ca
import numpy as np
import numpy.typing as npt

from vdfmu.compiler.unit.base import BaseUnit
from vdfmu.compiler.unit.declaration import Sampled
from vdfmu.compiler.unit.trace import Call

Pattern = npt.NDArray[np.bool_]
"""(N, N): row `i` marks the positions on which position `i` depends."""
Rows = Sequence[npt.NDArray[np.bool_]] | Pattern


def patterns(interface: Any) -> tuple[Rows, Rows, Rows]:
    """Return three patterns over the whole memory of an `Interface`: variables, derivatives of the states, time.

    The first holds for outputs and derivatives after initialization: inputs, continuous states and time. A continuous
    state depends on itself. A sampled state depends on all that its unit reads for a sample, unless it is delayed.
    The second holds during initialization: inputs, parameters and time. The third is like the first from one sample to
    the next, while sampled states are held. A Python unit may depend on everything, except for states that start at
    parameters.
    """
    return _long(interface) or _traced(interface)


def _long(interface: Any) -> tuple[Rows, Rows, Rows] | None:
    """Return patterns extended from a shorter machine; None if this fails for a second shorter machine."""
    if not interface.shorter:
        return None
    short, check, *_ = interface.shorter
    period = check.joints - short.joints
    try:
        for expected, pattern in zip(check.patterns, short.patterns, strict=True):
            extended = LongPattern(check, short, pattern, period)
            if any((extended[row] != expected[row]).any() for row in range(check.size)):
                return None
        step, start, between = (LongPattern(interface, short, pattern, period) for pattern in short.patterns)
    except LookupError:  # of a variable that the short machine does not have
        return None
    return step, start, between


def _traced(interface: Any) -> tuple[Pattern, Pattern, Pattern]:
    if interface.unit.backend == "python":
        between = np.ones((interface.size, interface.size), dtype=bool)
        states = np.array([v.variability == "discrete" for v in interface.memory])
        states[interface.states] = True
        between[states] = np.eye(interface.size, dtype=bool)[states]
        start = np.ones_like(between)
        if interface.unit.start is BaseUnit.start:  # which reads parameters
            start[states] = [v.causality == "parameter" for v in interface.memory]
        read = np.ones(interface.size, dtype=bool)
    else:
        program = interface.program
        moving = (*program.outputs, *program.derivatives)
        between, start = _after(interface, moving), _after(interface, (*program.start, *moving))
        read = _after(interface, program.update)[interface.sampled].any(axis=0)
    step = between.copy()
    outputs = [i for i, v in enumerate(interface.memory) if v.causality == "output"]
    for name, declared in interface.unit.declared.items():
        if isinstance(declared, Sampled) and not declared.delayed and name in interface.groups:
            step[outputs] |= between[outputs, interface.groups[name]].any(axis=1, keepdims=True) & read
    # clear the rows of variables that are set, and the columns of unknowns; sampled states are not knowns of FMI
    causality = np.array([v.causality for v in interface.memory])
    of_state = np.zeros(interface.size, dtype=bool)
    of_state[interface.states] = True
    time = causality == "independent"
    inputs, settable = causality == "input", np.isin(causality, ("input", "parameter"))
    calculated = np.isin(causality, ("output", "local"))
    moving = inputs | of_state | time
    for pattern, knowns in ((step, moving), (start, settable | time), (between, moving)):
        pattern[~calculated] = False
        pattern[:, ~knowns] = False
    return step, start, between


class LongPattern(Sequence[npt.NDArray[np.bool_]]):
    """The pattern of a long machine by the `pattern` of a `shorter`, calculated row by row on demand.

    Two joints of the long machine depend on each other as two joints of the short machine with the same distances from
    both ends and from each other, if a distance is small. A large distance shrinks by multiples of `period`, the
    number of joints after which both machines repeat.
    """

    def __init__(self, interface: Any, shorter: Any, pattern: Pattern, period: int) -> None:
        self._pattern, self._period = pattern, period
        self._n, self._m = interface.joints, shorter.joints
        self._near = (self._m - 1) // 3 - period + 1
        names, self._joint = _places(interface, shorter)
        short_names, short_joints = _places(shorter, interface)
        kinds = {name: k for k, name in enumerate(dict.fromkeys(short_names))}
        self._kind = np.array([kinds[name] for name in names])
        self._at = np.full((len(kinds), self._m), len(short_names), np.intp)  # out of range of all patterns
        for position, (name, joint) in enumerate(zip(short_names, short_joints, strict=True)):
            self._at[kinds[name], joint if joint >= 0 else slice(None)] = position

    def __len__(self) -> int:
        return len(self._joint)

    def __getitem__(self, position: Any) -> Any:
        """Row of a position."""
        joint = self._joint[position]
        columns = np.append(np.arange(self._n), max(joint, 0))  # the last is for joint -1
        joint = columns if joint < 0 else joint
        low, high = np.minimum(joint, columns), np.maximum(joint, columns)
        left = self._n - self._m
        gaps: list[Any] = []
        for gap in (low, high - low, self._n - 1 - high):  # shrink large gaps until the length is right
            out = np.minimum(np.maximum(gap - self._near, 0) // self._period * self._period, left)
            gaps.append(gap - out)
            left = left - out
        first, second = gaps[0], gaps[0] + gaps[1]
        here, there = np.where(joint <= columns, (first, second), (second, first))
        rows = self._at[self._kind[position], here]
        return self._pattern[rows[self._joint], self._at[self._kind, there[self._joint]]]


def _places(interface: Any, other: Any) -> tuple[list[tuple[Any, ...]], npt.NDArray[np.intp]]:
    """Return the name of each position without the joint, and its joint; -1 for groups of one size in both."""
    sizes, other_sizes = (Counter(v.group for v in each.memory) for each in (interface, other))
    grows = [sizes[v.group] != other_sizes[v.group] for v in interface.memory]
    both = list(zip(interface.memory, grows, strict=True))
    return [(v.group, v.index[g:]) for v, g in both], np.array([v.index[0] if g else -1 for v, g in both])


def _after(interface: Any, calls: Sequence[Call]) -> Pattern:
    """Return the pattern of positions after the calls on positions before them."""
    pattern = np.eye(interface.size, dtype=bool)
    chosen = np.zeros(interface.size, dtype=bool)  # written by an earlier choice
    differs = _differs(interface, calls)
    for call in calls:
        direct, rows = _of_call(interface, call)
        packed = np.packbits(pattern, axis=1)
        joined = np.array([np.bitwise_or.reduce(packed[row]) for row in direct[rows]], np.uint8)
        through = np.unpackbits(joined.reshape(-1, packed.shape[1]), axis=1, count=interface.size).astype(bool)
        for parameter, _ in call.when:
            through[through.any(axis=1) & differs[rows], interface.reference[parameter]] = True
        if call.when:
            through |= pattern[rows] & chosen[rows, None]
            chosen |= rows
        pattern[rows] = through
    return pattern


def _differs(interface: Any, calls: Sequence[Call]) -> npt.NDArray[np.bool_]:
    """Return a mask: False for positions that all choices set to the same value."""
    memory = ca.SX.sym("memory", interface.size)
    results: dict[int, list[ca.SX]] = {}
    for call in calls:
        if not call.when:
            continue
        function = interface.functions.casadi_function(call.function)
        arguments = {name: memory[interface.arguments[call.group(name)]] for name in function.name_in()}
        for name, value in function(**arguments).items():
            for row, position in enumerate(_positions(interface.arguments[call.group(name)])):
                results.setdefault(position, []).append(value[row])
    differs = np.ones(interface.size, dtype=bool)
    for position, values in results.items():
        differs[position] = not all(ca.is_equal(values[0], value) for value in values)
    return differs


def _of_call(interface: Any, call: Call) -> tuple[Pattern, npt.NDArray[np.bool_]]:
    """Return the pattern of the results of one call, and a mask of its results."""
    pattern = np.zeros((interface.size, interface.size), dtype=bool)
    rows = np.zeros(interface.size, dtype=bool)
    function = interface.functions.casadi_function(call.function)
    for result in function.name_out():
        set_here = _positions(interface.arguments[call.group(result)])
        rows[set_here] = True
        for argument in function.name_in():
            columns = _positions(interface.arguments[call.group(argument)])
            sparsity = function.jac_sparsity(function.index_out(result), function.index_in(argument))
            i, j = (np.array(index, np.intp) for index in sparsity.get_triplet())
            pattern[set_here[i], columns[j]] = True
    return pattern, rows


def _positions(where: slice) -> npt.NDArray[np.intp]:
    return np.arange(where.start, where.stop)
