"""Steps for sampled coupling, and what any algorithm has to have."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from vdfmu.engine.fmu.access import Call
from vdfmu.engine.fmu.instance import Instance
from vdfmu.engine.masters.exchange import Exchange
from vdfmu.engine.masters.together import Together, stages_of


class Stepper:
    """Steps all components of a run; the function of an `Algorithm` makes one from a `Coupling`."""

    pressed: Callable[[], bool] = staticmethod(lambda: False)
    """Whether the user wants to stop. The master asks between the rows; a stepper that takes long for one asks, too."""

    def advance(self, time: float, step: float, stop: float) -> None:
        """Step all from a communication point by `step` to `stop` [s], their sum but for rounding."""
        raise NotImplementedError

    def notes(self) -> list[str]:
        """Return notes on the run."""
        raise NotImplementedError

    def facts(self) -> dict[str, Any]:
        """Return the summary's entries on the steps."""
        raise NotImplementedError

    def free(self) -> None:
        """Free what it has of the components, such as saved states."""


class SampledStepper(Stepper):
    """Steps the units once, in the order of the schedule: inputs are held over a step."""

    def __init__(self, exchange: Exchange) -> None:
        self._clock, self._size = exchange.clock, exchange.size
        gathers = [bank.gather(slice(0, bank.inputs.size), late=True) for bank in exchange.banks]
        self.opening = [gather for gather in gathers if gather is not None]
        """Bring inputs that are not fresh to the outputs at the start of the step."""
        if exchange.checked.feed is not None:
            self.opening.insert(0, lambda: exchange.feed(exchange.clock.value))
        self.stages: list[tuple[Instance, list[Callable[[], None]], list[Call]]] = []
        """Unit by unit: the instance, what brings its fresh inputs up to date, its calls."""
        for name in exchange.checked.schedule.units:
            fresh: list[Callable[[], None]] = []
            for bank in exchange.banks:
                start = bank.input_windows[name].start
                gather = bank.gather(slice(start, start + bank.fresh_counts[name]))
                if gather is not None:
                    fresh.append(gather)
            self.stages.append((exchange.instances[name], fresh, exchange.calls(name)))
        for group in exchange.checked.schedule.groups:
            at = next(i for i, (instance, *_) in enumerate(self.stages) if instance.name == group[0])
            own = slice(at, at + len(group))
            members = [instance for instance, *_ in self.stages[own]]
            joined = Together(members, exchange.checked.descriptions, exchange.checked.links, exchange.banks[0])
            self.stages[own] = stages_of(self.stages[own], joined.step_call(self._clock, self._size))
        self._calls: list[tuple[Instance, Callable[..., int | None], tuple[Any, ...], str]] = []
        """The stages as one list, of which a gather has no status."""
        for instance, gathers, calls in self.stages:
            self._calls += [(instance, gather, (), "") for gather in gathers]
            self._calls += [(instance, *call) for call in calls]

    def advance(self, time: float, step: float, stop: float) -> None:
        """Step all units from `time` by `step`."""
        self._clock.value, self._size.value = time, step
        for gather in self.opening:
            gather()
        for instance, function, arguments, name in self._calls:
            if status := function(*arguments):
                instance.judge(status, name)

    def notes(self) -> list[str]:
        """Return notes on the run: none."""
        return []

    def facts(self) -> dict[str, Any]:
        """Return the summary's entries on the steps: none."""
        return {}
