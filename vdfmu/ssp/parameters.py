"""Parameter values of the units from a robot and a scenario: what the parameter sets of the SSP hold."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from vdfmu.errors import UsageError
from vdfmu.kernel.structure import parameters
from vdfmu.model import Scenario
from vdfmu.ssp.structure import spread
from vdfmu.ssp.system_file import units_of
from vdfmu.unit.interface import Interface
from vdfmu.unit.variable import NO_LIMIT
from vdfmu.units import shipped_units

__all__ = ["override", "robot_parameters", "scenario_parameters", "system_values"]

Values = dict[str, Any]


def robot_parameters(unit: str, scenario: Scenario) -> Values:
    """Return the parameters of a unit that describe the robot: the scenario's plant for the plant, else nominal."""
    robot = scenario.plant_robot if unit == "plant" else scenario.robot
    known = Interface(shipped_units()[unit], scenario.robot).reference
    return {
        p.name: float(getattr(robot, p.field)[p.index]) for p in parameters(scenario.robot) if p.name in known
    }


def scenario_parameters(unit: str, scenario: Scenario) -> Values:
    """Values of a unit that the scenario sets: trajectory, gains, modes, start position, tolerance.

    The wrench at the end effector, an input that nothing feeds, is 0.
    """
    table = Interface(shipped_units()[unit], scenario.robot)
    if unit == "trajectory":
        motion = scenario.trajectory
        groups = {"q_start": motion.q_start, "q_end": motion.q_end, "T": motion.T, "t_start": motion.t_start}
    elif unit == "feedforward":
        gains = scenario.feedforward
        groups = {k: getattr(gains, k) for k in ("mode", "Lambda", "K_V", "k_vq", "k_vkappa")}
        groups |= {"F_e_d": np.zeros(6)}
    elif unit == "controller":
        gains = scenario.controller
        limit = np.minimum(gains.tau_max, NO_LIMIT)
        groups = {"K_p": gains.K_p, "K_v": gains.K_v, "tau_max": limit, "velocity": gains.velocity}
    else:
        groups = {"q_0": scenario.trajectory.q_start, "tolerance": scenario.tolerance, "F_e": np.zeros(6)}
    return {
        v.name: _cast(table, v.name, np.asarray(groups[v.group])[v.index]) for v in table if v.group in groups
    }


def system_values(scenario: Scenario, settings: Mapping[str, Any] | None = None) -> dict[str, Values]:
    """All values of the units that robot, scenario and settings decide: unit to variable to value.

    Variables that none of them names are not in it: they keep the start values of the variable table.
    """
    changed = override(scenario, settings or {})
    values = {
        unit: robot_parameters(unit, scenario) | scenario_parameters(unit, scenario) | changed.get(unit, {})
        for unit in units_of(scenario)
    }
    if scenario.robot.limits:
        _check_start(values["plant"], scenario.robot.n)
    return values


def _check_start(plant: Values, n: int) -> None:
    """Raise UsageError for a start beyond the end stops, which would throw the link out of them."""
    for i in range(1, n + 1):
        q, low, high = (plant[f"{name}[{i}]"] for name in ("q_0", "q_min", "q_max"))
        if not low <= q <= high:
            raise UsageError(
                f"plant.q_0[{i}]: expected a start between the end stops, {low:g} and {high:g}, got {q:g}."
            )


def override(scenario: Scenario, settings: Mapping[str, Any]) -> dict[str, Values]:
    """Read settings such as ``controller.K_p[1]=3000``: unit to variable to value.

    A name without an index sets all elements: ``controller.K_p=3000``, or each of them by a list or array. An integer
    with named values takes the name: ``feedforward.mode=vdc``. Inputs that nothing feeds can be set too.

    Raises
    ------
    UsageError
        For an unknown unit or variable, one that cannot be set, a value that does not fit, or another number of values;
        with one line for each setting that is wrong.
    """
    values: dict[str, Values] = {}
    problems: list[str] = []
    for key, value in settings.items():
        try:
            unit, found = _set(scenario, key, value)
        except UsageError as error:
            problems.append(str(error))
        else:
            values.setdefault(unit, {}).update(found)
    if problems:
        raise UsageError("\n".join(problems))
    return values


def _set(scenario: Scenario, key: str, value: Any) -> tuple[str, Values]:
    """Return the unit of one setting, and the values of its variables."""
    unit, _, name = key.partition(".")
    units = units_of(scenario)
    if unit not in units or not name:
        raise UsageError(f"{key}: expected unit.parameter=value with a unit of {', '.join(units)}.")
    table = Interface(shipped_units()[unit], scenario.robot)
    variables = [v for v in table if name in (v.group, v.name)] or [table.find(name)]
    free = scenario_parameters(unit, scenario)
    for variable in variables:
        if variable.causality != "parameter" and variable.name not in free:
            fed = "n output" if variable.causality == "output" else " connected input"
            raise UsageError(
                f"{key}: {variable.name} is a{fed} of {unit}; only parameters and free inputs can be set."
            )
    names = [variable.name for variable in variables]
    try:
        values = spread(value, names)
    except ValueError as error:
        raise UsageError(f"{key}: {error}.") from None
    return unit, {name: _cast(table, name, one) for name, one in zip(names, values, strict=True)}


def _cast(table: Interface, name: str, value: Any) -> Any:
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
