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

from collections.abc import Callable, Iterator, Sequence
from graphlib import CycleError, TopologicalSorter
from itertools import islice
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.integrate import LSODA

from vdfmu.cosim.inputs import Course, Table, read_inputs
from vdfmu.errors import UsageError, VdfmuError
from vdfmu.ssp.description import SystemDescription
from vdfmu.unit.evaluate import Evaluation, evaluation
from vdfmu.unit.motion import Motion, samples

__all__ = ["BLOCK", "REFERENCE_OF", "Reference", "reference", "reference_blocks"]

Floats = npt.NDArray[np.float64]

REFERENCE_OF = {"gauss-seidel": "sampled", "jacobi": "sampled-delayed"}
"""Master algorithm to the reference that it must match."""

BLOCK = 1024
"""Rows of a stretch: what is held in memory of a long run."""
_RTOL, _ATOL = 1e-11, 1e-12
"""Tolerances of scipy: four orders below the 1e-7 rad that a co-simulation may differ by."""
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


class _Link(NamedTuple):
    """Elements of an output that feed those of an input, as positions in the memories of their units."""

    start: str
    starts: npt.NDArray[np.intp]
    end: str
    ends: npt.NDArray[np.intp]
    direct: bool
    """Whether the output depends on a connected input."""


class _System:
    """The units of a system on their memories, joined by links."""

    def __init__(self, description: SystemDescription) -> None:
        self.units: dict[str, Evaluation] = {}
        for name, interface in description.tables.items():
            unit = self.units[name] = evaluation(interface)
            for variable, value in description.values[name].items():
                unit.memory[interface.reference[variable]] = float(value)
        pairs = list(description.element_links())
        self.connected = {(unit, i) for _, _, unit, i in pairs}
        self.fed: list[tuple[str, int, Course]] = []
        for table in read_inputs(description.scenario.inputs, description.scenario.input_hold):
            self._feed_from(table)
        self.links = [
            _Link(
                start,
                np.array(
                    [i for s, i, e, _ in pairs if (s, e) == (start, end) and self._direct(s, i) == direct]
                ),
                end,
                np.array(
                    [j for s, i, e, j in pairs if (s, e) == (start, end) and self._direct(s, i) == direct]
                ),
                direct,
            )
            for start, end, direct in dict.fromkeys((s, e, self._direct(s, i)) for s, i, e, _ in pairs)
        ]
        self.motions = {name: Motion(unit, 0.0, _ATOL, "DOP853") for name, unit in self.units.items()}

    def _direct(self, unit: str, position: int) -> bool:
        known = self.units[unit].interface.step_dependencies(position)
        return any((unit, i) in self.connected for i in known)

    def _feed_from(self, table: Table) -> None:
        """Let the columns of a table feed the inputs that they name."""
        for name, values in zip(table.names, table.values.T, strict=True):
            unit, _, variable = name.partition(".")
            place = self.units[unit].interface.reference.get(variable) if unit in self.units else None
            declared = None if place is None else self.units[unit].interface.variables[place]
            if (
                place is None
                or declared is None
                or declared.causality != "input"
                or (unit, place) in self.connected
            ):
                if table.chosen:
                    raise UsageError(
                        f"{table.where}: {name}: expected an input that nothing is connected to."
                    )
                continue
            held = table.held or declared.type != "Real" or declared.variability == "discrete"
            self.fed.append((unit, place, Course(table.t, values[:, None], held)))
        self.connected |= {(unit, place) for unit, place, _ in self.fed}

    def feed(self, t: float, held: bool) -> None:
        """Give the inputs that signals from outside feed their values at a time; `held`: also those that jump."""
        for unit, place, course in self.fed:
            if held or not course.held:
                self.units[unit].memory[place] = course.at(t)[0]

    def carry(self, links: Sequence[_Link]) -> None:
        """Carry outputs over to inputs, all at once."""
        values = [self.units[link.start].memory[link.starts] for link in links]
        for link, value in zip(links, values, strict=True):
            self.units[link.end].memory[link.ends] = value

    def order(self) -> list[str]:
        """Units in the order of a step: each after those whose direct outputs it reads."""
        graph: dict[str, set[str]] = {name: set() for name in self.units}
        for link in self.links:
            if link.direct:
                graph[link.end].add(link.start)
        try:
            return list(TopologicalSorter(graph).static_order())
        except CycleError as error:
            raise UsageError(f"there is no reference: algebraic loop {' -> '.join(error.args[1])}.") from None

    def start(self) -> None:
        """Set the states and outputs of the start time; what feeds through needs as many passes as there are units."""
        self.feed(0.0, held=True)
        for _ in range(len(self.units) + 1):
            for unit in self.units.values():
                unit.memory[-1] = 0.0
                unit.start()
                unit.outputs()
            self.carry(self.links)

    def evaluate(self, t: float, order: Sequence[str]) -> None:
        """Calculate all outputs at a time, from the states."""
        self.feed(t, held=False)
        for name in order:
            unit = self.units[name]
            unit.memory[-1] = t
            self.carry([link for link in self.links if link.end == name])
            unit.outputs()
        self.carry(self.links)

    def row(self) -> list[Floats]:
        """Outputs of all units."""
        return [
            unit.memory[where]
            for unit in self.units.values()
            for where in unit.interface.groups.values()
            if unit.interface.variables[where.start].causality == "output"
        ]

    def signals(self, rows: Sequence[Sequence[Floats]]) -> dict[str, Floats]:
        """Rows by signal."""
        names = [
            f"{name}.{group}"
            for name, unit in self.units.items()
            for group, where in unit.interface.groups.items()
            if unit.interface.variables[where.start].causality == "output"
        ]
        return {name: np.array([row[i] for row in rows]) for i, name in enumerate(names)}


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
        For an unknown name, or a system with an algebraic loop.
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


