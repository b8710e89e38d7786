"""The program of a system: the calculations of a communication step in their order, for C and WebAssembly."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import NamedTuple

import casadi as ca
import numpy as np

from vdfmu.base.arrays import Floats
from vdfmu.base.errors import UsageError
from vdfmu.compiler.unit.evaluate import Call, Traced, traced_margins, traced_requirements
from vdfmu.compiler.unit.interface import Interface
from vdfmu.engine.algorithms import ALGORITHMS, choice
from vdfmu.engine.plan.grid import Grid, count_steps
from vdfmu.system.package.description import SystemDescription
from vdfmu.system.reference.solution import SampledReference
from vdfmu.system.reference.wired import Action, Evaluate, WiredUnits


class MovingUnit(NamedTuple):
    """A unit with states. Places are in the memory of the system."""

    name: str
    unit: Traced
    begin: int
    """Place of its first number."""
    step: ca.Function | None
    """Step of its solver, of a unit with continuous states."""
    left: ca.Function | None
    """Time until it switches by time, if it does."""
    update: tuple[Call, ...]
    """Calls that set its sampled states."""

    def numbers(self) -> dict[str, int]:
        """Return the numbers of ``LaneUnit`` in ``fmu_src/batch/advance.h``."""
        table, begin = self.unit.interface, self.begin
        period = begin + table.groups["period"].start if self.update else 0
        fixed = int(self.unit.group("solver")[0]) if self.step is not None else 0
        sampled, states = table.sampled, table.states
        return {
            "time": begin + table.time, "x": begin + states.start, "n_x": states.stop - states.start,
            "period": period, "sampled": begin + sampled.start, "n_sampled": sampled.stop - sampled.start,
            "fixed": fixed,
        }  # fmt: skip

    def place(self, argument: str) -> int | None:
        """Place of an argument of `step` or `left`; None for rates of inputs and the internal step."""
        table = self.unit.interface
        if argument.startswith("rate_") or argument == "h":
            return None
        where = table.reference["tolerance"] if argument == "tolerance" else table.arguments[argument].start
        return self.begin + where


class ParameterCondition(NamedTuple):
    """Conditions on several parameters of a unit. Each holds if its margin is at least 0."""

    function: ca.Function
    places: tuple[int, ...]
    """Of its arguments."""
    words: tuple[str, ...]


class SystemProgram:
    """The communication steps of a system of traced units.

    Parameters
    ----------
    description : SystemDescription
    varied : iterable of str
        Parameters, ``component.variable``, that differ from run to run.

    Attributes
    ----------
    system : WiredUnits
        Its memory has the values before the start.
    lists : dict of str to list of actions
        ``begin``, ``part_0``, then after the i-th of `moving` ``part_<i+1>``.
    moving : list of MovingUnit
        In the order of a step.
    conditions : list of ParameterCondition
    grid : Grid

    Raises
    ------
    UsageError
        With all reasons why there is none.
    """

    def __init__(self, description: SystemDescription, varied: Iterable[str] = ()) -> None:
        scenario, problems = description.scenario, list(_problems(description))
        if problems:
            raise UsageError("\n".join(problems))
        self.system = system = WiredUnits(description)
        problems = [problem for name in system.units for problem in self._unit_problems(name, set(varied))]
        if problems:
            raise UsageError("\n".join(problems))
        solution = SampledReference(system, not ALGORITHMS[scenario.master].ordered)
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
        """Yield why a unit has no program, and its choices among `varied`."""
        unit = self.system.units[name]
        if not isinstance(unit, Traced):
            yield f"{name}: a unit in plain Python"
            return
        if unit.interface.unit.exchange:
            yield f"{name}: is integrated together with others"
        program = unit.interface.program
        groups = {choice for call in (*program.calls, *program.step) for choice, _ in call.when} | {"solver"}
        for v in unit.interface.variables:
            if v.group in groups and f"{name}.{v.name}" in varied:
                yield f"{name}.{v.name}: decides what is compiled, and can have one value in a study only"

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
            own, function = traced_requirements(table)
            found = [(own, function)] if function is not None else []
            if robot is not None:
                listed = [each for each in robot.requirements() if each.margin is not None]
                found += [(listed, each) for each in traced_margins(robot)]
            for listed, made in found:
                places = tuple(begin + table.arguments[group].start for group in made.name_in())
                words = (f"{name}: {each.parameters[0].name}: expected {each.expected}." for each in listed)
                yield ParameterCondition(made, places, tuple(words))
            if table.is_sampled and not self.system.linked.isdisjoint(range(begin, begin + table.size)):
                words = (f"{name}: period: expected a whole multiple of the communication step, {step:g} s.",)
                yield ParameterCondition(_whole_multiple(step), (begin + table.groups["period"].start,), words)

    def limits(self) -> dict[str, tuple[int, float, float]]:
        """Variables that a run may set, ``component.variable``: place, least and largest value."""
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
        """Place and unit of each signal; of each unit outputs come before inputs, as a master records them."""
        system, fed = self.system, self.system.linked | {place for place, _ in self.system.outside}
        return {
            f"{name}.{v.name}": (system.begin(name) + i, v.unit or "")
            for name, unit in system.units.items()
            for kind in ("output", "input")
            for i, v in enumerate(unit.interface.variables)
            if v.causality == kind and (kind == "output" or system.begin(name) + i in fed)
        }

    def courses(self) -> Floats:
        """Values of the inputs from outside in the steps, (n, k)."""
        courses = [course for _, course in self.system.outside]
        points = self.grid.times(0, self.grid.n).tolist()
        values = [[course.at(t)[0] for course in courses] for t in points] if courses else []
        return np.array(values, dtype=np.float64).reshape(len(points), len(courses))


def _whole_multiple(step: float) -> ca.Function:
    """Return the function of a period to its margin: from 0 on it is a whole multiple of a step, as the masters ask."""
    period = ca.SX.sym("period")
    ratio = period / step
    margin = 1e-9 * ratio - ca.fabs(ratio - ca.fmax(1.0, ca.floor(ratio + 0.5)))
    return ca.Function("whole_multiple", [period], [margin], ["period"], ["margin"])


def _problems(description: SystemDescription) -> Iterator[str]:
    """Yield why a system has no program, as far as its description tells."""
    scenario = description.scenario
    if ALGORITHMS[scenario.master].substeps != 1:
        yield f"master: expected {choice(substeps=1)}, got {scenario.master}"
    if scenario.adaptive is not None:
        yield "adaptive: its steps are as long as given"
    foreign = [name for name, table in description.tables.items() if not isinstance(table, Interface)]
    if foreign:
        yield f"{', '.join(foreign)}: an FMU of another tool"
