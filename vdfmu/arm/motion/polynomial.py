"""Motions of the joints as piecewise polynomials of degree 5 with four continuous derivatives."""

from __future__ import annotations

import io
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from math import factorial, perm
from typing import Any

import numpy as np
import numpy.typing as npt
import scipy

from vdfmu.arm.motion.played import Cycle, Played
from vdfmu.base.arrays import Floats
from vdfmu.base.errors import UsageError
from vdfmu.base.option import checks_types

DEGREE = 5
"""Lowest degree of a spline with a continuous fourth derivative, which the elastic feedforward needs."""
_ROUNDING = 1e-9
"""Fraction of a limit that is rounding."""
MOST_NUMBERS = 500_000
"""Most coefficients of a unit: some 10 MB of C, which take seconds to compile."""
_GAP = 1e-9
"""Largest gap [rad or m] between the end of a motion and the start of the next that is not a jump."""
_CLOSED = 1e-12
"""Distance between start and end [rad or m] that is rounding."""

_UNIT = '''"""A motion that vdfmu worked out: {note}."""

from pathlib import Path

import numpy as np

from vdfmu.arm.motion.played import {base}

_TABLE = np.load(Path(__file__).with_name("motion.npy"))


class Motion({base}):
    __doc__ = {base}.__doc__
    files = ("motion.npy",)
    edges, rows = _TABLE[:, 0], _TABLE[:-1]
'''


@dataclass(frozen=True, eq=False)
class Motion:
    """Motion of n joints over m pieces, at rest at both ends."""

    knots: Floats
    """Times (m + 1,) [s], starting at 0."""
    coefficients: Floats
    """Coefficients (m, 6, n) of the powers of the time since the start of a piece, constants first."""
    notes: tuple[str, ...] = ()
    """Notes for the user."""

    @property
    def n(self) -> int:
        """Number of joints."""
        return self.coefficients.shape[2]

    @property
    def duration(self) -> float:
        """Duration [s]."""
        return float(self.knots[-1])

    @property
    def start(self) -> Floats:
        """Positions at the start, (n,)."""
        return self.coefficients[0, 0]

    @cached_property
    def end(self) -> Floats:
        """Positions at the end, (n,)."""
        return self.at(self.duration)[0]

    @property
    def closed(self) -> bool:
        """Whether it ends at its start, so that it can be repeated."""
        return bool(np.allclose(self.start, self.end, rtol=0.0, atol=_CLOSED))

    def at(self, t: float | Floats) -> Floats:
        """Return positions and four time derivatives at times of the motion, (5, ..., n)."""
        place = np.clip(np.searchsorted(self.knots, t, "right") - 1, 0, len(self.coefficients) - 1)
        u = np.asarray(np.clip(t, 0.0, self.duration) - self.knots[place])[..., None]
        c = np.moveaxis(self.coefficients[place], -2, 0)
        return np.array([_horner(c, u, order) for order in range(5)])

    def extremes(self, order: int) -> Floats:
        """Least and largest value of a derivative in each piece, (2, m, n)."""
        h, c = np.diff(self.knots)[:, None], np.moveaxis(self.coefficients, 1, 0)
        values = np.array([_horner(c, h * share, order) for share in (0.0, 1.0, *_turns(c, h, order))])
        return np.array([values.min(axis=0), values.max(axis=0)])

    @cached_property
    def peaks(self) -> Floats:
        """Largest absolute values of the four derivatives of each joint, (4, n)."""
        return np.array([np.abs(self.extremes(order)).max(axis=(0, 1)) for order in range(1, 5)])

    def shares(self, velocity: Floats, acceleration: Floats) -> Floats:
        """Return the factor by which each piece's time must change to meet the limits, (m,); limits are (n,) each."""
        taken = [np.abs(self.extremes(order)).max(axis=0) for order in (1, 2)]
        return np.maximum(taken[0] / velocity, np.sqrt(taken[1] / acceleration)).max(axis=1)

    def fitted(
        self, velocity: Floats | None = None, acceleration: Floats | None = None, duration: float | None = None
    ) -> Motion:
        """Return the motion scaled to `duration` [s], or the fastest within limits, (n,). UsageError beyond them."""
        factors = [
            (peak / limit) ** (1.0 / order)
            for order, (peak, limit) in enumerate(zip(self.peaks, (velocity, acceleration), strict=False), 1)
            if limit is not None
        ]
        least = float(np.max(factors, initial=0.0))
        if duration is not None and not 0.0 < duration < np.inf:
            raise UsageError(f"duration: expected more than 0 s, got {duration}.")
        if duration is None:
            return self.slower(least) if least > 0.0 else self
        if least * self.duration > duration * (1.0 + _ROUNDING):
            joint = int(np.argmax(np.max(factors, axis=0))) + 1
            raise UsageError(
                f"duration: expected at least {least * self.duration:.6g} s, because of the limits of joint {joint}, "
                f"got {duration:g} s. Give more time, or raise the limits."
            )
        return self.slower(duration / self.duration)

    def slower(self, factor: float) -> Motion:
        """Return the motion slowed down by `factor`."""
        if not 0.0 < factor < np.inf:
            raise UsageError(f"factor: expected a number above 0, got {factor}.")
        powers = factor ** -np.arange(DEGREE + 1.0)
        return Motion(self.knots * factor, self.coefficients * powers[:, None], self.notes)

    def dwelling(self, seconds: float) -> Motion:
        """Return the motion followed by a rest."""
        return self if np.array_equal(seconds, 0.0) else joined([self, rest(self.end, seconds)])

    def unit(self) -> type[Played]:
        """Return the unit that outputs it, ``units={"trajectory": motion.unit()}``. UsageError for too many pieces."""
        if self.coefficients.size > MOST_NUMBERS:
            raise UsageError(
                f"motion: expected at most {MOST_NUMBERS} coefficients, got {self.coefficients.size}, "
                f"{DEGREE + 1} for each joint and piece. Give fewer points, or a shorter motion."
            )
        hold = np.zeros((1, DEGREE + 1, self.n))
        hold[0, 0] = self.start if self.closed else self.end
        pieces = np.concatenate([self.coefficients, hold])
        table = np.column_stack([self.knots, pieces.reshape(len(pieces), -1)])
        table = np.vstack([table, np.where(np.arange(table.shape[1]) == 0, self.duration + 1.0, 0.0)])
        base = Cycle if self.closed else Played
        stream = io.BytesIO()
        np.save(stream, table)
        note = f"{self.n} joints, {len(self.coefficients)} pieces over {self.duration:g} s"
        text = _UNIT.format(note=note, base=base.__name__)
        files = {"unit.py": text.encode(), "motion.npy": stream.getvalue()}
        body: Any = {"__module__": __name__, "__doc__": base.__doc__, "made_of": files, "notes": self.notes}
        body |= {"edges": table[:, 0], "rows": table[:-1], "experiment_stop": self.duration}
        unit: Any = type("Motion", (base,), body)
        return unit


