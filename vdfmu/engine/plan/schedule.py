"""The order of initialization and of the steps, from the declared dependencies of the units."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

from vdfmu.engine.algorithms import ALGORITHMS, DEFAULT, DELAYED, choice
from vdfmu.engine.fmu.description import Description
from vdfmu.engine.plan.conversion import SOURCE, Link, Port
from vdfmu.engine.plan.graph import cycles, topological

_BETWEEN = "\0"
"""First character of a port between inputs and outputs, see `variable_graph`; no variable's name contains it."""


class Initial(NamedTuple):
    """The order of connections in initialization mode."""

    links: tuple[Link, ...]
    torn: tuple[Link, ...]
    """Connections that close an algebraic loop, so their values are guessed."""
    loops: tuple[str, ...]
    """The cycle of each of them, for messages."""


class Schedule(NamedTuple):
    """The order of a run."""

    initial: Initial
    units: tuple[str, ...]
    """The components in the order of their doStep."""
    fresh: frozenset[Port]
    """Inputs that get their source's value of the same step. Other inputs (with a continuous algorithm, other discrete
    inputs) get its value at the start of the step."""
    through: frozenset[Port] = frozenset()
    """Connected inputs with direct feedthrough to an output that another unit reads; to any output if none is read."""
    direct: frozenset[Port] = frozenset()
    """Outputs that depend directly on a connected input."""
    blocks: tuple[tuple[str, ...], ...] = ()
    """The components in blocks that depend on each other, for continuous algorithms."""
    groups: tuple[tuple[str, ...], ...] = ()
    """Model-exchange components that depend on each other within a step, so they are integrated as one."""


def choose_schedule(
    descriptions: Mapping[str, Description], links: Sequence[Link], algorithm: str | None
) -> tuple[str, Schedule, list[str], list[str]]:
    """Order a system for an algorithm; for None, `DEFAULT`, or `DELAYED` if only undeclared dependencies forbid that.

    Returns the algorithm, the schedule, problems as from `make_schedule`, and notes.
    """
    schedule, problems = make_schedule(descriptions, links, algorithm or DEFAULT)
    if algorithm is not None or not problems:
        return algorithm or DEFAULT, schedule, problems, _late(descriptions, links, algorithm or DEFAULT)
    declared = {
        unit: replace(each, step_dependencies={k: v or frozenset() for k, v in each.step_dependencies.items()})
        for unit, each in descriptions.items()
    }
    if make_schedule(declared, links, DEFAULT)[1]:
        return DEFAULT, schedule, problems, []
    more = f" (and {len(problems) - 1} more)" if problems[1:] else ""
    note = f"the master is {DELAYED}: {DEFAULT}, the default, has no order for this system. {problems[0]}{more}"
    return DELAYED, make_schedule(descriptions, links, DELAYED)[0], [], [note]


def _late(descriptions: Mapping[str, Description], links: Sequence[Link], algorithm: str) -> list[str]:
    """Return notes on components that only `DEFAULT` would integrate as one."""
    if ALGORITHMS[algorithm].ordered or ALGORITHMS[algorithm].repeats:
        return []
    return [
        f"{', '.join(group)}: depend on each other within a step; {algorithm} passes their outputs on a step late or "
        f"as predicted, so they may be far off or unstable; {DEFAULT} integrates them as one"
        for group in make_schedule(descriptions, links, DEFAULT)[0].groups
    ]


