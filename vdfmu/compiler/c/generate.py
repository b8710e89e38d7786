"""The generated C of a unit: `unit.c`, `config.h`, `kernel.h` and one file for each traced function.

`fmu_src/c/unit.h` declares the content of `unit.c`. The tables and functions come from the
:class:`~vdfmu.compiler.unit.interface.Interface`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from itertools import accumulate

import numpy as np

from vdfmu.base.progress import counted
from vdfmu.base.version import __version__
from vdfmu.compiler.c.functions import avx2_copies, kernel_files
from vdfmu.compiler.c.text import (
    array,
    c_constant,
    c_prototype,
    call_lines,
    cell,
    comment,
    definition,
    elementary_files,
    fields,
    head,
    indented,
    setting_lines,
    string,
    wrapped,
)
from vdfmu.compiler.functions.derivatives import DIRECTIONS, NEVER
from vdfmu.compiler.unit.declaration import AT, PHASES
from vdfmu.compiler.unit.evaluate import traced_margins, traced_requirements
from vdfmu.compiler.unit.interface import Interface
from vdfmu.compiler.unit.trace import Call, argument_name
from vdfmu.compiler.unit.variable import Variable

_ROLES = {"input": "INPUT", "output": "OUTPUT", "local": "DERIVATIVE", "independent": "TIME"}
_SOLVER = ("h", "tolerance")
"""Arguments of the step that are passed by value."""
_ADD = """\
static void add(double *target, const double *term, size_t n)
{
    for (size_t i = 0; i < n; i++)
        target[i] += term[i];
}
"""


def generated_sources(interface: Interface, guid: str, *, adjoints: bool = True) -> dict[str, str]:
    """Return file name to text of the generated part of a unit, with or without adjoint derivatives."""
    traced = _TracedFunctions(interface, DIRECTIONS if adjoints else DIRECTIONS[:1])
    unit = _UnitGenerator(interface, guid, traced)
    return {"config.h": unit.config(), "kernel.h": unit.kernel_header(), "unit.c": unit.source(), **traced.files()}


class _TracedFunctions:
    """The traced functions in the C of a unit."""

    def __init__(self, interface: Interface, directions: Sequence[str]) -> None:
        self.interface, self.directions = interface, directions
        program = interface.program
        self.called = [call.function for call in program.calls]
        self.steps = sorted({call.function for call in program.step})
        at_events = [call.function for calls in program.at_events.values() for call in calls]
        names = [*self.called, *self.steps, *(call.function for call in program.left), *at_events]
        self.functions = {
            name: interface.functions.casadi_function(name)
            for name in counted(f"trace {interface.name}", names, len(names))
        }
        robot = interface.robot if interface.has_robot else None
        self.margins = traced_margins(robot) if robot is not None else []
        function = traced_requirements(interface)[1]
        self.margins += [function] if function is not None else []
        self.functions |= {function.name(): function for function in self.margins}

    def files(self) -> dict[str, str]:
        """Return file name to text of the functions."""
        files: dict[str, str] = {}
        for name, function in self.functions.items():
            traced = self.interface.functions.casadi_function
            endings = self.directions if name in self.called else ()
            kernel = kernel_files(
                function, self.functions, {ending: partial(traced, f"{name}_{ending}") for ending in endings}
            )
            files |= kernel | (avx2_copies(kernel) if name in self.steps else {})
        return files | elementary_files()


class _UnitGenerator:
    """Generator of one unit."""

    def __init__(self, interface: Interface, guid: str, traced: _TracedFunctions) -> None:
        self.interface, self.guid = interface, guid
        self.program = interface.program
        self.traced, self.functions = traced, traced.functions
        self._has_adjoints = "reverse" in traced.directions
        robot = interface.robot if interface.has_robot else None
        self.conditions = robot.requirements() if robot is not None else []
        self.requirements = self.conditions + traced_requirements(interface)[0]

    def config(self) -> str:
        name = self.interface.model_name
        return (
            head(f"Names of the unit {name}.")
            + f"""#ifndef VDFMU_CONFIG_H
#define VDFMU_CONFIG_H

#define MODEL_IDENTIFIER {name}

