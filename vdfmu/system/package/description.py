"""The system of a scenario, for all formats: signals, connections and parameter sets of its units."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from vdfmu.base.standards import SSP_1, SSP_FORMATS
from vdfmu.compiler.fmu.description import FMI_3_TYPES
from vdfmu.compiler.unit.interface import Interface, Variable, general_description
from vdfmu.system.scenario import Scenario
from vdfmu.system.scenario.scenario import Variables
from vdfmu.system.scenario.system_file import Box, SystemFile
from vdfmu.system.scenario.values import system_values


class PackageSignal(NamedTuple):
    """A variable as tools see it: a scalar, or an array of FMI 3."""

    name: str
    """Name in the FMU."""
    variables: tuple[Variable, ...]
    """Elements, row by row."""
    shape: tuple[int, ...]
    """Shape, empty for a scalar."""
    type: str
    """Name in the format."""

    @property
    def group(self) -> str:
        """Name without indices."""
        return self.variables[0].group

    @property
    def kind(self) -> str:
        """Causality."""
        return self.variables[0].causality

    @property
    def unit(self) -> str | None:
        """Unit of measurement."""
        return self.variables[0].unit

    @property
    def description(self) -> str:
        """Description, for an array without the index."""
        text = self.variables[0].description
        return general_description(text) if self.shape else text


class ElementConnection(NamedTuple):
    """A connection. An element of an array has an index, counted from 1."""

    start: tuple[str, PackageSignal]
    end: tuple[str, PackageSignal]
    start_index: tuple[int, ...] = ()
    end_index: tuple[int, ...] = ()


Entry = tuple[PackageSignal, tuple[Any, ...]]
"""A parameter and the values of its elements."""


class ParameterSet(NamedTuple):
    """Parameters of a file."""

    name: str
    entries: tuple[Entry, ...]


class Binding(NamedTuple):
    """Binding of a parameter set to a component."""

    file: str
    """Name of the set's file."""
    mapping: tuple[tuple[str, str], ...] = ()
    """Names in the set and in the component; empty if they are equal."""


