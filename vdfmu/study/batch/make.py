"""From a system to the program that runs several parameter sets of it side by side, if there can be one."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from vdfmu.base.arrays import Floats
from vdfmu.base.errors import KernelError, UsageError
from vdfmu.compiler.c.compile import Compilation, compile_libraries
from vdfmu.compiler.c.platforms import this_platform
from vdfmu.compiler.c.programs import native_available
from vdfmu.compiler.unit.evaluate import Traced
from vdfmu.compiler.unit.interface import Interface
from vdfmu.engine.algorithms import ALGORITHMS, choice
from vdfmu.engine.plan.grid import largest_step
from vdfmu.engine.plan.inputs import Course
from vdfmu.study.batch.engine import BatchProgram
from vdfmu.study.batch.source import lane_sources
from vdfmu.system.package.description import SystemDescription
from vdfmu.system.reference.wired import WiredUnits

_WIDE = ("-mavx2", "-mfma", "-mavx512f", "-mavx512dq", "-mavx512vl", "-mprefer-vector-width=512")
LEVELS = ((4, ()), (4, ("-mavx2", "-mfma")), (8, _WIDE))
"""Lanes and flags of the libraries: for any processor, for those with AVX2, for those with AVX-512."""
FLAGS = ("-ffp-contract=fast",)
"""A product and a sum in one go: the bits differ from an FMU's in any case."""


def make_program(description: SystemDescription, varied: Iterable[str]) -> BatchProgram:
    """Compile a system whose `varied` parameters, ``component.variable``, differ from run to run.

    UsageError, with all reasons, if it cannot be run in lanes.
    """
    scenario = description.scenario
    problems = [] if native_available() else ["it needs the compiler ziglang: pip install 'vdfmu[native]'"]
    if not ALGORITHMS[scenario.master].reference:
        problems.append(f"master: expected {choice(continuous=False)}, got {scenario.master}")
    if scenario.adaptive is not None:
        problems.append("adaptive: its steps are as long as given")
    foreign = [name for name, table in description.tables.items() if not isinstance(table, Interface)]
    if foreign:
        problems.append(f"{', '.join(foreign)}: an FMU of another tool")
    if problems:
        raise UsageError("\n".join(problems))
    system = WiredUnits(description)
    for name, unit in system.units.items():
        if not isinstance(unit, Traced):
            problems.append(f"{name}: a unit in plain Python")
        elif unit.interface.is_sampled:
            problems.append(f"{name}: sampled states")
        elif unit.interface.program.left:
            problems.append(f"{name}: switching by time")
        else:
            if unit.x.size and unit.group("solver")[0]:
                problems.append(f"{name}.solver: expected adaptive")
            problems += _deciding(name, unit, set(varied))
    if problems:
        raise UsageError("\n".join(problems))
    try:
        files, optional = lane_sources(system, ALGORITHMS[scenario.master].reference == "sampled-delayed")
    except KernelError as error:
        raise UsageError(str(error).removesuffix(".")) from None
    platform = this_platform()
    levels = LEVELS if platform.startswith("x86_64") else LEVELS[:1]
    libraries = compile_libraries(
        Compilation("lanes", files, platform, (*FLAGS, f"-DLANES={width}", *flags)) for width, flags in levels
    )
    n = round(scenario.stop / scenario.step)
    points = scenario.step * np.arange(n, dtype=np.float64)
    sizes = np.full(n, scenario.step)
    if points[-1] + sizes[-1] != scenario.stop:
        sizes[-1] = largest_step(points[-1].item(), scenario.stop)
    return BatchProgram(
        tuple(libraries), system.memory.copy(), *_variables(system), optional,
        np.array([place for place, _ in system.outside], dtype=np.int64),
        _courses([course for _, course in system.outside], points), points, sizes, np.append(points, scenario.stop),
    )  # fmt: skip


def _deciding(name: str, unit: Traced, varied: set[str]) -> list[str]:
    """Return the variables of a unit that cannot vary, since they decide what is compiled."""
    program = unit.interface.program
    groups = {choice for call in (*program.calls, *program.step) for choice, _ in call.when} | {"solver"}
    return [
        f"{name}.{v.name}: decides what is compiled, and can have one value in a study only"
        for v in unit.interface.variables
        if v.group in groups and f"{name}.{v.name}" in varied
    ]


def _variables(system: WiredUnits) -> tuple[dict[str, tuple[int, float, float]], dict[str, tuple[int, str]]]:
    """Return parameters and signals, of each unit outputs before inputs, as a master records them."""
    parameters: dict[str, tuple[int, float, float]] = {}
    signals: dict[str, tuple[int, str]] = {}
    fed = system.linked | {place for place, _ in system.outside}
    for name, unit in system.units.items():
        begin = system.begin(name)
        for i, v in enumerate(unit.interface.variables):
            if v.causality in ("parameter", "input"):
                least = -np.inf if v.minimum is None else v.minimum
                parameters[f"{name}.{v.name}"] = begin + i, least, np.inf if v.maximum is None else v.maximum
        for kind in ("output", "input"):
            for i, v in enumerate(unit.interface.variables):
                if v.causality == kind and (kind == "output" or begin + i in fed):
                    signals[f"{name}.{v.name}"] = begin + i, v.unit or ""
    return parameters, signals


def _courses(courses: list[Course], points: Floats) -> Floats:
    values = [[course.at(t)[0] for course in courses] for t in points.tolist()] if courses else []
    return np.array(values, dtype=np.float64).reshape(len(points), len(courses))
