"""Steps in compiled code: bit-identical to those of `SampledStepper` and similar ones, without the interpreter.

The plan is a list of actions: copies of values and calls of FMUs. Python judges each status, each flag of a step and
each integer out of range, and handles events. Then the step goes on.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from ctypes import Structure, addressof, byref, c_double, c_void_p, cast
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vdfmu.base.arrays import Floats
from vdfmu.engine.fmu.access import TEXTS, Ends, Transfer
from vdfmu.engine.fmu.instance import Instance
from vdfmu.engine.fmu.versions import Instance3
from vdfmu.engine.masters.continuous import ContinuousStepper
from vdfmu.engine.masters.coupled import Coupled
from vdfmu.engine.masters.events import EventStepper
from vdfmu.engine.masters.exchange import Bank, Exchange
from vdfmu.engine.masters.loop import (
    BY_HAND,
    CHANGED,
    COPY,
    EVENT,
    LINE,
    NO_COMPILER,
    NOT_FINITE,
    PREDICTED,
    RAMP,
    RATES,
    SCALED,
    STEP,
    VALUES,
    Action,
    Master,
    RowBlock,
    library,
)  # fmt: skip
from vdfmu.engine.masters.sampled import MultirateStepper, SampledStepper, Stepper
from vdfmu.engine.plan.actions import step_actions
from vdfmu.engine.plan.grid import Grid, largest_step
from vdfmu.engine.results.recorder import RowsInMemory

_TYPES = "float64 float32 int64 bool int32 int16 int8 uint64 uint32 uint16 uint8".split()
_SLICE = 0.01
"""Time [s] after which signals, and the clocks of recorder and observers, are checked."""


def obstacle(stepper: Stepper, exchange: Exchange) -> str:
    """Return why a run's steps must be made in Python; empty if compiled code can make them."""
    if type(stepper) not in (SampledStepper, MultirateStepper, EventStepper, ContinuousStepper):
        return f"the algorithm {exchange.checked.algorithm}"
    if isinstance(stepper, ContinuousStepper) and (stepper.error is not None or stepper.repeated):
        return "steps that may be repeated"
    if isinstance(stepper, ContinuousStepper) and any(
        addressof(call[1][4]) != rates.ctypes.data for _, call, _, rates in stepper.coupled.rates
    ):
        return "rates of parts of an array"
    if exchange.checked.feed is not None:
        return "inputs from outside"
    for bank in exchange.banks:
        if bank.kind in TEXTS and bank.links:
            return "texts or binary values between components"
        if any(link.conversion.table is not None for link in bank.links):
            return "a connection with a table"
    for instance in exchange.instances.values():
        if instance.python or instance.integrator is not None:
            return f"{instance.name} is {'written in Python' if instance.python else 'integrated by the master'}"
        if instance.updates:
            return f"{instance.name} takes its inputs within steps"
    return NO_COMPILER if library() is None else ""


