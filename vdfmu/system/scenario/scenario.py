"""A scenario, and its system for a robot: unit, robot and variables of each component, and the connections."""

from __future__ import annotations

from collections.abc import Collection, Container, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import fmpy
import numpy as np

from vdfmu.arm.robot import Robot
from vdfmu.arm.robot.parameters import PARAMETERS
from vdfmu.arm.units import find_unit
from vdfmu.arm.units.plant import Plant
from vdfmu.base.arrays import Floats
from vdfmu.base.cache import cached_per_command
from vdfmu.base.errors import UsageError
from vdfmu.base.measure import measure
from vdfmu.base.standards import FMI_VERSIONS
from vdfmu.base.text import nearest
from vdfmu.compiler.unit import Input, Output, Unit
from vdfmu.compiler.unit.interface import Interface, Variable, interface_of
from vdfmu.engine.fmu.variables import element_names, start_values, type_of
from vdfmu.engine.options import CouplingOptions, SimulatorOptions
from vdfmu.engine.results.results import group_of
from vdfmu.system.scenario.system_file import SystemFile

_TYPES = ("Real", "Integer", "Boolean")


class ForeignInterface:
    """Variables of an FMU of FMI 2.0 or 3.0, else UsageError. ``q[1]`` and elements of arrays are in group ``q``."""

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
        self.variables = tuple(each for variable in description.modelVariables for each in _variables(variable))

    @property
    def name(self) -> str:
        """Name of the table in messages."""
        return self.path.name

    def __iter__(self) -> Any:
        return iter(self.variables)

    def __len__(self) -> int:
        return len(self.variables)

    @cached_property
    def reference(self) -> dict[str, int]:
        """Name to position in the variables."""
        return {v.name: i for i, v in enumerate(self.variables)}


def _variables(v: Any) -> Iterator[Variable]:
    """Yield the elements of a variable that can be connected or set, which excludes strings."""
    if type_of(v.type) not in _TYPES or v.causality not in ("input", "output", "parameter"):
        return
    low, high = (None if text is None else float(text) for text in (v.min, v.max))
    unit = v.unit or getattr(v.declaredType, "unit", None)
    settable = v.start is not None and v.causality != "output"
    for name, start in zip(element_names(v.name, v.shape), start_values(v), strict=True):
        group, index = group_of(name)
        yield Variable(
            group,
            tuple(i - 1 for i in index),
            type_of(v.type),
            v.causality,
            v.variability or "continuous",
            unit,
            start if settable else None,
            v.description or "",
            minimum=low,
            maximum=high,
        )


Variables = Interface | ForeignInterface
"""The variables of a component."""
ROBOT_WAY_OUT = 'Name one in its file, such as robot = "manipulator_6dof".'


