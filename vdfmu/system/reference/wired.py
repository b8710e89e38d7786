"""The connected units of a system in a common memory, for the references.

Calculations are lists of actions, which run in sequence or as a compiled function.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from graphlib import CycleError, TopologicalSorter
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from vdfmu.base.errors import UsageError
from vdfmu.compiler.unit.evaluate import Evaluation, Traced, evaluation
from vdfmu.compiler.unit.interface import Interface
from vdfmu.engine.plan.inputs import Course, InputTable, read_inputs
from vdfmu.system.package.description import SystemDescription

Places = npt.NDArray[np.intp]
Dependencies = Callable[[Interface, int], list[int]]
Run = Callable[[float], None]
"""Runs a list of actions at a time [s]."""
Node = tuple[str, int]
"""A unit and the position of a variable."""


class Carry(NamedTuple):
    """Copies numbers between places of the memory, all at once."""

    starts: Places
    ends: Places


class TimeSetter(NamedTuple):
    """Sets the time at places."""

    places: Places


class Evaluate(NamedTuple):
    """Runs a method of a unit: ``outputs``, ``derivatives`` or ``update``."""

    unit: str
    method: str


Action = Carry | TimeSetter | Evaluate


class WiredUnits:
    """The units of a system in a common memory with links. UsageError for foreign FMUs and algebraic loops.

    Attributes
    ----------
    memory : (m,) array
        The memories of the units, then `solver_x` and `solver_x_dot`.
    units : dict of str to Evaluation
    x, x_dot : (n_x,) places of the continuous states of all units, and of their derivatives
    solver_x, solver_x_dot : (n_x,) places of a solver's states and derivatives
    clocks : places of the time
    outside : list of (place, Course)
        Inputs from external signals.
    starting : list of (unit, Carry)
        Units in the order of the start, and the links of their outputs.
    """

    def __init__(self, description: SystemDescription) -> None:
        interfaces = {name: table for name, table in description.tables.items() if isinstance(table, Interface)}
        foreign = [name for name in description.tables if name not in interfaces]
        if foreign:
            raise UsageError(
                f"there is no reference: {', '.join(foreign)} is an FMU of another tool, whose equations are unknown."
            )
        begins = np.cumsum([0, *(interface.size for interface in interfaces.values())]).tolist()
        n_x = sum(interface.states.stop - interface.states.start for interface in interfaces.values())
        self.memory = np.zeros(begins[-1] + 2 * n_x)
        self.solver_x, self.solver_x_dot = (begins[-1] + np.arange(2 * n_x)).reshape(2, n_x)
        self._first = dict(zip(interfaces, begins, strict=False))
        self.units: dict[str, Evaluation] = {}
        for (name, interface), begin in zip(interfaces.items(), begins, strict=False):
            memory = self.memory[begin : begin + interface.size]
            memory[:] = interface.memory_of(description.values[name])
            self.units[name] = evaluation(interface, memory)
        links = [
            [(name, interfaces[name].reference[variable.name]) for name, variable in ends]
            for ends in description.resolved.links()
        ]
        self._source = {end: start for start, end in links}
        self.outside: list[tuple[int, Course]] = []
        fed: set[Node] = set()
        for table in read_inputs(description.scenario.inputs, description.scenario.input_hold):
            fed |= self._feed_from(table)
        self._feeds: set[Node] = {
            (name, i)
            for name, i in self._source.values()
            if any((name, j) in self._source or (name, j) in fed for j in interfaces[name].step_dependencies(i))
        }
        self.starting = self._passes(Interface.start_dependencies, list(self._outputs()), " at the start")
        moving = self._passes(
            Interface.held_dependencies,
            [node for node in dict.fromkeys(self._source.values()) if not self._is_state(*node)],
            held=True,
        )
        self.clocks = self.places((name, interface.time) for name, interface in interfaces.items())
        self.x, self.x_dot = (
            np.concatenate([self._range(name, part) for name in interfaces]) for part in ("states", "derivatives")
        )
        self.evaluate: list[Action] = [
            Carry(self.solver_x, self.x),
            TimeSetter(self.clocks),
            self._links(lambda source, _: self._is_state(*source)),
            *(action for name, carry in moving for action in (Evaluate(name, "outputs"), carry)),
        ]
        """Calculates all inputs at a time from the solver's states."""

    def _feed_from(self, table: InputTable) -> set[Node]:
        """Connect the columns of a table to the inputs of the same names, and return these inputs."""
        free = {
            f"{name}.{variable.name}": (name, i)
            for name, unit in self.units.items()
            for i, variable in enumerate(unit.interface.variables)
            if variable.causality == "input" and (name, i) not in self._source
        }
        if wrong := [name for name in table.names if table.chosen and name not in free]:
            raise UsageError(f"{table.where}: {', '.join(wrong)}: expected unconnected inputs.")
        fed = {free[name]: values for name, values in zip(table.names, table.values.T, strict=True) if name in free}
        for (name, i), values in fed.items():
            variable = self.units[name].interface.variables[i]
            held = table.held or variable.type != "Real" or variable.variability == "discrete"
            self.outside.append((self._first[name] + i, Course(table.t, values[:, None], held)))
        return set(fed)

    def feed(self, t: float, *, held: bool) -> None:
        """Set the inputs from external signals at a time, with `held` including held ones."""
        for place, course in self.outside:
            if held or not course.held:
                self.memory[place] = course.at(t)[0]

    def _range(self, name: str, part: str) -> Places:
        """Return the places of the ``states`` or ``derivatives`` of a unit."""
        where = getattr(self.units[name].interface, part)
        return self._first[name] + np.arange(where.start, where.stop)

    def begin(self, name: str) -> int:
        """Return the place of the first number of a unit's memory."""
        return self._first[name]

    def clock(self, name: str) -> Places:
        """Return the place of a unit's time."""
        return self.places([(name, self.units[name].interface.time)])

    def places(self, nodes: Iterable[Node]) -> Places:
        """Return the places of variables."""
        return np.array([self._first[name] + position for name, position in nodes], dtype=np.intp)

    def _outputs(self) -> Iterator[Node]:
        for name, unit in self.units.items():
            yield from ((name, i) for i, v in enumerate(unit.interface) if v.causality == "output")

    def _is_state(self, name: str, position: int) -> bool:
        interface = self.units[name].interface
        sampled = interface.variables[position].variability == "discrete"
        return sampled or interface.states.start <= position < interface.states.stop

    def _passes(
        self, dependencies: Dependencies, wanted: Sequence[Node], when: str = "", *, held: bool = False
    ) -> list[tuple[str, Carry]]:
        """Return units with links in an order that yields the requested outputs. If `held`, states are known."""
        reads = {name: _read(unit) if held else range(unit.interface.size) for name, unit in self.units.items()}
        graph: dict[Node, set[Node]] = {}
        left = list(wanted)
        while left:
            name, position = node = left.pop()
            if node not in graph:
                inputs = dependencies(self.units[name].interface, position)
                sources = {self._source[name, i] for i in inputs if (name, i) in self._source and i in reads[name]}
                graph[node] = {source for source in sources if not (held and self._is_state(*source))}
                left += graph[node]
        try:
            ordered = list(TopologicalSorter(graph).static_order())
        except CycleError as error:
            names = (f"{name}.{self.units[name].interface.variables[i].name}" for name, i in error.args[1])
            raise UsageError(f"there is no reference: algebraic loop{when}: {' -> '.join(names)}.") from None
        level: dict[Node, int] = {}  # number of links on the longest path to an output
        for node in ordered:
            level[node] = max((level[other] + 1 for other in graph[node]), default=0)
        places = {(depth, name): None for name in self.units for (n, _), depth in level.items() if n == name}
        return [
            (name, self._links(lambda source, _, name=name: source[0] == name))
            for _, name in sorted(places, key=lambda at: at[0])
        ]

    def _links(self, chosen: Callable[[Node, Node], bool]) -> Carry:
        """Return the action of the chosen links."""
        links = {target: source for target, source in self._source.items() if chosen(source, target)}
        return Carry(self.places(links.values()), self.places(links))

    @property
    def read(self) -> set[int]:
        """Places of connected outputs."""
        return set(self.places(self._source.values()).tolist())

    @property
    def linked(self) -> set[int]:
        """Places of connected inputs."""
        return set(self.places(self._source).tolist())

    def links_before_step(self, delayed: bool) -> Carry:
        """Return the links at the start of a step: from outputs without feedthrough, or all."""
        return self._links(lambda source, _: delayed or source not in self._feeds)

    def links_within_step(self, name: str) -> Carry:
        """Return the links to a unit from outputs with feedthrough, which have values of the same step."""
        return self._links(lambda source, target: target[0] == name and source in self._feeds)

    def order(self) -> list[str]:
        """Return the units in the order of a step: readers of outputs with feedthrough follow their sources."""
        graph: dict[str, set[str]] = {name: set() for name in self.units}
        for (end, _), source in self._source.items():
            if source in self._feeds:
                graph[end].add(source[0])
        try:
            return list(TopologicalSorter(graph).static_order())
        except CycleError as error:
            raise UsageError(
                f"there is no sampled reference: {' -> '.join(error.args[1])} would each have to step before the next."
            ) from None

    def start(self) -> None:
        """Set the states and outputs at the start time."""
        self.memory[self.clocks] = 0.0
        self.feed(0.0, held=True)
        for name, (starts, ends) in self.starting:
            unit = self.units[name]
            unit.start()
            unit.outputs()
            self.memory[ends] = self.memory[starts]

    def python(self, actions: Sequence[Action]) -> Run:
        """Return a function that runs actions in sequence."""
        memory = self.memory

        def bound(action: Action) -> Run:
            match action:
                case Carry(starts, ends):
                    return lambda _: memory.__setitem__(ends, memory[starts])
                case TimeSetter(places):
                    return lambda t: memory.__setitem__(places, t)
                case Evaluate(unit, method):
                    call = getattr(self.units[unit], method)
                    return lambda _: call()

        runs = [bound(action) for action in actions]

        def run(t: float) -> None:
            for each in runs:
                each(t)

        return run


def _read(unit: Evaluation) -> set[int]:
    """Return the positions that a unit's outputs read, given its choices."""
    table = unit.interface
    if not isinstance(unit, Traced):
        return set(range(table.size))
    slices = [table.arguments[group] for call in table.program.outputs if unit.takes(call) for group in call.reads]
    return {position for where in slices for position in range(where.start, where.stop)}
