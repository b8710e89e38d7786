"""Stability of a run: the loops along it, where they come nearest to instability, and where disturbances grow."""

from __future__ import annotations

import math
import time as clock
from collections.abc import Collection, Container, Iterable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from functools import cached_property
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from vdfmu.base.arrays import Floats
from vdfmu.base.errors import UsageError, VdfmuError
from vdfmu.engine.linear.linearise import Linearisation, changed, with_part
from vdfmu.engine.linear.loops import (
    SLOW,
    Loop,
    Margins,
    Tied,
    fastest_mode,
    loop_of_part,
    moving,
    opened_at,
    with_tied,
)
from vdfmu.engine.linear.system import LinearSystem, Places, cut
from vdfmu.engine.masters.components import Components
from vdfmu.engine.masters.observer import Tap
from vdfmu.engine.package.system import Value
from vdfmu.engine.plan.grid import Grid

_HARM = 50.0
"""Factor by which disturbances grow, beyond what the rate `SLOW` gives, before a run is unstable: vibration and the
ends of a motion, where friction falls with speed, let them grow for a while."""
_TOLD, _DOUBTFUL = 1.01, 1.1
"""Factors from which a growth that the run survives is told, and from which it makes the run doubtful."""
_ROWS, _FEWEST = 200, 60
"""Rows at which a run is linearised: about as many at most, and at least. Half of what is left may be used ahead."""
_SHARE, _SMALL, _GROWN = 0.25, 0.02, 0.05
"""By how much loops should change from row to row at most: a share of the margin, what is below counting as this; and
the logarithm of the factor by which a change of its rate makes a growth uncertain."""
_SHRINK, _GROW = 0.25, 1.5
"""By how much the next gap between rows is smaller or larger at most."""
_MINIMA, _NEAR, _HALVINGS = 4, 2.0, 4
"""Minima of the loops' margins over the run that are looked at closer, the most; as how many times the least; and how
often the time around each is halved."""
_FINE = 1000
"""Times for the growth: between rows a rate is taken as linear."""


class Growth(NamedTuple):
    """Where disturbances grow most along a run."""

    exponent: float
    """Logarithm of the factor by which they grow, beyond what the rate `above` gives."""
    begin: float
    """Begin [s]."""
    end: float
    """End [s]."""
    rate: float
    """Largest rate in this time [1/s]."""
    state: str
    """State with the largest part in the mode of this rate."""
    lasts: bool
    """Whether they grow until the end of the run."""

    @property
    def unstable(self) -> bool:
        """Whether disturbances grow by a factor of `_HARM`; e-fold if they last."""
        return bool(self.exponent > (1.0 if self.lasts else math.log(_HARM)))

    @property
    def told(self) -> bool:
        """Whether they grow enough to be told."""
        return bool(self.exponent > math.log(_TOLD))

    @property
    def doubtful(self) -> bool:
        """Whether they grow enough to make the run doubtful."""
        return bool(self.exponent > math.log(_DOUBTFUL))


class Nearest(NamedTuple):
    """Where loops come nearest to instability."""

    modulus: float
    """Smallest modulus margin; 0 if a mode grows that is not slow."""
    time: float
    name: str
    """The input at which that loop is opened; without a margin, the state with the largest part in what grows."""


class Pose(NamedTuple):
    """Loops at a time [s] of a run."""

    time: float
    matrix: Floats
    """All matrices of the system as one, see :func:`_matrix`."""
    rate: float
    """Largest rate of a mode [1/s]."""
    loop: Loop | None
    """None if the loops have no margins."""


