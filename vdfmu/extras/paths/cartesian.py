"""Lines and circles of the end effector, with inverse kinematics by Newton's method with minimum-norm steps."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import numpy.typing as npt
import scipy

from vdfmu.arm.dynamics import forward_kinematics, jacobian
from vdfmu.arm.motion.joint_space import limit
from vdfmu.arm.motion.polynomial import Motion, joined, spline
from vdfmu.arm.robot import Robot
from vdfmu.base.arrays import Floats
from vdfmu.base.errors import UsageError
from vdfmu.base.option import checks_types

Pose = tuple[Floats, Floats]
"""Position (3,) [m] and rotation (3, 3) of {O} in {I}."""
_RAMP = 1.0 / 3.0
"""Fraction of the time in which the end effector accelerates, and in which it decelerates."""
_FIRST, _MOST = 64, 2048
"""Initial and largest number of knots."""
_SAME = 1e-9
"""Difference by rounding between two solutions of one pose, at the worst non-singular Jacobian."""
_MOST_TURNS = 10
_STANDS = 1e-5
"""Length of a path [m] that may be an error of inverse kinematics."""
_LOOKS = 16
"""Number of samples of the end effector's speed per piece of a motion."""
_BETWEEN = 4
"""Number of points between two knots at which the path is solved and checked."""

_CLOSE = 1e-11
"""Error of a pose [m, rad] at which Newton's method ends: some hundred rounding errors."""
_PASSES = 30
_SINGULAR = 0.01
"""Smallest ratio of the Jacobian's singular values, with lengths divided by the arm's length. It changes by less than
this between poses half a per cent of a path apart, so no singular pose is skipped."""
_FAR = 0.5
"""Longest step [rad or m] of Newton's method far from a solution."""
_PULL = 0.5
"""Rate, per path, at which a redundant arm moves to the middle between its end stops."""


@checks_types
def line(
    robot: Robot,
    start: npt.ArrayLike,
    points: npt.ArrayLike,
    *,
    orientation: str | npt.ArrayLike | None = None,
    velocity: npt.ArrayLike | None = None,
    acceleration: npt.ArrayLike | None = None,
    speed: float | None = None,
    duration: float | None = None,
    dwell: float = 0.0,
    tolerance: float = 1e-6,
) -> Motion:
    """Return the motion whose end effector moves straight from point to point, stopping at each.

    Parameters
    ----------
    robot : Robot
    start : (n,) [rad or m]
        Pose of the joints at which it starts.
    points : (3,) or (k, 3) [m]
        Positions of {O} in {I}, one after the other.
    orientation : "keep", "free" or (3, 3), optional
        The rotation of {O} is kept, follows from the position, or turns to this rotation in {I} on the way to the last
        point, about one axis at a constant rate. The default is "keep" for six or more joints, else "free".
    velocity, acceleration : float or (n,) [rad/s or m/s, rad/s2 or m/s2], optional
        Limits of each joint.
    speed : float [m/s], optional
        Largest speed of the end effector.
    duration : float [s], optional
        Duration of each line; default: the shortest within the limits.
    dwell : float [s]
        Rest at each point.
    tolerance : float [m, and rad]
        Largest deviation from the path, checked at five times as many points as the motion has.

    Raises
    ------
    UsageError
        If a path is out of reach, exceeds the end stops or meets a singular pose, with place, joint and fix.
    """
    targets = np.atleast_2d(np.array(points, dtype=float))
    if targets.ndim != 2 or targets.shape[1] != 3 or not np.all(np.isfinite(targets)):
        raise UsageError(f"points: expected positions of three finite numbers, got {points}.")
    kind, R_end = _orientation(robot, orientation)
    parts: list[Motion] = []
    q = _start(robot, start)
    for i, target in enumerate(targets):
        where = f"line {i + 1}" if len(targets) > 1 else "line"
        R_1 = R_end if i == len(targets) - 1 else None
        part = _straight(robot, q, target, R_1, kind, where, tolerance)
        parts.append(_timed(robot, part, velocity, acceleration, speed, duration).dwelling(dwell))
        q = part.end
    return joined(parts)


