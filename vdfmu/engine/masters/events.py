"""Event mode of co-simulation: events at communication points, and clocks (FMI 3.0).

Components with event mode get their discrete and clocked inputs only in event mode. A component enters it at a
communication point if one of its clocks ticks, if it has an event, or if a discrete input has changed. Components are
handled in the order of the steps, so readers get the outputs of a tick at once. A triggered clock ticks the clocks
connected to it at the same time. Changed discrete outputs are passed on until all are constant.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vdfmu.base.errors import CosimError
from vdfmu.engine.fmu.access import Call
from vdfmu.engine.fmu.variables import FmuVariable
from vdfmu.engine.fmu.versions import Instance3
from vdfmu.engine.masters.exchange import Exchange
from vdfmu.engine.masters.sampled import SampledStepper
from vdfmu.engine.plan.grid import largest_step

_ROUNDS = 100
"""Largest number of successive events at one time."""
_CLOSE = 1e-9
"""Distance from a communication point, relative to the step, within which a time is regarded as that point."""


class _Ticking:
    """A time-based clock: its next tick is `count` intervals after `origin`; never if the interval is unknown."""

    def __init__(self, variable: FmuVariable, start: float) -> None:
        assert variable.clock is not None
        self.variable, self.clock = variable, variable.clock
        self.interval = math.nan if self.clock.asked else self.clock.interval
        self.origin, self.count = start + self.clock.shift, 0

    @property
    def next(self) -> float:
        if math.isnan(self.interval):
            return math.inf
        return self.origin + self.count * self.interval

    def ticked(self, time: float) -> None:
        if self.clock.variability == "countdown":
            self.interval = math.nan
        elif self.clock.variability == "changing":
            self.origin, self.count = time, 1
        else:
            self.count += 1

    def set_interval(self, interval: float, time: float) -> None:
        """Accept an interval from the component, valid from now on or, for a periodic clock, from the start."""
        if self.clock.variability in ("countdown", "changing"):
            self.origin, self.count = time, 1
        self.interval = interval


class _EventUnit:
    """A component with event mode: its clocks, and its calls by the variables' clock, None without a clock."""

    def __init__(self, exchange: Exchange, instance: Instance3, start: float) -> None:
        self.instance = instance
        variables = instance.description.variables.values()
        clocks = [v for v in variables if v.clock is not None]
        timed = [v for v in clocks if v.clock is not None and not v.clock.triggered]
        self.ticking = [_Ticking(v, start) for v in timed if v.causality == "input"]
        self.triggered = [v for v in clocks if v.causality == "output"]
        self.sets: dict[int | None, list[Call]] = {}
        self.gets: dict[int | None, list[Call]] = {}
        for reference in (None, *(v.reference for v in clocks)):

            def ticks(v: FmuVariable, reference: int | None = reference) -> bool:
                return reference in v.clocks if reference is not None else not v.clocks

            for verb, calls in (("Set", self.sets), ("Get", self.gets)):
                calls[reference] = [c for bank in exchange.banks for c in bank.calls(instance, verb, ticks)]
        self.gathers = exchange.gathers(instance.name)
        self.watched: list[tuple[NDArray[Any], NDArray[np.intp], NDArray[Any]]] = []
        """For each type: inputs, the places of discrete ones without a clock, and their last values."""
        for bank in exchange.banks:
            window = bank.input_windows[instance.name]
            links, part = bank.links[window], bank.inputs[window]
            places = [i for i, k in enumerate(links) if not (k.sink.clocks or instance.between_events(k.sink))]
            where = np.array(places, np.intp)
            self.watched.append((part, where, part[where]))

    def gather(self) -> None:
        """Update the inputs."""
        for gather in self.gathers:
            gather()

    @property
    def changed(self) -> bool:
        """Return whether a discrete input differs from the value set last."""
        return any(not np.array_equal(part[where], last) for part, where, last in self.watched)

    def noted(self) -> None:
        """Note that the discrete inputs are set."""
        for part, where, last in self.watched:
            last[:] = part[where]


