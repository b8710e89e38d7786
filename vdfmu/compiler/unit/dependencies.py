"""Dependencies of calculated variables on inputs, parameters and states: structural nonzeros of traced Jacobians."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca
import numpy as np
import numpy.typing as npt

from vdfmu.compiler.unit.base import BaseUnit
from vdfmu.compiler.unit.declaration import Sampled
from vdfmu.compiler.unit.trace import Call

Pattern = npt.NDArray[np.bool_]
"""Pattern (N, N), in which row `i` marks the positions on which position `i` depends."""


def patterns(interface: Any) -> tuple[Pattern, Pattern, Pattern]:
    """Return three patterns over the memory of an `Interface`: variables, derivatives of the states, and the time.

    The first holds for outputs and derivatives after initialization: inputs, continuous states and time. A continuous
    state depends on itself. A sampled state depends on everything that its unit reads for a sample, unless it is
    delayed. The second holds during initialization: inputs, parameters and time. The third is like the first from one
    sample to the next, while sampled states are held. A Python unit may depend on everything, except for states that
    start at parameters.
    """
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
    # clear the rows of variables that are set, and the columns of unknowns; sampled states are not FMI knowns
    causality = np.array([v.causality for v in interface.memory])
    of_state = np.zeros(interface.size, dtype=bool)
    of_state[interface.states] = True
    time = causality == "independent"
    inputs, settable = causality == "input", np.isin(causality, ("input", "parameter"))
    calculated = np.isin(causality, ("output", "local"))
    moving = inputs | of_state | time
    for pattern, knowns in ((step, moving), (start, settable | time), (between, moving)):
        pattern &= calculated[:, None] & knowns
    return step, start, between


def _after(interface: Any, calls: Sequence[Call]) -> Pattern:
    """Return the pattern by which positions after the calls depend on positions before them."""
    pattern = np.eye(interface.size, dtype=bool)
    written = np.zeros(interface.size, dtype=bool)  # from an earlier call; other rows are those of the identity
    chosen = written.copy()  # from an earlier choice
    differs = _differs(interface, calls)
    for call in calls:
        direct, rows = _of_call(interface, call)
        through = direct[rows]
        packed = np.packbits(pattern[written], axis=1)
        joined = np.array([np.bitwise_or.reduce(packed[row]) for row in through[:, written]], np.uint8)
        through[:, written] = False
        through |= np.unpackbits(joined.reshape(-1, packed.shape[1]), axis=1, count=interface.size).astype(bool)
        for parameter, _ in call.when:
            through[through.any(axis=1) & differs[rows], interface.reference[parameter]] = True
        if call.when:
            through |= pattern[rows] & chosen[rows, None]
            chosen |= rows
        pattern[rows] = through
        written |= rows
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
    """Return the pattern of one call's results, and a mask of its results."""
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
