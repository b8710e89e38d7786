"""THE variable table: every variable of the four units, once.

The slaves, the model descriptions, the SSP and the documentation are made from it. FMI names are structured and count
from 1; Python indices count from 0; this file is where the two meet.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from vdfmu.errors import UsageError
from vdfmu.fmu.units import UNITS, unit_of
from vdfmu.kernel.structure import parameters
from vdfmu.model import Robot

__all__ = ["MODEL_NAMES", "NO_LIMIT", "UNIT_NAMES", "Interface", "Variable", "interface"]

MODEL_NAMES = {
    "trajectory": "Trajectory",
    "feedforward": "Feedforward",
    "controller": "PDController",
    "plant": "Plant",
}
UNIT_NAMES = tuple(MODEL_NAMES)
DESCRIPTIONS = {
    "trajectory": "Desired joint trajectory with four time derivatives, Eq. (57)",
    "feedforward": "Feedforward torque by virtual decomposition, Eq. (12)-(28) and (48)-(53)",
    "controller": "Proportional-derivative controller, Eq. (58)",
    "plant": "Serial manipulator with flexible harmonic-drive joints, Eq. (4)-(11), (29)-(47), (54)-(56)",
}

NO_LIMIT = 1e12
"""Start value of a limit that does not limit; FMI has no portable infinity."""
_POSITIVE = 1e-12  # smallest value of what must be positive: FMI has no strict bounds


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


class Interface:
    """Variables of one unit in the order of their value references, 0, 1, ...

    A group's variables lie next to each other: its values are a slice of the unit's memory.
    """

    def __init__(self, unit: str, robot: Robot, variables: Iterable[Variable], direct: dict, initial: dict) -> None:
        self.unit = unit
        self.robot = robot
        self.variables = tuple(variables)
        self._direct, self._initial = direct, initial

    def __iter__(self) -> Iterator[Variable]:
        return iter(self.variables)

    def __len__(self) -> int:
        return len(self.variables)

    @property
    def model_name(self) -> str:
        """Model identifier of the FMU."""
        return MODEL_NAMES[self.unit]

    @property
    def description(self) -> str:
        """One line on what the unit is."""
        return DESCRIPTIONS[self.unit]

    @cached_property
    def reference(self) -> dict[str, int]:
        """Name to value reference."""
        return {v.name: i for i, v in enumerate(self.variables)}

    @cached_property
    def groups(self) -> dict[str, slice]:
        """Group to its slice of value references, in order."""
        found: dict[str, slice] = {}
        for i, v in enumerate(self.variables):
            found[v.group] = slice(found[v.group].start if v.group in found else i, i + 1)
        return found

    def find(self, name: str) -> Variable:
        """Variable of a name.

        Raises
        ------
        UsageError
            If there is none; the message lists near names.
        """
        if name in self.reference:
            return self.variables[self.reference[name]]
        group = name.split("[")[0]
        near = [v.name for v in self if v.group == group] or list(self.groups)
        raise UsageError(f"{self.unit} has no variable {name!r}. There are: {', '.join(near)}.")

    def direct_dependencies(self, output: Variable) -> list[int]:
        """Value references of the inputs that an output depends on directly."""
        return self._resolve(output, self._direct.get(output.group, ()))

    def initial_dependencies(self, output: Variable) -> list[int]:
        """Value references of the inputs and parameters that an output depends on during initialization."""
        return self._resolve(output, self._initial[output.group])

    def _resolve(self, output: Variable, groups: Iterable[str]) -> list[int]:
        """References of the groups; of a group written ``q.`` only the element with the index of the output."""
        found: list[int] = []
        for group in groups:
            if group.endswith("."):
                found += [i for i, v in enumerate(self.variables) if (v.group, v.index) == (group[:-1], output.index)]
            elif group in self.groups:
                s = self.groups[group]
                found += range(s.start, s.stop)
        return sorted(found)


def interface(unit: str, robot: Robot) -> Interface:
    """Variables of a unit for a robot.

    Parameters
    ----------
    unit : "trajectory", "feedforward", "controller" or "plant"
    """
    if unit not in MODEL_NAMES:
        raise UsageError(f"There is no unit {unit!r}. There are: {', '.join(UNIT_NAMES)}.")
    return _TABLES[unit](robot)


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
_TAU_M = ("N.m", "feedforward torque, motor-side")
_TAU_S = ("torque", "spring torque, link-side")
_TAU = ("N.m", "motor torque, motor-side")

# Field of the robot: quantity, smallest value, description.
_ROBOT = {
    "gravity": ("m/s2", None, "gravity vector of Eq. (62) in {I}, upward, axis"),
    "tool_offset": ("m", None, "origin of the end-effector frame {O} in the last link frame, axis"),
    "offset": ("m", None, "origin of the link frame in the frame of the previous link, (link, axis)"),
    "centroid": ("m", None, "centre of mass in the link frame, (link, axis)"),
    "mass": ("kg", _POSITIVE, "mass of link"),
    "inertia": ("kg.m2", None, "inertia about the centre of mass, (link, row, column)"),
    "ell": ("ratio", 1.0, "reduction ratio"),
    "I_m": ("rotor inertia", _POSITIVE, "rotor inertia times ell, Eq. (56)"),
    "K_f0": ("stiffness", _POSITIVE, "flexspline stiffness, link-side, Eq. (2)"),
    "c_f": ("per torque", _POSITIVE, "flexspline stiffening, link-side, Eq. (2)"),
    "K_w0": ("N.m/rad", _POSITIVE, "wave generator stiffness, motor-side, Eq. (3)"),
    "c_w": ("1/(N.m)", _POSITIVE, "wave generator stiffening, motor-side, Eq. (3)"),
    "f_c": ("torque", 0.0, "Coulomb friction, link-side, Eq. (54)"),
    "f_s": ("torque", 0.0, "static friction, link-side, Eq. (54)"),
    "f_v": ("damping", 0.0, "viscous friction, link-side, Eq. (54)"),
    "v_s": ("velocity", _POSITIVE, "Stribeck velocity, Eq. (54)"),
    "eps": ("velocity", _POSITIVE, "velocity that regularises sgn as tanh(v/eps)"),
    "f_ck": ("N.m", 0.0, "Coulomb friction of the rotor, motor-side, Eq. (55)"),
    "theta_err_amplitude": ("position", 0.0, "amplitude of the kinematic error, link-side, Eq. (3)"),
    "theta_err_phase": ("rad", None, "phase of the kinematic error, Eq. (3)"),
}


def _joints(
    robot: Robot,
    group: str,
    causality: str,
    quantity: str,
    description: str,
    start: float | None = None,
    minimum: float | None = None,
    maximum: float | None = None,
    variability: str = "continuous",
) -> list[Variable]:
    """One variable a joint."""
    return [
        Variable(
            group, (i,), "Real", causality, variability, unit_of(quantity, robot.joint_types[i]),
            start, minimum, maximum, f"Joint {i + 1}: {description}",
        )
        for i in range(robot.n)
    ]  # fmt: skip


def _signals(robot: Robot, causality: str, table: dict[str, tuple[str, str]]) -> list[Variable]:
    start = 0.0 if causality == "input" else None
    return [v for group, (quantity, text) in table.items() for v in _joints(robot, group, causality, quantity, text, start)]


def _scalar(
    group: str, unit: str | None, start: Any, description: str, minimum: float | None = None,
    maximum: float | None = None, type: str = "Real", choices: tuple[str, ...] = (), variability: str = "fixed",
) -> Variable:  # fmt: skip
    """One parameter without an index."""
    return Variable(
        group, (), type, "parameter", variability, unit, start, minimum, maximum, description, choices
    )


def _robot_parameters(robot: Robot) -> list[Variable]:
    """Parameters of the robot that are not folded, in the order of the kernel's parameter vector."""
    found: list[Variable] = []
    for p in parameters(robot):
        quantity, minimum, text = _ROBOT[p.field]
        joint_type = robot.joint_types[p.index[0]] if p.field not in ("gravity", "tool_offset") else "revolute"
        text = f"Joint {p.index[0] + 1}: {text}" if len(p.index) == 1 and p.field not in ("gravity", "tool_offset") else (
            f"{text} {','.join(str(i + 1) for i in p.index)}"
        )
        start = float(getattr(robot, p.field)[p.index])
        found.append(
            Variable(p.field, p.index, "Real", "parameter", "fixed", unit_of(quantity, joint_type), start, minimum, None,
                     text[0].upper() + text[1:])
        )  # fmt: skip
    return found


