"""Inverse kinematics along a path of the end effector: Newton's method from point to point, by least norms."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy

from vdfmu.arm.dynamics import forward_kinematics, jacobian
from vdfmu.arm.robot import Robot
from vdfmu.base.arrays import Floats
from vdfmu.base.errors import UsageError

_CLOSE = 1e-11
"""Error of a pose [m, rad] at which Newton's method ends: some hundred roundings."""
_TURNS = 30
_SINGULAR = 0.01
"""Smallest singular value of the Jacobian over the largest, lengths over that of the arm. It changes by less from one
pose to the next, half a per cent of a path apart, so that none is stepped over."""
_FAR = 0.5
"""Longest step [rad or m] of Newton's method, which far from a solution has none of its own."""
_PULL = 0.5
"""Rate, over the path, at which a redundant arm goes to the middle between its end stops."""


def follow(
    robot: Robot, start: Floats, poses: Sequence[tuple[Floats, Floats]], rows: int, where: str, percent: Floats
) -> Floats:
    """Return the positions of the joints at poses of the end effector, (m, n), the first of which is that at `start`.

    A redundant arm has many solutions; this takes the nearest to the one before; with end stops, drawn to the middle
    between them. A pose is the position (3,) [m] and the rotation (3, 3) of {O} in {I}; with 3 `rows` the
    position counts alone, with 6 both. Messages name the path `where` and how far along it a pose is, in percent.

    Raises
    ------
    UsageError
        For poses out of reach, singular ones, and those beyond end stops: the first of each kind and joint.
    """
    q = start
    found: list[Floats] = []
    problems: dict[int, str] = {}
    length = float(np.linalg.norm(robot.offset, axis=-1).sum()) or 1.0
    scale = np.array([1.0 / length] * 3 + [1.0] * 3)[:rows]
    shares = np.diff(percent, prepend=percent[0]) / 100.0
    for i, (p, R) in enumerate(poses):
        place = f"{where}: at {percent[i]:.3g} % of it, at {np.array2string(p, precision=4)} m"
        if rows < robot.n and robot.limits:
            J = jacobian(robot, q)[:rows]
            pull = _PULL * shares[i] * (0.5 * (robot.q_min + robot.q_max) - q)
            q = q + pull - np.linalg.pinv(J) @ (J @ pull)
        q, off = _solved(robot, q, (p, R), rows)
        U, sigma, V = np.linalg.svd(scale[:, None] * jacobian(robot, q)[:rows])
        stuck = int(np.argmax(np.abs(V[len(sigma) - 1])))
        if off > _CLOSE:
            away = f"{off:.3g} m{' or rad' * (rows == 6)} away"
            way = " Choose a nearer path, or let the orientation be free." if rows == 6 else " Choose a nearer path."
            raise UsageError(f"{place}: expected a pose that the arm reaches, got one that is {away}.{way}")
        if sigma[-1] < _SINGULAR * sigma[0]:
            blocked = U[:, len(sigma) - 1]
            what = "turn" if rows == 6 and np.linalg.norm(blocked[3:]) > np.linalg.norm(blocked[:3]) else "move"
            raise UsageError(
                f"{place}: expected a pose in which the end effector can {what} in all directions, got a singular one: "
                f"joint {stuck + 1}, at {q[stuck]:.4g}, would have to be {sigma[0] / max(sigma[-1], 1e-12):.3g} times "
                "as fast as others. Choose a path or a start away from it, or go there by waypoints of the joints."
            )
        for j in np.flatnonzero((q < robot.q_min) | (q > robot.q_max)) if robot.limits else ():
            problems.setdefault(
                int(j),
                f"{place}: expected joint {j + 1} between its end stops, {robot.q_min[j]:g} and {robot.q_max[j]:g}, "
                f"got {q[j]:.4g}.",
            )
        found.append(q)
    if problems:
        way = "Choose another start, such as the other elbow, or a shorter path."
        raise UsageError("\n".join(problems.values()) + f" {way}")
    return np.array(found)


def _solved(robot: Robot, q: Floats, pose: tuple[Floats, Floats], rows: int) -> tuple[Floats, float]:
    """Return the positions nearest to `q` at a pose, and what is left of the way to it."""
    for _ in range(_TURNS):
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


def twist(pose: tuple[Floats, Floats], target: tuple[Floats, Floats]) -> Floats:
    """Return what takes a pose to another, (6,) [m, rad], in the frame of the first, linear part first."""
    (p, R), (p_t, R_t) = pose, target
    return np.concatenate([R.T @ (p_t - p), scipy.spatial.transform.Rotation.from_matrix(R.T @ R_t).as_rotvec()])