def _horner(c: Floats, u: Floats, order: int) -> Floats:
    """Return a derivative of polynomials whose coefficients are the rows of `c`, (6, ..., n), at u, (..., 1)."""
    value = np.zeros(c.shape[1:])
    for k in range(DEGREE, order - 1, -1):
        value = value * u + perm(k, order) * c[k]
    return value


def _turns(c: Floats, h: Floats, order: int) -> Floats:
    """Return places, 0 to 1, of a derivative's extrema in pieces, (d, m, n): roots of the next one, of degree d."""
    d = DEGREE - order - 1
    a = np.array([perm(k + order + 1, order + 1) * c[k + order + 1] * h**k for k in range(d + 1)])
    smallest = np.maximum(1e-12 * np.abs(a).max(axis=0), 1e-300)
    lead = np.where(np.abs(a[d]) < smallest, smallest, a[d])
    companion = np.zeros((*a.shape[1:], d, d))
    companion[..., np.arange(1, d), np.arange(d - 1)] = 1.0
    companion[..., -1:] = -np.moveaxis(a[:d] / lead, 0, -1)[..., None]
    turns = np.linalg.eigvals(companion).real.astype(np.float64)
    return np.clip(np.moveaxis(turns, -1, 0), 0.0, 1.0)


def spline(t: Floats, q: Floats) -> Motion:
    """Return the spline of degree 5 through points, at rest at both ends up to the fourth derivative.

    Rest imposes four conditions at each end, so the first and the last interval have two more knots. `t` (k,) [s]
    increases, `q` is (k, n) [rad or m].
    """
    t = t - t[0]
    first, last = ([1 / 3, 2 / 3],) * 2 if len(t) > 2 else ([1 / 5, 2 / 5, 3 / 5, 4 / 5], [])
    inner = np.concatenate([t[0] + (t[1] - t[0]) * np.array(first), t[1:-1], t[-2] + (t[-1] - t[-2]) * np.array(last)])
    ends = np.ones(DEGREE + 1)
    still = [(order, np.zeros(q.shape[1])) for order in range(1, 5)]
    whole = scipy.interpolate.make_interp_spline(
        t, q, k=DEGREE, t=np.concatenate([t[0] * ends, inner, t[-1] * ends]), bc_type=(still, still)
    )
    knots = np.concatenate([t[:1], inner, t[-1:]])
    coefficients = np.array([whole(knots[:-1], order) / factorial(order) for order in range(DEGREE + 1)])
    coefficients[1:DEGREE, 0] = 0.0  # exact rest, without rounding
    coefficients[0, 0] = q[0]
    return Motion(knots, np.moveaxis(coefficients, 0, 1).copy())


@checks_types
def rest(q: npt.ArrayLike, seconds: float) -> Motion:
    """Return a motion that rests at `q`, (n,) [rad or m], for some `seconds`."""
    if not 0.0 < seconds < np.inf:
        raise UsageError(f"dwell: expected one positive time in s, got {seconds}.")
    if np.ndim(q) != 1:
        raise UsageError(f"q: expected a position for each joint, got {q}.")
    coefficients = np.zeros((1, DEGREE + 1, np.size(q)))
    coefficients[0, 0] = q
    return Motion(np.array([0.0, seconds]), coefficients)


def joined(parts: Iterable[Motion]) -> Motion:
    """Return motions joined in sequence; UsageError for a gap between two, or without motions."""
    parts = list(parts)
    if not parts:
        raise UsageError("joined: expected motions, got none.")
    for i, (before, after) in enumerate(pairwise(parts), 1):
        if before.n != after.n or np.abs(after.start - before.end).max() > _GAP:
            raise UsageError(
                f"joined: expected motion {i + 1} to start at {before.end}, the end of motion {i}, got {after.start}."
            )
    begins = np.cumsum([0.0] + [part.duration for part in parts])
    knots = [part.knots[:-1] + begin for part, begin in zip(parts, begins, strict=False)]
    notes = dict.fromkeys(note for part in parts for note in part.notes)
    return Motion(
        np.append(np.concatenate(knots), begins[-1]),
        np.concatenate([part.coefficients for part in parts]),
        tuple(notes),
    )
