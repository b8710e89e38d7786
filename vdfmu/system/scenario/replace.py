"""Changes a scenario: its payload, the units of some components, and the starts of plants."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from vdfmu.arm.motion.played import Played
from vdfmu.arm.robot import Robot
from vdfmu.arm.robot.parameters import read_only, section
from vdfmu.base.errors import UsageError
from vdfmu.compiler.unit import JOINTS, Output, Unit
from vdfmu.engine.package.system import Connections, ends_of
from vdfmu.system.scenario.scenario import ResolvedSystem, Scenario, resolve
from vdfmu.system.scenario.system_file import SystemFile, rewired
from vdfmu.system.scenario.values import section_values

_PAYLOAD = {row.name for row in section("payload")}


def with_parameters(scenario: Scenario, names: Iterable[str]) -> Scenario:
    """Return the scenario with a robot that has the parameters set by these names; see :func:`robot_for`."""
    robot = scenario.robot and robot_for(scenario.robot, names)
    return scenario if robot is scenario.robot else dataclasses.replace(scenario, robot=robot)


def unfolded(scenario: Scenario) -> Scenario:
    """Return the scenario in which gravity, centres of mass, payload and tool of all robots are parameters."""
    robots = {name: part.robot.unfolded() for name, part in scenario.system.parts.items() if part.robot is not None}
    parts = {**scenario.system.parts}
    parts |= {name: parts[name]._replace(robot=robot) for name, robot in robots.items()}
    return dataclasses.replace(
        scenario,
        robot=scenario.robot and scenario.robot.unfolded(),
        system=dataclasses.replace(scenario.system, parts=parts),
    )


def robot_for(robot: Robot, names: Iterable[str]) -> Robot:
    """Return the robot with these parameters added if it lacks them: an empty payload, or zeros that are folded.

    Names are ``plant.payload_mass``, ``robot.gravity[1]`` or, for a single unit, ``gravity[1]``.
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
    if "payload_inertia" in fields and not robot.payload_inertia.any():  # the zeros of a point mass have no parameters
        robot = dataclasses.replace(robot, payload_inertia=read_only(1e-12 * np.eye(3)))
    return robot


def with_units(scenario: Scenario, units: Mapping[str, Any], connections: Connections = ()) -> Scenario:
    """Return the scenario with other units for some components, dropping connections and values that no longer fit.

    A new input is connected to the output of the same name, shape and unit of measurement if exactly one of the
    components that were connected to the replaced one has it. Finally the `connections`, output to input or inputs, are
    added; these inputs lose their earlier connections. UsageError or UnitError for an unknown component or signal, or a
    value that is not a unit.
    """
    before, parts = scenario.resolved, dict(scenario.system.parts)
    for name, unit in units.items():
        if name not in parts:
            fix = f"There are: {', '.join(parts)}."
            raise UsageError(f"units: the system {scenario.system.name} has no component {name!r}. {fix}")
        if not (issubclass(unit, Unit) if isinstance(unit, type) else isinstance(unit, (str, os.PathLike))):
            raise UsageError(f"units: {name}: expected a unit, its name or its file, got {unit!r}.")
        value = unit if isinstance(unit, type) else os.fspath(unit)
        parts[name] = parts[name]._replace(unit=value)
    system = dataclasses.replace(scenario.system, parts=parts)
    resolved = resolve(system, scenario.robot)
    links = ends_of(system.connections)
    kept = [link for link in links if resolved.elements(link[0], "output") and resolved.elements(link[1], "input")]
    dropped = [link for link in links if link not in kept]
    inputs = [(name, v.group) for name in units for v in resolved.tables[name] if v.causality == "input"]
    new = [
        f"{name}.{group}" for name, group in dict.fromkeys(inputs) if not before.elements(f"{name}.{group}", "input")
    ]
    free = [end for end in new if all(end != target for _, target in ends_of(connections))]
    joined = [(sources[0], end) for end in free if len(sources := _sources(resolved, links, end)) == 1]
    links_now = [pair for link in (*kept, *joined) for pair in _split(resolved, link, connections)]
    system = dataclasses.replace(system, connections=rewired(rewired({}, links_now), connections))
    if connections:
        resolve(system, scenario.robot).check_connections("connections")
    for name in units:
        _require_connected(system, resolved, name, links)
    written = section_values(before, scenario.sections)
    sections = dict(scenario.sections)
    for name in units:
        values = written.get(name, {}).items()
        sections[name] = {v: value for v, value in values if v in resolved.tables[name].reference}
    for name, unit in resolved.units.items():
        sections = started(system, name, unit, sections)
    lost = [end for _, end in dropped if resolved.elements(end, "input")]
    outputs = (f"{name}.{v.group}" for name in units for v in resolved.tables[name] if v.causality == "output")
    sources = dict.fromkeys((*(source for source, _ in dropped), *outputs))
    system = dataclasses.replace(
        system,
        dropped=tuple(map(" -> ".join, dropped)),
        joined=tuple(map(" -> ".join, joined)),
        unfed={
            end: [each for each in sources if each.split(".")[0] != end.split(".")[0] and resolved.fits(each, end)]
            for end in dict.fromkeys([*new, *lost])
            if not resolved.is_fed(end, system.fed)
        },
    )
    return dataclasses.replace(scenario, system=system, sections=sections)


