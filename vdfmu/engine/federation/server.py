"""The process of a federate; see `vdfmu.engine.federation.federated`."""

from __future__ import annotations

import sys
from collections.abc import Callable, Generator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np

from vdfmu.engine.cosim.bank import Bank
from vdfmu.engine.cosim.components import Components
from vdfmu.engine.cosim.isolated_server import Server, serve
from vdfmu.engine.cosim.link import SOURCE, Link, Port
from vdfmu.engine.federation.helics_link import HelicsLink, end_broker, start_broker
from vdfmu.engine.federation.plan import Plan
from vdfmu.errors import CosimError


class _Share(Components):
    """The components of a federate, whose initialization waits for that of others."""

    settled: Callable[[float, float], None]

    def settle(self, time: float, convergence: float) -> None:
        self.settled(time, convergence)


class FederateServer(Server):
    """What runs in the process of a federate: steps of its components, and exchanges with the others."""

    components = _Share
    _broker: Any = None
    _link: HelicsLink | None = None

    def broker(self, core: str, federates: int) -> str:
        """Start a broker; return its address."""
        self._broker, address = start_broker(core, federates)
        return address

    def join(self, name: str, plan: Plan, address: str, start: bytes) -> None:
        """Join the others, and load what `start` holds."""
        self._plan, self._sent = plan, plan.sent[name]
        others = {other: sent for other, sent in plan.sent.items() if other != name}
        self._link = HelicsLink(name, list(others), plan.core, address)
        with self._announced():
            self.load(start)
            assert isinstance(self._components, _Share)
            self._components.settled = self._settle
        position = self._components.exchange.banks[0].position
        self._own = np.array([position[port] for port in self._sent.reals if port in position], np.intp)
        self._reals = np.zeros(len(self._sent.reals))
        self._rest: list[Any] = [0] * len(self._sent.rest)
        self._known: list[Any] = []
        self._read = {other: (self._places(sent.reals), self._places(sent.rest)) for other, sent in others.items()}

    def _place(self, port: Port) -> tuple[Bank, int] | None:
        """Return where the value of a variable is; None if it is not here."""
        banks = self._components.exchange.banks
        return next(((bank, bank.position[port]) for bank in banks if port in bank.position), None)

    def _places(self, ports: tuple[Port, ...]) -> list[tuple[int, Bank, int]]:
        """Return which of the variables of another federate are read here, and where their values go."""
        found = [(i, self._place((SOURCE, ".".join(port)))) for i, port in enumerate(ports)]
        return [(i, *place) for i, place in found if place is not None]

    def initialize(self, *arguments: Any) -> None:
        """See `Components.initialize`; the outputs of others are here then."""
        with self._announced():
            super().initialize(*arguments)
            self._exchange(arguments[0])

    def _settle(self, time: float, convergence: float) -> None:
        """Carry values over connections in initialization mode, each after those of the others that it depends on."""
        exchange, checked, levels = self._components.exchange, self._components.checked, self._plan.levels
        initial, slaves = checked.schedule.initial, self._components.slaves
        for level in range(max(levels.values(), default=0) + 1):

            def now(link: Link, level: int = level) -> bool:
                return levels[link.end] == level

            torn = [pair for pair in zip(initial.torn, initial.loops, strict=True) if now(pair[0])]
            part = replace(
                initial,
                links=tuple(filter(now, initial.links)),
                torn=tuple(link for link, _ in torn),
                loops=tuple(loop for _, loop in torn),
            )
            exchange.checked = replace(checked, schedule=replace(checked.schedule, initial=part))
            exchange.initialize(time, convergence)
            for ports, values in ((self._sent.reals, self._reals), (self._sent.rest, self._rest)):
                for i, (unit, name) in enumerate(ports):
                    if levels[unit, name] == level:
                        values[i] = slaves[unit].get(checked.descriptions[unit].variables[name])
            self._swap(time)
        exchange.checked = checked

    def advance(self, time: float, step: float, stop: float) -> None:
        """Step the components, and exchange their outputs with the others."""
        with self._announced():
            super().advance(time, step, stop)
            self._exchange(stop)

    def _exchange(self, time: float) -> None:
        """Send the outputs and take those of the others."""
        self._reals[: self._own.size] = self._components.exchange.banks[0].memory[self._own]
        for i, port in enumerate(self._sent.rest):
            if (place := self._place(port)) is not None:
                bank, at = place
                self._rest[i] = bank.heap.value(bank.kind, bank.memory[at])
        self._swap(time)

    def _swap(self, time: float) -> None:
        assert self._link is not None
        exchange = self._components.exchange
        exchange.running.value = 0  # no component
        said: dict[str, Any] = {"ended": self._box.ended} if self._box.ended else {}
        rest = [value.decode("latin-1") if isinstance(value, bytes) else value for value in self._rest]
        if rest != self._known:
            self._known = said["values"] = rest
        for heard in self._link.swap(time, self._reals.tolist(), said):
            reals, others = self._read[heard.name]
            for i, bank, at in reals:
                bank.memory[at] = heard.reals[i]
            for i, bank, at in others if "values" in heard.said else ():
                value = heard.said["values"][i]
                value = value.encode("latin-1") if bank.kind == "Binary" else value
                bank.memory[at] = bank.heap.number(bank.kind, value)
            self._box.ended.update(heard.said.get("ended", {}))

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
        """Return the wall time that the federate waited for the others."""
        return super().facts() | {"waited_s": self._link.waited if self._link else 0.0}

    def close(self, time: float) -> list[Any] | None:
        """See `Components.close`; leave the others before."""
        if self._link is not None:
            self._link.leave({"left": True})
        failure = super().close(time) if hasattr(self, "_components") else None
        if self._broker is not None:
            end_broker(self._broker)
        return failure


if __name__ == "__main__":
    serve(FederateServer, *sys.argv[1:])