class Along:
    """The loops of a run at times along it, opened at some inputs.

    Parameters
    ----------
    system : LinearSystem
        Any of those at these times.
    opened : sequence of str
    rows : iterable of (time, matrix)
        See :func:`_matrix`.

    Attributes
    ----------
    rows : list of Pose
        The loops at rows of the run.
    lacking : str
        Why the loops have no margins; empty if they have.
    """

    def __init__(self, system: LinearSystem, opened: Sequence[str], rows: Iterable[tuple[float, Floats]] = ()) -> None:
        self.system, self.opened, self.lacking = system, opened, ""
        self._parts: dict[bytes, tuple[LinearSystem, Any]] = {}
        self.rows = [self.pose(time, M) for time, M in rows]

    def part(self, M: Floats) -> LinearSystem:
        """Return the loops of a system with such a matrix, and nothing else."""
        acts = (M != 0.0).tobytes()
        if acts not in self._parts:  # most are alike
            system = _with_matrix(self.system, M)
            places = system.on(self.opened)
            self._parts[acts] = system.part(places), _ix(system, places)
        part, ix = self._parts[acts]
        return _with_matrix(part, M[ix])

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
        """The loops at the rows, and between them, where they come nearest to instability.

        Between two rows the matrices of the system are taken as linear. In most systems all values in between do
        occur, such as the slopes of friction at all speeds.
        """
        poses = [*self.rows]
        for loop, time in _minima(poses):
            for _ in range(_HALVINGS):
                k = next(k for k, pose in enumerate(poses) if pose.time == time)
                around = poses[max(k - 1, 0) : k + 2]
                more = [self._between(*pair) for pair in pairwise(around)]
                time = min((*around, *more), key=lambda pose: _modulus(pose)[loop]).time
                poses = sorted([*poses, *more], key=lambda pose: pose.time)
        return poses

    def _between(self, before: Pose, after: Pose) -> Pose:
        return self.pose((before.time + after.time) / 2.0, (before.matrix + after.matrix) / 2.0)

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
        found = [pose.loop.margins() for pose in self.poses if pose.loop is not None]
        modulus, gain, phase, delay = np.min([each[:4] for each in found], axis=0)
        return Margins(modulus, gain, phase, delay, self.rate)

    def growth(self, begin: float, end: float, above: float = SLOW) -> Growth:
        """Return where disturbances grow most beyond a rate [1/s], of a run from `begin` to `end` [s]."""
        times, rates = (np.array([getattr(pose, name) for pose in self.poses]) for name in ("time", "rate"))
        bounds = np.union1d(np.linspace(begin, max(end, times[-1]), _FINE), times[times >= begin])
        rate = np.interp(bounds, times, np.maximum(rates, -1e9))
        steps = np.diff(bounds) * ((rate[1:] + rate[:-1]) / 2.0 - above)
        most, run, first, place = -np.inf, 0.0, 0, (0, len(steps))  # a run that fails at once has no steps
        for k, step in enumerate(steps.tolist()):
            if run < 0.0 or not k:
                run, first = 0.0, k
            run += step
            if run > most:
                most, place = run, (first, k + 1)
        inside = [pose for pose in self.poses if bounds[place[0]] <= pose.time <= bounds[place[1]]]
        fastest = max(inside or self.poses, key=lambda pose: pose.rate)
        rate, state = self._fastest(fastest)
        return Growth(
            most, float(bounds[place[0]]), float(bounds[place[1]]), rate, state, place[1] == len(steps)
        )  # fmt: skip

    def nearest(self) -> Nearest | None:
        """Return where the loops come nearest to instability; None if they have no margins, see `lacking`."""
        if self.poses[0].loop is None:
            return None
        pose = min(self.poses, key=lambda pose: (_modulus(pose).min(), -pose.rate))
        least = _modulus(pose)
        name = self.system.parts.inputs[self.system.places(self.opened)[int(least.argmin())]]
        modulus = float(least.min())
        return Nearest(modulus, pose.time, name if modulus else self._fastest(pose)[1])

    def _fastest(self, pose: Pose) -> tuple[float, str]:
        return fastest_mode(self.part(pose.matrix))


def _modulus(pose: Pose) -> Floats:
    assert pose.loop is not None
    return pose.loop.modulus


