"""The components of a system for a robot: the unit, the robot and the variables of each, and what connects them."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Mapping
from functools import cached_property
from pathlib import Path
from typing import Any

import fmpy

from vdfmu.arm.robot import Robot
from vdfmu.arm.units import find_unit
from vdfmu.arm.units.plant import Plant
from vdfmu.base.errors import UsageError
from vdfmu.base.measure import measure
from vdfmu.base.once import cached_per_command
from vdfmu.base.standards import FMI_VERSIONS
from vdfmu.base.text import nearest
from vdfmu.compiler.unit import Input, Output, Unit
from vdfmu.compiler.unit.interface import Interface, Variable, interface_of
from vdfmu.engine.fmu.variables import element_names, start_values, type_of
from vdfmu.system.scenario.system_file import SystemFile

_INDEXED = re.compile(r"(.+)\[(\d+(?:,\d+)*)\]")
_TYPES = ("Real", "Integer", "Boolean")


class ForeignInterface:
    """Variables of an FMU of FMI 2.0 or 3.0; names ``q[1]``, and elements of arrays, are elements of the group ``q``.

    Raises
    ------
    UsageError
        For a file that is not such an FMU.
    """

    robot = None

    def __init__(self, path: Path) -> None:
        if not path.is_file():
            raise UsageError(f"{path}: there is no such FMU.")
        try:
            description: Any = fmpy.read_model_description(str(path), validate=False)
        except Exception as error:
            raise UsageError(f"{path}: the FMU cannot be read: {error}.") from None
        part = description.coSimulation or description.modelExchange
        if description.fmiVersion not in FMI_VERSIONS or part is None:
            raise UsageError(
                f"{path}: expected an FMU of FMI {' or '.join(FMI_VERSIONS)} for co-simulation or model exchange, got "
                f"FMI {description.fmiVersion}{'' if part else ' with neither'}."
            )
        self.path = path
        self.implementation = "CoSimulation" if description.coSimulation else "ModelExchange"
        self.model_name: str = part.modelIdentifier
        self.description: str = description.description or description.modelName
        self.variables = tuple(each for found in description.modelVariables for each in _variables(found))

    @property
    def name(self) -> str:
        """Its name in messages."""
        return self.path.name

    def __iter__(self) -> Any:
        return iter(self.variables)

    def __len__(self) -> int:
        return len(self.variables)

    @cached_property
    def reference(self) -> dict[str, int]:
        """Name to position in the variables."""
        return {v.name: i for i, v in enumerate(self.variables)}


def _variables(found: Any) -> Iterator[Variable]:
    """Yield the elements of a variable that can be connected or set; none of others, such as strings."""
    if type_of(found.type) not in _TYPES or found.causality not in ("input", "output", "parameter"):
        return
    low, high = (None if text is None else float(text) for text in (found.min, found.max))
    unit = found.unit or getattr(found.declaredType, "unit", None)
    settable = found.start is not None and found.causality != "output"
    for name, start in zip(element_names(found.name, found.shape), start_values(found), strict=True):
        match = _INDEXED.fullmatch(name)
        group = match[1] if match else name
        index = tuple(int(i) - 1 for i in match[2].split(",")) if match else ()
        yield Variable(
            group, index, type_of(found.type), found.causality, found.variability or "continuous", unit,
            start if settable else None, found.description or "", minimum=low, maximum=high,
        )  # fmt: skip


Variables = Interface | ForeignInterface
"""The variables of a component."""
ROBOT_WAY_OUT = 'Name one in its file, such as robot = "manipulator_6dof".'


class ResolvedSystem:
    """A system for a robot, see :func:`resolve`: units and variables of its components, and its connections.

    Parameters
    ----------
    system : SystemFile
    robot : Robot or None
        The robot of the components that have none of their own.
    """

    def __init__(self, system: SystemFile, robot: Robot | None) -> None:
        self.system = system
        self.robot = robot

    @cached_property
    def units(self) -> dict[str, type[Unit]]:
        """Component to its unit, without those that are FMUs of any tool."""
        parts = {name: part for name, part in self.system.parts.items() if part.fmu is None}
        found = {unit: find_unit(unit) for unit in {part.unit for part in parts.values()}}  # a file is run once for all
        return {name: found[part.unit] for name, part in parts.items()}

    @cached_property
    def robots(self) -> dict[str, Robot | None]:
        """Component to its robot, also for units that do not read it."""
        return {name: self.system.parts[name].robot_of(self.robot) for name in self.units}

    @cached_property
    def takers(self) -> list[str]:
        """Components that take the robot of a scenario: units that need one and have none of their own."""
        return [n for n, unit in self.units.items() if unit.needs_robot() and self.system.parts[n].robot is None]

    @cached_property
    def plants(self) -> list[str]:
        """Components that are plants: a `Plant`, or a unit with its input tau, its output q, and its start q_0."""
        return [name for name, unit in self.units.items() if _is_plant(unit)]

    @cached_property
    def tables(self) -> dict[str, Variables]:
        """Component to its variables.

        Raises
        ------
        UsageError
            If there is no robot, and some component takes it.
        """
        if self.robot is None and (lacking := self.takers):
            raise UsageError(
                f"robot: expected one for {', '.join(lacking)}, got none. {ROBOT_WAY_OUT} Or give each of these "
                f'components one of its own: {lacking[0]} = {{ unit = "..", robot = ".." }} in the system file.'
            )
        found: dict[str, Variables] = {}
        for name, part in self.system.parts.items():
            if part.fmu is not None:
                found[name] = ForeignInterface(part.fmu)
            else:
                unit = self.units[name]
                found[name] = interface_of(unit, self.robots[name] if unit.needs_robot() else None)
        return found

    def links(self) -> Iterator[tuple[tuple[str, Variable], tuple[str, Variable]]]:
        """Yield every connection of single elements: component and variable of the output, the same of the input."""
        for source, targets in self.system.connections.items():
            for target in targets:
                for a, b in self.joined(source, target):
                    yield (source.partition(".")[0], a), (target.partition(".")[0], b)

    def joined(self, source: str, target: str) -> list[tuple[Variable, Variable]]:
        """Return the elements that a connection of two groups, or of single elements, joins."""
        (start, a), (end, b) = source.split(".", 1), target.split(".", 1)
        return _pairs(_end(self.tables[start], a, "output"), _end(self.tables[end], b, "input"))

    def check_connections(self) -> None:
        """Raise UsageError for connections that cannot be made, with a line for each problem.

        Those of signals that the components do not have, that share no index, differ in their units of measurement, or
        feed an input twice.
        """
        problems: list[str] = []
        feeds: dict[tuple[str, str], str] = {}
        for source, targets in self.system.connections.items():
            starts = _signals(self.tables, source, "output", problems)
            for target in targets:
                ends = _signals(self.tables, target, "input", problems)
                shared = _pairs(starts, ends)
                if starts and ends and not shared:
                    problems.append(
                        f"{source} -> {target}: expected signals of one shape, got {_shape(starts)} and {_shape(ends)}."
                    )
                for start, end in shared:
                    if None not in (a := _dimension(start), b := _dimension(end)) and a != b:
                        problems.append(
                            f"{source} -> {target}: expected one unit of measurement, got {start.unit} and {end.unit}."
                        )
                    fed = (target.partition(".")[0], end.name)
                    if (earlier := feeds.setdefault(fed, source)) != source or targets.count(target) > 1:
                        problems.append(f"{target}: expected one output that feeds it, got {earlier} and {source}.")
        if problems:
            raise UsageError(
                "\n".join(f"{self.system.path}: connections: {problem}" for problem in dict.fromkeys(problems))
            )


@cached_per_command
def resolve(system: SystemFile, robot: Robot | None) -> ResolvedSystem:
    """Return the components of a system for a robot, which are found once in a job."""
    return ResolvedSystem(system, robot)


def _is_plant(unit: type[Unit]) -> bool:
    declared = unit.declared
    return issubclass(unit, Plant) or (
        isinstance(declared.get("tau"), Input) and isinstance(declared.get("q"), Output) and "q_0" in declared
    )


def _end(table: Variables, name: str, causality: str) -> dict[tuple[int, ...], Variable]:
    """Variables of one end of a connection by their indices; one element, ``q[1]``, is a scalar."""
    found = [v for v in table if v.causality == causality and name in (v.group, v.name)]
    return {v.index if v.group == name else (): v for v in found}


def _pairs(
    starts: Mapping[tuple[int, ...], Variable], ends: Mapping[tuple[int, ...], Variable]
) -> list[tuple[Variable, Variable]]:
    """Return what has one index at both ends of a connection."""
    return [(starts[index], end) for index, end in ends.items() if index in starts]


def optional(table: Variables, name: str) -> str:
    """Say which option of its robot gives a component a variable that it lacks; empty if none does."""
    group = name.partition("[")[0]
    if not isinstance(table, Interface) or group in table.groups or group not in table.unit.declared:
        return ""
    return f"It is there for a robot with {table.unit.declared[group].when} only."


def _signals(
    tables: Mapping[str, Variables], end: str, causality: str, problems: list[str]
) -> dict[tuple[int, ...], Variable]:
    """Variables of one end of a connection by their indices; a problem if there are none."""
    component, _, name = end.partition(".")
    found = _end(tables[component], name, causality)
    if not found:
        known = list(dict.fromkeys(v.group for v in tables[component] if v.causality == causality))
        way = optional(tables[component], name) or nearest(name, known)
        problems.append(f"{end}: expected an {causality} of {component}, got {name!r}. {way}")
    return found


def _shape(signals: Collection[tuple[int, ...]]) -> str:
    return str(tuple(1 + max(axis) for axis in zip(*signals, strict=True)))


def _dimension(variable: Variable) -> dict[str, int] | None:
    """Exponents of the base units of a signal; None where they are not known, as of an FMU of another tool."""
    try:
        return measure(variable.unit).exponents if variable.unit else None
    except UsageError:
        return None
