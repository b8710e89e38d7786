"""The process of a federate: its components, and its values for all others by HELICS.

See `vdfmu.engine.federation.federated` for the other side.
"""

from __future__ import annotations

import json
import os
import socket
import sys
from collections.abc import Callable, Collection, Generator, Mapping, Sequence
from contextlib import contextmanager, suppress
from ctypes import CDLL, RTLD_GLOBAL
from random import randrange
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np

from vdfmu.base.errors import CosimError
from vdfmu.engine.federation.federated import FederationPlan
from vdfmu.engine.fmu.access import held, shown
from vdfmu.engine.masters.components import Components
from vdfmu.engine.masters.exchange import Bank, Exchange
from vdfmu.engine.package.system import Value
from vdfmu.engine.plan.conversion import SOURCE, Link, Port
from vdfmu.engine.run.isolated_server import Server, serve

if sys.platform == "linux":
    # HELICS exposes its bundled C++ library to all libraries that are loaded later, and libraries of Python FMUs then
    # hang at their start. So the system's library is loaded first.
    with suppress(OSError):  # not installed, so not needed
        CDLL("libstdc++.so.6", RTLD_GLOBAL)

import helics as h

_QUIET = "--loglevel=no_print --tick=2s"
"""Options of brokers and cores: no log, and the interval of mutual checks; a loss is noticed after 8 s."""
_CONNECT = "--timeout=30s"
"""Time limit of a federate to find the broker."""
_FAREWELL = 2000
"""Time limit [ms] of the broker for the farewell of the federates."""


def _free_ports(number: int) -> int:
    """Return the first of some consecutive free ports below the ephemeral range."""
    while True:
        first = randrange(20_000, 32_000)
        try:
            for port in range(first, first + number):
                with socket.socket() as probe:
                    probe.bind(("127.0.0.1", port))
        except OSError:
            continue
        return first


def _loopback(core: str) -> str:
    return f"--local_interface={'tcp://' if core.startswith('zmq') else ''}127.0.0.1"


class Heard(NamedTuple):
    """Message of another federate: real values, and all other content."""

    name: str
    reals: list[float]
    said: dict[str, Any]


class HelicsLink:
    """The connection of a federate to its peers; CosimError from every method if they cannot be reached.

    The time of HELICS is a count of exchanges, so rounding of times does not matter. `core` and `address` are the
    broker's, `digest` must be the same for all federates. `waited` is the wall time of the exchanges [s].
    """

    def __init__(self, name: str, peers: Sequence[str], core: str, address: str, digest: str) -> None:
        self._digest = digest
        self.waited, self._name, self._count, self._left = 0.0, name, 0, False
        near = core != "ipc" and address.removeprefix("tcp://").startswith(("127.", "localhost"))
        place = f"--broker_address={address} {_loopback(core) if near else ''}"
        info = h.helicsCreateFederateInfo()
        h.helicsFederateInfoSetCoreTypeFromString(info, core)
        h.helicsFederateInfoSetCoreInitString(info, f"--federates=1 {_QUIET} {_CONNECT} {place}")
        h.helicsFederateInfoSetTimeProperty(info, h.HELICS_PROPERTY_TIME_PERIOD, 1.0)
        h.helicsFederateInfoSetFlagOption(info, h.HELICS_FLAG_UNINTERRUPTIBLE, True)
        h.helicsFederateInfoSetIntegerProperty(info, h.HELICS_PROPERTY_INT_LOG_LEVEL, h.HELICS_LOG_LEVEL_NO_PRINT)
        try:
            self._federate = federate = h.helicsCreateValueFederate(name, info)
            topics = {"values": h.HELICS_DATA_TYPE_VECTOR, "said": h.HELICS_DATA_TYPE_STRING}
            self._values, self._words = (
                h.helicsFederateRegisterGlobalPublication(federate, f"{name}/{topic}", kind, "")
                for topic, kind in topics.items()
            )
            self._inputs = {
                peer: [h.helicsFederateRegisterSubscription(federate, f"{peer}/{topic}", "") for topic in topics]
                for peer in peers
            }
            h.helicsFederateEnterExecutingMode(federate)
        except h.HelicsException as error:
            raise self._failure(0.0, f"no broker answers at {address}, or a federate is missing: {error}") from None
        cores = h.helicsQueryExecute(h.helicsCreateQuery("root", "federate_map"), federate)["cores"]
        self._cores = {str(c["attributes"]["id"]): f["attributes"]["name"] for c in cores for f in c["federates"]}

    def _failure(self, time: float, why: str) -> CosimError:
        return CosimError(f"federate {self._name}", "exchange", time, why)

    def swap(self, time: float, reals: list[float], said: dict[str, Any]) -> list[Heard]:
        """Send values at a time [s], and return the peers' values; CosimError if a peer has failed or left."""
        began = perf_counter()
        self._count += 1
        try:
            self._say([time, *reals], said | ({"digest": self._digest} if self._count == 1 else {}))
            granted = h.helicsFederateRequestTime(self._federate, float(self._count))
            heard: list[Heard] = []
            for peer, (values, words) in self._inputs.items():
                said = json.loads(h.helicsInputGetString(words)) if h.helicsInputIsUpdated(words) else {}
                heard.append(Heard(peer, h.helicsInputGetVector(values), said))
        except h.HelicsException as error:
            self._left, text = True, str(error)
            for number, name in self._cores.items():
                text = text.replace(number, f"federate {name}")
            raise self._failure(time, f"the others cannot be reached any more: {text}") from None
        for peer, values, words in heard:
            if "failed" in words:
                match words["failed"]:
                    case [str(unit), str(call), int() | float() as at, str(reason)]:
                        raise CosimError(unit, call, at, reason)
                    case _:
                        raise self._failure(time, f"federate {peer} failed, and its reason cannot be read")
            if "left" in words:
                raise self._failure(time, f"federate {peer} left the run")
            if granted != self._count or values[:1] != [time] or words.get("digest", self._digest) != self._digest:
                at = f"is at t = {values[0]:.9g} s" if values else "has sent nothing"
                expected = "expected the same package, split, start, stop and step for all"
                raise self._failure(time, f"federate {peer} {at}, or runs something else; {expected}")
        self.waited += perf_counter() - began
        return [Heard(peer, values[1:], words) for peer, values, words in heard]

    def _say(self, values: list[float], said: dict[str, Any]) -> None:
        h.helicsPublicationPublishVector(self._values, values)
        if said:
            h.helicsPublicationPublishString(self._words, json.dumps(said))

    def leave(self, said: dict[str, Any]) -> None:
        """Leave the peers once, with a reason."""
        if not self._left:
            self._left = True
            try:
                self._say([], said)
                h.helicsFederateDisconnect(self._federate)
            except h.HelicsException:  # the peers are gone
                pass


