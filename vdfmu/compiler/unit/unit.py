"""The base class of units: what `base` declares, and how a unit runs by itself in Python; its linear model."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from vdfmu.base.arrays import Floats
from vdfmu.base.errors import UsageError
from vdfmu.base.state_space import StateSpace
from vdfmu.compiler.unit.base import BaseUnit
from vdfmu.compiler.unit.evaluate import Evaluation, Traced, evaluation
from vdfmu.compiler.unit.interface import Interface
from vdfmu.compiler.unit.requirements import unmet
from vdfmu.compiler.unit.solver import ScipySolver
from vdfmu.compiler.unit.trace import argument_name


class Unit(BaseUnit):
    """Base of all units. A subclass declares variables and overrides some of the four methods.

    Its docstring is the unit's description: the first line says what it is, the rest is for its page.

    Parameters
    ----------
    robot : Robot, optional
        Robot of a unit that has variables for joints, or :class:`RobotParameters`.
    **values : array_like
        Parameters and inputs instead of their start values.

    Raises
    ------
    UnitError
        For a unit without the robot that it needs.
    UsageError
        For a name or a value that does not fit.
    """

    def simulate(
        self, inputs: Mapping[str, Any] | None = None, *, stop: float, step: float = 1e-3, tolerance: float = 1e-9
    ) -> Solution:
        """Run the unit from time 0 by scipy, with the parameters and inputs that are set.

        Parameters
        ----------
        inputs : mapping of str to value or function of time, optional
            Inputs that change, or are to have another value.
        stop, step : float [s]
            End, and time from one row to the next.
        tolerance : float
            Tolerance of the continuous states, relative and absolute.

        Returns
        -------
        Solution
            ``solution.t`` and ``solution["y"]``: inputs and outputs, (m, ...) each.

        Raises
        ------
        UsageError
            For an unknown input.
        UnitError
            If a method fails.
        """
        return simulate(self, inputs, stop=stop, step=step, tolerance=tolerance)

    def linearize(self, *, x: Any = None, t: float = 0.0) -> StateSpace:
        """Return the linear model at the inputs and parameters that are set, and a state.

        Parameters
        ----------
        x : (n_x,) array_like, optional
            Continuous states in the order of their declaration; default those at the start.
        t : float [s]

        Returns
        -------
        vdfmu.StateSpace
            ``A, B, C, D`` with the names of their rows and columns; outputs are the states and what follows from them.
        """
        return linearize(self, x=x, t=t)


Signal = Callable[[float], npt.ArrayLike] | npt.ArrayLike


class Solution(NamedTuple):
    """Times `t` (m,), and the values of inputs and outputs by name, (m, ...) each."""

    t: Floats
    signals: dict[str, Floats]

    def __getitem__(self, name: Any) -> Any:
        """Values of a variable."""
        return self.signals[name] if isinstance(name, str) else tuple(self)[name]


class _Driven(ScipySolver):
    """Motion with inputs that change in time."""

    def __init__(self, unit: Evaluation, drive: Callable[[float], None], tolerance: float) -> None:
        super().__init__(unit, tolerance=tolerance)
        self._drive = drive

    def drive(self, t: float) -> None:
        """Set the inputs at `t` [s]."""
        self._drive(t)

    def sample(self, t: float) -> None:
        """Update the sampled states by the inputs at `t` [s]."""
        self._drive(t)
        super().sample(t)

    def _rate(self, t: float, x: Floats) -> Floats:
        self._drive(t)
        return super()._rate(t, x)


def simulate(
    unit: BaseUnit,
    inputs: Mapping[str, Signal] | None = None,
    *,
    stop: float,
    step: float = 1e-3,
    tolerance: float = 1e-9,
) -> Solution:
    """Run a unit from time 0 by scipy, with its parameters and inputs as they are set; see :meth:`Unit.simulate`."""
    for name, value in (("stop", stop), ("step", step), ("tolerance", tolerance)):
        if not 0.0 < value < math.inf:
            raise UsageError(f"{name}: expected a positive finite number, got {value!r}.")
    if abs(stop / step - round(stop / step)) > 1e-6:
        raise UsageError(f"stop: expected a multiple of the step {step:g} s, got {stop:g} s.")
    run = _bound(unit)
    given = dict(inputs or {})
    known = run.interface.groups_of("input")
    unknown = [name for name in given if name not in known]
    if unknown:
        raise UsageError(
            f"{run.interface.name} has no input {', '.join(unknown)}. There are: {', '.join(known) or 'none'}."
        )
    places = {name: (run.group(name), signal) for name, signal in given.items()}

    def drive(t: float) -> None:
        for name, (place, signal) in places.items():
            value = np.ravel(signal(t) if callable(signal) else signal)
            if value.size not in (1, place.size):
                raise UsageError(f"input {name}: expected {place.size} numbers, got {value.size}.")
            place[:] = value

    motion = _Driven(run, drive, tolerance)
    count = round(stop / step)
    t: Floats = step * np.arange(count + 1, dtype=np.float64)
    shown = run.interface.groups_of("input", "output")
    rows: dict[str, list[Floats]] = {group: [] for group in shown}
    drive(0.0)
    run.start()
    for k in range(count + 1):
        if k:
            motion.move(float(t[k - 1]), float(t[k]))
        drive(float(t[k]))
        run.outputs()
        for group, where in shown.items():
            rows[group].append(run.memory[where].copy())
    shapes = {name: d.sizes(unit.n) for name, d in unit.declared.items()}
    return Solution(t, {group: np.array(row).reshape(-1, *shapes[group]) for group, row in rows.items()})


def linearize(unit: BaseUnit, *, x: npt.ArrayLike | None = None, t: float = 0.0) -> StateSpace:
    """Linear model of a unit; see :meth:`Unit.linearize`."""
    run = _bound(unit)
    run.memory[-1] = t
    run.start()
    if x is not None:
        if np.size(x) != run.x.size:
            raise UsageError(f"x: expected {run.x.size} numbers, got {np.size(x)}.")
        run.x[:] = np.ravel(x)
    run.outputs()
    return state_space(run)


def _bound(unit: BaseUnit) -> Evaluation:
    """Return the unit's methods on a memory that holds what is set on the instance."""
    interface = Interface(type(unit), unit.of_robot)
    run = evaluation(interface)
    for name, value in unit.store.items():
        if name in interface.groups:
            choices = unit.declared[name].choices
            run.group(name)[:] = choices.index(value) if choices else np.ravel(value)
    values = zip(interface, run.memory.tolist(), strict=False)
    wrong = [f"{v.name}: {problem}." for v, x in values if v.causality != "output" and (problem := v.problem(x))]
    if wrong := wrong or unmet(interface, run.memory):
        raise UsageError(f"{interface.name}: {' '.join(wrong)}")
    return run


