"""The program of a system: the ordered calculations of a communication step, for C and WebAssembly."""

from __future__ import annotations

import struct
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from vdfmu.base.arrays import Floats
from vdfmu.base.errors import UsageError
from vdfmu.base.page import compressed
from vdfmu.compiler import wasm
from vdfmu.compiler.unit.evaluate import Call, Traced, traced_margins, traced_requirements
from vdfmu.compiler.unit.interface import Interface
from vdfmu.engine.algorithms import ALGORITHMS, choice
from vdfmu.engine.plan.grid import Grid, count_steps
from vdfmu.system.package.description import SystemDescription
from vdfmu.system.reference.solution import SampledReference
from vdfmu.system.reference.wired import Action, Carry, Evaluate, TimeSetter, WiredUnits


class MovingUnit(NamedTuple):
    """A unit with states. Places refer to the memory of the system."""

    name: str
    unit: Traced
    begin: int
    """Place of the unit's first number."""
    step: ca.Function | None
    """Step of the unit's solver, if it has continuous states."""
    left: ca.Function | None
    """Function that returns the time until the unit's next switching by time, if any."""
    update: tuple[Call, ...]
    """Calls that set the unit's sampled states."""

    def numbers(self) -> dict[str, int]:
        """Return the numbers of ``LaneUnit`` in ``fmu_src/batch/advance.h``."""
        table, begin = self.unit.interface, self.begin
        period = begin + table.groups["period"].start if self.update else 0
        fixed = int(self.unit.group("solver")[0]) if self.step is not None else 0
        sampled, states = table.sampled, table.states
        return {
            "time": begin + table.time,
            "x": begin + states.start,
            "n_x": states.stop - states.start,
            "period": period,
            "sampled": begin + sampled.start,
            "n_sampled": sampled.stop - sampled.start,
            "fixed": fixed,
        }

    def place(self, argument: str) -> int | None:
        """Return the place of an argument of `step` or `left`; None for rates of inputs and the internal step."""
        table = self.unit.interface
        if argument.startswith("rate_") or argument == "h":
            return None
        where = table.reference["tolerance"] if argument == "tolerance" else table.arguments[argument].start
        return self.begin + where


class ParameterCondition(NamedTuple):
    """Conditions on several parameters of a unit, each of which holds if its margin is at least 0."""

    function: ca.Function
    places: tuple[int, ...]
    """Places of the arguments."""
    words: tuple[str, ...]