def _trajectory(robot: Robot) -> Interface:
    fixed = {"variability": "fixed"}
    variables = [
        *_signals(robot, "output", _DESIRED),
        *_joints(robot, "q_start", "parameter", "position", "position before the motion", 0.0, **fixed),
        *_joints(robot, "q_end", "parameter", "position", "position after the motion", 0.5, **fixed),
        _scalar("T", "s", 10.0, "Duration of the motion", minimum=1e-6),
        _scalar("t_start", "s", 0.0, "Start of the motion"),
    ]
    timing = ("q_start.", "q_end.", "T", "t_start")
    return Interface("trajectory", robot, variables, {}, dict.fromkeys(_DESIRED, timing))


def _feedforward(robot: Robot) -> Interface:
    tunable = {"minimum": 0.0, "variability": "tunable"}
    listed = _robot_parameters(robot)
    gains = [
        *_joints(robot, "Lambda", "parameter", "1/s", "gain of the required velocity, Eq. (12)", 5.0, **tunable),
        *_joints(robot, "K_V", "parameter", "1", "gain K_B of the link in SI units, times the unit matrix, Eq. (50)", 0.1,
                 **tunable),
        *_joints(robot, "k_vq", "parameter", "damping_m", "gain of the link velocity, motor-side, Eq. (26)", 0.001,
                 **tunable),
        *_joints(robot, "k_vkappa", "parameter", "damping_m", "gain of the rotor velocity, motor-side, Eq. (27)", 0.01,
                 **tunable),
    ]  # fmt: skip
    variables = [
        *_signals(robot, "input", _DESIRED),
        *_signals(robot, "input", _MEASURED),
        *_signals(robot, "output", {"tau_m": _TAU_M, "tau_s": _TAU_S}),
        _scalar("mode", None, 0, "0: inverse (exact inverse of the plant), 1: vdc (required velocities)", 0, 1,
                type="Integer", choices=("inverse", "vdc")),
        *gains,
        *listed,
    ]  # fmt: skip
    direct = {"tau_m": (*_DESIRED, *_MEASURED), "tau_s": (*_DESIRED, *_MEASURED)}
    all_groups = tuple({v.group: None for v in variables if v.causality != "output"})
    return Interface("feedforward", robot, variables, direct, dict.fromkeys(direct, all_groups))


