"""Components of model exchange that depend on each other within a step: the master integrates them as one."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from ctypes import c_double
from itertools import groupby, pairwise
from typing import Any

import numpy as np

from vdfmu.base.arrays import Floats
from vdfmu.base.errors import CosimError
from vdfmu.engine.fmu.access import Call
from vdfmu.engine.fmu.description import Description
from vdfmu.engine.fmu.instance import Instance
from vdfmu.engine.fmu.integrator import ModelExchangeIntegrator
from vdfmu.engine.masters.bank import Bank
from vdfmu.engine.plan.conversion import Link
from vdfmu.engine.plan.graph import ranks
from vdfmu.engine.plan.schedule import variable_graph

_ROUNDS = 100
"""Most rounds of an event between members."""


class Together:
    """For its integrator one component, with the states of all: values pass between them at every evaluation.

    Outputs are got in the order of their declared dependencies, each input is set as soon as its source is known. A
    component may be asked for some outputs, given an input, and asked for others; of model exchange that is allowed.

    Parameters
    ----------
    members : sequence of Instance
    descriptions : mapping of str to Description
    links : sequence of Link
        All of the system.
    bank : Bank
        Real variables.
    """

    derivatives_name = "derivatives"

    def __init__(
        self, members: Sequence[Instance], descriptions: Mapping[str, Description], links: Sequence[Link], bank: Bank
    ) -> None:
        self.members, self.bank = members, bank
        self.name, self.box = members[0].name, members[0].box
        self._sizes = [member.sizes() for member in members]
        names = {member.name for member in members}
        inner = [k for k in links if k.stepped and {k.start[0], k.end[0]} <= names]
        self._inner = np.array([bank.position[k.end] - bank.outputs.size for k in inner], np.intp)
        self._passes = self._planned({name: descriptions[name] for name in names}, inner)
        self._integrator = ModelExchangeIntegrator(self, members[0].tolerance)

    @property
    def next_event(self) -> float:
        """Time of the next event [s]."""
        return min(member.next_event for member in self.members)

    def step_call(self, clock: c_double, size: c_double) -> Call:
        """Return the call of a step from `clock` by `size` [s]."""
        return self._integrator.step_call(clock, size)

    def _planned(self, descriptions: Mapping[str, Description], links: Sequence[Link]) -> list[Callable[[], None]]:
        """Return the functions that pass values on, stage by stage: outputs of one rank, then inputs that they feed."""
        ports, edges = variable_graph(descriptions, links, initial=False)
        ends = {link.end for link in links}
        rank = ranks(ports, edges, lambda _, port: port not in ends)
        stages: list[Callable[[], None]] = []
        for _, group in groupby(sorted(links, key=lambda k: rank[k.end]), lambda k: rank[k.end]):
            stage = list(group)
            for verb, found in (("Get", {k.start for k in stage}), ("Set", {k.end for k in stage})):
                if verb == "Set":
                    stages.append(self._carry(stage))
                for member in self.members:
                    own = {name for unit, name in found if unit == member.name}
                    calls = self.bank.calls(member, verb, lambda v, own=own: v.name in own) if own else []
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
        """Bring all inputs that members feed up to date."""
        for stage in self._passes:
            stage()

    # ------------------------------------------------------------------ what the integrator asks of a component

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
        """Update the discrete states of all at an event, until what they pass on stays."""
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
        reason = f"an event does not settle: what {names} pass to each other still changes after {_ROUNDS} updates"
        raise CosimError(self.name, "updateDiscreteStates", time, reason)

    def completed_step(self) -> bool:
        """Tell all that the solver has done a step; return whether that is an event for any."""
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
    """Return the stages of members that make one `step` together: inputs of all, the step, outputs of all."""
    inputs: list[Any] = []
    outputs: list[Any] = []
    for instance, gathers, calls in members:
        at = [call[-1] for call in calls].index("doStep")
        inputs.append((instance, gathers, calls[:at]))
        outputs.append((instance, [], calls[at + 1 :]))
    return [*inputs, (members[0][0], [], [step]), *outputs]
