"""Solves a system of units with scipy, row by row: the solvers, and events between their steps.

scipy's solvers were chosen by measurement on the shipped scenarios, at errors of at most 1e-11 rad against themselves
with tolerances of 1e-13. Inputs jump at communication points, so sampled intervals are short: the explicit method of
order 8. Over seconds the elastic modes and the friction near standstill make the system stiff in places: LSODA changes
its method. In compiled code, the implicit method of order 9 takes a fifth of LSODA's time at the same error.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from itertools import islice, pairwise
from typing import Any

import numpy as np

from vdfmu.base.arrays import Floats, odeint, scipy_part
from vdfmu.base.errors import UsageError, VdfmuError
from vdfmu.base.interrupt import InterruptGuard
from vdfmu.compiler.unit.events import PARTS, Motion, UnitEvents, parts_of, steps_of
from vdfmu.compiler.unit.solver import Slopes, Solver, samples, switchings
from vdfmu.system.reference.compiled import (
    CompiledContinuous,
    CompiledRows,
    CompiledSampled,
    Repeated,
    compiles,
    no_finite_state,
)
from vdfmu.system.reference.wired import Action, Carry, Evaluate, Places, Run, TimeSetter, WiredUnits

SHORT: dict[str, Any] = {"rtol": 1e-9, "atol": 1e-11}
"""Tolerances between communication points; errors are 2e-13 rad in the tracking and the two-joint run."""
_LONG: dict[str, Any] = {"rtol": 1e-12, "atol": 1e-13}
"""Tolerances for whole runs, in which errors accumulate: 5e-13 rad in the tracking run, 4e-12 in the two-joint run."""
_DENSE: dict[str, Any] = {"rtol": 3e-12, "atol": 3e-13}
"""Tolerances of the polynomials of Radau IIA. The errors of their ends are smaller; only these add up."""
_CLOSE = 1e-9
"""Fraction of a period below which two times are equal."""
_STRETCH = 1000
"""Most rows of the continuous reference that scipy solves at a time."""
_STRETCH_WITH_EVENTS = 50
"""The same with events, each of which ends a solution."""
_MOST_STEPS = 100_000
"""Most steps of scipy in a communication step or between rows, far more than a finite solution needs."""
_MOST_REPEATED = 1000
"""Most steps of the explicit method in an interval that is solved again; it is stiff if it needs more."""
_LONGEST = 0.05
"""Longest step of the continuous reference [s], so that it does not miss a late motion."""


class _RightHandSide:
    """Right-hand side f(t, x) of a solver: `run` reads `x` and sets `x_dot` (n_x,), `feed` sets inputs for a time."""

    def __init__(self, run: Run, x: Floats, x_dot: Floats, feed: Callable[[float], None] | None = None) -> None:
        self._run, self._x, self._x_dot, self._feed = run, x, x_dot, feed
        self.error: BaseException | None = None
        """Exception of a call, kept because some solvers of scipy drop it and end normally."""
        self.slopes = Slopes(self)

    def __call__(self, t: float, x: Floats) -> Floats:
        try:
            self._x[...] = x  # faster than [:]
            if self._feed is not None:
                self._feed(t)
            self._run(t)
        except BaseException as error:
            self.error = error
            raise
        return self._x_dot


class _Dop853:
    """The states of a right-hand side by scipy's method of order 8."""

    def __init__(
        self, right: _RightHandSide, x: Floats, tolerances: dict[str, Any], most_steps: int = _MOST_STEPS
    ) -> None:
        self._right, self._x = right, x
        self.rate = right.__call__  # faster than a callable object
        ode = scipy_part("scipy.integrate._ode").ode(right)
        ode.set_integrator("dop853", **tolerances, nsteps=most_steps)
        ode.set_solout(lambda t, x: None)  # otherwise the solver continues after an error
        self._solver = ode._integrator
        self._solver.reset(x.size, False)

    def solve(self, t: float, to: float, steps: int = 1) -> int:
        """Move the states from `t` to `to` [s], at first by a part of this in `steps`.

        Return the number of steps; negative without a finite solution.
        """
        x, solver = self._x, self._solver
        solver.work[6] = (to - t) / max(steps, 1)
        # `ode.integrate` takes longer than a short interval; this solver would turn an exception of a signal in the
        # right-hand side into a number or a ValueError
        with InterruptGuard():
            try:
                _, x[...], *_, state = solver.runner(self.rate, t, x, to, *solver.call_args, ())
            except (SystemError, ValueError) as error:  # it continues after an exception in the right-hand side
                raise self._right.error or error from None
        if self._right.error is not None:
            raise self._right.error
        return int(solver.iwork[18]) if state >= 0 and math.isfinite(x @ x) else -1


