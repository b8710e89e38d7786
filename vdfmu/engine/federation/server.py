"""The process of a federate; see `vdfmu.engine.federation.federated`."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Collection, Generator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np

from vdfmu.base.errors import CosimError
from vdfmu.engine.federation.helics_link import HelicsLink, end_broker, start_broker
from vdfmu.engine.federation.plan import FederationPlan
from vdfmu.engine.fmu.access import held, shown
from vdfmu.engine.masters.components import Components
from vdfmu.engine.masters.exchange import Bank, Exchange
from vdfmu.engine.package.system import Value
from vdfmu.engine.plan.conversion import SOURCE, Link, Port
from vdfmu.engine.run.isolated_server import Server, serve


class _FederateExchange(Exchange):
    """Exchange between the components of a federate; in initialization mode, between the components of all."""

    levels: Mapping[Port, int]
    heard: Mapping[Port, Any]
    swap: Callable[[float, Collection[Port]], None]
    """Sends all values, new ones for some variables, and waits for the others' values, which are then in `heard`."""

    def initialize(self, time: float, convergence: float) -> None:
        """See `Exchange.initialize`: all federates do the same, each with its own components and the others' values."""
        self._time = time
        self.swap(time, [link.start for link in self.checked.schedule.initial.torn])
        super().initialize(time, convergence)

    def _pass(self, links: Sequence[Link], torn: Sequence[Link] = ()) -> None:
        super()._pass([], [link for link in torn if link.end[0] in self.instances])
        for level in range(max(self.levels.values(), default=0) + 1):
            now = [link for link in links if self.levels[link.end] == level]
            super()._pass([link for link in now if link.end[0] in self.instances])
            self.swap(self._time, {port for port, its in self.levels.items() if its == level})

    def _source(self, link: Link) -> Any:
        outside = link.start[0] == SOURCE or link.start[0] in self.instances
        return super()._source(link) if outside else self.heard[link.start]

    def _carry(self, link: Link, value: Value) -> None:
        if link.end[0] in self.instances:
            super()._carry(link, value)


class _FederateComponents(Components):
    exchanges = _FederateExchange


class FederateServer(Server):
    """Runs in the process of a federate: steps its components and exchanges values with the others."""

    components = _FederateComponents
    _broker: Any = None
    _link: HelicsLink | None = None

    def broker(self, core: str, federates: int) -> str:
        """Start a broker; return its address."""
        self._broker, address = start_broker(core, federates)
        return address

    def join(self, name: str, plan: FederationPlan, address: str, start: bytes) -> None:
        """Join the others, and load what `start` holds."""
        self._plan, self._sent = plan, plan.sent[name]
        self._heard: dict[Port, Any] = {}
        others = {other: sent for other, sent in plan.sent.items() if other != name}
        self._link = HelicsLink(name, list(others), plan.core, address, plan.digest)
        with self._announced():
            self.load(start)
        exchange = self._components.exchange
        assert isinstance(exchange, _FederateExchange)
        exchange.running.value = 0  # no component, while others load theirs
        exchange.levels, exchange.swap, exchange.heard = plan.levels, self._settle, self._heard
        position = exchange.banks[0].position
        self._own = np.array([position[port] for port in self._sent.reals if port in position], np.intp)
        self._reals = np.zeros(len(self._sent.reals))
        self._rest: list[Any] = [0] * len(self._sent.rest)
        self._known: list[Any] = []
        self._read = {other: self._places((*sent.reals, *sent.rest)) for other, sent in others.items()}

    def _place(self, port: Port) -> tuple[Bank, int] | None:
        """Return where the value of a variable is; None if it is not here."""
        banks = self._components.exchange.banks
        return next(((bank, bank.position[port]) for bank in banks if port in bank.position), None)

    def _places(self, ports: Sequence[Port]) -> list[tuple[Port, Bank, int]]:
        """Return which variables of another federate are read here, and where their values go."""
        found = [(port, self._place((SOURCE, ".".join(port)))) for port in ports]
        return [(port, *place) for port, place in found if place is not None]

    def initialize(self, *arguments: Any) -> None:
        """See `Components.initialize`; afterwards the others' outputs are here, too."""
        with self._announced():
            self._components.initialize(*arguments)
            self._exchange(arguments[0])

    def _settle(self, time: float, new: Collection[Port]) -> None:
        """Exchange values in initialization mode; some are `new`."""
        components = self._components
        for ports, values in ((self._sent.reals, self._reals), (self._sent.rest, self._rest)):
            for i, (unit, name) in enumerate(ports):
                if (unit, name) in new:
                    variable = components.checked.descriptions[unit].variables[name]
                    values[i] = components.instances[unit].get(variable)
        self._swap(time)

    def advance(self, time: float, step: float, stop: float) -> None:
        """Step the components, and exchange their outputs with the others."""
        with self._announced():
            super().advance(time, step, stop)
            self._exchange(stop)

    def _exchange(self, time: float) -> None:
        """Send the outputs and receive the others' outputs."""
        self._reals[: self._own.size] = self._components.exchange.banks[0].memory[self._own]
        for i, port in enumerate(self._sent.rest):
            if (place := self._place(port)) is not None:
                bank, at = place
                self._rest[i] = shown(bank.kind, bank.memory[at])
        self._swap(time)

    def _swap(self, time: float) -> None:
        assert self._link is not None
        exchange = self._components.exchange
        exchange.running.value = 0  # no component
        said: dict[str, Any] = {"ended": self._box.ended} if self._box.ended else {}
        if self._rest != self._known:
            self._known = self._rest[:]
            said["values"] = [{"bytes": x.decode("latin-1")} if isinstance(x, bytes) else x for x in self._rest]
        for name, reals, words in self._link.swap(time, self._reals.tolist(), said):
            sent, values = self._plan.sent[name], words.get("values", ())
            rest = [x["bytes"].encode("latin-1") if isinstance(x, dict) else x for x in values]
            self._heard |= zip((*sent.reals[: len(reals)], *sent.rest[: len(rest)]), (*reals, *rest), strict=True)
            for port, bank, at in self._read[name]:
                if bank.kind == "Real" or rest:
                    bank.memory[at] = held(bank.kind, self._heard[port])
            self._box.ended.update(words.get("ended", {}))

    @contextmanager
    def _announced(self) -> Generator[None]:
        """Tell the others of a failure."""
        assert self._link is not None
        try:
            yield
        except CosimError as error:
            self._link.leave({"failed": error.args[:4]})
            raise
        except BaseException:
            self._link.leave({"left": True})
            raise

    def facts(self) -> dict[str, Any]:
        """Return the wall time spent waiting for the others."""
        return self._stepper.facts() | {"waited_s": self._link.waited if self._link else 0.0}

    def close(self, time: float) -> list[Any] | None:
        """See `Components.close`; leave the others first."""
        if self._link is not None:
            self._link.leave({"left": True})
        failure = super().close(time) if hasattr(self, "_components") else None
        if self._broker is not None:
            end_broker(self._broker)
        return failure


if __name__ == "__main__":
    serve(FederateServer, *sys.argv[1:])
    os._exit(0)  # skips the shutdown of loaded libraries, in which some processes die
