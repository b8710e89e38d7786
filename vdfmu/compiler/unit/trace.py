"""Traces a unit's methods: their reads, writes, choices and expressions."""

from __future__ import annotations

import math
import os
import re
import sys
import traceback
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from types import FrameType
from typing import Any, NamedTuple, NoReturn

import casadi as ca
import numpy as np

from vdfmu.base.errors import KernelError, UnitError, UsageError
from vdfmu.base.files import PACKAGE
from vdfmu.base.text import kind_text
from vdfmu.compiler.c.text import CALLED
from vdfmu.compiler.scalar.symbol import SymbolArray, from_sx, refusal, refusals, to_sx
from vdfmu.compiler.unit.base import BaseUnit, Values, unit_name
from vdfmu.compiler.unit.declaration import AT, Choice, Declared, Derivative, Output, Sampled, State, Switch
from vdfmu.compiler.unit.place import place, shown, source_file

Fixed = Mapping[str, int]
"""Choice or switch to its value."""

_MEMORY = "Keep a value for the next call in a Sampled state, and within a call in a local variable"
_TAKEN = CALLED.union(
    "p x x_dot t h tolerance norm ratio factors given made w null jac hess"
    # keywords of C, and definitions of C that traced functions use
    " auto bool break case char const continue default do double else enum extern false float for goto if inline int"
    " long register restrict return short signed sizeof static struct switch true typedef typeof union unsigned void"
    " volatile while NAN INFINITY NULL memcpy".split()
)
_FORMS = re.compile(r"[svw]\d+|(own|d|bar|rate)_.*|.*_(new|out)")
"""Patterns of other names that traced functions use."""


def argument_name(name: str) -> str:
    """Return a variable's name as an argument or result of traced functions, where some names have other uses."""
    return f"own_{name}_" if name in _TAKEN or _FORMS.fullmatch(name) else name


class Call(NamedTuple):
    """A traced function, a unit's method for some choices, with groups of variables as arguments and results."""

    function: str
    when: tuple[tuple[str, int], ...]
    """The choices, with their values, for which it runs."""
    reads: tuple[str, ...]
    """Variables, ``p`` for the robot's parameters and ``t`` for the time."""
    sets: tuple[str, ...]

    def group(self, name: str) -> str:
        """Return the group of an argument or a result."""
        return name[:-4] if name[-4:] == "_new" and name[:-4] in self.sets else name


def _may_set(phase: str, declared: Declared) -> bool:
    """Return whether a method may set a variable."""
    if phase.startswith(AT):
        return isinstance(declared, State) and not isinstance(declared, Sampled)
    return isinstance(declared, Sampled) if phase == "update" else declared.set_by == phase


class _ForkError(Exception):
    """A method has read a choice whose value is not fixed."""

    def __init__(self, choice: Declared) -> None:
        self.choice = choice


