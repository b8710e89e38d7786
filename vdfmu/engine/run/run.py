"""A run of loaded components: planned once, made row by row, and repeated if its plan stays valid."""

from __future__ import annotations

import signal
import time as clock
from collections.abc import Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import numpy as np

from vdfmu.base.errors import LOG, CosimError, UsageError
from vdfmu.base.interrupt import InterruptGuard
from vdfmu.engine.fmu.messages import LogMessage
from vdfmu.engine.masters.components import Components
from vdfmu.engine.masters.observer import Observed, Observer, Pace
from vdfmu.engine.options import AUTO, FMPY, C, SimulatorOptions
from vdfmu.engine.plan.grid import Grid
from vdfmu.engine.results.formats import format_of
from vdfmu.engine.results.recorder import ROWS, SECONDS, Blocks, Recorder, RowsInMemory, Tap, announce_size
from vdfmu.engine.results.results import Results
from vdfmu.engine.run.isolated import Isolated


class Interrupted(KeyboardInterrupt):
    """The signal `number` stopped the run between two steps; `results` holds the rows so far."""

    def __init__(self, time: float, results: Results, number: int = signal.SIGINT) -> None:
        super().__init__(f"interrupted at t = {time:.9g} s")
        self.time = time
        self.results = results
        self.number = number


def wanted(grid: Grid, record: Sequence[str] | None) -> object:
    """Return what determines the plan of a run of the same components, except files and taps."""
    return grid, None if record is None else tuple(record)