def _minima(poses: Sequence[Pose]) -> list[tuple[int, float]]:
    """Return loops and times of the least minima over the run of their margins."""
    if poses[0].loop is None:
        return []
    modulus = np.array([_modulus(pose) for pose in poses])
    after, before = (np.pad(modulus, ((1, 1), (0, 0)), constant_values=np.inf)[k : k + len(poses)] for k in (2, 0))
    lowest = (modulus <= after) & (modulus <= before) & (modulus > 0.0) & (modulus <= _NEAR * modulus.min())
    found = sorted((modulus[k, loop], loop, poses[k].time) for k, loop in np.argwhere(lowest).tolist())
    return [(loop, time) for _, loop, time in found[:_MINIMA]]


def _matrix(system: LinearSystem) -> Floats:
    """Return all matrices of a system as one: rates, outputs and samples by states, inputs and sampled states."""
    parts, (_, E, G, F) = system.parts, system.samples
    return np.vstack([np.hstack([parts.A, parts.B, E]), np.hstack([parts.C, parts.D, G]), F])


def _with_matrix(system: LinearSystem, M: Floats) -> LinearSystem:
    (n, m), p = system.parts.B.shape, len(system.parts.C)
    parts = replace(
        system.parts, A=M[:n, :n], B=M[:n, n : n + m], C=M[n : n + p, :n], D=M[n : n + p, n : n + m]
    )  # fmt: skip
    samples = system.samples._replace(E=M[:n, n + m :], G=M[n : n + p, n + m :], F=M[n + p :])
    return replace(system, parts=parts, samples=samples)


def _ix(system: LinearSystem, places: Places) -> Any:
    """Return the places of a part in the matrix of a system."""
    (n, m), p, (x, u, y, s) = system.parts.B.shape, len(system.parts.C), places
    return np.ix_(np.concatenate([x, n + y, n + p + s]), np.concatenate([x, n + u, n + m + s]))


class _ChosenRows:
    """Rows of a run of n steps, chosen as it goes: closer together where its loops change."""

    def __init__(self, n: int, more: Collection[int]) -> None:
        self.n, self.row = n, 0
        self._more, self._next, self._gap, self._left = more, 0.0, 1.0, _ROWS

    def __contains__(self, row: int) -> bool:
        found = row >= self._next or row == self.n or row in self._more
        if found:
            self.row = row
        return found

    def go_on(self, change: float) -> None:
        """Choose the next row, after one with a change since the one before: 1 is as much as it should be."""
        self._left = max(self._left - 1, 1)
        gap = self._gap * min(max(1.0 / max(change, 1e-3), _SHRINK), _GROW)
        self._gap = min(max(gap, (self.n - self.row) / (4.0 * self._left), 1.0), max(self.n / _FEWEST, 1.0))
        self._next = self.row + self._gap

    def stop(self) -> None:
        """Choose no more rows."""
        self._next = math.inf


def _change(before: Pose, after: Pose) -> float:
    """Return how much loops change between two poses: 1 is as much as they should."""
    growing = max(before.rate, after.rate) > 0.0
    change = abs(after.rate - before.rate) * (after.time - before.time) / _GROWN if growing else 0.0
    if before.loop is not None and after.loop is not None:
        pair = np.array([before.loop.modulus, after.loop.modulus])
        change = max(change, float((np.ptp(pair, axis=0) / np.maximum(pair.min(axis=0), _SMALL)).max()) / _SHARE)
    return change


