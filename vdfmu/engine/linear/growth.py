"""Stability of a run: its loops, the place nearest to instability, and the growth of disturbances."""

from __future__ import annotations

import math
import time as clock
from bisect import bisect_left
from collections.abc import Collection, Iterable, Mapping, Sequence
from functools import cached_property
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from vdfmu.base.arrays import Floats, distinct
from vdfmu.base.errors import UsageError, VdfmuError
from vdfmu.engine.linear.linearise import Linearisation, with_part
from vdfmu.engine.linear.loops import SLOW, Loop, Margins, Tied, fastest_mode, loop_of_part, moving, opened_at
from vdfmu.engine.linear.system import LinearSystem, cut
from vdfmu.engine.linear.tied import with_tied
from vdfmu.engine.masters.components import Components
from vdfmu.engine.package.system import Value
from vdfmu.engine.plan.grid import Grid
from vdfmu.engine.results.recorder import Tap
from vdfmu.engine.run.isolated import Isolated, LostProcessError

_HARM = 50.0
"""Growth of disturbances, relative to growth at the rate `SLOW`, from which a run is unstable. They grow for a while in
vibrations, and at the ends of a motion because friction falls with speed."""
_NOTABLE = 1.01
"""Growth of disturbances from which it is reported."""
_ROWS, _FEWEST = 200, 60
"""Approximately the largest and smallest number of linearised rows. Up to half of the remaining ones may be used
early."""
_SHARE, _SMALL, _GROWN = 0.25, 0.02, 0.05
"""Largest change of the loops from row to row, relative to the margin or to the second value if that is larger; and
largest uncertainty of the logarithm of a growth because its rate changes."""
_SHRINK, _GROW = 0.25, 1.5
"""Limits of the next gap between rows, relative to the last gap."""
_MINIMA, _NEAR, _HALVINGS = 4, 2.0, 4
"""Largest number of minima of the margins along the run that are refined, the largest of them relative to the smallest,
and the number of halvings of the time around each."""
_FINE = 1000
"""Number of times for the growth; rates are linear between rows."""


class Growth(NamedTuple):
    """The largest growth of disturbances along a run, from `begin` to `end` [s]."""

    exponent: float
    """Logarithm of their growth, relative to growth at the rate `above`."""
    begin: float
    end: float
    rate: float
    """Largest rate from `begin` to `end` [1/s]."""
    state: str
    """State with the largest participation in the mode of this rate."""
    lasts: bool
    """Whether they grow until the end of the run."""

    @property
    def unstable(self) -> bool:
        """Whether disturbances grow by the factor `_HARM`, or by e if they still grow at the end."""
        return bool(self.exponent > (1.0 if self.lasts else math.log(_HARM)))

    @property
    def notable(self) -> bool:
        """Whether they grow enough to be reported."""
        return bool(self.exponent > math.log(_NOTABLE))


class Nearest(NamedTuple):
    """The time and loop nearest to instability."""

    modulus: float
    """Smallest modulus margin; 0 if a mode grows that is not slow, see `vdfmu.engine.linear.loops`."""
    time: float
    name: str
    """The input that opens this loop; without a margin, the state with the largest participation in the growth."""


class Late(NamedTuple):
    """The loop that tolerates the smallest delay."""

    samples: float
    """Delay margin in samples of the loop."""
    time: float
    name: str
    """The input that opens this loop."""


class Pose(NamedTuple):
    """The loops at a time [s] of a run."""

    time: float
    matrix: Floats
    """All matrices of the system as one; see `LinearSystem.whole`."""
    rate: float
    """Largest rate of a mode [1/s]."""
    loop: Loop | None
    """The opened loops; None if they have no margins."""


