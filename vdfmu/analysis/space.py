"""The plant of an arm at rest at a pose as a linear system with names and units."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import Any

import numpy as np
import numpy.typing as npt

from vdfmu.analysis.linear import linearize as linearize_unit
from vdfmu.analysis.linear import slopes, without_dry_friction
from vdfmu.arrays import Floats
from vdfmu.equations.limits import motor_torque
from vdfmu.equations.plant import state_names
from vdfmu.errors import UsageError
from vdfmu.model.robot import Robot, robot_argument
from vdfmu.unit.evaluate import Evaluation, evaluation
from vdfmu.unit.interface import Interface
from vdfmu.units.plant import Plant

_INPUTS = ("tau", "F_e")
_OUTPUTS = ("kappa", "p_O")
"""Outputs beside the states."""


@dataclass(frozen=True)
class StateSpace:
    """``x_dot = A x + B u``, ``y = C x + D u`` of deviations from an equilibrium.

    Attributes
    ----------
    A, B, C, D : (n_x, n_x), (n_x, n_u), (n_y, n_x), (n_y, n_u) arrays
    states, inputs, outputs : tuple of str
        Names, such as ``q[1]``.
    state_units, input_units, output_units : tuple of str
    x, u, y : (n_x,), (n_u,), (n_y,) arrays
        The equilibrium.
    """

    A: Floats
    B: Floats
    C: Floats
    D: Floats
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    state_units: tuple[str, ...]
    input_units: tuple[str, ...]
    output_units: tuple[str, ...]
    x: Floats
    u: Floats
    y: Floats

    def to_scipy(self) -> Any:
        """Return a ``scipy.signal.StateSpace``, which has no names."""
        from scipy.signal import StateSpace as ScipyStateSpace

        return ScipyStateSpace(self.A, self.B, self.C, self.D)

    def to_control(self) -> Any:
        """Return a ``control.StateSpace`` of python-control, with the names.

        Raises
        ------
        UsageError
            If python-control is not installed.
        """
        try:
            control = import_module("control")
        except ImportError:
            raise UsageError(
                "to_control: expected python-control, which is not installed: pip install control."
            ) from None
        return control.ss(
            self.A, self.B, self.C, self.D, states=self.states, inputs=self.inputs, outputs=self.outputs
        )


def linearize(robot: Robot, at: npt.ArrayLike, *, dry: bool = False) -> StateSpace:
    """Linearise the plant of an arm at rest at a pose, exactly: by differentiation of its equations.

    Motors and springs hold the arm against gravity. States are q, q_dot, kappa_dot, tau_s, and those of options that
    the arm has; inputs the motor torques tau and the wrench F_e of the arm on its surroundings; outputs the states, the
    rotors' positions kappa and the end effector's p_O, all as of the unit Plant.

    Parameters
    ----------
    robot : Robot
    at : (n,) [rad or m]
        Positions of the joints.
    dry : bool
        Whether Coulomb and Stribeck friction stay, with the slope at rest of their regularisation (54). Viscous
        friction stays in any case.

    Raises
    ------
    UsageError
        For anything but a robot; for a wrong number of positions or one that is not finite, or an arm with limits that
        is beyond an end stop or heavier than its motors can hold.

    Examples
    --------
    >>> system = vdfmu.linearize(vdfmu.load_robot("planar_2dof"), at=(0.3, -0.5))
    >>> system.A.shape, system.inputs[:2], system.states[4:6], system.state_units[4:6]
    ((8, 8), ('tau[1]', 'tau[2]'), ('kappa_dot[1]', 'kappa_dot[2]'), ('rad/s', 'rad/s'))
    """
    plant = _at_rest(robot_argument(robot), at)
    if not dry:
        without_dry_friction(plant)
    A, B = linearize_unit(plant, _INPUTS)
    C = np.vstack([np.eye(len(A)), slopes(plant, plant.interface.program.outputs, _OUTPUTS, "x")])
    D = np.zeros((len(C), B.shape[1]))  # the plant has no direct feed-through
    states = state_names(robot)
    signals = [_signals(plant, groups) for groups in (states, _INPUTS, (*states, *_OUTPUTS))]
    names, units, values = zip(*signals, strict=True)
    return StateSpace(A, B, C, D, *names, *units, *values)


def _signals(plant: Evaluation, groups: Sequence[str]) -> tuple[tuple[str, ...], tuple[str, ...], Floats]:
    """Names, units and values of groups, one after the other."""
    table = plant.interface
    variables = [variable for group in groups for variable in table.variables[table.groups[group]]]
    names, units = tuple(v.name for v in variables), tuple(v.unit or "1" for v in variables)
    return names, units, np.concatenate([plant.group(group) for group in groups])


def _at_rest(robot: Robot, at: npt.ArrayLike) -> Evaluation:
    """Return the plant at rest at a pose, held by motors and springs."""
    q = np.asarray(at, dtype=float)
    if q.shape != (robot.n,) or not np.isfinite(q).all():
        raise UsageError(f"{robot.name}: expected {robot.n} finite positions of the joints, got {at!r}.")
    plant = evaluation(Interface(Plant, robot))
    plant.group("q_0")[:] = q
    plant.start()
    tau = plant.group("tau")
    tau[:] = plant.group("tau_s") / robot.ell
    if robot.limits:
        given = motor_torque(robot, tau, np.zeros(robot.n))
        problems = [
            f"joint {i + 1} at {q[i]:g}: expected {robot.q_min[i]:g} to {robot.q_max[i]:g}, between its end stops."
            for i in np.flatnonzero((q < robot.q_min) | (q > robot.q_max))
        ] + [
            f"joint {i + 1}: expected a motor torque of at most {abs(given[i]):.4g} N.m, it takes "
            f"{abs(tau[i]):.4g} N.m to hold the arm."
            for i in np.flatnonzero(np.abs(tau) > np.abs(given))
        ]
        if problems:
            raise UsageError("\n".join(f"{robot.name}: {problem}" for problem in problems))
    plant.outputs()
    return plant
