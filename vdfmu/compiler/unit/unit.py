"""The public base class of units: a :class:`BaseUnit` that also runs in Python."""

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
from vdfmu.compiler.unit.evaluate import Evaluation, evaluation, state_space, unmet
from vdfmu.compiler.unit.interface import Interface
from vdfmu.compiler.unit.solver import ScipySolver

Signal = Callable[[float], npt.ArrayLike] | npt.ArrayLike


class Solution(NamedTuple):
    """Times `t` (m,), and the values of inputs and outputs by name, (m, ...) each."""

    t: Floats
    signals: dict[str, Floats]

    def __getitem__(self, name: Any) -> Any:
        """Values of a variable."""
        return self.signals[name] if isinstance(name, str) else tuple(self)[name]


class Unit(BaseUnit):
    """Base class of all units. A subclass declares variables and overrides some of the four methods.

    Its docstring describes the unit: the first line is its description, the rest is shown on its page.

    Parameters
    ----------
    robot : Robot, optional
        Robot, for a unit with variables per joint or :class:`RobotParameters`.
    **values : array_like
        Values of parameters and inputs that replace their start values.

    Raises
    ------
    UnitError
        For a unit without the robot that it needs.
    UsageError
        For a name or a value that does not fit.
    """

    def simulate(
        self, inputs: Mapping[str, Signal] | None = None, *, stop: float, step: float = 1e-3, tolerance: float = 1e-9
    ) -> Solution:
        """Run the unit from time 0 with scipy, with the parameters and inputs that are set.

        Parameters
        ----------
        inputs : mapping of str to value or function of time, optional
            Inputs that vary, or that have a value other than the one set.
        stop, step : float [s]
            End time, and interval between rows.
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
        for name, value in (("stop", stop), ("step", step), ("tolerance", tolerance)):
            if not 0.0 < value < math.inf:
                raise UsageError(f"{name}: expected a positive finite number, got {value!r}.")
        count = round(stop / step)
        if abs(stop / step - count) > 1e-6:
            raise UsageError(f"stop: expected a multiple of the step {step:g} s, got {stop:g} s.")
        run = self._bound()
        signals, names = dict(inputs or {}), run.interface.groups_of("input")
        if unknown := [name for name in signals if name not in names]:
            raise UsageError(
                f"{run.interface.name} has no input {', '.join(unknown)}. There are: {', '.join(names) or 'none'}."
            )

        def drive(t: float) -> None:
            for name, signal in signals.items():
                value, place = np.ravel(signal(t) if callable(signal) else signal), run.group(name)
                if value.size not in (1, place.size):
                    raise UsageError(f"input {name}: expected {place.size} numbers, got {value.size}.")
                place[:] = value

        motion = ScipySolver(run, tolerance=tolerance, drive=drive)
        t: Floats = step * np.arange(count + 1, dtype=np.float64)
        shown = run.interface.groups_of("input", "output")
        rows: dict[str, list[Floats]] = {group: [] for group in shown}
        drive(0.0)
        run.start()
        motion.events.begin()
        for k in range(count + 1):
            if k:
                motion.move(float(t[k - 1]), float(t[k]))
            drive(float(t[k]))
            run.outputs()
            for group, where in shown.items():
                rows[group].append(run.memory[where].copy())
        shapes = {name: d.sizes(self.n) for name, d in self.declared.items()}
        return Solution(t, {group: np.array(row).reshape(-1, *shapes[group]) for group, row in rows.items()})

    def linearize(self, *, x: npt.ArrayLike | None = None, t: float = 0.0) -> StateSpace:
        """Return the linear model at the inputs and parameters that are set and at a state.

        Parameters
        ----------
        x : (n_x,) array_like, optional
            Continuous states in the order of their declaration; default: at the start.
        t : float [s]

        Returns
        -------
        vdfmu.base.state_space.StateSpace
            ``A, B, C, D`` with the names of their rows and columns; outputs are the states and the other outputs.
        """
        run = self._bound()
        run.memory[-1] = t
        run.start()
        if x is not None:
            if np.size(x) != run.x.size:
                raise UsageError(f"x: expected {run.x.size} numbers, got {np.size(x)}.")
            run.x[:] = np.ravel(x)
        run.outputs()
        return state_space(run)

    def _bound(self) -> Evaluation:
        """Return the methods on a memory with the values of the instance."""
        interface = Interface(type(self), self.of_robot)
        run = evaluation(interface)
        for name, value in self.store.items():
            if name in interface.groups:
                choices = self.declared[name].choices
                run.group(name)[:] = choices.index(value) if isinstance(value, str) else np.ravel(value)
        values = zip(interface, run.memory.tolist(), strict=False)
        wrong = [f"{v.name}: {problem}." for v, x in values if v.causality != "output" and (problem := v.problem(x))]
        if wrong := wrong or unmet(interface, run.memory):
            raise UsageError(f"{interface.name}: {' '.join(wrong)}")
        return run
