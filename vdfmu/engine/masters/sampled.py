"""Steps for sampled coupling: of all components once, by their own multiples of the step, or integrated together."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from ctypes import c_double
from dataclasses import dataclass
from itertools import groupby, pairwise
from typing import Any

import numpy as np
from fmpy.fmi1 import FMICallException

from vdfmu.base.arrays import Floats
from vdfmu.base.errors import CosimError
from vdfmu.engine.fmu.access import Call
from vdfmu.engine.fmu.description import Description
from vdfmu.engine.fmu.instance import Instance
from vdfmu.engine.fmu.integrator import ModelExchangeIntegrator
from vdfmu.engine.masters.exchange import Exchange, Gather
from vdfmu.engine.plan.conversion import Link
from vdfmu.engine.plan.graph import ranks
from vdfmu.engine.plan.grid import largest_step
from vdfmu.engine.plan.schedule import variable_graph


class Stepper:
    """Steps all components of a run; the function of an `Algorithm` makes one from a `Coupling`."""

    pressed: Callable[[], bool] = staticmethod(lambda: False)
    """Whether the user wants to stop. Called by the master between rows, and within rows by slow steppers."""

    def advance(self, time: float, step: float, stop: float) -> None:
        """Step all from a communication point by `step` [s] to `stop` [s], which is their sum except for rounding."""
        raise NotImplementedError

    def notes(self) -> list[str]:
        """Return notes on the run; default none."""
        return []

    def facts(self) -> dict[str, Any]:
        """Return the summary's entries on the steps; default none."""
        return {}

    def free(self) -> None:
        """Free resources of the components, such as saved states."""


class SampledStepper(Stepper):
    """Steps the units once, in the order of the schedule: inputs are held over a step."""

    def __init__(self, exchange: Exchange) -> None:
        self._clock, self._size = exchange.clock, exchange.size
        self.opening = exchange.gathers()
        """Update inputs that are not fresh, from the outputs at the start of the step."""
        if exchange.checked.feed is not None:
            self.opening.insert(0, lambda: exchange.feed(exchange.clock.value))
        self.stages: list[tuple[Instance, list[Gather], list[Call]]] = []
        """For each unit: the instance, functions that update its fresh inputs, and its calls."""
        for name in exchange.checked.schedule.units:
            fresh = exchange.gathers(lambda bank, name=name: bank.fresh_windows[name])
            self.stages.append((exchange.instances[name], fresh, exchange.calls(name)))
        for group in exchange.checked.schedule.groups:
            at = next(i for i, (instance, *_) in enumerate(self.stages) if instance.name == group[0])
            span = slice(at, at + len(group))
            joined = Together([instance for instance, *_ in self.stages[span]], exchange)
            self.stages[span] = stages_of(self.stages[span], joined.step_call(self._clock, self._size))
        self._calls: list[tuple[Instance, Callable[..., int | None], tuple[Any, ...], str]] = []
        """The stages as one list; gathers return no status."""
        for instance, gathers, calls in self.stages:
            self._calls += [(instance, gather, (), "") for gather in gathers]
            self._calls += [(instance, *call) for call in calls]

    def advance(self, time: float, step: float, stop: float) -> None:
        """Step all units from `time` by `step`."""
        self._clock.value, self._size.value = time, step
        for gather in self.opening:
            gather()
        for instance, function, arguments, name in self._calls:
            try:
                status = function(*arguments)
            except FMICallException as error:
                status = error.status
            if status:
                instance.judge(status, name)


@dataclass
class _RateUnit:
    """One component: functions that update its inputs, its calls, and its current step."""

    instance: Instance
    multiple: int
    early: bool
    """Whether it steps when its step begins, so that others read its outputs for that time."""
    opening: list[Gather]
    fresh: list[Gather]
    sets: list[Call]
    rest: list[Call]
    begun: float = 0.0
    last: int = 0


class MultirateStepper(SampledStepper):
    """Steps units like `SampledStepper`, each by its own multiple of the communication step.

    A unit reads its inputs when its step begins, holds them, and steps at its end, so its outputs change then. An early
    unit, see `Checked.early`, steps when its step begins, and its outputs are held during the step. The last step of a
    unit may be shorter.
    """

    def __init__(self, exchange: Exchange, span: float) -> None:
        super().__init__(exchange)
        self._exchange, self._span = exchange, span
        self._k, self._stop = 0, 0.0
        early = exchange.checked.early
        self._units: list[_RateUnit] = []
        for name, (instance, fresh, calls) in zip(exchange.checked.schedule.units, self.stages, strict=True):
            at = next(i for i, call in enumerate(calls) if call[2] == "doStep")
            opening = exchange.gathers(lambda bank, name=name: bank.input_windows[name])
            multiple = exchange.checked.multiples.get(name, 1)
            self._units.append(_RateUnit(instance, multiple, name in early, opening, fresh, calls[:at], calls[at:]))

    def advance(self, time: float, step: float, stop: float) -> None:
        """Begin or end the steps that begin at `time` or end a communication step later."""
        k, n = self._k, round(self._span / step)
        self._stop = self._stop if k else time + self._span
        self._clock.value, self._size.value = time, step
        self._exchange.feed(time)
        begin = [unit for unit in self._units if k % unit.multiple == 0]
        for unit in begin:
            unit.begun, unit.last = time, min(k + unit.multiple, n) - 1
            for gather in unit.opening:
                gather()
        for unit in self._units:
            if k % unit.multiple == 0:
                for gather in unit.fresh:
                    gather()
                unit.instance.run(unit.sets)
            if k % unit.multiple == 0 if unit.early else k == unit.last:
                length = step * (unit.last + 1 - k if unit.early else k % unit.multiple + 1)
                self._clock.value = unit.begun
                self._size.value = largest_step(unit.begun, self._stop) if unit.last == n - 1 else length
                unit.instance.run(unit.rest)
        self._clock.value, self._size.value = time, step
        self._k += 1


