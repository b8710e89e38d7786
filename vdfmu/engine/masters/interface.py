"""The interface Jacobian of a loop, from the directional derivatives of its components."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from vdfmu.base.arrays import Floats
from vdfmu.engine.fmu.instance import Instance
from vdfmu.engine.fmu.variables import FmuVariable
from vdfmu.engine.masters.coupled import Block, Coupled, CoupledUnit


def interface_inverse(block: Block, coupled: Coupled, h: float) -> Floats | None:
    """Return the inverse of the derivative of a loop's residual by the guess: see `Broyden`.

    Each component is taken as x' = A x + B u, y = C x + D u, with the matrices at the start of a step of `h` [s]. None
    if one of them gives no directional derivatives, or if no inverse exists.
    """
    if not all(unit.instance.description.derives_unknowns for unit in block.units):
        return None
    passes = [_sensitivity(unit, coupled, h) for unit in block.units]
    residual = np.empty((block.torn.size, block.torn.size))
    for column, torn in enumerate(block.torn):
        changes = np.zeros(coupled.outputs.size)
        changes[torn] = 1.0
        for each in passes:
            each(changes)
        residual[:, column] = changes[block.torn]
    residual -= np.eye(block.torn.size)
    try:
        inverse: Any = np.linalg.inv(residual)
    except np.linalg.LinAlgError:
        return None
    return inverse if np.isfinite(inverse).all() else None


def _sensitivity(unit: CoupledUnit, coupled: Coupled, h: float) -> Callable[[Floats], None]:
    """Return the function that brings changes of outputs at the end of a step through a component."""
    instance, bank = unit.instance, coupled.bank
    outputs = coupled.read_of(instance.name)
    own = bank.links[bank.input_windows[instance.name]]
    moving = [i for i, k in enumerate(own) if not k.discrete]
    links = [own[i] for i in moving]
    sources = [bank.position[k.start] for k in links]
    factors = np.array([k.conversion.factor for k in links])
    jacobian = jacobian_of(instance, [k.sink for k in links], [bank.variables[i][1] for i in outputs])()
    m = len(links)
    n = jacobian.shape[1] - m
    motion = np.zeros((n + 2 * m, n + 2 * m))  # x' = A x + B u, u' = w, w' = 0
    motion[:n, : n + m] = jacobian[:n]
    motion[n : n + m, n + m :] = np.eye(m)
    from scipy.linalg import expm  # takes long to import

    part = expm(h / len(unit.parts) * motion)
    state = np.zeros((n + 2 * m, m))
    for hold, _ in unit.parts:
        state[n : n + m] = np.diag(hold[moving])
        state[n + m :] = np.diag(1.0 - hold[moving]) / h if unit.runs else 0.0
        state = part @ state
    gain = jacobian[n:] @ state[: n + m]

    def through(changes: Floats) -> None:
        changes[outputs] = gain @ (factors * changes[sources])

    return through


def jacobian_of(
    instance: Instance, inputs: Sequence[FmuVariable], outputs: Sequence[FmuVariable], some: Sequence[int] | None = None
) -> Callable[[], Floats]:
    """Return the function for the derivatives of the declared states' rates and of outputs, by states and by inputs.

    From the directional derivatives of the component where it is then: [[A, B], [C, D]]. With `some`, the places of
    inputs, the derivatives by the others are left 0.
    """
    states = instance.description.states
    n = sum(length for *_, length in states)
    # each array with all of its elements, as its directional derivatives are
    begins: list[tuple[int, int]] = [(x, length) for x, _, length in states]
    begins += dict.fromkeys((v.reference, v.length) for v in inputs)
    finals = [(rate, length) for _, rate, length in states]
    finals += dict.fromkeys((v.reference, v.length) for v in outputs)

    def places(wanted: Sequence[FmuVariable], among: list[tuple[int, int]]) -> list[int]:
        elements = [(reference, i) for reference, length in among for i in range(length)]
        at = {element: i for i, element in reversed(list(enumerate(elements)))}
        return [*range(n), *(n + at[v.reference, v.index] for v in wanted)]

    size = sum(length for _, length in finals)
    knowns = [reference for reference, _ in begins]
    unknowns = [reference for reference, _ in finals]
    rows, columns = places(outputs, finals[len(states) :]), places(inputs, begins[len(states) :])
    chosen = [*range(n), *(n + i for i in (range(len(inputs)) if some is None else some))]
    seeds = np.eye(sum(length for _, length in begins))[[columns[i] for i in chosen]]
    all_at_once = np.random.default_rng(0).uniform(1.0, 2.0, (1, len(chosen))) @ seeds

    def calculate() -> Floats:
        jacobian = np.zeros((len(rows), len(columns)))
        # one direction tells whether any matters: a mode of a component may read none of its inputs
        if instance.differentiate(unknowns, size, knowns, all_at_once).any():
            jacobian[:, chosen] = instance.differentiate(unknowns, size, knowns, seeds).T[rows]
        return jacobian

    return calculate
