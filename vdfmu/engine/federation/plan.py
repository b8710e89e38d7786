"""Split of a system over processes, and values between them."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from hashlib import sha256
from typing import NamedTuple

from vdfmu.engine.fmu.description import Description, FmuVariable
from vdfmu.engine.plan.check import Checked
from vdfmu.engine.plan.conversion import SOURCE, Link, Port
from vdfmu.engine.plan.feed import Feed
from vdfmu.engine.plan.graph import ranks
from vdfmu.engine.plan.schedule import variable_graph


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
    nothing: dict[str, frozenset[str] | None] = dict.fromkeys(outside, frozenset())
    source = Description("", "", "", False, outside, nothing, nothing)
    return replace(
        checked,
        descriptions={name: d for name, d in checked.descriptions.items() if name in components},
        links=tuple(links.values()),
        schedule=replace(checked.schedule, units=tuple(u for u in checked.schedule.units if u in components)),
        starts={name: values for name, values in checked.starts.items() if name in components},
        feed=Feed(checked.feed.courses if checked.feed else (), source, (), ()) if outside else None,
    )
