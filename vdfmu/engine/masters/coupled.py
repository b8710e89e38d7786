"""The plan of a continuous coupling: units with ramped inputs, in blocks of units that depend on each other."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vdfmu.base.arrays import Floats
from vdfmu.engine.fmu.access import Call
from vdfmu.engine.fmu.instance import Instance
from vdfmu.engine.fmu.variables import FmuVariable
from vdfmu.engine.masters.exchange import Bank, Exchange
from vdfmu.engine.plan.conversion import SOURCE

Indices = NDArray[np.intp]


@dataclass
class CoupledUnit:
    """A unit: its calls, and its windows in the arrays of real inputs."""

    instance: Instance
    gathers: list[Callable[[], None]]
    parts: list[tuple[Floats, list[Call]]]
    """The equal parts of a step: the place of each input on the ramp over the whole step, and the calls. The place is 0
    for an input that ramps; other inputs are held at their value there."""
    inputs: Floats
    """Values to set before a part."""
    starts: Floats
    ends: Floats
    slopes: Floats
    runs: bool
    """Whether inputs ramp over a step instead of being held over a part of it."""
    held: Indices
    """Inputs held at their value at the start of the step."""


@dataclass
class Block:
    """Units that depend on each other, in the order of their steps, or a single unit."""

    units: list[CoupledUnit]
    torn: Indices
    """Continuous outputs that a unit of the block reads before they are computed. They are guessed."""
    stepwise: list[tuple[NDArray[Any], NDArray[Any], Indices]]
    """For each type: outputs now and at the start of the step, and which are discrete."""


class Coupled:
    """Data of a step: memory of inputs and outputs, and the units in the order of their steps."""

    def __init__(self, exchange: Exchange) -> None:
        self.exchange = exchange
        bank = self.bank = exchange.banks[0]
        self.outputs, self.inputs = bank.outputs, bank.inputs
        """The latest values of all real outputs, and the values that are set at all connected real inputs."""
        n = len(bank.links)
        self.starts, self.ends, self.slopes = np.zeros(n), np.zeros(n), np.zeros(max(n, 1))
        """Real inputs at the start and the end of the step, and their slopes."""
        variables = [v for _, v in bank.variables[: bank.outputs.size]]
        self.discrete = np.array([v.variability == "discrete" or v.kind != bank.kind for v in variables], bool)
        """Whether a real output changes at communication points only."""
        self.nominal = np.array([v.size for v in variables])
        self.begun = [each.outputs.copy() for each in exchange.banks]
        """Outputs at the start of the step, of each type."""
        self.waiting = {each.kind: np.zeros_like(each.inputs) for each in exchange.banks[1:]}
        """Inputs of the other types at the start of the step."""
        self._gathers = [each.gather(slice(0, len(each.links))) for each in exchange.banks]
        self.blocks = self._cut([self._unit(name) for name in exchange.checked.schedule.units])
        lines = {bank.position[k.start] for k in bank.links if not k.discrete and k.start[0] != SOURCE}
        self.lines = np.array(sorted(lines), np.intp)
        """Real outputs whose line from start to end a step uses."""
        direct = {bank.position[port] for port in exchange.checked.schedule.direct if port in bank.position}
        self.passing = np.isin(self.lines, list(direct))
        """Whether each of `lines` depends directly on an input."""
        self.derived = np.zeros(self.outputs.size, bool)
        """Real outputs whose unit provides their time derivatives."""
        self.rates: list[tuple[Instance, Call, Indices, Floats]] = []
        """Calls that get these derivatives, their outputs, and the memory that receives them."""
        for name, instance in exchange.instances.items():
            places = self.read_of(name)
            if instance.description.derives_outputs and places.size:
                rates = np.zeros(places.size)
                call = instance.slopes([bank.variables[i][1] for i in places], rates)
                self.rates.append((instance, call, places, rates))
                self.derived[places] = True
        self.switches: list[tuple[NDArray[Any], NDArray[Any], Indices]] = []
        """For each type: outputs, now and at the start of the step, and places of discrete ones that are read."""
        for each, before in zip(exchange.banks, self.begun, strict=True):
            read = {each.position[k.start] for k in each.links if k.discrete and k.start[0] != SOURCE}
            read -= set() if each is not bank else set(np.flatnonzero(~self.discrete))
            self.switches.append((each.outputs, before, np.array(sorted(read), np.intp)))

    def read_of(self, name: str) -> Indices:
        """Return the places of a component's real outputs in `lines`."""
        window = self.bank.output_windows[name]
        return self.lines[(self.lines >= window.start) & (self.lines < window.stop)]

    def begin(self) -> None:
        """Keep the outputs and the inputs at the start of a step."""
        for bank, before in zip(self.exchange.banks, self.begun, strict=True):
            np.copyto(before, bank.outputs)
        for bank, gather in zip(self.exchange.banks, self._gathers, strict=True):
            if gather is not None:
                gather()
                np.copyto(self.waiting.get(bank.kind, self.starts), bank.inputs)

    def undo(self) -> None:
        """Restore the outputs at the start of the step."""
        for bank, before in zip(self.exchange.banks, self.begun, strict=True):
            np.copyto(bank.outputs, before)

    def _unit(self, name: str) -> CoupledUnit:
        exchange, bank = self.exchange, self.bank
        instance, window, calls = exchange.instances[name], bank.input_windows[name], exchange.calls(name)
        moving = instance.description.interpolates_inputs
        # An input that cannot ramp is needed at the end of the step if an output depends on it directly. Any other
        # input is integrated, so it gets the middle of the ramp, which has the ramp's integral; a discrete input is
        # held.
        schedule = exchange.checked.schedule
        gathers = [self._gather_of(each, name) for each in exchange.banks]
        links = bank.links[window]
        through = [not k.discrete and not moving and k.end in schedule.through for k in links]
        # outputs computed last, from an input set within the step, do not belong to the end of the ramp
        runs = moving or (instance.description.updates_inputs and not any(through))
        middle = 0.0 if runs else 0.5
        hold = np.array([1.0 if k.discrete or end else middle for k, end in zip(links, through, strict=True)])
        if runs and links:
            first = bank.outputs.size
            variables = [v for _, v in bank.variables[first + window.start : first + window.stop]]
            ramp = instance.rate_call(variables, self.inputs[window], self.slopes[window], exchange.clock)
            calls.insert([call[-1] for call in calls].index("doStep"), ramp)
        parts = [(hold, calls)]
        if any(through) and instance.description.varies_steps:
            # The unit may also integrate such an input. Half a step with the value at the start and half with the value
            # at the end have the integral of the ramp, and the step ends with the right value.
            gets = [call for call in calls if call[-1].startswith("get")]
            first = np.array([1.0 if k.discrete else 0.0 for k in links])
            parts = [(first, calls[: len(calls) - len(gets)]), (np.ones(len(links)), calls)]
        held = [i for i, k in enumerate(links) if k.discrete and k.end not in schedule.fresh]
        return CoupledUnit(
            instance,
            [gather for gather in gathers if gather is not None],
            parts,
            self.inputs[window],
            self.starts[window],
            self.ends[window],
            self.slopes[window],
            runs,
            np.array(held, np.intp),
        )

    def _gather_of(self, bank: Bank, name: str) -> Callable[[], None] | None:
        """Return the function that updates a unit's inputs of one type, but not discrete ones and not reals."""
        window = bank.input_windows[name]
        gather = bank.gather(window)
        fresh = self.exchange.checked.schedule.fresh
        held = np.array([i for i, k in enumerate(bank.links[window]) if k.end not in fresh], np.intp)
        if gather is None or bank is self.bank or not held.size:
            return gather
        inputs, starts = bank.inputs[window], self.waiting[bank.kind][window]

        def some() -> None:
            gather()
            inputs[held] = starts[held]

        return some

    def _cut(self, units: list[CoupledUnit]) -> list[Block]:
        """Group the units of each loop into a block, with the outputs that must be guessed."""
        by_name = {unit.instance.name: unit for unit in units}
        position = self.bank.position
        blocks: list[Block] = []
        for names in self.exchange.checked.schedule.blocks:
            rank = {name: i for i, name in enumerate(names)}
            torn = {
                position[k.start]
                for k in self.bank.links
                if k.start[0] in rank and k.end[0] in rank and rank[k.start[0]] >= rank[k.end[0]] and not k.discrete
            }
            stepwise: list[tuple[NDArray[Any], NDArray[Any], Indices]] = []
            for bank, before in zip(self.exchange.banks, self.begun, strict=True):
                windows = [range(w.start, w.stop) for w in (bank.output_windows[name] for name in names)]
                places = np.array([i for w in windows for i in w], np.intp)
                chosen = places[self.discrete[places]] if bank is self.bank else places
                if chosen.size:
                    stepwise.append((bank.outputs, before, chosen))
            blocks.append(Block([by_name[name] for name in names], np.array(sorted(torn), np.intp), stepwise))
        return blocks