class Along:
    """The loops of a run at times along it, opened at some inputs.

    `system` is the linear system at any of these times; `rows` are times [s] and matrices, see `LinearSystem.whole`.
    """

    def __init__(self, system: LinearSystem, opened: Sequence[str], rows: Iterable[tuple[float, Floats]] = ()) -> None:
        self.system, self.opened = system, opened
        self.lacking = ""
        """Reason for missing margins; empty if they are known."""
        self._parts: dict[bytes, tuple[LinearSystem, Any]] = {}
        self.rows = [self.pose(time, M) for time, M in rows]

    def part(self, M: Floats) -> LinearSystem:
        """Return only the loops of the system with these matrices."""
        acts = (M != 0.0).tobytes()
        if acts not in self._parts:  # most times share their structure
            system = self.system.with_whole(M)
            places = system.on(self.opened)
            self._parts[acts] = system.part(places), system.in_whole(places)
        part, ix = self._parts[acts]
        return part.with_whole(M[ix])

    def pose(self, time: float, M: Floats) -> Pose:
        """Return the loops at a time [s]."""
        part = self.part(M)
        if not self.lacking:
            try:
                loop = loop_of_part(part, self.opened)
                return Pose(time, M, loop.rate, loop)
            except UsageError as error:
                self.lacking = str(error)
        return Pose(time, M, fastest_mode(part)[0], None)

    @cached_property
    def poses(self) -> list[Pose]:
        """The loops at the rows, and between the rows nearest to instability.

        The matrices are interpolated linearly between two rows. In most systems all values in between do occur, such as
        the slopes of friction at all speeds.
        """
        poses = [*self.rows]
        for loop, time in _minima(poses):
            for _ in range(_HALVINGS):
                k = next(k for k, pose in enumerate(poses) if pose.time == time)
                around = poses[max(k - 1, 0) : k + 2]
                more = [self.pose((a.time + b.time) / 2.0, (a.matrix + b.matrix) / 2.0) for a, b in pairwise(around)]
                time = min((*around, *more), key=lambda pose: _modulus(pose)[loop]).time
                poses = sorted([*poses, *more], key=lambda pose: pose.time)
        return poses

    @property
    def modulus(self) -> Floats:
        """Smallest modulus margin of each loop, (n,)."""
        return np.min([_modulus(pose) for pose in self.poses], axis=0)

    @property
    def rate(self) -> float:
        """Largest rate of a mode [1/s]."""
        return max(pose.rate for pose in self.poses)

    def margins(self) -> Margins:
        """Return the smallest margins of each loop."""
        margins = [pose.loop.margins()[:4] for pose in self.poses if pose.loop is not None]
        modulus, gain, phase, delay = np.min(margins, axis=0)
        return Margins(modulus, gain, phase, delay, self.rate)

    def growth(self, begin: float, end: float, above: float = SLOW) -> Growth:
        """Return the largest growth of disturbances above a rate [1/s] in a run from `begin` to `end` [s]."""
        growth = growth_of([pose.time for pose in self.poses], [pose.rate for pose in self.poses], begin, end, above)
        inside = [pose for pose in self.poses if growth.begin <= pose.time <= growth.end]
        fastest = max(inside or self.poses, key=lambda pose: pose.rate)
        rate, state = fastest_mode(self.part(fastest.matrix))
        return growth._replace(rate=rate, state=state)

    def nearest(self) -> Nearest | None:
        """Return the time and loop nearest to instability; None without margins, see `lacking`."""
        if self.poses[0].loop is None:
            return None
        pose = min(self.poses, key=lambda pose: (_modulus(pose).min(), -pose.rate))
        least = _modulus(pose)
        name = self.opened_at(int(least.argmin()))
        modulus = float(least.min())
        return Nearest(modulus, pose.time, name if modulus else fastest_mode(self.part(pose.matrix))[1])

    def delay(self) -> Late | None:
        """Return the smallest delay margin of sampled loops; None for continuous loops or without margins."""
        loops = [(pose.time, pose.loop) for pose in self.poses if pose.loop is not None and pose.loop.sampled]
        if not loops:
            return None
        samples = np.array([loop.delay / loop.step for _, loop in loops])
        row, loop = (int(each) for each in np.unravel_index(samples.argmin(), samples.shape))
        return Late(float(samples[row, loop]), loops[row][0], self.opened_at(loop))

    def without_feedback(self) -> str | None:
        """Return the first input to which nothing is fed back along the run; None if all have feedback."""
        fed = np.any([pose.loop.K.any(axis=1) for pose in self.poses if pose.loop is not None], axis=0)
        silent = np.flatnonzero(~fed) if fed.ndim else []
        return self.opened_at(int(silent[0])) if len(silent) else None

    def opened_at(self, loop: int) -> str:
        """Return the input that opens a loop."""
        return self.system.parts.inputs[self.system.places(self.opened)[loop]]