def _split(resolved: ResolvedSystem, link: tuple[str, str], added: Connections) -> list[tuple[str, str]]:
    """Return a connection, element by element if an added connection feeds an element of its input."""
    source, target = link
    if all(end == target or end.partition("[")[0] != target for _, end in ends_of(added)):
        return [link]
    starts, ends = resolved.elements(source, "output"), resolved.elements(target, "input")
    parts = source.partition(".")[0], target.partition(".")[0]
    return [(f"{parts[0]}.{starts[i].name}", f"{parts[1]}.{ends[i].name}") for i in ends if i in starts]


def _sources(resolved: ResolvedSystem, links: Sequence[tuple[str, str]], end: str) -> list[str]:
    """Return outputs that fit an input by name, shape and unit, from components that are connected to its own.

    If there are some in a terminal of the same name, only these are returned.
    """
    component, _, name = end.partition(".")
    pairs = [(source.partition(".")[0], target.partition(".")[0]) for source, target in links]
    near = dict.fromkeys(other for pair in pairs if component in pair for other in pair if other != component)
    fitting = [other for other in near if resolved.fits(f"{other}.{name}", end)]
    beside = _terminals(resolved, component, name)
    of_terminal = [other for other in fitting if beside & _terminals(resolved, other, name)]
    return [f"{other}.{name}" for other in of_terminal or fitting]


def _terminals(resolved: ResolvedSystem, component: str, group: str) -> set[str]:
    unit = resolved.units.get(component, Unit)
    return {terminal.name for terminal in unit.terminals if group in terminal.groups}


def _require_connected(
    system: SystemFile, resolved: ResolvedSystem, component: str, links: Sequence[tuple[str, str]]
) -> None:
    """Raise UsageError for a unit without connected signals, listing the connections of the replaced one."""

    def listed(ends: Iterable[str]) -> str:
        return (
            ", ".join(dict.fromkeys(end.partition(".")[2] for end in ends if end.startswith(f"{component}."))) or "none"
        )

    ends = [*system.connections, *system.fed]
    signals = {
        kind: [f"{component}.{v.group}" for v in resolved.tables[component] if v.causality == kind]
        for kind in ("input", "output")
    }
    if any(signals.values()) and listed(ends) == "none":
        raise UsageError(
            f"{component}: none of its signals fits the system. Its inputs are {listed(sorted(signals['input']))}, its "
            f"outputs {listed(sorted(signals['output']))}; the system connects the inputs "
            f"{listed(target for _, target in links)} and the outputs {listed(source for source, _ in links)}. Give "
            "its signals these names, or connect them: --connect."
        )


def leaders(resolved: ResolvedSystem) -> dict[str, str]:
    """Return plant to the component whose desired motion ``q_d`` reaches it first, if there is only one.

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
    """Return the system in which plants share start positions with their leaders, unless its file shares them."""
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
    """Return the sections with a motion's start for the components that share it, unless they set it."""
    extended = dict(sections)
    if issubclass(unit, Played) and unit.rows is not None:
        for members in system.shared.values():
            for other, group in members.items():
                if members.get(component) == "q_start" and other != component:
                    extended[other] = {group: unit.begin()} | dict(extended.get(other, {}))
    return extended


def _is_position(unit: type[Unit], name: str) -> bool:
    """Return whether a unit declares joint positions of this name."""
    declared = unit.declared.get(name)
    return declared is not None and declared.unit == "position" and declared.shape == (JOINTS,)


def _joints(system: SystemFile, component: str) -> tuple[str, ...] | None:
    """Return the joint types if a component has its own robot, else None."""
    robot = system.parts[component].robot
    return None if robot is None else robot.joint_types
