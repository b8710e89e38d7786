"""The axes of a comparison: laws, arms, mismatches, motions. Another law, arm or mismatch is one line here."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from vdfmu.arm.dynamics import forward_kinematics
from vdfmu.arm.equations.trajectory import desired_motion
from vdfmu.arm.motion.polynomial import Motion
from vdfmu.arm.motion.read import KINDS
from vdfmu.arm.robot import Robot
from vdfmu.arm.units.laws.state_feedback import StateFeedback
from vdfmu.base.arrays import Floats
from vdfmu.base.errors import UsageError
from vdfmu.compiler.unit import JOINTS, Parameter
from vdfmu.study.analysis.lqr import StateGains, state_gains
from vdfmu.study.run.key_figures import length


@lru_cache(maxsize=8)
def _found(robot: Any, period: float, *weights: tuple[float, ...]) -> StateGains:
    q_pose, error, rate, torque = map(np.array, weights)
    return state_gains(robot, q_pose, error=error, rate=rate, torque=torque, step=period)


def _gain(name: str, unit: str, text: str) -> Parameter:
    def start(robot: Any, period: Any, q_pose: Any, error: Any, rate: Any, torque: Any) -> Any:
        weights = (tuple(np.asarray(one, float).tolist()) for one in (q_pose, error, rate, torque))
        return getattr(_found(robot, float(period), *weights), name)

    return Parameter(unit, (JOINTS, JOINTS), text, start=start, tunable=True)


class OptimalStateFeedback(StateFeedback):
    """Feedback of the whole state of links and rotors, with gravity, with gains that are optimal at q_pose.

    Each weight is the size of an error that counts as equally bad: of a link, a rotor, a motor; see
    :func:`vdfmu.study.analysis.lqr.state_gains`.
    """

    q_pose = Parameter("position", JOINTS, "pose at which the gains are optimal")
    error = Parameter("position", JOINTS, "error of the link", start=1e-3, minimum=1e-9)
    rate = Parameter("velocity", JOINTS, "velocity of the rotor divided by ell", start=0.02, minimum=1e-9)
    torque = Parameter("N.m", JOINTS, "torque of the motor, motor-side", start=0.01, minimum=1e-9)
    period = Parameter("s", text="communication step", start=1e-3, minimum=1e-6)
    K_q = _gain("K_q", "stiffness", "gain of the link positions, link-side")
    K_q_dot = _gain("K_q_dot", "damping", "gain of the link velocities, link-side")
    K_kappa = _gain("K_kappa", "stiffness", "gain of the rotor positions, link-side")
    K_kappa_dot = _gain("K_kappa_dot", "damping", "gain of the rotor velocities, link-side")


ARMS = ("manipulator_6dof", "ur5e_6dof", "panda_7dof", "scara_4dof", "kr300_6dof")
"""Arms that are compared by default: any robot will do."""
_HOLD = 0.5
"""Rest after a motion [s]."""
Bounds = tuple[float, float]
Start = Callable[[Mapping[str, Any], Robot], dict[str, Any]]


def _pd(rule: Mapping[str, Any], robot: Robot) -> dict[str, Any]:
    return {"K_p": rule["K_p"], "K_v": rule["K_v"]}


@dataclass(frozen=True)
class ComparedLaw:
    """A law: its unit, what of it is searched, as factors of the start, and the start."""

    unit: str
    """Name of the unit."""
    text: str
    vary: Mapping[str, Bounds]
    """Parameter to the smallest and largest factor of its start."""
    start: Start = _pd
    """From the gains of the rule for any arm, K_p and K_v (n,) link-side, and the robot to values of parameters."""
    searched: Any = None
    """Unit that is searched instead, whose other parameters follow from those that vary; default the unit."""
    kept: tuple[str, ...] = ()
    """Parameters of the unit that follow, which a run is given."""


_GAINS: dict[str, Bounds] = {"K_p": (0.1, 10.0), "K_v": (0.1, 3.0)}
_ALL = (
    ComparedLaw("controller", "PD with the exact feedforward", _GAINS),
    ComparedLaw("pd_gravity", "PD of the rotors with gravity", _GAINS),
    ComparedLaw("computed_torque", "computed torque of the rigid arm",
        {"k_p": (0.04, 10.0), "k_v": (0.1, 3.0), "K_v": (0.1, 3.0)},
        lambda rule, robot: {"k_p": 2500.0, "k_v": 100.0, "K_v": rule["K_v"]}),
    ComparedLaw("state_feedback", "optimal state feedback with gravity", {"error": (0.1, 10.0), "rate": (0.03, 10.0)},
        lambda rule, robot: {"error": 1e-3, "rate": 1e-3 * rule["K_p"] / rule["K_v"],
                             "torque": 1e-3 * rule["K_p"] / robot.ell},
        OptimalStateFeedback, ("K_q", "K_q_dot", "K_kappa", "K_kappa_dot")),
    ComparedLaw("joint_torque", "torque feedback around PD with gravity", {**_GAINS, "share": (0.4, 1.1)},
        lambda rule, robot: _pd(rule, robot) | {"share": 0.9}),
    ComparedLaw("disturbance_observer", "PD with the exact feedforward and a disturbance observer",
        {**_GAINS, "T_Q": (0.1, 10.0)}, lambda rule, robot: _pd(rule, robot) | {"T_Q": 0.05}),
    ComparedLaw("virtual_decomposition", "virtual decomposition with adaptation",
        {"Lambda": (0.1, 10.0), "k_vkappa": (0.1, 3.0), "gamma": (0.01, 100.0)},
        lambda rule, robot: {"Lambda": 0.1 * rule["K_p"] / rule["K_v"], "k_vkappa": rule["K_v"] / robot.ell,
                             "gamma": 1.0, "gamma_j": 0.1}),
)  # fmt: skip
LAWS = {law.unit: law for law in _ALL}


@dataclass(frozen=True)
class Mismatch:
    """A difference of the plant, or of what is between it and the law, unknown to the law."""

    text: str
    factors: Mapping[str, float] = field(default_factory=dict[str, float])
    """Fields of the plant's robot to factors, as of the table ``[plant_factors]`` of a scenario."""
    payload: float = 0.0
    """Mass at the tool, as a share of the mass of the links."""
    structure: str = "plain"
    """What is in the loop, see :data:`vdfmu.study.compare.cells.STRUCTURES`."""
    values: Mapping[str, float] = field(default_factory=dict[str, float])
    """Values of parameters, ``component.variable``."""
    noise: float = 0.0
    """Noise of the motors' torques, as a share of the largest of the nominal motion; runs differ with the seed."""