def growth_of(at: Sequence[float], of_rows: Sequence[float], begin: float, end: float, above: float = SLOW) -> Growth:
    """Return the largest growth in a run from `begin` to `end` [s], given rates [1/s] at rows; its state is empty."""
    times, rates = np.array(at), np.array(of_rows)
    bounds = distinct(np.linspace(begin, max(end, times[-1]), _FINE), times[times >= begin])
    rate = np.interp(bounds, times, np.maximum(rates, -1e9))
    steps = np.diff(bounds) * ((rate[1:] + rate[:-1]) / 2.0 - above)
    most, run, first, place = -np.inf, 0.0, 0, (0, len(steps))  # a run that fails at once has no step
    for k, step in enumerate(steps.tolist()):
        if run < 0.0 or not k:
            run, first = 0.0, k
        run += step
        if run > most:
            most, place = run, (first, k + 1)
    first, last = bounds[[*place]].tolist()
    return Growth(most, first, last, float(rates.max()), "", place[1] == len(steps))


def _modulus(pose: Pose) -> Floats:
    assert pose.loop is not None
    return pose.loop.modulus


def _minima(poses: Sequence[Pose]) -> list[tuple[int, float]]:
    """Return the loops and times of the smallest minima of their margins over the run."""
    if poses[0].loop is None:
        return []
    modulus = np.array([_modulus(pose) for pose in poses])
    after, before = (np.pad(modulus, ((1, 1), (0, 0)), constant_values=np.inf)[k : k + len(poses)] for k in (2, 0))
    lowest = (modulus <= after) & (modulus <= before) & (modulus > 0.0) & (modulus <= _NEAR * modulus.min())
    minima = sorted((modulus[k, loop], loop, poses[k].time) for k, loop in np.argwhere(lowest).tolist())
    return [(loop, time) for _, loop, time in minima[:_MINIMA]]


class _ChosenRows:
    """Rows of a run of n steps, chosen during the run: closer together while its loops change."""

    def __init__(self, n: int, more: Collection[int]) -> None:
        self.n, self.row = n, 0
        self._more, self._next, self._gap, self._left = sorted(more), 0.0, 1.0, _ROWS

    def due(self, k: int) -> float:
        """Return the next row, `k` or a later one."""
        later = self._more[bisect_left(self._more, k) :]
        return min(max(k, self._next), self.n if k <= self.n else math.inf, *later[:1])

    def go_on(self, change: float) -> None:
        """Choose the next row from the change between the last two, where 1 is the largest allowed."""
        self._left = max(self._left - 1, 1)
        gap = self._gap * min(max(1.0 / max(change, 1e-3), _SHRINK), _GROW)
        self._gap = min(max(gap, (self.n - self.row) / (4.0 * self._left), 1.0), max(self.n / _FEWEST, 1.0))
        self._next = math.ceil(self.row + self._gap)

    def stop(self) -> None:
        """Stop choosing rows."""
        self._next = math.inf


def _change(before: Pose, after: Pose) -> float:
    """Return the change of loops between two poses, where 1 is the largest allowed."""
    growing = max(before.rate, after.rate) > 0.0
    change = abs(after.rate - before.rate) * (after.time - before.time) / _GROWN if growing else 0.0
    if before.loop is not None and after.loop is not None:
        pair = np.array([before.loop.modulus, after.loop.modulus])
        change = max(change, float((np.ptp(pair, axis=0) / np.maximum(pair.min(axis=0), _SMALL)).max()) / _SHARE)
    return change


