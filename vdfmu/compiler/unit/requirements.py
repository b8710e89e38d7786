"""Conditions on the parameters of a unit and of its robot together, on floats and as a function."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

import casadi as ca
import numpy as np

from vdfmu.base.arrays import Floats
from vdfmu.base.errors import UnitError
from vdfmu.compiler.functions.traced import traced_function
from vdfmu.compiler.scalar.symbol import to_sx
from vdfmu.compiler.unit.base import BaseUnit
from vdfmu.compiler.unit.declaration import STRICT, Entry, Machine, Requirement
from vdfmu.compiler.unit.evaluate import Plain
from vdfmu.compiler.unit.interface import Interface
from vdfmu.compiler.unit.place import place
from vdfmu.compiler.unit.trace import Symbols, run


def unmet(interface: Interface, memory: Floats) -> list[str]:
    """Return an error for each condition that the parameters in a unit's memory violate, as native FMUs word it."""
    checked: list[tuple[Requirement, float]] = []
    if interface.has_robot and interface.robot is not None:
        requirements = interface.robot.requirements()
        robot = interface.robot.with_values(memory[interface.arguments["p"]])
        checked += zip(requirements, margins(robot, requirements), strict=True)
    if interface.unit.requirements is not BaseUnit.requirements:
        checked += _with_margins(interface, Plain(interface, memory).requirements())
    problems: list[str] = []
    for requirement, margin in checked:
        if not margin >= 0.0:
            places = [interface.reference[parameter.name] for parameter in requirement.parameters]
            variables = [interface.memory[i] for i in places]
            got = (
                f"{v.name} = {memory[i]:.9g}{f' {v.unit}' if v.unit != '1' else ''}"
                for v, i in zip(variables, places, strict=True)
            )
            problems.append(f"{variables[0].name}: expected {requirement.expected}, got {', '.join(got)}.")
    return problems


def margins(machine: Any, requirements: Collection[Requirement]) -> list[Any]:
    """Return the margin of each condition, of floats or symbols; a condition holds if its margin is >= 0."""
    return [each.margin(machine, each.parameters[0]) for each in requirements if each.margin is not None]


def traced_margins(machine: Machine) -> list[ca.Function]:
    """Return the function ``margins`` of the parameter vector to the result of `margins`; empty without conditions."""
    requirements = machine.requirements()
    if not requirements:
        return []
    symbols, p = machine.symbolic()
    return [traced_function("margins", {"p": p}, {"margin": to_sx(margins(symbols, requirements))})]


def traced_requirements(interface: Interface) -> tuple[list[Requirement], ca.Function | None]:
    """Return the conditions of a unit, and the function of its groups to their margins, as in :func:`margins`."""
    if interface.unit.requirements is BaseUnit.requirements:
        return [], None
    unit = interface.unit(interface.robot)
    record = Symbols(unit, "requirements", {})
    checked = _with_margins(interface, run(unit, "requirements", record))
    sizes = ca.vertcat(*(to_sx(margin) for _, margin in checked))
    inputs = {name: record.symbols[name] for name in record.reads}
    function = traced_function(f"{interface.name}_requirements", inputs, {"margin": sizes})
    return [requirement for requirement, _ in checked], function


def _with_margins(interface: Interface, returned: Any) -> list[tuple[Requirement, Any]]:
    """Return conditions with their margins; UnitError if the method returned something else."""
    if not isinstance(returned, Mapping):
        raise _wrong_type(interface, repr(returned))
    pairs: list[tuple[Requirement, Any]] = []
    for key, value in returned.items():
        match value:
            case (str() as expected, size) if np.ndim(size) == 0:
                pass
            case _:
                raise _wrong_type(interface, f"{key!r}: {value!r}")
        entries: list[Entry] = []
        for group in key if isinstance(key, tuple) else (key,):
            members = interface.memory[interface.groups.get(group, slice(0))]
            indices = [v.index for v in members if v.causality == "parameter"]
            if not indices:
                raise _wrong_type(interface, f"{group!r}, which is not a parameter")
            entries += [Entry(group, index) for index in indices]
        pairs.append((Requirement(expected, tuple(entries)), size - STRICT))
    return pairs


def _wrong_type(interface: Interface, got: str) -> UnitError:
    unit = interface.unit
    return UnitError(
        f"{place(unit, 'requirements')}: requirements() of {unit.__name__}: expected a parameter's name to its "
        f'condition and one number, such as {{"k": ("k > 0", self.k)}}, got {got}.'
    )