class _Mover(Solver):
    """Integrates the states of a unit between communication points with held inputs."""

    def __init__(self, system: WiredUnits, name: str, run: Run | None, update: Run | None) -> None:
        super().__init__(system.units[name])
        self._name, self._update, unit = name, update, self.unit
        self.is_undivided = not (unit.interface.is_sampled or unit.switches or unit.at_events)
        """Whether nothing divides an interval."""
        self.events.begin()
        self.steps = 1
        """Number of steps of the last interval, into which the next is divided at first."""
        if run is not None:
            self._dop853 = _Dop853(_RightHandSide(run, unit.x, unit.x_dot), unit.x, SHORT)
            self.rate = self._dop853.rate

    def sample(self, t: float) -> None:
        """Update the sampled states at `t` [s]."""
        if self._update is not None:
            self._update(t)

    def solve(self, t: float, to: float) -> None:
        """Integrate the states from `t` to `to` [s]; VdfmuError if that fails."""
        self.steps = self._dop853.solve(t, to, self.steps)
        if self.steps < 0:
            raise no_finite_state(self._name, t)


class _Solution:
    """Rows of the outputs of a system, in compiled code with intervals that scipy solves again, or by scipy.

    Attributes
    ----------
    lists : dict of str to list of Action
        Parts of the calculation.
    repeated : Repeated
    """

    lists: dict[str, list[Action]]

    def __init__(self, system: WiredUnits) -> None:
        self._system = system
        self._rows: CompiledRows | None = None
        self.repeated = Repeated()

    def blocks(self, t: Floats, run: Mapping[str, Run], every: int, block: int, shown: Places) -> Iterator[Floats]:
        """Yield the outputs (m, k) at `shown` places at each `every`-th of the times `t` (n,) [s], `block` at a time.

        `run` has a function for each of `lists`. Systems without events are solved in compiled code, if its functions
        are. Then :meth:`repeat` compares intervals of the last block with scipy.
        """
        compiled = compiles(run) and self._system.x.size > 0  # without states there is nothing to solve
        if compiled and not any(unit.at_events for unit in self._system.units.values()):
            self._rows = self._compiled(t, run, shown)
        if self._rows is not None:
            yield from self._rows.blocks(t, every, block)
            return
        rows = (self._system.memory[shown] for _ in islice(self.solve(t, run), 0, None, every))
        while some := [*islice(rows, block)]:
            yield np.array(some)

    def _compiled(self, t: Floats, run: Mapping[str, Run], shown: Places) -> CompiledRows | None:
        """Return the rows in compiled code, if it can solve this system."""
        raise NotImplementedError

    def solve(self, t: Floats, run: Mapping[str, Run]) -> Iterator[None]:
        """Yield as soon as the memory has the outputs of each of the times `t` (m,) [s], by scipy."""
        raise NotImplementedError

    def _states(self) -> Floats:
        return self._system.memory[self._system.x]

    def _by_scipy(self, rows: Any, k: int) -> tuple[Floats, int]:
        """Return the states after an interval of a block, and the steps to there, by scipy."""
        raise NotImplementedError

    def repeat(self, back: int) -> None:
        """Solve the interval before the row `back` rows ago by scipy too, if it was solved in compiled code.

        VdfmuError for a difference of more than 10 times the tolerance `SHORT`, of a norm over all states in each step.
        Where a speed changes its sign, friction makes the errors of both some times as large as they estimate.
        """
        if self._rows is None:
            return
        memory = self._system.memory.copy()
        k, rows = -1 - back, self._rows
        t, to = rows.intervals[k].tolist()
        x, steps = self._by_scipy(rows, k)
        self._system.memory[:] = memory
        apart = np.abs(rows.after[k] - x)
        allowed = 10.0 * (steps + 1) * math.sqrt(x.size) * (SHORT["atol"] + SHORT["rtol"] * np.abs(x))
        if np.any(apart > allowed):
            raise VdfmuError(
                f"The reference failed: from t = {t:.9g} s to {to:.9g} s its compiled solver and scipy's differ by "
                f"{apart.max():.3g}. Report it, and run without the reference."
            )
        self.repeated.difference = max(self.repeated.difference, float(apart.max()))
        self.repeated.intervals += 1