class _FederateExchange(Exchange):
    """Exchange between the components of a federate; in initialization mode, between all components."""

    levels: Mapping[Port, int]
    heard: Mapping[Port, Any]
    swap: Callable[[float, Collection[Port]], None]
    """Sends all values, new ones for some variables, and waits for the peers' values in `heard`."""

    def initialize(self, time: float, convergence: float) -> None:
        """See `Exchange.initialize`: all federates do the same, each with its components and its peers' values."""
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
    """Runs in the process of a federate: steps its components and exchanges values with its peers."""

    components = _FederateComponents
    _broker: Any = None
    _link: HelicsLink | None = None

    def broker(self, core: str, federates: int) -> str:
        """Start a broker in this process, on loopback; return its address."""
        name = f"vdfmu_{os.getpid()}"
        ports = "" if core == "ipc" else f"--port={_free_ports(2 * federates + 2)} "
        place = f"{ports}{_loopback(core)}" if ports else f"--local_interface={name}"
        self._broker = h.helicsCreateBroker(core, name, f"--federates={federates} {_QUIET} {place}")
        return h.helicsBrokerGetAddress(self._broker)

    def join(self, name: str, plan: FederationPlan, address: str, start: bytes) -> None:
        """Join the peers, and load the components in `start`."""
        self._plan, self._sent = plan, plan.sent[name]
        self._heard: dict[Port, Any] = {}
        peers = {peer: sent for peer, sent in plan.sent.items() if peer != name}
        self._link = HelicsLink(name, list(peers), plan.core, address, plan.digest)
        with self._announced():
            self.load(start)
        exchange = self._components.exchange
        assert isinstance(exchange, _FederateExchange)
        exchange.running.value = 0  # no component runs while peers load theirs
        exchange.levels, exchange.swap, exchange.heard = plan.levels, self._settle, self._heard
        position = exchange.banks[0].position
        self._places = np.array([position[port] for port in self._sent.reals if port in position], np.intp)
        self._reals = np.zeros(len(self._sent.reals))
        self._rest: list[Any] = [0] * len(self._sent.rest)
        self._sent_rest: list[Any] = []
        self._read = {
            peer: [(p, *place) for p in (*sent.reals, *sent.rest) for place in self._place((SOURCE, ".".join(p)))]
            for peer, sent in peers.items()
        }
        """Variables of each peer that are read here, with the places of their values."""

    def _place(self, port: Port) -> list[tuple[Bank, int]]:
        """Return the place of the value of a variable, if it is here."""
        return [(bank, bank.position[port]) for bank in self._components.exchange.banks if port in bank.position]

    def initialize(self, *arguments: Any) -> None:
        """See `Components.initialize`; receives the peers' outputs as well."""
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
        """Step the components, and exchange outputs with the peers."""
        with self._announced():
            super().advance(time, step, stop)
            self._exchange(stop)

    def _exchange(self, time: float) -> None:
        self._reals[: self._places.size] = self._components.exchange.banks[0].memory[self._places]
        for i, port in enumerate(self._sent.rest):
            for bank, at in self._place(port):
                self._rest[i] = shown(bank.kind, bank.memory[at])
        self._swap(time)

    def _swap(self, time: float) -> None:
        assert self._link is not None
        exchange = self._components.exchange
        exchange.running.value = 0  # no component runs
        said: dict[str, Any] = {"ended": self._box.ended} if self._box.ended else {}
        if self._rest != self._sent_rest:
            self._sent_rest = self._rest[:]
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
        """Report a failure to the peers."""
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
        """Return the facts of the stepper, and the wall time of exchanges [s]."""
        return self._stepper.facts() | {"waited_s": self._link.waited if self._link else 0.0}

    def close(self, time: float) -> list[Any] | None:
        """See `Components.close`; leave the peers first."""
        if self._link is not None:
            self._link.leave({"left": True})
        failure = super().close(time) if hasattr(self, "_components") else None
        if self._broker is not None:
            h.helicsBrokerWaitForDisconnect(self._broker, _FAREWELL)
            h.helicsBrokerDisconnect(self._broker)
        return failure


if __name__ == "__main__":
    serve(FederateServer, *sys.argv[1:])
    os._exit(0)  # skips the shutdown of loaded libraries, in which some processes die
