"""Program of a unit: short lists of calls of traced functions on its memory.

The Python slave runs the lists, the native FMU is generated from them, and the dependencies are read off them. The
arguments and results of a function are names of groups of variables; further groups are ``p``, the robot's run-time
parameters, ``x`` and ``x_dot``, the continuous states and their derivatives, and ``t``, the time. A variable of such a
name is ``own_x`` there.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from hashlib import sha256
from pathlib import Path

import casadi as ca
import numpy as np
import numpy.typing as npt

from vdfmu.base.errors import KernelError, UnitError
from vdfmu.compiler.functions import traced_function
from vdfmu.compiler.functions.derivatives import DIRECTIONS, derivative
from vdfmu.compiler.functions.functions import Functions
from vdfmu.compiler.functions.rodas import Stages, permuted, rodas_step, stage_equations
from vdfmu.compiler.functions.sources import source_digest
from vdfmu.compiler.functions.switching import NEVER, time_left
from vdfmu.compiler.scalar.elimination import factorize, solve
from vdfmu.compiler.scalar.generic import cutting
from vdfmu.compiler.scalar.symbol import from_sx, to_sx
from vdfmu.compiler.unit.base import BaseUnit, is_shipped, unit_name
from vdfmu.compiler.unit.declaration import PHASES
from vdfmu.compiler.unit.machine import Machine
from vdfmu.compiler.unit.place import place, shown, source_file
from vdfmu.compiler.unit.trace import Leaf, SymbolicWatch, argument_name, leaves, run, state_slices
from vdfmu.compiler.unit.variable import scalar_variables


@dataclass(frozen=True)
class Call:
    """Run a traced function.

    Attributes
    ----------
    function : str
    when : tuple of (parameter, value)
        Choices with which it runs.
    reads, sets : tuple of str
        Groups.
    """

    function: str
    when: tuple[tuple[str, int], ...]
    reads: tuple[str, ...]
    sets: tuple[str, ...]

    def group(self, name: str) -> str:
        """Group of an argument or a result."""
        return name[:-4] if name[-4:] == "_new" and name[:-4] in self.sets else name


class Program:
    """Lists of calls.

    Attributes
    ----------
    start : from the parameters to the states of the start time
    outputs : from inputs, parameters, states and time to the outputs
    derivatives : to the derivatives of the continuous states
    update : to the sampled states of the time until the next sample
    step : one step of the solver. Besides groups it takes `h`, `tolerance` and ``rate_<input>``, and
        returns `x_new`, `norm` and `ratio`
    left : time until something switches by time, of units whose derivatives do
    """

    def __init__(self, functions: UnitFunctions) -> None:
        lists = {phase: tuple(functions.calls(phase)) for phase in PHASES}
        self.start, self.outputs = lists["start"], lists["outputs"]
        self.derivatives, self.update = lists["derivatives"], lists["update"]
        self.step = tuple(
            Call(functions.related(call.function, "step"), call.when, call.reads, ()) for call in self.derivatives
        )
        self.left = tuple(
            Call(functions.related(call.function, "left"), call.when, call.reads, ())
            for call in self.derivatives
            if functions.switches(call.function)
        )

    @property
    def calls(self) -> tuple[Call, ...]:
        """Calls of start, outputs, derivatives and update."""
        return (*self.start, *self.outputs, *self.derivatives, *self.update)


class UnitFunctions(Functions):
    """The traced functions of a unit for a robot.

    Parameters
    ----------
    unit : type of Unit
    robot : Robot or None
        Its structure decides the functions.
    cache : path, None or "default"
        See :class:`~vdfmu.compiler.functions.functions.Functions`. Functions of a unit that is not one of
        the package's are not kept: what they come from is known only once they are traced.
    """

    def __init__(self, unit: type[BaseUnit], robot: Machine | None, cache: Path | None | str = "default") -> None:
        self.unit, self.robot = unit, robot
        self.name = unit_name(unit)
        self._leaves: dict[str, Leaf] = {}
        instance = unit(robot)
        self._calls = {phase: self._listed(phase, leaves(instance, phase)) for phase in PHASES}
        self.shipped = is_shipped(unit)
        key = robot.key() if robot is not None else "no-robot"
        own = [unit.__module__.partition(".")[2]] if self.shipped else []
        super().__init__(f"{key}-{source_digest('compiler', *own)[:16]}", cache if self.shipped else None)

    def _listed(self, phase: str, found_leaves: list[Leaf]) -> list[Call]:
        found: list[Call] = []
        for leaf in found_leaves:
            names = [_choice_name(self.unit, name, value) for name, value in leaf.fixed.items()]
            function = "_".join((self.name, phase, *names))
            self._leaves[function] = leaf
            found.append(Call(function, tuple(leaf.fixed.items()), leaf.reads, leaf.sets))
        return found

    def calls(self, phase: str) -> list[Call]:
        """Return the calls of one method, one for each value of the choices that it reads."""
        return self._calls[phase]

    def names(self) -> list[str]:
        """Names of the functions, except for derivatives of them."""
        moving = self._calls["derivatives"]
        return [
            *self._leaves,
            *(self.related(c.function, kind) for kind in ("step", "jacobian") for c in moving),
            *(self.related(c.function, "left") for c in moving if "t" in c.reads),
        ]

    def related(self, derivatives: str, kind: str) -> str:
        """Name of the step or the jacobian that belongs to a function of derivatives."""
        return f"{self.name}_{kind}{derivatives.removeprefix(f'{self.name}_derivatives')}"

    @cached_property
    def digest(self) -> str:
        """Digest of what the unit is; empty for units of the package, whose sources decide it.

        It covers its file and those that it names, its variables, which other modules may decide too, and what
        the functions calculate.
        """
        if self.shipped:
            return ""
        digest = sha256()
        for content in self.sources.values():
            digest.update(sha256(content).digest())
        for variable in scalar_variables(self.unit, self.robot):
            digest.update(repr(variable).encode())
        for name in self._leaves if self.unit.backend == "native" else ():
            digest.update(self.casadi_function(name).serialize().encode())
        return digest.hexdigest()

    @property
    def sources(self) -> dict[str, bytes]:
        """Name to content of the unit's file, as ``unit.py``, and of the files beside it that it names.

        Raises
        ------
        UnitError
            If one of them cannot be read.
        """
        if self.unit.made_of is not None:
            return dict(self.unit.made_of)
        path = source_file(self.unit)
        if path is None:
            if self.unit.backend == "native":
                return {}
            raise UnitError(f"{self.unit.__name__}: a Python FMU carries the file of its unit, and this one has none.")
        found: dict[str, bytes] = {}
        for name in ("unit.py", *self.unit.files):
            try:
                found[name] = (path if name == "unit.py" else path.with_name(name)).read_bytes()
            except OSError as error:
                raise UnitError(f"{shown(self.unit)}: files: {name} cannot be read: {error.strerror}.") from None
        return found

    def made(self, name: str) -> ca.Function:
        """Trace a function."""
        if name in self._leaves:
            watch = self._traced(self._leaves[name])
            return traced_function(name, watch.symbols, watch.expressions())
        kind = next(k for k in ("step", "jacobian", "left") if name.startswith(f"{self.name}_{k}"))
        derivatives = f"{self.name}_derivatives{name.removeprefix(f'{self.name}_{kind}')}"
        if kind == "left":
            return self._left(derivatives)[1]
        stiff = _ImplicitEquations(self._traced(self._leaves[derivatives]), cut=kind == "step")
        try:
            return stiff.jacobian(name) if kind == "jacobian" else stiff.step(name, self.casadi_function(derivatives))
        except KernelError as error:
            raise UnitError(
                f"{place(self.unit, 'balance')}: balance() of {self.unit.__name__} has no derivatives: {error} "
                "Return the rows in the order of the states, each with the derivative of its state."
            ) from None

    def switches(self, derivatives: str) -> bool:
        """Whether derivatives switch by time; UnitError if it is not known when."""
        reads = self._leaves[derivatives].reads
        return self.unit.backend == "native" and "t" in reads and self._left(derivatives)[0]

    def _left(self, derivatives: str) -> tuple[bool, ca.Function]:
        """Return whether derivatives switch by time, and the function of the time until they do."""
        watch, function = self._traced(self._leaves[derivatives]), self.casadi_function(derivatives)
        given = watch.symbols
        declared = self.unit.declared.items()
        inputs = [argument_name(name) for name, d in declared if d.causality == "input"]
        rates = {name: ca.SX.sym(f"rate_{name}", given[name].numel()) for name in inputs if name in given}
        changing = rates | ({"x": watch.expressions()["x_dot"]} if "x" in given else {})
        try:
            left = time_left(function, given, changing)
        except ValueError as error:
            raise UnitError(
                f"{place(self.unit, 'derivatives')}: derivatives() of {self.unit.__name__} may switch by time: "
                f"{error}. Write conditions that are linear in time, such as of a phase, self.t * f - "
                "np.floor(self.t * f); or give what switches as an input, from a unit without continuous states."
            ) from None
        arguments = given | {f"rate_{name}": rate for name, rate in rates.items()}
        name = self.related(derivatives, "left")
        return left is not None, traced_function(name, arguments, {"left": ca.SX(NEVER) if left is None else left})

    def _made(self, name: str) -> ca.Function:
        base, _, direction = name.rpartition("_")
        if direction in DIRECTIONS and base in {call.function for call in self._calls["update"]}:
            return derivative(self.casadi_function(base), direction, rounded=True)
        return super()._made(name)

    def _traced(self, leaf: Leaf) -> SymbolicWatch:
        instance = self.unit(self.robot)
        watch = SymbolicWatch(instance, leaf.phase, leaf.fixed)
        run(instance, leaf.phase, watch)
        return watch


def _choice_name(unit: type[BaseUnit], name: str, value: int) -> str:
    choices = unit.declared[name].choices
    text = choices[value] if choices else f"{'' if value else 'not_'}{name}"
    return text if text.isidentifier() and text.isascii() and "__" not in text else f"{name}_{value}"


class _ImplicitEquations:
    """The right-hand side of a unit and its linearisation, as expressions.

    ``E`` and ``EJ`` are the derivatives of the balance with respect to derivatives and states, where the unit has one:
    the identity and the Jacobian else. `Ef_t` is E times the derivative along inputs that change at `rates`, and time.
    With `cut` and a long chain, rows and columns of what the balance cuts come after those of the states: E is 0 in
    these columns. `order` is that of the elimination.
    """

    def __init__(self, watch: SymbolicWatch, cut: bool = False) -> None:
        unit = watch.unit
        n_x = state_slices(unit)[""].stop
        self.inputs = watch.symbols
        x = self.x = watch.symbol("x", n_x)
        self.x_dot = watch.expressions()["x_dot"]
        inputs = [argument_name(name) for name, d in unit.declared.items() if d.causality == "input"]
        given = [name for name in self.inputs if name in inputs]
        self.rates = {name: ca.SX.sym(f"rate_{name}", self.inputs[name].numel()) for name in given}
        changing = [self.inputs[name] for name in given]
        changes = list(self.rates.values())
        if "t" in self.inputs:
            changing.append(self.inputs["t"])
            changes.append(ca.SX(1))
        where = state_slices(unit)
        first = [name for name in type(unit).elimination if name in where]
        names = [*first, *(name for name in where if name not in ("", *first))]
        self.order = np.concatenate([np.arange(where[name].start, where[name].stop) for name in names])
        if type(unit).balance is BaseUnit.balance:
            self.E, self.EJ = ca.SX.eye(n_x), ca.jacobian(self.x_dot, x)
            self.Ef_t = _along(self.x_dot, changing, changes)
            self._residual = None
        else:
            balance = SymbolicWatch(unit, "balance", watch.fixed, watch)
            x_dot = balance.symbol("x_dot", n_x)
            long = cut and unit.chain is not None and unit.n >= unit.chain
            with cutting(balance.cut if long else None):
                residual = to_sx(run(unit, "balance", balance))
            cuts = balance.cuts
            unknown = x
            if cuts:
                residual = ca.vertcat(residual, *[value - symbols for _, symbols, value in cuts])
                unknown = ca.vertcat(x, *[symbols for _, symbols, _ in cuts])
                self.order = _along_chain([where[name].start for name in names], unit.n, n_x, cuts)
            at = list(self.inputs.values())
            parts = [
                ca.jacobian(residual, unknown),
                -ca.horzcat(ca.jacobian(residual, x_dot), ca.SX(residual.numel(), unknown.numel() - n_x)),
                _along(residual, changing, changes),
                residual[:n_x],
            ]
            if cuts:
                _, symbols, values = zip(*cuts, strict=True)
                _, parts = ca.substitute_inplace(list(symbols), list(values), parts, False)
            linear = ca.Function("linear", [x_dot, *at, *self.rates.values()], parts[:3])
            self.EJ, self.E, self.Ef_t = linear(self.x_dot, *at, *self.rates.values())
            self._residual = ca.Function("residual", [x_dot, *at], parts[3:])

    def step(self, name: str, derivatives: ca.Function) -> ca.Function:
        """One Rodas4 step, inputs linear in time, and its local error relative to the tolerance, by component.

        It calls functions that are traced once: `derivatives`, and those named after it.
        """
        n_x, (h, tolerance, time) = self.x.numel(), (ca.SX.sym(one) for one in ("h", "tolerance", "time"))
        rates = {f"rate_{key}": rate for key, rate in self.rates.items()}
        stages = stage_equations(h, self.E, self.EJ, self.Ef_t, self.order, n_x, name)
        used = {**self.inputs, **rates, "h": h}
        # the Jacobian needs most of the derivative at the start
        made = {"factors": stages.factors, "x_dot": ca.densify(self.x_dot)}
        started = ca.cse([*made.values()])
        start = ca.Function(f"{name}_start", list(used.values()), started, list(used), list(made))
        if stages.carried:
            derivatives = self._balance(f"{name}_balance", stages)

        moving = {key: value for key, value in self.inputs.items() if key in self.rates or key == "t"}
        later = [value + time * self.rates.get(key, 1.0) for key, value in moving.items()]
        move = ca.Function(f"{name}_move", [time, *moving.values(), *self.rates.values()], later)

        x, x_new, error = (ca.SX.sym(one, n_x) for one in ("x", "x_new", "error"))
        nominal = 1.0  # SI unit, of every state
        ratio = error / (tolerance * (nominal + ca.fmax(ca.fabs(x), ca.fabs(x_new))))
        norm = ca.sqrt(ca.sumsqr(ratio) / n_x)
        size = ca.Function(f"{name}_size", [x, x_new, error, tolerance], ca.cse([norm, ratio]))

        given = self.inputs | rates | {"h": h, "tolerance": tolerance}
        now = {key: ca.MX.sym(key, value.numel()) for key, value in given.items()}

        def f(x_i: ca.MX, after: ca.MX, *y_i: ca.MX) -> ca.MX:
            moved = move.call([after, *(now[key] for key in (*moving, *rates))]) if moving else []
            at = now | dict(zip(moving, moved, strict=True)) | {"x": x_i} | dict(zip(["y"], y_i, strict=False))
            return derivatives(*(at[key] for key in derivatives.name_in()))

        factors, x_dot = start(*(now[key] for key in start.name_in()))
        x_end, last = rodas_step(f, now["x"], x_dot, now["h"], factors, stages, name)
        results = [x_end, *size(now["x"], x_end, last, now["tolerance"])]
        return ca.Function(name, list(now.values()), results, list(now), ["x_new", "norm", "ratio"])

    def _balance(self, name: str, stages: Stages) -> ca.Function:
        """Residual of a stage, in explicit rows the derivative, of what is carried and the inputs."""
        assert self._residual is not None
        y = ca.SX.sym("y", len(stages.carried))
        x_dot = ca.SX(self.x.numel(), 1)
        x_dot[stages.carried] = y
        at = {"y": y} | self.inputs
        value = self._residual(x_dot, *self.inputs.values()) + stages.explicit * x_dot
        return ca.Function(name, list(at.values()), ca.cse([ca.densify(value)]), list(at), ["value"])

    def jacobian(self, name: str) -> ca.Function:
        """Jacobian of the derivatives with respect to the states."""
        n_x, order = self.x.numel(), self.order
        rows = from_sx(ca.densify(self.EJ)).reshape(n_x, n_x)
        factors = factorize(permuted(self.E, order))
        J = np.empty((n_x, n_x), dtype=object)
        for j in range(n_x):
            J[order, j] = solve(factors, rows[order, j])
        column = ca.reshape(ca.reshape(to_sx(J), n_x, n_x).T, n_x, n_x)
        return traced_function(name, self.inputs, {"J": column})


def _along_chain(states: list[int], n: int, n_x: int, cuts: list[tuple[int, ca.SX, ca.SX]]) -> npt.NDArray[np.int_]:
    """Order of elimination from the last joint to the first: states, what is cut from its end on, the last state.

    Parameters
    ----------
    states : places of the first joint's states, in their order for one joint
    n, n_x : joints and states
    cuts : see :class:`SymbolicWatch`; their unknowns come after the states
    """
    ends = n_x + np.cumsum([symbols.numel() for _, symbols, _ in cuts])
    order: list[int] = []
    for i in reversed(range(n)):
        order += [start + i for start in states[:-1]]
        for (joint, symbols, _), end in reversed(list(zip(cuts, ends, strict=True))):
            order += range(end - symbols.numel(), end) if joint == i else ()
        order.append(states[-1] + i)
    return np.array(order)


def _along(expression: ca.SX, changing: list[ca.SX], changes: list[ca.SX]) -> ca.SX:
    if not changing:
        return ca.SX(*expression.shape)
    return ca.jtimes(expression, ca.vertcat(*changing), ca.vertcat(*changes))
