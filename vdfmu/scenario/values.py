"""Parameter values of the units from a robot and a scenario: what the parameter sets of the SSP hold."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vdfmu.engine.ssp.structure import spread
from vdfmu.errors import UsageError
from vdfmu.kernel.structure import parameters
from vdfmu.model import Robot
from vdfmu.model.parameters import PARAMETERS
from vdfmu.scenario import Scenario
from vdfmu.scenario.parts import Variables, tables_of
from vdfmu.unit.base import Unit
from vdfmu.unit.interface import Interface
from vdfmu.unit.variable import NO_LIMIT, Variable

__all__ = ["is_free", "override", "robot_parameters", "scenario_parameters", "start_values", "system_values"]

Values = dict[str, Any]


def robot_parameters(component: str, table: Variables, scenario: Scenario) -> Values:
    """Return a component's parameters that describe the robot: the scenario's plant for ``plant``, else nominal."""
    robot = scenario.plant_robot if component == "plant" else scenario.robot
    if not isinstance(table, Interface) or table.unit.robot_fields is None:
        return {}
    return {
        p.name: float(getattr(robot, p.field)[p.index])
        for p in parameters(scenario.robot)
        if p.name in table.reference and p.field not in table.unit.declared
    }


def scenario_parameters(component: str, table: Variables, scenario: Scenario) -> Values:
    """Values of a component that the scenario sets: motion, gains, modes, start position, tolerance.

    An input of a unit that nothing feeds, such as the wrench at the end effector, has its start value. A value without
    a place in the component, such as the name of a mode in an FMU, is left out.
    """
    motion, gains, feedback = scenario.trajectory, scenario.feedforward, scenario.controller
    known: dict[str, dict[str, Any]] = {
        "trajectory": {
            "q_start": motion.q_start,
            "q_end": motion.q_end,
            "T": motion.T,
            "t_start": motion.t_start,
        },
        "feedforward": {k: getattr(gains, k) for k in ("mode", "Lambda", "K_V", "k_vq", "k_vkappa")},
        "controller": {
            "K_p": feedback.K_p,
            "K_v": feedback.K_v,
            "tau_max": np.minimum(feedback.tau_max, NO_LIMIT),
            "velocity": feedback.velocity,
        },
        "plant": {"q_0": motion.q_start},
    }
    groups = known.get(component, {}) | {"tolerance": scenario.tolerance}
    free = {v.name: v.start for v in table if is_free(component, v, scenario)}
    return (free if isinstance(table, Interface) else {}) | {
        v.name: _cast(table, v.name, np.asarray(groups[v.group])[v.index])
        for v in table
        if v.group in groups and v.causality == "parameter" and _has_place(v, np.asarray(groups[v.group]))
    }


def _has_place(variable: Variable, value: NDArray[Any]) -> bool:
    """Whether an element of a value can be that of a variable."""
    inside = all(i < size for i, size in zip(variable.index, value.shape, strict=False))
    return (
        len(variable.index) == value.ndim and inside and (value.dtype.kind != "U" or bool(variable.choices))
    )


def is_free(component: str, variable: Variable, scenario: Scenario) -> bool:
    """Whether a variable is an input that nothing feeds."""
    fed = {end for targets in scenario.system.connections.values() for end in targets}
    return variable.causality == "input" and f"{component}.{variable.group}" not in fed


def system_values(scenario: Scenario, settings: Mapping[str, Any] | None = None) -> dict[str, Values]:
    """All values of the components that robot, scenario and settings decide: component to variable to value.

    Variables that none of them names are not in it: they keep the start values of their declaration.
    """
    tables = tables_of(scenario)
    written = {
        f"{component}.{group}": value
        for component, section in scenario.sections.items()
        for group, value in section.items()
    }
    changed = override(scenario, written | dict(settings or {}), tables)
    values = {
        name: robot_parameters(name, table, scenario)
        | scenario_parameters(name, table, scenario)
        | changed.get(name, {})
        for name, table in tables.items()
    }
    if scenario.robot.limits and "plant" in values:
        _check_start(values["plant"], scenario.robot.n)
    return values


def _check_start(plant: Values, n: int) -> None:
    """Raise UsageError for a start beyond the end stops, which would throw the link out of them."""
    for i in range(1, n + 1):
        q, low, high = (plant.get(f"{name}[{i}]") for name in ("q_0", "q_min", "q_max"))
        if q is not None and low is not None and high is not None and not low <= q <= high:
            raise UsageError(
                f"plant.q_0[{i}]: expected a start between the end stops, {low:g} and {high:g}, got {q:g}."
            )


def override(
    scenario: Scenario, settings: Mapping[str, Any], tables: Mapping[str, Variables] | None = None
) -> dict[str, Values]:
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
    values: dict[str, Values] = {}
    problems: list[str] = []
    known = tables_of(scenario) if tables is None else tables
    for key, value in settings.items():
        component, _, name = key.partition(".")
        reached = [component]
        if component == "robot" and "robot" not in known:
            reached = [
                c for c, table in known.items() if any(name in (v.group, v.name) for v in _of_robot(table))
            ]
        try:
            if not reached:
                raise UsageError(f"{key}: no component has a parameter {name} of the robot.")
            for one in reached:
                values.setdefault(one, {}).update(_set(scenario, known, one, name, key, value))
        except UsageError as error:
            problems.append(str(error))
    if problems:
        raise UsageError("\n".join(problems))
    return values


def _of_robot(table: Variables) -> list[Variable]:
    """Parameters of a component that describe the robot."""
    return [v for v in table if v.group in PARAMETERS and v.causality == "parameter"] if table.robot else []


def _set(
    scenario: Scenario, tables: Mapping[str, Variables], component: str, name: str, key: str, value: Any
) -> Values:
    """Return the values of one setting of a component."""
    if component not in tables or not name:
        raise UsageError(f"{key}: expected unit.parameter=value with a unit of {', '.join(tables)}.")
    table = tables[component]
    variables = [v for v in table if name in (v.group, v.name)] or [table.find(name)]
    for variable in variables:
        if variable.causality != "parameter" and not is_free(component, variable, scenario):
            fed = "n output" if variable.causality == "output" else " connected input"
            raise UsageError(
                f"{key}: {variable.name} is a{fed} of {component}; only parameters and free inputs can be set."
            )
    return _spread(table, variables, key, value)


def start_values(unit: type[Unit], robot: Robot | None, settings: Mapping[str, Any]) -> Values:
    """Read settings of a unit by itself, ``K_p=3000`` or ``K_p[1]=3000``: variable to value.

    Raises
    ------
    UsageError
        As :func:`override`.
    """
    table = Interface(unit, robot if unit.needs_robot() else None)
    values: Values = {}
    for key, value in settings.items():
        values |= _spread(
            table, [v for v in table if key in (v.group, v.name)] or [table.find(key)], key, value
        )
    return values


def _spread(table: Variables, variables: Sequence[Variable], key: str, value: Any) -> Values:
    """Return the values of the variables of one setting."""
    names = [variable.name for variable in variables]
    try:
        values = spread(value, names)
    except ValueError as error:
        raise UsageError(f"{key}: {error}.") from None
    return {name: _cast(table, name, one) for name, one in zip(names, values, strict=True)}


def _cast(table: Variables, name: str, value: Any) -> Any:
    """Value of the variable's type from a number, a name or a text, within its limits."""
    variable = table.find(name)
    where = f"{table.name}.{name}"
    unit = f" {variable.unit}" if variable.unit and variable.unit != "1" else ""
    text = str(value).strip()
    if variable.choices and text in variable.choices:
        return variable.choices.index(text)
    if variable.type == "Boolean":
        known = {"true": True, "1": True, "false": False, "0": False}
        if text.lower() not in known:
            raise UsageError(f"{where}: expected true or false, got {text!r}.")
        return known[text.lower()]
    try:
        number = float(text)
    except ValueError:
        expected = (
            f"one of {', '.join(variable.choices)}"
            if variable.choices
            else f"a number{unit and ' in' + unit}"
        )
        raise UsageError(f"{where}: expected {expected}, got {text!r}.") from None
    low = -np.inf if variable.minimum is None else variable.minimum
    high = np.inf if variable.maximum is None else variable.maximum
    if not np.isfinite(number) or not low <= number <= high:
        raise UsageError(f"{where}: expected a finite number from {low:g} to {high:g}{unit}, got {text}.")
    if variable.type == "Integer":
        if number != int(number):
            raise UsageError(f"{where}: expected an integer, got {text}.")
        return int(number)
    return number