@checks_types
def circle(
    robot: Robot,
    start: npt.ArrayLike,
    centre: npt.ArrayLike,
    axis: npt.ArrayLike = (0.0, 0.0, 1.0),
    *,
    angle: float = 2.0 * np.pi,
    orientation: str | None = None,
    velocity: npt.ArrayLike | None = None,
    acceleration: npt.ArrayLike | None = None,
    speed: float | None = None,
    duration: float | None = None,
    dwell: float = 0.0,
    tolerance: float = 1e-6,
) -> Motion:
    """Return the motion whose end effector moves in a circle about an axis, at rest at both ends.

    Other arguments and errors: see :func:`line`.

    Parameters
    ----------
    centre, axis : (3,) [m, 1], in {I}
        A point of the axis and its direction.
    angle : float [rad]
        Right-handed about the axis; at most ten turns.
    orientation : "keep", "turn" or "free", optional
        The rotation of {O} is kept, turns along, or follows from the position.
    """
    q = _start(robot, start)
    c, z = np.array(centre, dtype=float), np.array(axis, dtype=float)
    if c.shape != (3,) or z.shape != (3,) or not np.linalg.norm(z) > 0.0 or not np.all(np.isfinite([c, z])):
        raise UsageError(f"circle: expected centre and axis of three finite numbers, got {centre} and {axis}.")
    if not np.isfinite(angle) or angle == 0.0:
        raise UsageError(f"angle: expected a finite number other than 0, in rad, got {angle}.")
    if abs(angle) > _MOST_TURNS * 2.0 * np.pi:
        raise UsageError(
            f"angle: expected at most {_MOST_TURNS} turns, {_MOST_TURNS * 2.0 * np.pi:.4g} rad, got {angle:g} rad. As "
            f"degrees it would be {np.radians(angle):.4g} rad; join several circles for more turns."
        )
    kind = "turn" if orientation == "turn" else _orientation(robot, orientation)[0]
    p_0, R_0 = forward_kinematics(robot, q)
    z = z / np.linalg.norm(z)
    c = c + z * float(z @ (p_0 - c))
    radius = float(np.linalg.norm(p_0 - c))
    if radius <= tolerance:
        raise UsageError(f"centre: expected an axis that does not pass through the end effector's start at {p_0}.")

    def path(s: float) -> Pose:
        turned = scipy.spatial.transform.Rotation.from_rotvec(s * angle * z).as_matrix()
        return c + turned @ (p_0 - c), turned @ R_0 if kind == "turn" else R_0

    motion = _along(robot, q, path, kind, "circle", tolerance)
    return _timed(robot, motion, velocity, acceleration, speed, duration).dwelling(dwell)


def _start(robot: Robot, start: npt.ArrayLike) -> Floats:
    q = np.array(start, dtype=float)
    if q.shape != (robot.n,) or not np.all(np.isfinite(q)):
        raise UsageError(f"start: expected the positions of {robot.n} joints, got {start}.")
    return q


def _straight(
    robot: Robot, q: Floats, p_1: Floats, R_1: Floats | None, kind: str, where: str, tolerance: float
) -> Motion:
    """Return the motion straight to a position, with the rotation kept or turned to `R_1`."""
    p_0, R_0 = forward_kinematics(robot, q)
    turn = np.zeros(3) if R_1 is None else scipy.spatial.transform.Rotation.from_matrix(R_0.T @ R_1).as_rotvec()
    if np.linalg.norm(p_1 - p_0) <= tolerance and np.linalg.norm(turn) <= tolerance:
        raise UsageError(f"{where}: expected a point other than its start, got {p_1}.")

    def path(s: float) -> Pose:
        return p_0 + s * (p_1 - p_0), R_0 @ scipy.spatial.transform.Rotation.from_rotvec(s * turn).as_matrix()

    return _along(robot, q, path, kind, where, tolerance)


def _orientation(robot: Robot, orientation: str | npt.ArrayLike | None) -> tuple[str, Floats | None]:
    if orientation is None:
        return "keep" if robot.n >= 6 else "free", None
    if isinstance(orientation, str):
        if orientation not in ("keep", "free"):
            raise UsageError(f"orientation: expected keep, free or a rotation, got {orientation!r}.")
        return orientation, None
    R = np.array(orientation, dtype=float)
    # numbers in files have some six digits
    if R.shape != (3, 3) or not np.allclose(R @ R.T, np.eye(3), rtol=0.0, atol=1e-5) or np.linalg.det(R) < 0.0:
        raise UsageError(f"orientation: expected a rotation, three orthogonal rows of unit length, got {orientation}.")
    return "keep", scipy.spatial.transform.Rotation.from_matrix(R).as_matrix()