_FRICTION = ("f_c", "f_s", "f_v", "f_ck")
MISMATCHES = {
    "none": Mismatch("the plant that the law knows"),
    "payload": Mismatch("a payload of 10 % of the mass of the links", payload=0.1),
    "masses": Mismatch("masses and inertias of the links +20 %", {"mass": 1.2, "inertia": 1.2}),
    "stiffness": Mismatch("stiffness of the drives -30 %", {"K_f0": 0.7, "K_w0": 0.7}),
    "friction": Mismatch("friction +50 %", dict.fromkeys(_FRICTION, 1.5)),
    "encoder": Mismatch("encoders of 17 bits, on links and motors, velocities by differences", structure="sensed",
        values={"link_encoder.bits": 17.0, "motor_encoder.bits": 17.0}),
    "encoder_delay": Mismatch("encoders of 30 bits that are 1 ms late, velocities by differences", structure="sensed",
        values={"link_encoder.bits": 30.0, "motor_encoder.bits": 30.0, "link_encoder.T_d": 1e-3,
                "motor_encoder.T_d": 1e-3}),
    "torque_noise": Mismatch("white noise of the motors' torque, 2 % of the largest of the nominal motion",
        structure="driven", noise=0.02),
    "delay_1": Mismatch("torques that arrive one sample late", structure="driven",
        values={"communication.T_d": 1e-3}),
    "delay_2": Mismatch("torques that arrive two samples late", structure="driven",
        values={"communication.T_d": 2e-3}),
    "contact": Mismatch("a wall, 2 mm before the farthest place of the path", structure="contact"),
}  # fmt: skip


class PlannedMotion(NamedTuple):
    """A motion: tables of a scenario, with ``stop`` [s], and positions and derivatives (3 or more, m, n) at times."""

    tables: dict[str, Any]
    at: Callable[[Floats], Floats]


def point_to_point(robot: Robot, start: Floats, end: Floats, T: float) -> PlannedMotion:
    """Go along Eq. (57)."""
    tables = {"stop": T + _HOLD, "trajectory": {"q_start": start, "q_end": end, "T": T}}
    return PlannedMotion(tables, lambda t: np.stack([desired_motion(x, start, end, T)[:3] for x in t.tolist()], axis=1))


def circle(robot: Robot, start: Floats, end: Floats, T: float) -> PlannedMotion:
    """Move the tool round a circle, of a radius of 4 % of the arm's length, from `end` on."""
    p, _ = forward_kinematics(robot, end)
    problems: list[str] = []
    for axis in np.eye(3)[::-1]:  # horizontal, if the arm can
        inward = -(p - axis * (axis @ p))
        centre = p + 0.04 * length(robot) * inward / np.linalg.norm(inward)
        keys: dict[str, Any] = {"start": end, "centre": centre, "axis": axis, "orientation": "free"}
        try:
            return _played("circle", keys | _limits(start, end, T), robot)
        except UsageError as error:
            problems += str(error).splitlines()
    raise UsageError("\n".join(f"{robot.name}: {one}" for one in problems))


def time_optimal(robot: Robot, start: Floats, end: Floats, T: float) -> PlannedMotion:
    """Go through a corner in the shortest time, at speeds and accelerations of up to those of Eq. (57)."""
    return _played("fastest", {"points": [start, corner_of(start, end), end], **_limits(start, end, T)}, robot)


def corner_of(start: Floats, end: Floats) -> Floats:
    """Return the joints at the corner of the time-optimal motion, (n,): each a quarter of its way off, by turns."""
    return 0.5 * (start + end) + 0.25 * (end - start) * (-1.0) ** np.arange(len(start))


def _limits(start: Floats, end: Floats, T: float) -> dict[str, Any]:
    """Return the largest speeds and accelerations of Eq. (57)."""
    way = np.abs(end - start)
    return {"velocity": 2.0 * way / T, "acceleration": 2.0 * np.pi * way / T**2}


def _played(kind: str, keys: dict[str, Any], robot: Robot) -> PlannedMotion:
    found: Motion = KINDS[kind][0](**keys, robot=robot)
    tables = {"stop": round(found.duration + _HOLD, 3), "motion": {"kind": kind, **keys}}
    return PlannedMotion(tables, found.at)


MOTIONS: dict[str, Callable[[Robot, Floats, Floats, float], PlannedMotion]] = {
    one.__name__: one for one in (point_to_point, circle, time_optimal)
}
"""Motions from the start, end and duration [s] of the first motion of an arm, `reach`."""