def _controller(robot: Robot) -> Interface:
    tunable = {"minimum": 0.0, "variability": "tunable"}
    desired = {k: _DESIRED[k] for k in ("q_d", "q_d_dot")}
    variables = [
        *_signals(robot, "input", desired | _MEASURED | {"tau_m": _TAU_M}),
        *_joints(robot, "tau", "output", *_TAU),
        *_joints(robot, "tau_e", "output", "torque", "feedback torque, link-side, Eq. (58)"),
        *_joints(robot, "K_p", "parameter", "stiffness", "proportional gain, link-side, Eq. (58)", 1000.0, **tunable),
        *_joints(robot, "K_v", "parameter", "damping", "derivative gain, link-side, Eq. (58)", 20.0, **tunable),
        *_joints(robot, "tau_max", "parameter", "N.m", "limit of the motor torque, motor-side", NO_LIMIT, **tunable),
        _scalar("velocity", None, 0, "Velocity of the derivative term; 0: kappa_dot (collocated), 1: q_dot (Eq. 58)", 0, 1,
                type="Integer", choices=("kappa_dot", "q_dot")),
        *[v for v in _robot_parameters(robot) if v.group == "ell"],
    ]  # fmt: skip
    inputs = tuple(f"{group}." for group in (*desired, *_MEASURED))
    direct = {"tau": (*inputs, "tau_m."), "tau_e": inputs}
    initial = {
        "tau": (*direct["tau"], "K_p.", "K_v.", "tau_max.", "velocity", "ell."),
        "tau_e": (*inputs, "K_p.", "K_v.", "velocity"),
    }
    return Interface("controller", robot, variables, direct, initial)


