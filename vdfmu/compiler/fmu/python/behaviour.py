"""Behaviour of a unit over time: its methods on its memory and its solver, without FMI."""

from __future__ import annotations

from typing import Any

import numpy as np

from vdfmu.base.arrays import Floats
from vdfmu.base.errors import FmuError, KernelError, UnitError
from vdfmu.compiler.unit.evaluate import Traced, evaluation
from vdfmu.compiler.unit.integrator import Integrator
from vdfmu.compiler.unit.interface import Interface
from vdfmu.compiler.unit.requirements import unmet
from vdfmu.compiler.unit.solver import ScipySolver


class Behaviour:
    """A unit on its memory.

    Parameters
    ----------
    interface : Interface
    memory : (interface.size,) array
        Values of all variables; booleans and integers as floats.
    """

    def __init__(self, interface: Interface, memory: Floats) -> None:
        self.interface = interface
        self.memory = memory
        self._unit = evaluation(interface, memory)
        own = interface.has_states and isinstance(self._unit, Traced)
        self._solver = Integrator(self._unit) if own else ScipySolver(self._unit)
        self._saved = (*(("h",) if own else ()), *(("tolerance",) if interface.has_states else ()), "start")

    def check(self) -> list[str]:
        """Problems of the parameter values together; each alone is checked when it is set."""
        return unmet(self.interface, self.memory)

    def start(self, t: float, tolerance: float | None) -> None:
        """Set the states of the start time `t` [s] from the parameters.

        `tolerance` belongs to the experiment; the smaller of it and the unit's parameter holds.
        """
        if self.interface.has_states:
            own = float(self._unit.group("tolerance")[0])
            self._solver.tolerance = own if tolerance is None else min(own, tolerance)
        if isinstance(self._solver, Integrator):
            self._solver.h = 1e-4
        self._solver.start = self.memory[-1] = t
        self._unit.start()

    def outputs(self, t: float) -> None:
        """Calculate the outputs at time `t` [s] from inputs, parameters and states."""
        self.memory[-1] = t
        self._unit.outputs()

    def step(self, t: float, duration: float) -> None:
        """Move from `t` to `t + duration` [s] with the inputs held.

        A unit without a state calculates its outputs from the inputs at `t`.
        """
        before = self.memory.copy()
        try:
            self._solver.move(t, t + duration, duration)
            if self._unit.x.size and not np.isfinite(self._unit.x).all():
                raise KernelError(f"the states are not finite before t = {t + duration:.9g} s. Check the parameters.")
            self._unit.outputs()
        except (KernelError, UnitError) as error:
            self.memory[:] = before
            raise FmuError(str(error)) from None

    def state(self) -> Any:
        """Everything beyond the variables that decides the future, JSON-able."""
        return {name: getattr(self._solver, name) for name in self._saved}

    def restore(self, state: Any) -> None:
        """Restore what :meth:`state` returned; raise and change nothing for anything else."""
        for name, value in {name: float(state[name]) for name in self._saved}.items():
            setattr(self._solver, name, value)