class SampledReference(_Solution):
    """Reference with outputs held over a communication step. If `delayed`, units read other outputs a sample late.

    `moving` are the units with states, in the order of a step. `lists` are the parts of the calculation: ``part_0``,
    then ``part_<i+1>`` after the i-th of `moving`.
    """

    def __init__(self, system: WiredUnits, delayed: bool) -> None:
        super().__init__(system)
        self.lists = {}
        self.moving: list[str] = []
        part: list[Action] = [system.links_before_step(delayed)]
        self.lists["part_0"] = part
        for name in list(system.units) if delayed else system.order():
            unit, i = system.units[name], len(self.moving)
            if not delayed:
                part.append(system.links_within_step(name))
            if unit.x.size or unit.interface.is_sampled or unit.at_events:
                if unit.x.size:
                    self.lists[f"rate_{i}"] = [TimeSetter(system.clock(name)), Evaluate(name, "derivatives")]
                if unit.interface.is_sampled:
                    self.lists[f"update_{i}"] = [TimeSetter(system.clock(name)), Evaluate(name, "update")]
                self.moving.append(name)
                self.lists[f"part_{i + 1}"] = part = []
            part += [TimeSetter(system.clock(name)), Evaluate(name, "outputs")]

    def _movers(self, run: Mapping[str, Run]) -> list[_Mover]:
        """Keep what a step by scipy takes, and return the movers."""
        movers = [
            _Mover(self._system, name, run.get(f"rate_{i}"), run.get(f"update_{i}"))
            for i, name in enumerate(self.moving)
        ]
        self._parts = [run[f"part_{i}"] for i in range(len(movers) + 1)]
        self._moves = [mover.solve if mover.is_undivided else mover.move for mover in movers]
        return movers

    def _compiled(self, t: Floats, run: Mapping[str, Run], shown: Places) -> CompiledRows:
        self._scipy_movers = movers = self._movers(run)
        moves = {name: mover.move for name, mover in zip(self.moving, movers, strict=True) if not mover.is_undivided}
        return CompiledSampled(self._system, shown, self.moving, run, moves, SHORT)

    def solve(self, t: Floats, run: Mapping[str, Run]) -> Iterator[None]:
        """See :meth:`_Solution.solve`."""
        self._movers(run)
        yield
        for begin, end in pairwise(t.tolist()):
            self._step(begin, end)
            yield

    def _step(self, begin: float, end: float) -> None:
        first, *rest = self._parts
        self._system.feed(begin, held=True)
        first(end)
        for move, outputs in zip(self._moves, rest, strict=True):
            move(begin, end)
            outputs(end)

    def _by_scipy(self, rows: CompiledSampled, k: int) -> tuple[Floats, int]:
        self._system.memory[:] = rows.before[k]
        for mover, steps in zip(self._scipy_movers, rows.steps[k].tolist(), strict=True):
            mover.steps = steps
        self._step(*rows.intervals[k].tolist())
        return self._states(), max(mover.steps for mover in self._scipy_movers)