def _along(
    robot: Robot, start: Floats, path: Callable[[float], Pose], kind: str, where: str, tolerance: float
) -> Motion:
    """Return the motion along a path of poses, s from 0 to 1, over one second."""
    if not tolerance > 0.0:
        raise UsageError(f"tolerance: expected more than 0 m and rad, got {tolerance}.")
    rows = 3 if kind == "free" else 6
    knots = _FIRST
    while True:
        looks = np.linspace(0.0, 1.0, (_BETWEEN + 1) * knots + 1)
        poses = [path(float(s)) for s in _law(looks)]
        q = follow(robot, start, poses, rows, where, 100.0 * _law(looks))[:: _BETWEEN + 1]
        if np.allclose(q[-1], q[0], rtol=0.0, atol=_SAME):
            q[-1] = q[0]  # so that the motion can be repeated
        motion = spline(looks[:: _BETWEEN + 1], q)
        reached = zip(*forward_kinematics(robot, motion.at(looks)[0]), strict=True)
        off = max(np.abs(twist(pose, wanted)[:rows]).max() for pose, wanted in zip(reached, poses, strict=True))
        if off <= tolerance:
            return motion
        if knots == _MOST:
            raise UsageError(
                f"{where}: must stay within {tolerance:g} m or rad of the path, got {off:.3g} with {knots} knots. "
                "Raise the tolerance, or keep away from singular poses."
            )
        knots *= 2


def _timed(
    robot: Robot,
    motion: Motion,
    velocity: npt.ArrayLike | None,
    acceleration: npt.ArrayLike | None,
    speed: float | None,
    duration: float | None,
) -> Motion:
    """Return the motion over `duration`, or over the shortest time within the limits."""
    limits = limit("velocity", velocity, motion.n), limit("acceleration", acceleration, motion.n)
    if speed is not None and not 0.0 < speed < np.inf:
        raise UsageError(f"speed: expected more than 0 m/s, got {speed}.")
    shortest = 0.0 if speed is None else motion.duration * _largest_speed(robot, motion) / speed
    if duration is None and speed is None and (limits[0] is None or limits[1] is None):
        raise UsageError("expected a duration, a speed, or limits of velocity and acceleration, got none of them.")
    if duration is None:
        free = all(bound is None for bound in limits)
        if free and speed is not None and shortest * speed <= _STANDS:
            raise UsageError(
                "speed: expected a path along which the end effector moves, got one on which it only turns. Give a "
                "duration, or limits of velocity and acceleration."
            )
        fitted = motion.slower(shortest) if free else motion.fitted(*limits)
        return fitted.slower(max(1.0, shortest / fitted.duration))
    if duration < shortest:
        raise UsageError(f"duration: expected at least {shortest:.6g} s, because of the speed, got {duration:g} s.")
    return motion.fitted(*limits, duration)


def _largest_speed(robot: Robot, motion: Motion) -> float:
    """Return an upper bound of the end effector's speed [m/s].

    Between close samples a smooth speed rises by an eighth of its second difference; the whole difference is added.
    """
    t = np.linspace(0.0, motion.duration, _LOOKS * len(motion.coefficients) + 1)
    q, q_dot = motion.at(t)[:2]
    v = np.linalg.norm(np.einsum("tij,tj->ti", jacobian(robot, q)[:, :3], q_dot), axis=1)
    return float((v[1:-1] + np.abs(np.diff(v, 2))).max())


def _law(t: Floats) -> Floats:
    """Return the place on a path, 0 to 1, over a time from 0 to 1: at rest at the ends, with constant speed between.

    The speed rises over a third of the time, by a polynomial of degree 7 with three zero derivatives at its ends.
    """

    def begun(t: Floats) -> Floats:
        x = np.clip(t / _RAMP, 0.0, 1.0)
        ramp = x**5 * (7.0 + x * (-14.0 + x * (10.0 - 2.5 * x)))
        return _RAMP * ramp + np.maximum(t - _RAMP, 0.0)

    whole = 1.0 - _RAMP
    return np.where(t < 0.5, begun(t), whole - begun(1.0 - t)) / whole