class Recording(Values):
    """Record of a method's reads and writes, on the values of the instance.

    `phase` is the method, `fixed` the choices that it may read, `reads` are the arguments of its traced function.
    """

    def __init__(self, unit: BaseUnit, phase: str, fixed: Fixed) -> None:
        super().__init__(unit)
        self.phase, self.fixed = phase, fixed
        self.reads: dict[str, None] = {}

    def read(self, declared: Declared) -> Any:
        """Return the value of a variable that the method may read."""
        choice = isinstance(declared, (Choice, Switch))
        if self.phase == "requirements" and (choice or declared.causality != "parameter"):
            raise refusal(UnitError(f"{declared.name} is not a parameter with numbers"))
        if choice:
            if declared.name not in self.fixed:
                raise refusal(_ForkError(declared))
            value = self.fixed[declared.name]
            return declared.choices[value] if declared.choices else bool(value)
        if declared.name in self.sets:
            return self.sets[declared.name]
        if isinstance(declared, Output) or (isinstance(declared, Derivative) and self.phase != "balance"):
            raise refusal(UnitError(f"{declared.name} is read before it is set"))
        if isinstance(declared, State) and self.phase == "start":
            raise refusal(UnitError(f"{declared.name} is a state and gets its first value by start()"))
        self.reads[argument_name(declared.name)] = None
        return self.value(declared)

    def write(self, declared: Declared, value: Any) -> None:
        """Store the value of a variable that the method may set."""
        if not _may_set(self.phase, declared):
            raise refusal(UnitError(f"{self.phase}() must not set {declared.name}, {_kind(declared)}"))
        super().write(declared, value)
        result = np.asarray(self.sets[declared.name])
        if result.dtype != object and not np.isfinite(result).all():
            raise UnitError(f"{declared.name} is {result} at the start values, expected finite numbers")

    def keep(self, name: str) -> None:
        """Raise an error for an attribute that a trace would miss."""
        if self.unit.backend != "python":
            raise refusal(
                UnitError(f"{self.phase}() sets {name}, which {type(self.unit).__name__} does not declare. {_MEMORY}")
            )

    def time(self) -> Any:
        """Return the time [s]."""
        self.reads["t"] = None
        return super().time()

    def robot(self, fields: tuple[str, ...]) -> Any:
        """Return the robot with the fields that the unit declares."""
        if fields:
            return _RobotPart(self, fields)
        self.reads["p"] = None
        return super().robot(fields)

    def value(self, declared: Declared) -> Any:
        """Return the value of a variable."""
        return self.unit.store[declared.name]

    def field(self, name: str) -> Any:
        """Return a field of the robot."""
        return getattr(self.unit.of_robot, name)


class _RobotPart:
    """The fields of a robot that a unit declares."""

    def __init__(self, record: Recording, fields: tuple[str, ...]) -> None:
        self._record, self._fields = record, fields
        self.n = record.unit.n

    def __getattr__(self, name: str) -> Any:
        if name not in self._fields:
            fields = ", ".join(repr(field) for field in (*self._fields, name))
            raise refusal(UnitError(f"the unit declares no {name} of the robot. Write RobotParameters({fields})"))
        self._record.reads[argument_name(name)] = None
        return self._record.field(name)


class Symbols(Recording):
    """Record of a method that runs on symbols, either new ones or those of another record.

    `symbols` are columns of the variables read, of ``x``, the continuous states, ``x_dot``, ``p`` and ``t``.
    """

    def __init__(self, unit: BaseUnit, phase: str, fixed: Fixed, other: Symbols | None = None) -> None:
        super().__init__(unit, phase, fixed)
        self.symbols: dict[str, ca.SX] = {} if other is None else dict(other.symbols)
        self._robot: Any = None if other is None else other._robot

    def symbol(self, name: str, size: int) -> ca.SX:
        """Column of a name."""
        if name not in self.symbols:
            self.symbols[name] = ca.SX.sym(name, size)
        return self.symbols[name]

    def value(self, declared: Declared) -> Any:
        """Return the symbols of a variable."""
        where, shape = state_slices(self.unit), declared.sizes(self.unit.n)
        state = declared.state if isinstance(declared, Derivative) else declared
        if state.name in where:
            column = self.symbol("x_dot" if isinstance(declared, Derivative) else "x", where[""].stop)
            column = column[where[state.name]]
        else:
            column = self.symbol(argument_name(declared.name), math.prod(shape))
        array = from_sx(ca.SX(column)).reshape(shape)
        return array.view(SymbolArray) if shape else array[()]

    def write(self, declared: Declared, value: Any) -> None:
        """Store the value of a variable; arrays that are read again are arrays of symbols."""
        super().write(declared, value)
        array = self.sets[declared.name]
        if isinstance(array, np.ndarray) and array.dtype == object:
            self.sets[declared.name] = array.view(SymbolArray)

    def field(self, name: str) -> Any:
        """Return the symbols of a field of the robot."""
        return from_sx(self.symbol(argument_name(name), self.unit.n)).view(SymbolArray)

    def time(self) -> Any:
        """Return the symbol of the time."""
        super().time()
        return from_sx(self.symbol("t", 1))[0]

    def robot(self, fields: tuple[str, ...]) -> Any:
        """Return the robot, whose run-time parameters are symbols."""
        if not fields and self._robot is None:
            self._robot, self.symbols["p"] = self.unit.of_robot.symbolic()
        part = super().robot(fields)
        return part if fields else self._robot

    def expressions(self) -> dict[str, ca.SX]:
        """Return the set variables as columns; continuous states are ``x``, derivatives ``x_dot``."""
        results: dict[str, ca.SX] = {}
        parts: dict[str, dict[str, ca.SX]] = {"x": {}, "x_dot": {}}
        where = state_slices(self.unit)
        new = "_new" if self.phase == "update" or self.phase.startswith(AT) else ""
        for name, value in self.sets.items():
            declared = self.unit.declared[name]
            if isinstance(declared, Derivative):
                parts["x_dot"][declared.state.name] = to_sx(value)
            elif name in where:
                parts["x"][name] = to_sx(value)
            else:
                results[argument_name(name) + new] = to_sx(value)
        if new and parts["x"]:  # other states keep their values
            kept = {name: to_sx(self.value(self.unit.declared[name])) for name in where if name}
            parts = {"x_new": kept | parts["x"], "x_dot": {}}
        whole = {name: [by_state[state] for state in where if state] for name, by_state in parts.items() if by_state}
        return results | {name: ca.vertcat(*columns) for name, columns in whole.items()}