def _sampled(system: _System, t: Floats, delayed: bool) -> Iterator[list[Floats]]:
    """Yield the rows of a sampled reference."""
    order = list(system.units) if delayed else system.order()
    late = [link for link in system.links if delayed or not link.direct]
    fresh = {
        name: [k for k in system.links if k.end == name and not (delayed or not k.direct)] for name in order
    }
    system.start()
    yield [values.copy() for values in system.row()]
    for k in range(len(t) - 1):
        system.carry(late)
        system.feed(t[k], held=True)
        for name in order:
            system.carry(fresh[name])
            unit = system.units[name]
            system.motions[name].move(t[k], t[k + 1])
            unit.outputs()
            if not np.isfinite(unit.x).all():
                raise VdfmuError(f"The reference failed: {name} has no finite state after t = {t[k]:.9g} s.")
        yield [values.copy() for values in system.row()]


def _continuous(system: _System, t: Floats) -> Iterator[list[Floats]]:
    """Yield the rows of the continuous reference; sampled states change at their own samples."""
    system.start()
    order = _passes(system)
    states = [unit for unit in system.units.values() if unit.x.size]
    ends = np.cumsum([0, *(unit.x.size for unit in states)])

    def set_states(x: Floats) -> None:
        for unit, begin, end in zip(states, ends, ends[1:], strict=False):
            unit.x[:] = x[begin:end]

    def rate(time: float, x: Floats) -> Floats:
        set_states(x)
        system.evaluate(time, order)
        for unit in states:
            unit.derivatives()
        return np.concatenate([unit.x_dot for unit in states])

    def row(time: float, x: Floats) -> list[Floats]:
        set_states(x)
        system.evaluate(time, order)
        return [values.copy() for values in system.row()]

    x = np.concatenate([unit.x for unit in states]) if states else np.zeros(0)
    yield row(0.0, x)
    k = 1
    for begin, end in _parts(system, float(t[-1])):
        system.feed(begin, held=True)
        system.evaluate(begin, order)
        for time, solution in _solved(rate, begin, end, x):
            last = len(t) if end == t[-1] else int(np.searchsorted(t, end + 1e-9 * (end - begin)))
            stop = min(int(np.searchsorted(t, time, side="right")), last)
            for point in t[k:stop].tolist():
                yield row(point, solution(point))
            k, x = max(k, stop), solution(time)
        set_states(x)
        system.evaluate(end, order)


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


def _parts(system: _System, stop: float) -> Iterator[tuple[float, float]]:
    """Yield the times between samples, and between jumps and bends of signals from outside.

    Units that have a sample at the begin are updated before.
    """
    sampled = [unit for unit in system.units.values() if unit.interface.is_sampled]
    points = {0.0, stop}
    for unit in sampled:
        points |= {begin for begin, _, _ in samples(unit, 0.0, 0.0, stop)}
    for *_, course in system.fed:
        points |= {at for at in course.breaks.tolist() if course.tolerance < at < stop - course.tolerance}
    ordered = sorted(points)
    for begin, end in zip(ordered, ordered[1:], strict=False):
        for unit in sampled:
            period = float(unit.group("period")[0])
            if abs(begin / period - round(begin / period)) < 1e-9:
                unit.memory[-1] = begin
                unit.update()
        yield begin, end


def _passes(system: _System) -> list[str]:
    """Units in an order in which their outputs can be calculated, some of them more than once.

    An order of the single outputs in which each comes after those that it depends on, by unit.
    """
    graph: dict[tuple[str, int], set[tuple[str, int]]] = {}
    sources = {
        (link.end, int(j)): (link.start, int(i))
        for link in system.links
        for i, j in zip(link.starts, link.ends, strict=True)
    }
    for name, unit in system.units.items():
        for position, variable in enumerate(unit.interface.variables):
            if variable.causality == "output":
                known = unit.interface.step_dependencies(position)
                graph[name, position] = {sources[name, i] for i in known if (name, i) in sources}
    try:
        nodes = list(TopologicalSorter(graph).static_order())
    except CycleError as error:
        loop = " -> ".join(
            f"{name}.{system.units[name].interface.variables[i].name}" for name, i in error.args[1]
        )
        raise UsageError(f"there is no continuous reference: algebraic loop {loop}.") from None
    order: list[str] = []
    level: dict[tuple[str, int], int] = {}
    for node in nodes:  # the level of an output: how many units it comes after
        level[node] = max((level[other] + (other[0] != node[0]) for other in graph[node]), default=0)
    for depth in range(max(level.values(), default=0) + 1):
        units = [
            name for name in system.units if any(n == name and at == depth for (n, _), at in level.items())
        ]
        order += units
    return order
