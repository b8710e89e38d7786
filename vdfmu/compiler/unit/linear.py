"""The linear model of a unit, by differentiation of its traced functions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from vdfmu.base.arrays import Floats
from vdfmu.base.errors import UsageError
from vdfmu.base.state_space import StateSpace
from vdfmu.compiler.unit.evaluate import Evaluation, Traced
from vdfmu.compiler.unit.trace import argument_name


def state_space(
    unit: Evaluation, inputs: Sequence[str] | None = None, outputs: Sequence[str] | None = None
) -> StateSpace:
    """Linearise a unit exactly where its memory is; UsageError if it is not traced.

    `inputs` and `outputs` are groups, whose columns and rows come one after the other; default all, the states first
    among the outputs.
    """
    table = unit.interface
    if not isinstance(unit, Traced):
        raise UsageError(f"{table.unit.__name__}: what cannot be traced has no derivatives.")
    inputs = list(table.groups_of("input")) if inputs is None else inputs
    outputs = list(table.groups_of("output")) if outputs is None else outputs
    J = _jacobian(unit, ["x", *map(argument_name, inputs)])
    places = np.arange(table.size)
    x, x_dot = places[table.states], places[table.derivatives]
    J[x, x] = 1.0  # of outputs that are states
    u, y = (np.concatenate([x[:0], *(places[table.groups[g]] for g in gs)]) for gs in (inputs, outputs))
    signals = (
        [(table.memory[i].name, table.memory[i].unit or "1", float(unit.memory[i])) for i in part] for part in (x, u, y)
    )
    found = StateSpace.of(J[np.ix_(np.concatenate([x_dot, y]), np.concatenate([x, u]))], *signals)
    still = ", ".join(dict.fromkeys(v.group for v in table.memory[table.sampled]))
    return replace(found, notes=(f"sampled states are taken as constant: {still}",)) if still else found


def _jacobian(unit: Evaluation, names: Sequence[str]) -> Floats:
    """Return the slopes of outputs and of derivatives by some arguments, (size, size) over the memory.

    Only the calls for the present values of the choices count.
    """
    table, functions = unit.interface, unit.interface.functions
    J = np.zeros((table.size, table.size))
    for call in filter(unit.takes, (*table.program.derivatives, *table.program.outputs)):
        function = functions.casadi_function(call.function)
        given = {name: unit.argument(name) for name in function.name_in()}
        product = functions.function(f"{call.function}_forward", **given)
        for name in (name for name in names if name in given):
            direction = product.args[f"d_{name}"]
            for column, i in enumerate(range(table.size)[table.arguments[name]]):
                direction[:] = 0.0
                direction[column] = 1.0
                product.run()
                for result in function.name_out():
                    J[table.arguments[result], i] = product.results[f"d_{result}"]
            direction[:] = 0.0
    return J