def state_slices(unit: BaseUnit) -> dict[str, slice]:
    """Continuous state to its place in ``x``; ``""`` to all of them."""
    slices: dict[str, slice] = {}
    end = 0
    for declared in unit.declared.values():
        if type(declared) is State:
            begin, end = end, end + math.prod(declared.sizes(unit.n))
            slices[declared.name] = slice(begin, end)
    return slices | {"": slice(0, end)}


def _kind(declared: Declared) -> str:
    names = {
        "Output": "an output",
        "Input": "an input",
        "State": "a continuous state",
        "Sampled": "a sampled state",
        "Held": "a held state",
        "Mode": "a mode",
        "Event": "an event indicator",
    }
    return names.get(type(declared).__name__, f"a {type(declared).__name__.lower()}")


def calls_of(unit: BaseUnit, phase: str, fixed: Fixed) -> Iterator[Call]:
    """Yield a method's call for each combination of the choices that it reads; nothing if it sets nothing.

    The name of its function follows from unit, method and `fixed` choices. UnitError for a method that fails, or that
    does not set a variable that it must set.
    """
    record = Recording(unit, phase, fixed)
    try:
        run(unit, phase, record)
    except _ForkError as fork:
        for value in range(max(2, len(fork.choice.choices))):
            yield from calls_of(unit, phase, {**fixed, fork.choice.name: value})
        return
    _check_complete(unit, phase, fixed, record.sets)
    if unit.backend != "python":
        _check_repeatable(unit, phase, record)
    for name, value in record.sets.items():
        unit.store.setdefault(name, value)
    if record.sets:
        names = [_choice_name(unit.declared[name], value) for name, value in fixed.items()]
        function = "_".join((unit_name(type(unit)), phase, *names))
        moved = phase.startswith(AT) and any(name in record.sets for name in state_slices(unit))
        sets = (*map(argument_name, record.sets), *(["x"] if moved else []))
        yield Call(function, tuple(fixed.items()), tuple(record.reads), sets)


def _choice_name(choice: Declared, value: int) -> str:
    text = choice.choices[value] if choice.choices else f"{'' if value else 'not_'}{choice.name}"
    return text if text.isidentifier() and text.isascii() and "__" not in text else f"{choice.name}_{value}"


def _check_repeatable(unit: BaseUnit, phase: str, first: Recording) -> None:
    """Raise an error if a second run of a method has another result, because its trace would be one case of many."""
    again = Recording(unit, phase, first.fixed)
    run(unit, phase, again)
    for name, value in first.sets.items():
        if not np.array_equal(value, again.sets.get(name, np.nan)):
            raise UnitError(
                f"{place(type(unit), phase)}: {phase}() of {type(unit).__name__} gives {name} = {value}, then "
                f"{again.sets.get(name)} for the same values. {_MEMORY}. For noise use an input or vdfmu.unit.normal."
            )


