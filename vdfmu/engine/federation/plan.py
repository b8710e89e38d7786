"""Which component steps in which process, and what these send each other."""

from __future__ import annotations

import sys
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from hashlib import sha256
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from vdfmu.base.errors import UsageError, VdfmuError
from vdfmu.base.text import close_to
from vdfmu.engine.fmu.description import Description, Variable
from vdfmu.engine.package.system import System
from vdfmu.engine.plan.checked import Checked
from vdfmu.engine.plan.feed import Feed
from vdfmu.engine.plan.link import SOURCE, Link, Port
from vdfmu.engine.plan.schedule import topological, variable_graph
from vdfmu.engine.results.results import Results

if TYPE_CHECKING:
    from vdfmu.engine.federation.federated import Federated

CORES = ("tcp_ss", "tcp", "zmq", "ipc")
"""Ways of HELICS to carry messages; ``tcp_ss`` needs one port, that of the broker; ``ipc``, shared memory, one machine.

Not ``zmq_ss``: exchanges of four federates stall with it in HELICS 3.6.1, for a tenth of a second each.
"""


class Sent(NamedTuple):
    """Variables that a federate sends to others, which read them: the reals, and those of other types."""

    reals: tuple[Port, ...]
    rest: tuple[Port, ...]


class Plan(NamedTuple):
    """The federates of a system."""

    parts: Mapping[str, tuple[str, ...]]
    """The components of each federate, by its name, that of its first component."""
    here: tuple[str, ...]
    """Those to run here."""
    sent: Mapping[str, Sent]
    """What each sends; of the reals those that change in steps come first."""
    levels: Mapping[Port, int]
    """How often a value passes from federate to federate before it reaches a variable in initialization mode."""
    core: str
    """As of `Federation`; so is the broker."""
    broker: str | None

    @property
    def digest(self) -> str:
        """What is the same for all federates of one run."""
        same = self.parts, self.sent, sorted(self.levels.items())
        return sha256(repr(same).encode()).hexdigest()


@dataclass(frozen=True)
class Federation:
    """How a system is split over processes, and how these find each other; parameters as of `federate`."""

    split: Sequence[str]
    only: str | None = None
    broker: str | None = None
    core: str = "tcp_ss"

    def apart(self, checked: Checked) -> tuple[Checked, Callable[..., Federated]]:
        """Return the part of a checked system that runs here, and what makes its `Federated`.

        Raises
        ------
        UsageError
            With all that is wrong with the split.
        VdfmuError
            HELICS is not installed.
        """
        if find_spec("helics") is None:
            raise VdfmuError(
                "the Python package helics, which joins the federates, is not installed. Install it: "
                f"{sys.executable} -m pip install helics"
            )
        from vdfmu.engine.federation.federated import Federated

        plan = self._plan(checked)
        return share(checked, [name for part in plan.here for name in plan.parts[part]]), partial(
            Federated, plan
        )

    def _plan(self, checked: Checked) -> Plan:
        owner: dict[str, str] = {}
        problems: list[str] = []
        groups = [tuple(name.strip() for name in text.split(",")) for text in self.split]
        for group in groups:
            for name in group:
                if name not in checked.descriptions:
                    known = close_to(name, checked.descriptions)
                    problems.append(f"split: the system has no component {name!r}{known}")
                elif name in owner:
                    problems.append(
                        f"split: {name} is named twice, for the federates {owner[name]} and {group[0]}; each "
                        "component steps in one"
                    )
                owner.setdefault(name, group[0])
        rest = tuple(name for name in checked.descriptions if name not in owner)
        owner |= dict.fromkeys(rest, rest[0] if rest else "")
        parts = {group[0]: group for group in [*groups, rest] if group}
        if not problems and len(parts) < 2:
            problems.append(
                f"split: expected at least two federates, got {', '.join(parts)}; name some of the components "
                f"{', '.join(checked.descriptions)}"
            )
        if self.only is not None and self.only not in parts and not problems:
            problems.append(
                f"no federate is named {self.only!r}; there are {', '.join(parts)}, by their first component"
            )
        if self.only is not None and self.broker is None:
            problems.append(
                f"federate {self.only} runs alone, and needs the address of a broker that the others know too: "
                "--broker HOST:PORT; 'helics_broker' starts one"
            )
        if self.core not in CORES:
            problems.append(f"core: expected {', '.join(CORES)}, got {self.core!r}")
        together = all(component.step is None for component in checked.system.components)
        problems += [
            f"{name}: has event mode, and its events are of all components at one time, which are not in one "
            "process; 'vdfmu simulate' runs it"
            for name, description in checked.descriptions.items()
            if description.event_mode and together
        ]
        if problems:
            raise UsageError("\n".join(problems))
        crossing = [k for k in checked.links if k.start[0] != SOURCE and owner[k.start[0]] != owner[k.end[0]]]
        passed = sorted([*crossing, *checked.schedule.initial.torn], key=lambda link: not link.stepped)
        sent = {name: _sent([k for k in passed if k.start[0] in part]) for name, part in parts.items()}
        here = tuple(parts) if self.only is None else (self.only,)
        return Plan(parts, here, sent, _levels(checked, crossing), self.core, self.broker)


