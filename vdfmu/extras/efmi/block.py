"""A unit as an eFMI block: its variables, and the calls of its methods.

Parameters that are fixed in a run, parameters of the robot, and choices are constants here, and only the chosen methods
are written. The value of a sampled state before the sample is a separate state, like ``previous(x)`` in Modelica. A
unit that reads the time counts its steps.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import casadi as ca

from vdfmu.base.errors import UsageError
from vdfmu.compiler.functions.derivatives import lookup_table
from vdfmu.compiler.scalar.symbol import LOOKUP
from vdfmu.compiler.unit.interface import Interface, general_description
from vdfmu.compiler.unit.trace import Call, argument_name
from vdfmu.compiler.unit.variable import Variable

PERIOD, FIRST, STEPS = "period", "firstStep", "steps"
"""Names of a block's own variables, which its unit must not declare, except for the period of a sampled unit."""
_RESERVED = (PERIOD, FIRST, STEPS, "errorSignals", "self")
_WORDS = set(  # keywords and functions of GALEC
    "block protected public end record function method signals algorithm input output parameter constant Boolean "
    "Integer Real limit if signal in then elseif else for loop and or not size self while do until break return "
    "enumeration min max sign absolute integer real fractional ln lg pi euler nan interpolation1D interpolation2D "
    "interpolation3D".split()
)


@dataclass(frozen=True)
class BlockVariable:
    """A variable of a block."""

    name: str
    causality: str
    """"input", "output", "tunableParameter", "constant" or "state"."""
    start: tuple[float, ...]
    """Start values: one for a whole array, or one per element."""
    size: int = 0
    """Length of an array, in which matrices are row by row; 0 for a scalar."""
    unit: str | None = None
    description: str = ""
    type: str = "Real"
    """"Real", "Integer" or "Boolean"."""
    minimum: float | None = None
    maximum: float | None = None
    before: bool = False
    """Whether it is the value of the variable `name` before the sample."""


