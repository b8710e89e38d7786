"""What of a scenario looks like a wrong sign or unit of measurement, or reaches no component."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from vdfmu.arm.robot.parameters import PARAMETERS
from vdfmu.arm.robot.robot import Robot
from vdfmu.arm.units._played import Played
from vdfmu.base.measure import WIDE_ANGLE
from vdfmu.compiler.unit.unit import Unit
from vdfmu.system.scenario.scenario import Scenario
from vdfmu.system.scenario.scenario_file import KEYS
from vdfmu.system.scenario.values import section_values


def model_notes(scenario: Scenario) -> list[str]:
    """Return the notes of a scenario, and what of it looks like a wrong sign or unit, though it may be meant."""
    robot, resolved = scenario.robot, scenario.resolved
    notes = [*scenario.notes, *_not_reached(scenario)]
    notes += [
        f"system: {name} is a key of scenarios, which cannot set values of a component of this name."
        for name in scenario.system.parts
        if name in KEYS
    ]
    notes += [
        f"shared.{name}: {component} has no {group}, and shares nothing."
        for name, members in scenario.system.shared.items()
        for component, group in members.items()
        if all(v.group != group for v in resolved.tables[component])
        and not issubclass(resolved.units.get(component, Unit), Played)  # shares its start all the same
    ]
    if robot is not None:
        notes += _robot_notes(robot)
        if not resolved.takers:
            notes.append("robot: no component takes it. Leave it out, unless tables and figures need it.")
    angles = {
        f"{component}.{name}": value
        for component, section in section_values(resolved, scenario.sections).items()
        for table in [resolved.tables[component]]
        for name, value in section.items()
        if table.variables[table.reference[name]].unit == "rad"
    }
    if robot is not None and robot.limits:
        for name in ("q_min", "q_max"):
            pairs = enumerate(zip(robot.joint_types, getattr(robot, name), strict=True), start=1)
            none = PARAMETERS[name].largest  # as the importers write for a joint without end stops
            angles |= {f"{name}[{i}]": q for i, (joint, q) in pairs if joint == "revolute" and abs(q) < none}
    wide = (f"{name} = {q:g} rad looks like degrees: {np.radians(q):.4g} rad." for name, q in angles.items()
            if abs(q) > WIDE_ANGLE)  # fmt: skip
    notes += [f"motion: {note}" for unit in resolved.units.values() for note in getattr(unit, "notes", ())]
    return notes + list(wide)


def _robot_notes(robot: Robot) -> Iterator[str]:
    """Yield what of a robot looks like another unit or sign."""
    size = float(np.abs(robot.gravity).max())
    if size > _STRONG_GRAVITY:
        yield f"gravity of {size:g} m/s2 looks like another unit: 9.81 m/s2 on Earth."
    elif -robot.gravity.min() > max(1.0, robot.gravity.max()):
        k = int(robot.gravity.argmin())
        yield (
            f"gravity[{k + 1}] = {robot.gravity[k]:g} m/s2 pulls towards +: it is written upward, +9.81 on the axis "
            "that points up."
        )
    masses = robot.mass.tolist() + ([float(robot.payload_mass)] if robot.payload else [])
    heavy = [m for m in masses if m > _HEAVY_LINK]
    if heavy:
        yield f"a mass of {max(heavy):g} kg looks like grams."


def _not_reached(scenario: Scenario) -> Iterator[str]:
    """Yield what a scenario says of its plant alone that no component takes, or one does not."""
    robot = scenario.robot
    unknown = robot is not None and robot.payload and not scenario.payload_known
    said = [*(["plant_factors"] if scenario.plant_factors else []), *(["payload.known"] if unknown else [])]
    plants = {name: scenario.system.parts[name].robot for name in scenario.resolved.plants}
    if said and None not in plants.values():
        yield (
            f"{' and '.join(said)}: no component takes it: none is a plant with the robot of the "
            "scenario. Write numbers of the plant in its own section."
        )
    elif said:
        yield from (
            f"{' and '.join(said)}: {name} has a robot of its own, which this does not reach."
            for name, own in plants.items()
            if own is not None
        )


_STRONG_GRAVITY = 30.0
"""Above that of every planet [m/s2], below 980 cm/s2."""
_HEAVY_LINK = 500.0
"""Links of the largest industrial robots have some hundred kg; a link of half a kilogram has 500 g."""
