"""A first motion for any arm: a scenario within the limits of joints and motors, with gains from a rule."""

from __future__ import annotations

import os
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from vdfmu.arm.drive.limits import motor_torque
from vdfmu.arm.dynamics import inverse_dynamics, mass_matrix
from vdfmu.arm.equations.harmonic_drive import deformation_derivative
from vdfmu.arm.equations.trajectory import desired_motion
from vdfmu.arm.robot import Robot, load_robot
from vdfmu.base.arrays import Floats
from vdfmu.base.errors import UsageError
from vdfmu.base.files import temporary_folder, write_whole
from vdfmu.base.measure import JOINT_TYPES
from vdfmu.base.state_space import Linear, held
from vdfmu.base.toml_file import locate, toml_value
from vdfmu.engine.linear.loops import Loop, margins_of
from vdfmu.system.scenario import Scenario, load_scenario

_DAMPING = 0.5
_DAMPED, _LIGHT = 2.0, np.geomspace(0.003, 2.0, 12).tolist()
"""Decay rates [1/s] of a joint with the friction of its drive, and of the modes of joints with little friction. Without
friction, a delayed loop excites the spring's mode with any gains. With little friction, the delay margin of a mode is
smallest if the peak of its gain is just above 1, and the decay rate at which this happens differs between modes."""
_SAMPLES = 1.1
"""Smallest delay margin of a single joint, in samples, with which all joints together have at least one sample."""
_STABLE = 1e-3
"""Smallest modulus margin of a loop that only needs to be stable."""
_FIRST, _FALL, _LAST = 0.4, 0.9, 1e-4
"""Values of N = K_v step / J to try: the first, the factor between them, and the last."""
_INERTIAS = 5
"""Number of link inertias, from the smallest to the largest, with which a joint's loop is tested."""


class Gains(NamedTuple):
    """Gains (n,), link-side, and the modulus margin of each single joint."""

    K_p: Floats
    K_v: Floats
    modulus: Floats


def joint_gains(
    J: float, K: float, inertias: Floats, step: float, margin: float = 0.5, name: str = "the joint", fall: float = 0.0
) -> tuple[float, float, float]:
    """Return the gains K_p and K_v of one joint, and its modulus margin, which is at least `margin`.

    The joint has the rotor inertia `J` [kg m2 or kg] and the stiffness `K` [N m/rad or N/m], link-side, and moves the
    `inertias` (m,) of links; messages have its `name`. Its friction falls with the rotor's speed by at most `fall` [N m
    s/rad or N s/m], a negative damping that reduces K_v. UsageError if no gains in the search have the margin.

    The loop has the margin, and a delay margin of one sample, both without friction and with falling friction. Without
    friction it also has the margin with an additional sample of delay. If no gains fulfil all of this, the loop with
    the additional sample needs only half the margin, and if that fails too, it only needs to be stable.
    """
    tries = np.geomspace(inertias.min(), inertias.max(), _INERTIAS)[:, None, None]
    falls = [fall, 0.0] if fall else [0.0]
    rotor, spring = np.array([J]), np.array([K])
    damped, light = (
        [_plant(rotor, M, spring, f, decay, step) for f in falls for M in tries for decay in decays]
        for decays in ((_DAMPED,), _LIGHT)
    )
    hardest = light[:1]  # first the one with which other gains failed, for a quick answer
    for late in (margin, margin / 2.0, _STABLE):
        N = _FIRST
        while N >= _LAST and (K_v := N * J / step) > fall:
            K_p = min((K_v - fall) ** 2 / (4 * _DAMPING**2 * (J + inertias.max())), K / 4)
            feedback = -np.array([[K_p, 0.0, 0.0, K_v]])  # on q, kappa, q_dot, kappa_dot
            loops = [Loop(plant, feedback, step, slow=0.0) for plant in damped]
            _, modulus, delay = margins_of(loops)
            later = margins_of([loop.later() for loop in loops[-_INERTIAS:]])[1]
            if modulus.min() >= margin and later.min() >= late and delay.min() >= _SAMPLES * step:
                for plants in (hardest, light):
                    _, _, delay = margins_of([Loop(plant, feedback, step) for plant in plants])
                    if delay.min() < _SAMPLES * step:
                        hardest = [plants[int(delay.min(axis=1).argmin())]]
                        break
                else:
                    return K_p, K_v, float(modulus.min())
            N *= _FALL
        if not fall:
            break
    raise UsageError(
        f"{name}: no gains have a modulus margin of {margin:g} and a delay margin of a sample at a step of {step:g} s. "
        "Use a smaller step or margin, or check the joint's drive, inertia and friction."
    )


