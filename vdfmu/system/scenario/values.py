"""Values of the components from robot, scenario and settings: what the parameter sets of the SSP hold."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from vdfmu.arm.robot import Robot
from vdfmu.arm.robot.parameters import OPTIONAL, PARAMETERS
from vdfmu.base.errors import UsageError
from vdfmu.base.text import nearest
from vdfmu.compiler.unit.declaration import Derivative
from vdfmu.compiler.unit.interface import Interface, interface_of
from vdfmu.compiler.unit.requirements import unmet
from vdfmu.compiler.unit.unit import Unit
from vdfmu.compiler.unit.variable import NO_LIMIT, Variable
from vdfmu.engine.package.system import spread
from vdfmu.system.scenario.resolved import ResolvedSystem, Variables, optional
from vdfmu.system.scenario.scenario import Scenario
from vdfmu.system.scenario.system_file import SystemFile

Values = dict[str, Any]


def system_values(scenario: Scenario, settings: Mapping[str, Any] | None = None) -> dict[str, Values]:
    """All values of the components that robot, scenario and settings decide: component to variable to value.

    Variables that none of them names are not in it: they keep the start values of their declaration. An input that
    nothing feeds, such as the wrench at the end effector, has its start value.

    Raises
    ------
    UsageError
        See :func:`override`; also for positions beyond the robot's end stops.
    """
    resolved = scenario.resolved
    # any other unit, or FMU of another tool, may call what it likes a tolerance
    solvers = [n for n, u in resolved.units.items() if any(isinstance(d, Derivative) for d in u.declared.values())]
    tolerances = _set_all(resolved, {f"{name}.tolerance": scenario.tolerance for name in solvers})
    written = _set_all(resolved, _sections(resolved, scenario.sections))
    changed = _set_all(resolved, settings or {})
    values = {
        name: {v.name: v.start for v in table if isinstance(table, Interface) and is_free(resolved.system, name, v)}
        | tolerances.get(name, {})
        | robot_parameters(name, table, scenario)
        | written.get(name, {})
        | changed.get(name, {})
        for name, table in resolved.tables.items()
    }
    _check(resolved.tables, values)
    return values


def section_values(resolved: ResolvedSystem, sections: Mapping[str, Mapping[str, Any]]) -> dict[str, Values]:
    """Values of the sections of a scenario's file: component to variable to value.

    A group that shares its value with others, as ``[shared]`` of the system has it, sets these too.

    Raises
    ------
    UsageError
        See :func:`override`; also for positions beyond the robot's end stops, and for connections of unknown signals.
    """
    resolved.check_connections()
    values = _set_all(resolved, _sections(resolved, sections))
    _check(resolved.tables, values)
    return values


def override(scenario: Scenario, settings: Mapping[str, Any]) -> dict[str, Values]:
    """Read settings such as ``controller.K_p[1]=3000``: component to variable to value.

    A name without an index sets all elements: ``controller.K_p=3000``, or each of them by a list or array. An integer
    with named values takes the name: ``feedforward.mode=vdc``. ``robot.mass[3]=3`` reaches every component that has the
    parameter. Inputs that nothing feeds can be set too.

    Raises
    ------
    UsageError
        For an unknown component or variable, one that cannot be set, a value that does not fit, or another number of
        values; with one line for each setting that is wrong.
    """
    return _set_all(scenario.resolved, settings)


def present_values(
    scenario: Scenario, values: Mapping[str, Mapping[str, Any]], target: str, number: float
) -> dict[str, Any]:
    """Return the values of what a setting sets, by ``component.variable``: those of `values`, else start values.

    Raises
    ------
    UsageError
        See :func:`override`; also for a `number` that does not fit.
    """
    tables = scenario.resolved.tables
    return {
        f"{component}.{v.name}": values[component].get(v.name, v.start)
        for component, each in override(scenario, {target: number}).items()
        for v in tables[component]
        if v.name in each
    }


def start_values(unit: type[Unit], robot: Robot | None, settings: Mapping[str, Any]) -> Values:
    """Read settings of a unit by itself, ``K_p=3000`` or ``K_p[1]=3000``: variable to value.

    Raises
    ------
    UsageError
        See :func:`override`.
    """
    table = interface_of(unit, robot if unit.needs_robot() else None)
    values: Values = {}
    for key, value in settings.items():
        values |= _spread(_named(table, key, key), key, value)
    return values


def group_value(scenario: Scenario, name: str, settings: Mapping[str, Any] | None = None) -> Any:
    """Value of a component's group, ``controller.K_p``: a float, the name of a choice, or an array of its shape.

    None if there is no such component or group.
    """
    component, _, group = name.partition(".")
    table = scenario.resolved.tables.get(component, ())
    return group_of(table, system_values(scenario, settings).get(component, {}), group)


def group_of(table: Iterable[Variable], values: Mapping[str, Any], group: str) -> Any:
    """Value of a group of a component with these variables and values; see :func:`group_value`."""
    found = {v.index: values.get(v.name, v.start) for v in table if v.group == group}
    if not found:
        return None
    if () in found:
        choices = next(v.choices for v in table if v.group == group)
        return choices[found[()]] if choices else found[()]
    array = np.full([1 + max(axis) for axis in zip(*found, strict=True)], np.nan)
    for index, value in found.items():
        array[index] = value
    return array


def robot_parameters(component: str, table: Variables, scenario: Scenario) -> Values:
    """Return a component's parameters that describe the robot: of plants the scenario's plant, else nominal."""
    if not isinstance(table, Interface) or table.unit.robot_fields is None:
        return {}
    own = scenario.system.parts[component].robot
    robot = own or (scenario.plant_robot if component in scenario.resolved.plants else scenario.known_robot)
    return {
        p.name: float(getattr(robot, p.field)[p.index])
        for p in (own or scenario.arm).entries()
        if p.name in table.reference and p.field not in table.unit.declared
    }


def robot_with(robot: Robot, values: Mapping[str, Any]) -> Robot:
    """Return a robot with numbers of its plant, by their names there: ``mass[2]``; itself if it has them."""
    own = [float(getattr(robot, each.field)[each.index]) for each in robot.entries()]
    new = [float(values.get(each.name, number)) for each, number in zip(robot.entries(), own, strict=True)]
    return robot if new == own else robot.with_values(new)


def is_free(system: SystemFile, component: str, variable: Variable) -> bool:
    """Whether a variable is an input that nothing feeds."""
    names = {f"{component}.{variable.group}", f"{component}.{variable.name}"}
    return variable.causality == "input" and system.fed.keys().isdisjoint(names)


def _sections(resolved: ResolvedSystem, sections: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    """Values of sections by ``component.group``, with those of groups that share them."""
    written = {f"{name}.{key}": value for name, section in sections.items() for key, value in section.items()}
    for members in resolved.system.shared.values():
        groups = [
            f"{component}.{group}"
            for component, group in members.items()
            if any(
                v.group == group for v in resolved.tables[component]
            )  # a unit instead of another may have no such value
        ]
        given = next((written[group] for group in groups if group in written), None)
        if given is not None:
            written = dict.fromkeys(groups, given) | written
    return written


def _set_all(resolved: ResolvedSystem, settings: Mapping[str, Any]) -> dict[str, Values]:
    """Read settings, see :func:`override`."""
    values: dict[str, Values] = {}
    problems: list[str] = []
    for key, value in settings.items():
        component, _, name = key.partition(".")
        reached = [component]
        if component == "robot" and "robot" not in resolved.tables:
            reached = [c for c, table in resolved.tables.items() if _has_parameter(table, name)]
        try:
            if not reached:
                raise UsageError(f"{key}: no component has a parameter {name} of the robot.")
            for one in reached:
                values.setdefault(one, {}).update(_set(resolved, one, name, key, value))
        except UsageError as error:
            problems += str(error).splitlines()
    if problems:
        raise UsageError("\n".join(dict.fromkeys(problems)))
    return values


def _has_parameter(table: Variables, name: str) -> bool:
    """Whether a component has a parameter of the robot."""
    rows = getattr(table.robot, "rows", {})
    of_robot = (v for v in table if v.group in rows and v.causality == "parameter")
    return any(name in (v.group, v.name) for v in of_robot)


def _set(resolved: ResolvedSystem, component: str, name: str, key: str, value: Any) -> Values:
    """Return the values of one setting of a component."""
    if component not in resolved.tables or not name:
        raise UsageError(f"{key}: expected component.parameter, a component of {', '.join(resolved.tables)}.")
    variables = _named(resolved.tables[component], name, key)
    for variable in variables:
        if variable.causality != "parameter" and not is_free(resolved.system, component, variable):
            fed = "n output" if variable.causality == "output" else " connected input"
            raise UsageError(
                f"{key}: {variable.name} is a{fed} of {component}; only parameters and free inputs can be set."
            )
    return _spread(variables, key, value)


def _named(table: Variables, name: str, key: str) -> list[Variable]:
    """Variables of a name, with or without an index."""
    found = [v for v in table if name in (v.group, v.name)]
    if not found:
        groups = list(dict.fromkeys(v.group for v in table if v.causality != "output"))
        of_group = [v.name for v in table if v.group == name.partition("[")[0]]
        row = PARAMETERS.get(name.partition("[")[0])
        way = optional(table, name) or nearest(name, of_group or groups)
        if (
            isinstance(table, Interface)
            and table.robot is not None
            and row
            and row.section in OPTIONAL
            and not getattr(table.robot, row.section)
        ):
            way = f"The file of robot {table.robot.name} does not have its optional table [{row.section}]."
        raise UsageError(f"{key}: {table.name} has no {name}. {way}")
    return found


def _spread(variables: Sequence[Variable], key: str, value: Any) -> Values:
    """Return the values of the variables of one setting."""
    try:
        values = spread(value, [variable.name for variable in variables])
    except ValueError as error:
        raise UsageError(f"{key}: {error}.") from None
    component = key.partition(".")[0] if "." in key else ""
    found: Values = {}
    problems: list[str] = []
    for variable, one in zip(variables, values, strict=True):
        try:
            found[variable.name] = _cast(variable, one)
        except ValueError as error:
            place = key if len(variables) == 1 or values[0] is value else f"{component}.{variable.name}"
            problems.append(f"{place}: {error}.")
    if problems:
        raise UsageError("\n".join(dict.fromkeys(problems)))
    return found


def _cast(variable: Variable, value: Any) -> Any:
    """Value of the variable's type from a number, a name or a text; ValueError for one that it does not have."""
    text = str(value).strip()
    if text in variable.choices:
        return variable.choices.index(text)
    if variable.type == "Boolean":
        known = {"true": True, "1": True, "false": False, "0": False}
        if text.lower() not in known:
            raise ValueError(f"expected true or false, got {text!r}")
        return known[text.lower()]
    try:
        number = math.nan if isinstance(value, bool) else float(text)
    except ValueError:
        number = math.nan
    if number == math.inf and variable.start == NO_LIMIT:
        return NO_LIMIT
    problem = variable.problem(number if not math.isnan(number) else text)
    if problem:
        raise ValueError(problem)
    if variable.type == "Integer":
        if number != int(number):
            raise ValueError(f"expected an integer, got {text}")
        return int(number)
    return number