def make_schedule(
    descriptions: Mapping[str, Description], links: Sequence[Link], algorithm: str
) -> tuple[Schedule, list[str]]:
    """Order a system; `descriptions` are in the order of the SSD.

    FMI 2.0 forbids reading outputs between setting an input and doStep, so a controller computes its output for
    [t_k, t_k+1] in its own doStep from t_k, with the inputs at t_k. Hence:

    ordered algorithms
        An output that depends on a connected input (feedthrough) is passed on *fresh*: readers get its value of the
        same step. Any other output (the state of a plant, a trajectory) is passed on as at t_k, to all readers. Units
        with feedthrough come first, each after the sources of its fresh inputs, then the other units, all else in the
        order of the SSD. Components of model exchange that read each other's fresh outputs are integrated as one.
        Sampled control is delayed only by its zero-order hold.
    other algorithms
        Every input is the output at t_k. Feedthrough costs one more step of delay.
    continuous algorithms
        Every continuous input ramps over the step to the value of its source at t_k+1, computed or predicted (see
        `vdfmu.engine.masters.continuous`). A discrete input holds its value at t_k, unless it feeds through and comes
        from a component. Units step after their sources; blocks of units that read each other are ordered as above.

    Returns the schedule, and a problem for each algebraic loop in the steps of an ordered algorithm, with its cycle.
    Other algorithms break loops by delay or prediction, or solve them. Loops of the initialization are solved.
    """
    problems: list[str] = []
    ports, edges = variable_graph(descriptions, links, initial=True)
    torn = _tear(ports, edges, links)
    rank = {port: i for i, port in enumerate(topological(ports, edges))}
    order = sorted(links, key=lambda link: rank.get(link.end, 0))
    initial = Initial(
        tuple(k for k in order if k.end not in torn),
        tuple(link for link, _ in torn.values()),
        tuple(_loop_message(cycle, descriptions) for _, cycle in torn.values()),
    )
    ordered = ALGORITHMS[algorithm].ordered
    if ordered:
        for _, cycle in cycles(*variable_graph(descriptions, links, initial=False)):
            problems.append(
                f"algebraic loop in the steps: {_loop_message(cycle, descriptions)}; {DELAYED} breaks it by the "
                f"delay of a step, {choice(repeats=True)} solves it"
            )

    needs = _Needs(descriptions, (link for link in links if link.stepped), False)
    read = {
        (unit, output): needs.of(unit, output)
        for unit, description in descriptions.items()
        for output in [v.name for v in description.named("output")]
    }
    through = _through(read, {k.start for k in links if k.stepped})
    direct = frozenset(output for output, names in read.items() if names)
    feeding = {k.start[0] for k in links if k.start in direct}
    if ALGORITHMS[algorithm].continuous:
        stepped = [k for k in links if k.stepped]
        internal = [k for k in stepped if k.start[0] != SOURCE]
        fresh = _fresh_discrete(list(descriptions), internal, through)
        blocks = _blocks(list(descriptions), [k for k in stepped if not k.discrete or k.end in fresh], feeding)
        names = tuple(name for block in blocks for name in block)
        return Schedule(initial, names, fresh, through, direct, blocks), problems
    fresh = [k for k in links if ordered and k.stepped and read[k.start]]
    names = sorted(descriptions, key=lambda name: name not in feeding) if ordered else list(descriptions)
    unit_edges = {(k.start[0], k.end[0]) for k in fresh}
    groups: dict[str, tuple[str, ...]] = {}
    fix = f"{DELAYED}, or {choice(repeats=True)}"
    if not problems:
        joined = _joined(descriptions, links)
        for part, cycle in cycles(names, unit_edges):
            if joined.keys() >= set(part):
                group = tuple(name for name in names if name in joined[part[0]])
                groups |= dict.fromkeys(group, group)
                inner = (k for k in links if k.stepped and {k.start[0], k.end[0]} <= set(group))
                problems += [
                    f"{k}: is of type {k.source.type}, but must be real, because {', '.join(group)} depend on each "
                    f"other within a step and are integrated together; use {fix}"
                    for k in inner
                    if {k.source.kind, k.sink.kind} != {"Real"}
                ]
                continue
            joins = [next(str(k) for k in fresh if (k.start[0], k.end[0]) == pair) for pair in pairwise(cycle)]
            problems.append(
                f"{algorithm} cannot order {', '.join(cycle[:-1])}: each must step before the next although "
                f"no variable depends on itself ({'; '.join(joins)}); use {DELAYED}, or split a unit"
            )
    blocks = {name: groups.get(name, (name,)) for name in names}
    listed = list(dict.fromkeys(blocks.values()))
    between = {(blocks[a], blocks[b]) for a, b in unit_edges if blocks[a] != blocks[b]}
    for _, cycle in () if problems else cycles(listed, between):
        listed_blocks = " and ".join(", ".join(block) for block in cycle[:-1])
        problems.append(
            f"{algorithm} cannot order {listed_blocks}: components that are integrated together read outputs within a "
            f"step that depend on them; use {fix}"
        )
    units = tuple(name for block in (listed if problems else topological(listed, between)) for name in block)
    ends = {k.end for k in fresh} | {k.end for k in links if k.stepped and k.end[0] in groups.get(k.start[0], ())}
    together = tuple(dict.fromkeys(groups.values()))
    return Schedule(initial, units, frozenset(ends), through, direct, groups=together), problems


