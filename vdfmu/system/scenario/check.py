"""Checks of a scenario for likely mistakes: wrong signs, wrong units, unused values."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from vdfmu.arm.motion.played import Played
from vdfmu.arm.robot.parameters import PARAMETERS
from vdfmu.arm.robot.plausible import doubts, position_notes, speed_notes
from vdfmu.arm.robot.robot_file import plain_notes
from vdfmu.arm.units import find_unit
from vdfmu.compiler.unit import Input, Unit
from vdfmu.engine.plan.inputs import read_inputs
from vdfmu.system.scenario.scenario import Scenario
from vdfmu.system.scenario.scenario_file import KEYS
from vdfmu.system.scenario.values import group_of, multiplied, override, robot_with, section_values, system_values


def model_notes(scenario: Scenario, parameters: Mapping[str, Any] | None = None) -> list[str]:
    """Return notes on a scenario with parameters, about likely mistakes and unused values."""
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
        and not issubclass(resolved.units.get(component, Unit), Played)  # it shares its start anyway
    ]
    if robot is not None and not resolved.takers:
        notes.append("robot: no component uses it. Omit it, unless tables and figures need it.")
    notes += [f"motion: {note}" for unit in resolved.units.values() for note in getattr(unit, "notes", ())]
    robots = [scenario.robot] if scenario.robot is not None else []
    notes += [note for robot in robots for note in plain_notes(robot.sources)]
    return list(dict.fromkeys([*notes, *implausible(scenario, parameters)]))


def implausible(scenario: Scenario, parameters: Mapping[str, Any] | None = None) -> list[str]:
    """Return notes on likely mistakes of units or signs in the robots and motions of a scenario with parameters."""
    written = section_values(scenario.resolved, scenario.sections)
    products = multiplied(scenario.resolved, system_values(scenario), parameters or {})
    for component, changed in override(scenario, products).items():
        written[component] = written.get(component, {}) | changed
    return list(dict.fromkeys([*_of_robots(scenario, written), *_of_motions(scenario, written)]))


def remarks(
    scenario: Scenario,
    parameters: Mapping[str, Any] | None,
    values: Mapping[str, Mapping[str, Any]],
    asked: bool = False,
) -> dict[str, Any]:
    """Return the summary's entries that are known before the run: ``cut``, ``unfed``, ``implausible``.

    `values` are those of the units including the `parameters`. `asked` is whether the user chose the end of the run.
    """
    facts: dict[str, Any] = {}
    end = max((begin + length for _, begin, length in motions(scenario, values)), default=0.0)
    if end > scenario.stop + 0.5 * scenario.step:
        facts["cut"] = {"end": end, "stop": scenario.stop, "asked": asked}
    lacking = unfed_inputs(scenario, parameters or ())
    facts["unfed"] = [f"{name} is not connected, so it keeps its start value" for name in lacking]
    facts["implausible"] = implausible(scenario, parameters)
    return {key: value for key, value in facts.items() if value}


def unfed_inputs(scenario: Scenario, names: Iterable[str]) -> list[str]:
    """Return inputs without connection and value: those that a replacement adds, and position inputs outside plants.

    `names` are parameters that are set.
    """
    tables = read_inputs(scenario.inputs, scenario.input_hold)
    fed_or_set = {*scenario.system.fed, *names, *(name for table in tables for name in table.names)}
    fed_or_set |= {f"{name}.{key}" for name, keys in scenario.sections.items() for key in keys}
    lacking = dict.fromkeys((*scenario.system.unfed, *_positions(scenario)))
    return [name for name in lacking if not scenario.resolved.is_fed(name, fed_or_set)]


def motions(scenario: Scenario, values: Mapping[str, Mapping[str, Any]]) -> Iterator[tuple[str, float, float]]:
    """Yield the desired motions: the unit's name, start and length [s]; if repeated, those of the first cycle."""
    for name, unit in scenario.resolved.units.items():
        begin = values[name].get("t_start", 0.0)
        if issubclass(unit, Played) and unit.rows is not None:
            yield name, begin, unit.experiment_stop / values[name].get("speed", 1.0)
        elif issubclass(unit, find_unit("trajectory")):
            yield name, begin, values[name].get("T", unit.declared["T"].start)


def _positions(scenario: Scenario) -> Iterator[str]:
    """Yield the position inputs of components that act on a plant."""
    for name, unit in scenario.resolved.units.items():
        for key, declared in unit.declared.items() if name not in scenario.resolved.plants else ():
            if isinstance(declared, Input) and declared.unit == "position":
                yield f"{name}.{key}"


def _of_robots(scenario: Scenario, written: Mapping[str, Mapping[str, Any]]) -> Iterator[str]:
    """Yield likely mistakes of units or signs in the robot and in the run's plants."""
    if scenario.robot is not None:
        yield from doubts(scenario.robot)
    for name in scenario.resolved.plants:
        robot = scenario.system.parts[name].robot or scenario.plant_robot
        yield from doubts(robot_with(robot, written.get(name, {})))


def _of_motions(scenario: Scenario, written: Mapping[str, Mapping[str, Any]]) -> Iterator[str]:
    """Yield likely mistakes of units in positions and speeds."""
    resolved = scenario.resolved
    for component, values in written.items():
        table = resolved.tables[component]
        unit, positions = resolved.units.get(component, Unit), list[str]()
        for name, value in values.items():
            v = table.variables[table.reference[name]]
            quantity = unit.declared[v.group].unit if v.group in unit.declared else ""
            if v.unit == "rad" and v.group not in PARAMETERS:
                positions += position_notes(f"{component}.{name}", value, "revolute")
            elif quantity == "position":
                positions += position_notes(f"{component}.{name}", value, "prismatic")
            elif quantity == "velocity":
                yield from speed_notes(f"{component}.{name}", value, "prismatic" if v.unit == "m/s" else "revolute")
        yield from positions
        robot = resolved.robots.get(component)
        if issubclass(unit, find_unit("trajectory")) and robot is not None and not positions:
            start, end, T = (group_of(table, values, name) for name in ("q_start", "q_end", "T"))
            for i, kind in enumerate(robot.joint_types):  # (57) is fastest in its middle
                name = f"{component}: speed of joint {i + 1}"
                yield from speed_notes(name, 2.0 * abs(end[i] - start[i]) / T, kind)


def _not_reached(scenario: Scenario) -> Iterator[str]:
    """Yield notes on keys for plants that not every plant, or none, uses."""
    robot = scenario.robot
    unknown = robot is not None and robot.payload and not scenario.payload_known
    keys = " and ".join(["plant_factors"] * bool(scenario.plant_factors) + ["payload.known"] * bool(unknown))
    plants = {name: scenario.system.parts[name].robot for name in scenario.resolved.plants}
    if keys and None not in plants.values():
        yield (
            f"{keys}: not used, because no component is a plant with the robot of the scenario. Write parameters of "
            "the plant in its own section."
        )
    elif keys:
        yield from (
            f"{keys}: {name} has its own robot, so this does not apply to it." for name, arm in plants.items() if arm
        )
