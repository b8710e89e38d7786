"""Independent witness of a run: the methods of the units in numpy, on floats.

FMUs and references share trace and cache, and so their faults. The witness compares components at five rows of the run
with the methods of the units and the parameters of the scenario: no trace, no cache, no C.

- Parameters and free inputs equal the scenario, to the bit.
- States at the start, outputs and derivatives follow from the component's inputs and states.
- A sampled state after one more period follows from ``update``.
- Continuous states after one more, very short, step moved at a rate between the derivatives at its two ends (mean value
  theorem). This shows faults in the functions of the solver except the Jacobian: a wrong Jacobian costs steps, and its
  error is below the tolerance.

Both sides round: a number may be off by `_ROUNDING` of the largest value of its group. A chain of n operations rounds
by up to 1e-16 n. 1e4 operations lead to an output of six joints, and 1e-9 leaves three digits for cancellation. A
group that is smaller than the rounding of the component's largest number counts as large as that rounding, such as the
energy of springs that carry nothing, 1e-35 J, beside a potential energy of 10 J. An
acceleration in equilibrium cancels more. So a number may also be off by its change if all its sources change by
`_ROUNDING` of themselves.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from vdfmu.base.arrays import Floats
from vdfmu.base.errors import VdfmuError
from vdfmu.compiler.unit.evaluate import Plain
from vdfmu.compiler.unit.interface import Interface
from vdfmu.compiler.unit.solver import samples
from vdfmu.engine.masters.observer import Numbers, Probe, Reading
from vdfmu.engine.results.results import Results
from vdfmu.system.package.description import SystemDescription
from vdfmu.system.scenario.values import is_free

_ROUNDING = 1e-9
_SHORT = 1e-5
"""Short step over communication step, 1e-8 s: then a rate of 1e5 1/s changes by 1e-3."""
_LAST_PLACES = 8.0 * float(np.spacing(1.0))
"""Relative rounding of a state in a step of the solver: sums of six stages, and the result."""
_SHOWN = 3
"""Most faults of a component in the summary."""


class _Comparison(NamedTuple):
    """Numbers of a component at a time: expected by numpy, got, and the allowed difference.

    `again` calculates the expected numbers from a memory. `memory` is the memory without error.
    """

    time: float
    places: npt.NDArray[np.intp]
    expected: Floats
    got: Floats
    allowed: Floats | float
    memory: Floats
    again: Callable[[Floats], Floats]


class Witness:
    """Comparison of a run with a system. `probe` reads the run."""

    def __init__(self, system: SystemDescription) -> None:
        self._units: dict[str, _WitnessedUnit] = {}
        self._left: list[str] = []
        scenario = system.scenario
        fed = {name for table in scenario.inputs or () for name in table.names}
        for name, table in system.tables.items():
            if isinstance(table, Interface) and table.unit.backend == "native":
                unfed = [is_free(scenario.system, name, v) and f"{name}.{v.name}" not in fed for v in table]
                self._units[name] = _WitnessedUnit(table, system.values[name], np.flatnonzero(unfed).tolist())
            else:
                self._left.append(name)
        self.probe = Probe({name: unit.step(scenario.step) for name, unit in self._units.items()})

    def summary(self, results: Results) -> dict[str, Any]:
        """Return the entry ``witness`` of a summary: compared and omitted components, and faults as texts."""
        probe, count = self.probe, 0
        faults = [f"the components cannot be read: {probe.failure}"] if probe.failure else []
        for name, unit in self._units.items():
            try:
                step = probe.steps[name]
                made = [each for reading in probe.readings for each in unit.comparisons(name, reading, step, results)]
                count += sum(each.places.size for each in made)
                wrong = [*unit.changed(name, probe.readings), *unit.wrong(made)]
            except VdfmuError as error:
                faults.append(f"{name}: its methods fail in numpy: {error}")
                continue
            faults += [f"{name}.{fault}" for fault in wrong[:_SHOWN]]
            if len(wrong) > _SHOWN:
                faults.append(f"{name}: {len(wrong) - _SHOWN} more numbers")
        return {
            "components": list(self._units) if probe.readings else [],
            "left_out": self._left if probe.readings else [*self._left, *self._units],
            "times_s": [reading.time for reading in probe.readings],
            "numbers": count,
            "faults": faults,
        }


class _WitnessedUnit:
    """A component in numpy, with the parameters of the scenario."""

    def __init__(self, interface: Interface, values: Mapping[str, Any], free: Sequence[int]) -> None:
        self._names = [v.name for v in interface.memory]
        self._groups = np.unique([v.group for v in interface.memory], return_inverse=True)[1]
        self._plain = plain = Plain(interface, interface.memory_of(values))
        self._initial = plain.memory.copy()
        roles = np.array([v.causality for v in interface.memory])
        kept = np.array([v.variability == "discrete" for v in interface.memory])
        moved = np.zeros(roles.size, bool)
        moved[interface.states] = True
        self._fixed = [*np.flatnonzero(roles == "parameter").tolist(), *free]
        self._sampled = np.flatnonzero((roles == "output") & kept)
        self._moved = np.flatnonzero(moved)
        self._rates = np.arange(interface.derivatives.start, interface.derivatives.stop)
        self._made = np.flatnonzero((roles == "output") & ~kept & ~moved)
        self._real = np.array([v.type == "Real" for v in interface.memory])
        self._inputs = np.flatnonzero(roles == "input")

    def step(self, step: float) -> float:
        """Return the length [s] of a further step that changes the states. 0 for a unit without states."""
        if self._moved.size:
            return _SHORT * step
        return float(self._plain.group("period")[0]) if self._sampled.size else 0.0

    def changed(self, name: str, readings: Sequence[Reading]) -> list[str]:
        """Return parameters and free inputs that differ from the scenario, as texts."""
        texts = {
            i: f"{self._names[i]} at t = {reading.time:.9g} s: expected {self._initial[i]:.17g}, got {got:.17g}"
            for reading in reversed(readings)
            for i in self._fixed
            if (got := reading.values[name].get(i, self._initial[i])) != self._initial[i]
        }
        return list(texts.values())

    def comparisons(self, name: str, reading: Reading, step: float, results: Results) -> Iterator[_Comparison]:
        """Yield the comparisons of a row, with outputs from the results if recorded."""
        got = dict(reading.values[name])
        for i in self._made.tolist():
            signal = f"{name}.{self._names[i]}"
            if signal in results:
                got[i] = float(results[signal][reading.row])
        memory = self._initial.copy()
        memory[[*self._made, *self._rates]] = np.nan
        for i in (*self._inputs, *self._moved, *self._sampled):
            memory[i] = got[int(i)]
        memory[-1] = reading.time
        if reading.row == 0:
            states = np.concatenate([self._moved, self._sampled])
            yield self._compared(reading.time, states, got, memory, self._plain.start)
        yield self._compared(reading.time, self._made, got, memory, self._plain.outputs)
        rates = self._compared(reading.time, self._rates, got, memory, self._plain.derivatives)
        yield rates
        if name in reading.after:
            yield from self._further(memory, rates.expected, reading.after[name], step)

    def _run(self, memory: Floats, method: Callable[[], None]) -> Floats:
        self._plain.memory[:] = memory
        method()
        return self._plain.memory.copy()

    def _compared(
        self, time: float, places: npt.NDArray[np.intp], got: Numbers, memory: Floats, method: Callable[[], None]
    ) -> _Comparison:
        places = places[[int(i) in got for i in places]]  # a Python FMU lacks derivatives
        values = np.array([got[int(i)] for i in places])

        def again(memory: Floats) -> Floats:
            return self._run(memory, method)[places] if places.size else values

        return _Comparison(time, places, again(memory), values, 0.0, memory, again)

    def _further(self, memory: Floats, first: Floats, after: Numbers, step: float) -> Iterator[_Comparison]:
        """Yield sampled states and mean rates after a further step, with the known derivatives `first` at its start."""
        plain, begin = self._plain, float(memory[-1])

        def update() -> None:
            for time, _, due in samples(plain, 0.0, begin, begin + step):
                if due:
                    plain.memory[-1] = time
                    plain.update()
            plain.memory[-1] = begin

        if self._sampled.size:
            yield self._compared(begin + step, self._sampled, after, memory, update)
            memory = self._run(memory, update)
        if not self._moved.size:
            return
        there = memory.copy()
        there[self._moved] = [after[int(i)] for i in self._moved]
        there[-1] = begin + step

        def rates(start: Floats) -> Floats:
            return self._run(start, plain.derivatives)[self._rates]

        if self._sampled.size or not first.size:
            first = rates(memory)
        last = rates(there)
        moved = (there - memory)[self._moved] / step
        rounding = _LAST_PLACES * np.maximum(np.abs(memory), np.abs(there))[self._moved] / step
        allowed = 0.5 * np.abs(last - first) + rounding
        mean = 0.5 * (first + last)
        yield _Comparison(begin, self._rates, mean, moved, allowed, memory, lambda start: mean + rates(start) - first)

    def wrong(self, comparisons: Sequence[_Comparison]) -> list[str]:
        """Return the numbers that are too far off as texts, the farthest first."""
        sizes = np.zeros(self._groups.max() + 1)
        for each in comparisons:
            np.maximum.at(sizes, self._groups[each.places], np.abs(each.expected))
        sizes = np.maximum(sizes, np.spacing(sizes.max()))
        faults: list[tuple[float, str]] = []
        for each in comparisons:
            groups = self._groups[each.places]
            apart = np.abs(each.got - each.expected)
            limit = each.allowed + _ROUNDING * sizes[groups]
            if np.all(apart <= limit):
                continue
            changes = np.zeros(sizes.size)
            for sign in (1.0, -1.0):
                change = np.abs(each.again(self._off(each.memory, sign)) - each.expected)
                np.maximum.at(changes, groups, change)
            limit = limit + changes[groups]
            for k in np.flatnonzero(~(apart <= limit)).tolist():
                text = f"{self._names[each.places[k]]} at t = {each.time:.9g} s: expected {each.expected[k]:.12g}"
                faults.append((apart[k] / limit[k], f"{text}, got {each.got[k]:.12g}"))
        return [text for _, text in sorted(faults, reverse=True)]

    def _off(self, memory: Floats, sign: float) -> Floats:
        """Return a memory with real numbers off by `_ROUNDING`, alternately up and down."""
        signs = sign * (1.0 - 2.0 * (np.arange(memory.size) % 2))
        return np.where(self._real, memory * (1.0 + _ROUNDING * signs), memory)