class CompiledSteps:
    """The steps of a run on a `grid`, equal to those of `stepper`, with the rows of all `keepers`."""

    def __init__(self, stepper: Stepper, exchange: Exchange, grid: Grid, keepers: Sequence[RowsInMemory]) -> None:
        loop, bank = library(), exchange.banks[0]
        assert loop is not None
        self._eventful = stepper if isinstance(stepper, EventStepper) else None
        self._continuous = stepper if isinstance(stepper, ContinuousStepper) else None
        self._banks = [bank for bank in exchange.banks if bank.kind not in TEXTS]  # texts are not read
        self._exchange, self._run, self._grid = exchange, loop.do_steps, grid
        self._kept: list[Any] = []
        """Memory whose addresses are in the plan."""
        self.lasting = self._eventful is None and self._continuous is None
        """Whether the plan is valid for other start values."""
        self._actions: list[Action] = []
        self._judges: list[tuple[Instance, Callable[[Any], None]]] = []
        """The component of each action, and the function that checks its status."""
        if self._continuous is None:
            self._sample()
        else:
            self._couple(self._continuous.coupled)
        rows: list[RowBlock] = []
        owners: list[RowsInMemory] = []
        for keeper, each in product(keepers, self._banks):
            if columns := keeper.columns.get(kind := each.kind.lower()):
                parts = keeper.data[kind], each.memory, np.array(columns, np.intp)
                rows.append(RowBlock(*map(self._address, parts), len(columns), each.memory.itemsize))
                owners.append(keeper)
        blocks = self._array(RowBlock, rows)
        self._keepers = [
            (keeper, [block for owner, block in zip(owners, blocks, strict=True) if owner is keeper])
            for keeper in keepers
        ]
        box, watched = exchange.box, exchange.watched
        self._master = Master(
            outputs=self._address(bank.outputs), watched=self._address(watched), n_watched=watched.size,
            actions=addressof(self._array(Action, self._actions)), n_actions=len(self._actions),
            rows=addressof(blocks), n_rows=len(rows),
            clock=addressof(exchange.clock), size=addressof(exchange.size), time=addressof(box.clock),
            waiting=addressof(box.waiting), begin=grid.begin, step=grid.step, rest=grid.last, n=grid.n,
            row=addressof(exchange.row), running=addressof(exchange.running), event=self._next_event,
        )  # fmt: skip
        self._pointer = byref(self._master)

    def run(self, end: int) -> int:
        """Do steps to row `end` at most; return the last complete row.

        Ends after a step with messages. CosimError for a failure of a component, or an output that is not finite.
        """
        master, row, first = self._master, self._exchange.row, 0
        for keeper, blocks in self._keepers:
            begin, full = keeper.room(row.value + 1)
            end = min(end, full - 1)
            for block in blocks:
                block.first = begin
        while answer := self._run(self._pointer, first, end, _SLICE):
            if answer in (EVENT, BY_HAND):
                self._events(answer == EVENT)
                first, end = master.n_actions, row.value + 1 if self._exchange.box.ended else end
                continue
            if answer == NOT_FINITE:
                self._exchange.refuse_not_finite("doStep", self._grid.time(row.value + 1))
            instance, judge = self._judges[master.action]
            judge(master)
            master.pending |= instance.event_needed
            first, end = master.action + 1, row.value + 1
        if self._continuous is not None:
            self._continuous.count(self._grid, row.value)
        return row.value

    @property
    def instance(self) -> Instance:
        """The component of the last action, for a message if it ends the process."""
        return self._judges[self._master.action][0]

    @property
    def _next_event(self) -> float:
        """Time of the next known event [s]; infinite if there is none."""
        return math.inf if self._eventful is None else min(self._eventful.events.times, default=math.inf)

    def _events(self, pending: bool) -> None:
        """Handle events at the end of a step, or make a step in Python if it has events within it or at its end."""
        master, eventful, grid, k = self._master, self._eventful, self._grid, self._exchange.row.value
        assert eventful is not None
        begin, end = grid.time(k), grid.time(k + 1)
        self._exchange.box.time = begin
        if pending:
            eventful.events.handle(end, end - begin)
        else:
            eventful.advance(begin, grid.step if k < grid.n - 1 else grid.last, end)
        master.pending, master.event = 0, self._next_event

    def _sample(self) -> None:
        """Plan steps with inputs that are held over a step."""
        exchange, banks = self._exchange, self._banks
        for action in step_actions(exchange.checked):
            name = action.name or exchange.checked.schedule.units[0]
            if action.verb == "gather":
                for bank in banks:
                    self._gather(name, bank, bank.inputs_of(action.name, action.fresh))
                continue
            add = {"set": self._set, "step": self._step, "get": self._get}[action.verb]
            add(exchange.instances[name], action.at_end)
        for name, unit in self._eventful.events.units.items() if self._eventful else ():
            for bank in banks:
                self._gather(name, bank, bank.inputs_of(name))
            for part, where, last in unit.watched:
                if where.size:
                    self._add(
                        unit.instance, lambda master: None, kind=CHANGED, types=_TYPES.index(part.dtype.name),
                        n=where.size, source=self._address(part), from_=self._address(where),
                        values=self._address(last),
                    )  # fmt: skip

    def _couple(self, coupled: Coupled) -> None:
        """Plan steps with ramped inputs, as in `ContinuousStepper`."""
        exchange, bank, begun = self._exchange, coupled.bank, coupled.begun[0]
        previous = begun.copy()
        instance = next(iter(exchange.instances.values()))  # for all copies, which cannot fail
        for each, before in zip(exchange.banks, coupled.begun, strict=True):
            if each in self._banks:
                self._whole(instance, before, each.outputs)
                self._gather(instance.name, each, each.inputs_of())
                self._whole(instance, coupled.waiting.get(each.kind, coupled.starts)[: each.inputs.size], each.inputs)
        self._line(instance, PREDICTED, coupled.outputs, begun, factor=self._address(previous), from_row=1)
        for owner, (_, arguments, name), places, rates in coupled.rates:
            self._rates(owner, owner.slopes_name, arguments, name, from_row=1)
            where = self._address(places)
            self._line(
                owner, LINE, coupled.outputs, begun, factor=self._address(rates), to=where, from_=where, n=rates.size,
                from_row=1,
            )  # fmt: skip
        self._part(instance, coupled.outputs, begun, np.flatnonzero(coupled.discrete))
        for unit in (unit for block in coupled.blocks for unit in block.units):
            name = unit.instance.name
            for each in self._banks:
                window = each.inputs_of(name)
                self._gather(name, each, window)
                if each is not bank:
                    held = [i for i, k in enumerate(each.links[window]) if k.end not in exchange.checked.schedule.fresh]
                    self._part(
                        unit.instance, each.inputs[window], coupled.waiting[each.kind][window], np.array(held, np.intp)
                    )
            self._whole(unit.instance, unit.ends, unit.inputs)
            self._part(unit.instance, unit.ends, unit.starts, unit.held)
            for part, (hold, calls) in enumerate(unit.parts):
                self._line(
                    unit.instance, RAMP, unit.inputs, unit.starts, factor=self._address(unit.ends),
                    offset=self._address(hold), more=self._address(unit.slopes),
                )  # fmt: skip
                self._set(unit.instance, False)
                for _, arguments, call in calls:
                    if call == "setRealInputDerivatives":
                        self._rates(unit.instance, "SetRealInputDerivatives", arguments, call)
                self._step(unit.instance, False, part=part, parts=len(unit.parts))
            self._get(unit.instance, False)
        self._whole(instance, bank.inputs, coupled.ends[: bank.inputs.size])
        self._whole(instance, previous, begun)

    def _line(self, instance: Instance, kind: int, values: Floats, begin: Floats, **fields: Any) -> None:
        """Add a copy along ramps over the step, if it has values."""
        if values.size:
            fields = {"n": values.size} | fields
            self._add(
                instance, lambda master: None, kind=kind, last=self._grid.last, values=self._address(values),
                source=self._address(begin), **fields,
            )  # fmt: skip

    def _part(self, instance: Instance, target: NDArray[Any], source: NDArray[Any], places: NDArray[np.intp]) -> None:
        """Add the copy of the values at some places, if there are any."""
        if places.size:
            self._copy(instance, (target, places, source, places), False, lambda master: None)

    def _whole(self, instance: Instance, target: NDArray[Any], source: NDArray[Any]) -> None:
        """Add the copy of all values."""
        self._part(instance, target, source, np.arange(target.size))

    def _rates(self, instance: Instance, name: str, arguments: Any, call: str, **fields: Any) -> None:
        """Add a call that gets or sets time derivatives."""
        _, references, n, orders, values, *_ = arguments
        self._kept += [references, orders, values]
        self._add(
            instance, lambda master: instance.judge(master.status, call), name,
            kind=RATES + isinstance(instance, Instance3), references=addressof(references), n_references=n,
            n=len(values), more=addressof(orders), values=addressof(values), **fields,
        )  # fmt: skip

    def _set(self, instance: Instance, at_end: bool) -> None:
        """Add the calls that set the inputs of a component."""
        for moved in self._transfers(instance, "Set"):
            self._move(instance, moved, at_end)
            self._values(instance, moved, at_end)

    def _get(self, instance: Instance, at_end: bool) -> None:
        """Add the calls that get the outputs of a component."""
        for moved in self._transfers(instance, "Get"):
            self._values(instance, moved, at_end)
            self._move(instance, moved, at_end)

    def _transfers(self, instance: Instance, verb: str) -> list[Transfer]:
        return [moved for bank in self._banks for moved in bank.transfers(instance, verb)]

    def _gather(self, name: str, bank: Bank, window: slice) -> None:
        """Add the copy over the connections of a window of inputs, if it has any; see `Bank.gather`."""
        links = bank.links[window]
        if not links:
            return
        places = [(bank.position[link.end], bank.position[link.start]) for link in links]
        to, source = (np.array(each, np.intp) for each in zip(*places, strict=True))
        names = () if all(link.conversion.trivial for link in links) else ("factor", "offset")
        scales = [np.array([getattr(link.conversion, name) for link in links]) for name in names]
        self._copy(
            self._exchange.instances[name], (bank.memory, to, bank.memory, source), False, lambda master: None, scales
        )

    def _move(self, instance: Instance, moved: Transfer, at_end: bool) -> None:
        """Add the copy between the memory of a call and the master's, if they differ."""
        if not moved.direct:
            self._copy(instance, moved.ends, at_end, lambda master: moved.move())

    def _copy(
        self, instance: Instance, ends: Ends, at_end: bool, judge: Callable[[Any], None], scales: Sequence[Floats] = ()
    ) -> None:
        values, to, source, places = ends
        types = 16 * _TYPES.index(source.dtype.name) + _TYPES.index(values.dtype.name)
        factor, offset = map(self._address, scales or (None, None))
        self._add(
            instance, judge, kind=SCALED if scales else COPY, types=types, n=to.size, at_end=at_end, factor=factor,
            offset=offset, values=self._address(values), to=self._address(to), source=self._address(source),
            from_=self._address(places),
        )  # fmt: skip

    def _values(self, instance: Instance, moved: Transfer, at_end: bool) -> None:
        """Add a call that gets or sets values."""
        self._kept.append(moved)
        self.lasting = self.lasting and not moved.partial
        self._add(
            instance, lambda master: instance.judge(master.status, moved.name), moved.verb + moved.native,
            at_end=at_end, kind=VALUES + isinstance(instance, Instance3),
            references=addressof(moved.references), n_references=len(moved.references), n=moved.memory.size,
            values=self._address(moved.memory),
        )  # fmt: skip

    def _step(self, instance: Instance, at_end: bool, **parts: int) -> None:
        grid, multiples = self._grid, self._exchange.checked.multiples
        every = multiples.get(instance.name, 1)
        begun = grid.begin + (grid.n - 1) // every * every * grid.step
        last = largest_step(begun, grid.begin + (grid.end - grid.begin)) if multiples else grid.last
        answers: dict[str, Any] = {}
        if isinstance(instance, Instance3):
            answers = {"flags": addressof(instance.flags), "reached": addressof(instance.reached)}
            self._kept += [instance.flags, instance.reached]

        def judge(master: Any) -> None:
            status, instance.step = master.status, (c_double(master.point), c_double(master.length))
            if isinstance(instance, Instance3):
                status = instance.complete(status, *instance.step)
            if status:
                instance.judge(status, "doStep")

        self._add(instance, judge, "DoStep", kind=STEP + bool(answers), at_end=at_end, last=last, **answers, **parts)

    def _add(self, instance: Instance, judge: Callable[[Any], None], name: str = "", **fields: Any) -> None:
        """Add an action, which is a call of the FMI function if `name` is given."""
        function, number = None, 0
        if name:
            function = cast(getattr(instance.fmu.dll, instance.symbol(name)), c_void_p).value
            number = getattr(instance.function(name), "number", 0)
        every = self._exchange.checked.multiples.get(instance.name, 1)
        calls = {"function": function, "number": number, "component": instance.fmu.component}
        self._actions.append(Action(every=every, **calls, **fields))
        self._judges.append((instance, judge))

    def _address(self, array: NDArray[Any] | None) -> int | None:
        """Return the address of the memory of an array, and keep it."""
        self._kept.append(array)
        return None if array is None else array.ctypes.data

    def _array(self, kind: type[Structure], items: Sequence[Any]) -> Any:
        """Return an array of structures, and keep it."""
        self._kept.append((kind * len(items))(*items))
        return self._kept[-1]