class ContinuousReference(_Solution):
    """Reference without sampling, except for sampled states. `lists` are the parts of the calculation."""

    def __init__(self, system: WiredUnits) -> None:
        super().__init__(system)
        moving = [Evaluate(name, "derivatives") for name, unit in system.units.items() if unit.x.size]
        try:
            order = system.order()
        except UsageError:  # no sampled reference exists
            order = list(system.units)
        sampled = [name for name in order if system.units[name].interface.is_sampled]
        self._updates = {name: f"update_{i}" for i, name in enumerate(sampled)}
        self.lists = {
            "inputs": system.evaluate,
            "outputs": [*system.evaluate, *(Evaluate(name, "outputs") for name in system.units)],
            "rate": [*system.evaluate, *moving, Carry(system.x_dot, system.solver_x_dot)],
            **{key: [Evaluate(name, "update"), *system.evaluate] for name, key in self._updates.items()},
        }

    def _right(self, run: Mapping[str, Run]) -> _RightHandSide:
        system = self._system
        changing = any(not course.held for _, course in system.outside)
        x, x_dot = (system.memory[each[0] : each[-1] + 1] for each in (system.solver_x, system.solver_x_dot))
        return _RightHandSide(run["rate"], x, x_dot, self._feed if changing else None)

    def _compiled(self, t: Floats, run: Mapping[str, Run], shown: Places) -> CompiledRows | None:
        if self._updates or self._system.outside or any(unit.switches for unit in self._system.units.values()):
            return None
        self._rate, self._x = self._right(run), self._states()
        self._dop853 = _Dop853(self._rate, self._x, _LONG, _MOST_REPEATED)
        return CompiledContinuous(self._system, shown, run, _DENSE, float(t[-1]), _LONGEST)

    def _by_scipy(self, rows: CompiledRows, k: int) -> tuple[Floats, int]:
        t, to = rows.intervals[k].tolist()
        self._x[:] = rows.before[k]
        steps = self._dop853.solve(t, to)
        if steps >= 0:
            return self._x, steps
        from scipy.integrate import solve_ivp  # takes long to import

        rate = lambda t, x: self._rate(t, x).copy()  # noqa: E731 # solve_ivp keeps it
        solved = solve_ivp(rate, (t, to), rows.before[k], method="Radau", **_LONG)  # near an equilibrium LSODA is slow
        if not solved.success:
            raise VdfmuError(f"The continuous reference failed after t = {t:.9g} s: {solved.message}")
        return solved.y[:, -1], len(solved.t) - 1

    def solve(self, t: Floats, run: Mapping[str, Run]) -> Iterator[None]:
        """See :meth:`_Solution.solve`."""
        system, x = self._system, self._states()
        rate = self._right(run) if x.size else None
        events = UnitEvents(list(system.units.values()), partial(self._calculate, run["inputs"]), self._states)
        self._calculate(run["outputs"], 0.0, x)
        events.begin()
        yield
        k = 1
        for begin, end, sampled in self._parts(float(t[-1])):
            system.feed(begin, held=True)
            self._calculate(run["inputs"], begin, x)
            for name in self._updates:
                if name in sampled:
                    run[self._updates[name]](begin)
            time_left = lambda time: self._left(run["inputs"], time, x)  # noqa: B023, E731 # x at the time of the call
            whole = [(begin, end, False)]  # an event may move a switching
            for part, last, crossing in whole if events else switchings(time_left, begin, end):
                if crossing:
                    assert rate is not None
                    self._feed(part)
                    x = x + (last - part) * rate(part, x)
                stop = len(t) if last == t[-1] else int(np.searchsorted(t, last + _CLOSE * (last - part)))
                while part < last:
                    points = t[k : min(k + (_STRETCH_WITH_EVENTS if events else _STRETCH), stop)]
                    k += len(points)
                    to = last if k == stop else float(points[-1])
                    if events:
                        states = _with_events(events, self._motion(run["inputs"], rate, x), part, to, x, points)
                    else:
                        states = iter(_solved(None if crossing else rate, part, to, x, points))
                    for point, state in zip(points.tolist(), states, strict=False):
                        self._calculate(run["outputs"], point, state)
                        yield
                    x = next(states)
                    part = to

    def _motion(self, inputs: Run, rate: _RightHandSide | None, x: Floats) -> Motion:
        """Return the motion of the states between events."""
        if rate is None or not any(unit.switches for unit in self._system.units.values()):
            return lambda t, start, times: _solved(rate, t, float(times[-1]), start, times[:-1])
        states = x.copy()

        def advance(t: float, duration: float) -> None:
            left = partial(self._left, inputs, x=states)
            for part, last, crossing in switchings(left, t, t + duration):
                if crossing:
                    self._feed(part)
                    states[:] = states + (last - part) * rate(part, states)
                else:
                    states[:] = _solved(rate, part, last, states, np.empty(0))[0]

        return steps_of(advance, states)

    def _left(self, inputs: Run, t: float, x: Floats) -> float:
        """Return the time until a unit switches by time."""
        switching = [u for u in self._system.units.values() if u.switches]
        if switching:
            self._calculate(inputs, t, x)
        return min((unit.left(t) for unit in switching), default=math.inf)

    def _feed(self, t: float) -> None:
        self._system.feed(t, held=False)

    def _calculate(self, run: Run, t: float, x: Floats) -> None:
        self._feed(t)
        self._system.memory[self._system.solver_x] = x
        run(t)

    def _parts(self, stop: float) -> Iterator[tuple[float, float, list[str]]]:
        """Yield the intervals between samples, jumps and bends: start, end, and units with a sample at the start."""
        points: list[tuple[float, float, list[str]]] = [
            (begin, _CLOSE * float(self._system.units[name].group("period")[0]), [name])
            for name in self._updates
            for begin, _, sampled in samples(self._system.units[name], 0.0, 0.0, stop)
            if sampled
        ]
        for _, course in self._system.outside:
            close = course.tolerance
            points += [(time, close, []) for time in course.breaks.tolist() if 0.0 < time < stop - close]
        points.sort(key=lambda point: point[0])
        begin, units = 0.0, []
        for time, close, sampled in points:
            if time - begin > close:  # otherwise it is also a sample of another unit
                yield begin, time, units
                begin, units = time, []
            units += sampled
        yield begin, stop, units


def _with_events(
    events: UnitEvents, motion: Motion, begin: float, end: float, x: Floats, points: Floats
) -> Iterator[Floats]:
    """Yield the states at points between two times [s] and at the end, with the events until then."""
    times, row = [begin, *(point for point in points.tolist() if point < end), end], x
    for row in islice(events.move(motion, begin, x, parts_of(times)), PARTS - 1, None, PARTS):
        yield row
    if len(times) == len(points) + 1:  # the last point is the end
        yield row


def _solved(rate: _RightHandSide | None, begin: float, end: float, x: Floats, points: Floats) -> Floats:
    """Return scipy's solution at points between two times [s] and at the end, row by row; x without a rate."""
    if rate is None:
        return np.tile(x, (len(points) + 1, 1))
    times = np.concatenate([[begin], np.minimum(points, end), [end]])
    options: Any = {"tcrit": [end], "hmax": _LONGEST, "mxstep": _MOST_STEPS, **_LONG}
    options |= {"Dfun": rate.slopes, "col_deriv": 1}
    states, fault = odeint(rate.__call__, x, times, **options)
    if fault:
        raise VdfmuError(f"The continuous reference failed after t = {begin:.9g} s: {fault}")
    return states[1:]