def _check(tables: Mapping[str, Variables], values: Mapping[str, Values]) -> None:
    """Raise UsageError for what units require, and for joints beyond the end stops, out of which links would fly."""
    problems = [
        f"{component}.{problem}"
        for component, table in tables.items()
        if isinstance(table, Interface) and table.unit.requirements is not Unit.requirements
        for known in [values.get(component, {})]
        for problem in unmet(table, table.memory_of(known))
    ]
    problems += [
        f"{component}.{v.name}: expected a position of joint {i + 1} between its end stops, {low:g} and {high:g}, "
        f"got {q:g}."
        for component, table in tables.items()
        for v in _positions(table)
        for (i,), q in [(v.index, values.get(component, {}).get(v.name))]
        if isinstance(table.robot, Robot) and table.robot.limits and q is not None
        for low, high in [_stops(values.get(component, {}), table.robot, i)]
        if not low <= q <= high
    ]
    if problems:
        raise UsageError("\n".join(problems))


def _stops(values: Values, robot: Robot, i: int) -> tuple[float, float]:
    low, high = (values.get(f"{name}[{i + 1}]", getattr(robot, name)[i]) for name in ("q_min", "q_max"))
    return low, high


def _positions(table: Variables) -> Iterable[Variable]:
    """Parameters of a component that are positions of the joints; those with a least value are distances."""
    if isinstance(table, Interface):
        declared = table.unit.declared
        for v in table:
            if v.causality != "parameter" or v.minimum is not None or v.group not in declared:
                continue
            if declared[v.group].unit == "position":
                yield v
