"""The program of a system as C for lanes: several parameter sets side by side, each in a lane of vectors."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator

import casadi as ca
import numpy as np

from vdfmu.base.compile import SHOWN, Compilation, compile_libraries
from vdfmu.base.errors import FmuError, KernelError, UsageError
from vdfmu.base.files import data_path
from vdfmu.base.platforms import this_platform, zig
from vdfmu.compiler.c.functions import kernel_source
from vdfmu.compiler.c.text import elementary_files, head
from vdfmu.compiler.unit.evaluate import Call, Evaluation, Traced
from vdfmu.extras.batch.engine import BatchProgram
from vdfmu.system.package.description import SystemDescription
from vdfmu.system.program import MovingUnit, SystemProgram
from vdfmu.system.reference.reference import Code

_DIVISION = re.compile(r" / (w\d+);")
"""End of a line of C that divides. It is replaced by a product, so that the compiler can reuse reciprocals."""
_ROUNDS = {ca.OP_FLOOR, ca.OP_CEIL, ca.OP_FMOD}


def lane_sources(program: SystemProgram) -> tuple[dict[str, bytes], list[list[int]]]:
    """Return file name to C text, and the places set by each call that only runs if one of them is recorded.

    Choices are compiled with their values in the memory of the system. KernelError for a function without C text.
    """
    code = _LaneCode(program)
    folder = data_path("fmu_src")
    files = {name: (folder / "batch" / name).read_bytes() for name in ("lanes.h", "advance.h", "run.h", "level.c")}
    files |= {name: (folder / "c" / name).read_bytes() for name in ("control.h", "processor.h", "processor.c")}
    files |= {name: text.encode() for name, text in {"shown.h": SHOWN, **elementary_files()}.items()}
    return files | {"system.c": code.text().encode()}, list(code.optional.values())


class _LaneCode(Code):
    """C text of a system for lanes."""

    head = "double *m, double t, const bool *shown"
    unused = "(void)t, (void)shown;"

    def __init__(self, program: SystemProgram) -> None:
        super().__init__(program.system)
        self.program = program
        self.optional: dict[tuple[str, str], list[int]] = {}
        """Unit and function to the places set by a call whose results no unit reads."""

    def call(self, name: str, unit: Traced, call: Call) -> Iterator[str]:
        """Yield the lines of a call; outputs that nothing reads are only calculated if they are recorded."""
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

    def text(self) -> str:
        """Return the complete text."""
        program = self.program
        functions = [f"static {self.function(name, actions)}" for name, actions in program.lists.items()]
        units = [text for i, moving in enumerate(program.moving) for text in self._unit(i, moving)]
        begin, sampled = self._begin(), {call.function for moving in program.moving for call in moving.update}
        sizes = {"MOVING": len(program.moving)}
        sizes["MOST_INPUTS"] = max(unit.interface.size for unit in self.system.units.values())
        return "\n".join(
            [
                head("The order and the calculations of a step of a system's units, for lanes."),
                '#include "lanes.h"\n',
                *(_kernel_text(function, function.name() in sampled) for function in self.called.values()),
                f"enum {{ {', '.join(f'{name} = {size}' for name, size in sizes.items())} }};",
                "static const real still[MOST_INPUTS]; /* rates of the inputs */\n",
                '#include "advance.h"\n',
                *functions,
                *units,
                begin,
                self._communication_step(),
                '#include "run.h"\n',
            ]
        )

    def _unit(self, i: int, moving: MovingUnit) -> Iterator[str]:
        """Yield the functions of a unit for a step, and its ``LaneUnit``."""
        parts: dict[str, object] = dict(moving.numbers())
        for kind, function, arguments in (
            ("step", moving.step, "const double *h, double *x_new, double *norm, double *ratio"),
            ("left", moving.left, "double *left"),
        ):
            if function is not None:
                taken, parts[kind] = self.take(function), f"{kind}_{i}"
                places = map(moving.place, taken.name_in())
                listed = (
                    "h" if name == "h" else "still" if place is None else f"m + {place}"
                    for name, place in zip(taken.name_in(), places, strict=True)
                )
                call = f"{taken.name()}({', '.join([*listed, *taken.name_out()])});"
                yield f"static void {kind}_{i}(double *m, {arguments})\n{{\n    {call}\n}}\n"
        if moving.update:
            parts["update"] = f"update_{i}"
            lines = (line for call in moving.update for line in self.call(moving.name, moving.unit, call))
            body = "".join(f"    {line}\n" for line in lines)
            yield f"static void update_{i}(double *m)\n{{\n{body}}}\n"
        fields = ", ".join(f".{name} = {value}" for name, value in parts.items())
        yield f"static const LaneUnit unit_{i} = {{{fields}}};\n"

    def _communication_step(self) -> str:
        """Text of the step of the whole over `size` [s]."""
        lines = ["(void)h;", "part_0(m, t + size, shown);"]
        for i in range(len(self.program.moving)):
            lines += [f"alive = move(&unit_{i}, m, h + {i}, alive, t, size);", f"part_{i + 1}(m, t + size, shown);"]
        body = "".join(f"    {line}\n" for line in [*lines, "return alive;"])
        arguments = "real *m, real *h, mask alive, const bool *shown, real t, scalar size"
        return f"static mask communication_step({arguments})\n{{\n{body}}}\n"

    def _begin(self) -> str:
        """Text of the start, with the conditions on several parameters."""
        lines = ["mask good = finite_lanes((real)0.0);", "begin(m, t, shown);"]
        for condition in self.program.conditions:
            function = self.take(condition.function)
            count = function.numel_out(0)
            lines += [
                "{",
                f"    real margin[{count}];",
                f"    {function.name()}({''.join(f'm + {place}, ' for place in condition.places)}margin);",
                f"    for (int i = 0; i < {count}; i++)",
                "        good &= margin[i] >= 0.0;",
                "}",
            ]
        body = "".join(f"    {line}\n" for line in [*lines, "return good;"])
        return f"static mask start(real *m, real t, const bool *shown)\n{{\n{body}}}\n"


def _kernel_text(function: ca.Function, exact: bool) -> str:
    """Return the C text of a traced function, with reciprocals and fused products unless it rounds or must be `exact`.

    Rounded and sampled values jump, so their operands must be bit-identical to an FMU's.
    """
    text, parts = kernel_source(function), (function, *function.find_functions())
    if exact or not _ROUNDS.isdisjoint(part.instruction_id(k) for part in parts for k in range(part.n_instructions())):
        return f"#pragma clang fp contract(off)\n{text}#pragma clang fp contract(fast)\n"
    return _DIVISION.sub(r" * (1.0 / \1);", text)


_WIDE = ("-mavx2", "-mfma", "-mavx512f", "-mavx512dq", "-mavx512vl", "-mprefer-vector-width=512")
LEVELS = ((4, ()), (4, ("-mavx2", "-mfma")), (8, _WIDE))
"""Number of lanes and flags of the libraries for any processor, for AVX2, and for AVX-512."""
FLAGS = ("-ffp-contract=fast-honor-pragmas",)
"""Allows fused multiply-add, because the results are not bit-identical to an FMU's anyway."""


def make_program(description: SystemDescription, varied: Iterable[str]) -> BatchProgram:
    """Compile a system with `varied` parameters for lanes. UsageError with all reasons if that is impossible."""
    try:
        zig()
    except FmuError:
        raise UsageError("it needs the compiler ziglang: pip install 'vdfmu[native]'") from None
    program = SystemProgram(description, varied)
    try:
        files, optional = lane_sources(program)
    except KernelError as error:
        raise UsageError(str(error).removesuffix(".")) from None
    platform = this_platform()
    levels = LEVELS if platform.startswith("x86_64") else LEVELS[:1]
    libraries = compile_libraries(
        Compilation("lanes", files, platform, (*FLAGS, f"-DLANES={width}", *flags), zig=True) for width, flags in levels
    )
    fed = np.array([place for place, _ in program.system.outside], dtype=np.int64)
    grid = program.grid
    points = grid.times(0, grid.n)
    sizes = np.append(np.full(grid.n - 1, grid.step), grid.last)
    return BatchProgram(
        tuple(libraries),
        program.system.memory.copy(),
        program.limits(),
        program.signals(),
        optional,
        fed,
        program.courses(),
        points,
        sizes,
        np.append(points, grid.end),
    )
