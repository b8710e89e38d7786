"""Events of units during a motion of their states: the time of the first, and the changes that it causes.

The motion ends where an event indicator changes its sign: a rise above 0 is an event, and after a fall the next rise
can be one. The indicators are evaluated at the points of the motion and at the vertices of parabolas through three
points, so two changes between two points may be missed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise

import numpy as np

from vdfmu.base.arrays import Floats
from vdfmu.base.errors import KernelError
from vdfmu.compiler.unit.declaration import AT
from vdfmu.compiler.unit.evaluate import Evaluation

PARTS = 8
"""Number of parts of an interval at whose ends the event indicators are evaluated."""
MOST_ROUNDS = 100
"""Longest chain of events at one time, each caused by the one before."""
MOST_CHANGES = 1_000
"""Largest number of changes of sign in one motion, which take some 3 ms each; native FMUs allow ten times as many."""
_LEAST = np.finfo(float).tiny

Motion = Callable[[float, Floats, Floats], Floats]
"""Returns the states (m, n_x) at times (m,) of a motion, given its start time and state."""
Level = Callable[[float, Floats], Floats]
"""Returns a level per event at a time and a state, which is above 0 if the event indicator has changed its sign."""


def margin(t: float) -> float:
    """Return the rounding uncertainty [s] of a switching time `t`: 18 units in the last place."""
    return 4e-15 * abs(t) + 1e-17


def parts_of(times: Sequence[float]) -> Floats:
    """Return the ends of the parts of the intervals between times, (PARTS (m - 1),)."""
    shares = np.arange(1, PARTS) / PARTS
    return np.concatenate([[*(begin + (end - begin) * shares), end] for begin, end in pairwise(times)])


def steps_of(advance: Callable[[float, float], None], x: Floats) -> Motion:
    """Return the motion of the states `x`, which `advance` moves in place from a time over a duration [s]."""

    def motion(t: float, start: Floats, times: Floats) -> Floats:
        x[:] = start
        rows: list[Floats] = []
        for begin, end in pairwise([t, *times.tolist()]):
            advance(begin, end - begin)
            rows.append(x.copy())
        return np.array(rows)

    return motion


def first_change(
    motion: Motion, level: Level, t: float, x: Floats, times: Floats, states: Floats
) -> tuple[float, Floats] | None:
    """Return the time just after the first change of sign, and the state there; None if there is no change.

    The motion is at `x` at the time `t`, where no sign has changed, and at `states` (m, n_x) at `times` (m,).
    """
    points = [(t, x), *zip(times.tolist(), states, strict=True)]
    levels = [level(t, x)]
    for k in range(1, len(points)):
        levels.append(level(*points[k]))
        for top in sorted(_tops(points[k - 2 : k + 1], levels[k - 2 : k + 1])) if k > 1 else ():
            begin, start = points[k - 1 if top > points[k - 1][0] else k - 2]
            state = motion(begin, start, np.array([top]))[0]
            if (level(top, state) > 0.0).any():
                return _located(motion, level, begin, start, top, state)
        if (levels[k] > 0.0).any():
            return _located(motion, level, *points[k - 1], *points[k])
    return None


def _tops(points: Sequence[tuple[float, Floats]], levels: Sequence[Floats]) -> Iterator[float]:
    """Yield times between three points where the parabolas through their levels have maxima above 0."""
    a, b, c = (time for time, _ in points)
    for low, middle, high in zip(*levels, strict=True):
        bend = ((high - middle) / (c - b) - (middle - low) / (b - a)) / (c - a)
        slope = (middle - low) / (b - a) + bend * (b - a)
        if bend < 0.0 and a < (top := b - 0.5 * slope / bend) < c and middle - 0.25 * slope**2 / bend > 0.0:
            yield float(top)


def _located(
    motion: Motion, level: Level, begin: float, start: Floats, end: float, state: Floats
) -> tuple[float, Floats]:
    """Return time and state just after the first change between two times, by false position (Illinois)."""
    low, below, above, side, k = begin, level(begin, start).max(), level(end, state).max(), 0, 0
    while end - low > (close := 2.0 * margin(end)):
        k += 1
        # every third iteration bisects, because a level may jump, and so do all between infinite levels
        straight = below < 0.0 and k % 3 and np.isfinite(above - below)
        middle = end - above * (end - low) / (above - below) if straight else 0.5 * (low + end)
        middle = float(min(max(middle, low + 0.5 * close), end - 0.5 * close))
        moved = motion(begin, start, np.array([middle]))[0]
        here = level(middle, moved).max()
        if here > 0.0:
            end, state, above = middle, moved, here
            below *= 0.5 if side > 0 else 1.0
        else:
            low, below = middle, here
            above *= 0.5 if side < 0 else 1.0
        side = 1 if here > 0.0 else -1
    return end, state


class UnitEvents:
    """Events of units whose states a solver integrates.

    `place` sets a time [s] and states (n_x,) in the units, and the inputs that follow from them. `states` returns the
    states. `above` (n,) is whether each event indicator was above 0; like the states it determines the future.
    """

    def __init__(
        self, units: Sequence[Evaluation], place: Callable[[float, Floats], None], states: Callable[[], Floats]
    ) -> None:
        self._units = [unit for unit in units if unit.at_events]
        self._place, self._states = place, states
        self._methods = [method for unit in self._units for method in unit.at_events]
        self._names = [v.name for unit in self._units for v in unit.interface.memory[unit.interface.events]]
        self.above = np.zeros(len(self._methods), np.bool_)
        self.happened: list[tuple[str, float]] | None = None
        """Takes the name and time [s] of each event."""

    def __bool__(self) -> bool:
        return bool(self._methods)

    def begin(self) -> None:
        """Start from the present event indicators; those already above 0 are not events."""
        self.above = self._numbers() > 0.0

    def move(self, motion: Motion, t: float, x: Floats, times: Floats) -> Iterator[Floats]:
        """Yield the state at the times (m,) of a motion from `x` at `t`; KernelError if events do not end."""
        x = self.take(t, x)
        changes = 0
        while len(times):
            states = motion(t, x, times)
            change = first_change(motion, self._level, t, x, times, states)
            if change is None:
                yield from states
                return
            t, x = change
            changes += 1
            if changes > MOST_CHANGES:
                raise self._endless(t, f"{MOST_CHANGES} in one interval")
            count = int(np.searchsorted(times, t))
            yield from states[:count]
            x, times = self.take(t, x), times[count:]
            if len(times) and times[0] <= t + 2.0 * margin(t):
                yield x
                times = times[1:]

    def take(self, t: float, x: Floats) -> Floats:
        """Handle the events at a time, and those that they cause; return the states after them."""
        for _ in range(MOST_ROUNDS if self._methods else 0):
            above = self._numbers_at(t, x) > 0.0
            rising = np.flatnonzero(above & ~self.above)
            self.above = above
            if not rising.size:
                return x
            for i in rising:
                self._methods[i]()
                if self.happened is not None:
                    self.happened.append((self._names[i], t))
            x = self._states()
        if self._methods:
            raise self._endless(t, f"{MOST_ROUNDS} at one time")
        return x

    def _numbers(self) -> Floats:
        for unit in self._units:
            unit.events()
        return np.concatenate([unit.levels for unit in self._units] or [np.empty(0)])

    def _numbers_at(self, t: float, x: Floats) -> Floats:
        self._place(t, x)
        return self._numbers()

    def _level(self, t: float, x: Floats) -> Floats:
        numbers = self._numbers_at(t, x)
        return np.where(self.above, np.where(numbers == 0.0, _LEAST, -numbers), numbers)

    def _endless(self, t: float, count: str) -> KernelError:
        last = self._names[int(np.argmax(self.above))]
        return KernelError(
            f"at t = {t:.9g} s events do not end: there are more than {count}, the last of {last}. Let {AT}{last} stop "
            "the motion, for example with a Held state for rest."
        )
