"""Values of the components from robot, scenario and parameters, for the SSP's parameter sets."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from vdfmu.arm.robot import Robot
from vdfmu.arm.robot.parameters import OPTIONAL, PARAMETERS
from vdfmu.base.errors import UsageError
from vdfmu.base.text import nearest
from vdfmu.compiler.unit import Derivative, Unit
from vdfmu.compiler.unit.evaluate import unmet
from vdfmu.compiler.unit.interface import Interface, Variable, interface_of
from vdfmu.engine.package.system import factor_of, spread
from vdfmu.system.scenario.scenario import ResolvedSystem, Scenario, Variables, optional
from vdfmu.system.scenario.system_file import SystemFile

Values = dict[str, Any]


def system_values(scenario: Scenario, parameters: Mapping[str, Any] | None = None) -> dict[str, Values]:
    """Return the values set by robot, scenario and parameters: component to variable to value.

    Other variables keep their declared start values, as do free inputs such as the wrench at the end effector.
    UsageError as in :func:`override`, and for positions beyond the end stops.
    """
    resolved = scenario.resolved
    # in other units and FMUs tolerance may mean anything
    solvers = [n for n, u in resolved.units.items() if any(isinstance(d, Derivative) for d in u.declared.values())]
    tolerances = _set_all(resolved, {f"{name}.tolerance": scenario.tolerance for name in solvers})
    written = _set_all(resolved, _sections(resolved, scenario.sections))
    values = {
        name: {v.name: v.start for v in table if isinstance(table, Interface) and is_free(resolved.system, name, v)}
        | tolerances.get(name, {})
        | robot_parameters(name, table, scenario)
        | written.get(name, {})
        for name, table in resolved.tables.items()
    }
    changed = _set_all(resolved, multiplied(resolved, values, parameters or {}))
    values = {name: each | changed.get(name, {}) for name, each in values.items()}
    _check(resolved.tables, values)
    return values


def section_values(resolved: ResolvedSystem, sections: Mapping[str, Mapping[str, Any]]) -> dict[str, Values]:
    """Return the values of the sections of a scenario's file: component to variable to value.

    A group also sets all groups that share its value in the system's ``[shared]``. UsageError as in :func:`override`,
    for positions beyond the robot's end stops, and for wrong connections.
    """
    resolved.check_connections()
    values = _set_all(resolved, _sections(resolved, sections))
    _check(resolved.tables, values)
    return values


def override(scenario: Scenario, parameters: Mapping[str, Any]) -> dict[str, Values]:
    """Read parameters such as ``controller.K_p[1]=3000``: component to variable to value.

    A name without an index sets all elements: ``controller.K_p=3000``, or each by a list or array. An integer with
    named values accepts the name: ``feedforward.mode=vdc``. ``robot.mass[3]=3`` sets the parameter in every component.
    Free inputs can be set too. UsageError has a line for each wrong setting: an unknown component or variable, a
    variable that cannot be set, a wrong value or number of values.
    """
    return _set_all(scenario.resolved, parameters)


def multiplied(
    resolved: ResolvedSystem, values: Mapping[str, Mapping[str, Any]], parameters: Mapping[str, Any]
) -> dict[str, Any]:
    """Return parameters with each factor, ``controller.K_v=*0.8``, replaced by its product with the system's values.

    `values`: component to variable to value, before the parameters. UsageError for a factor that is not a number, or
    without a number to multiply.
    """
    products: dict[str, Any] = {}
    for key, value in parameters.items():
        try:
            factor = factor_of(value)
        except ValueError as error:
            raise UsageError(f"{key}: {error}.") from None
        if factor is None:
            products[key] = value
            continue
        for component, each in _set_all(resolved, {key: factor}).items():
            for v in resolved.tables[component]:
                if v.name not in each:
                    continue
                present = values[component].get(v.name, v.start)
                if not isinstance(present, float):
                    raise UsageError(f"{key}: expected a number to multiply, got {present}. Set a value instead.")
                products[f"{component}.{v.name}"] = factor * present
    return products


def present_values(
    scenario: Scenario, values: Mapping[str, Mapping[str, Any]], target: str, number: float
) -> dict[str, Any]:
    """Return ``component.variable`` to value for the variables of a setting. UsageError for a wrong one or `number`."""
    tables = scenario.resolved.tables
    return {
        f"{component}.{v.name}": values[component].get(v.name, v.start)
        for component, each in override(scenario, {target: number}).items()
        for v in tables[component]
        if v.name in each
    }


def start_values(unit: type[Unit], robot: Robot | None, parameters: Mapping[str, Any]) -> Values:
    """Read parameters of a unit, ``K_p=3000`` or ``K_p[1]=3000``: variable to value. UsageError as :func:`override`."""
    table = interface_of(unit, robot if unit.needs_robot() else None)
    values: Values = {}
    for key, value in parameters.items():
        values |= _spread(_named(table, key, key), key, value)
    return values


def group_value(scenario: Scenario, name: str, parameters: Mapping[str, Any] | None = None) -> Any:
    """Return the value of a group, ``controller.K_p``: a float, the name of a choice, or an array. None if unknown."""
    component, _, group = name.partition(".")
    table = scenario.resolved.tables.get(component, ())
    return group_of(table, system_values(scenario, parameters).get(component, {}), group)


def group_of(table: Iterable[Variable], values: Mapping[str, Any], group: str) -> Any:
    """Return the value of a group of a component. See :func:`group_value`."""
    elements = {v.index: values.get(v.name, v.start) for v in table if v.group == group}
    if not elements:
        return None
    if () in elements:
        choices = next(v.choices for v in table if v.group == group)
        return choices[elements[()]] if choices else elements[()]
    array = np.full([1 + max(axis) for axis in zip(*elements, strict=True)], np.nan)
    for index, value in elements.items():
        array[index] = value
    return array


def robot_parameters(component: str, table: Variables, scenario: Scenario) -> Values:
    """Return the robot's parameters in a component: those of the plant, with its factors, or those of the model."""
    if not isinstance(table, Interface) or table.unit.robot_fields is None:
        return {}
    part_robot = scenario.system.parts[component].robot
    robot = part_robot or (scenario.plant_robot if component in scenario.resolved.plants else scenario.known_robot)
    return {
        p.name: float(getattr(robot, p.field)[p.index])
        for p in (part_robot or scenario.arm).entries()
        if p.name in table.reference and p.field not in table.unit.declared
    }