class Poses(Tap):
    """Linearises the loops of a run at some of its rows, if its components are in this process.

    Parameters
    ----------
    group : str
        Loops are opened at connected inputs of this name, at any component; if there are none, where `cut` says.
    tied : sequence of Tied
        See :func:`~vdfmu.engine.linear.loops.with_tied`.
    without : mapping
        Components to parameters, with values for a second look at the same states, such as no dry friction.
    again : bool
        Whether :meth:`changed` will be called.
    opened : sequence of str
        Inputs at which loops are opened instead.
    more : sequence of int
        Rows in addition to those by which a run is judged.
    noted : bool
        Whether a linearisation with notes will do.

    Attributes
    ----------
    lacking : str
        Why the loops are not known; empty if they are.
    notes : tuple of str
    others : Along or None
        Those of the second look.
    components : Components or None
    seconds : float
        Wall time of the looks [s].
    """

    def __init__(
        self, group: str, tied: Sequence[Tied] = (), *, without: Mapping[str, Mapping[str, Value]] | None = None,
        again: bool = False, opened: Sequence[str] = (), more: Sequence[int] = (), noted: bool = False,
    ) -> None:  # fmt: skip
        self._opened, self._group, self._tied, self._without, self._more = opened, group, tied, without or {}, more
        self._whole, self._noted = again or bool(without), noted
        self.lacking, self.notes = "", tuple[str, ...]()
        self.others: Along | None = None
        self.seconds = 0.0
        self.components: Components | None = None
        self._linearisation: Linearisation | None = None
        self._systems: list[tuple[float, LinearSystem]] = []
        self._rows = _ChosenRows(0, ())
        self._loops: Along | None = None
        self._linked: Any = None

    def rows(self, grid: Grid) -> Container[int]:
        """Begin a run; its rows are chosen as it goes."""
        self._rows, self._step = _ChosenRows(grid.n, self._more), grid.step
        return self._rows

    def take(self, k: int, time: float, components: Any) -> None:
        """Linearise the components."""
        if not isinstance(components, Components):
            self._rows.stop()
            return
        began = clock.perf_counter()
        try:
            self._look(components, time)
        except (VdfmuError, np.linalg.LinAlgError) as error:
            if isinstance(error, VdfmuError) or self._loops is None or not self._loops.rows:
                self.lacking = str(error)
            self._rows.stop()  # numbers that grow beyond all bounds: what is known until here is enough
        self.seconds += clock.perf_counter() - began

    def _look(self, components: Components, time: float) -> None:
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
            self.others = self.changed(self._without)

    @property
    def loops(self) -> Along:
        """The loops of the run; UsageError if they are not known."""
        if self._loops is None:
            raise UsageError(self.lacking or "loops: expected a run with rows")
        return self._loops

    def _begin(self, system: LinearSystem) -> Along:
        """Return what may lie on loops; UsageError if they are not known."""
        opened, self.notes = [*self._opened] or opened_at(system, self._group) or cut(system), system.parts.notes
        if self.notes and not self._noted:
            raise UsageError("; ".join(self.notes))
        if not opened:
            raise UsageError("no connected input lies on a loop")
        loops = system.around(opened)
        moving(loops)
        if loops.how.continuous and loops.samples.signals:
            raise UsageError(f"{loops.algorithm} takes as continuous what has sampled states")
        u, y = (np.flatnonzero(system.links.any(axis=axis)) for axis in (1, 0))
        places = np.arange(len(system.parts.A)), u, y, np.arange(len(system.samples.signals))
        self._linked = _ix(system, places)
        return Along(system.part(places), opened)

    def _matrix(self, system: LinearSystem) -> Floats:
        return _matrix(with_tied(system, self._tied))[self._linked]

    def changed(self, values: Mapping[str, Mapping[str, Value]], at: Sequence[int] | None = None) -> Along:
        """Return the loops with other values of parameters of some components, at the states of all rows or of some.

        Components must be as after the run, and :func:`~vdfmu.engine.linear.linearise.can_change`.
        """
        assert self.components is not None
        chosen = self._systems if at is None else [self._systems[k] for k in at]
        with ExitStack() as stack:
            for unit, new in values.items():
                instance = stack.enter_context(changed(self.components, unit, new))
                chosen = [(time, with_part(system, instance, time)) for time, system in chosen]
        along = self.loops
        return Along(along.system, along.opened, [(time, self._matrix(system)) for time, system in chosen])