def state_space(
    unit: Evaluation, inputs: Sequence[str] | None = None, outputs: Sequence[str] | None = None
) -> StateSpace:
    """Linearise a unit exactly where its memory is; UsageError if it is not traced.

    `inputs` and `outputs` are groups, whose columns and rows come one after the other; default all, the states first
    among the outputs.
    """
    table = unit.interface
    if not isinstance(unit, Traced):
        raise UsageError(f"{table.unit.__name__}: what cannot be traced has no derivatives.")
    inputs = list(table.groups_of("input")) if inputs is None else inputs
    outputs = list(table.groups_of("output")) if outputs is None else outputs
    J = _jacobian(unit, ["x", *map(argument_name, inputs)])
    places = np.arange(table.size)
    x, x_dot = places[table.states], places[table.derivatives]
    J[x, x] = 1.0  # of outputs that are states
    u, y = (np.concatenate([x[:0], *(places[table.groups[g]] for g in gs)]) for gs in (inputs, outputs))
    signals = (
        [(table.memory[i].name, table.memory[i].unit or "1", float(unit.memory[i])) for i in part] for part in (x, u, y)
    )
    found = StateSpace.of(J[np.ix_(np.concatenate([x_dot, y]), np.concatenate([x, u]))], *signals)
    still = ", ".join(dict.fromkeys(v.group for v in table.memory[table.sampled]))
    return replace(found, notes=(f"sampled states are taken as constant: {still}",)) if still else found


def _jacobian(unit: Evaluation, names: Sequence[str]) -> Floats:
    """Return the slopes of outputs and of derivatives by some arguments, (size, size) over the memory.

    Only the calls for the present values of the choices count.
    """
    table, functions = unit.interface, unit.interface.functions
    J = np.zeros((table.size, table.size))
    for call in filter(unit.takes, (*table.program.derivatives, *table.program.outputs)):
        function = functions.casadi_function(call.function)
        given = {name: unit.argument(name) for name in function.name_in()}
        product = functions.function(f"{call.function}_forward", **given)
        for name in (name for name in names if name in given):
            direction = product.args[f"d_{name}"]
            for column, i in enumerate(range(table.size)[table.arguments[name]]):
                direction[:] = 0.0
                direction[column] = 1.0
                product.run()
                for result in function.name_out():
                    J[table.arguments[result], i] = product.results[f"d_{result}"]
            direction[:] = 0.0
    return J
