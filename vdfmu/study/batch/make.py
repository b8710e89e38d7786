"""From a system to the C and the program that runs several parameter sets of it side by side, if there can be one."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from vdfmu.base.arrays import Floats
from vdfmu.base.errors import KernelError, UsageError
from vdfmu.base.files import data_path
from vdfmu.compiler.c.compile import Compilation, compile_libraries
from vdfmu.compiler.c.files import kernel_source
from vdfmu.compiler.c.loaded import SHOWN
from vdfmu.compiler.c.platforms import native_available, this_platform
from vdfmu.compiler.c.text import head
from vdfmu.compiler.unit.evaluate import Evaluation, Traced
from vdfmu.compiler.unit.interface import Interface
from vdfmu.compiler.unit.machine import traced_margins
from vdfmu.compiler.unit.program import Call
from vdfmu.compiler.unit.requirements import traced_requirements
from vdfmu.engine.algorithms import ALGORITHMS, choice
from vdfmu.engine.plan.grid import largest_step
from vdfmu.engine.plan.inputs import Course
from vdfmu.study.batch.engine import BatchProgram
from vdfmu.system.package.description import SystemDescription
from vdfmu.system.reference.compiled import Code
from vdfmu.system.reference.solution import SampledReference
from vdfmu.system.reference.wired import Evaluate, WiredUnits

_DIVISION = re.compile(r" / (w\d+);")
"""End of a line of C that divides: as a product, so that a compiler reuses reciprocals."""


def lane_sources(system: WiredUnits, delayed: bool) -> tuple[dict[str, bytes], list[list[int]]]:
    """Return file name to content of the C, and the places set by each call that runs only where these are recorded.

    Choices are compiled as they are in the memory of the system; `delayed`: every unit sees the others' outputs one
    sample late. KernelError if a unit has no traced functions, or one of these has no C text.
    """
    code = _LaneCode(system)
    folder = data_path("fmu_src")
    files = {name: (folder / "batch" / name).read_bytes() for name in ("lanes.h", "advance.h", "run.h", "level.c")}
    files |= {name: (folder / "c" / name).read_bytes() for name in ("control.h", "processor.h", "processor.c")}
    files["shown.h"] = SHOWN.encode()
    return files | {"system.c": code.text(delayed).encode()}, list(code.optional.values())


class _LaneCode(Code):
    """C text of a system in lanes."""

    head = "double *m, double t, const bool *shown"
    unused = "(void)t, (void)shown;"

    def __init__(self, system: WiredUnits) -> None:
        super().__init__(system)
        self.optional: dict[tuple[str, str], list[int]] = {}
        """Unit and function to the places that a call sets whose results no unit reads."""

    def call(self, name: str, unit: Traced, call: Call) -> Iterator[str]:
        """Yield the lines of a call; outputs that nothing reads are calculated where they are recorded."""
        lines = super().call(name, unit, call)
        if call in unit.interface.program.outputs:
            places = [place for group in call.sets for place in self._places(name, unit, group)]
            if self.system.read.isdisjoint(places):
                self.optional.setdefault((name, call.function), places)
                yield f"if (shown[{list(self.optional).index((name, call.function))}])"
        yield from lines

    def _places(self, name: str, unit: Evaluation, group: str) -> range:
        where, begin = unit.interface.arguments[group], self.system.begin(name)
        return range(begin + where.start, begin + where.stop)

    def text(self, delayed: bool) -> str:
        """Return the text of the whole."""
        system, solution = self.system, SampledReference(self.system, delayed)
        start = [
            action
            for name, carry in system.starting
            for action in (Evaluate(name, "start"), Evaluate(name, "outputs"), carry)
        ]
        lists = {"begin": start} | {f"part_{i}": solution.lists[f"part_{i}"] for i in range(len(solution.moving) + 1)}
        functions = [f"static {self.function(name, actions)}" for name, actions in lists.items()]
        moving = [name for name in solution.moving if system.units[name].x.size]
        steps = [self._step(i, name) for i, name in enumerate(moving)]
        begin = self._begin()
        sizes = {
            "MOVING": len(moving),
            "MOST_STATES": max((system.units[name].x.size for name in moving), default=1),
            "MOST_INPUTS": max(unit.interface.size for unit in system.units.values()),
        }
        return "\n".join(
            [
                head("The order of a step of the units of a system, and what they calculate, in lanes."),
                '#include "lanes.h"\n',
                *(_DIVISION.sub(r" * (1.0 / \1);", kernel_source(function)) for function in self.called.values()),
                f"enum {{ {', '.join(f'{name} = {size}' for name, size in sizes.items())} }};",
                "static const real still[MOST_INPUTS]; /* rates of the inputs */\n",
                '#include "advance.h"\n',
                *functions,
                *steps,
                begin,
                self._communication_step(moving),
                '#include "run.h"\n',
            ]
        )

    def _step(self, i: int, name: str) -> str:
        unit, begin = self.system.units[name], self.system.begin(name)
        assert isinstance(unit, Traced)
        (call,) = (c for c in unit.interface.program.step if unit.takes(c))
        function = self.take(unit.interface.functions.casadi_function(call.function))
        own = {"h": "h", "tolerance": f"m + {begin + unit.interface.reference['tolerance']}"}
        places = [
            "still" if argument.startswith("rate_") else own.get(argument)
            or f"m + {begin + unit.interface.arguments[argument].start}"
            for argument in function.name_in()
        ]  # fmt: skip
        arguments = ", ".join([*places, *function.name_out()])
        return (
            f"static void step_{i}(double *m, const double *h, double *x_new, double *norm, double *ratio)\n"
            f"{{\n    {function.name()}({arguments});\n}}\n"
        )

    def _communication_step(self, moving: Sequence[str]) -> str:
        """Text of the step of the whole over `size` [s]."""
        lines = ["part_0(m, t + size, shown);"]
        for i, name in enumerate(moving):
            interface, begin = self.system.units[name].interface, self.system.begin(name)
            x, n_x = interface.states.start + begin, interface.states.stop - interface.states.start
            places = f"{begin + interface.time}, {x}, {n_x}"
            lines += [
                f"alive = advance(step_{i}, m, {places}, h + {i}, alive, t, size);",
                f"part_{i + 1}(m, t + size, shown);",
            ]
        body = "".join(f"    {line}\n" for line in ["(void)h;", *lines, "return alive;"])
        arguments = "real *m, real *h, mask alive, const bool *shown, real t, scalar size"
        return f"static mask communication_step({arguments})\n{{\n{body}}}\n"

    def _begin(self) -> str:
        """Text of the start, with the conditions on several parameters."""
        lines = ["mask good = finite_lanes((real)0.0);", "begin(m, t, shown);"]
        for name, unit in self.system.units.items():
            robot = unit.interface.robot if unit.interface.has_robot else None
            found = [traced_requirements(unit.interface)[1]]
            if robot is not None:
                found += traced_margins(robot)
            for function in (self.take(each) for each in found if each is not None):
                count = function.numel_out(0)
                places = (self._places(name, unit, group).start for group in function.name_in())
                lines += [
                    "{",
                    f"    real margin[{count}];",
                    f"    {function.name()}({''.join(f'm + {place}, ' for place in places)}margin);",
                    f"    for (int i = 0; i < {count}; i++)",
                    "        good &= margin[i] >= 0.0;",
                    "}",
                ]
        body = "".join(f"    {line}\n" for line in [*lines, "return good;"])
        return f"static mask start(real *m, real t, const bool *shown)\n{{\n{body}}}\n"


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
    how = ALGORITHMS[scenario.master]
    if how.substeps != 1:
        problems.append(f"master: expected {choice(substeps=1)}, got {scenario.master}")
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
        files, optional = lane_sources(system, not how.ordered)
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
