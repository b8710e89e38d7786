"""What parameters of a unit must meet beyond their limits: its `requirements`, on floats and as a traced function."""

import casadi as ca

from vdfmu.kernel.requirements import STRICT, Requirement
from vdfmu.kernel.structure import Parameter
from vdfmu.kernel.trace import traced_function
from vdfmu.scalar.symbol import to_sx
from vdfmu.unit.base import Unit
from vdfmu.unit.evaluate import Floats, Plain
from vdfmu.unit.interface import Interface
from vdfmu.unit.trace import SymbolicWatch, run


def unmet(interface: Interface, memory: Floats) -> list[str]:
    """Return what the parameters in a unit's memory do not meet, in the words of native FMUs."""
    if interface.unit.requirements is Unit.requirements:
        return []
    plain = Plain(interface, memory)
    problems: list[str] = []
    for group, (expected, size) in plain.requirements().items():
        if not size > 0.0:
            those = interface.memory[interface.groups[group]]
            values = zip(those, plain.group(group), strict=True)
            units = (f" {v.unit}" if v.unit != "1" else "" for v in those)
            got = ", ".join(f"{v.name} = {x:.9g}{unit}" for (v, x), unit in zip(values, units, strict=True))
            problems.append(f"{those[0].name}: expected {expected}, got {got}.")
    return problems


def traced_requirements(interface: Interface) -> tuple[list[Requirement], ca.Function | None]:
    """Return what a unit requires, and the function of its groups to the margins; a requirement holds from 0 on."""
    if interface.unit.requirements is Unit.requirements:
        return [], None
    unit = interface.unit(interface.robot)
    watch = SymbolicWatch(unit, "requirements", {})
    found = run(unit, "requirements", watch)
    listed = [
        Requirement(
            expected, tuple(Parameter(group, v.index) for v in interface.memory[interface.groups[group]])
        )
        for group, (expected, _) in found.items()
    ]
    margins = ca.vertcat(*(to_sx(size) - STRICT for _, size in found.values()))
    inputs = {name: watch.symbols[name] for name in watch.reads}
    return listed, traced_function(f"{interface.name}_requirements", inputs, {"margin": margins})