def _plant(robot: Robot) -> Interface:
    fixed = {"variability": "fixed"}
    axes = [Variable("p_O", (k,), "Real", "output", "continuous", "m", None, None, None,
                     f"Position of the end effector in {{I}}, axis {k + 1}") for k in range(3)]  # fmt: skip
    rotation = [Variable("R_O", (j, k), "Real", "output", "continuous", "1", None, None, None,
                         f"Rotation matrix of the end effector in {{I}}, row {j + 1}, column {k + 1}")
                for k in range(3) for j in range(3)]  # fmt: skip
    energies = [Variable(group, (), "Real", "output", "continuous", "J", None, None, None, text)
                for group, text in (("E_kin", "Kinetic energy of links and rotors"),
                                    ("E_pot", "Potential energy of gravity"),
                                    ("E_spring", "Elastic energy of the drives"))]  # fmt: skip
    wrench = [Variable("F_e", (k,), "Real", "input", "continuous", "N" if k < 3 else "N.m", 0.0, None, None,
                       f"{'Force' if k < 3 else 'Moment'} that the arm exerts on its surroundings in {{O}}, axis {k % 3 + 1}")
              for k in range(6)]  # fmt: skip
    listed = _robot_parameters(robot)
    variables = [
        *_joints(robot, "tau", "input", *_TAU, start=0.0),
        *wrench,
        *_signals(robot, "output", {**_MEASURED, "tau_s": _TAU_S, "kappa": ("position", "position of the rotor divided by ell")}),
        *axes,
        *rotation,
        *energies,
        *_joints(robot, "q_0", "parameter", "position", "start position of the link", 0.0, **fixed),
        *_joints(robot, "q_dot_0", "parameter", "velocity", "start velocity of the link", 0.0, **fixed),
        _scalar("equilibrium", None, True, "Start the springs with the torque that holds the arm, and the rotors with the "
                "velocity of their links; otherwise from kappa_dot_0 and tau_s_0", type="Boolean"),
        *_joints(robot, "kappa_dot_0", "parameter", "velocity", "start velocity of the rotor, without equilibrium", 0.0,
                 **fixed),
        *_joints(robot, "tau_s_0", "parameter", "torque", "start spring torque, link-side, without equilibrium", 0.0, **fixed),
        _scalar("tolerance", "1", 1e-6, "Tolerance of the solver, relative and absolute in SI units; a tolerance of the "
                "experiment replaces it", 1e-12, 1e-1),
        *listed,
    ]  # fmt: skip
    spring = ("q_0", "equilibrium", "tau_s_0", *{v.group: None for v in listed})
    velocity = ("q_dot_0.", "equilibrium", "kappa_dot_0.")
    geometry = ("q_0", "offset", "tool_offset")
    everything = ("q_0", "q_dot_0", "kappa_dot_0", *spring)
    initial = {
        "q": ("q_0.",), "q_dot": ("q_dot_0.",), "kappa_dot": velocity, "tau_s": spring, "kappa": spring,
        "p_O": geometry, "R_O": ("q_0",), "E_kin": everything, "E_pot": (*geometry, "gravity", "mass", "centroid"),
        "E_spring": spring,
    }  # fmt: skip
    return Interface("plant", robot, variables, {}, initial)


_TABLES: dict[str, Callable[[Robot], Interface]] = {
    "trajectory": _trajectory,
    "feedforward": _feedforward,
    "controller": _controller,
    "plant": _plant,
}


def start_values(table: Interface) -> np.ndarray:
    """Start values of all variables in the order of the value references; outputs are 0 until they are calculated."""
    return np.array([0.0 if v.start is None else float(v.start) for v in table])
