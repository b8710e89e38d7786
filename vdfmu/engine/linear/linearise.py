"""Linearises the components of a running system, also with other parameters but the states and inputs of a run."""

from __future__ import annotations

from collections.abc import Callable, Container, Generator, Iterator, Mapping, Sequence
from contextlib import contextmanager
from ctypes import c_double
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from vdfmu.base.arrays import Floats
from vdfmu.base.errors import UsageError
from vdfmu.base.state_space import StateSpace
from vdfmu.engine.fmu.access import Call
from vdfmu.engine.fmu.description import Description
from vdfmu.engine.fmu.instance import Instance
from vdfmu.engine.fmu.variables import FmuVariable
from vdfmu.engine.fmu.versions import class_of
from vdfmu.engine.linear.system import LinearSystem, Samples, reached
from vdfmu.engine.masters.components import Components
from vdfmu.engine.masters.coupled import jacobian_of
from vdfmu.engine.package.system import FlatSystem, Value
from vdfmu.engine.plan.check import Checked, periods
from vdfmu.engine.plan.conversion import Port
from vdfmu.engine.run.isolated import Isolated
from vdfmu.engine.run.simulator import Simulator


def linear_system(
    system: FlatSystem | str | Path, at: float | None = None, *, step: float | None = None, **options: Any
) -> LinearSystem:
    """Run a system to a time `at` [s], by default its start, and linearise its components there.

    The matrices are directional derivatives. Model-exchange components without them are differenced, with a note.
    Sampled states are linearised if an annotation names their period. For `step`, errors and `options`, such as
    `algorithm` and `parameters`, see :class:`vdfmu.engine.run.Simulator`. UsageError for co-simulation components
    without directional derivatives.
    """
    simulator = Simulator(system, **options)
    step = simulator.grid(None, None, step)[2]
    with simulator:
        components = simulator.stand(at, step)
        return Linearisation(components, step).at(components.box.time if at is None else at)


class Linearisation:
    """Linearises components at their current states; see :func:`linear_system`.

    With `loops`, derivatives with respect to inputs outside of loops may be left at 0. UsageError for components
    without derivatives.
    """

    def __init__(self, components: Components | Isolated, step: float, loops: bool = False) -> None:
        checked = components.exchange.checked
        blind = [name for name, each in checked.descriptions.items() if not (each.derives_unknowns or each.exchange)]
        if blind:
            raise UsageError(
                f"{', '.join(blind)}: expected FMUs with directional derivatives, or for model exchange. Export them "
                "that way; native FMUs built by vdfmu have directional derivatives."
            )
        self._derive = _derive(components)
        counts = self._derive("begin", loops)
        groups = {name: _groups(checked.descriptions[name], count) for name, count in counts.items()}
        self._sizes = n, m, p, s = [sum(len(each[kind]) for each in groups.values()) for kind in range(4)]
        self._fixed = np.zeros((n + p + s, n + m + s))  # the system's matrices without the components' Jacobians
        self._places: list[tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]] = []
        """Rows and columns of each component's Jacobian in these matrices."""
        begins = np.zeros(4, np.intp)
        for part in groups.values():
            x, u, y, held = (begin + np.arange(len(each)) for begin, each in zip(begins, part, strict=True))
            begins += [len(each) for each in part]
            k = len(y) - len(held)
            rows = np.concatenate([x, n + y[:k], n + p + held])
            self._places.append((rows, np.concatenate([x, n + u, n + m + held])))
            self._fixed[n + y[k:], n + m + held] = 1.0  # a sampled state is an output
        variables = [[(name, v) for name, part in groups.items() for v in part[kind]] for kind in range(4)]
        self._names = [tuple(f"{name}.{v.name}" for name, v in each) for each in variables]
        self._units = [tuple(v.unit.name if v.unit else "1" for _, v in each) for each in variables]
        rows, columns = ({name: i for i, name in enumerate(self._names[kind])} for kind in (1, 2))
        links, fresh, constant = np.zeros((m, p)), np.zeros(m, bool), dict[str, None]()
        for link in checked.links:
            start, end = ".".join(link.start), ".".join(link.end)
            if start in columns and end in rows and link.stepped:
                links[rows[end], columns[start]] = link.conversion.factor
                fresh[rows[end]] = link.end in checked.schedule.fresh
            elif link.sink.type == "Real" and end.partition(".")[0] in groups and link.discrete:
                constant[start] = None
        step /= max(1, checked.how.substeps)
        every = {name: n for name, period in periods(checked).items() if (n := round(period / step)) != 1}
        self._facts: dict[str, Any] = {
            "links": links,
            "fresh": fresh,
            "step": step,
            "algorithm": checked.algorithm,
            "constant": tuple(constant),
            "every": every,
        }
        self._notes = [
            f"its step of {n} communication steps is treated as one: {name}"
            for name, n in checked.multiples.items()
            if n != 1
        ]

    def at(self, time: float, values: bool = True) -> LinearSystem:
        """Linearise at a time [s]. Without `values`, all states, inputs and outputs are 0."""
        M, notes, (n, m, p, _) = self._fixed.copy(), list(self._notes), self._sizes
        jacobians, read, more = self._derive("at", time, values)
        for (rows, columns), J in zip(self._places, jacobians, strict=True):
            M[np.ix_(rows, columns)] = np.reshape(J, (len(rows), len(columns)))
        x, u, y, s = (
            np.concatenate([each[kind] for each in read]) if read else np.zeros(self._sizes[kind]) for kind in range(4)
        )
        names, units = self._names, self._units
        parts = StateSpace(
            M[:n, :n], M[:n, n : n + m], M[n : n + p, :n], M[n : n + p, n : n + m], names[0], names[1], names[2],
            units[0], units[1], units[2], x, u, y, notes=tuple(dict.fromkeys([*notes, *more])),
        )  # fmt: skip
        signals = list(zip(names[3], units[3], s.tolist(), strict=True))
        samples = Samples(signals, M[:n, n + m :], M[n : n + p, n + m :], M[n + p :])
        return LinearSystem(parts, samples=samples, **self._facts)


