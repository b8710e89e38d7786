"""The split of a system over processes, and the federates of a run on this machine.

Each is a process as in `vdfmu.engine.run.isolated`: it holds components, shares the memory of their values with this
process, and steps them on request. Values between federates pass directly by HELICS; this process only reads all
values, row by row. A failed federate reports to its peers on any machine. The death of a federate is noticed here at
once, and on other machines after some seconds.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Collection, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import replace
from hashlib import sha256
from pathlib import Path
from typing import Any, NamedTuple, Self

from numpy import array, intp

from vdfmu.base.errors import CosimError, VdfmuError
from vdfmu.engine.fmu.access import TEXTS
from vdfmu.engine.fmu.description import Description, FmuVariable
from vdfmu.engine.fmu.messages import MessageBox
from vdfmu.engine.masters.exchange import Exchange
from vdfmu.engine.plan.check import Checked
from vdfmu.engine.plan.conversion import SOURCE, Link, Port
from vdfmu.engine.plan.feed import Feed
from vdfmu.engine.plan.graph import ranks
from vdfmu.engine.plan.schedule import variable_graph
from vdfmu.engine.run.isolated import Elsewhere, Isolated, Limits


class Sent(NamedTuple):
    """Variables from a federate to its peers: reals, and all other types."""

    reals: tuple[Port, ...]
    rest: tuple[Port, ...]


class FederationPlan(NamedTuple):
    """The federates of a system."""

    parts: Mapping[str, tuple[str, ...]]
    """The components of each federate by its name, the name of its first component."""
    here: tuple[str, ...]
    """The federates to run here."""
    sent: Mapping[str, Sent]
    """Variables from each; reals that change in steps come first."""
    levels: Mapping[Port, int]
    """Number of exchanges in initialization mode until a variable has its value."""
    core: str
    """See `Federation` for it and the broker."""
    broker: str | None

    @property
    def digest(self) -> str:
        """Digest of the plan, the same for all federates of one run."""
        same = self.parts, self.sent, sorted(self.levels.items())
        return sha256(repr(same).encode()).hexdigest()


def sent_values(links: Sequence[Link]) -> Sent:
    """Return the variables at the start of connections."""
    reals, rest = (dict.fromkeys(k.start for k in links if (k.source.kind == "Real") == r) for r in (True, False))
    return Sent(tuple(reals), tuple(rest))


def levels(checked: Checked, crossing: Sequence[Link]) -> dict[Port, int]:
    """Return `FederationPlan.levels`; loops are open at connections with a guess during initialization."""
    ports, edges = variable_graph(checked.sources, checked.links, initial=True)
    edges -= {(link.start, link.end) for link in checked.schedule.initial.torn}
    between = {(link.start, link.end) for link in crossing}
    return ranks(ports, edges, lambda a, b: (a, b) in between)


def share(checked: Checked, components: Collection[str]) -> Checked:
    """Return a part of a checked system, with values from all other components as inputs from outside.

    The initialization remains the initialization of the whole system.
    """
    links: dict[Port, Link] = {}
    outside: dict[str, FmuVariable] = dict(checked.feed.description.variables) if checked.feed else {}
    for link in checked.links:
        if link.end[0] in components:
            if link.start[0] not in components and link.start[0] != SOURCE:
                name = ".".join(link.start)
                outside[name] = replace(link.source, name=name, causality="output")
                link = replace(link, start=(SOURCE, name), source=outside[name])
            links[link.end] = link
    no_dependencies: dict[str, frozenset[str] | None] = dict.fromkeys(outside, frozenset())
    source = Description("", "", "", False, outside, no_dependencies, no_dependencies)
    return replace(
        checked,
        descriptions={name: d for name, d in checked.descriptions.items() if name in components},
        links=tuple(links.values()),
        schedule=replace(checked.schedule, units=tuple(u for u in checked.schedule.units if u in components)),
        starts={name: values for name, values in checked.starts.items() if name in components},
        feed=Feed(checked.feed.courses if checked.feed else (), source, (), ()) if outside else None,
    )


class _Federate(Isolated):
    """The process of a federate; calls `ended` with its name at an early end."""

    server = "vdfmu.engine.federation.server"

    def __init__(self, name: str, ended: Callable[[str], None], *arguments: Any) -> None:
        super().__init__(*arguments)
        self.name, self._ended = name, ended

    def gone(self) -> None:
        self._ended(self.name)

    @property
    def waits(self) -> bool:
        """Whether it exceeds the time limit, and not by the call of a component."""
        return self.late and not self.works

    @property
    def works(self) -> bool:
        """Whether it is calling a component."""
        return self.exchange.running.value > 0

    def cut(self, late: bool) -> None:
        """End the process because another process ended, or, if `late`, because of its time limit."""
        if (child := self._child) is not None:
            child.late = late
            child.kill()

    def begin(self) -> None:
        """Note that the steps begin."""
        self._stepping = True

    def facts(self) -> dict[str, Any]:
        with suppress(VdfmuError):  # it has just ended
            return super().facts() if self.waiting else {}
        return {}

    def idle(self, time: float, code: int | str) -> CosimError:
        why = f"its process ended ({code})"
        if self.late:
            why = f"no answer of other federates within {self.limits.time:g} s (wait_limit, --wait-limit)"
        return CosimError(f"federate {self.name}", "exchange", time, why)

    def lost(self) -> CosimError:
        error = super().lost()
        self._ended(self.name)
        if error.call != "exchange":
            error = CosimError(error.unit, error.call, error.time, f"{error.reason} (federate {self.name})")
        return error


class Federated(Elsewhere):
    """`Components` and their stepper, in several processes."""

    def __init__(
        self,
        plan: FederationPlan,
        checked: Checked,
        folders: Mapping[str, Path],
        box: MessageBox,
        folder: Path,
        limits: Limits,
    ) -> None:
        self.box, self._plan = box, plan
        self.exchange = Exchange(checked, {}, box)
        self._federates: dict[str, _Federate] = {}
        self._copies: list[tuple[Any, Any, Any, Any]] = []
        self._first: str | None = None
        self._lock = threading.Lock()
        for i, name in enumerate(plan.here):
            place = folder / f"federate_{i}"
            place.mkdir()
            part = share(checked, plan.parts[name])
            federate = _Federate(name, self._ended, part, folders, box, place, limits)
            federate.pressed = lambda: self.pressed()
            self._federates[name] = federate
            for bank, other in zip(self.exchange.banks, federate.exchange.banks, strict=True):
                pairs = [(bank.position[port], i) for port, i in other.position.items() if port[0] in part.descriptions]
                if pairs and bank.kind not in TEXTS:
                    to, of = array(pairs, intp).T
                    self._copies.append((bank.memory, to, other.memory, of))

    def load(self) -> None:
        """Start the processes, let them join each other, and load their components."""
        plan, federates = self._plan, self._federates
        for federate in federates.values():
            federate.start()
        self._take()
        address = plan.broker or federates[plan.here[0]].ask("broker", plan.core, len(plan.parts))
        for name, federate in federates.items():
            federate.post_call("join", name, plan, address, federate.content)
        self._take(joining=True)

    def initialize(self, *arguments: Any) -> None:
        """See `Components.initialize`."""
        self.box.time = arguments[0]
        self._call("initialize", *arguments)
        self._copy()

    def couple(self, *arguments: Any) -> Self:
        """See `Components.couple`."""
        self._call("couple", *arguments)
        for federate in self._federates.values():
            federate.begin()
        return self

    def advance(self, time: float, step: float, stop: float) -> None:
        """Step all components."""
        self.exchange.clock.value, self.exchange.size.value = time, step
        for federate in self._federates.values():
            federate.post_step(time, step, stop)
        self._take()
        self._copy()

    def facts(self) -> dict[str, Any]:
        """Return the summary's entries on the federates."""
        parts = self._plan.parts
        federates = {name: {"components": [*parts[name]]} | unit.facts() for name, unit in self._federates.items()}
        return {"federates": federates, "core": self._plan.core}

    def close(self) -> CosimError | None:
        """Free all, end the processes, the broker's last, and return the first failure."""
        failures = [federate.close() for federate in reversed(self._federates.values())]
        return next(filter(None, failures), None)

    def _call(self, name: str, *arguments: Any) -> None:
        for federate in self._federates.values():
            federate.post_call(name, *arguments)
        self._take()

    def _take(self, joining: bool = False) -> None:
        """Wait for all answers; raise the first failure.

        Federates report failures to each other, except while `joining`: a failure there ends all others.
        """
        failures: dict[str, VdfmuError] = {}

        def take(name: str) -> None:
            try:
                self._federates[name].take()
            except VdfmuError as error:
                failures[name] = error
                if joining and isinstance(error, CosimError) and error.call == "exchange":
                    self._ended(name)

        if joining:
            with ThreadPoolExecutor(len(self._federates)) as pool:
                list(pool.map(take, self._federates))
        else:
            for name in self._federates:
                take(name)
        if failures:
            first = self._first or next(iter(failures))
            raise failures.get(first) or self._federates[first].lost()  # it had answered before its end

    def _ended(self, name: str) -> None:
        """End the peers of an ended federate, since they wait for it; only the first call, from any thread, counts."""
        with self._lock:
            if self._first is not None:
                return
            self._first = name
            late = self._federates[name].waits
            if late:  # it waited for another federate, maybe here
                self._first = next((n for n, federate in self._federates.items() if federate.works), name)
        for other, federate in self._federates.items():
            if other != name:
                federate.cut(late and other == self._first)

    def _copy(self) -> None:
        """Copy the values of all federates to this process."""
        for memory, to, other, of in self._copies:
            memory[to] = other[of]
