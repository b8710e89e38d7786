"""Where plants start: at the beginning of the motion that leads them, where the system's file does not say."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

from vdfmu.arm.units._played import Played
from vdfmu.compiler.unit import JOINTS, Output, Unit
from vdfmu.system.scenario.resolved import ResolvedSystem, resolve
from vdfmu.system.scenario.system_file import SystemFile


def leaders(resolved: ResolvedSystem) -> dict[str, str]:
    """Return plant to the component whose desired motion ``q_d`` reaches it first; without those that have several.

    Here a plant is any component with start positions of the joints, ``q_0``.
    """
    units = resolved.units
    plants = [name for name, unit in units.items() if _is_position(unit, "q_0")]
    found: dict[str, str] = {}
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
            found[plant] = leading.pop()
    return found


def with_starts(system: SystemFile) -> SystemFile:
    """Return the system with start positions that its plants share with what leads them, unless its file shares any."""
    resolved, shared = resolve(system, None), dict(system.shared)
    units = resolved.units
    for plant, leader in leaders(resolved).items():
        played = issubclass(units[leader], Played) or _is_position(units[leader], "q_start")
        told = any(members.get(plant) == "q_0" for members in shared.values())
        if played and not told and _joints(system, plant) == _joints(system, leader):
            known = (name for name, members in shared.items() if members.get(leader) == "q_start")
            name = next(known, "start" if "start" not in shared else f"start_{plant}")
            shared[name] = {leader: "q_start", **shared.get(name, {}), plant: "q_0"}
    return dataclasses.replace(system, shared=shared)


def started(
    system: SystemFile, component: str, unit: type[Unit], sections: Mapping[str, Mapping[str, Any]]
) -> dict[str, Any]:
    """Return the sections with the start of a motion for what shares it with the trajectory, unless they give one."""
    found = dict(sections)
    if issubclass(unit, Played) and unit.rows is not None:
        for members in system.shared.values():
            for other, group in members.items():
                if members.get(component) == "q_start" and other != component:
                    found[other] = {group: unit.begin()} | dict(found.get(other, {}))
    return found


def _is_position(unit: type[Unit], name: str) -> bool:
    """Whether a unit has a position of each joint of this name."""
    found = unit.declared.get(name)
    return found is not None and found.unit == "position" and found.shape == (JOINTS,)


def _joints(system: SystemFile, component: str) -> tuple[str, ...] | None:
    """Joints of a component's own robot; None for that of the scenario."""
    robot = system.parts[component].robot
    return None if robot is None else robot.joint_types