def _on_loops(checked: Checked) -> set[Port]:
    """Return the inputs that are on a loop of components."""
    names = [*checked.sources]
    acts = np.zeros((len(names),) * 2, bool)  # of columns on rows
    for link in checked.links:
        acts[names.index(link.end[0]), names.index(link.start[0])] = True
    behind = {name: reached(acts, np.array([i])) for i, name in enumerate(names)}
    return {link.end for link in checked.links if behind[link.end[0]][names.index(link.start[0])]}


def _derive(components: Any) -> Callable[..., Any]:
    """Return the function that calls a method of the `Derivatives` of components, here or in their process."""
    if not isinstance(components, Components):
        return components.derive
    derivatives = Derivatives(components)
    return lambda call, *arguments: getattr(derivatives, call)(*arguments)


class Derivatives:
    """Derivatives and values of components in this process, as numbers for the process that assembles them."""

    def __init__(self, components: Components) -> None:
        self._components = components
        self._parts: list[_Linearised] = []

    def begin(self, loops: bool) -> dict[str, int]:
        """Begin to linearise and return the number of states by component; for `loops` see :class:`Linearisation`."""
        looped = _on_loops(self._components.checked) if loops else None
        self._parts = [_Linearised(name, each, looped) for name, each in self._components.instances.items()]
        return {part.name: len(part.groups[0]) for part in self._parts}

    def at(self, time: float, values: bool) -> tuple[list[Floats], list[list[Floats]], list[str]]:
        """Return the Jacobian of each component, the values of its groups if requested, and all notes."""
        jacobians = [part.jacobian(time) for part in self._parts]
        notes = [note for part in self._parts for note in part.notes()]
        return jacobians, [part.values() for part in self._parts] if values else [], notes

    def changed(
        self, name: str, values: Mapping[str, Value], rows: Sequence[tuple[float, Floats, Floats]]
    ) -> list[Floats]:
        """Return the Jacobians of a component with other parameters, at times [s], states and inputs."""
        with _changed(self._components, name, values) as instance:
            _, inputs, outputs, _ = _groups(instance.description)
            held = np.zeros(len(inputs))
            calls, jacobian = instance.access("Set", inputs, held), jacobian_of(instance, inputs, outputs)
            made: list[Floats] = []
            for time, x, u in rows:
                if instance.description.exchange:
                    instance.call("SetTime", c_double(time))
                    instance.transfer("SetContinuousStates", x)
                held[:] = u
                instance.run(calls)
                made.append(jacobian().copy())
        return made


def _groups(description: Description, count: int | None = None) -> tuple[list[FmuVariable], ...]:
    """Return a component's first `count` states, its inputs, outputs with sampled states, and sampled states."""
    variables = description.variables.values()
    sampled = [v for v in description.sampled if v.type == "Real" and not description.exchange]
    inputs, outputs = (
        [v for v in variables if v.causality == causality and v.type == "Real" and v.variability != "discrete"]
        for causality in ("input", "output")
    )
    first = {(v.reference, v.index): v for v in reversed([*variables])}
    states = [first[x, i] for x, _, length in description.states for i in range(length)]
    return states[:count], inputs, [*outputs, *sampled], sampled


