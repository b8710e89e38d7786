"""The components of a scenario's system: their variables, and their FMUs."""

from __future__ import annotations

import os
from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from vdfmu.arm.fmus import build_fmus
from vdfmu.arm.robot import Robot
from vdfmu.arm.units import find_unit
from vdfmu.base.errors import UsageError
from vdfmu.base.measure import measure
from vdfmu.base.toml_tables import nearest
from vdfmu.compiler.fmu.build import choose_backend
from vdfmu.compiler.fmu.content import Content
from vdfmu.compiler.functions.cache import cache_folder, load, store
from vdfmu.compiler.unit.base import unit_name
from vdfmu.compiler.unit.interface import Interface
from vdfmu.compiler.unit.unit import Unit
from vdfmu.compiler.unit.variable import Variable
from vdfmu.system.scenario.foreign import ForeignInterface
from vdfmu.system.scenario.scenario import ROBOT_WAY_OUT, Scenario
from vdfmu.system.scenario.system_file import SystemFile

Variables = Interface | ForeignInterface
"""The variables of a component."""


def units_of(system: SystemFile) -> dict[str, type[Unit]]:
    """Units of a system by component, without those that are FMUs of any tool."""
    parts = {name: part for name, part in system.parts.items() if part.fmu is None}
    # a file is run once for all its components
    found = {
        unit: unit if isinstance(unit, type) else find_unit(unit)
        for unit in {part.unit for part in parts.values()}
    }
    return {name: found[part.unit] for name, part in parts.items()}


def takers(system: SystemFile, units: Mapping[str, type[Unit]]) -> list[str]:
    """Components that take the robot of a scenario: units that need one and have none of their own."""
    return [name for name, unit in units.items() if unit.needs_robot() and system.parts[name].robot is None]


def tables_of(
    system: SystemFile, robot: Robot | None, components: Collection[str] | None = None
) -> dict[str, Variables]:
    """Variables of the components of a system, or of some of them, by component.

    Raises
    ------
    UsageError
        If there is no robot, and some component takes it.
    """
    units = units_of(system)
    if robot is None and (lacking := takers(system, units)):
        raise UsageError(
            f"robot: expected one for {', '.join(lacking)}, got none. {ROBOT_WAY_OUT} Or give each of these components "
            f'one of its own: {lacking[0]} = {{ unit = "..", robot = ".." }} in the system file.'
        )
    found: dict[str, Variables] = {}
    for name, part in system.parts.items():
        if components is not None and name not in components:
            continue
        if part.fmu is not None:
            found[name] = ForeignInterface(part.fmu)
        else:
            found[name] = Interface(units[name], part.robot_of(robot) if units[name].needs_robot() else None)
    return found


def check_connections(system: SystemFile, tables: Mapping[str, Variables]) -> None:
    """Raise UsageError for connections that cannot be made, with a line for each problem.

    Those of signals that the components do not have, that share no index, differ in their units of measurement, or feed
    an input twice.
    """
    problems: list[str] = []
    feeds: dict[tuple[str, str], str] = {}
    for source, targets in system.connections.items():
        starts = _signals(tables, source, "output", problems)
        for target in targets:
            ends = _signals(tables, target, "input", problems)
            shared = [(starts[index], ends[index]) for index in ends if index in starts]
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
                    problems.append(
                        f"{target}: expected one output that feeds it, got {earlier} and {source}."
                    )
    if problems:
        raise UsageError(
            "\n".join(f"{system.path}: connections: {problem}" for problem in dict.fromkeys(problems))
        )


def end_signals(table: Variables, name: str, causality: str) -> dict[tuple[int, ...], Variable]:
    """Variables of one end of a connection by their indices; one element, ``q[1]``, is a scalar."""
    found = [v for v in table if v.causality == causality and name in (v.group, v.name)]
    return {v.index if v.group == name else (): v for v in found}


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
    found = end_signals(tables[component], name, causality)
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


def build_parts(
    scenario: Scenario,
    folder: str | os.PathLike[str],
    values: Mapping[str, Mapping[str, Any]] | None = None,
    *,
    backend: str | None = None,
    fmi_version: str = "2.0",
    platforms: Sequence[str] | str | None = None,
) -> dict[str, Path]:
    """Build the FMUs of the scenario's system, or take those that are there; component to its FMU.

    `values` are start values by component; other arguments as of :func:`vdfmu.build_fmus`. Components of one
    unit have an FMU each if their start values differ.
    """
    units = units_of(scenario.system)
    robots = {name: scenario.system.parts[name].robot_of(scenario.robot) for name in units}
    placed = _placed(units, robots, values or {}, Path(folder))
    found: dict[str, Path] = {
        name: part.fmu for name, part in scenario.system.parts.items() if part.fmu is not None
    }
    for place, robot in dict.fromkeys((placed[name], robots[name]) for name in units):
        here = {name: unit for name, unit in units.items() if (placed[name], robots[name]) == (place, robot)}
        built = build_fmus(
            robot,
            place,
            units=list(dict.fromkeys(here.values())),
            start_values={unit_name(unit): dict((values or {}).get(name, {})) for name, unit in here.items()},
            backend=backend,
            fmi_version=fmi_version,
            platforms=platforms,
        )
        found |= {name: built[unit_name(unit)] for name, unit in here.items()}
    return {name: found[name] for name in scenario.system.parts}


def _placed(
    units: Mapping[str, type[Unit]],
    robots: Mapping[str, Robot | None],
    values: Mapping[str, Mapping[str, Any]],
    folder: Path,
) -> dict[str, Path]:
    """Folder of each component's FMU: one of its own where another unit, robot, or start values have its name."""
    placed: dict[str, Path] = {}
    taken: dict[str, tuple[type[Unit], Robot | None, dict[str, Any]]] = {}
    for name, unit in units.items():
        mine = unit, robots[name] if unit.needs_robot() else None, dict(values.get(name, {}))
        names = (unit.__name__, unit_name(unit))
        placed[name] = folder if all(taken.get(key, mine) == mine for key in names) else folder / name
        if placed[name] == folder:
            taken |= dict.fromkeys(names, mine)
    return placed


def cached_fmus(
    scenario: Scenario,
    folder: str | os.PathLike[str],
    backend: str | None = None,
    fmi_version: str = "2.0",
) -> dict[str, Path]:
    """FMUs of a scenario's system in `folder`: those that the cache has, by their content, and the others built."""
    backend = choose_backend(backend)
    cached: dict[str, bytes | None] = {}
    places: dict[str, Path] = {}
    units = units_of(scenario.system)
    robots = {name: scenario.system.parts[name].robot_of(scenario.robot) for name in units}
    placed = _placed(units, robots, {}, Path(folder))
    for name, unit in units.items():
        robot = robots[name] if unit.needs_robot() else None
        own = ("python", "2.0") if unit.backend == "python" else (backend, fmi_version)
        places[name] = cache_folder() / "fmus" / Content(unit, robot, {}, *own).guid.strip("{}")
        cached[name] = content = load(places[name])
        if content is not None:
            with suppress(OSError):  # of which the build then says more
                placed[name].mkdir(parents=True, exist_ok=True)
                (placed[name] / f"{unit.__name__}.fmu").write_bytes(content)
    fmus = build_parts(scenario, folder, backend=backend, fmi_version=fmi_version)
    for name, place in places.items():
        content = fmus[name].read_bytes()
        if content != cached[name]:
            store(place, content)
    return fmus