/* Prefix of the FMI functions. DISABLE_PREFIX: none, as a shared library has it. */
#ifndef DISABLE_PREFIX
#ifndef FMI2_FUNCTION_PREFIX
#define FMI2_FUNCTION_PREFIX {name}_
#endif
#ifndef FMI3_FUNCTION_PREFIX
#define FMI3_FUNCTION_PREFIX {name}_
#endif
#endif

#endif
"""
        )

    def kernel_header(self) -> str:
        listed = [
            c_prototype(function, ending)
            for name, function in self.functions.items()
            for ending in (("", *self.traced.directions) if name in self.traced.called else ("",))
        ]
        listed += [c_prototype(self.functions[name]).replace(name, f"{name}_avx2", 1) for name in self.traced.steps]
        prototypes = "".join(f"{wrapped(prototype)};\n" for prototype in listed)
        about = (
            "Traced equations. `*_forward` is the product of the Jacobian with a direction d_*, `*_reverse` that of a "
            "direction bar_* with the Jacobian, `*_avx2` see processor.h."
        )
        return head(about) + f"#ifndef VDFMU_KERNEL_H\n#define VDFMU_KERNEL_H\n\n{prototypes}\n#endif\n"

    def source(self) -> str:
        name, robot = self.interface.model_name, self.interface.robot
        about = f" Robot: {robot.name}." if robot is not None else ""
        parts = (
            comment(
                f"{name}: {self.interface.description}.{about} The tables of the unit and its program on the "
                f"memory. Generated by vdfmu {__version__}; do not edit."
            )
            + "#include <math.h>\n#include <string.h>\n\n"
            + '#include "kernel.h"\n#include "processor.h"\n#include "unit.h"\n',
            self._positions(),
            *self._variables(),
            self._arrays(),
            *self._patterns(),
            *self._requirements(),
            _ADD if self.program.calls and self._has_adjoints else "",
            *self._programs(),
            *self._solver_step(),
            *self._left(),
            *self._events(),
            self._unit(),
        )
        return "\n".join(filter(None, parts))

    def _positions(self) -> str:
        """Return the positions of the groups, as an enumeration."""
        arguments = self.interface.arguments.items()
        places = {group: where.start for group, where in arguments if where.stop > where.start}
        listed = fields(f"at_{group} = {place}" for group, place in places.items())
        return f"/* Positions in the memory: the first of each group. */\nenum {{\n{listed}\n}};\n"

    def _variables(self) -> Iterator[str]:
        lists: dict[tuple[str, ...], str] = {}
        for v in self.interface.memory:
            if v.choices and v.choices not in lists:
                lists[v.choices] = f"choices_of_{v.group}"
                yield array("char *const", lists[v.choices], map(string, v.choices))
        kinds: dict[str, str] = {}  # common part of rows to its macro
        rows: list[str] = []
        for v in self.interface.memory:
            kind = kinds.setdefault(_kind(v, lists.get(v.choices)), f"V{len(kinds)}")
            rows.append(f"{kind}({string(v.name)}, {c_constant(0.0 if v.start is None else v.start)})")
        macros = "".join(f"#define {name}(name, start) {kind}\n" for kind, name in kinds.items())
        columns = "/* name, unit, type, role, start, min, max, names of the values, their number */\n"
        yield columns + macros + array("Variable", "variables", rows)

    def _arrays(self) -> str:
        rows = (cell(string(a.name), a.first, a.size) for a in self.interface.arrays)
        return "/* name, first, size */\n" + array("Array", "arrays", rows)

    def _patterns(self) -> Iterator[str]:
        rows = [i for i, v in enumerate(self.interface.memory) if v.causality in ("output", "local")]
        yield array("size_t", "calculated", map(str, rows))
        for name, read in (("step", self.interface.step_dependencies), ("start", self.interface.start_dependencies)):
            runs = [_runs(read(row)) for row in rows]
            begin = [0, *accumulate(map(len, runs))]
            yield array("size_t", f"{name}_begin", map(str, begin))
            yield array("Run", f"{name}_run", (cell(*run) for listed in runs for run in listed))

    def _requirements(self) -> Iterator[str]:
        if not self.requirements:
            return
        positions = [[self.interface.reference[p.name] for p in r.parameters] for r in self.requirements]
        yield array("size_t", "required", (str(i) for listed in positions for i in listed))
        begins = accumulate(map(len, positions), initial=0)
        rows = (
            cell(string(requirement.expected), f"required + {begin}", len(listed))
            for requirement, begin, listed in zip(self.requirements, begins, positions, strict=False)
        )
        yield array("Requirement", "requirements", rows, one_a_line=True)
        calls = ""
        first = [0, len(self.conditions)] if self.conditions else [0]
        for begin, function in zip(first, self.traced.margins, strict=False):
            places = [f"m + at_{argument}" for argument in function.name_in()]
            calls += f"    {function.name()}({', '.join([*places, f'margin + {begin}' if begin else 'margin'])});\n"
        yield f"static void unit_margins(const double *m, double *margin)\n{{\n{calls}}}\n"

    def _programs(self) -> Iterator[str]:
        for name in PHASES:
            calls: tuple[Call, ...] = getattr(self.program, name)
            if name == "update" and not calls:
                continue
            yield _function(name, "double *m", "m", self._blocks(calls, partial(self._set, "m", "")))
            forward = self._blocks(calls, partial(self._set, "md", "_forward"))
            yield _function(f"{name}_forward", "const double *m, double *d", "md", forward)
            if self._has_adjoints:
                reverse = self._blocks(calls[::-1], self._reverse)
                yield _function(f"{name}_reverse", "const double *m, double *d", "md", reverse)

    def _blocks(self, calls: Sequence[Call], write: Callable[[Call], list[str]]) -> list[str]:
        """Return the lines of calls, with a condition if a call depends on choices."""
        lines: list[str] = []
        for call in calls:
            conditions = [f"m[at_{argument_name(group)}] == {c_constant(value)}" for group, value in call.when]
            lines += indented(f"if ({' && '.join(conditions)}) {{", write(call)) if conditions else write(call)
        return lines

    def _set(self, memories: str, ending: str, call: Call) -> list[str]:
        """Return the lines of a call that reads memories and writes its results to the last memory."""
        function = self.functions[call.function]
        arguments = [f"{memory} + at_{call.group(name)}" for memory in memories for name in function.name_in()]
        groups = ((name, call.group(name)) for name in function.name_out())
        made = [(name, f"{memories[-1]} + at_{group}", self._size(group), name != group) for name, group in groups]
        return setting_lines(f"{function.name()}{ending}", arguments, made)

    def _reverse(self, call: Call) -> list[str]:
        function = self.functions[call.function]
        arguments = {name: call.group(name) for name in function.name_in()}
        made = [call.group(name) for name in function.name_out()]
        places = [f"m + at_{group}" for group in arguments.values()]
        places += [f"d + at_{group}" for group in made] + [f"bar_{name}" for name in arguments]
        bars = fields((f"bar_{name}[{self._size(group)}]" for name, group in arguments.items()), indent="")
        lines = [
            *f"double {bars};".splitlines(),
            *call_lines(f"{function.name()}_reverse", places),
            *(f"memset(d + at_{group}, 0, {self._size(group)} * sizeof(double));" for group in made),
            *(f"add(d + at_{group}, bar_{name}, {self._size(group)});" for name, group in arguments.items()),
        ]
        return indented("{", lines)

    def _solver_step(self) -> Iterator[str]:
        if not self.program.step:
            return
        arguments = (
            "const double *m, const double *rate, double h, double tolerance,\n"
            "                        double *x_new, double *norm, double *ratio"
        )
        for ending in ("", "_avx2"):
            lines = self._blocks(self.program.step, partial(self._step_call, ending))
            text = _function(f"solver_step{ending}", arguments, ["rate"], lines)
            yield f"#ifdef AVX2_STEP\n{text}#endif\n" if ending else text

    def _left(self) -> Iterator[str]:
        if self.program.left:
            lines = [f"*left = {c_constant(NEVER)};", *self._blocks(self.program.left, partial(self._step_call, ""))]
            yield _function("left", "const double *m, const double *rate, double *left", ("m", "rate"), lines)

    def _events(self) -> Iterator[str]:
        if not self.program.at_events:
            return
        lists = {f"event_{name.removeprefix(AT)}": calls for name, calls in self.program.at_events.items()}
        for name, calls in {"events": self.program.events, **lists}.items():
            yield _function(name, "double *m", "m", self._blocks(calls, partial(self._set, "m", "")))
        yield f"static void (*const at_event[])(double *m) = {{{', '.join(lists)}}};\n"

    def _step_call(self, ending: str, call: Call) -> list[str]:
        function, places = self.functions[call.function], list[str]()
        for name in function.name_in():
            memory = "rate" if name.startswith("rate_") else "m"
            places.append(f"&{name}" if name in _SOLVER else f"{memory} + at_{name.removeprefix('rate_')}")
        return call_lines(function.name() + ending, [*places, *function.name_out()])

    def _size(self, group: str) -> int:
        where = self.interface.arguments[group]
        return where.stop - where.start

    def _unit(self) -> str:
        interface, N = self.interface, self.interface.size
        n_x = interface.states.stop - interface.states.start
        calculated = sum(v.causality in ("output", "local") for v in interface.memory)
        has_step = bool(self.program.step)
        values = {
            "name": string(interface.model_name),
            "guid": string(self.guid),
            "n": N,
            "variables": "variables",
            "n_arrays": len(interface.arrays),
            "arrays": "arrays",
            "time": "at_t",
            "n_x": n_x,
            "x": "at_x" if n_x else "0",
            "x_dot": "at_x_dot" if n_x else "0",
            "exchange": int(interface.has_exchange),
            "tolerance": f"at_{argument_name('tolerance')}" if has_step else f"{N}, /* there is no solver */",
            "solver": "at_solver" if has_step else N,
            "period": "at_period" if self.program.update else f"{N}, /* nothing is sampled */",
            "sampled": interface.sampled.start,
            "n_sampled": interface.sampled.stop - interface.sampled.start,
            "step_pattern": f"{{{calculated}, calculated, step_begin, step_run}}",
            "start_pattern": f"{{{calculated}, calculated, start_begin, start_run}}",
            "n_requirements": len(self.requirements),
            "requirements": "requirements" if self.requirements else "NULL",
            "margins": "unit_margins" if self.requirements else "NULL",
        }
        for name in ("start", "outputs", "derivatives", *(["update"] if self.program.update else [])):
            for each in (name, *(f"{name}_{ending}" for ending in self.traced.directions)):
                values[each] = each
        values |= {
            "left": "left" if self.program.left else "NULL",
            "solver_step": "solver_step" if has_step else "NULL",
        }
        if self.program.at_events:
            where = interface.events
            values |= {"n_events": where.stop - where.start, "event": where.start}
            values |= {"events": "events", "at_event": "at_event"}
        lines = "".join(f"    .{name} = {value}".rstrip() + ",\n" for name, value in values.items())
        copy = "#ifdef AVX2_STEP\n    .solver_step_avx2 = solver_step_avx2,\n#endif\n" if has_step else ""
        return f"const Unit unit = {{\n{lines.replace(' */,', ' */')}{copy}}};\n"


def _runs(positions: list[int]) -> list[tuple[int, int]]:
    """Return start and end of each run of consecutive positions."""
    parts = np.split(np.array(positions, int), np.flatnonzero(np.diff(positions) > 1) + 1) if positions else ()
    return [(int(part[0]), int(part[-1]) + 1) for part in parts]


def _kind(v: Variable, choices: str | None) -> str:
    """Return a row of the table of variables, without name and start."""
    role = _ROLES.get(v.causality)
    if role is None:
        role = "TUNABLE_PARAMETER" if v.variability == "tunable" else "FIXED_PARAMETER"
    least = "-INFINITY" if v.minimum is None else c_constant(v.minimum)
    most = "INFINITY" if v.maximum is None else c_constant(v.maximum)
    unit = string(v.unit or "")
    return cell("name", unit, v.type.upper(), role, "start", least, most, choices or "NULL", len(v.choices))


def _function(name: str, arguments: str, names: Iterable[str], lines: Sequence[str]) -> str:
    """Return a function of the program. An empty function marks its arguments as unused."""
    text = "\n".join(lines)
    unused = [f"(void){argument};" for argument in names if f"{argument} + " not in text]
    return definition(f"static void {name}({arguments})", [*unused, *lines])