def arm_gains(robot: Robot, q: npt.ArrayLike, step: float, margin: float = 0.5) -> Gains:
    """Return an arm's gains for a controller that uses the rotors' velocity.

    `q`, (m, n) [rad or m], are positions of the arm, along its motion or throughout the workspace. The inertia that a
    joint moves is calculated with all other joints held, and with all of them free. UsageError if a single joint cannot
    have the `margin`.
    """
    M = mass_matrix(robot, np.atleast_2d(np.asarray(q, dtype=float)))
    held = np.diagonal(M, axis1=1, axis2=2)
    free = 1.0 / np.diagonal(np.linalg.inv(M), axis1=1, axis2=2)
    seen: Floats = np.concatenate([held, free]).astype(float)
    J, K = _rotors(robot)
    fall = steepest_fall(robot) if robot.friction == "lumped" else np.zeros(robot.n)  # else no rotor feels it
    each = [
        joint_gains(float(J[i]), float(K[i]), seen[:, i], step, margin, f"joint {label}", float(fall[i]))
        for i, label in enumerate(robot.joint_labels)
    ]
    return Gains(*np.array(each).T)


def steepest_fall(robot: Robot) -> Floats:
    """Steepest fall of Eq. (54) with speed, at v_s / sqrt(2), minus f_v: (n,) [N m s/rad or N s/m], 0 if it rises."""
    return np.maximum((robot.f_s - robot.f_c) / robot.v_s * np.sqrt(2.0 / np.e) - robot.f_v, 0.0)


def _plant(J: Floats, M: Floats, K: Floats, fall: float, decay: float, step: float) -> Linear:
    """Model links with mass matrix M on springs on n rotors, sampled: states q, kappa, q_dot, kappa_dot, (n,) each.

    Inputs are the rotors' torques, link-side.
    """
    n, none, unit = len(J), np.zeros((len(J), len(J))), np.eye(len(J))
    of_links, of_rotors = np.linalg.solve(M, np.diag(K)), np.diag(K / J)
    A = np.block(
        [
            [none, none, unit, none],
            [none, none, none, unit],
            [-of_links, of_links, none, none],
            [of_rotors, -of_rotors, none, np.diag(fall / J)],
        ]
    ) - decay * np.eye(4 * n)
    return held(Linear(A, np.vstack([none, none, none, np.diag(1.0 / J)])), step)


def whole_arm(robot: Robot, q: Floats, gains: Gains, step: float) -> tuple[float, float]:
    """Return the smallest modulus margin of an arm at rest at `q`, (m, n) [rad or m], and the delay margin in samples.

    The loop of each joint is opened with all others closed. There is no friction, only light damping of all modes.
    """
    J, K = _rotors(robot)
    feedback = -np.hstack([np.diag(gains.K_p), np.zeros((robot.n, 2 * robot.n)), np.diag(gains.K_v)])
    _, modulus, delay = margins_of(
        [Loop(_plant(J, M, K, 0.0, decay, step), feedback, step) for M in mass_matrix(robot, q) for decay in _LIGHT]
    )
    return float(modulus.min()), float(delay.min() / step)


def _rotors(robot: Robot) -> tuple[Floats, Floats]:
    """Return the inertias of the rotors and the stiffness of their springs at rest, link-side, (n,) each."""
    return robot.I_m * robot.ell, 1.0 / np.asarray(deformation_derivative(robot, np.zeros(robot.n)), dtype=float)


_STEPS = (1e-3, 5e-4, 2.5e-4)
"""Communication steps [s] to try."""
_MANY = 8
"""Number of joints from which strokes are reduced, so that long arms bend but do not coil up."""
_ROOM = 0.4
"""Largest stroke of a joint as a fraction of its distance from the end stop."""
_AWAY = 0.1
"""Distance from the end stops at which the motion starts, as a fraction of the distance between them."""
_TIMES = (1.0, 2.0, 4.0, 8.0, 16.0)
"""Durations [s] to try."""
_RESERVE = 0.7
"""Largest share of a motor's capacity that the motion may use."""
_POINTS = 21
_STRONG = f"It uses at most {100 * _RESERVE:g} % of the capacity of the motors."
_WEAK = "the motors are too weak to move or to hold the arm: see their torques"