class SampledBlock:
    """A block.

    Parameters
    ----------
    interface : Interface
        Interface with start values of tunable parameters and values of all others.
    step : float
        Step [s] of a memoryless unit; a sampled unit uses its period.
    """

    def __init__(self, interface: Interface, step: float) -> None:
        self.interface, program = interface, interface.program
        self.start, self.update, self.outputs = map(self._chosen, (program.start, program.update, program.outputs))
        """Calls at the start of the first step, and calls of each step."""
        self.calls = (*self.start, *self.update, *self.outputs)
        self.has_time = any("t" in call.reads for call in self.calls)
        """Whether a step reads the time, which is k periods in step k, from 0."""
        self.is_sampled = bool(program.update)
        self.period = float(interface.find(PERIOD).start) if self.is_sampled else step
        self.name = interface.model_name
        self.variables = tuple(self._variables())
        if len({(v.name, v.before) for v in self.variables}) < len(self.variables):
            names = ", ".join(_RESERVED)
            raise UsageError(f"{interface.name}: eFMI blocks reserve the variables {names}. Rename them.")

    @property
    def description(self) -> str:
        """Description of the unit with its robot and its choices."""
        robot = self.interface.robot
        about = [robot.name] if robot is not None else []
        about += [f"{v.name} = {v.choices[int(v.start)]}" for v in self.interface if v.choices]
        return self.interface.description + (f" ({', '.join(about)})" if about else "")

    def named(self, group: str) -> str:
        """Name of a group of variables, or an argument of traced functions, in the block."""
        reserved = group in _RESERVED and not (group == PERIOD and self.is_sampled)
        return f"own_{group}" if reserved or group in _WORDS else group

    def _chosen(self, calls: Sequence[Call]) -> tuple[Call, ...]:
        fixed = {v.name: float(v.start) for v in self.interface if v.causality == "parameter" and not v.index}
        return tuple(call for call in calls if all(fixed[name] == value for name, value in call.when))

    def _variables(self) -> list[BlockVariable]:
        interface = self.interface
        read = {name for call in self.calls for name in call.reads}
        places = {argument_name(group): where for group, where in interface.groups.items()}
        kinds = ("input", "output", "tunableParameter", "constant", "state")
        variables: dict[str, list[BlockVariable]] = {kind: [] for kind in kinds}

        def add(v: BlockVariable) -> None:
            variables[v.causality].append(v)

        for name, where in places.items():
            members = interface.variables[where]
            first = members[0]
            if name == PERIOD and self.is_sampled:
                continue
            if first.causality != "parameter":
                add(self._variable(name, members, first.causality))
                if first.variability == "discrete":
                    add(self._variable(name, members, "state", before=True))
            elif first.variability == "tunable":
                add(self._variable(name, members, "tunableParameter"))
            elif name in read:
                add(self._variable(name, members, "constant"))
        if "p" in read:
            members = interface.variables[interface.arguments["p"]]
            text = f"Parameters of the robot, in the order of its FMU: {members[0].name} .. {members[-1].name}"
            add(BlockVariable("p", "constant", tuple(float(v.start) for v in members), len(members), description=text))
        for table in self._tables():
            for part, numbers in zip(("edges", "rows"), lookup_table(table), strict=True):
                name = f"{table.name()}_{part}"
                add(BlockVariable(name, "constant", tuple(numbers), len(numbers), description=f"Table, {part}"))
        text = "Time from one step to the next"
        add(BlockVariable(PERIOD, "constant", (self.period,), unit="s", description=text))
        if self.start:
            text = "Whether the next step is the first"
            add(BlockVariable(FIRST, "state", (1,), description=text, type="Boolean"))
        if self.has_time:
            add(BlockVariable(STEPS, "state", (0,), description="Steps done", type="Integer"))
        return [v for listed in variables.values() for v in listed]

    def _tables(self) -> list[ca.Function]:
        """Return the tables of the traced functions."""
        functions = (self.interface.functions.casadi_function(call.function) for call in self.calls)
        tables = {table.name(): table for function in functions for table in function.find_functions(0)}
        return [table for name, table in tables.items() if name.startswith(LOOKUP)]

    def _variable(self, name: str, members: Sequence[Variable], causality: str, before: bool = False) -> BlockVariable:
        first = members[0]
        units = {v.unit for v in members}
        start = tuple(0.0 if v.start is None or first.causality == "output" else float(v.start) for v in members)
        shape = [1 + max(v.index[axis] for v in members) for axis in range(len(first.index))]
        text = general_description(first.description) if first.index else first.description
        text += f", {shape[0]} rows one after the other" if len(shape) > 1 else ""
        return BlockVariable(
            self.named(name),
            causality,
            start,
            len(members) if first.index else 0,
            units.pop() if len(units) == 1 else None,
            text + " before the sample" * before,
            minimum=first.minimum,
            maximum=first.maximum,
            before=before,
        )

    @cached_property
    def sizes(self) -> dict[str, int]:
        """Name to length, 0 for a scalar."""
        return {v.name: v.size for v in self.variables}

    def of(self, *causalities: str) -> list[BlockVariable]:
        """Variables of some causalities."""
        return [v for v in self.variables if v.causality in causalities]

    @property
    def tunable(self) -> list[tuple[BlockVariable, list[tuple[str, float]]]]:
        """Tunable parameters with their limits, each as a comparison that is true if exceeded, and its number."""
        return [
            (v, [(sign, bound) for sign, bound in (("<", v.minimum), (">", v.maximum)) if bound is not None])
            for v in self.of("tunableParameter")
        ]

    def is_before(self, call: Call, name: str) -> bool:
        """Return whether a name in a call means the state before the sample, which updates read and the start sets."""
        return call not in self.outputs and any(v.before and v.name == self.named(name) for v in self.variables)