class Run:
    """A run of initialized components on a grid: its stepper, its rows, and its steps in C or in Python.

    :meth:`begin` makes the first row, :meth:`step` the next ones, and :meth:`results` returns them; :meth:`whole` does
    all of this. A run that `lasts` may begin again after a reset of its components, because start values do not change
    its plan. `record`, `observer` and `pace` are those of :class:`vdfmu.engine.options.RowOptions`; rows are written to
    `files`. For `taps` see :meth:`vdfmu.engine.run.Simulator.run`.
    """

    def __init__(
        self,
        components: Components | Isolated,
        grid: Grid,
        record: Sequence[str] | None,
        options: SimulatorOptions,
        files: Sequence[Path] = (),
        taps: Sequence[Tap] = (),
        paced: bool = False,
    ) -> None:
        self.grid, self._components, self._box = grid, components, components.box
        self._exchange, self._files, self._taps = components.exchange, files, taps
        self.wanted, stepper = wanted(grid, record), options["stepper"]
        """Values that its plan depends on."""
        span = grid.end - grid.begin
        self._stepper = components.couple(options["adaptive"], options["convergence"], span, record)
        block, longest = (ROWS, SECONDS) if files and not paced else (grid.n + 1, np.inf)
        self._signals, *_ = kept = self._exchange.recorders(block, record)
        announce_size(files, self._signals, grid.n + 1)
        self._rows = Recorder(files, *kept, grid.times, longest) if files else RowsInMemory(*kept[1:])
        self._blocks: list[Blocks] = []
        for tap in taps:
            names, memory, places = self._exchange.reals(tap.wanted)
            tap.begin(grid, names)
            self._blocks += [Blocks(tap, grid, names, memory, places)] if names else []
        steps = "chosen" if stepper == FMPY else components.compiled(grid, [self._rows, *self._blocks])
        if isinstance(steps, str) and stepper == C:
            raise UsageError(
                f"stepper: must be {FMPY} or {AUTO} here, got {C}. The steps cannot be made in C: {steps}."
            )
        self._how, self._steps = (f"{FMPY}: {steps}", None) if isinstance(steps, str) else (C, steps)
        self.lasts = bool(self._steps and self._steps.lasting and grid.n <= ROWS and not (files or taps))
        """Whether it may be repeated."""
        self._times = grid.times(0, grid.n + 1) if self.lasts else None
        self.row = -1
        """The last complete row."""
        self.summary: dict[str, Any] = {}
        self._looks: list[Tap] = []
        """Taps of single rows, in order."""
        self._guard, self._observer, self._pace = InterruptGuard(), None, None
        self._began = 0.0

    @property
    def time(self) -> float:
        """Time [s] of the last row."""
        return self.grid.time(max(self.row, 0))

    def by_hand(self) -> None:
        """Discard the facts and taps of the previous run, because steps by hand have none."""
        self.summary, self._looks = {"notes": [], "stop": self.grid.end}, []
        self._observer = self._pace = None

    def begin(self) -> None:
        """Make the first row; the components must be at their start."""
        self._exchange.row.value, self.row = 0, -1
        self._keep(0)
        self.row = 0

    def step(self, end: int) -> None:
        """Make steps up to row `end`, or until a component ends the simulation."""
        box, guard, advance = self._box, self._guard, self._in_c if self._steps is not None else self._in_python
        while self.row < end:
            advance(end)
            if box.ended:
                self.row = self._end(self.row - 1, box.time)
                break
            if box.pending:
                box.flush()
            if guard.number:
                raise KeyboardInterrupt

    def whole(
        self, summary: dict[str, Any], progress: Any, observer: Observer | None = None, speed: float | None = None
    ) -> Results:
        """Begin, make all steps and return the results, with `summary` added to their facts.

        Calls ``progress(k, n)`` if it is not None. `speed` is the option `pace`.
        """
        grid, box = self.grid, self._box
        guard = self._guard = InterruptGuard()
        stopped = self._stepper.pressed = lambda: guard.number != 0
        self.summary, self._observer = summary, observer
        self._pace = None if speed is None else Pace(speed, grid.step, stopped)
        watching = [] if observer is None else [Observed(observer, self._exchange, summary)]
        self._looks = [*watching, *self._taps, *([] if self._pace is None else [self._pace])]
        summary["stepper"] = self._how
        LOG.info("stepper: %s", self._how)
        self._began = clock.perf_counter()
        stride = grid.n if progress is None else max(1, -(-grid.n // 100))
        try:
            with guard, self._pace or nullcontext(), np.errstate(invalid="ignore"):  # `refuse_not_finite` reports them
                self.begin()
                if progress is not None:
                    progress(0, grid.n)
                while self.row < grid.n and not box.ended:
                    self.step(min(grid.n, self.row + stride))
                    if progress is not None:
                        progress(self.row, grid.n)
        except CosimError as error:
            box.flush()
            error.results = self.results()
            if np.isnan(error.time):
                error.time = box.time
            raise
        except KeyboardInterrupt:
            box.flush()
            raise Interrupted(self.time, self.results(), guard.number or signal.SIGINT) from None
        for note in self._stepper.notes():
            summary["notes"].append(note)
            box.pending.append(LogMessage("", box.time, "note", "", note))
        box.flush()
        return self.results()

    def _keep(self, k: int) -> None:
        """Check and store row `k`, and show it to the taps."""
        self._exchange.refuse_not_finite("doStep" if k else "initialization", self.grid.time(k))
        for keeper in (self._rows, *self._blocks):
            keeper.keep(k)
        self._show(k)

    def _show(self, k: int) -> None:
        for tap in self._looks:
            if tap.due(k) == k:
                tap.take(k, self.grid.time(k), self._components)

    def _in_python(self, end: int) -> None:
        """Make a step and its row."""
        grid, k = self.grid, self.row
        self._box.time = time = grid.time(k)
        self._stepper.advance(time, grid.step if k < grid.n - 1 else grid.last, grid.time(k + 1))
        self._keep(k + 1)
        self.row = k + 1

    def _in_c(self, end: int) -> None:
        """Make steps and their rows up to row `end` or the next row that a tap needs."""
        assert self._steps is not None
        due = min((tap.due(self.row + 1) for tap in self._looks), default=end)
        try:
            self.row = self._steps.run(int(min(end, due)))
        except BaseException:
            self.row = self._exchange.row.value
            raise
        self._show(self.row)

    def _end(self, k: int, time: float) -> int:
        """Note that a unit ended the simulation in the step after row k, at `time`; return the last row."""
        box, exchange = self._box, self._exchange
        unit, at = min(box.ended.items(), key=lambda item: item[1])
        reached = exchange.clock.value + exchange.size.value
        if not time <= at <= reached:  # the unit has no last successful time, or rounds it differently
            at = reached
        last = k + 1 if at > time else k
        note = f"{unit} ended the simulation at t = {at:.9g} s"
        if at < reached and last > k:
            note += f"; the last row has its values at this time, and values of other units at t = {reached:.9g} s"
        self.summary |= {"stop": at, "steps": last, "ended": {"component": unit, "time": at}}
        self.summary["notes"].append(note)
        box.pending.append(LogMessage("", at, "note", "", note))
        return last

    def results(self) -> Results:
        """Return the rows so far, after writing them to files whose format does not stream."""
        summary, done, box, rows = self.summary, self.row, self._box, self._rows
        summary["wall_s"] = clock.perf_counter() - self._began - rows.seconds
        if self._pace is not None:
            summary["wall_s"] -= self._pace.waited
            summary["pace"] = self._pace.facts()
        summary |= self._stepper.facts()
        if box.events.facts:
            summary["events"] = box.events.facts
        time = self.grid.times(0, done + 1) if self._times is None else self._times[: done + 1].copy()
        if done == self.grid.n or "ended" in summary:
            time[done] = summary["stop"]
        for block in self._blocks:
            block.flush(done + 1)
        data = rows.finish(time)
        if self.lasts:  # the next run reuses the memory
            data = {kind: array.copy() for kind, array in data.items()}
        results = Results(time, self._signals, data, summary, box.kept)
        for path in self._files if done >= 0 else ():
            if not (form := format_of(path)).streams:
                form.write(results, path)
        if self._observer is not None and done >= 0:
            getattr(self._observer, "end", lambda results: None)(results)
        return results

    def saved(self) -> str:
        """Save the rows of a process that a component ends; return a text about them."""
        if self._steps is not None and not self._box.ended:
            self.row = max(self.row, self._exchange.row.value)
        self.results()
        files = " and ".join(map(str, self._files))
        return f" The rows so far are in {files}." if files and self.row >= 0 else ""