class _Linearised:
    """A component: its states, inputs, outputs with sampled states, sampled states; and its matrices."""

    def __init__(self, name: str, instance: Instance, looped: Container[Port] | None) -> None:
        description = instance.description
        self.name, self.instance, self.acts = name, instance, False
        count = None if description.derives_unknowns else instance.sizes()[0]
        self.groups = _, inputs, unknowns, sampled = _groups(description, count)
        if description.derives_unknowns:
            knowns = [*inputs, *sampled]
            some = [i for i, v in enumerate(knowns) if v in sampled or looped is None or (name, v.name) in looped]
            whole, part = (jacobian_of(instance, knowns, unknowns, each) for each in (None, some))
            self._ways: list[Callable[[float], Floats]] = [lambda _: part(), lambda _: whole()]
        else:
            assert instance.integrator is not None
            differences = instance.integrator.differences
            self._ways = [lambda time: differences(time, inputs, unknowns)]
        self._values = [np.zeros(len(group)) for group in self.groups]
        self._reads: list[Call] | None = None

    def jacobian(self, time: float) -> Floats:
        """Return its Jacobian, first with respect to all inputs, for the notes, and later only to inputs on loops."""
        J = self._ways[-1](time)
        self.acts = self.acts or bool(J.any())
        del self._ways[1:]
        return J

    def values(self) -> list[Floats]:
        """Return the values of its groups, read with one call per type."""
        if self._reads is None:
            pairs = [(group, values) for group, values in zip(self.groups, self._values, strict=True) if group]
            self._reads = [call for pair in pairs for call in self.instance.access("Get", *pair)]
        self.instance.run(self._reads)
        return [values.copy() for values in self._values]

    def notes(self) -> Iterator[str]:
        """Yield the notes on its Jacobians so far."""
        if not self.instance.description.derives_unknowns:
            yield f"without directional derivatives, by differences: {self.name}"
        if not self.groups[0] and self.groups[1] and not self.acts:
            yield f"without declared states, and no output depends on an input directly: {self.name}"


def can_change(checked: Checked, name: str) -> bool:
    """Return whether :func:`with_part` can be called for a component, which needs derivatives and no sampled states."""
    description = checked.descriptions[name]
    return description.derives_unknowns and not description.sampled


@contextmanager
def _changed(components: Components, name: str, values: Mapping[str, Value]) -> Generator[Instance]:
    """Yield another instance of a component with other parameters, for model exchange if there are states to set."""
    checked = components.checked
    description = checked.descriptions[name]
    description = replace(description, exchange=bool(description.states), event_mode=False)
    instance = class_of(description.version.name)(
        name, description, components.folders[description.source], components.box, set()
    )
    starts = {v.name: (v, value) for v, value in checked.starts.get(name, ())}
    starts |= {each: (description.variables[each], value) for each, value in values.items()}
    try:
        instance.instantiate()
        instance.prepare(None, 0.0, 1.0, list(starts.values()))
        instance.enter_initialization()
        instance.exit_initialization(stepped=False)
        if description.exchange:
            instance.call("EnterContinuousTimeMode")
        yield instance
    finally:
        instance.close()


def with_part(
    components: Components | Isolated,
    name: str,
    values: Mapping[str, Value],
    rows: Sequence[tuple[float, LinearSystem]],
) -> list[tuple[float, LinearSystem]]:
    """Return times and systems of a run with other parameters of a component, at the states and inputs of the run."""
    parts = rows[0][1].parts
    x, u, y = (
        np.flatnonzero([each.partition(".")[0] == name for each in names])
        for names in (parts.states, parts.inputs, parts.outputs)
    )
    n, made = len(x), list[tuple[float, LinearSystem]]()
    places = [(time, system.parts.x[x], system.parts.u[u]) for time, system in rows]
    jacobians = _derive(components)("changed", name, values, places)
    for (time, system), numbers in zip(rows, jacobians, strict=True):
        parts, J = system.parts, np.reshape(numbers, (n + len(y), n + len(u)))
        A, B, C, D = (each.copy() for each in (parts.A, parts.B, parts.C, parts.D))
        A[np.ix_(x, x)], B[np.ix_(x, u)], C[np.ix_(y, x)], D[np.ix_(y, u)] = J[:n, :n], J[:n, n:], J[n:, :n], J[n:, n:]
        made.append((time, replace(system, parts=replace(parts, A=A, B=B, C=C, D=D))))
    return made
