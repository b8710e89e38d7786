"""Motions that excite the joints for identification: sweeps and multisines, at rest at both ends."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Literal

import numpy as np
import numpy.typing as npt

from vdfmu.arm.motion.joint_space import limit
from vdfmu.arm.motion.polynomial import MOST_NUMBERS, Motion, spline
from vdfmu.base.arrays import Floats
from vdfmu.base.errors import UsageError
from vdfmu.base.option import checks_types

_KNOTS = 24
"""Knots per shortest period, with which the spline equals the sine to 1e-7 of its amplitude."""


@checks_types
def multisine(
    start: npt.ArrayLike,
    amplitude: npt.ArrayLike,
    lines: Sequence[int],
    period: float,
    *,
    periods: int = 1,
    phases: Literal["schroeder", "random"] = "schroeder",
    seed: int = 0,
    velocity: npt.ArrayLike | None = None,
    acceleration: npt.ArrayLike | None = None,
) -> Motion:
    """Return a sum of sines about a pose: whole periods, preceded by a period of growth and followed by one of decay.

    All lines have equal amplitudes. Joint j, from 0, is shifted in time by j / n of the period. UsageError if an
    argument does not fit.

    Parameters
    ----------
    start : (n,) [rad or m]
    amplitude : float or (n,) [rad or m]
        Largest deviation from `start` in a period, reduced with a note if a limit requires it. With 0 the joint rests.
    lines : sequence of int
        Frequencies, as multiples of 1 / `period`.
    period : float [s]
    periods : int
        Periods of full amplitude, from `period` to ``(1 + periods) period``.
    phases : "schroeder" or "random"
        Phases with low peaks by Schroeder (1970), or random phases of each joint from `seed`.
    velocity, acceleration : float or (n,) [rad/s or m/s, rad/s2 or m/s2], optional
        Limits of each joint.
    """
    q = np.atleast_1d(np.array(start, dtype=float))
    k = np.array(lines, dtype=float)
    problems: list[str] = []
    if k.ndim != 1 or not k.size or not np.all((k >= 1) & (k == np.floor(k))) or len(set(k)) < k.size:
        problems.append(f"lines: expected whole numbers of at least 1, each once, got {lines}.")
    if not (np.isfinite(period) and period > 0.0):
        problems.append(f"period: expected more than 0 s, got {period}.")
    for name, number, least in (("periods", periods, 1), ("seed", seed, 0)):
        if not np.isfinite(number) or int(number) != number or number < least:
            problems.append(f"{name}: expected a whole number of at least {least}, got {number}.")
    if phases not in ("schroeder", "random"):
        problems.append(f"phases: expected schroeder or random, got {phases!r}.")
    if problems:
        raise UsageError("\n".join(problems))
    count = np.arange(1, k.size + 1)
    if phases == "schroeder":
        shift = 2.0 * np.pi * np.outer(np.arange(len(q)) / len(q), k)
        phase = shift - np.pi * count * (count - 1) / k.size
    else:
        phase = np.random.default_rng(seed).uniform(0.0, 2.0 * np.pi, (len(q), k.size))

    def wave(t: Floats) -> Floats:
        return np.cos(2.0 * np.pi / period * t[:, None, None] * k + phase).sum(axis=2)

    _check_length((periods + 2) * k.max(), q)
    fine = np.linspace(0.0, period, int(_KNOTS * k.max()) + 1)
    peak = np.abs(wave(fine)).max(axis=0)
    times = (periods + 2) * period, period, k.max() / period
    return _about(q, amplitude, wave, peak, *times, velocity, acceleration)


@checks_types
def sweep(
    start: npt.ArrayLike,
    amplitude: npt.ArrayLike,
    frequencies: Sequence[float],
    duration: float,
    *,
    law: Literal["linear", "logarithmic"] = "logarithmic",
    velocity: npt.ArrayLike | None = None,
    acceleration: npt.ArrayLike | None = None,
) -> Motion:
    """Return a sine about a pose with a changing frequency, which grows at the start and fades at the end.

    Other arguments and errors: see :func:`multisine`.

    Parameters
    ----------
    frequencies : (float, float) [Hz]
        At the start and at the end.
    duration : float [s]
        It grows and fades over a tenth of the duration.
    law : "linear" or "logarithmic"
        How the frequency changes with time.
    """
    q = np.atleast_1d(np.array(start, dtype=float))
    both = np.array(frequencies, dtype=float)
    if both.shape != (2,) or not np.all((both > 0.0) & np.isfinite(both)):
        raise UsageError(f"frequencies: expected two above 0 Hz, got {frequencies}.")
    first, last = both
    if not (np.isfinite(duration) and duration > 0.0):
        raise UsageError(f"duration: expected more than 0 s, got {duration}.")
    if law not in ("linear", "logarithmic"):
        raise UsageError(f"law: expected linear or logarithmic, got {law!r}.")
    _check_length(duration * both.max(), q)
    ratio = np.log(last / first)

    def wave(t: Floats) -> Floats:
        s = t / duration
        if law == "linear" or abs(ratio) < 1e-9:
            turns = duration * (first * s + 0.5 * (last - first) * s * s)
        else:
            turns = duration * first * np.expm1(ratio * s) / ratio
        return np.repeat(np.sin(2.0 * np.pi * turns)[:, None], len(q), axis=1)

    times = duration, 0.1 * duration, both.max()
    return _about(q, amplitude, wave, np.ones(len(q)), *times, velocity, acceleration)


def _check_length(most_periods: float, q: Floats) -> None:
    """Raise UsageError for too many periods of the highest frequency, or if `q` is not a pose."""
    if q.ndim != 1 or not q.size or not np.all(np.isfinite(q)):
        raise UsageError(f"start: expected a position for each joint, got {q}.")
    most = MOST_NUMBERS / (_KNOTS * 6.0 * q.size)
    if not most_periods <= most:
        raise UsageError(
            f"expected at most {most:.0f} periods of the highest frequency, got {most_periods:.4g}. Choose a lower "
            "one, or a shorter motion."
        )


def _about(
    q: Floats,
    amplitude: npt.ArrayLike,
    wave: Callable[[Floats], Floats],
    peak: Floats,
    duration: float,
    ramp: float,
    highest: float,
    velocity: npt.ArrayLike | None,
    acceleration: npt.ArrayLike | None,
) -> Motion:
    """Return a wave (m, n) with a peak (n,) about a pose, with ramps; `highest` is its highest frequency [Hz]."""
    try:
        most = np.broadcast_to(np.asarray(amplitude, dtype=float), q.shape)
    except ValueError:
        most = np.full(q.shape, np.nan)
    if not np.all((most >= 0.0) & np.isfinite(most)) or not np.any(most > 0.0):
        raise UsageError(f"amplitude: expected a number above 0, or {len(q)} numbers of at least 0, got {amplitude}.")
    t = np.linspace(0.0, duration, max(int(np.ceil(_KNOTS * highest * duration)), 8 * _KNOTS) + 1)
    envelope = smooth_step(t / ramp) * smooth_step((duration - t) / ramp)
    full = spline(t, q + most / peak * envelope[:, None] * wave(t))
    limits = limit("velocity", velocity, len(q)), limit("acceleration", acceleration, len(q))
    share = np.ones(len(q))
    for taken, allowed in zip(full.peaks, limits, strict=False):
        share = share if allowed is None else np.minimum(share, allowed / np.maximum(taken, 1e-300))
    coefficients = full.coefficients * share
    coefficients[:, 0] += (1.0 - share) * q
    notes = tuple(
        f"joint {j + 1}: amplitude {most[j] * share[j]:.4g} instead of {most[j]:g}, to keep the limits."
        for j in np.flatnonzero((share < 1.0) & (most > 0.0))
    )
    return Motion(full.knots, coefficients, notes)


def smooth_step(x: Floats) -> Floats:
    """Return the polynomial of degree 9 from 0 at 0 to 1 at 1 with four zero derivatives there; held outside."""
    x = np.clip(x, 0.0, 1.0)
    return x**5 * (126.0 + x * (-420.0 + x * (540.0 + x * (-315.0 + 70.0 * x))))
