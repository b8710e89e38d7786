"""Conditions on the parameters of a unit and of its robot together, on floats and as a function."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import casadi as ca
import numpy as np

from vdfmu.base.errors import UnitError
from vdfmu.compiler.functions.traced import traced_function
from vdfmu.compiler.scalar.symbol import to_sx
from vdfmu.compiler.unit.base import BaseUnit
from vdfmu.compiler.unit.evaluate import Floats, Plain
from vdfmu.compiler.unit.interface import Interface
from vdfmu.compiler.unit.machine import STRICT, Entry, Requirement, margins
from vdfmu.compiler.unit.place import place
from vdfmu.compiler.unit.trace import Symbols, run


def unmet(interface: Interface, memory: Floats) -> list[str]:
    """Return what the parameters in a unit's memory do not meet together, in the words of native FMUs."""
    found: list[tuple[Requirement, float]] = []
    if interface.has_robot and interface.robot is not None:
        listed = interface.robot.requirements()
        robot = interface.robot.with_values(memory[interface.arguments["p"]])
        found += zip(listed, margins(robot, listed), strict=True)
    if interface.unit.requirements is not BaseUnit.requirements:
        found += _listed(interface, Plain(interface, memory).requirements())
    problems: list[str] = []
    for requirement, margin in found:
        if not margin >= 0.0:
            places = [interface.reference[parameter.name] for parameter in requirement.parameters]
            units = [f" {v.unit}" if v.unit != "1" else "" for v in (interface.memory[i] for i in places)]
            names = [interface.memory[i].name for i in places]
            got = (f"{name} = {memory[i]:.9g}{unit}" for name, i, unit in zip(names, places, units, strict=True))
            problems.append(f"{names[0]}: expected {requirement.expected}, got {', '.join(got)}.")
    return problems


def traced_requirements(interface: Interface) -> tuple[list[Requirement], ca.Function | None]:
    """Return what a unit requires itself, and the function of its groups to the margins; one holds from 0 on."""
    if interface.unit.requirements is BaseUnit.requirements:
        return [], None
    unit = interface.unit(interface.robot)
    record = Symbols(unit, "requirements", {})
    found = _listed(interface, run(unit, "requirements", record))
    sizes = ca.vertcat(*(to_sx(margin) for _, margin in found))
    inputs = {name: record.symbols[name] for name in record.reads}
    function = traced_function(f"{interface.name}_requirements", inputs, {"margin": sizes})
    return [requirement for requirement, _ in found], function


def _listed(interface: Interface, found: Any) -> list[tuple[Requirement, Any]]:
    """Return requirements with their margins; UnitError if the method returned something else."""
    if not isinstance(found, Mapping):
        raise _other(interface, repr(found))
    listed: list[tuple[Requirement, Any]] = []
    for key, one in found.items():
        groups = key if isinstance(key, tuple) else (key,)
        match one:
            case (str() as expected, size) if np.ndim(size) == 0:
                pass
            case _:
                raise _other(interface, f"{key!r}: {one!r}")
        entries: list[Entry] = []
        for group in groups:
            own = [v for v in interface.memory[interface.groups.get(group, slice(0))] if v.causality == "parameter"]
            if not own:
                raise _other(interface, f"{group!r}, which is not a parameter")
            entries += [Entry(group, v.index) for v in own]
        listed.append((Requirement(expected, tuple(entries)), size - STRICT))
    return listed


def _other(interface: Interface, got: str) -> UnitError:
    unit = interface.unit
    return UnitError(
        f"{place(unit, 'requirements')}: requirements() of {unit.__name__}: expected a parameter's name to what is "
        f'expected of it and one number, such as {{"k": ("k > 0", self.k)}}, got {got}.'
    )