def _joined(descriptions: Mapping[str, Description], links: Sequence[Link]) -> dict[str, list[str]]:
    """Return the components of model exchange that read each other, each with its group.

    Outputs that are states count too, because in a group no value is held over a step.
    """
    names = [name for name, description in descriptions.items() if description.exchange]
    edges = {(k.start[0], k.end[0]) for k in links if k.stepped and {k.start[0], k.end[0]} <= set(names)}
    return {name: part for part, _ in cycles(names, edges) for name in part}


def _through(read: Mapping[Port, Sequence[str]], starts: set[Port]) -> frozenset[Port]:
    """Return inputs with feedthrough to an output that another unit reads, or to any output if none is read.

    Outputs that no unit reads must not affect how other outputs are computed.
    """
    coupled = {unit for unit, _ in starts}
    shared = {
        (unit, id(names)): names
        for (unit, output), names in read.items()
        if unit not in coupled or (unit, output) in starts
    }
    return frozenset((unit, name) for (unit, _), names in shared.items() for name in names)


def _fresh_discrete(names: Sequence[str], links: Sequence[Link], through: frozenset[Port]) -> frozenset[Port]:
    """Return the discrete inputs with feedthrough: they get the value at the end of the step.

    Inputs in a loop within the step are excluded, because a switch in such a loop might not settle.
    """
    edges = {(k.start[0], k.end[0]) for k in links if not k.discrete or k.end in through}
    loop_of = {name: i for i, (part, _) in enumerate(cycles(names, edges)) for name in part}
    apart = [k for k in links if k.start[0] not in loop_of or loop_of[k.start[0]] != loop_of.get(k.end[0])]
    return frozenset(k.end for k in apart if k.discrete and k.end in through)


def _blocks(names: Sequence[str], links: Sequence[Link], feeding: set[str]) -> tuple[tuple[str, ...], ...]:
    """Group units that read each other into blocks, in the order of the data flow.

    Within a block the `feeding` units, with feedthrough to connected outputs, come first, each after its sources with
    feedthrough, so that only outputs of units without feedthrough are guessed. If this order has a cycle (an algebraic
    loop), the order of the SSD stays.
    """
    edges = {(k.start[0], k.end[0]) for k in links}
    loops = {name: tuple(part) for part, _ in cycles(names, edges) for name in part}
    block_of = {name: loops.get(name, (name,)) for name in names}
    ordered = topological(
        list(dict.fromkeys(block_of.values())),
        {(block_of[a], block_of[b]) for a, b in edges if block_of[a] != block_of[b]},
    )
    blocks: list[tuple[str, ...]] = []
    for part in ordered:
        inner = {(a, b) for a, b in edges if a in part and b in part and a in feeding}
        listed = sorted(part, key=lambda name: name not in feeding)
        blocks.append(tuple(listed if cycles(listed, inner) else topological(listed, inner)))
    return tuple(blocks)