def robot_with(robot: Robot, values: Mapping[str, Any]) -> Robot:
    """Return the robot with parameters such as ``mass[2]`` set, or the robot itself if none differs."""
    numbers = [float(getattr(robot, each.field)[each.index]) for each in robot.entries()]
    new = [float(values.get(each.name, number)) for each, number in zip(robot.entries(), numbers, strict=True)]
    return robot if new == numbers else robot.with_values(new)


def is_free(system: SystemFile, component: str, variable: Variable) -> bool:
    """Return whether a variable is an unconnected input."""
    names = {f"{component}.{variable.group}", f"{component}.{variable.name}"}
    return variable.causality == "input" and system.fed.keys().isdisjoint(names)


def _sections(resolved: ResolvedSystem, sections: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    """Return ``component.group`` to value from sections, including groups that share the value."""
    written = {f"{name}.{key}": value for name, section in sections.items() for key, value in section.items()}
    for members in resolved.system.shared.values():
        groups = [
            f"{component}.{group}"
            for component, group in members.items()
            if any(v.group == group for v in resolved.tables[component])  # a replaced unit may not have it
        ]
        value = next((written[group] for group in groups if group in written), None)
        if value is not None:
            written = dict.fromkeys(groups, value) | written
    return written


def _set_all(resolved: ResolvedSystem, parameters: Mapping[str, Any]) -> dict[str, Values]:
    """Read parameters, see :func:`override`."""
    values: dict[str, Values] = {}
    problems: list[str] = []
    for key, value in parameters.items():
        component, _, name = key.partition(".")
        reached = [component]
        if component == "robot" and "robot" not in resolved.tables:
            reached = [c for c, table in resolved.tables.items() if _has_parameter(table, name)]
        try:
            if not reached:
                raise UsageError(f"{key}: no component has a parameter {name} of the robot.")
            for each in reached:
                values.setdefault(each, {}).update(_set(resolved, each, name, key, value))
        except UsageError as error:
            problems += str(error).splitlines()
    if problems:
        raise UsageError("\n".join(dict.fromkeys(problems)))
    return values


def _has_parameter(table: Variables, name: str) -> bool:
    rows = getattr(table.robot, "rows", {})
    of_robot = (v for v in table if v.group in rows and v.causality == "parameter")
    return any(name in (v.group, v.name) for v in of_robot)


def _set(resolved: ResolvedSystem, component: str, name: str, key: str, value: Any) -> Values:
    """Return variable to value for a setting of a component."""
    if component not in resolved.tables or not name:
        raise UsageError(f"{key}: expected component.parameter, with a component of {', '.join(resolved.tables)}.")
    variables = _named(resolved.tables[component], name, key)
    for variable in variables:
        if variable.causality != "parameter" and not is_free(resolved.system, component, variable):
            fed = "n output" if variable.causality == "output" else " connected input"
            raise UsageError(
                f"{key}: {variable.name} is a{fed} of {component}; only parameters and free inputs can be set."
            )
    return _spread(variables, key, value)


def _named(table: Variables, name: str, key: str) -> list[Variable]:
    """Return the variables of a name, with or without an index."""
    named = [v for v in table if name in (v.group, v.name)]
    if not named:
        groups = list(dict.fromkeys(v.group for v in table if v.causality != "output"))
        group = name.partition("[")[0]
        way = optional(table, name) or nearest(name, [v.name for v in table if v.group == group] or groups)
        row, robot = PARAMETERS.get(group), table.robot
        if robot is not None and row and row.section in OPTIONAL and not getattr(robot, row.section):
            way = f"The file of robot {robot.name} does not have its optional table [{row.section}]."
        raise UsageError(f"{key}: {table.name} has no {name}. {way}")
    return named


def _spread(variables: Sequence[Variable], key: str, value: Any) -> Values:
    try:
        values = spread(value, [variable.name for variable in variables])
    except ValueError as error:
        raise UsageError(f"{key}: {error}.") from None
    component = key.partition(".")[0] if "." in key else ""
    cast: Values = {}
    problems: list[str] = []
    for variable, element in zip(variables, values, strict=True):
        try:
            cast[variable.name] = variable.domain.read(element)
        except ValueError as error:
            place = key if len(variables) == 1 or values[0] is value else f"{component}.{variable.name}"
            problems.append(f"{place}: {error}.")
    if problems:
        raise UsageError("\n".join(dict.fromkeys(problems)))
    return cast


def _check(tables: Mapping[str, Variables], values: Mapping[str, Values]) -> None:
    """Raise UsageError for violated requirements of units, and for joint positions beyond the end stops."""
    problems: list[str] = []
    for component, table in tables.items():
        if not isinstance(table, Interface):
            continue
        written, robot, declared = values.get(component, {}), table.robot, table.unit.declared
        if table.unit.requirements is not Unit.requirements:
            problems += [f"{component}.{problem}" for problem in unmet(table, table.memory_of(written))]
        for v in table if isinstance(robot, Robot) and robot.limits else ():
            # distances have a minimum
            if v.causality != "parameter" or v.minimum is not None or v.name not in written or v.group not in declared:
                continue
            if declared[v.group].unit == "position":
                (i,), q = v.index, written[v.name]
                low, high = (written.get(f"{name}[{i + 1}]", getattr(robot, name)[i]) for name in ("q_min", "q_max"))
                if not low <= q <= high:
                    problems.append(
                        f"{component}.{v.name}: expected a position of joint {i + 1} between its end stops, {low:g} "
                        f"and {high:g}, got {q:g}."
                    )
    if problems:
        raise UsageError("\n".join(problems))