class Events:
    """The events of a run from `start` [s], whose components are initialized and in event mode."""

    def __init__(self, exchange: Exchange, start: float) -> None:
        self._exchange, self._box = exchange, exchange.box
        instances = [exchange.instances[name] for name in exchange.checked.schedule.units]
        self.units = {
            s.name: _EventUnit(exchange, s, start) for s in instances if isinstance(s, Instance3) and s.event_mode
        }
        self._sinks: dict[tuple[str, int], list[tuple[str, int]]] = {}
        for (a, source), (b, sink) in exchange.checked.clock_links:
            ends = [exchange.checked.descriptions[u].variables[v].reference for u, v in ((a, source), (b, sink))]
            self._sinks.setdefault((a, ends[0]), []).append((b, ends[1]))
        for unit in self.units.values():
            unit.instance.in_event = True
            self._intervals(unit, start)
        self._handle(start, set(self.units), 0.0)

    @property
    def times(self) -> list[float]:
        """Times [s] of the next events that are known in advance."""
        times = [tick.next for unit in self.units.values() for tick in unit.ticking]
        return times + [unit.instance.next_event for unit in self.units.values()]

    def next(self, time: float, stop: float) -> float:
        """Return the time [s] of the next event known in advance after `time`, or `stop` if that is earlier."""
        close = _CLOSE * (stop - time)
        return min((t for t in self.times if time + close < t < stop - close), default=stop)

    def handle(self, time: float, step: float) -> None:
        """Handle the events at a communication point, `step` after the last."""
        self._exchange.feed(time)
        self._handle(time, set(), _CLOSE * step)

    def _handle(self, time: float, involved: set[str], close: float) -> None:
        ticks: dict[str, set[int]] = {}
        for _ in range(_ROUNDS):
            for name, unit in self.units.items():
                instance = unit.instance
                for tick in unit.ticking:
                    if tick.next <= time + close:
                        tick.ticked(time)
                        ticks.setdefault(name, set()).add(tick.variable.reference)
                unit.gather()
                if due := instance.event_needed or instance.next_event <= time + close:
                    instance.box.event(name, time)
                if due or unit.changed or name in ticks:
                    involved.add(name)
            if not involved:
                for unit in self.units.values():
                    unit.instance.leave_event()
                return
            # in the order of the steps: a component that ticks another comes first or again
            for name, unit in self.units.items():
                if name in involved:
                    involved.discard(name)
                    self._event(unit, time, ticks.pop(name, set()), ticks)
        names = ", ".join(sorted(involved | set(ticks))) or "the components"
        raise CosimError(names, "updateDiscreteStates", time, f"events do not end: there were {_ROUNDS} at one time")

    def _event(self, unit: _EventUnit, time: float, active: set[int], ticks: dict[str, set[int]]) -> None:
        """Handle an event of a component with its active clocks; add the clocks that it ticks."""
        instance = unit.instance
        instance.enter_event()
        instance.set_clocks(sorted(active))
        unit.gather()
        self._run(instance, unit.sets, active)
        unit.noted()
        if clocks := [v.reference for v in unit.triggered]:
            for reference in (r for r, ticked in zip(clocks, instance.clocks(clocks), strict=True) if ticked):
                active.add(reference)
                for name, sink in self._sinks.get((instance.name, reference), ()):
                    ticks.setdefault(name, set()).add(sink)
        self._run(instance, unit.gets, active)
        instance.update(time)
        instance.run(unit.gets[None])
        self._intervals(unit, time)

    @staticmethod
    def _run(instance: Instance3, calls: dict[int | None, list[Call]], active: set[int]) -> None:
        for reference, each in calls.items():
            if reference is None or reference in active:
                instance.run(each)

    @staticmethod
    def _intervals(unit: _EventUnit, time: float) -> None:
        """Read the intervals of clocks that the component sets."""
        if asked := [tick for tick in unit.ticking if tick.clock.asked]:
            intervals = unit.instance.intervals([tick.variable.reference for tick in asked])
            for tick, interval in zip(asked, intervals, strict=True):
                if interval is not None:
                    tick.set_interval(interval, time)


class EventStepper(SampledStepper):
    """Steps the units like `SampledStepper`, from event to event."""

    def __init__(self, exchange: Exchange, events: Events) -> None:
        super().__init__(exchange)
        self.events, self._ended = events, exchange.box.ended

    def advance(self, time: float, step: float, stop: float) -> None:
        """Step all units from `time` to `stop`, from event to event."""
        start = time
        while time < stop and not self._ended:
            end = self.events.next(time, stop)
            super().advance(time, step if (time, end) == (start, stop) else largest_step(time, end), end)
            self.events.handle(end, end - time)
            time = end
