"""The program of a unit: short lists of calls of traced functions on its memory.

Arguments and results of a function are groups of variables. Other groups are ``p``, the robot's run-time parameters,
``x`` and ``x_dot``, the continuous states and their derivatives, and ``t``, the time. A variable named ``x`` becomes
``own_x_``.
"""

from __future__ import annotations

from functools import cached_property
from hashlib import sha256
from pathlib import Path

import casadi as ca

from vdfmu.base.errors import KernelError, UnitError
from vdfmu.base.sources import source_digest
from vdfmu.compiler.functions.chain import ChainError
from vdfmu.compiler.functions.chain_calls import chain_function
from vdfmu.compiler.functions.derivatives import DIRECTIONS, NEVER, derivative, time_left
from vdfmu.compiler.functions.traced import Functions, traced_function
from vdfmu.compiler.unit.base import BaseUnit, is_shipped, unit_name
from vdfmu.compiler.unit.declaration import PHASES, Machine
from vdfmu.compiler.unit.implicit import ImplicitEquations
from vdfmu.compiler.unit.joints import chain_step, chain_trace, is_long
from vdfmu.compiler.unit.place import place, shown, source_file
from vdfmu.compiler.unit.trace import Call, Symbols, argument_name, calls_of, run
from vdfmu.compiler.unit.variable import scalar_variables


class Program:
    """Lists of calls of the methods `start`, `outputs`, `derivatives` and `update`, and of two other functions.

    `step` makes one step of the solver. Besides groups its arguments are `h`, `tolerance` and ``rate_<input>``; it
    returns `x_new`, `norm` and `ratio`. `left` returns the time until the derivatives switch, if they switch by time.

    `events` sets the event indicators, which are also outputs. `at_events` has the calls of each event's method.
    """

    def __init__(self, functions: UnitFunctions) -> None:
        calls = {phase: tuple(calls) for phase, calls in functions.calls.items()}
        self.start, self.outputs, self.derivatives, self.update = (calls[phase] for phase in PHASES)
        self.events = calls.get("events", ())
        self.outputs += self.events
        self.at_events = {name: calls[name] for name in functions.unit.event_methods(functions.robot)}
        switching = [call for call in self.derivatives if functions.switches(call.function)]
        self.step, self.left = (
            tuple(Call(functions.related(call.function, kind), call.when, call.reads, ()) for call in calls)
            for kind, calls in (("step", self.derivatives), ("left", switching))
        )

    @property
    def calls(self) -> tuple[Call, ...]:
        """Calls of start, outputs, derivatives and update."""
        return (*self.start, *self.outputs, *self.derivatives, *self.update)