def _sent(links: Sequence[Link]) -> Sent:
    reals, rest = (
        dict.fromkeys(k.start for k in links if (k.source.kind == "Real") == r) for r in (True, False)
    )
    return Sent(tuple(reals), tuple(rest))


def _levels(checked: Checked, crossing: Sequence[Link]) -> dict[Port, int]:
    """Return `Plan.levels`; loops are open where the initialization guesses what a connection carries."""
    ports, edges = variable_graph(checked.sources, checked.links, initial=True)
    edges -= {(link.start, link.end) for link in checked.schedule.initial.torn}
    between = {(link.start, link.end) for link in crossing}
    levels = dict.fromkeys(ports, 0)
    into: dict[Port, list[Port]] = {}
    for a, b in edges:
        into.setdefault(b, []).append(a)
    for b in topological(ports, edges):
        levels[b] = max((levels[a] + ((a, b) in between) for a in into.get(b, ())), default=0)
    return levels


def share(checked: Checked, components: Collection[str]) -> Checked:
    """Return the system of some components of a checked one: what they read of others comes from outside.

    But in its initialization, which is that of all.
    """
    links: dict[Port, Link] = {}
    outside: dict[str, Variable] = dict(checked.feed.description.variables) if checked.feed else {}
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


def federate(
    system: System | str | Path,
    split: Sequence[str],
    *,
    only: str | None = None,
    broker: str | None = None,
    core: str = "tcp_ss",
    **options: Any,
) -> Results:
    """Co-simulate a system in several processes, federates, that pass each other values by HELICS.

    Every federate steps its components with the values that the others had at the start of the step: the results are
    those of :func:`vdfmu.simulate` with ``algorithm="jacobi"``.

    Parameters
    ----------
    system : System, str or Path
        As of :func:`vdfmu.simulate`.
    split : sequence of str
        The components of each federate, such as ``["plant", "feedforward,controller"]``; those that are not named are
        one more. A federate has the name of its first component.
    only : str, optional
        The federate to run here, where others run on other machines; the results are those of its components. By
        default all run here.
    broker : str, optional
        Address, ``HOST:PORT``, of the HELICS broker that all federates know. By default one is started here, on
        loopback.
    core : str, optional
        How HELICS carries messages, one of `CORES`.
    **options : Any
        Those of :func:`vdfmu.simulate`, but for the algorithm and what belongs to others, and isolation.

    Returns
    -------
    Results
        As of :func:`vdfmu.simulate`; the summary has the ``federates``, and the wall time that each waited for others.

    Raises
    ------
    SspError, UsageError, VdfmuError
        As of :func:`vdfmu.simulate`, and for a wrong split, or if HELICS is not installed.
    CosimError
        A component failed, a federate has ended, here or elsewhere, or cannot be reached; `results` holds the rows.
    """
    from vdfmu.engine.run.master import simulate

    return simulate(system, federation=Federation(split, only, broker, core), **options)