class SystemProgram:
    """The communication steps of a system of traced units. UsageError with all reasons if impossible.

    `varied` are the parameters, ``component.variable``, that differ from run to run. The memory of `system` has the
    values before the start. `lists` are the actions of ``begin``, of ``part_0``, and of ``part_<i+1>`` after the i-th
    of `moving`, which is in the order of a step.
    """

    def __init__(self, description: SystemDescription, varied: Iterable[str] = ()) -> None:
        scenario, problems = description.scenario, list(_problems(description))
        if problems:
            raise UsageError("\n".join(problems))
        self.system = system = WiredUnits(description)
        problems = [problem for name in system.units for problem in self._unit_problems(name, set(varied))]
        if problems:
            raise UsageError("\n".join(problems))
        solution = SampledReference(system, not ALGORITHMS[scenario.algorithm].ordered)
        start: list[Action] = [
            action
            for name, carry in system.starting
            for action in (Evaluate(name, "start"), Evaluate(name, "outputs"), carry)
        ]
        parts = (f"part_{i}" for i in range(len(solution.moving) + 1))
        self.lists = {"begin": start} | {name: solution.lists[name] for name in parts}
        self.moving = [self._moving(name) for name in solution.moving]
        self.conditions = list(self._conditions(scenario.step))
        self.grid = Grid(0.0, scenario.stop, scenario.step, count_steps(scenario.step, scenario.stop))

    def unit(self, name: str) -> Traced:
        """Return a unit."""
        unit = self.system.units[name]
        assert isinstance(unit, Traced)
        return unit

    def _unit_problems(self, name: str, varied: set[str]) -> Iterator[str]:
        """Yield reasons why a unit cannot be in a program, and reasons against its choices in `varied`."""
        unit = self.system.units[name]
        if not isinstance(unit, Traced):
            yield f"{name}: a unit in plain Python"
            return
        if unit.interface.unit.exchange:
            yield f"{name}: is integrated together with others"
        if unit.at_events:
            yield f"{name}: has events, at which internal steps end"
        program = unit.interface.program
        groups = {choice for call in (*program.calls, *program.step) for choice, _ in call.when} | {"solver"}
        for v in unit.interface.variables:
            if v.group in groups and f"{name}.{v.name}" in varied:
                yield f"{name}.{v.name}: determines what is compiled, so it can have only one value in a study"

    def _moving(self, name: str) -> MovingUnit:
        unit = self.unit(name)
        program, functions = unit.interface.program, unit.interface.functions
        step, left = (
            next((functions.casadi_function(call.function) for call in calls if unit.takes(call)), None)
            for calls in (program.step, program.left)
        )
        update = tuple(call for call in program.update if unit.takes(call))
        return MovingUnit(name, unit, self.system.begin(name), step, left, update)

    def _conditions(self, step: float) -> Iterator[ParameterCondition]:
        for name in self.system.units:
            table, begin = self.unit(name).interface, self.system.begin(name)
            robot = table.robot if table.has_robot else None
            requirements, function = traced_requirements(table)
            conditions = [(requirements, function)] if function is not None else []
            if robot is not None:
                listed = [each for each in robot.requirements() if each.margin is not None]
                conditions += [(listed, each) for each in traced_margins(robot)]
            for listed, made in conditions:
                places = tuple(begin + table.arguments[group].start for group in made.name_in())
                words = (f"{name}: {each.parameters[0].name}: expected {each.expected}." for each in listed)
                yield ParameterCondition(made, places, tuple(words))
            if table.is_sampled and not self.system.linked.isdisjoint(range(begin, begin + table.size)):
                words = (f"{name}: period: expected a whole multiple of the communication step, {step:g} s.",)
                yield ParameterCondition(_whole_multiple(step), (begin + table.groups["period"].start,), words)

    def limits(self) -> dict[str, tuple[int, float, float]]:
        """Return the variables that a run may set: ``component.variable`` to place, minimum and maximum."""
        return {
            f"{name}.{v.name}": (
                self.system.begin(name) + i,
                -np.inf if v.minimum is None else v.minimum,
                np.inf if v.maximum is None else v.maximum,
            )
            for name, unit in self.system.units.items()
            for i, v in enumerate(unit.interface.variables)
            if v.causality in ("parameter", "input")
        }

    def signals(self) -> dict[str, tuple[int, str]]:
        """Return signal to place and unit. A unit's outputs precede its inputs, as in a master's records."""
        system, fed = self.system, self.system.linked | {place for place, _ in self.system.outside}
        return {
            f"{name}.{v.name}": (system.begin(name) + i, v.unit or "")
            for name, unit in system.units.items()
            for kind in ("output", "input")
            for i, v in enumerate(unit.interface.variables)
            if v.causality == kind and (kind == "output" or system.begin(name) + i in fed)
        }

    def courses(self) -> Floats:
        """Return the inputs from external signals at the steps, (n, k)."""
        courses = [course for _, course in self.system.outside]
        points = self.grid.times(0, self.grid.n).tolist()
        values = [[course.at(t)[0] for course in courses] for t in points] if courses else []
        return np.array(values, dtype=np.float64).reshape(len(points), len(courses))


def _whole_multiple(step: float) -> ca.Function:
    """Return a function of a period that is at least 0 for a whole multiple of the step, as the masters require."""
    period = ca.SX.sym("period")
    ratio = period / step
    margin = 1e-9 * ratio - ca.fabs(ratio - ca.fmax(1.0, ca.floor(ratio + 0.5)))
    return ca.Function("whole_multiple", [period], [margin], ["period"], ["margin"])


