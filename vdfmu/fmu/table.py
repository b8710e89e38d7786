"""THE variable table: every variable of every unit, once.

The slaves, the model descriptions, the SSP and the documentation are made from it. FMI names are structured
and count from 1; Python indices count from 0; `Variable.name` is where the two meet.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from vdfmu.fmu.units import UNITS, unit_of
from vdfmu.kernel.structure import parameters
from vdfmu.model import Robot
from vdfmu.model.parameters import PARAMETERS, SPRING_KEYS
from vdfmu.model.read import POSITIVE
from vdfmu.model.scenario import SOLVER_TOLERANCE

__all__ = ["NO_LIMIT", "POSITIVE", "TABLES", "Variable"]

NO_LIMIT = 1e12
"""Start value of a limit that does not limit; FMI has no portable infinity."""


@dataclass(frozen=True)
class Variable:
    """One scalar variable.

    Attributes
    ----------
    group : str
        Name without indices, the paper's symbol.
    index : tuple of int
        Indices from 0; empty for a scalar.
    type : "Real", "Integer" or "Boolean"
    causality : "input", "output" or "parameter"
        Beside them a native unit has "local" derivatives and the "independent" time.
    variability : "continuous", "fixed" or "tunable"
    unit : str or None
    start : float, int, bool or None
        None for an output, whose value is calculated.
    minimum, maximum : float or None
    description : str
    choices : tuple of str
        Names of the values 0, 1, .. of an integer.
    """

    group: str
    index: tuple[int, ...]
    type: str
    causality: str
    variability: str
    unit: str | None
    start: Any
    minimum: float | None
    maximum: float | None
    description: str
    choices: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        """Structured FMI name, counted from 1: ``q[1]``, ``inertia[1,3,3]``, ``T``."""
        return self.group + (f"[{','.join(str(i + 1) for i in self.index)}]" if self.index else "")

    @property
    def display_unit(self) -> str | None:
        """First display unit of the unit, if it has any."""
        return next(iter(UNITS[self.unit].display), None) if self.unit else None

    def problem(self, value: Any) -> str | None:
        """Tell what is wrong with a value, as ``expected .., got ..``; None if nothing."""
        try:
            value = float(value)
        except (TypeError, ValueError):
            return f"expected a number, got {value!r}"
        unit = f" {self.unit}" if self.unit and self.unit != "1" else ""
        low, high = self.minimum, self.maximum
        if self.choices:
            if value in range(len(self.choices)):
                return None
            expected = " or ".join(f"{i} ({name})" for i, name in enumerate(self.choices))
        elif not math.isfinite(value):
            expected = "a finite number"
        elif low is not None and value < low:
            strict = low == POSITIVE and value <= 0.0
            expected = "a number above 0" if strict else f"at least {low:g}{unit}"
        elif high is not None and value > high:
            expected = f"at most {high:g}{unit}"
        else:
            return None
        return f"expected {expected}, got {value:.9g}{unit}"


# Group: quantity, description.
_DESIRED = {
    "q_d": ("position", "desired position"),
    "q_d_dot": ("velocity", "desired velocity"),
    "q_d_ddot": ("acceleration", "desired acceleration"),
    "q_d_dddot": ("jerk", "third derivative of the desired position"),
    "q_d_ddddot": ("snap", "fourth derivative of the desired position"),
}
_MEASURED = {
    "q": ("position", "position of the link"),
    "q_dot": ("velocity", "velocity of the link"),
    "kappa_dot": ("velocity", "velocity of the rotor divided by ell"),
}
_TAU_M = {"tau_m": ("N.m", "feedforward torque, motor-side")}
_KAPPA_DOT_D = {"kappa_dot_d": ("velocity", "desired velocity of the rotor divided by ell")}
_TAU_S = {"tau_s": ("torque", "spring torque, link-side")}
_TAU = {"tau": ("N.m", "motor torque, motor-side")}
_TAU_E = {"tau_e": ("torque", "feedback torque, link-side, Eq. (58)")}
_KAPPA = {"kappa": ("position", "position of the rotor divided by ell")}


def _joints(
    robot: Robot,
    groups: Mapping[str, tuple[str, str]],
    causality: str,
    start: float | None = None,
    minimum: float | None = None,
    variability: str = "continuous",
) -> list[Variable]:
    """One variable a joint for each group."""
    return [
        Variable(
            group, (i,), "Real", causality, variability, unit_of(quantity, robot.joint_types[i]),
            start, minimum, None, f"Joint {i + 1}: {text}",
        )
        for group, (quantity, text) in groups.items()
        for i in range(robot.n)
    ]  # fmt: skip


def _inputs(robot: Robot, groups: Mapping[str, tuple[str, str]]) -> list[Variable]:
    return _joints(robot, groups, "input", start=0.0)


def _outputs(robot: Robot, groups: Mapping[str, tuple[str, str]]) -> list[Variable]:
    return _joints(robot, groups, "output")


def _fixed(robot: Robot, group: str, quantity: str, text: str, start: float = 0.0) -> list[Variable]:
    return _joints(robot, {group: (quantity, text)}, "parameter", start, variability="fixed")


def _gain(robot: Robot, group: str, quantity: str, text: str, start: float) -> list[Variable]:
    """Tunable parameters, none below 0."""
    return _joints(robot, {group: (quantity, text)}, "parameter", start, 0.0, "tunable")


def _scalar(
    group: str,
    unit: str,
    start: float,
    text: str,
    minimum: float | None = None,
    maximum: float | None = None,
) -> Variable:
    """Make a fixed parameter without an index."""
    return Variable(group, (), "Real", "parameter", "fixed", unit, start, minimum, maximum, text)


def _choice(group: str, choices: tuple[str, ...], text: str) -> Variable:
    """Make a fixed integer parameter whose values have names; it starts with the first."""
    last = len(choices) - 1
    return Variable(group, (), "Integer", "parameter", "fixed", None, 0, 0, last, text, choices)


def _output(group: str, index: tuple[int, ...], unit: str, text: str) -> Variable:
    return Variable(group, index, "Real", "output", "continuous", unit, None, None, None, text)


def _wrench(group: str, text: str) -> list[Variable]:
    return [
        Variable(
            group, (k,), "Real", "input", "continuous", "N" if k < 3 else "N.m", 0.0, None, None,
            f"{'Force' if k < 3 else 'Moment'} {text} in {{O}}, axis {k % 3 + 1}",
        )
        for k in range(6)
    ]  # fmt: skip


def _robot_parameters(robot: Robot) -> list[Variable]:
    """Parameters of the robot that are not folded, in the order of the kernel's parameter vector."""
    return [_of_robot(robot, p.field, p.index) for p in parameters(robot)]


