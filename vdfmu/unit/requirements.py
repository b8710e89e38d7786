"""What the parameters of a unit must meet together, those of its robot and its own, on floats and as a function."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import casadi as ca

from vdfmu.kernel.requirements import STRICT, Requirement, margins, requirements
from vdfmu.kernel.structure import Parameter, set_parameters
from vdfmu.kernel.trace import traced_function
from vdfmu.scalar.symbol import to_sx
from vdfmu.unit.base import Unit
from vdfmu.unit.evaluate import Floats, Plain
from vdfmu.unit.interface import Interface
from vdfmu.unit.trace import SymbolicWatch, run


def unmet(interface: Interface, memory: Floats) -> list[str]:
    """Return what the parameters in a unit's memory do not meet together, in the words of native FMUs."""
    found: list[tuple[Requirement, float]] = []
    if interface.has_robot and interface.robot is not None:
        listed = requirements(interface.robot)
        robot = set_parameters(interface.robot, memory[interface.slice("p")])
        found += zip(listed, margins(robot, listed), strict=True)
    if interface.unit.requirements is not Unit.requirements:
        own = Plain(interface, memory).requirements()
        found += zip(_listed(interface, own), (size - STRICT for _, size in own.values()), strict=True)
    problems: list[str] = []
    for requirement, margin in found:
        if not margin >= 0.0:
            places = [interface.reference[parameter.name] for parameter in requirement.parameters]
            units = [f" {v.unit}" if v.unit != "1" else "" for v in (interface.memory[i] for i in places)]
            names = [interface.memory[i].name for i in places]
            got = (
                f"{name} = {memory[i]:.9g}{unit}" for name, i, unit in zip(names, places, units, strict=True)
            )
            problems.append(f"{names[0]}: expected {requirement.expected}, got {', '.join(got)}.")
    return problems


def traced_requirements(interface: Interface) -> tuple[list[Requirement], ca.Function | None]:
    """Return what a unit requires itself, and the function of its groups to the margins; one holds from 0 on."""
    if interface.unit.requirements is Unit.requirements:
        return [], None
    unit = interface.unit(interface.robot)
    watch = SymbolicWatch(unit, "requirements", {})
    found = run(unit, "requirements", watch)
    sizes = ca.vertcat(*(to_sx(size) - STRICT for _, size in found.values()))
    inputs = {name: watch.symbols[name] for name in watch.reads}
    function = traced_function(f"{interface.name}_requirements", inputs, {"margin": sizes})
    return _listed(interface, found), function


def _listed(interface: Interface, found: Mapping[str, tuple[str, Any]]) -> list[Requirement]:
    return [
        Requirement(
            expected, tuple(Parameter(group, v.index) for v in interface.memory[interface.groups[group]])
        )
        for group, (expected, _) in found.items()
    ]
