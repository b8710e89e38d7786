"""Plausibility: numbers that are allowed but outside the range of arms, each with the likely mistake.

All shipped robots, and all gears of the catalogue with all its motors, are within the limits; the usual mistakes,
factors of 1000, 180 / pi and ell, are outside.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np

from vdfmu.arm.equations.harmonic_drive import deformation_derivative
from vdfmu.arm.robot.robot import Robot
from vdfmu.arm.robot.robot_file import plain_notes
from vdfmu.base.arrays import Floats
from vdfmu.base.measure import JOINT_TYPES

_FAR = JOINT_TYPES["prismatic"].far
"""Length [m]."""
_NONE = 1e6
"""Position that importers and FMUs write for a missing stop."""
_HEAVY = 500.0
"""Mass of a link [kg]: the heaviest shipped one has 395 kg, a link of half a kilogram in grams is 500."""
_STRONG_GRAVITY = 30.0
"""Gravity [m/s2], above that of every planet and below 980 cm/s2."""
_LARGE = 5.0
"""Radius of gyration [m]: shipped links have 0.02 to 0.5; one of 10 cm is 100 with kg.mm2, 10 with kg.cm2."""
_ON_AXIS = 1e-3
"""Distance from an axis up to which a tool lies on it, relative to the arm's length: pi with a few digits results in
1e-3."""
_SOFT, _STIFF = 2.0, 150.0
"""Frequency [Hz] of a rotor on its drive's spring, and on only the flexspline. Shipped arms and the catalogue have 10
to 84 and 10 to 104, series elastic actuators 3 and more. With newton millimetres it is 32 times as high, with a missing
ell 5 to 16 times, with a stiffness per arc minute 58 times as low."""
_WEAK_MOTOR, _STRONG_MOTOR = 1e3, 2e6
"""Acceleration of a rotor [rad/s2] by the motor's largest torque. Shipped arms have 5e3 to 1e5, the catalogue up to
3e5. With a link-side torque it is ell times as high, with ell applied twice to the inertia ell times as low."""


class Plausibility(NamedTuple):
    """A quantity of each joint, its limits for arms, and the note beyond them."""

    size: Callable[[Robot], Floats]
    low: float
    high: float
    text: str
    """The text, with the quantity in braces."""
    if_low: str
    if_high: str


def _width(robot: Robot) -> Floats:
    return np.sqrt(np.linalg.eigvalsh(robot.inertia)[:, -1] / robot.mass)


def _length(robot: Robot) -> Floats:
    return np.maximum(np.abs(robot.offset).max(axis=1), np.abs(robot.centroid).max(axis=1))


def _frequency(robot: Robot, stiffness: Any) -> Floats:
    return np.sqrt(stiffness / (robot.I_m * robot.ell)) / (2.0 * math.pi)


def _acceleration(robot: Robot) -> Floats:
    return robot.tau_stall * robot.ell / robot.I_m if robot.limits else np.zeros(0)


_DRIVES = "Drives have 10 to 100 Hz: check the units of K_f0, K_w0 and I_m."
_MOTORS = "Motors reach 5e3 to 3e5: check tau_stall and I_m."
CHECKS = (
    Plausibility(lambda robot: robot.mass, 0.0, _HEAVY, "a mass of {:g} kg", "", "looks like grams. Give it in kg."),
    Plausibility(_length, 0.0, _FAR, "a length of {:g} m", "", "looks like mm. Give offset and centroid in m."),
    Plausibility(
        _width, 0.0, _LARGE, "the inertia of a body {:.3g} m wide", "", "looks like kg.cm2 or kg.mm2. Give it in kg.m2."
    ),
    Plausibility(
        lambda robot: _frequency(robot, 1.0 / deformation_derivative(robot, np.zeros(robot.n))), _SOFT, math.inf,
        "a drive that swings at {:.3g} Hz",
        f"looks like a stiffness per arc minute. {_DRIVES}", "",
    ),
    Plausibility(
        lambda robot: _frequency(robot, robot.K_f0), 0.0, _STIFF,
        "a rotor that oscillates on its flexspline at {:.4g} Hz",
        "", f"looks like K_f0 in N.mm/rad, I_m without its factor ell, or a simulator's armature. {_DRIVES}",
    ),
    Plausibility(
        _acceleration, _WEAK_MOTOR, _STRONG_MOTOR, "a motor that accelerates its rotor by {:.3g} rad/s2",
        f"looks like I_m with ell twice. {_MOTORS}",
        f"looks like tau_stall of the link side, or I_m without its factor ell. {_MOTORS}",
    ),
)  # fmt: skip


def robot_notes(robot: Robot) -> list[str]:
    """Return notes on the conversion of `stiffness` and `rotor_inertia`, and on likely mistakes: number, cause, fix."""
    return [*plain_notes(robot.sources), *doubts(robot)]


def doubts(robot: Robot) -> Iterator[str]:
    """Yield probable mistakes of units or signs: number, likely cause, fix."""
    yield from _gravity(robot)
    yield from _joints(robot)
    yield from tool_notes(robot)
    yield from _stops(robot)


def joints_without_tool(robot: Any) -> list[int]:
    """Return the joints whose rotation does not move the tool's position, counted from 1, the last joint first.

    These are the last joints, up to the first whose axis misses the tool and so moves it on a circle. `robot` needs
    `joint_types`, `offset`, `rotation` and `tool_offset`.
    """
    p, joints = np.asarray(robot.tool_offset), list[int]()
    length = np.linalg.norm([*robot.offset, p], axis=1).sum()
    for i in reversed(range(len(robot.joint_types))):
        if JOINT_TYPES[robot.joint_types[i]].slides or math.hypot(p[0], p[1]) > _ON_AXIS * length:
            break
        joints.append(i + 1)
        p = robot.offset[i] + robot.rotation[i] @ p
    return joints


def tool_notes(robot: Robot) -> Iterator[str]:
    """Yield a note if the tool lies on the axis of the last joint, and the robot does not declare it."""
    joints = [] if robot.tool_on_last_axis else joints_without_tool(robot)
    if joints:
        named = " and ".join(robot.joint_labels[i - 1] for i in joints[::-1])
        yield (
            f"the tool lies on the axis of joint {named} and does not move with it. A payload there has no torque "
            "about it. Give tool_offset, or tool_on_last_axis = true if the tool is a flange there."
        )


def _gravity(robot: Robot) -> Iterator[str]:
    size = float(np.abs(robot.gravity).max())
    if size > _STRONG_GRAVITY:
        yield f"gravity of {size:g} m/s2 looks like another unit. Earth has 9.81 m/s2."
    elif -robot.gravity.min() > max(1.0, robot.gravity.max()):
        k = int(robot.gravity.argmin())
        text = f"gravity[{k + 1}] = {robot.gravity[k]:g} m/s2 pulls towards +{'xyz'[k]}, because the vector points up"
        yield f"{text}. Write +9.81 on the axis that points up."


def _joints(robot: Robot) -> Iterator[str]:
    """Yield a note for each failed check, about its worst joint, and notes on the tool and the payload."""
    for check in CHECKS:
        sizes = check.size(robot)
        for out, i, why in (
            (sizes < check.low, sizes.argmin, check.if_low),
            (sizes > check.high, sizes.argmax, check.if_high),
        ):
            if out.any():
                yield f"joint {robot.joint_labels[i()]}: {check.text.format(sizes[i()])} {why}"
    for i in np.flatnonzero(np.abs(robot.tool_offset) > _FAR)[:1]:
        yield f"tool_offset[{i + 1}] = {robot.tool_offset[i]:g} m looks like mm. Give it in m."
    if robot.payload and robot.payload_mass > _HEAVY:
        yield f"payload: a mass of {float(robot.payload_mass):g} kg looks like grams. Give it in kg."


def _stops(robot: Robot) -> Iterator[str]:
    """Yield notes on the lower and the upper stops, each about the worst joint."""
    for name in ("q_min", "q_max") if robot.limits else ():
        values = getattr(robot, name)
        i = int(np.where(np.abs(values) < _NONE, np.abs(values), 0.0).argmax())
        if abs(values[i]) < _NONE:
            yield from position_notes(f"{name}[{i + 1}]", float(values[i]), robot.joint_types[i])


def position_notes(name: str, value: float, kind: str) -> Iterator[str]:
    """Yield a note if the position of a joint seems to be in degrees or millimetres."""
    joint = JOINT_TYPES[kind]
    if abs(value) > joint.far:
        unit, meant = joint.unit("position"), value / joint.shown.factor
        yield f"{name} = {value:.4g} {unit} looks like {joint.mistaken}. Write {meant:.4g} {unit}."


def speed_notes(name: str, value: float, kind: str) -> Iterator[str]:
    """Yield a note if a joint is faster than in any arm."""
    most, unit = JOINT_TYPES[kind].fastest, JOINT_TYPES[kind].unit("velocity")
    if abs(value) > most:
        yield (
            f"{name} = {value:.4g} {unit} is faster than arms, whose joints reach {0.75 * most:g} {unit}. "
            "Check positions, times and their units."
        )