def _of_robot(robot: Robot, field: str, index: tuple[int, ...]) -> Variable:
    """One entry of a robot's array."""
    row = PARAMETERS[field]
    counted = ",".join(str(i + 1) for i in index)
    text = f"{row.description}{_PLACES[row.per_joint, len(row.shape)]} {counted}".rstrip()
    if row.per_joint and not row.shape:
        text = f"Joint {counted}: {row.description}"
    unit = row.unit(robot.joint_types[index[0]] if row.per_joint else "revolute")
    start = float(getattr(robot, field)[index])
    low = -row.largest if row.smallest is None else row.smallest
    return Variable(field, index, "Real", "parameter", "fixed", unit, start, low, row.largest, text)


_PLACES = {
    (False, 0): "", (False, 1): ", axis", (False, 2): ", (row, column)",
    (True, 0): "", (True, 1): ", (link, axis)", (True, 2): ", (link, row, column)",
}  # fmt: skip
"""Whether each joint has its own and number of axes, to what the indices are."""


def _trajectory(robot: Robot) -> list[Variable]:
    return [
        *_outputs(robot, _DESIRED),
        *_fixed(robot, "q_start", "position", "position before the motion"),
        *_fixed(robot, "q_end", "position", "position after the motion", 0.5),
        _scalar("T", "s", 10.0, "Duration of the motion", minimum=1e-6),
        _scalar("t_start", "s", 0.0, "Start of the motion"),
    ]


def _feedforward(robot: Robot) -> list[Variable]:
    mode = "0: inverse (exact inverse of the plant), 1: vdc (required velocities)"
    K_V = "gain K_B of the link in SI units, times the unit matrix, Eq. (50)"
    return [
        *_inputs(robot, _DESIRED | _MEASURED),
        *_wrench("F_e_d", "to be exerted on the surroundings"),
        *_outputs(robot, _TAU_M | _TAU_S | _KAPPA_DOT_D),
        _choice("mode", ("inverse", "vdc"), mode),
        *_gain(robot, "Lambda", "1/s", "gain of the required velocity, Eq. (12)", 1.0),
        *_gain(robot, "K_V", "1", K_V, 0.01),
        *_gain(robot, "k_vq", "damping_m", "gain of the link velocity, motor-side, Eq. (26)", 0.0001),
        *_gain(robot, "k_vkappa", "damping_m", "gain of the rotor velocity, motor-side, Eq. (27)", 0.05),
        *_robot_parameters(robot),
    ]


