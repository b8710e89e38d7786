"""A unit by itself, as a Python object: its motion under given inputs, and its linear model."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from vdfmu.base.arrays import Floats
from vdfmu.base.errors import UsageError
from vdfmu.base.state_space import StateSpace
from vdfmu.compiler.unit.base import BaseUnit
from vdfmu.compiler.unit.evaluate import Evaluation, evaluation
from vdfmu.compiler.unit.interface import Interface
from vdfmu.compiler.unit.linear import state_space
from vdfmu.compiler.unit.requirements import unmet
from vdfmu.compiler.unit.solver import ScipySolver

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