_TEXT = """\
# A first motion of {robot}, written by vdfmu robot reach.
# SI units, angles in rad. The motion stays away from end stops. {motors}

name = {name}
description = {description}
robot = {written}
stop = {stop!r}
step = {step!r}  # the largest of {steps} for which the rule finds gains
tolerance = {tolerance!r}  # of the solver in the plant: high gains make the errors in the tables small

[trajectory]
q_start = {start}
q_end = {end}
T = {T!r}

[controller]
# One rule for any arm: the poles of each joint are as fast as sampling, one sample of delay and friction that falls
# with speed allow, with a delay margin of at least a sample. Modulus margins of the single joints: {margins}.
K_p = {K_p}  # N.m/rad or N/m, link-side
K_v = {K_v}  # N.m.s/rad or N.s/m, link-side, on the rotors' velocity
"""


def reach_scenario(robot: Robot | str | os.PathLike[str] | None = None) -> Scenario:
    """Return the scenario that ``vdfmu robot reach`` writes for a robot or its file, the paper's arm by default."""
    if isinstance(robot, Robot):
        name = robot.name
    else:
        robot = robot or "manipulator_6dof"
        name, robot = locate(robot, "robots").stem, load_robot(robot)
    with temporary_folder("vdfmu_") as folder:
        path = Path(folder) / f"{name}_reach.toml"
        _, notes = write_scenario(robot, name, name, path)
        return replace(load_scenario(path, robot), notes=tuple(notes), file="")


def write_scenario(arm: Robot, name: str, written: str, path: Path) -> tuple[Gains, list[str]]:
    """Write the scenario; return its gains, and notes on its motion."""
    start, end, T, notes = _motion(arm)
    step, gains = _gains(arm, np.linspace(start, end, _POINTS))
    text = _TEXT.format(
        robot=name,
        name=toml_value(path.stem),
        written=toml_value(written),
        stop=T + 0.5,
        step=step,
        T=T,
        tolerance=1e-8 if step == _STEPS[0] else 1e-9,
        steps=", ".join(f"{1e3 * s:g}" for s in _STEPS) + " ms",
        start=_list(start),
        end=_list(end),
        K_p=_list(gains.K_p),
        K_v=_list(gains.K_v),
        motors="; ".join(notes).capitalize() + "." if notes else _STRONG,
        margins=", ".join(f"{m:.2f}" for m in gains.modulus),
        description=toml_value(f"A first motion of {name}"),
    )
    write_whole(path, [text.encode()])
    return gains, notes


def _gains(arm: Robot, q: Floats) -> tuple[float, Gains]:
    """Return the largest step [s] whose gains have the margins with all joints together, or the last, and the gains."""
    for step in _STEPS[:-1]:
        with suppress(UsageError):
            gains = arm_gains(arm, q, step)
            if whole_arm(arm, q[:: _POINTS // 2], gains, step)[1] >= 1.0:
                return step, gains
    return _STEPS[-1], arm_gains(arm, q, _STEPS[-1])


def _motion(robot: Robot) -> tuple[Floats, Floats, float, list[str]]:
    """Return start, end and duration of the motion, and notes on it."""
    start = np.zeros(robot.n)
    step = np.array([JOINT_TYPES[kind].stroke for kind in robot.joint_types]) * min(1.0, _MANY / robot.n)
    if robot.limits:
        away = _AWAY * np.minimum(robot.q_max - robot.q_min, 10.0)
        start = np.round(np.clip(start, robot.q_min + away, robot.q_max - away), 3)
        up, down = robot.q_max - start, start - robot.q_min
        step = np.where(up >= down, 1.0, -1.0) * np.minimum(step, _ROOM * np.maximum(up, down))
    end = np.round(start + step, 3)
    T = next((T for T in _TIMES if _within(robot, start, end, T)), None)
    if T is None:
        return start, end, _TIMES[-1], [_WEAK]
    return start, end, T, []


def _within(robot: Robot, start: Floats, end: Floats, T: float) -> bool:
    """Return whether the motors can deliver the torques of the motion with some reserve."""
    if not robot.limits:
        return T > _TIMES[0]  # no fast motion if the speeds are unknown
    motions = [desired_motion(t, start, end, T) for t in np.linspace(0.0, T, _POINTS)]
    q, q_dot, q_ddot = (np.array([motion[k] for motion in motions]) for k in range(3))
    tau = inverse_dynamics(robot, q, q_dot, q_ddot) / robot.ell + robot.I_m * q_ddot
    asked = tau / _RESERVE
    return bool(np.all(np.abs(motor_torque(robot, asked, q_dot) - asked) <= 1e-9 * np.abs(asked)))


def _list(numbers: Floats) -> str:
    return toml_value([float(f"{number:.4g}") for number in numbers])
