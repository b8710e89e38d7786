"""A federate of HELICS: at each exchange it sends its values to all others and waits for theirs."""

from __future__ import annotations

import json
import os
import socket
import sys
from collections.abc import Sequence
from contextlib import suppress
from ctypes import CDLL, RTLD_GLOBAL
from random import randrange
from time import perf_counter
from typing import Any, NamedTuple

from vdfmu.base.errors import CosimError

if sys.platform == "linux":
    # HELICS exposes its bundled C++ library to all libraries that are loaded later; those of Python FMUs then hang when
    # they start. So the system's library is loaded first.
    with suppress(OSError):  # there is none, so nothing needs it
        CDLL("libstdc++.so.6", RTLD_GLOBAL)

import helics as h

_QUIET = "--loglevel=no_print --tick=2s"
"""Options of brokers and cores: no log, and how often they check on each other; a lost one is noticed after 8 s."""
_CONNECT = "--timeout=30s"
"""Time that a federate has to find the broker."""
_FAREWELL = 2000
"""Time [ms] that the broker waits for federates to leave."""


def start_broker(core: str, federates: int) -> tuple[Any, str]:
    """Start a broker in this process, on loopback; return it and its address."""
    name = f"vdfmu_{os.getpid()}"
    if core == "ipc":
        place = f"--local_interface={name}"
    else:
        place = f"--port={_free_ports(2 * federates + 2)} {_loopback(core)}"
    broker = h.helicsCreateBroker(core, name, f"--federates={federates} {_QUIET} {place}")
    return broker, h.helicsBrokerGetAddress(broker)


def _free_ports(number: int) -> int:
    """Return the first of some consecutive free ports, below the range that systems assign to connections."""
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
    """Message of another federate: the time and the reals, and everything else it said."""

    name: str
    reals: list[float]
    said: dict[str, Any]


class HelicsLink:
    """The connection of a federate to all others; CosimError from every method if they cannot be reached.

    The time of HELICS is a count of exchanges, so rounding of times does not matter. `core` and `address` are the
    broker's, `digest` must be the same for all federates. `waited` is the wall time [s] that the exchanges took.
    """

    def __init__(self, name: str, others: Sequence[str], core: str, address: str, digest: str) -> None:
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
            self._values, self._words = (
                h.helicsFederateRegisterGlobalPublication(federate, f"{name}/{what}", kind, "")
                for what, kind in (("values", h.HELICS_DATA_TYPE_VECTOR), ("said", h.HELICS_DATA_TYPE_STRING))
            )
            self._inputs = {
                other: [
                    h.helicsFederateRegisterSubscription(federate, f"{other}/{what}", "") for what in ("values", "said")
                ]
                for other in others
            }
            h.helicsFederateEnterExecutingMode(federate)
        except h.HelicsException as error:
            raise self._failure(0.0, f"there is no broker at {address}, or not all have joined: {error}") from None
        self._cores = _names_of_cores(federate)

    def _failure(self, time: float, why: str) -> CosimError:
        return CosimError(f"federate {self._name}", "exchange", time, why)

    def swap(self, time: float, reals: list[float], said: dict[str, Any]) -> list[Heard]:
        """Send values at a time [s], and return all others' values; raise CosimError if one has failed or left."""
        began = perf_counter()
        self._count += 1
        try:
            self._say([time, *reals], said | ({"digest": self._digest} if self._count == 1 else {}))
            granted = h.helicsFederateRequestTime(self._federate, float(self._count))
            heard: list[Heard] = []
            for other, (values, words) in self._inputs.items():
                said = json.loads(h.helicsInputGetString(words)) if h.helicsInputIsUpdated(words) else {}
                heard.append(Heard(other, h.helicsInputGetVector(values), said))
        except h.HelicsException as error:
            self._left = True
            raise self._failure(time, f"the others cannot be reached any more: {self._named(str(error))}") from None
        for other, values, words in heard:
            if "failed" in words:
                match words["failed"]:
                    case [str(unit), str(call), int() | float() as at, str(reason)]:
                        raise CosimError(unit, call, at, reason)
                    case _:
                        raise self._failure(time, f"federate {other} failed, and what it said of it cannot be read")
            if "left" in words:
                raise self._failure(time, f"federate {other} left the run")
            if granted != self._count or values[:1] != [time] or words.get("digest", self._digest) != self._digest:
                at = f"is at t = {values[0]:.9g} s" if values else "has said nothing"
                raise self._failure(
                    time,
                    f"federate {other} {at}, or runs something else; expected the same package, split, start, stop and "
                    "step for all",
                )
        self.waited += perf_counter() - began
        return [Heard(other, values[1:], words) for other, values, words in heard]

    def _say(self, values: list[float], said: dict[str, Any]) -> None:
        h.helicsPublicationPublishVector(self._values, values)
        if said:
            h.helicsPublicationPublishString(self._words, json.dumps(said))

    def leave(self, said: dict[str, Any]) -> None:
        """Leave the others, with a reason; do nothing if already done."""
        if not self._left:
            self._left = True
            try:
                self._say([], said)
                h.helicsFederateDisconnect(self._federate)
            except h.HelicsException:  # they have gone
                pass

    def _named(self, text: str) -> str:
        """Return a message of HELICS with the numbers of cores replaced by the names of their federates."""
        for number, name in self._cores.items():
            text = text.replace(number, f"federate {name}")
        return text


def _names_of_cores(federate: Any) -> dict[str, str]:
    found = h.helicsQueryExecute(h.helicsCreateQuery("root", "federate_map"), federate)
    return {
        str(core["attributes"]["id"]): each["attributes"]["name"]
        for core in found["cores"]
        for each in core["federates"]
    }


def end_broker(broker: Any) -> None:
    """End a broker, after the others have left it."""
    h.helicsBrokerWaitForDisconnect(broker, _FAREWELL)
    h.helicsBrokerDisconnect(broker)
