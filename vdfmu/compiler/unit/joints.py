"""Traces a unit for a long arm by running its methods on arms of one joint.

Joints with the same trace share its functions; see :mod:`vdfmu.compiler.functions.chain`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import groupby
from typing import Any

import casadi as ca

from vdfmu.compiler.functions.chain import ChainError, PartChain, PartTrace, Place, chain_of
from vdfmu.compiler.functions.chain_calls import chain_function
from vdfmu.compiler.functions.chain_stages import ChainStages
from vdfmu.compiler.scalar.passes import recording
from vdfmu.compiler.scalar.symbol import to_sx
from vdfmu.compiler.unit.base import BaseUnit
from vdfmu.compiler.unit.declaration import JOINTS, PHASES, Declared, Derivative, Machine
from vdfmu.compiler.unit.implicit import elimination_order, solver_step
from vdfmu.compiler.unit.trace import Fixed, Symbols, argument_name, run, state_slices


def is_long(unit: type[BaseUnit], robot: Machine | None) -> bool:
    """Return whether each joint of an arm calls its own functions, because there are many joints.

    Only methods of this package are known to exchange values between joints exclusively through passes.
    """
    if robot is None or unit.chain is None or robot.n < unit.chain:
        return False
    package = f"{__name__.partition('.')[0]}."
    return all(getattr(unit, phase).__module__.startswith(package) for phase in (*PHASES, "balance"))


def chain_trace(unit: type[BaseUnit], robot: Machine, name: str, phase: str, fixed: Fixed) -> PartChain:
    """Return the trace of a method for a long arm. ChainError if that cannot be built from its joints."""
    arm = _Arm(unit(robot), phase, fixed)
    kind_of: dict[str, int] = {}
    texts: dict[str, int] = {}
    kinds: list[int] = []
    records: list[tuple[Symbols, PartTrace]] = []
    for i in range(robot.n):
        part = robot.joint(i)
        if part.key() not in kind_of:
            record, trace = arm.traced(unit(part), i)
            text = _text(trace)
            if text not in texts:
                texts[text] = len(records)
                records.append((record, trace))
            kind_of[part.key()] = texts[text]
        kinds.append(kind_of[part.key()])
    places = [arm.places(records[kind][0], i) for i, kind in enumerate(kinds)]
    arguments: dict[str, int] = {}
    for record, _ in records:
        arguments |= {argument: arm.size(argument) for argument in record.symbols}
    outputs = arm.outputs(records[0][0])
    return chain_of(name, [trace for _, trace in records], kinds, places, arguments, outputs)


def chain_step(
    unit: type[BaseUnit], robot: Machine, name: str, derivatives: ca.Function, chain: PartChain
) -> ca.Function:
    """Return one step of the solver for a long arm; see :meth:`.implicit.ImplicitEquations.step`.

    `chain` is the balance of the arm.
    """
    instance = unit(robot)
    stages = ChainStages(chain, [state for state in state_slices(instance) if state], elimination_order(instance))
    balance = chain_function(chain)
    sizes = {each.name_in(k): each.numel_in(k) for each in (derivatives, balance) for k in range(each.n_in())}
    del sizes["x_dot"]
    inputs = [argument_name(d.name) for d in instance.declared.values() if d.causality == "input"]
    moving = [key for key in sizes if key in inputs]
    now = {key: ca.MX.sym(key, size) for key, size in sizes.items()}
    rates = {key: ca.MX.sym(f"rate_{key}", sizes[key]) for key in moving}
    h = ca.MX.sym("h")
    x_dot = derivatives(*(now[key] for key in derivatives.name_in()))
    along = rates | ({"t": ca.MX(1.0)} if "t" in sizes else {})
    arguments = now | {f"rate_{key}": rate for key, rate in rates.items()} | {"h": h}
    made = {"factors": stages.start(now, x_dot, h, along), "x_dot": x_dot}
    start = ca.Function(f"{name}_start", list(arguments.values()), list(made.values()), list(arguments), list(made))
    solved = stages.stages(name)
    y, rate = ca.MX.sym("x_dot_new", len(solved.carried)), ca.MX.zeros(sizes["x"])
    rate[solved.carried] = y
    read = {"x_dot_new": y} | {key: now[key] for key in now if key in balance.name_in()}
    value = balance(*({**now, "x_dot": rate}[key] for key in balance.name_in())) + solved.explicit * rate
    residual = ca.Function(f"{name}_balance", list(read.values()), [value], list(read), ["value"])
    return solver_step(name, sizes, moving, start, residual, solved)


def _text(trace: PartTrace) -> str:
    """Return a text that is the same for parts that calculate the same."""
    passes = [column for each in trace.passes for column in (each.before, each.last)]
    inputs = {**trace.inputs, **{f"pass_{k}": column for k, column in enumerate(passes)}}
    results = [*trace.results.values(), *trace.shared.values()]
    results += [column for each in trace.passes for column in (each.first, each.after)]
    made = ca.Function(
        "part",
        list(inputs.values()),
        ca.cse(list(map(ca.vec, results))),
        list(inputs),
        [f"made_{k}" for k in range(len(results))],
    )
    return made.serialize()


class _Arm:
    """A method of a unit for a whole arm."""

    def __init__(self, unit: BaseUnit, phase: str, fixed: Fixed) -> None:
        self._unit, self._phase, self._fixed = unit, phase, fixed
        self._states = state_slices(unit)
        robot: Any = unit.of_robot
        self._entries = {(entry.field, entry.index): k for k, entry in enumerate(robot.entries())}

    def traced(self, unit: BaseUnit, joint: int) -> tuple[Symbols, PartTrace]:
        """Trace the method for one joint."""
        record = Symbols(unit, self._phase, self._fixed)
        with recording() as passes:
            returned = run(unit, self._phase, record)
        results: dict[str, ca.SX] = {}
        shared: dict[str, ca.SX] = {}
        for group, name, column, of_joint in self._made(record, returned):
            (results if of_joint else shared)[group if of_joint else name] = column
        inputs = {group: symbols for group, symbols, _ in self._groups(record, joint)}
        return record, PartTrace(inputs, results, shared, passes)

    def _made(self, record: Symbols, returned: Any) -> Iterator[tuple[str, str, ca.SX, bool]]:
        """Yield the group, name and column of each result, and whether each joint has its own."""
        if self._phase == "balance":
            rows = to_sx(returned)
            for state, where in state_slices(record.unit).items():
                if state:
                    yield f"made_{state}", "residual", rows[where], True
        for name, value in record.sets.items():
            declared = record.unit.declared[name]
            if isinstance(declared, Derivative):
                declared, whole = declared.state, "x_dot"
            else:
                whole = "x" if name in self._states else argument_name(name)
            yield f"made_{declared.name}", whole, to_sx(value), _of_joints(declared)

    def outputs(self, record: Symbols) -> dict[str, int]:
        """Return the sizes of the results, as in :meth:`Symbols.expressions`."""
        if self._phase == "balance":
            return {"residual": self._states[""].stop}
        names = [name for _, name, *_ in self._made(record, None)]
        return {name: self.size(name) for name in sorted(dict.fromkeys(names), key=("x", "x_dot").__contains__)}

    def size(self, name: str) -> int:
        """Return the size of an argument or a result."""
        if name == "p":
            return len(self._entries)
        if name in ("x", "x_dot"):
            return self._states[""].stop
        declared = self._declared(name)
        if declared is not None:
            return math.prod(declared.sizes(self._unit.n))
        return 1 if name == "t" else self._unit.n

    def places(self, record: Symbols, joint: int) -> dict[str, Place]:
        """Return the places of the groups of a joint."""
        places = {group: place for group, _, place in self._groups(record, joint)}
        for state, where in self._states.items():
            if self._phase == "balance" and state:
                places[f"made_{state}"] = Place("residual", where.start + joint)
        for group, name, column, of_joint in self._made(record, None) if self._phase != "balance" else ():
            if of_joint:
                begin = self._states[group.removeprefix("made_")].start if name in ("x", "x_dot") else 0
                places[group] = Place(name, begin + joint * column.numel())
        return places

    def _groups(self, record: Symbols, joint: int) -> Iterator[tuple[str, ca.SX, Place]]:
        """Yield each group of inputs of a joint: its name, its symbols, and its place in those of the arm."""
        for name, column in record.symbols.items():
            if name == "p":
                yield from self._parameters(record, column, joint)
            elif name in ("x", "x_dot"):
                for state, where in state_slices(record.unit).items():
                    if state:
                        declared = record.unit.declared[state]
                        at = joint * (where.stop - where.start) if _of_joints(declared) else 0
                        yield f"{name}_{state}", column[where], Place(name, self._states[state].start + at)
            else:
                declared = self._declared(name)
                of_joint = _of_joints(declared) if declared is not None else name != "t"
                yield name, column, Place(name, joint * column.numel() if of_joint else 0)

    def _parameters(self, record: Symbols, column: ca.SX, joint: int) -> Iterator[tuple[str, ca.SX, Place]]:
        robot = record.unit.of_robot
        begin = 0
        for field, entries in groupby(robot.entries(), key=lambda entry: entry.field):
            listed = list(entries)
            index = listed[0].index
            index = (joint, *index[1:]) if robot.rows[field].per_joint else index
            end = begin + len(listed)
            yield f"p_{field}", column[begin:end], Place("p", self._entries[field, index])
            begin = end

    def _declared(self, name: str) -> Declared | None:
        return next((d for d in self._unit.declared.values() if argument_name(d.name) == name), None)


def _of_joints(declared: Declared) -> bool:
    if JOINTS in declared.shape[1:]:
        raise ChainError(f"{declared.name} has the dimension joints twice")
    return JOINTS in declared.shape[:1]
