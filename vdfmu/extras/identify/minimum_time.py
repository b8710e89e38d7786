"""The fastest motion along a path through waypoints, by toppra, smoothed up to a continuous fourth derivative."""

from __future__ import annotations

import logging
from collections.abc import Callable
from importlib import import_module
from typing import Any

import numpy as np
import numpy.typing as npt
import scipy

from vdfmu.arm.drive.limits import motor_rectangle
from vdfmu.arm.dynamics import inverse_dynamics
from vdfmu.arm.motion.joint_space import check_points, limit
from vdfmu.arm.motion.polynomial import DEGREE, Motion, spline
from vdfmu.arm.robot import Robot
from vdfmu.base.arrays import Floats
from vdfmu.base.errors import UsageError
from vdfmu.base.option import checks_types

_GRID = 200
"""Points of toppra's grid between two waypoints."""
_FINE = 8000
"""Number of samples of toppra's result for smoothing."""
_SMOOTH = 0.02
"""Width of each of the three moving averages, relative to the duration."""
_KNOTS = 6
"""Knots per width of an average."""
_LOOKS = 1001
"""Number of samples of torques."""
_NEAR = 1e-3
"""Distance of points, relative to the largest one, below which a spline misses points by more than 1e-6 of the path."""
_RESOLVED = 1e-9
"""Smallest distance of points, relative to the largest position, at which the motion is smooth despite rounding."""
_STRETCH = 1.01
"""Factor by which the time is stretched repeatedly until the torques are within the limits."""
Load = Callable[[Floats, Floats, Floats], Floats]
"""Function from positions, speeds and accelerations to torques, link-side."""


@checks_types
def fastest(
    points: npt.ArrayLike,
    velocity: npt.ArrayLike | None = None,
    acceleration: npt.ArrayLike | None = None,
    *,
    robot: Robot | None = None,
    torque: npt.ArrayLike | None = None,
) -> Motion:
    """Return the nearly time-optimal motion along a path through points, at rest at both ends.

    The path of two points is straight, that of more points a natural spline of degree 5 over the distance. Along it
    toppra finds the shortest motion, whose acceleration jumps. The place on the path is then averaged three times over
    a fiftieth of the duration, which keeps the path and makes the motion continuous up to the fourth derivative. If the
    result exceeds a limit, the whole motion is slowed down. A note states the lost time.

    Parameters
    ----------
    points : (k, n) [rad or m]
    velocity, acceleration : float or (n,) [rad/s or m/s, rad/s2 or m/s2], optional
        Without `velocity` or `torque`, these limits follow from a robot's motors, including rotors: from the largest
        rectangle under each torque-speed line, up to the given speed.
    robot : Robot, optional
        For its motors, or for `torque`.
    torque : float or (n,) [N m or N], optional
        Limits of the torques for the rigid links, link-side.

    Raises
    ------
    UsageError
        Without toppra, for arguments that do not fit, or if no motion respects the limits, for example torques below
        the weight.
    """
    q = np.array(points, dtype=float)
    check_points(q)
    n = q.shape[1]
    speed, change, most = (
        limit(name, value, n)
        for name, value in (("velocity", velocity), ("acceleration", acceleration), ("torque", torque))
    )
    rotors, notes = np.zeros(n), ()
    if most is not None and robot is None:
        raise UsageError("fastest: torque limits need a robot. Give robot.")
    if robot is not None and robot.limits and robot.n == n and (speed is None or most is None):
        speed, tau = motor_rectangle(robot, np.inf if speed is None else speed)
        if most is None:
            most, rotors = robot.ell * tau, robot.ell * robot.I_m
            notes = (f"by the robot's motors: speeds up to {_list(speed)}, torques up to {_list(most)} link-side.",)
    if speed is None or (change is None and most is None):
        raise UsageError(
            "fastest: expected limits of velocity and acceleration, or a robot with [joints.limits], got neither."
        )
    length = np.linalg.norm(np.diff(q, axis=0), axis=1)
    least = max(_NEAR * length.max(), _RESOLVED * np.abs(q).max())
    if problems := [
        f"point {i + 2}: expected at least {least:.3g} from the point before, got {length[i]:.3g}. Leave it out."
        for i in np.flatnonzero(length < least)
    ]:
        raise UsageError("\n".join(problems))
    s = np.append(0.0, np.cumsum(length / length.sum()))
    path = _path(s, q)

    def load(q: Floats, q_dot: Floats, q_ddot: Floats) -> Floats:
        return inverse_dynamics(robot, q, q_dot, q_ddot) + rotors * q_ddot if robot is not None else q_ddot

    t, places, speeds = _shortest(path, s, speed, change, load, most)
    width = _SMOOTH * t[-1]
    fine = np.linspace(0.0, t[-1] + 3.0 * width, _FINE + 1)
    at = np.clip(fine - 1.5 * width, 0.0, t[-1])
    i = np.clip(np.searchsorted(t, at, "right") - 1, 0, len(t) - 2)
    slope = (speeds[i + 1] - speeds[i]) / (t[i + 1] - t[i])
    smooth = places[i] + (at - t[i]) * (speeds[i] + 0.5 * (at - t[i]) * slope)
    for _ in range(3):
        smooth = _mean(fine, smooth, width)
    knots = np.linspace(0.0, fine[-1], int(np.ceil(_KNOTS * fine[-1] / width)) + 1)
    motion = spline(knots, path(np.clip(np.interp(knots, fine, smooth), 0.0, 1.0))).fitted(speed, change)
    while most is not None and overload(load, motion, most) > 1.0:
        motion = motion.slower(_STRETCH)
        if motion.duration > 100.0 * t[-1]:
            raise UsageError("torque: the limits are too low to hold the arm along the path. Raise them.")
    share = 100.0 * (motion.duration / t[-1] - 1.0)
    note = (
        f"{motion.duration:.4g} s, {share:.1f} % longer than the shortest motion, whose acceleration is discontinuous."
    )
    return Motion(motion.knots, motion.coefficients, (note, *notes))