def interface_inverse(block: Block, coupled: Coupled, h: float) -> Floats | None:
    """Return a loop's inverse interface Jacobian, of its residual's derivative by the guess; see `Broyden`.

    A component is treated as x' = A x + B u, y = C x + D u, with its directional derivatives at the start of a step of
    `h` [s]. None if a component has no directional derivatives, or if no inverse exists.
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
    with suppress(np.linalg.LinAlgError):
        inverse: Any = np.linalg.inv(residual)
        return inverse if np.isfinite(inverse).all() else None
    return None


def _sensitivity(unit: CoupledUnit, coupled: Coupled, h: float) -> Callable[[Floats], None]:
    """Return the function that propagates changes of outputs at the end of a step through a component."""
    instance, bank = unit.instance, coupled.bank
    outputs = coupled.read_of(instance.name)
    inputs = bank.links[bank.input_windows[instance.name]]
    moving = [i for i, k in enumerate(inputs) if not k.discrete]
    links = [inputs[i] for i in moving]
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
    """Return the function that calculates [[A, B], [C, D]] of a component at its current state.

    Uses directional derivatives of the declared states' rates and of outputs, with respect to states and inputs. With
    `some`, places of inputs, derivatives with respect to other inputs stay 0.
    """
    states = instance.description.states
    n = sum(length for *_, length in states)
    # each array with all elements, like its directional derivatives
    begins: list[tuple[int, int]] = [(x, length) for x, _, length in states]
    begins += dict.fromkeys((v.reference, v.length) for v in inputs)
    finals = [(rate, length) for _, rate, length in states]
    finals += dict.fromkeys((v.reference, v.length) for v in outputs)

    def places(wanted: Sequence[FmuVariable], among: list[tuple[int, int]]) -> list[int]:
        elements = [(reference, i) for reference, length in among for i in range(length)]
        at = {element: i for i, element in reversed(list(enumerate(elements)))}
        return [*range(n), *(n + at[v.reference, v.index] for v in wanted)]

    size = sum(length for _, length in finals)
    knowns, unknowns = [reference for reference, _ in begins], [reference for reference, _ in finals]
    rows, columns = places(outputs, finals[len(states) :]), places(inputs, begins[len(states) :])
    chosen = [*range(n), *(n + i for i in (range(len(inputs)) if some is None else some))]
    seeds = np.eye(sum(length for _, length in begins))[[columns[i] for i in chosen]]
    all_at_once = (1.5 + 0.5 * np.sin(np.arange(len(chosen))[None] ** 2.0)) @ seeds  # numpy.random takes long to import
    some_direction, directions = (instance.derivative(unknowns, size, knowns, each) for each in (all_at_once, seeds))

    def calculate() -> Floats:
        jacobian = np.zeros((len(rows), len(columns)))
        # test all directions at once: a component may ignore all inputs in a mode
        if chosen and some_direction().any():
            jacobian[:, chosen] = directions().T[rows]
        return jacobian

    return calculate
