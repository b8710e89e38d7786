"""A first motion for any arm: a scenario whose gains come from one rule, within the limits of joints and motors."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from vdfmu.arm.drive.limits import motor_torque
from vdfmu.arm.dynamics import inverse_dynamics
from vdfmu.arm.equations.trajectory import desired_motion
from vdfmu.arm.robot import Robot, load_robot, robot_names
from vdfmu.base.arrays import Floats
from vdfmu.base.errors import UsageError
from vdfmu.base.files import temporary_folder, write_whole
from vdfmu.base.toml_file import locate, toml_value
from vdfmu.study.analysis.gains import Gains, arm_gains
from vdfmu.study.analysis.loops import SystemMargins, margins_along
from vdfmu.system.scenario import Scenario, load_scenario

_STEP = 1e-3
_FAR = {"revolute": 0.5, "prismatic": 0.1}
"""How far each joint moves [rad, m], where its end stops leave room."""
_MANY = 8
"""Joints from which each moves less, so that long arms bend and do not coil."""
_ROOM = 0.4
"""Share of the way to the end stop that a joint moves at most."""
_AWAY = 0.1
"""Distance from the end stops at which the motion starts, as a share of the distance between them."""
_TIMES = (1.0, 2.0, 4.0, 8.0, 16.0)
"""Durations [s] that are tried."""
_RESERVE = 0.7
"""Largest share of a motor's capacity that the motion takes."""
_POINTS = 21
_STRONG = f"It takes at most {100 * _RESERVE:g} % of what the motors can give."
_WEAK = "the motors are too weak to move or to hold the arm: see their torques"

_TEXT = """\
# A first motion of {robot}, written by vdfmu robot reach.
# SI units, angles in rad. It keeps clear of end stops. {motors}

name = {name}
description = {description}
robot = {written}
stop = {stop!r}
step = {step!r}
tolerance = 1e-8  # of the solver in the plant: gains are high, and errors in tables of three digits are small

[trajectory]
q_start = {start}
q_end = {end}
T = {T!r}

[controller]
# One rule for any arm: poles of each joint as far out as sampling and a sample of delay allow. Modulus margins of
# the joints by themselves: {margins}.
K_p = {K_p}  # N.m/rad or N/m, link-side
K_v = {K_v}  # N.m.s/rad or N.s/m, link-side, on the rotors' velocity
"""


class Reach(NamedTuple):
    """The written file, its gains, the margins of the whole arm along the motion, and notes on the motion."""

    path: Path
    gains: Gains
    margins: SystemMargins | None
    """None if they are not known: the last note says why."""
    notes: list[str]


def write_reach(robot: str | os.PathLike[str], out: str | os.PathLike[str]) -> Reach:
    """Write the scenario of a first motion of a robot, see :func:`~vdfmu.load_robot`, to a file."""
    path, place = Path(out), locate(robot, "robots")
    shipped = str(robot) in robot_names() and not Path(robot).exists()
    written = str(robot) if shipped else Path(os.path.relpath(place, path.parent)).as_posix()
    gains, notes = _write(load_robot(robot), place.stem, written, path)
    try:
        return Reach(path, gains, margins_along(path), notes)
    except UsageError as error:
        return Reach(path, gains, None, [*notes, f"margins of the whole arm: {error}"])


def reach_scenario(robot: Robot | str | os.PathLike[str] | None = None) -> Scenario:
    """Return the scenario that :func:`write_reach` writes, of a robot or its file, by default of the paper's arm."""
    if isinstance(robot, Robot):
        name = robot.name
    else:
        robot = robot or "manipulator_6dof"
        name, robot = locate(robot, "robots").stem, load_robot(robot)
    with temporary_folder("vdfmu_") as folder:
        path = Path(folder) / f"{name}_reach.toml"
        _, notes = _write(robot, name, name, path)
        return replace(load_scenario(path, robot), notes=tuple(notes), file="")


def _write(arm: Robot, name: str, written: str, path: Path) -> tuple[Gains, list[str]]:
    """Write the scenario; return its gains, and notes on its motion."""
    start, end, T, notes = _motion(arm)
    gains = arm_gains(arm, np.linspace(start, end, _POINTS), _STEP)
    text = _TEXT.format(
        robot=name, name=toml_value(path.stem), written=toml_value(written), stop=T + 0.5, step=_STEP, T=T,
        start=_list(start), end=_list(end), K_p=_list(gains.K_p), K_v=_list(gains.K_v),
        motors="; ".join(notes).capitalize() + "." if notes else _STRONG,
        margins=", ".join(f"{m:.2f}" for m in gains.modulus), description=toml_value(f"A first motion of {name}"),
    )  # fmt: skip
    write_whole(path, [text.encode()])
    return gains, notes


def _motion(robot: Robot) -> tuple[Floats, Floats, float, list[str]]:
    """Return start, end and duration of the motion, and notes on it."""
    start = np.zeros(robot.n)
    step = np.array([_FAR[kind] for kind in robot.joint_types]) * min(1.0, _MANY / robot.n)
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
    """Whether the motors give what the motion takes, with some reserve."""
    if not robot.limits:
        return T > _TIMES[0]  # no fast motion if the speeds are unknown
    motions = [desired_motion(t, start, end, T) for t in np.linspace(0.0, T, _POINTS)]
    q, q_dot, q_ddot = (np.array([motion[k] for motion in motions]) for k in range(3))
    tau = inverse_dynamics(robot, q, q_dot, q_ddot) / robot.ell + robot.I_m * q_ddot
    asked = tau / _RESERVE
    return bool(np.all(np.abs(motor_torque(robot, asked, q_dot) - asked) <= 1e-9 * np.abs(asked)))


def _list(numbers: Floats) -> str:
    return toml_value([float(f"{number:.4g}") for number in numbers])