def _check_complete(unit: BaseUnit, phase: str, fixed: Fixed, sets: Mapping[str, Any]) -> None:
    """Raise an error if a method does not set a variable that it must set."""
    missing = [name for name, d in unit.declared.items() if d.set_by == phase and name not in sets]
    if missing:
        choices = [
            f"{name} = {unit.declared[name].choices[value] if unit.declared[name].choices else bool(value)}"
            for name, value in fixed.items()
        ]
        with_choices = f" with {', '.join(choices)}" if choices else ""
        where = missing[0] if getattr(type(unit), phase) is getattr(BaseUnit, phase) else phase
        method = f"{phase}() of {type(unit).__name__}"
        raise UnitError(f"{place(type(unit), where)}: {method} never sets {', '.join(missing)}{with_choices}.")


def run(unit: BaseUnit, phase: str, values: Values) -> Any:
    """Run a method of a unit on values; UnitError with file, line and reason if it fails."""
    before, unit.in_use = unit.in_use, values
    symbols = isinstance(values, Symbols)
    try:
        return _call(getattr(unit, phase), source_file(type(unit)) if symbols else None)
    except _ForkError:
        raise
    except RecursionError as error:
        _fail(unit, phase, error, "it calls itself endlessly")
    except (KernelError, UnitError, UsageError) as error:
        _fail(unit, phase, error, str(error).rstrip("."), symbols)
    except Exception as error:
        reason = kind_text(error).rstrip(".: ")
        if "read-only" in reason:
            reason = "an element of a variable cannot be set alone. Set the variable as a whole, self.y = array"
        _fail(unit, phase, error, reason, symbols and "self.y" not in reason)
    finally:
        unit.in_use = before


def _call(method: Callable[[], Any], file: Path | None) -> Any:
    """Call a method, and raise errors of values and symbols even if the method catches them.

    Errors of types and attributes raised in `file` and the files next to it are unexpected; numpy and other libraries
    also raise them for unknown objects such as symbols.
    """
    refused: list[Exception] = []
    token, tracer = refusals.set(refused), sys.gettrace()

    def look(frame: FrameType, event: str, argument: Any) -> Any:
        if event == "exception" and isinstance(argument[1], (TypeError, AttributeError)):
            refusal(argument[1])
        return look if os.path.dirname(frame.f_code.co_filename) == str(file.parent if file else "") else None

    try:
        if file is not None and PACKAGE not in file.parents and tracer is None:  # otherwise a debugger needs its place
            sys.settrace(look)
        with np.errstate(all="ignore"):
            result = method()
    except Exception:
        if not refused:
            raise
        result = None
    finally:
        sys.settrace(tracer)
        refusals.reset(token)
    if refused:
        raise refused[0]
    return result


_WAY_OUT = (
    ". Write it with arithmetic, elementwise functions of numpy, and where, lookup, solve, inv, expm and others "
    "of vdfmu.unit"
)
_OTHER_WAY_OUT = '; or write backend = "python" in the class, and its FMU runs the method in Python'


def _fail(unit: BaseUnit, phase: str, error: Exception, reason: str, symbols: bool = False) -> NoReturn:
    file, frames = source_file(type(unit)), traceback.extract_tb(error.__traceback__)
    lines = [frame.lineno for frame in frames if frame.filename == str(file)]
    where = f"{shown(type(unit))}, line {lines[-1]}" if lines else shown(type(unit))
    ours = "<", str(PACKAGE), sys.prefix, sys.base_prefix
    if str(file).startswith(ours) and (laws := [each for each in frames if not each.filename.startswith(ours)]):
        where = f"{laws[-1].filename}, line {laws[-1].lineno}"  # a law of a drive, called by a unit of the package
    if symbols:  # the error of a compared symbol already contains the fix
        reason += ("" if "Write it with" in reason else _WAY_OUT) + _OTHER_WAY_OUT
    method = f"{phase}() of {type(unit).__name__} {'cannot be traced' if symbols else 'fails'}"
    raise UnitError(f"{where}: {method}: {reason}.") from None
