"""Steps for sampled coupling: all components at once, by multiples of the step, or integrated together."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from ctypes import c_double
from itertools import groupby, pairwise
from typing import Any

import numpy as np
from fmpy.fmi1 import FMICallException
from numpy.typing import NDArray

from vdfmu.base.arrays import Floats
from vdfmu.base.errors import CosimError
from vdfmu.engine.fmu.access import Call
from vdfmu.engine.fmu.description import Description
from vdfmu.engine.fmu.instance import Instance
from vdfmu.engine.fmu.integrator import ModelExchangeIntegrator
from vdfmu.engine.masters.exchange import Exchange
from vdfmu.engine.plan.actions import Planned, step_actions
from vdfmu.engine.plan.conversion import Link
from vdfmu.engine.plan.graph import ranks
from vdfmu.engine.plan.grid import largest_step
from vdfmu.engine.plan.schedule import variable_graph


class Stepper:
    """Steps all components of a run. The function in an `Algorithm` makes one from a `Coupling`."""

    pressed: Callable[[], bool] = staticmethod(lambda: False)
    """Returns whether the user stops the run. Called by the master between rows, and by slow steppers within rows."""

    def advance(self, time: float, step: float, stop: float) -> None:
        """Step all components from `time` by `step` to `stop` [s], their sum except for rounding."""
        raise NotImplementedError

    def notes(self) -> list[str]:
        """Return notes on the run, by default none."""
        return []

    def facts(self) -> dict[str, Any]:
        """Return the summary's entries on the steps, by default none."""
        return {}

    def free(self) -> None:
        """Free resources of the components, such as saved states."""


class SampledStepper(Stepper):
    """Steps the units once, in the order of the schedule: inputs are held over a step."""

    def __init__(self, exchange: Exchange) -> None:
        self._exchange = exchange
        self._sizes: dict[str, tuple[c_double, c_double]] = {}
        """For a unit with its own step: its communication point and step size."""
        self._due: dict[str, list[bool]] = {}
        """For a unit with its own step: whether it begins now, and whether it ends with this communication step."""
        if exchange.checked.multiples:
            self._sizes = {name: (c_double(), c_double()) for name in exchange.checked.schedule.units}
            self._due = {name: [True, True] for name in self._sizes}
        self._calls: list[tuple[Instance, Callable[..., int | None], tuple[Any, ...], str, list[bool], bool]] = []
        """Each function of a step with its arguments and name, and where to read whether it is due."""
        always = [True, True]
        for action in step_actions(exchange.checked):
            instance = exchange.instances[action.name or exchange.checked.schedule.units[0]]
            due = self._due.get(action.name, always)
            self._calls += [(instance, *call, due, action.at_end) for call in self._calls_of(action)]

    def _calls_of(self, action: Planned) -> list[Call]:
        """Return the calls of an action; gathering inputs returns no status."""
        exchange = self._exchange
        if action.verb == "gather":
            return [(gather, (), "") for gather in exchange.gathers(action.name, action.fresh)]
        members = [exchange.instances[name] for name in action.names]
        if action.verb == "step":
            stepped = Together(members, exchange) if len(members) > 1 else members[0]
            return [stepped.step_call(*self._sizes.get(action.name, (exchange.clock, exchange.size)))]
        return [call for bank in exchange.banks for call in bank.calls(members[0], action.verb.capitalize())]

    def advance(self, time: float, step: float, stop: float) -> None:
        """Step all units from `time` by `step`."""
        exchange = self._exchange
        exchange.clock.value, exchange.size.value = time, step
        exchange.feed(time)
        for instance, function, arguments, name, due, at_end in self._calls:
            if not due[at_end]:
                continue
            try:
                status = function(*arguments)
            except FMICallException as error:
                status = error.status
            if status:
                instance.judge(status, name)


class MultirateStepper(SampledStepper):
    """Steps units like `SampledStepper`, each by its own multiple of the communication step.

    A unit reads its inputs when its step begins, holds them, and makes the step when it ends, so its outputs change
    then. An early unit, see `Checked.early`, steps when its step begins, and its outputs are held during the step. The
    last step of a unit may be shorter.
    """

    def __init__(self, exchange: Exchange, span: float) -> None:
        super().__init__(exchange)
        self._span, self._k, self._stop = span, 0, 0.0

    def advance(self, time: float, step: float, stop: float) -> None:
        """Begin the steps that start at `time`, and make those that end a communication step later."""
        k, n = self._k, round(self._span / step)
        self._stop = self._stop if k else time + self._span
        for name, (clock, size) in self._sizes.items():
            every = self._exchange.checked.multiples.get(name, 1)
            begin = k - k % every
            end = min(begin + every, n)
            self._due[name][:] = k == begin, k == end - 1
            if k == begin:
                clock.value = time
                size.value = largest_step(time, self._stop) if end == n else step * (end - begin)
        super().advance(time, step, stop)
        self._k += 1


_ROUNDS = 100
"""Largest number of rounds of an event between members."""


class Together:
    """Model-exchange components that depend on each other within a step and are one component for the integrator.

    Values are exchanged between them at every evaluation: outputs are read in the order of their declared dependencies,
    and each input is set as soon as its source is known. Model exchange allows reading outputs of a component before
    all of its inputs are set.
    """

    derivatives_name = "derivatives"

    def __init__(self, members: Sequence[Instance], exchange: Exchange) -> None:
        self.members, bank = members, exchange.banks[0]
        self.bank = bank
        self.name, self.box = members[0].name, members[0].box
        self._sizes = [member.sizes() for member in members]
        self._asking: list[Instance] = []
        """Members that ask for an event after a step of the solver."""
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

    # The methods below are called by the integrator.

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
        """Report a solver step to all members; return whether it is an event for any."""
        self._asking = [member for member in self.members if member.completed_step()]
        return bool(self._asking)

    def happened(self, time: float, changed: NDArray[np.bool_]) -> None:
        """Note an event of the members whose event indicators have changed, whose time it is, or that ask for it."""
        begin = 0
        for member, (_, n) in zip(self.members, self._sizes, strict=True):
            if changed[begin : begin + n].any() or member.next_event <= time or member in self._asking:
                self.box.event(member.name, time)
            begin += n
        self._asking = []

    def enter_event(self) -> None:
        """Enter event mode."""
        for member in self.members:
            member.enter_event()

    def leave_event(self) -> None:
        """Leave event mode."""
        for member in self.members:
            member.leave_event()