def follow(robot: Robot, start: Floats, poses: Sequence[Pose], rows: int, where: str, percent: Floats) -> Floats:
    """Return the joint positions at poses of the end effector, (m, n), beginning near `start`.

    For a redundant arm this is the solution nearest to the previous one, drawn to the middle between end stops. With 3
    `rows` only the position counts, with 6 also the rotation. Poses out of reach, singular, or beyond end stops raise
    UsageError, with the path `where` and the place on it in percent.
    """
    q = start
    path: list[Floats] = []
    problems: dict[int, str] = {}
    length = float(np.linalg.norm(robot.offset, axis=-1).sum()) or 1.0
    scale = np.array([1.0 / length] * 3 + [1.0] * 3)[:rows]
    shares = np.diff(percent, prepend=percent[0]) / 100.0
    for i, (p, R) in enumerate(poses):
        place = f"{where}: {percent[i]:.3g} % along the path, at {np.array2string(p, precision=4)} m"
        if rows < robot.n and robot.limits:
            J = jacobian(robot, q)[:rows]
            pull = _PULL * shares[i] * (0.5 * (robot.q_min + robot.q_max) - q)
            q = q + pull - np.linalg.pinv(J) @ (J @ pull)
        q, off = _solved(robot, q, (p, R), rows)
        U, sigma, V = np.linalg.svd(scale[:, None] * jacobian(robot, q)[:rows])
        stuck = int(np.argmax(np.abs(V[len(sigma) - 1])))
        if off > _CLOSE:
            away = f"{off:.3g} m{' or rad' * (rows == 6)}"
            way = " Choose a nearer path, or let the orientation be free." if rows == 6 else " Choose a nearer path."
            raise UsageError(
                f"{place}: expected a pose within reach of the arm, got one that is {away} out of reach.{way}"
            )
        if sigma[-1] < _SINGULAR * sigma[0]:
            blocked = U[:, len(sigma) - 1]
            motion = "turn" if rows == 6 and np.linalg.norm(blocked[3:]) > np.linalg.norm(blocked[:3]) else "move"
            raise UsageError(
                f"{place}: expected a pose that lets the end effector {motion} in all directions, got a singular pose: "
                f"joint {stuck + 1}, at {q[stuck]:.4g}, would have to be {sigma[0] / max(sigma[-1], 1e-12):.3g} times "
                "as fast as others. Choose a path or a start away from it, or move there with joint waypoints."
            )
        for j in np.flatnonzero((q < robot.q_min) | (q > robot.q_max)) if robot.limits else ():
            problems.setdefault(
                int(j),
                f"{place}: expected joint {j + 1} between its end stops, {robot.q_min[j]:g} and {robot.q_max[j]:g}, "
                f"got {q[j]:.4g}.",
            )
        path.append(q)
    if problems:
        way = "Choose another start, such as the other elbow, or a shorter path."
        raise UsageError("\n".join(problems.values()) + f" {way}")
    return np.array(path)


def _solved(robot: Robot, q: Floats, pose: Pose, rows: int) -> tuple[Floats, float]:
    """Return the joint positions nearest to `q` for a pose, and the remaining error of the pose."""
    for _ in range(_PASSES):
        error = twist(forward_kinematics(robot, q), pose)[:rows]
        off = float(np.linalg.norm(error))
        if off <= _CLOSE:
            return q, off
        step = np.linalg.lstsq(jacobian(robot, q)[:rows], error, rcond=_SINGULAR * _SINGULAR)[0]
        q = q + step * min(1.0, _FAR / max(float(np.abs(step).max()), 1e-300))
    nearest = scipy.optimize.least_squares(
        lambda q: twist(forward_kinematics(robot, q), pose)[:rows], q, xtol=1e-12, ftol=1e-12
    )
    return nearest.x, float(np.linalg.norm(nearest.fun))


def twist(pose: Pose, target: Pose) -> Floats:
    """Return the displacement from one pose to another, (6,) [m, rad], in the frame of the first, linear part first."""
    (p, R), (p_t, R_t) = pose, target
    return np.concatenate([R.T @ (p_t - p), scipy.spatial.transform.Rotation.from_matrix(R.T @ R_t).as_rotvec()])