def _controller(robot: Robot) -> list[Variable]:
    desired = {group: _DESIRED[group] for group in ("q_d", "q_d_dot")}
    velocity = (
        "Derivative term; 0: kappa_dot_d - kappa_dot (collocated), 1: q_d_dot - q_dot (Eq. 58), "
        "2: q_d_dot - kappa_dot"
    )
    return [
        *_inputs(robot, desired | _MEASURED | _TAU_M | _KAPPA_DOT_D),
        *_outputs(robot, _TAU | _TAU_E),
        *_gain(robot, "K_p", "stiffness", "proportional gain, link-side, Eq. (58)", 1000.0),
        *_gain(robot, "K_v", "damping", "derivative gain, link-side, Eq. (58)", 20.0),
        *_gain(robot, "tau_max", "N.m", "limit of the motor torque, motor-side", NO_LIMIT),
        _choice("velocity", ("kappa_dot", "q_dot", "mixed"), velocity),
        *[v for v in _robot_parameters(robot) if v.group == "ell"],
    ]


def _estimator(robot: Robot) -> list[Variable]:
    limit = (
        "largest estimate, link-side; start: 10/c_f, where the flexspline is 100 times as stiff as at rest"
    )
    positions = {"q": _MEASURED["q"]} | _KAPPA
    printed = {
        "tau_f_hat": ("torque", "spring torque from the motor torque, link-side, Eq. (2)-(3) as printed")
    }
    consistent = {"tau_s_hat": ("torque", "spring torque from the positions alone, link-side")}
    limits = _gain(robot, "tau_hat_max", "torque", limit, 0.0)
    springs = [_of_robot(robot, field, (i,)) for field in SPRING_KEYS for i in range(robot.n)]
    return [
        *_inputs(robot, positions | _TAU),
        *_outputs(robot, consistent | printed),
        *[replace(v, start=10.0 / float(robot.c_f[v.index])) for v in limits],
        *springs,
    ]


def _plant(robot: Robot) -> list[Variable]:
    axes = range(3)
    R_O = "Rotation matrix of the end effector in {I}"
    equilibrium = (
        "Start the springs with the torque that holds the arm under F_e, and the rotors with the velocity of their "
        "links; otherwise from kappa_dot_0 and tau_s_0"
    )
    tolerance = (
        "Tolerance of the solver, relative and absolute in SI units; a smaller tolerance of the experiment "
        "replaces it"
    )
    return [
        *_inputs(robot, _TAU),
        *_wrench("F_e", "of the arm on its surroundings"),
        *_outputs(robot, _MEASURED | _TAU_S | _KAPPA),
        *[_output("p_O", (k,), "m", f"Position of the end effector in {{I}}, axis {k + 1}") for k in axes],
        *[_output("R_O", (j, k), "1", f"{R_O}, row {j + 1}, column {k + 1}") for j in axes for k in axes],
        _output("E_kin", (), "J", "Kinetic energy of links and rotors"),
        _output("E_pot", (), "J", "Potential energy of gravity"),
        _output("E_spring", (), "J", "Elastic energy of drives and end stops"),
        *_fixed(robot, "q_0", "position", "start position of the link"),
        *_fixed(robot, "q_dot_0", "velocity", "start velocity of the link"),
        Variable("equilibrium", (), "Boolean", "parameter", "fixed", None, True, None, None, equilibrium),
        *_fixed(robot, "kappa_dot_0", "velocity", "start velocity of the rotor, without equilibrium"),
        *_fixed(robot, "tau_s_0", "torque", "start spring torque, link-side, without equilibrium"),
        _scalar("tolerance", "1", SOLVER_TOLERANCE, tolerance, 1e-12, 1e-1),
        *_robot_parameters(robot),
    ]


TABLES = {
    "trajectory": _trajectory,
    "feedforward": _feedforward,
    "controller": _controller,
    "plant": _plant,
    "estimator": _estimator,
}
"""Unit to the function that lists its variables for a robot, in the order of their value references."""
