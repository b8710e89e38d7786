"""Checks the declaration of a unit and reports all faults at once, each with file and line."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from typing import Any, cast

import numpy as np

from vdfmu.base.errors import UnitError, UsageError
from vdfmu.base.measure import unit_of
from vdfmu.base.text import kind_text
from vdfmu.compiler.unit.base import ABOUT, BaseUnit
from vdfmu.compiler.unit.declaration import (
    AT,
    JOINTS,
    SOLVERS,
    Choice,
    Declared,
    Derivative,
    Event,
    Held,
    Machine,
    Mode,
    Parameter,
    RobotParameters,
    Sampled,
    State,
    Switch,
)
from vdfmu.compiler.unit.place import place

_WORDS = r"[A-Za-z](_?[A-Za-z0-9])*"
_LETTERS = "expected a letter, then letters, digits and single underscores"


def check_unit(unit: type[BaseUnit], robot: Machine | None) -> None:
    """Check the declaration of a unit for a robot; UnitError with all problems, one per line."""
    problems = [*_of_unit(unit), *(_of_machine(unit, robot) if robot is not None else ())]
    for declared in unit.declared_for(robot).values():
        problems += [(declared.name, text) for text in _of_variable(declared, robot)]
    if problems:
        raise UnitError("\n".join(f"{place(unit, name)}: {unit.__name__}: {text}." for name, text in problems))


def _of_unit(unit: type[BaseUnit]) -> Iterator[tuple[str, str]]:
    """Yield the variable or method, and the fault, of inconsistent variables."""
    if not re.fullmatch(_WORDS, unit.__name__):
        yield "", f"a unit cannot be named {unit.__name__}: {_LETTERS}"
    if not unit.declared and unit.robot_fields is None:
        yield "", "a unit needs variables: u = Input(..), y = Output(..)"
    states = [d for d in unit.declared.values() if type(d) is State]
    derived = [d.state for d in unit.declared.values() if isinstance(d, Derivative)]
    for name in (state.name for state in states if derived.count(state) != 1):
        yield name, f"{name} is a continuous state and needs one derivative: {name}_dot = Derivative({name})"
    for name, declared in unit.declared.items():
        if isinstance(declared, Derivative) and declared.state not in states:
            yield name, f"{name} must be the derivative of a continuous state of the unit"
    sampled = any(isinstance(d, Sampled) for d in unit.declared.values())
    for name, needed, start in (
        ("period", sampled, 'period = Parameter("s", start=1e-3, minimum=1e-6)'),
        ("tolerance", bool(states), 'tolerance = Parameter("1", start=1e-7, minimum=1e-12)'),
    ):
        declared = unit.declared.get(name)
        if needed and declared is None:
            yield "", f"sampled states need a {name}: {start}"
        elif needed and (not isinstance(declared, Parameter) or declared.shape):
            yield name, f"{name}: expected a parameter without a shape, {start}"
        elif needed and not (declared is not None and declared.minimum and declared.minimum > 0.0):
            yield name, f"{name}: expected a minimum above 0, {start}"
    if unit.sampled not in (None, True, False):
        yield "sampled", f"sampled: expected True, False or None, got {unit.sampled!r}"
    elif states and unit.sampled:
        yield "sampled", "sampled: expected False or None for a unit with continuous states, got True"
    elif sampled and unit.sampled is False:
        yield "sampled", "sampled: expected True or None for a unit with sampled states, got False"
    solver = unit.declared.get("solver")
    if states and unit.backend == "native" and not (isinstance(solver, Choice) and solver.choices == SOLVERS):
        yield "solver", "solver must be the choice of the solver that a unit with continuous states has. Rename it"
    if unit.backend not in ("native", "python"):
        yield "backend", f'backend: expected "native" or "python", got {unit.backend!r}'
    yield from _of_events(unit)
    for name in ABOUT:
        text = getattr(unit, name)
        if text is not None and not (isinstance(text, str) and text):
            yield name, f"{name}: expected a text, got {text!r}"
    for terminal in unit.terminals:
        head, sides = f"terminal {terminal.name}: expected", ("left", "right", "bottom", "top")
        if unknown := [group for group in terminal.groups if group not in unit.declared]:
            yield "terminals", f"{head} variables of the unit, got {', '.join(unknown)}"
        if terminal.side not in sides:
            yield "terminals", f"{head} the side {', '.join(sides[:3])} or {sides[3]}, got {terminal.side!r}"


def _of_events(unit: type[BaseUnit]) -> Iterator[tuple[str, str]]:
    """Yield the variable or method, and the fault, of incomplete events."""
    events = {f"{AT}{name}": name for name, d in unit.declared.items() if isinstance(d, Event)}
    for method, name in events.items():
        if not callable(getattr(unit, method, None)):
            yield name, f"{name} is an event and needs a method {method} that sets states"
        if unit.declared[name].shape:
            yield name, f"{name} is an event and must have no shape. Declare an event for each element"
    listed = unit.events is not BaseUnit.events
    for held in (name for name, d in unit.declared.items() if isinstance(d, Held) and not events):
        yield held, f"{held} is a held state, which methods of events set: declare one, {held}_changes = Event(..)"
    if listed and not events:
        yield "events", "events() needs events: declare one, ground = Event(..)"
    for method in dir(unit) if listed else ():
        if method.startswith(AT) and method not in events and callable(getattr(unit, method)):
            yield method, f"{method} is for an event that is not declared: {method[len(AT) :]} = Event(..)"


def _of_machine(unit: type[BaseUnit], robot: Machine) -> Iterator[tuple[str, str]]:
    """Yield the variable, and the fault, of variables that do not fit the robot."""
    for name, declared in unit.declared.items():
        if declared.when is not None and declared.when not in robot.flags:
            yield name, f"{name}: when: expected one of {', '.join(robot.flags)}, got {declared.when!r}"
    for name in unit.robot_fields or ():
        if name not in robot.joint_fields:
            yield (
                next(n for c in unit.__mro__ for n, v in vars(c).items() if isinstance(v, RobotParameters)),
                f"RobotParameters({name!r}): expected parameters with one number for each joint: "
                f"{', '.join(robot.joint_fields)}",
            )
        if name in unit.declared:
            yield name, f"{name} is there twice: as a variable and in RobotParameters. Rename the variable"
    if unit.robot_fields == ():
        for name in sorted({entry.field for entry in robot.entries()} & unit.declared_for(robot).keys()):
            yield name, f"{name} is there twice: as a variable and as a parameter of the robot. Rename one of them"


def _of_variable(declared: Declared, robot: Machine | None) -> Iterator[str]:
    name = declared.name
    if not re.fullmatch(f"{_WORDS}_?", name) or name == "time":
        yield f"a variable cannot be called {name}: {_LETTERS}, not 'time'"
    if isinstance(declared, Switch) and not isinstance(declared.start, bool):
        yield f"{name}: expected True or False, got {declared.start!r}"
    if isinstance(declared, (Choice, Mode)) and not _texts(declared.choices):
        yield f"{name}: expected choices that are texts, got {declared.choices}"
    if isinstance(declared, (Choice, Mode)) and len(set(declared.choices)) != max(2, len(declared.choices)):
        yield f"{name}: expected two or more different choices, got {declared.choices}"
    if isinstance(declared, (Choice, Mode, Switch)):
        return
    axes: tuple[object, ...] = declared.shape
    if not all(axis is JOINTS or (isinstance(axis, int) and axis > 0) for axis in axes):
        yield f"{name}: expected a shape of positive integers and JOINTS, got {declared.shape}"
        return
    sizes = declared.sizes(robot.n if robot is not None else 0)
    count = math.prod(sizes)
    for items, value in (("units of measurement", declared.unit), ("texts", declared.text)):
        if isinstance(value, str):
            continue
        if not _texts(value):
            yield f"{name}: expected {items}, one or one for each element, got {value!r}"
            return
        if len(value) != count:
            yield f"{name}: expected {count} {items}, one for each element, got {len(value)}"
    for measured in dict.fromkeys([declared.unit] if isinstance(declared.unit, str) else declared.unit):
        try:
            unit_of(measured, "revolute")
        except UsageError as error:
            yield f"{name}: {str(error).rstrip('.')}"
    if declared.set_by is None:
        yield from (f"{name}: {problem}" for problem in _of_start(declared, robot, sizes))


def _texts(value: object) -> bool:
    return isinstance(value, Sequence) and all(isinstance(each, str) for each in cast("Sequence[object]", value))


def _of_start(declared: Declared, robot: Machine | None, sizes: tuple[int, ...]) -> Iterator[str]:
    low, high = declared.minimum, declared.maximum
    for name, bound in (("minimum", low), ("maximum", high)):
        if bound is not None and (np.asarray(bound).dtype.kind not in "if" or np.ndim(bound)):
            yield f"{name}: expected a number, got {bound!r}"
            return
    if low is not None and high is not None and low > high:
        yield f"expected a minimum below the maximum, got {low:g} and {high:g}"
        return
    try:
        start: Any = declared.start(robot) if callable(declared.start) else declared.start
    except Exception as error:
        yield f"start: the function fails for {'the robot' if robot else 'no robot'}: {kind_text(error)}"
        return
    try:
        values = np.broadcast_to(np.asarray(start, dtype=float), sizes)
    except (TypeError, ValueError):
        yield f"start: expected numbers of shape {sizes}, got {start!r}"
        return
    if not np.isfinite(values).all():
        yield f"start: expected finite numbers, got {start!r}"
    elif low is not None and (values < low).any():
        yield f"start: expected at least {low:g}, the minimum, got {values.min():g}"
    elif high is not None and (values > high).any():
        yield f"start: expected at most {high:g}, the maximum, got {values.max():g}"
