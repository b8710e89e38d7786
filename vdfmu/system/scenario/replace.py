"""Changes of a scenario: a payload, other units for some components, and the starts of plants."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from vdfmu.arm.motion.played import Played
from vdfmu.arm.robot import Robot
from vdfmu.arm.robot.parameters import read_only, section
from vdfmu.base.errors import UsageError
from vdfmu.compiler.unit import JOINTS, Output, Unit
from vdfmu.engine.package.join import Connections
from vdfmu.system.scenario.scenario import ResolvedSystem, Scenario, resolve
from vdfmu.system.scenario.system_file import SystemFile, rewired
from vdfmu.system.scenario.values import section_values

_PAYLOAD = {row.name for row in section("payload")}


def with_parameters(scenario: Scenario, names: Iterable[str]) -> Scenario:
    """Return the scenario whose robot has the parameters that these names set, see :func:`robot_for`."""
    robot = scenario.robot and robot_for(scenario.robot, names)
    return scenario if robot is scenario.robot else dataclasses.replace(scenario, robot=robot)


def unfolded(scenario: Scenario) -> Scenario:
    """Return the scenario with gravity, centres of mass, payload and tool of all robots as parameters."""
    robots = {name: part.robot.unfolded() for name, part in scenario.system.parts.items() if part.robot is not None}
    parts = {**scenario.system.parts}
    parts |= {name: dataclasses.replace(parts[name], robot=robot) for name, robot in robots.items()}
    return dataclasses.replace(
        scenario, robot=scenario.robot and scenario.robot.unfolded(),
        system=dataclasses.replace(scenario.system, parts=parts),
    )  # fmt: skip


def robot_for(robot: Robot, names: Iterable[str]) -> Robot:
    """Return the robot with named parameters that it lacks: an empty payload, zeros that are folded.

    Names are ``plant.payload_mass``, ``robot.gravity[1]``, or of a unit alone, ``gravity[1]``.
    """
    named = {name.rpartition(".")[2] for name in names}
    fields = {name.partition("[")[0] for name in named}
    here, spare = ({p.name for p in r.entries() if p.field not in _PAYLOAD} for r in (robot, robot.unfolded()))
    if named & (spare - here):
        robot = robot.unfolded()
    if fields.isdisjoint(_PAYLOAD):
        return robot
    if not robot.payload:
        robot = dataclasses.replace(robot, payload=True)
    if "payload_inertia" in fields and not robot.payload_inertia.any():  # zeros, a point mass, have no parameters
        robot = dataclasses.replace(robot, payload_inertia=read_only(1e-12 * np.eye(3)))
    return robot


def with_units(scenario: Scenario, units: Mapping[str, Any], connections: Connections = ()) -> Scenario:
    """Return the scenario with other units for some components, without connections and values that these lack.

    A new input is connected to the output of the same name if both are in a terminal and their components were
    connected. Last come the `connections`, output to input or inputs; these inputs lose the connections that they had.
    UsageError or UnitError for an unknown component or signal, or a value that is not a unit.
    """
    system, parts = scenario.system, dict(scenario.system.parts)
    for name, unit in units.items():
        if name not in parts:
            way_out = f"There are: {', '.join(parts)}."
            raise UsageError(f"units: the system {system.name} has no component {name!r}. {way_out}")
        if not (issubclass(unit, Unit) if isinstance(unit, type) else isinstance(unit, (str, os.PathLike))):
            raise UsageError(f"units: {name}: expected a unit, its name or its file, got {unit!r}.")
        value = unit if isinstance(unit, type) else os.fspath(unit)
        parts[name] = dataclasses.replace(parts[name], unit=value)
    system = dataclasses.replace(system, parts=parts)
    resolved = resolve(system, scenario.robot)
    tables = {name: table for name, table in resolved.tables.items() if name in units}
    has = {
        name: {(key, v.causality) for v in table if v.causality in ("input", "output") for key in (v.group, v.name)}
        for name, table in tables.items()
    }

    def lacks(signal: str, causality: str) -> bool:
        component, _, group = signal.partition(".")
        return component in has and (group, causality) not in has[component]

    kept: dict[str, list[str]] = {}
    dropped: list[str] = []
    for source, targets in system.connections.items():
        for target in targets:
            if lacks(source, "output") or lacks(target, "input"):
                dropped.append(f"{source} -> {target}")
            else:
                kept.setdefault(source, []).append(target)
    joined = _joined(scenario, resolved, tables)
    for source, target in joined:
        kept.setdefault(source, []).append(target)
    kept = rewired(kept, connections)
    if connections:
        resolve(dataclasses.replace(system, connections=kept), scenario.robot).check_connections("connections")
    ends = {end.partition(".")[0] for source, targets in kept.items() for end in (source, *targets)}
    for name, signals in has.items():
        if signals and name not in ends:
            raise UsageError(f"{name}: {_unfit(name, signals, system.connections)}")
    joints = tuple(f"{source} -> {target}" for source, target in joined if target in kept.get(source, ()))
    written = section_values(scenario.resolved, scenario.sections)
    sections = dict(scenario.sections)
    for name, table in tables.items():
        sections[name] = {v: value for v, value in written.get(name, {}).items() if v in table.reference}
    for name, unit in resolved.units.items():
        sections = started(system, name, unit, sections)
    system = dataclasses.replace(system, connections=kept, dropped=tuple(dropped), joined=joints)
    lost = [connection.partition(" -> ")[2].partition(".") for connection in dropped]
    unfed = {
        f"{name}.{group}": list(dict.fromkeys(end for component, _, end in lost if component == name))
        for name, table in tables.items() if name in scenario.resolved.units
        for group in dict.fromkeys(v.group for v in table if v.causality == "input")
        if not _has(scenario.resolved, name, group, "input")
        and not any(end.partition("[")[0] == f"{name}.{group}" for end in system.fed)
    }  # fmt: skip
    system = dataclasses.replace(system, unfed=unfed)
    return dataclasses.replace(scenario, system=system, sections=sections)


def _unfit(component: str, signals: Iterable[tuple[str, str]], connections: Mapping[str, Iterable[str]]) -> str:
    """Return why a unit does not fit into a system: what it has, and what the system connects there."""
    names = {
        kind: ", ".join(sorted({name.partition("[")[0] for name, has in signals if has == kind})) or "none"
        for kind in ("input", "output")
    }
    ends = [(source, target) for source, targets in connections.items() for target in targets]
    reads, gives = (
        ", ".join(dict.fromkeys(end.partition(".")[2] for end in part if end.partition(".")[0] == component))
        for part in ([target for _, target in ends], [source for source, _ in ends])
    )
    return (
        f"none of its signals fits the system. Its inputs are {names['input']}, its outputs {names['output']}; the "
        f"system connects the inputs {reads or 'none'} and the outputs {gives or 'none'}. Give its signals these names."
    )


def _joined(scenario: Scenario, resolved: ResolvedSystem, new: Iterable[str]) -> list[tuple[str, str]]:
    """Return the connections of new inputs of `new` components by terminals of the same name."""
    old, ends = scenario.resolved, scenario.system.connections.items()
    linked = {
        frozenset(end.partition(".")[0] for end in (source, target)) for source, targets in ends for target in targets
    }
    joined: list[tuple[str, str]] = []
    for name in (name for name in new if name in resolved.units and name in old.units):
        for terminal in resolved.units[name].terminals:
            for group in terminal.groups:
                if not _has(resolved, name, group, "input") or _has(old, name, group, "input"):
                    continue
                sources = [
                    f"{other}.{group}"
                    for other, unit in resolved.units.items()
                    if frozenset((name, other)) in linked and _has(resolved, other, group, "output")
                    and any(t.name == terminal.name and group in t.groups for t in unit.terminals)
                ]  # fmt: skip
                if len(sources) == 1:
                    joined.append((sources[0], f"{name}.{group}"))
    return joined


def _has(system: ResolvedSystem, component: str, group: str, causality: str) -> bool:
    return any(v.group == group and v.causality == causality for v in system.tables[component])


def leaders(resolved: ResolvedSystem) -> dict[str, str]:
    """Return plant to the component whose desired motion ``q_d`` reaches it first, if it is unique.

    Here a plant is any component with start positions of the joints, ``q_0``.
    """
    units = resolved.units
    plants = [name for name, unit in units.items() if _is_position(unit, "q_0")]
    leader_of: dict[str, str] = {}
    for plant in plants:
        before, new, leading = {plant}, [plant], set[str]()
        while new:
            end = new.pop()
            for source, targets in resolved.system.connections.items():
                name = source.partition(".")[0]
                if name in before or all(target.partition(".")[0] != end for target in targets):
                    continue
                before.add(name)
                if name in units and isinstance(units[name].declared.get("q_d"), Output):
                    leading.add(name)
                elif name not in plants:
                    new.append(name)
        if len(leading) == 1:
            leader_of[plant] = leading.pop()
    return leader_of


def with_starts(system: SystemFile) -> SystemFile:
    """Return the system whose plants share their start positions with their leaders, unless its file shares them."""
    resolved, shared = resolve(system, None), dict(system.shared)
    units = resolved.units
    for plant, leader in leaders(resolved).items():
        played = issubclass(units[leader], Played) or _is_position(units[leader], "q_start")
        stated = any(members.get(plant) == "q_0" for members in shared.values())
        if played and not stated and _joints(system, plant) == _joints(system, leader):
            names = (name for name, members in shared.items() if members.get(leader) == "q_start")
            name = next(names, "start" if "start" not in shared else f"start_{plant}")
            shared[name] = {leader: "q_start", **shared.get(name, {}), plant: "q_0"}
    return dataclasses.replace(system, shared=shared)


def started(
    system: SystemFile, component: str, unit: type[Unit], sections: Mapping[str, Mapping[str, Any]]
) -> dict[str, Any]:
    """Return the sections with the start of a motion for components that share it, unless they set it."""
    extended = dict(sections)
    if issubclass(unit, Played) and unit.rows is not None:
        for members in system.shared.values():
            for other, group in members.items():
                if members.get(component) == "q_start" and other != component:
                    extended[other] = {group: unit.begin()} | dict(extended.get(other, {}))
    return extended


def _is_position(unit: type[Unit], name: str) -> bool:
    """Whether a unit declares positions of the joints by this name."""
    declared = unit.declared.get(name)
    return declared is not None and declared.unit == "position" and declared.shape == (JOINTS,)


def _joints(system: SystemFile, component: str) -> tuple[str, ...] | None:
    """Return the types of joints if a component has its own robot, else None."""
    robot = system.parts[component].robot
    return None if robot is None else robot.joint_types