class _Needs:
    """The connected inputs (initially also parameters) on which variables depend; an array's elements share them."""

    def __init__(self, descriptions: Mapping[str, Description], links: Iterable[Link], initial: bool) -> None:
        self._descriptions, self._initial = descriptions, initial
        self._connected: dict[str, list[str]] = {name: [] for name in descriptions}
        for unit, name in dict.fromkeys(link.end for link in links):
            self._connected[unit].append(name)
        self._shared: dict[tuple[str, frozenset[str] | None], tuple[str, ...]] = {}

    def of(self, unit: str, output: str) -> tuple[str, ...]:
        """Return the inputs of a unit for one of its outputs."""
        description = self._descriptions[unit]
        variable, declared = description.variables[output], description.step_dependencies.get(output)
        if self._initial and output in description.initial_dependencies:
            declared = description.initial_dependencies[output]
        elif variable.initial == "exact" if self._initial else variable.causality != "output":
            declared = frozenset()
        if (unit, declared) not in self._shared:
            inputs = self._connected[unit]
            self._shared[unit, declared] = tuple(name for name in inputs if declared is None or name in declared)
        return self._shared[unit, declared]


def variable_graph(
    descriptions: Mapping[str, Description], links: Sequence[Link], *, initial: bool
) -> tuple[list[Port], set[tuple[Port, Port]]]:
    """Return the connected variables, and the pairs whose second variable depends on the first directly.

    If several outputs depend on the same inputs, an additional port connects them, because otherwise the number of
    pairs would be the square of an array's length.
    """
    used = [link for link in links if initial or link.stepped]
    ports = list(dict.fromkeys(port for link in used for port in (link.start, link.end)))
    edges = {(link.start, link.end) for link in used}
    needs = _Needs(descriptions, used, initial)
    alike: dict[tuple[str, int], tuple[tuple[str, ...], list[Port]]] = {}
    for unit, output in dict.fromkeys(link.start for link in used):
        if unit in descriptions and (names := needs.of(unit, output)):
            alike.setdefault((unit, id(names)), (names, []))[1].append((unit, output))
    for k, ((unit, _), (names, outputs)) in enumerate(alike.items()):
        inputs = [(unit, name) for name in names]
        if len(inputs) > 1 and len(outputs) > 1:
            between = (unit, f"{_BETWEEN}{k}")
            ports.append(between)
            edges |= {(port, between) for port in inputs}
            inputs = [between]
        edges |= {(port, output) for port in inputs for output in outputs}
    return ports, edges


def _tear(
    ports: Sequence[Port], edges: set[tuple[Port, Port]], links: Sequence[Link]
) -> dict[Port, tuple[Link, Sequence[Port]]]:
    """Remove connections until all cycles are open; return them by their ends, with a cycle of their loop.

    In each loop, all connections into one unit are removed: the unit with the fewest discrete connections, because
    iterations cannot improve these, and among equals the one with the fewest connections.
    """
    torn: dict[Port, tuple[Link, Sequence[Port]]] = {}
    loop_of: dict[Port, Sequence[Port]] = {}
    while loops := cycles(ports, edges):
        for part, cycle in loops:
            inside = set(part)
            into: dict[str, list[Link]] = {}
            for link in links:
                if link.start in inside and link.end in inside and (link.start, link.end) in edges:
                    into.setdefault(link.end[0], []).append(link)
            for port in part:
                loop_of.setdefault(port, cycle)
            for link in min(into.values(), key=lambda each: (sum(k.discrete for k in each), len(each))):
                torn[link.end] = link, loop_of[link.end]
                edges.discard((link.start, link.end))
    return torn


def _loop_message(cycle: Sequence[Port], descriptions: Mapping[str, Description]) -> str:
    silent = sorted(
        {unit for unit, name in cycle if descriptions[unit].step_dependencies.get(name, frozenset()) is None}
    )
    text = " -> ".join(".".join(port) for port in cycle if not port[1].startswith(_BETWEEN))
    if silent:
        text += f". Note: no dependencies are declared by {', '.join(silent)}, so all inputs count"
    return text