class SystemDescription:
    """The system of a scenario with its variables, and with values by component and variable.

    `values` default to :func:`vdfmu.system.scenario.values.system_values`. With `version` "2.0" of SSP, groups of
    signals are the arrays of the FMI 3.0 units.
    """

    def __init__(
        self, scenario: Scenario, values: Mapping[str, Mapping[str, Any]] | None = None, version: str = SSP_1.name
    ) -> None:
        self.scenario = scenario
        self.version = version
        self.arrays = SSP_FORMATS[version].fmi.arrays
        self.values: Mapping[str, Mapping[str, Any]] = system_values(scenario) if values is None else values
        system = scenario.system
        self.name, self.description = system.name, system.description
        self.full_name = f"{self.name}_{scenario.name}"
        self.connections, self._shared = system.connections, system.shared
        self.resolved = scenario.resolved
        self.tables = self.resolved.tables
        self.corners = _corners(system)
        self._signals = {component: self._signals_of(table) for component, table in self.tables.items()}

    def fmu_name(self, component: str) -> str:
        """Return the file of a component's FMU in a package. Links and joints of the same kind share a file."""
        table = self.tables[component]
        model = table.model_name
        shared = isinstance(table, Interface) and table.unit.exchange
        alone = shared or [table.model_name for table in self.tables.values()].count(model) == 1
        return f"{model}.fmu" if alone else f"{model}_{component}.fmu"

    def _signals_of(self, table: Variables) -> tuple[PackageSignal, ...]:
        if not self.arrays or not isinstance(table, Interface):
            return tuple(PackageSignal(v.name, (v,), (), v.type) for v in table)
        arrays = ((array, table.memory[array.positions]) for array in table.arrays)
        return tuple(
            PackageSignal(array.name, variables, array.shape, FMI_3_TYPES[variables[0].type])
            for array, variables in arrays
            if variables[0].causality in ("input", "output", "parameter")
        )

    def signals(self, component: str, kind: str) -> tuple[PackageSignal, ...]:
        """Return the signals of a component with a causality, in the order of its table."""
        return tuple(s for s in self._signals[component] if s.kind == kind)

    @cached_property
    def tolerance(self) -> float:
        """Tolerance of the first plant's solver, else of the first solver."""
        tolerances = (self.values.get(name, {}).get("tolerance") for name in (*self.resolved.plants, *self.values))
        return float(next((value for value in tolerances if value is not None), self.scenario.tolerance))

    @cached_property
    def links(self) -> tuple[ElementConnection, ...]:
        """All connections."""
        return tuple(
            link
            for source, targets in self.connections.items()
            for target in targets
            for link in self._links(source, target)
        )

    def _links(self, source: str, target: str) -> list[ElementConnection]:
        """Return a connection of whole arrays, or one per element."""
        start, end = (name.partition(".")[0] for name in (source, target))
        joined = self.resolved.joined(source, target)
        pairs = [(self._signal_of[start, a.name], self._signal_of[end, b.name]) for a, b in joined]
        whole = len(set(pairs)) == 1 and all(a.index == b.index for a, b in joined)
        if whole and all(signal.shape and len(signal.variables) == len(pairs) for signal in pairs[0]):
            return [ElementConnection((start, pairs[0][0]), (end, pairs[0][1]))]
        return [
            ElementConnection((start, first), (end, second), _counted(first, a), _counted(second, b))
            for (a, b), (first, second) in zip(joined, pairs, strict=True)
        ]

    @cached_property
    def _signal_of(self) -> dict[tuple[str, str], PackageSignal]:
        return {(name, v.name): s for name, signals in self._signals.items() for s in signals for v in s.variables}

    @cached_property
    def measures(self) -> list[str]:
        """Names of all units of measurement of the connectors."""
        units = {s.unit for signals in self._signals.values() for s in signals if s.kind != "parameter"}
        return sorted(unit for unit in units if unit)

    @cached_property
    def parameter_sets(self) -> dict[str, ParameterSet]:
        """File name to its set."""
        return self._sets[0]

    @cached_property
    def bindings(self) -> dict[str, list[Binding]]:
        """Component to its sets, in the order of application. Each value is in only one set.

        The scenario's set comes first, because some importers apply only the first set; the robot is also in the FMUs'
        start values.
        """
        return self._sets[1]

    @cached_property
    def _sets(self) -> tuple[dict[str, ParameterSet], dict[str, list[Binding]]]:
        files: dict[str, ParameterSet] = {}
        bindings: dict[str, list[Binding]] = {component: [] for component in self.tables}
        left = {component: self._entries(component) for component in self.tables}
        shared = self._take_shared(left)
        robots: dict[str, dict[str, Entry]] = {}
        arm = self.scenario.robot
        nominal = {p.name: float(getattr(arm, p.field)[p.index]) for p in arm.entries()} if arm else {}
        for component, entries in left.items():
            robots[component] = robot = {
                name: (signal, values)
                for name, (signal, values) in entries.items()
                if all(nominal.get(v.name) == x for v, x in zip(signal.variables, values, strict=True))
            }
            rest = tuple(entry for name, entry in entries.items() if name not in robot)
            if rest:
                files[f"{component}.scenario.ssv"] = ParameterSet("scenario", rest)
                bindings[component].append(Binding(f"{component}.scenario.ssv"))
        for component, robot in robots.items():
            if robot:
                # components with all parameters of the robot share a file
                whole = {v.name for signal, _ in robot.values() for v in signal.variables} == nominal.keys()
                file = "robot.ssv" if whole else f"{component}.robot.ssv"
                files[file] = ParameterSet("robot", tuple(robot.values()))
                bindings[component].append(Binding(file))
        for name, (entries, mappings) in shared.items():
            files[f"{name}.ssv"] = ParameterSet(name, entries)
            for component, mapping in mappings.items():
                bindings[component].append(Binding(f"{name}.ssv", mapping))
        return files, bindings

    def _entries(self, component: str) -> dict[str, Entry]:
        """Return the parameters of a component that have a value for any element."""
        values = self.values[component]
        return {
            s.name: (s, tuple(values.get(v.name, v.start) for v in s.variables))
            for s in self._signals[component]
            if any(v.name in values for v in s.variables)
        }

    def _take_shared(self, left: dict[str, dict[str, Entry]]) -> dict[str, Any]:
        """Move equal shared parameters out of `left`; return name to entries, and component to mapping."""
        taken: dict[str, Any] = {}
        for name, groups in self._shared.items():
            members = {
                component: [entry for entry in left[component].values() if entry[0].group == group]
                for component, group in groups.items()
            }
            first = next(iter(members.values()))
            keys = [[_key(entry) for entry in entries] for entries in members.values()]
            if not first or any(other != keys[0] for other in keys):
                continue
            mappings: dict[str, tuple[tuple[str, str], ...]] = {}
            for component, entries in members.items():
                pairs = tuple((a[0].name, b[0].name) for a, b in zip(first, entries, strict=True))
                mappings[component] = pairs if any(a != b for a, b in pairs) else ()
                for _, key in pairs:
                    del left[component][key]
            taken[name] = (tuple(first), mappings)
        return taken


def _counted(signal: PackageSignal, variable: Variable) -> tuple[int, ...]:
    """Return the index of an element of an array, counted from 1."""
    return tuple(i + 1 for i in variable.index) if signal.shape else ()


def _corners(system: SystemFile) -> dict[str, Box]:
    """Return the corners of every component in the diagram. Components without a box are in columns on the right."""
    boxes = [part.box for part in system.parts.values() if part.box is not None]
    x = max((box[2] for box in boxes), default=-60.0) + 60.0
    bottom = min((box[1] for box in boxes), default=0.0)
    corners: dict[str, Box] = {}
    for name, part in system.parts.items():
        corners[name] = part.box or (x, bottom, x + 70.0, bottom + 100.0)
        x += 130.0 if part.box is None else 0.0
    return corners


def _key(entry: Entry) -> tuple[Any, ...]:
    """Return the properties that entries must share to share a value."""
    signal, values = entry
    return signal.shape, signal.type, signal.unit, tuple(v.index for v in signal.variables), tuple(values)


def positions(signals: Sequence[PackageSignal]) -> list[float]:
    """Return the heights, 0 to 1, of connectors on a side of the box: even, with a gap before each group."""
    begins = [k == 0 or signal.group != signals[k - 1].group for k, signal in enumerate(signals)]
    slots = np.arange(len(signals)) + np.cumsum(begins)
    return np.round(1.0 - slots / (len(signals) + sum(begins) + 1.0), 6).tolist()
