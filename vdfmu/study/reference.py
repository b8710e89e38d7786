"""References for a co-simulation: a system of units solved by scipy, without FMI and without a master.

Three references say what the answer is (times in communication points t_k, step h, inputs held over a step):

- ``sampled``: an output that depends on a connected input is that of the step from t_k, computed from everything at
  t_k; its readers have it in the same step. What ``gauss-seidel`` must give.
- ``sampled-delayed``: every unit sees the others' outputs one sample late. What ``jacobi`` must give.
- ``continuous``: no sampling but that of the units' own sampled states. What both tend to as the step shrinks.

They are assembled from the wiring and the units' own functions: outputs and right-hand sides are the traced ones, which
the tests hold against plain numpy, or plain numpy where a unit cannot be traced. The solver is scipy's, not ours.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from graphlib import CycleError, TopologicalSorter
from itertools import islice, pairwise
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.integrate import LSODA

from vdfmu.engine.cosim.inputs import Course, Table, read_inputs
from vdfmu.errors import UsageError, VdfmuError
from vdfmu.ssp.description import SystemDescription
from vdfmu.unit.evaluate import Evaluation, evaluation
from vdfmu.unit.interface import Interface
from vdfmu.unit.motion import Motion, samples

__all__ = ["BLOCK", "REFERENCE_OF", "Reference", "reference", "reference_blocks"]

Floats = npt.NDArray[np.float64]
Places = npt.NDArray[np.intp]
Dependencies = Callable[[Interface, int], list[int]]
_Node = tuple[str, int]
"""A unit and the position of one of its variables."""

REFERENCE_OF = {"gauss-seidel": "sampled", "jacobi": "sampled-delayed"}
"""Master algorithm to the reference that it must match."""

BLOCK = 1024
"""Rows of a stretch: what is held in memory of a long run."""
_RTOL, _ATOL = 1e-11, 1e-12
"""Tolerances of scipy: four orders below the 1e-7 rad that a co-simulation may differ by."""
_CLOSE = 1e-9
"""Part of a period within which two times are the same."""
_LONGEST = 0.05
"""Longest step of the continuous reference [s]: a motion that begins late must not be stepped over."""


class Reference(NamedTuple):
    """Solution on the communication points: `t` (m,), and the outputs, ``unit.group``, (m, size) each.

    Row k holds the outputs of the step that ends at t_k, as the rows of a co-simulation do; row 0 those at the start.
    """

    name: str
    t: Floats
    signals: dict[str, Floats]

    def array(self, name: str) -> Floats:
        """Values (m, size) of ``unit.group``."""
        return self.signals[name]


class _Pass(NamedTuple):
    """A unit whose outputs are calculated, and carried over from `starts` to `ends`, inputs of all units."""

    unit: Evaluation
    starts: Places
    ends: Places


class _System:
    """The units of a system in one memory, joined by links."""

    def __init__(self, description: SystemDescription) -> None:
        interfaces = {
            name: table for name, table in description.tables.items() if isinstance(table, Interface)
        }
        foreign = [name for name in description.tables if name not in interfaces]
        if foreign:
            raise UsageError(
                f"there is no reference: {', '.join(foreign)} is an FMU of another tool, whose equations are unknown."
            )
        begins = np.cumsum([0, *(interface.size for interface in interfaces.values())]).tolist()
        self.memory = np.zeros(begins[-1])
        self._first = dict(zip(interfaces, begins, strict=False))
        self.units: dict[str, Evaluation] = {}
        for (name, interface), begin in zip(interfaces.items(), begins, strict=False):
            memory = self.memory[begin : begin + interface.size]
            memory[: len(interface)] = interface.start_values()
            for variable, value in description.values[name].items():
                memory[interface.reference[variable]] = float(value)
            self.units[name] = evaluation(interface, memory)
        self._source = {(end, j): (start, i) for start, i, end, j in description.element_links()}
        self.outside: list[tuple[int, Course]] = []
        fed: set[_Node] = set()
        for table in read_inputs(description.scenario.inputs, description.scenario.input_hold):
            fed |= self._feed_from(table)
        self._feeds: set[_Node] = {
            (name, i)
            for name, i in self._source.values()
            if any(
                (name, j) in self._source or (name, j) in fed for j in interfaces[name].step_dependencies(i)
            )
        }
        self._starting = self._passes(Interface.start_dependencies, list(self._outputs()), " at the start")
        self._moving = self._passes(
            Interface.step_dependencies,
            [node for node in dict.fromkeys(self._source.values()) if not self._is_state(*node)],
        )
        self._held = self._links(lambda source, _: self._is_state(*source))
        self._times = self._places((name, interface.time) for name, interface in interfaces.items())
        self.x, self.x_dot = (
            self._places(
                (name, i)
                for name, unit in interfaces.items()
                for i in range(*getattr(unit, part).indices(unit.size))
            )
            for part in ("states", "derivatives")
        )
        self._shown: dict[str, int] = {}
        for name, position in self._outputs():
            group = f"{name}.{interfaces[name].variables[position].group}"
            self._shown[group] = self._shown.get(group, 0) + 1
        self._row = self._places(self._outputs())

    def _feed_from(self, table: Table) -> set[_Node]:
        """Let the columns of a table feed the inputs that they name; return these."""
        free = {
            f"{name}.{variable.name}": (name, i)
            for name, unit in self.units.items()
            for i, variable in enumerate(unit.interface.variables)
            if variable.causality == "input" and (name, i) not in self._source
        }
        if wrong := [name for name in table.names if table.chosen and name not in free]:
            raise UsageError(
                f"{table.where}: {', '.join(wrong)}: expected inputs that nothing is connected to."
            )
        fed = {
            free[name]: values
            for name, values in zip(table.names, table.values.T, strict=True)
            if name in free
        }
        for (name, i), values in fed.items():
            variable = self.units[name].interface.variables[i]
            held = table.held or variable.type != "Real" or variable.variability == "discrete"
            self.outside.append((self._first[name] + i, Course(table.t, values[:, None], held)))
        return set(fed)

    def feed(self, t: float, *, held: bool) -> None:
        """Give the inputs that signals from outside feed their values at a time; `held`: those that jump, too."""
        for place, course in self.outside:
            if held or not course.held:
                self.memory[place] = course.at(t)[0]

    def _places(self, nodes: Iterable[_Node]) -> Places:
        return np.array([self._first[name] + position for name, position in nodes], dtype=np.intp)

    def _outputs(self) -> Iterator[_Node]:
        for name, unit in self.units.items():
            yield from ((name, i) for i, v in enumerate(unit.interface) if v.causality == "output")

    def _is_state(self, name: str, position: int) -> bool:
        interface = self.units[name].interface
        sampled = interface.variables[position].variability == "discrete"
        return sampled or interface.states.start <= position < interface.states.stop

    def _before(self, name: str, position: int, dependencies: Dependencies) -> set[_Node]:
        """Return the outputs that an output depends on by one link each."""
        known = dependencies(self.units[name].interface, position)
        return {self._source[name, i] for i in known if (name, i) in self._source}

    def _passes(self, dependencies: Dependencies, wanted: Sequence[_Node], when: str = "") -> list[_Pass]:
        """Units in an order in which the wanted outputs can be calculated, some of them more than once."""
        graph: dict[_Node, set[_Node]] = {}
        left = list(wanted)
        while left:
            node = left.pop()
            if node not in graph:
                graph[node] = self._before(*node, dependencies)
                left += graph[node]
        try:
            ordered = list(TopologicalSorter(graph).static_order())
        except CycleError as error:
            names = (f"{name}.{self.units[name].interface.variables[i].name}" for name, i in error.args[1])
            raise UsageError(f"there is no reference: algebraic loop{when}: {' -> '.join(names)}.") from None
        level: dict[_Node, int] = {}  # the number of links on the longest way to an output
        for node in ordered:
            level[node] = max((level[other] + 1 for other in graph[node]), default=0)
        places = {(depth, name): None for name in self.units for (n, _), depth in level.items() if n == name}
        return [
            _Pass(self.units[name], *self._links(lambda source, _, name=name: source[0] == name))
            for _, name in sorted(places, key=lambda at: at[0])
        ]

    def _links(self, chosen: Callable[[_Node, _Node], bool]) -> tuple[Places, Places]:
        """Places of the outputs and inputs of some links."""
        found = {target: source for target, source in self._source.items() if chosen(source, target)}
        return self._places(found.values()), self._places(found)

    def late(self, delayed: bool) -> tuple[Places, Places]:
        """Links whose inputs get values at the start of a step: those from outputs without feed-through, or all."""
        return self._links(lambda source, _: delayed or source not in self._feeds)

    def fresh(self, name: str) -> tuple[Places, Places]:
        """Links to a unit from outputs with feed-through, whose values are of the same step."""
        return self._links(lambda source, target: target[0] == name and source in self._feeds)

    def order(self) -> list[str]:
        """Units in the order of a step: each after those whose outputs with feed-through it reads."""
        graph: dict[str, set[str]] = {name: set() for name in self.units}
        for (end, _), source in self._source.items():
            if source in self._feeds:
                graph[end].add(source[0])
        try:
            return list(TopologicalSorter(graph).static_order())
        except CycleError as error:
            raise UsageError(
                f"there is no sampled reference: each of {' -> '.join(error.args[1])} has to step before the next."
            ) from None

    def carry(self, starts: Places, ends: Places) -> None:
        """Carry outputs over to inputs, all at once."""
        self.memory[ends] = self.memory[starts]

    def start(self) -> None:
        """Set the states and outputs of the start time."""
        self.memory[self._times] = 0.0
        self.feed(0.0, held=True)
        for unit, starts, ends in self._starting:
            unit.start()
            unit.outputs()
            self.carry(starts, ends)

    def evaluate(self, t: float, x: Floats) -> None:
        """Calculate all inputs at a time, from the states."""
        self.memory[self._times] = t
        self.feed(t, held=False)
        self.memory[self.x] = x
        self.carry(*self._held)
        for unit, starts, ends in self._moving:
            unit.outputs()
            self.carry(starts, ends)

    def row(self) -> Floats:
        """Return the outputs of all units."""
        return self.memory[self._row]

    def signals(self, rows: Sequence[Floats]) -> dict[str, Floats]:
        """Rows by signal."""
        ends = np.cumsum(list(self._shown.values()))[:-1]
        parts = np.split(np.array(rows), ends, axis=1)
        return dict(zip(self._shown, parts, strict=True))


def reference_blocks(
    name: str,
    description: SystemDescription,
    *,
    step: float,
    stop: float,
    progress: Callable[[int, int], None] | None = None,
) -> Iterator[Reference]:
    """Compute one of the three references in stretches of `BLOCK` communication points, the last of what is left.

    Parameters
    ----------
    name : "sampled", "sampled-delayed" or "continuous"
    description : SystemDescription
        Units, connections and values.
    step, stop : float [s]
    progress : callable, optional
        Called with the number of finished steps and their total.

    Raises
    ------
    UsageError
        For an unknown name, or a system with an algebraic loop or an FMU of another tool.
    VdfmuError
        If scipy finds no solution.
    """
    if name not in ("sampled", "sampled-delayed", "continuous"):
        raise UsageError(f"no reference {name!r}; there are sampled, sampled-delayed and continuous.")
    system = _System(description)
    m = round(stop / step)
    t: Floats = step * np.arange(m + 1, dtype=np.float64)
    rows = _continuous(system, t) if name == "continuous" else _sampled(system, t, name == "sampled-delayed")
    for first in range(0, m + 1, BLOCK):
        yield Reference(name, t[first : first + BLOCK], system.signals(list(islice(rows, BLOCK))))
        if progress is not None:
            progress(min(first + BLOCK, m), m)


def reference(name: str, description: SystemDescription, *, step: float, stop: float) -> Reference:
    """Compute one of the three references as a whole; see :func:`reference_blocks`."""
    blocks = list(reference_blocks(name, description, step=step, stop=stop))
    signals = {key: np.concatenate([block.signals[key] for block in blocks]) for key in blocks[0].signals}
    return Reference(name, np.concatenate([block.t for block in blocks]), signals)


def _sampled(system: _System, t: Floats, delayed: bool) -> Iterator[Floats]:
    """Yield the rows of a sampled reference."""
    order = list(system.units) if delayed else system.order()
    late = system.late(delayed)
    motions = {name: Motion(system.units[name], 0.0, _ATOL, "DOP853", _RTOL) for name in order}
    fresh = {name: system.fresh(name) for name in order if not delayed}
    system.start()
    yield system.row()
    for begin, end in pairwise(t.tolist()):
        system.carry(*late)
        system.feed(begin, held=True)
        for name, motion in motions.items():
            if name in fresh:
                system.carry(*fresh[name])
            motion.move(begin, end)
            motion.unit.outputs()
            if not np.isfinite(motion.unit.x).all():
                raise VdfmuError(f"The reference failed: {name} has no finite state after t = {begin:.9g} s.")
        yield system.row()


def _continuous(system: _System, t: Floats) -> Iterator[Floats]:
    """Yield the rows of the continuous reference; sampled states change at their own samples."""

    def rate(time: float, x: Floats) -> Floats:
        system.evaluate(time, x)
        for unit in moving:
            unit.derivatives()
        return system.memory[system.x_dot]

    def row(time: float, x: Floats) -> Floats:
        system.evaluate(time, x)
        for unit in system.units.values():
            unit.outputs()
        return system.row()

    moving = [unit for unit in system.units.values() if unit.x.size]
    system.start()
    x = system.memory[system.x]
    yield row(0.0, x)
    k = 1
    for begin, end, sampled in _parts(system, float(t[-1])):
        system.feed(begin, held=True)
        system.evaluate(begin, x)
        for unit in sampled:
            unit.update()
        for time, solution in _solved(rate, begin, end, x):
            last = len(t) if end == t[-1] else int(np.searchsorted(t, end + _CLOSE * (end - begin)))
            stop = last if time >= end else int(np.searchsorted(t, time, side="right"))
            for point in t[k:stop].tolist():
                yield row(point, solution(point))
            k, x = max(k, stop), solution(time)


def _solved(
    rate: Callable[[float, Floats], Floats], begin: float, end: float, x: Floats
) -> Iterator[tuple[float, Callable[[float], Floats]]]:
    """Yield the end of each step of scipy's LSODA, and the solution in it."""
    if not x.size:
        yield end, lambda _: x
        return
    solver = LSODA(rate, begin, x, end, rtol=_RTOL, atol=_ATOL, max_step=_LONGEST)
    while solver.status == "running":
        message = solver.step()
        if message is not None:
            raise VdfmuError(f"The continuous reference failed at t = {solver.t:.9g} s: {message}")
        yield solver.t, solver.dense_output()


def _parts(system: _System, stop: float) -> Iterator[tuple[float, float, list[Evaluation]]]:
    """Yield the times between samples, jumps and bends, begin and end, and the units with a sample at the begin."""
    found: list[tuple[float, float, list[Evaluation]]] = [
        (begin, _CLOSE * float(unit.group("period")[0]), [unit])
        for unit in system.units.values()
        for begin, _, sampled in samples(unit, 0.0, 0.0, stop)
        if sampled
    ]
    for _, course in system.outside:
        close = course.tolerance
        found += [(time, close, []) for time in course.breaks.tolist() if 0.0 < time < stop - close]
    found.sort(key=lambda point: point[0])
    begin, units = 0.0, []
    for time, close, sampled in found:
        if time - begin > close:  # else it is the sample of another unit as well
            yield begin, time, units
            begin, units = time, []
        units += sampled
    yield begin, stop, units