def _problems(description: SystemDescription) -> Iterator[str]:
    """Yield the reasons against a program that are known from the description."""
    scenario = description.scenario
    if ALGORITHMS[scenario.algorithm].substeps != 1:
        yield f"algorithm: expected {choice(substeps=1)}, got {scenario.algorithm}"
    if scenario.adaptive is not None:
        yield "adaptive: a program makes steps of the given length"
    foreign = [name for name, table in description.tables.items() if not isinstance(table, Interface)]
    if foreign:
        yield f"{', '.join(foreign)}: an FMU of another tool"


def write_module(program: SystemProgram) -> tuple[bytes, int, tuple[int, int]]:
    """Return a module of WebAssembly, the address of the system's memory, and :attr:`Assembler.growth`.

    It exports ``begin()`` and ``step(t, size)``. They return 0, or the number (from 1) of a violated condition, or of a
    unit in `SystemProgram.moving` whose solver fails. KernelError for an operation that is not supported.
    """
    writer = _ModuleWriter(program)
    exported = {"begin": writer.begin(), "step": writer.step()}
    return writer.assembler.module(exported), writer.at, writer.assembler.growth


def page_program(program: SystemProgram, read: Collection[str] = ()) -> dict[str, Any]:
    """Return the data of a program for ``web/master.js``, for JSON; the outputs and the inputs in `read` are recorded.

    UsageError for inputs from external signals.
    """
    if program.system.outside:
        raise UsageError("some of its inputs come from files")
    module, address, growth = write_module(program)
    parameters: dict[str, dict[str, list[Any]]] = {}
    outputs: dict[str, int] = {}
    for name, unit in program.system.units.items():
        begin, entries = program.system.begin(name), parameters.setdefault(name, {})
        for i, v in enumerate(unit.interface.variables):
            if v.type == "Real" and v.causality == "parameter":
                entries[v.name] = [begin + i, unit.memory[i].item(), v.minimum, v.maximum]
            elif v.type == "Real" and (v.causality == "output" or f"{name}.{v.group}" in read):
                outputs[f"{name}.{v.name}"] = begin + i
    return {
        "module": compressed(module),
        "growth": growth,
        "address": address,
        "memory": program.system.memory.tolist(),
        "units": [{"name": name, "parameters": entries} for name, entries in parameters.items()],
        "names": [*outputs],
        "places": [*outputs.values()],
        "conditions": [words for condition in program.conditions for words in condition.words],
        "moving": [moving.name for moving in program.moving],
        "start": program.grid.begin,
        "stop": program.grid.end,
        "step": program.grid.step,
        "steps": program.grid.n,
        "last": program.grid.last,
    }


