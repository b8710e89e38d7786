"""The components of a system for a robot: the unit, the robot and the variables of each, and what connects them."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from functools import cached_property

from vdfmu.arm.robot import Robot
from vdfmu.arm.units import find_unit
from vdfmu.arm.units.plant import Plant
from vdfmu.base.errors import UsageError
from vdfmu.base.measure import measure
from vdfmu.base.once import cached_per_command
from vdfmu.base.text import nearest
from vdfmu.compiler.unit.declaration import Input, Output
from vdfmu.compiler.unit.interface import Interface, interface_of
from vdfmu.compiler.unit.unit import Unit
from vdfmu.compiler.unit.variable import Variable
from vdfmu.system.scenario.foreign import ForeignInterface
from vdfmu.system.scenario.system_file import SystemFile

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
