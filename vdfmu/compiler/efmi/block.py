"""A unit as a block of eFMI: its variables, and what its methods call.

What is fixed in a run is constant here: parameters that cannot be tuned, parameters of the robot, and choices; only the
chosen method is written. What a sampled state was before the sample is a state of its own, as in ``previous(x)``
of Modelica. A unit that reads the time counts its steps.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import casadi as ca

from vdfmu.base.errors import UsageError
from vdfmu.compiler.c.functions import lookup_table
from vdfmu.compiler.scalar.symbol import LOOKUP
from vdfmu.compiler.unit.interface import Interface, general_description
from vdfmu.compiler.unit.trace import Call, argument_name
from vdfmu.compiler.unit.variable import Variable

PERIOD, FIRST, STEPS = "period", "firstStep", "steps"
"""Variables of a block that its unit may not declare, except for the period of a sampled unit."""
_OURS = {PERIOD, FIRST, STEPS, "errorSignals", "self"}
_WORDS = set(
    # words of GALEC, and its functions
    "block protected public end record function method signals algorithm input output parameter constant Boolean "
    "Integer Real limit if signal in then elseif else for loop and or not size self while do until break return "
    "enumeration min max sign absolute integer real fractional ln lg pi euler nan interpolation1D interpolation2D "
    "interpolation3D".split()
)


@dataclass(frozen=True)
class BlockVariable:
    """A variable of a block.

    Attributes
    ----------
    name : str
        Of a state that is what another variable was before, that variable's.
    causality : "input", "output", "tunableParameter", "constant" or "state"
    start : tuple of float
        Start values, one for all of an array or one each.
    size : int
        Length of an array, in which a matrix lies row by row; 0 of a scalar.
    unit : str or None
    description : str
    type : "Real", "Integer" or "Boolean"
    minimum, maximum : float or None
    """

    name: str
    causality: str
    start: tuple[float, ...]
    size: int = 0
    unit: str | None = None
    description: str = ""
    type: str = "Real"
    minimum: float | None = None
    maximum: float | None = None
    before: bool = False
    """Whether it is what the variable of the name was before the sample."""


class SampledBlock:
    """A block.

    Parameters
    ----------
    interface : Interface
        Its start values are the start values of tunable parameters, and the values of all others.
    step : float
        Time from one step to the next [s] of a memoryless unit; a sampled one has its period.

    Attributes
    ----------
    start, update, outputs : tuple of Call
        What the first step begins with, and what each step does.
    has_time : bool
        Whether a step reads the time: k periods in step k, from 0.
    variables : tuple of BlockVariable
    """

    def __init__(self, interface: Interface, step: float) -> None:
        self.interface, program = interface, interface.program
        self.start, self.update, self.outputs = map(self._chosen, (program.start, program.update, program.outputs))
        self.has_time = any("t" in call.reads for call in (*self.start, *self.update, *self.outputs))
        self.is_sampled = bool(program.update)
        self.period = float(interface.find(PERIOD).start) if self.is_sampled else step
        self.variables = tuple(self._variables())
        if len({(v.name, v.before) for v in self.variables}) < len(self.variables):
            raise UsageError(f"{interface.name}: a block of eFMI has variables {', '.join(_OURS)} of its own. Rename.")

    @property
    def name(self) -> str:
        """Name of the block, which is the model's."""
        return self.interface.model_name

    @property
    def description(self) -> str:
        """What the unit is, for which robot, and what was chosen."""
        robot = self.interface.robot
        chosen = [f"{v.name} = {v.choices[int(v.start)]}" for v in self.interface if v.choices]
        about = [robot.name] if robot is not None else []
        return self.interface.description + (f" ({', '.join(about + chosen)})" if about + chosen else "")

    def named(self, group: str) -> str:
        """Name of a group of variables, or an argument of traced functions, in the block."""
        ours = group in _OURS and not (group == PERIOD and self.is_sampled)
        return f"own_{group}" if ours or group in _WORDS else group

    def _chosen(self, calls: Sequence[Call]) -> tuple[Call, ...]:
        fixed = {v.name: float(v.start) for v in self.interface if v.causality == "parameter" and not v.index}
        return tuple(call for call in calls if all(fixed[name] == value for name, value in call.when))

    def _variables(self) -> list[BlockVariable]:
        interface = self.interface
        read = {name for call in (*self.start, *self.update, *self.outputs) for name in call.reads}
        places = {argument_name(group): where for group, where in interface.groups.items()}
        found: dict[str, list[BlockVariable]] = {k: [] for k in ("input", "output", "tunable", "fixed", "state")}
        for name, where in places.items():
            members = interface.variables[where]
            first = members[0]
            if name == PERIOD and self.is_sampled:
                continue
            if first.causality != "parameter":
                found[first.causality].append(self._variable(name, members, first.causality))
                if first.variability == "discrete":
                    found["state"].append(self._variable(name, members, "state", before=True))
            elif first.variability == "tunable":
                found["tunable"].append(self._variable(name, members, "tunableParameter"))
            elif name in read:
                found["fixed"].append(self._variable(name, members, "constant"))
        if "p" in read:
            members = interface.variables[interface.arguments["p"]]
            text = f"Parameters of the robot, in the order of its FMU: {members[0].name} .. {members[-1].name}"
            start = tuple(float(v.start) for v in members)
            found["fixed"].append(BlockVariable("p", "constant", start, len(members), description=text))
        for table in self._tables():
            for what, numbers in zip(("edges", "rows"), lookup_table(table), strict=True):
                text = f"Table, {what}"
                name = f"{table.name()}_{what}"
                found["fixed"].append(BlockVariable(name, "constant", tuple(numbers), len(numbers), description=text))
        text = "Time from one step to the next"
        found["fixed"].append(BlockVariable(PERIOD, "constant", (self.period,), unit="s", description=text))
        if self.start:
            text = "Whether the next step is the first"
            found["state"].append(BlockVariable(FIRST, "state", (1,), description=text, type="Boolean"))
        if self.has_time:
            found["state"].append(BlockVariable(STEPS, "state", (0,), description="Steps done", type="Integer"))
        return [v for variables in found.values() for v in variables]

    def _tables(self) -> list[ca.Function]:
        """Return the tables in which the traced functions look rows up."""
        calls = (*self.start, *self.update, *self.outputs)
        functions = (self.interface.functions.casadi_function(call.function) for call in calls)
        named = {one.name(): one for function in functions for one in function.find_functions(0)}
        return [one for name, one in named.items() if name.startswith(LOOKUP)]

    def _variable(self, name: str, members: Sequence[Variable], causality: str, before: bool = False) -> BlockVariable:
        first = members[0]
        units = {v.unit for v in members}
        start = tuple(0.0 if v.start is None or first.causality == "output" else float(v.start) for v in members)
        shape = [1 + max(v.index[axis] for v in members) for axis in range(len(first.index))]
        text = general_description(first.description) if first.index else first.description
        text += f", {shape[0]} rows one after the other" if len(shape) > 1 else ""
        return BlockVariable(
            self.named(name), causality, start, len(members) if first.index else 0,
            units.pop() if len(units) == 1 else None, text + " before the sample" * before,
            minimum=first.minimum, maximum=first.maximum, before=before,
        )  # fmt: skip

    @cached_property
    def sizes(self) -> dict[str, int]:
        """Name to length; 0 of a scalar."""
        return {v.name: v.size for v in self.variables}

    def of(self, *causalities: str) -> list[BlockVariable]:
        """Variables of some causalities."""
        return [v for v in self.variables if v.causality in causalities]

    @property
    def tunable(self) -> list[tuple[BlockVariable, list[tuple[str, float]]]]:
        """Tunable parameters with their bounds: the relation that breaks each, and its number."""
        return [
            (v, [(sign, bound) for sign, bound in (("<", v.minimum), (">", v.maximum)) if bound is not None])
            for v in self.of("tunableParameter")
        ]

    def is_before(self, call: Call, name: str) -> bool:
        """Whether a call means by a name what a sampled state was, or begins as: updates read it, a start sets it."""
        return call not in self.outputs and any(v.before and v.name == self.named(name) for v in self.variables)
