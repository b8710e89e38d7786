"""Motions through joint waypoints, with given times or within limits of speed and acceleration."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import numpy.typing as npt

from vdfmu.arm.motion.polynomial import Motion, joined, rest, spline
from vdfmu.base.arrays import Floats
from vdfmu.base.errors import UsageError
from vdfmu.base.option import checks_types

_ROUNDS = 20
"""Iterations that redistribute the time among the intervals; the shortest motion is kept."""
_TOWARDS = 0.5
"""In each iteration the time of an interval is multiplied by this power of its use of the limits, relative to the
largest use of all intervals."""
_AT_REST = 0.2
"""Fraction of the samples' largest slope below which their ends count as at rest."""


@checks_types
def waypoints(
    points: npt.ArrayLike,
    times: npt.ArrayLike | None = None,
    *,
    velocity: npt.ArrayLike | None = None,
    acceleration: npt.ArrayLike | None = None,
    duration: float | None = None,
    dwell: npt.ArrayLike = 0.0,
) -> Motion:
    """Return the motion through joint positions, at rest at the first and the last, continuous up to snap.

    UsageError, with all problems, if points, times and limits do not fit.

    Parameters
    ----------
    points : (k, n) [rad or m]
    times : (k,) [s], optional
        Increasing times of arrival; the motion begins at the first. Without them they follow from the limits.
    velocity, acceleration : float or (n,) [rad/s or m/s, rad/s2 or m/s2], optional
        Limits of each joint. Without times the motion is as fast as they allow; with times it must keep them.
    duration : float [s], optional
        Without times, the duration of the whole motion including rests; it must respect the limits.
    dwell : float or (k,) [s]
        Rest at each point; with 0 the motion passes through.
    """
    q, dwells = np.array(points, dtype=float), np.array(dwell, dtype=float)
    t = None if times is None else np.array(times, dtype=float)
    check_points(q, t, dwells)
    dwells = np.broadcast_to(dwells, len(q))
    limits = limit("velocity", velocity, q.shape[1]), limit("acceleration", acceleration, q.shape[1])
    if t is None and duration is None and (limits[0] is None or limits[1] is None):
        raise UsageError(
            "waypoints: expected times, a duration, or limits of velocity and acceleration, got none of them."
        )
    if t is not None and duration is not None:
        raise UsageError("waypoints: expected times or a duration, got both. Remove one of them.")
    stops = [0, *(i for i in range(1, len(q) - 1) if dwells[i] > 0.0), len(q) - 1]
    moves = [
        spline(np.append(t[a] + dwells[a], t[a + 1 : b + 1]), q[a : b + 1])
        if t is not None
        else _timed(q[a : b + 1], *limits)
        for a, b in pairwise(stops)
    ]
    if t is not None or duration is not None:
        moving = joined(moves)
        rested = float(dwells.sum())
        if duration is not None and duration <= rested > 0.0:
            raise UsageError(f"duration: expected more than the {rested:g} s of rest, got {duration:g} s.")
        left = moving.duration if duration is None else duration - rested
        factor = moving.fitted(*limits, left).duration / moving.duration
        moves = [move.slower(factor) for move in moves]
    rests = [[rest(q[i], dwells[i])] if dwells[i] > 0.0 else [] for i in stops]
    parts = [part for before, move in zip(rests, moves, strict=False) for part in (*before, move)]
    return joined([*parts, *rests[-1]])


@checks_types
def samples(times: npt.ArrayLike, points: npt.ArrayLike) -> Motion:
    """Return the motion through dense samples, at rest at both ends; arguments and errors: see :func:`waypoints`."""
    t, q = np.array(times, dtype=float), np.array(points, dtype=float)
    motion = waypoints(q, t)
    slopes = np.abs(np.diff(q, axis=0) / np.diff(t)[:, None])
    ends = np.maximum(slopes[0], slopes[-1])
    if np.any(fast := ends > _AT_REST * np.maximum(slopes.max(axis=0), 1e-300)):
        joints = ", ".join(str(j + 1) for j in np.flatnonzero(fast))
        note = f"joint {joints}: the samples start or end with a speed, but the motion at rest, so it oscillates there."
        return Motion(motion.knots, motion.coefficients, (note,))
    return motion


def limit(name: str, value: npt.ArrayLike | None, n: int) -> Floats | None:
    """Return a limit for each joint, (n,)."""
    if value is None:
        return None
    try:
        bounds = np.broadcast_to(np.asarray(value, dtype=float), (n,))
    except ValueError:
        bounds = np.zeros(n)
    if not np.all((bounds > 0.0) & np.isfinite(bounds)):
        raise UsageError(f"{name}: expected a number above 0 for all joints, or {n} of them, got {value}.")
    return bounds


def _timed(q: Floats, velocity: Floats | None, acceleration: Floats | None) -> Motion:
    """Return the shortest motion found through points within limits; without both, times proportional to distances."""
    unit = 1.0 if velocity is None else velocity
    h = np.linalg.norm(np.diff(q, axis=0) / unit, axis=1)
    if velocity is None or acceleration is None:
        return spline(np.append(0.0, np.cumsum(h)), q)
    best: Motion | None = None
    for _ in range(_ROUNDS):
        motion = spline(np.append(0.0, np.cumsum(h)), q)
        taken = motion.fitted(velocity, acceleration)
        if best is None or taken.duration < best.duration:
            best = taken
        if len(q) == 2:
            break
        ends = np.append(0.0, np.cumsum(h))
        place = np.clip(np.searchsorted(ends, motion.knots[:-1], "right") - 1, 0, len(h) - 1)
        share = np.zeros(len(h))
        np.maximum.at(share, place, motion.shares(velocity, acceleration))
        h = np.maximum(h * (share / share.max()) ** _TOWARDS, 1e-3 * h.max())
    assert best is not None
    return best


def check_points(q: Floats, times: Floats | None = None, dwell: Floats | float = 0.0) -> None:
    """Check waypoints, (k, n), times of arrival and of rest; UsageError with all problems."""
    dwell = np.asarray(dwell)
    problems: list[str] = []
    if q.ndim != 2 or len(q) < 2:
        raise UsageError(f"waypoints: expected at least 2 points of n joints, (k, n), got shape {q.shape}.")
    for i, j in np.argwhere(~np.isfinite(q)):
        problems.append(f"point {i + 1}: joint {j + 1}: expected a finite number, got {q[i, j]}.")
    if dwell.shape not in ((), (len(q),)) or not np.all((dwell >= 0.0) & np.isfinite(dwell)):
        problems.append(f"dwell: expected a time of at least 0 s, or {len(q)} of them, got {dwell}.")
        dwell = np.zeros(())
    if times is not None:
        if times.shape != (len(q),):
            problems.append(f"times: expected {len(q)}, one for each point, got shape {times.shape}.")
        else:
            leave = times + np.where(np.arange(len(q)) < len(q) - 1, dwell, 0.0)
            for i in np.flatnonzero(~(np.diff(times) > (leave - times)[:-1])):
                rested = f", and its rest of {leave[i] - times[i]:g} s" if leave[i] > times[i] else ""
                problems.append(
                    f"point {i + 2}: time: expected more than the {times[i]:g} s of the point before{rested}, got "
                    f"{times[i + 1]:g} s."
                )
    elif len(same := np.flatnonzero(~np.any(np.diff(q, axis=0) != 0.0, axis=1))):
        problems += [
            f"point {i + 2}: expected a position other than the point before. Use dwell for a rest, or give times."
            for i in same
        ]
    if problems:
        raise UsageError("\n".join(problems))