def _list(numbers: Floats) -> str:
    return ", ".join(f"{number:.4g}" for number in numbers)


def _path(s: Floats, q: Floats) -> Any:
    """Return the path over the distance: a line for two points, else a natural spline."""
    if len(q) == 2:
        return scipy.interpolate.make_interp_spline(s, q, k=1)
    free = [(order, np.zeros(q.shape[1])) for order in (3, 4)]
    return scipy.interpolate.make_interp_spline(s, q, k=DEGREE, bc_type=(free, free))


def _shortest(
    path: Any, s: Floats, velocity: Floats, acceleration: Floats | None, load: Load, torque: Floats | None
) -> tuple[Floats, Floats, Floats]:
    """Return times, places and speeds on the path of the shortest motion.

    toppra gets times relative to the shortest time at full speed, because its tolerances are absolute.
    """
    try:
        toppra: Any = import_module("toppra")
    except ImportError:
        raise UsageError("fastest: it needs toppra: pip install 'vdfmu[motion]'.") from None

    body = {"dof": len(path(0.0)), "path_interval": s[[0, -1]]} | {"__call__": lambda _, x, order=0: path(x, order)}
    shape = type("Path", (toppra.interpolator.AbstractGeometricPath,), body)()
    places = np.unique(np.concatenate([np.linspace(a, b, _GRID + 1) for a, b in zip(s, s[1:], strict=False)]))
    travel = np.abs(np.diff(path(places), axis=0)).sum(axis=0)
    T = float((travel / velocity).max())
    if acceleration is not None:
        T = max(T, float(np.sqrt(travel / acceleration).max()))
    asked = [toppra.constraint.JointVelocityConstraint(np.outer(velocity * T, [-1.0, 1.0]))]
    if acceleration is not None:
        asked.append(toppra.constraint.JointAccelerationConstraint(np.outer(acceleration * T**2, [-1.0, 1.0])))
    if torque is not None:
        asked.append(
            toppra.constraint.JointTorqueConstraint(
                lambda q, q_dot, q_ddot: load(q, q_dot / T, q_ddot / T**2),
                np.outer(torque, [-1.0, 1.0]),
                np.zeros(len(torque)),
            )
        )
    logger = logging.getLogger("toppra")
    level = logger.level
    logger.setLevel(logging.CRITICAL)  # points without a solution are an error below
    try:
        speeds = toppra.algorithm.TOPPRA(asked, shape, gridpoints=places).compute_parameterization(0.0, 0.0)[1]
    finally:
        logger.setLevel(level)
    if speeds is None or not np.all(np.isfinite(speeds)):
        raise UsageError(
            "fastest: no speed keeps the limits along the path: expected torques that hold the arm at each of its "
            "poses. Raise them, or choose other points."
        )
    pace = speeds[1:] + speeds[:-1]
    return T * np.append(0.0, np.cumsum(2.0 * np.diff(places) / pace)), places, speeds / T


def _mean(t: Floats, y: Floats, width: float) -> Floats:
    """Return the moving average over `width` of values that are held before the first and after the last time."""
    integral = scipy.integrate.cumulative_trapezoid(y, t, initial=0.0)

    def until(end: Floats) -> Floats:
        inside = np.interp(end, t, integral)
        return inside + y[0] * np.minimum(end - t[0], 0.0) + y[-1] * np.maximum(end - t[-1], 0.0)

    return (until(t + 0.5 * width) - until(t - 0.5 * width)) / width


def overload(load: Load, motion: Motion, torque: Floats) -> float:
    """Return the largest share of torque limits, (n,) [N m or N] link-side, that a motion uses."""
    q, q_dot, q_ddot = motion.at(np.linspace(0.0, motion.duration, _LOOKS))[:3]
    return float((np.abs(load(q, q_dot, q_ddot)) / torque).max())