class ResolvedSystem:
    """A system for a default robot, see :func:`resolve`: its components' units and variables, and its connections."""

    def __init__(self, system: SystemFile, robot: Robot | None) -> None:
        self.system, self.robot = system, robot

    @cached_property
    def units(self) -> dict[str, type[Unit]]:
        """Component to unit, without FMUs of other tools."""
        parts = {name: part for name, part in self.system.parts.items() if part.fmu is None}
        units = {unit: find_unit(unit) for unit in {part.unit for part in parts.values()}}  # runs each file once
        return {name: units[part.unit] for name, part in parts.items()}

    @cached_property
    def robots(self) -> dict[str, Robot | None]:
        """Component to robot, even if the unit does not read it."""
        return {name: self.system.parts[name].robot_of(self.robot) for name in self.units}

    @cached_property
    def takers(self) -> list[str]:
        """Components that use the scenario's robot, because they need one and their part names none."""
        return [n for n, unit in self.units.items() if unit.needs_robot() and self.system.parts[n].robot is None]

    @cached_property
    def plants(self) -> list[str]:
        """Components that are plants: a `Plant`, or a unit with input tau, output q and start q_0."""
        return [name for name, unit in self.units.items() if _is_plant(unit)]

    @cached_property
    def tables(self) -> dict[str, Variables]:
        """Component to its variables. UsageError if a robot is missing."""
        if self.robot is None and (lacking := self.takers):
            raise UsageError(
                f"robot: expected one for {', '.join(lacking)}, got none. {ROBOT_WAY_OUT} Or give each of these "
                f'components its own robot: {lacking[0]} = {{ unit = "..", robot = ".." }} in the system file.'
            )
        return {
            name: ForeignInterface(part.fmu)
            if part.fmu is not None
            else interface_of(self.units[name], self.robots[name] if self.units[name].needs_robot() else None)
            for name, part in self.system.parts.items()
        }

    def links(self) -> Iterator[tuple[tuple[str, Variable], tuple[str, Variable]]]:
        """Yield every connection of elements: component and variable of the output, then of the input."""
        for source, targets in self.system.connections.items():
            for target in targets:
                for a, b in self.joined(source, target):
                    yield (source.partition(".")[0], a), (target.partition(".")[0], b)

    def joined(self, source: str, target: str) -> list[tuple[Variable, Variable]]:
        """Return the pairs of elements of a connection."""
        return _pairs(self.elements(source, "output"), self.elements(target, "input"))

    def elements(self, end: str, causality: str) -> dict[tuple[int, ...], Variable]:
        """Return index to variable of ``component.signal``; nothing without such a signal."""
        component, _, name = end.partition(".")
        return _end(self.tables[component], name, causality)

    def fits(self, source: str, target: str) -> bool:
        """Return whether an output and an input have the same shape and unit of measurement."""
        starts, ends = self.elements(source, "output"), self.elements(target, "input")
        return bool(ends) and starts.keys() == ends.keys() and all(_alike(starts[i], ends[i]) for i in ends)

    def is_fed(self, end: str, ends: Container[str]) -> bool:
        """Return whether an input, or each of its elements, is among some ends of connections."""
        component, elements = end.partition(".")[0], self.elements(end, "input").values()
        return end in ends or bool(elements) and all(f"{component}.{v.name}" in ends for v in elements)

    def check_connections(self, where: str = "") -> None:
        """Raise UsageError for unknown signals, signals without a common index or unit, and inputs with two outputs.

        `where` is the place of the connections in the error's lines, by default the system's file.
        """
        problems: list[str] = []
        feeds: dict[tuple[str, str], str] = {}
        for source, targets in self.system.connections.items():
            starts = _signals(self.tables, source, "output", problems)
            for target in targets:
                ends = _signals(self.tables, target, "input", problems)
                shared = _pairs(starts, ends)
                link = f"{source} -> {target}"
                if starts and ends and not shared:
                    got = f"{_shape(starts)} and {_shape(ends)}"
                    problems.append(f"{link}: expected signals of the same shape, got {got}.")
                for start, end in shared:
                    if not _alike(start, end):
                        problems.append(f"{link}: expected one unit of measurement, got {start.unit} and {end.unit}.")
                    fed = (target.partition(".")[0], end.name)
                    if (earlier := feeds.setdefault(fed, source)) != source or targets.count(target) > 1:
                        problems.append(f"{target}: expected one connected output, got {earlier} and {source}.")
        if problems:
            where = where or f"{self.system.path}: connections"
            raise UsageError("\n".join(f"{where}: {problem}" for problem in dict.fromkeys(problems)))


@cached_per_command
def resolve(system: SystemFile, robot: Robot | None) -> ResolvedSystem:
    """Return the components of a system for a robot, cached in a job."""
    return ResolvedSystem(system, robot)


def _is_plant(unit: type[Unit]) -> bool:
    declared = unit.declared
    return issubclass(unit, Plant) or (
        isinstance(declared.get("tau"), Input) and isinstance(declared.get("q"), Output) and "q_0" in declared
    )


def _end(table: Variables, name: str, causality: str) -> dict[tuple[int, ...], Variable]:
    """Return index to variable at an end of a connection. An element, ``q[1]``, is a scalar."""
    named = (v for v in table if v.causality == causality and name in (v.group, v.name))
    return {v.index if v.group == name else (): v for v in named}


def _pairs(
    starts: Mapping[tuple[int, ...], Variable], ends: Mapping[tuple[int, ...], Variable]
) -> list[tuple[Variable, Variable]]:
    """Return the variables with a common index."""
    return [(starts[index], end) for index, end in ends.items() if index in starts]


def optional(table: Variables, name: str) -> str:
    """Return a sentence about the robot's option with which a component has a missing variable, or an empty text."""
    group = name.partition("[")[0]
    if not isinstance(table, Interface) or group in table.groups or group not in table.unit.declared:
        return ""
    return f"It exists only for a robot with {table.unit.declared[group].when}."


def _signals(
    tables: Mapping[str, Variables], end: str, causality: str, problems: list[str]
) -> dict[tuple[int, ...], Variable]:
    """Return index to variable at an end of a connection; note a problem if there is none."""
    component, _, name = end.partition(".")
    if component not in tables:
        problems.append(f"{end}: expected component.signal, got {component!r}. {nearest(component, list(tables))}")
        return {}
    signals = _end(tables[component], name, causality)
    if not signals:
        groups = list(dict.fromkeys(v.group for v in tables[component] if v.causality == causality))
        way = optional(tables[component], name) or nearest(name, groups)
        problems.append(f"{end}: expected an {causality} of {component}, got {name!r}. {way}")
    return signals


