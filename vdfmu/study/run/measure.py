"""Numbers of a run that need no reference: tracking, estimation, limits, coupling energy, accuracy."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from vdfmu.arm.equations.harmonic_drive import deformation_derivative
from vdfmu.arm.robot import Robot
from vdfmu.arm.units.feedforward import Feedforward
from vdfmu.base.arrays import Floats
from vdfmu.engine.algorithms import ALGORITHMS
from vdfmu.engine.plan.grid import Grid
from vdfmu.engine.results.recorder import Tap
from vdfmu.engine.results.results import Results
from vdfmu.study.run import summary as numbers
from vdfmu.study.run.case import RunCase, note
from vdfmu.study.run.summary import has_signals
from vdfmu.system.package.description import SystemDescription
from vdfmu.system.reference.reference import BLOCK
from vdfmu.system.scenario.values import robot_with

_SHOWN = 1e-4
"""Smallest fraction of the largest torque for a note on the inverse."""
_LOST = 1e-3
"""Smallest fraction of the largest spring torque for a note on the tolerance."""


def accuracy_notes(results: Results, system: SystemDescription) -> Iterator[str]:
    """Yield notes on where a run is less exact than the pages of its units state."""
    scenario = system.scenario
    for name, unit in system.resolved.units.items():
        values, part = system.values.get(name, {}), scenario.system.parts[name]
        if issubclass(unit, Feedforward) and scenario.robot is not None and not values.get("mode", 0):
            robot = robot_with(part.robot or scenario.known_robot, values)
            source = system.scenario.system.fed.get(f"{name}.q_d_dot", "")
            if robot.rotor_coupling and source:
                yield from _left_out(results, robot, name, source)
        if name in system.resolved.plants and "tolerance" in values and not values.get("solver", 0):
            yield from _phases(results, robot_with(part.robot or scenario.plant_robot, values), name, values)


def _left_out(results: Results, robot: Robot, name: str, q_d_dot: str) -> Iterator[str]:
    """Yield a note on the torque that the inverse omits over a step for an arm with coupled rotors.

    The rotors after a joint react with at most ``sum I_m (kappa_ddot - q_ddot)`` more than the inverse includes in the
    motion of the joint's own rotor. D' times this is missing in that motion, and I_m times its second derivative in the
    torque. Rows near rest are omitted, because the third derivative of q_d may jump there.
    """
    if not has_signals(results, f"{name}.tau_s", f"{name}.tau_m", f"{name}.kappa_dot_d", q_d_dot):
        return
    lacking, largest = np.zeros(robot.n), np.zeros(robot.n)
    for part in results.blocks(BLOCK, overlap=6):  # seven rows, with the third difference over the middle four
        largest = np.maximum(largest, np.abs(part[f"{name}.tau_m"]).max(axis=0))
        if len(part) < 7:
            continue
        motion, steps = part[q_d_dot], sliding_window_view(np.diff(part.time), 6)
        h = steps[:, 3]
        valid = sliding_window_view(np.any(motion, axis=1), 7).all(axis=1) & (np.ptp(steps, axis=1) <= 1e-6 * h)
        reaction = (
            np.abs(np.diff(robot.I_m * (part[f"{name}.kappa_dot_d"] - motion), 3, axis=0))[2:-1] / h[:, None] ** 3
        )
        after = np.cumsum(reaction[:, ::-1], axis=1)[:, ::-1] - reaction
        lost = robot.I_m * deformation_derivative(robot, part[f"{name}.tau_s"][3:-3]) * after
        lacking = np.maximum(lacking, lost[valid].max(axis=0, initial=0.0))
    share = lacking / np.maximum(largest, 1e-300)
    i = int(share.argmax())
    if share[i] > _SHOWN:
        yield (
            f"{name}: mode inverse omits {lacking[i]:.2g} of {largest[i]:.3g} N.m of motor {i + 1} in a step, because "
            "its rotors are coupled and the motion is fast. See docs/model.md, 'Where the inverse is not exact'."
        )


def _phases(results: Results, robot: Robot, name: str, values: Mapping[str, Any]) -> Iterator[str]:
    """Yield a note if springs oscillate for so long that their torque at an instant depends on the tolerance.

    The energy of a vibration drifts by ``2 tol^(5/4)`` per cycle, because the local error of Rodas4 is of order 5,
    while its error control keeps one of order 4 at the tolerance. The frequency of a stiffening spring changes with the
    energy, by up to half the relative change, so the phase drifts with the square of the number of cycles. Viscous
    friction damps a vibration within ``2 I_m ell / f_v``.
    """
    if not has_signals(results, f"{name}.tau_s"):
        return
    largest, squares, rows = np.zeros(robot.n), np.zeros(robot.n), 0
    for part in results.blocks(BLOCK, overlap=2):
        tau_s = part[f"{name}.tau_s"]
        largest = np.maximum(largest, np.abs(tau_s).max(axis=0))
        bends = np.diff(tau_s, 2, axis=0)  # for noise of size 1 it is the square root of 6
        squares, rows = squares + np.sum(bends * bends, axis=0) / 6.0, rows + len(bends)
    slack, taut = (deformation_derivative(robot, tau_s) for tau_s in (0.0 * largest, largest))
    inertia = robot.I_m * robot.ell
    frequency = np.sqrt(1.0 / (taut * inertia)) / (2.0 * math.pi)
    kept = np.minimum(results.time[-1] - results.time[0], 2.0 * inertia / np.maximum(robot.f_v, 1e-300))
    cycles: Floats = frequency * kept
    swing = np.sqrt(squares / max(rows, 1))
    phase = 0.5 * math.pi * (1.0 - taut / slack) * cycles**2 * float(values["tolerance"]) ** 1.25
    lost = phase * swing / np.maximum(largest, 1e-300)
    i = int(lost.argmax())
    if lost[i] > _LOST:
        yield (
            f"{name}: spring {i + 1} oscillates by {swing[i]:.2g} of {largest[i]:.3g} N.m, over {cycles[i]:.2g} "
            f"cycles of "
            f"up to {frequency[i]:.2g} Hz. Tolerance {values['tolerance']:g} moves their phase by {phase[i]:.1g} rad "
            f"or more, and with it tau_s and E_spring at an instant. Compare with {name}.tolerance = 1e-9."
        )


POWER = ("plant.tau", "plant.kappa_dot", "controller.tau", "controller.kappa_dot")


class PowerBond(Tap):
    """Coupling energy error at tau and kappa_dot, link-side [J], printed as the sum of its absolute values.

    Torque and rotor velocity transmit power from controller to plant. The plant absorbs ``ell tau_in kappa_dot`` with
    the torque at its input, the controller delivers ``ell tau kappa_dot_in`` with the velocity at its input; with exact
    coupling the two are equal. At the start of each step inputs equal the outputs that they read, so the difference
    grows from zero over the step, and half the final difference times the step is the energy that the coupling adds to
    the plant or removes from it (trapezoidal rule). With error control, which steps between the rows, this is an
    estimate.
    """

    def __init__(self, robot: Robot) -> None:
        self._ell, self._energies = robot.ell, np.zeros((3, robot.n))
        self.wanted = [f"{group}[{i + 1}]" for group in POWER for i in range(robot.n)]
        self._columns: list[int] = []

    def begin(self, grid: Grid, names: Sequence[str]) -> None:
        """Begin a run."""
        self._columns = [names.index(name) for name in self.wanted] if len(names) == len(self.wanted) else []
        self._time, self._energies[:] = grid.begin, 0.0

    def block(self, times: Floats, values: Floats) -> None:
        """Add the energies of rows."""
        if not self._columns:
            return
        tau, kappa_dot, transmitted, received = np.split(values[:, self._columns], 4, axis=1)
        h = np.diff(times, prepend=self._time)[:, None]  # 0 at the first row, where no step ends
        self._time = times[-1]
        taken = self._ell * tau * kappa_dot
        residual = 0.5 * h * (taken - self._ell * transmitted * received)
        self._energies += np.sum([residual, np.abs(residual), np.abs(h * taken)], axis=1)

    def summary(self) -> dict[str, Any]:
        """Return the entry ``power_bond`` of a summary; nothing if a signal is missing in the run.

        For each joint ``residual_energy_j``, the sum over the rows; ``residual_energy_abs_j``, the sum of the absolute
        values; ``exchanged_energy_j``, the same for the energy absorbed by the plant.
        """
        if not self._columns:
            return {}
        names = ("residual_energy_j", "residual_energy_abs_j", "exchanged_energy_j")
        return {"power_bond": dict(zip(names, self._energies.tolist(), strict=True))}


class Measures:
    """The numbers of a run. `taps` read along the run, and `add` adds all numbers to the summary after it."""

    def __init__(self, case: RunCase) -> None:
        self._case = case
        self._bond = PowerBond(case.scenario.robot) if case.scenario.robot else None

    @property
    def taps(self) -> list[Tap]:
        """Functions that read along the run."""
        return [] if self._bond is None else [self._bond]

    def add(self, results: Results) -> None:
        """Add the numbers to the summary of the results."""
        case, summary = self._case, results.summary
        scenario = case.scenario
        for text in (*numbers.start_notes(results, scenario), *accuracy_notes(results, case.system)):
            summary["notes"].append(text)
            note(case.options, text)
        summary["real_time_factor"] = scenario.stop / summary["wall_s"]
        if scenario.robot is not None:
            tau_m = scenario.system.fed.get("controller.tau_m", "")
            summary |= numbers.tracking_errors(results, scenario.robot, case.arm_limits, tau_m)
        summary |= numbers.time_at_limits(results, case.arm_limits)
        if has_signals(results, "plant.tau_s", "estimator.tau_s_hat", "estimator.tau_f_hat"):
            summary |= numbers.estimation_errors(results, ALGORITHMS[scenario.algorithm].substeps)
        summary |= {"paper": dict(scenario.paper)} | (self._bond.summary() if self._bond else {})
