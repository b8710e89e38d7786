"""The energy that the coupling of controller and plant adds to a run or takes from it."""

from __future__ import annotations

from collections.abc import Container
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vdfmu.arm.robot import Robot
from vdfmu.engine.masters.observer import Tap
from vdfmu.engine.plan.grid import Grid
from vdfmu.system.reference.reference import BLOCK

_READ = ("plant.tau", "plant.kappa_dot", "controller.tau", "controller.kappa_dot")


class PowerBond(Tap):
    """Energy residual of the coupling at tau and kappa_dot, link-side [J]; printed is the sum of its absolute values.

    Torque and rotor velocity carry power from controller to plant. The plant takes up ``ell tau_in kappa_dot`` with the
    torque that it was given, the controller gives ``ell tau kappa_dot_in`` with the velocity that it was given; with
    exact coupling the two are the same. Each step begins with inputs that are the outputs they read, so the difference
    grows from zero over it, and half the final difference times the step is the energy that the coupling adds to the
    plant or takes from it (trapezoidal rule). Error control steps between the rows; then this is an estimate.
    """

    def __init__(self, robot: Robot) -> None:
        self._ell, self._energies = robot.ell, np.zeros((3, robot.n))
        self._names = [f"{group}[{i + 1}]" for group in _READ for i in range(robot.n)]
        self._places: NDArray[np.intp] | None = None
        self._count, self._times = 0, np.zeros(BLOCK + 1)
        self._block = np.zeros((BLOCK, len(self._names)))

    def rows(self, grid: Grid) -> Container[int]:
        """Begin a run. Its first row shows whether it has the signals."""
        self._places, self._count, self._times[0] = None, 0, grid.begin
        self._energies[:] = 0.0
        return range(grid.n + 1)

    def take(self, k: int, time: float, components: Any) -> None:
        """Take the row."""
        if k == 0:
            names, self._memory, places = components.exchange.reals(self._names)
            known = dict(zip(names, places, strict=True))
            self._places = np.array([known[name] for name in self._names]) if len(known) == len(self._names) else None
        if self._places is not None:
            self._memory.take(self._places, None, self._block[self._count], "clip")
            self._count += 1
            self._times[self._count] = time
            if self._count == BLOCK:
                self._add()

    def _add(self) -> None:
        count, (tau, kappa_dot, given, received) = self._count, np.split(self._block[: self._count], 4, axis=1)
        h = np.diff(self._times[: count + 1])[:, None]  # 0 at the first row, which ends no step
        self._times[0], self._count = self._times[count], 0
        taken = self._ell * tau * kappa_dot
        residual = 0.5 * h * (taken - self._ell * given * received)
        self._energies += np.sum([residual, np.abs(residual), np.abs(h * taken)], axis=1)

    def summary(self) -> dict[str, Any]:
        """Return the entry ``power_bond`` of a summary; nothing if the run lacks one of the signals.

        For each joint ``residual_energy_j``, the sum over the rows; ``residual_energy_abs_j``, the sum of the absolute
        values; ``exchanged_energy_j``, the same for the energy that the plant took up.
        """
        if self._places is None:
            return {}
        if self._count:
            self._add()
        names = ("residual_energy_j", "residual_energy_abs_j", "exchanged_energy_j")
        return {"power_bond": dict(zip(names, self._energies.tolist(), strict=True))}
