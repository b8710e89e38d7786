"""Variables shared by several units: the motion of the joints, and the wrench of the end effector."""

from __future__ import annotations

from typing import Any

import numpy as np

from vdfmu.arm.equations.inverse_dynamics import AT_REST, Base
from vdfmu.arm.equations.trajectory import Desired, desired_motion
from vdfmu.arm.world.attachment import moving_base
from vdfmu.compiler.unit import JOINTS, Input, Parameter
from vdfmu.compiler.unit.declaration import NO_LIMIT

DESIRED = {
    "q_d": ("position", JOINTS, "desired position"),
    "q_d_dot": ("velocity", JOINTS, "desired velocity"),
    "q_d_ddot": ("acceleration", JOINTS, "desired acceleration"),
    "q_d_dddot": ("jerk", JOINTS, "third derivative of the desired position"),
    "q_d_ddddot": ("snap", JOINTS, "fourth derivative of the desired position"),
}
"""Unit, shape and description of the desired motion."""
MEASURED = {
    "q": ("position", JOINTS, "position of the link"),
    "q_dot": ("velocity", JOINTS, "velocity of the link"),
    "kappa": ("position", JOINTS, "position of the rotor divided by ell"),
    "kappa_dot": ("velocity", JOINTS, "velocity of the rotor divided by ell"),
    "tau_s": ("torque", JOINTS, "spring torque, link-side"),
}
"""Unit, shape and description of the measured motion and torque of joints."""

WRENCH = (3 * ("N",) + 3 * ("N.m",), 6)
"""Units and shape of a force and a moment."""
MASS = (3 * (3 * ("kg",) + 3 * ("kg.m",)) + 3 * (3 * ("kg.m",) + 3 * ("kg.m2",)), (6, 6))
"""Units and shape of a mass matrix of Eq. (60)."""
VELOCITY = (3 * ("m/s",) + 3 * ("rad/s",), 6)
"""Units and shape of a linear and an angular velocity."""
ACCELERATION = (3 * ("m/s2",) + 3 * ("rad/s2",), 6)
"""Units and shape of the acceleration of a point and an angular acceleration."""


def six(linear: str, angular: str) -> list[str]:
    """Descriptions of the parts of a 6-vector."""
    return [f"{linear if k < 3 else angular}, axis {k % 3 + 1}" for k in range(6)]


def wrench(text: str) -> Input:
    """Wrench at the end effector, (6,), in {O}."""
    return Input(*WRENCH, six(f"Force {text} in {{O}}", f"Moment {text} in {{O}}"))


def base_motion() -> tuple[Input, Input, Input]:
    """Rotation, velocity and acceleration of a moving base."""
    velocity = six("Velocity of the base in {S}", "Angular velocity of the base in {S}")
    acceleration = six("Acceleration of the origin of {S} in {S}", "Angular acceleration of the base in {S}")
    return (
        Input("1", (3, 3), "Rotation matrix of the base in {I}", start=np.eye(3), when="moving_base"),
        Input(*VELOCITY, velocity, when="moving_base"),
        Input(*ACCELERATION, acceleration, when="moving_base"),
    )


def base_of(unit: Any) -> Base:
    """Return the motion of the base from a unit's inputs, or a resting base if the robot has no moving base."""
    return moving_base(unit.R_S, unit.V_S[3:], unit.A_S) if unit.of_robot.moving_base else AT_REST


def tool_inputs() -> tuple[Input, Input, Input]:
    """Pose and velocity of the end effector, from a plant with coupled_tool."""
    return (
        Input("m", 3, "Position of the end effector in {I}, axis"),
        Input("1", (3, 3), "Rotation matrix of the end effector in {I}", start=np.eye(3)),
        Input(*VELOCITY, six("Velocity of the end effector in {O}", "Angular velocity of the end effector in {O}")),
    )


def gain(unit: str, text: str, start: float) -> Parameter:
    """Tunable parameter of each joint, at least 0."""
    return Parameter(unit, JOINTS, text, start=start, minimum=0.0, tunable=True)


def torque_limit() -> Parameter:
    """Limit of the motor torques, by default none."""
    return gain("N.m", "limit of the motor torque, motor-side", NO_LIMIT)


def small_motion(t: float, n: int, stop: float) -> Desired:
    """Return a small desired motion of `n` joints, for experiments that end at `stop`."""
    return desired_motion(t, np.zeros(n), 0.05 * (1.0 + np.arange(n) / n), 2.0 * stop)


def wave_wrench(t: float) -> Any:
    """Return a small wrench, for experiments."""
    return 0.1 * np.sin(2.0 * t + np.arange(6.0))