def _shape(signals: Collection[tuple[int, ...]]) -> str:
    return str(tuple(1 + max(axis) for axis in zip(*signals, strict=True)))


def _alike(start: Variable, end: Variable) -> bool:
    """Return whether two signals have the same base units, as far as these are defined."""
    a, b = _dimension(start), _dimension(end)
    return None in (a, b) or a == b


def _dimension(variable: Variable) -> dict[str, int] | None:
    """Return the exponents of a signal's base units; None if they are unknown, as in FMUs of other tools."""
    try:
        return measure(variable.unit).exponents if variable.unit else None
    except UsageError:
        return None


_TINY = 1e-12
"""Fraction of the inertia that an unknown payload keeps, because zeros would change the structure."""
FACTOR_FIELDS = tuple(row.name for row in PARAMETERS.values() if row.fold != "always")
"""Fields of the robot that a plant factor may scale."""


@dataclass(frozen=True, eq=False)
class Scenario:
    """All data of a run.

    Parameters
    ----------
    name, description : str
    system : SystemFile
        The components and their connections.
    robot : Robot or None
        The nominal robot of the feedforward, with the scenario's friction arrangement if given. None if no component
        uses it.
    stop, step : float [s]
        End of the run, and communication step.
    algorithm : str
        Name of an algorithm of `vdfmu.engine.algorithms`.
    adaptive : float or None
        Largest relative error of a coupled signal in a step; None for steps of the given length.
    tolerance : float
        Relative tolerance of the plant's solver.
    plant_factors : mapping of str to float or (n,) array
        Field of the robot to its factor: plant = nominal * factor.
    sections : mapping of str to mapping
        Component to the values of the file: group or variable, ``K_p`` or ``K_p[1]``, to value or values.
        :func:`vdfmu.system.scenario.values.system_values` reads them.
    paper : mapping
        Values from the paper: `source`, and lists that start at joint 1. Empty if the paper reports none.
    payload_known : bool
        Whether components other than the plant include the robot's payload.
    inputs, input_hold : path, sequence of paths or mapping, optional, and bool
        Signals for free inputs, and whether they are held until the next row. See :func:`vdfmu.engine.run.simulate`.
    notes, file : tuple of str, str
        Notes of the author, and the scenario's file, empty for a shipped one.
    limits : mapping of str to float
        Limits of the verdict on its runs, see `vdfmu.study.limits`.
    options : CouplingOptions
        Other options of its runs.
    """

    name: str
    description: str
    system: SystemFile
    robot: Robot | None
    stop: float
    step: float
    algorithm: str
    adaptive: float | None
    tolerance: float
    plant_factors: Mapping[str, Floats | float]
    sections: Mapping[str, Mapping[str, Any]]
    paper: Mapping[str, Any]
    inputs: Any = None
    input_hold: bool = False
    payload_known: bool = True
    notes: tuple[str, ...] = ()
    limits: Mapping[str, float] = field(default_factory=dict[str, float])
    file: str = field(default="", compare=False)
    options: CouplingOptions = field(default_factory=CouplingOptions)

    @property
    def coupling(self) -> SimulatorOptions:
        """All options of the coupling."""
        return {**self.options, "algorithm": self.algorithm, "adaptive": self.adaptive}

    @property
    def resolved(self) -> ResolvedSystem:
        """The components of the system for the robot."""
        return resolve(self.system, self.robot)

    @property
    def arm(self) -> Robot:
        """The robot. UsageError if it is None."""
        if self.robot is None:
            raise UsageError(f"scenario {self.name} has no robot. {ROBOT_WAY_OUT}")
        return self.robot

    @property
    def plant_robot(self) -> Robot:
        """The robot of the plant: nominal times the factors."""
        return apply_factors(self.arm, self.plant_factors)

    @property
    def known_robot(self) -> Robot:
        """The robot of the other components: nominal, and without an unknown payload."""
        robot = self.arm
        if self.payload_known or not robot.payload:
            return robot
        return robot.with_parameters(payload_mass=0.0, payload_inertia=_TINY * robot.payload_inertia)


def apply_factors(robot: Robot, factors: Mapping[str, Floats | float]) -> Robot:
    """Return the robot with scaled fields. A factor has shape () or (n,)."""
    scaled: dict[str, Floats] = {}
    for key, factor in factors.items():
        nominal = getattr(robot, key)
        per_joint = np.asarray(factor, dtype=float)
        scaled[key] = nominal * per_joint.reshape(per_joint.shape + (1,) * (nominal.ndim - per_joint.ndim))
    return robot.with_parameters(**scaled) if scaled else robot