class Poses(Tap):
    """Linearises the loops of a run at some of its rows.

    Loops are opened at the inputs `opened`. The default is the connected inputs named `group` of any component or, if
    there are none, the inputs from :func:`~vdfmu.engine.linear.system.cut`. `alternative` is a second linearisation at
    the same states, with the parameters in `without` by component, such as no dry friction. Set `again` if
    :meth:`changed` will be called, and `noted` to accept a linearisation with notes. `more` are additional rows. For
    `tied` see :func:`~vdfmu.engine.linear.tied.with_tied`.
    """

    def __init__(
        self,
        group: str,
        tied: Sequence[Tied] = (),
        *,
        without: Mapping[str, Mapping[str, Value]] | None = None,
        again: bool = False,
        opened: Sequence[str] = (),
        more: Sequence[int] = (),
        noted: bool = False,
    ) -> None:
        self._opened, self._group, self._tied, self._without, self._more = opened, group, tied, without or {}, more
        self._whole, self._noted = again or bool(without), noted
        self.lacking, self.notes = "", tuple[str, ...]()
        """Reason for unknown loops, empty if they are known, and notes of the linearisation."""
        self.alternative: Along | None = None
        self.seconds = 0.0
        """Wall time of the linearisations [s]."""
        self.components: Components | Isolated | None = None
        self._linearisation: Linearisation | None = None
        self._systems: list[tuple[float, LinearSystem]] = []
        self._rows = _ChosenRows(0, ())
        self._loops: Along | None = None
        self._linked: Any = None

    def begin(self, grid: Grid, names: Sequence[str]) -> None:
        """Begin a run, during which rows are chosen."""
        self._rows, self._step = _ChosenRows(grid.n, self._more), grid.step

    def due(self, k: int) -> float:
        """Return the next row."""
        return self._rows.due(k)

    def take(self, k: int, time: float, components: Any) -> None:
        """Linearise the components."""
        self._rows.row = k
        began = clock.perf_counter()
        try:
            self._look(components, time)
        except LostProcessError:
            raise
        except (VdfmuError, np.linalg.LinAlgError) as error:
            if isinstance(error, VdfmuError) or self._loops is None or not self._loops.rows:
                self.lacking = str(error)
            self._rows.stop()  # numbers overflow; the poses so far suffice
        self.seconds += clock.perf_counter() - began

    def _look(self, components: Components | Isolated, time: float) -> None:
        if self.lacking:
            return
        if self._linearisation is None:
            self.components, self._linearisation = components, Linearisation(components, self._step, loops=True)
        system = self._linearisation.at(time, values=self._whole)
        if self._loops is None:
            self._loops = self._begin(system)
        if self._whole:
            self._systems.append((time, system))
        rows = self._loops.rows
        rows.append(self._loops.pose(time, self._matrix(system)))
        self._rows.go_on(_change(*rows[-2:]) if len(rows) > 1 else 1.0)
        if self._without and self._rows.row == self._rows.n:
            self.alternative = self.changed(self._without)

    @property
    def loops(self) -> Along:
        """The loops of the run; UsageError if they are not known."""
        if self._loops is None:
            raise UsageError(self.lacking or "loops: expected a run with rows")
        return self._loops

    def _begin(self, system: LinearSystem) -> Along:
        """Return the loops of the connected part; UsageError if they are not known."""
        opened, self.notes = [*self._opened] or opened_at(system, self._group) or cut(system), system.parts.notes
        if self.notes and not self._noted:
            raise UsageError("; ".join(self.notes))
        if not opened:
            raise UsageError("no connected input lies on a loop")
        loops = system.around(opened)
        moving(loops)
        if loops.how.continuous and loops.samples.signals:
            raise UsageError(f"{loops.algorithm} treats sampled states as continuous")
        u, y = (np.flatnonzero(system.links.any(axis=axis)) for axis in (1, 0))
        places = np.arange(len(system.parts.A)), u, y, np.arange(len(system.samples.signals))
        self._linked = system.in_whole(places)
        return Along(system.part(places), opened)

    def _matrix(self, system: LinearSystem) -> Floats:
        return with_tied(system, self._tied).whole[self._linked]

    def changed(self, values: Mapping[str, Mapping[str, Value]]) -> Along:
        """Return the loops with other parameters of some components, at the states of all rows.

        Components must be in the state after the run, and changeable:
        :func:`~vdfmu.engine.linear.linearise.can_change`.
        """
        return Along(self.loops.system, self.loops.opened, self._changed(values, self._systems))

    def moved(self, values: Mapping[str, Mapping[str, Value]], at: Sequence[int]) -> list[Loop]:
        """Return the loops of :meth:`changed` at some rows; UsageError if they have no margins."""
        rows = self._changed(values, [self._systems[k] for k in at])
        return [loop_of_part(self.loops.part(M), self.loops.opened) for _, M in rows]

    def _changed(
        self, values: Mapping[str, Mapping[str, Value]], rows: list[tuple[float, LinearSystem]]
    ) -> list[tuple[float, Floats]]:
        assert self.components is not None
        for unit, new in values.items():
            rows = with_part(self.components, unit, new, rows)
        return [(time, self._matrix(system)) for time, system in rows]