_ROUNDS = 100
"""Most rounds of an event between members."""


class Together:
    """Components of model exchange that depend on each other within a step, for the integrator one component.

    Values are exchanged between them at every evaluation: outputs are read in the order of their declared dependencies,
    and each input is set as soon as its source is known. Model exchange allows to read outputs of a component before
    all of its inputs are set.
    """

    derivatives_name = "derivatives"

    def __init__(self, members: Sequence[Instance], exchange: Exchange) -> None:
        self.members, bank = members, exchange.banks[0]
        self.bank = bank
        self.name, self.box = members[0].name, members[0].box
        self._sizes = [member.sizes() for member in members]
        names = {member.name for member in members}
        inner = [k for k in exchange.checked.links if k.stepped and {k.start[0], k.end[0]} <= names]
        self._inner = np.array([bank.position[k.end] - bank.outputs.size for k in inner], np.intp)
        self._passes = self._planned({name: exchange.checked.descriptions[name] for name in names}, inner)
        self._integrator = ModelExchangeIntegrator(self, members[0].tolerance)

    @property
    def next_event(self) -> float:
        """Time of the next event [s]."""
        return min(member.next_event for member in self.members)

    def step_call(self, clock: c_double, size: c_double) -> Call:
        """Return the call of a step from `clock` by `size` [s]."""
        return self._integrator.step_call(clock, size)

    def _planned(self, descriptions: Mapping[str, Description], links: Sequence[Link]) -> list[Callable[[], None]]:
        """Return the functions that pass values on, in stages: outputs of one rank, then inputs connected to them."""
        ports, edges = variable_graph(descriptions, links, initial=False)
        starts = {link.start for link in links}
        rank = ranks(ports, edges, lambda _, port: port in starts)
        stages: list[Callable[[], None]] = []
        for _, group in groupby(sorted(links, key=lambda k: rank[k.end]), lambda k: rank[k.end]):
            stage = list(group)
            for verb, some in (("Get", {k.start for k in stage}), ("Set", {k.end for k in stage})):
                if verb == "Set":
                    stages.append(self._carry(stage))
                for member in self.members:
                    calls = self.bank.calls(member, verb, lambda v, some=some, name=member.name: (name, v.name) in some)
                    if calls:
                        stages.append(lambda member=member, calls=calls: member.run(calls))
        return stages

    def _carry(self, links: Sequence[Link]) -> Callable[[], None]:
        """Return the function that copies the outputs to the inputs of connections."""
        bank, first = self.bank, self.bank.outputs.size
        pairs = sorted((bank.position[k.end] - first, bank.position[k.start], k.conversion) for k in links)
        targets, sources = (np.array([pair[i] for pair in pairs], np.intp) for i in (0, 1))
        factor, offset = (np.array([getattr(c, name) for *_, c in pairs]) for name in ("factor", "offset"))
        plain = all(c.trivial for *_, c in pairs)

        def carry() -> None:
            values = bank.outputs[sources]
            bank.inputs[targets] = values if plain else factor * values + offset

        return carry

    def pass_on(self) -> None:
        """Update all inputs that are connected to members."""
        for stage in self._passes:
            stage()

    # The methods below are calls of the integrator.

    def sizes(self) -> tuple[int, int]:
        """Return the numbers of states and event indicators."""
        return sum(n for n, _ in self._sizes), sum(n for _, n in self._sizes)

    def set_time(self, time: float) -> None:
        """Set the time."""
        for member in self.members:
            member.set_time(time)

    def transfer(self, name: str, values: Floats) -> None:
        """Get or set states, derivatives or event indicators of all."""
        indicators = name == "GetEventIndicators"
        if indicators or name == self.derivatives_name:
            self.pass_on()
        places = np.cumsum([0, *(sizes[indicators] for sizes in self._sizes)]).tolist()
        for member, (begin, end) in zip(self.members, pairwise(places), strict=True):
            member.transfer(member.derivatives_name if name == self.derivatives_name else name, values[begin:end])

    def update(self, time: float) -> None:
        """Update the discrete states of all at an event, until the values between them are constant."""
        self.pass_on()
        for _ in range(_ROUNDS):
            passed = self.bank.inputs[self._inner]
            for member in self.members:
                member.update(time)
                if member.name in self.box.ended:
                    self.box.ended[self.name] = time
            self.pass_on()
            if np.array_equal(self.bank.inputs[self._inner], passed, equal_nan=True) or self.name in self.box.ended:
                return
        names = ", ".join(member.name for member in self.members)
        reason = f"an event does not settle: values between {names} still change after {_ROUNDS} updates"
        raise CosimError(self.name, "updateDiscreteStates", time, reason)

    def completed_step(self) -> bool:
        """Report a step of the solver to all; return whether it is an event for any."""
        return any([member.completed_step() for member in self.members])

    def enter_event(self) -> None:
        """Enter event mode."""
        for member in self.members:
            member.enter_event()

    def leave_event(self) -> None:
        """Leave event mode."""
        for member in self.members:
            member.leave_event()


def stages_of(members: Sequence[tuple[Instance, list[Any], list[Call]]], step: Call) -> list[Any]:
    """Return the stages of one joint `step` of members: inputs of all, the step, outputs of all."""
    inputs: list[Any] = []
    outputs: list[Any] = []
    for instance, gathers, calls in members:
        at = [call[-1] for call in calls].index("doStep")
        inputs.append((instance, gathers, calls[:at]))
        outputs.append((instance, [], calls[at + 1 :]))
    return [*inputs, (members[0][0], [], [step]), *outputs]