class _ModuleWriter:
    """Writes the functions of a system whose memory is at the address `at`."""

    def __init__(self, program: SystemProgram) -> None:
        self.program, self.assembler = program, wasm.Assembler()
        self.at = self.assembler.room(8 * program.system.memory.size)
        self._still = self.assembler.room(8 * max(unit.interface.size for unit in program.system.units.values()))
        """Rates of the inputs."""
        self._parts = {
            name: self.assembler.function(wasm.NUMBER, b"", (), self._actions(actions))
            for name, actions in program.lists.items()
        }

    def _address(self, place: int) -> int:
        return self.at + 8 * place

    def _actions(self, actions: Sequence[Action]) -> bytes:
        """Return the code of actions; the time is the first local."""
        code = bytearray()
        for action in actions:
            if isinstance(action, Carry):
                for start, end in zip(action.starts.tolist(), action.ends.tolist(), strict=True):
                    value = wasm.constant(0) + wasm.LOAD + wasm.unsigned(self._address(start))
                    code += wasm.constant(0) + value + wasm.STORE + wasm.unsigned(self._address(end))
            elif isinstance(action, TimeSetter):
                for place in action.places.tolist():
                    code += wasm.constant(0) + wasm.local(0) + wasm.STORE + wasm.unsigned(self._address(place))
            else:
                assert isinstance(action, Evaluate)
                unit = self.program.unit(action.unit)
                for called in getattr(unit.interface.program, action.method):
                    if unit.takes(called):
                        code += self._call(action.unit, called)
        return bytes(code)

    def _call(self, name: str, called: Call) -> bytes:
        """Return the code of a call, which copies results that are also arguments."""
        table, begin = self.program.unit(name).interface, self.program.system.begin(name)
        function = table.functions.casadi_function(called.function)
        where = {
            group: self._address(begin + table.arguments[called.group(group)].start)
            for group in (*function.name_in(), *function.name_out())
        }
        sizes = {group: 8 * function.numel_out(group) for group in function.name_out() if called.group(group) != group}
        new = {group: self.assembler.room(size) for group, size in sizes.items()}
        copies = (b"".join(wasm.constant(each[group]) for each in (where, new, sizes)) + wasm.COPY for group in new)
        return self._called(function, where | new) + b"".join(copies)

    def _called(self, function: ca.Function, where: Mapping[str, int]) -> bytes:
        arguments = (wasm.constant(where[name]) for name in (*function.name_in(), *function.name_out()))
        return b"".join(arguments) + wasm.call(self.assembler.traced(function))

    def begin(self) -> int:
        """Add the start: states, outputs, and the conditions on several parameters."""
        code, number_ = wasm.number(0.0) + wasm.call(self._parts["begin"]), 0
        for function, places, words in self.program.conditions:
            where = dict(zip(function.name_in(), map(self._address, places), strict=True))
            (result,), margins = function.name_out(), self.assembler.room(8 * len(words))
            code += self._called(function, where | {result: margins})
            for k in range(len(words)):
                number_ += 1
                met = wasm.constant(0) + wasm.LOAD + wasm.unsigned(margins + 8 * k) + wasm.number(0.0) + b"\x66"
                code += met + wasm.return_if_not(number_)
        return self.assembler.function(b"", wasm.INTEGER, (), code + wasm.constant(0))

    def step(self) -> int:
        """Add the communication step."""
        moved, end = wasm.call(self.assembler.functions["move_unit"]), wasm.local(0) + wasm.local(1) + b"\xa0"
        code = end + wasm.call(self._parts["part_0"])
        for i, moving in enumerate(self.program.moving):
            where = wasm.constant(self._unit(moving)) + wasm.constant(self.at) + wasm.constant(self.assembler.room(8))
            code += where + wasm.local(0) + wasm.local(1) + moved + wasm.return_if_not(i + 1)
            code += end + wasm.call(self._parts[f"part_{i + 1}"])
        return self.assembler.function(2 * wasm.NUMBER, wasm.INTEGER, (), code + wasm.constant(0))

    def _unit(self, moving: MovingUnit) -> int:
        """Return the address of the ``LaneUnit`` of a unit."""
        functions: list[int] = []
        for function, arguments in ((moving.step, 5), (moving.left, 2)):
            if function is None:
                functions.append(0)
                continue
            code = bytearray()
            for name in function.name_in():
                place = moving.place(name)
                address = self._still if place is None else self._address(place)
                code += wasm.local(1) if name == "h" else wasm.constant(address)
            first = arguments - function.n_out()
            code += b"".join(map(wasm.local, range(first, arguments))) + wasm.call(self.assembler.traced(function))
            written = self.assembler.function(arguments * wasm.INTEGER, b"", (), bytes(code))
            functions.append(self.assembler.slot(written))
        code = b"".join(self._call(moving.name, each) for each in moving.update)
        update = self.assembler.slot(self.assembler.function(wasm.INTEGER, b"", (), code)) if code else 0
        numbers = (*functions, update, *moving.numbers().values())
        return self.assembler.data(struct.pack(f"<{len(numbers)}i", *numbers))