class UnitFunctions(Functions):
    """The traced functions of a unit for the structure of a robot.

    `cache`: see :class:`~vdfmu.compiler.functions.traced.Functions`. Only functions of the package's units are cached,
    because others may come from any module.
    """

    def __init__(self, unit: type[BaseUnit], robot: Machine | None, cache: Path | None | str = "default") -> None:
        self.unit, self.robot = unit, robot
        self.name = unit_name(unit)
        self.shipped = is_shipped(unit)
        key = robot.key() if robot is not None else "no-robot"
        module = [unit.__module__.partition(".")[2]] if self.shipped else []
        super().__init__(f"{key}-{source_digest('compiler', *module)[:16]}", cache if self.shipped else None)

    @cached_property
    def calls(self) -> dict[str, list[Call]]:
        """Calls of each method. UnitError for a wrong method."""
        instance = self.unit(self.robot)
        methods = self.unit.event_methods(self.robot)
        phases = (*PHASES, "events", *methods) if methods else PHASES
        return {phase: list(calls_of(instance, phase, {})) for phase in phases}

    @cached_property
    def _traced(self) -> dict[str, tuple[str, Call]]:
        return {call.function: (phase, call) for phase, calls in self.calls.items() for call in calls}

    @cached_property
    def _related(self) -> dict[str, tuple[str, str]]:
        """Function to its kind, and to the derivatives to which it belongs."""
        return {
            self.related(call.function, kind): (kind, call.function)
            for call in self.calls["derivatives"]
            for kind in ("step", "jacobian", *(["left"] if "t" in call.reads else []))
        }

    def names(self) -> list[str]:
        """Names of the functions, except for derivatives of them."""
        return [*self._traced, *self._related]

    def related(self, derivatives: str, kind: str) -> str:
        """Name of the step, the jacobian or the time left for a function of derivatives."""
        return f"{self.name}_{kind}{derivatives.removeprefix(f'{self.name}_derivatives')}"

    @cached_property
    def digest(self) -> str:
        """Digest of the unit: its files, variables and traced functions. Empty for units of the package."""
        if self.shipped:
            return ""
        digest = sha256()
        for content in self.sources.values():
            digest.update(sha256(content).digest())
        for variable in scalar_variables(self.unit, self.robot):
            digest.update(repr(variable).encode())
        for name in self._traced:  # this also checks the methods of Python FMUs
            if self.unit.backend == "native":
                digest.update(self.casadi_function(name).serialize().encode())
        return digest.hexdigest()

    @property
    def identity(self) -> str:
        """A text that differs if the traced functions differ."""
        return f"{self.name} {self._key} {self.digest}"

    @property
    def sources(self) -> dict[str, bytes]:
        """Name to content of the unit's file, as ``unit.py``, and of its `files`; UnitError if one is not readable."""
        if self.unit.made_of is not None:
            return dict(self.unit.made_of)
        path = source_file(self.unit)
        if path is None:
            if self.unit.backend == "native":
                return {}
            raise UnitError(f"{self.unit.__name__} must be in a file, because a Python FMU contains it.")
        contents: dict[str, bytes] = {}
        for name in ("unit.py", *self.unit.files):
            try:
                contents[name] = (path if name == "unit.py" else path.with_name(name)).read_bytes()
            except OSError as error:
                raise UnitError(f"{shown(self.unit)}: files: {name} cannot be read: {error.strerror}.") from None
        return contents

    def made(self, name: str) -> ca.Function:
        """Trace a function."""
        if name in self._traced:
            if is_long(self.unit, self.robot):
                return self._chain(name)
            record = self._record(name)
            return traced_function(name, record.symbols, record.expressions())
        kind, derivatives = self._related[name]
        if kind == "left":
            return self._left(derivatives)[1]
        if kind == "step" and is_long(self.unit, self.robot):
            try:
                return self._chain_step(name, derivatives)
            except ChainError:
                pass
        try:
            stiff = ImplicitEquations(self._record(derivatives))
            return stiff.jacobian(name) if kind == "jacobian" else stiff.step(name, self.casadi_function(derivatives))
        except KernelError as error:
            raise UnitError(
                f"{place(self.unit, 'balance')}: balance() of {self.unit.__name__} has no derivatives: {error} "
                "Return the rows in the order of the states, each with the derivative of its state."
            ) from None

    def _chain(self, name: str) -> ca.Function:
        """Trace a function of a long arm."""
        assert self.robot is not None
        phase, call = self._traced[name]
        try:
            return chain_function(chain_trace(self.unit, self.robot, name, phase, dict(call.when)))
        except ChainError:
            record = self._record(name)
            return traced_function(name, record.symbols, record.expressions())

    def _chain_step(self, name: str, derivatives: str) -> ca.Function:
        """Trace the solver's step for a long arm."""
        assert self.robot is not None
        _, call = self._traced[derivatives]
        chain = chain_trace(self.unit, self.robot, f"{name}_residual", "balance", dict(call.when))
        return chain_step(self.unit, self.robot, name, self.casadi_function(derivatives), chain)

    def switches(self, derivatives: str) -> bool:
        """Return whether derivatives switch by time; UnitError if the time cannot be determined."""
        return (
            self.unit.backend == "native" and "t" in self._traced[derivatives][1].reads and self._left(derivatives)[0]
        )

    def _left(self, derivatives: str) -> tuple[bool, ca.Function]:
        """Return whether derivatives switch by time, and the function of the time until they do."""
        record, function = self._record(derivatives), self.casadi_function(derivatives)
        symbols = record.symbols
        inputs = [argument_name(name) for name, d in self.unit.declared.items() if d.causality == "input"]
        rates = {name: ca.SX.sym(f"rate_{name}", symbols[name].numel()) for name in inputs if name in symbols}
        changing = rates | ({"x": record.expressions()["x_dot"]} if "x" in symbols else {})
        try:
            left = time_left(function, symbols, changing)
        except ValueError as error:
            raise UnitError(
                f"{place(self.unit, 'derivatives')}: derivatives() of {self.unit.__name__} may switch by time: "
                f"{error}. Write conditions that are linear in time, such as of a phase, self.t * f - "
                "np.floor(self.t * f); or give what switches as an input, from a unit without continuous states."
            ) from None
        arguments = symbols | {f"rate_{name}": rate for name, rate in rates.items()}
        name = self.related(derivatives, "left")
        return left is not None, traced_function(name, arguments, {"left": ca.SX(NEVER) if left is None else left})

    def _made(self, name: str) -> ca.Function:
        base, _, direction = name.rpartition("_")
        if direction in DIRECTIONS and base in {call.function for call in self.calls["update"]}:
            return derivative(self.casadi_function(base), direction, rounded=True)
        return super()._made(name)

    def _record(self, name: str) -> Symbols:
        phase, call = self._traced[name]
        instance = self.unit(self.robot)
        record = Symbols(instance, phase, dict(call.when))
        run(instance, phase, record)
        return record
