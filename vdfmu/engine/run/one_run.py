"""One run of components: its steps, its rows, its results."""

from __future__ import annotations

import signal
import time as clock
from collections.abc import Mapping, Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import numpy as np

from vdfmu.base.errors import CosimError
from vdfmu.base.interrupt import InterruptGuard
from vdfmu.engine.fmu.messages import LogMessage
from vdfmu.engine.masters.observer import Finite, Observed, Pace, Tap
from vdfmu.engine.plan.grid import Grid
from vdfmu.engine.results.formats import format_of
from vdfmu.engine.results.recorder import ROWS, SECONDS, Recorder, RowsInMemory
from vdfmu.engine.results.results import Results
from vdfmu.engine.run.session import Session


class Interrupted(KeyboardInterrupt):
    """The signal `number` stopped the run between two steps; `results` holds the rows so far."""

    def __init__(self, time: float, results: Results, number: int = signal.SIGINT) -> None:
        super().__init__(f"interrupted at t = {time:.9g} s")
        self.time = time
        self.results = results
        self.number = number


class Run:
    """A run of components that are initialized and coupled.

    It adds to the facts in `summary`, uses `record`, `observer` and `pace` of the `options`, see
    :class:`vdfmu.engine.options.RowOptions`, and writes rows to `files`. For `taps` see :meth:`vdfmu.Simulator.run`.
    """

    def __init__(
        self, session: Session, grid: Grid, summary: dict[str, Any], options: Mapping[str, Any],
        files: Sequence[Path] = (), taps: Sequence[Tap] = (),
    ) -> None:  # fmt: skip
        self._session, self._grid, self.summary, self._files, self._more = session, grid, summary, files, taps
        self._observer, speed = options["observer"], options["pace"]
        self._done = -1
        """The last complete row."""
        exchange = session.exchange
        self._one = session.stepping(grid)
        block, longest = (ROWS, SECONDS) if files and speed is None else (grid.n + 1, np.inf)
        self._signals, data, put = exchange.recorders(block, options["record"])
        self._rows = RowsInMemory(data, put)
        if files:
            self._rows = Recorder(files, self._signals, data, put, grid.times, longest)
        listed: list[Tap] = [Finite(), self._rows]
        if self._observer is not None:
            listed.append(Observed(self._observer, exchange, summary))
        guard = self._guard = InterruptGuard()
        self._stopped = lambda: guard.number != 0  # the stepper keeps this, and not the rows
        self._pace = None if speed is None else Pace(speed, grid.step, self._stopped)
        listed += [*taps, *([] if self._pace is None else [self._pace])]
        self._taps = [(tap.rows(grid), tap.take) for tap in listed]

    def steps(self, progress: Any) -> Results:
        """Do the steps and return the results; call ``progress(k, n)`` if it is not None."""
        session, grid, guard, box = self._session, self._grid, self._guard, self._session.box
        session.save = self._saved
        self._began = clock.perf_counter()
        stride = max(1, -(-grid.n // 100))
        try:
            with guard, self._pace or nullcontext(), np.errstate(invalid="ignore"):  # Finite reports them
                session.stepper.pressed = self._stopped
                self._row(0)
                self._done = 0
                if progress is not None:
                    progress(0, grid.n)
                while self._done < grid.n and not box.ended:
                    self._do(range(self._done, min(grid.n, self._done + stride)))
                    if progress is not None:
                        progress(self._done, grid.n)
        except CosimError as error:
            box.flush()
            error.results = self._results()
            if np.isnan(error.time):
                error.time = box.time
            raise
        except KeyboardInterrupt:
            box.flush()
            number = guard.number or signal.SIGINT
            raise Interrupted(grid.time(max(self._done, 0)), self._results(), number) from None
        for note in session.stepper.notes():
            self.summary["notes"].append(note)
            box.pending.append(LogMessage("", box.time, "note", "", note))
        box.flush()
        results = self._results()
        for tap in () if box.ended else self._more:
            tap.end(session.components)
        return results

    def _row(self, k: int) -> None:
        """Show row `k` to the taps."""
        time, components = self._grid.time(k), self._session.components
        for rows, take in self._taps:
            if k in rows:
                take(k, time, components)

    def _do(self, steps: range) -> None:
        """Do some steps, until a component ends the simulation."""
        box, one, row, guard = self._session.box, self._one, self._row, self._guard
        pending, ended = box.pending, box.ended
        for k in steps:
            one(k)
            row(k + 1)
            self._done = k + 1
            if ended:
                self._done = self._end(k, box.time)
                break
            if pending:
                box.flush()
            if guard.number:
                raise KeyboardInterrupt

    def _end(self, k: int, time: float) -> int:
        """Note that a unit ended the simulation in the step after row k, at `time`; return the last row."""
        box, exchange = self._session.box, self._session.exchange
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

    def _results(self) -> Results:
        """Return the rows so far, and write them to files whose format does not stream."""
        summary, done, box, rows = self.summary, self._done, self._session.box, self._rows
        summary["wall_s"] = clock.perf_counter() - self._began - rows.seconds
        if self._pace is not None:
            summary["wall_s"] -= self._pace.waited
            summary["pace"] = self._pace.facts()
        summary |= self._session.stepper.facts()
        time = self._grid.times(0, done + 1)
        if done == self._grid.n or "ended" in summary:
            time[done] = summary["stop"]
        results = Results(time, self._signals, rows.finish(time), summary, box.kept)
        for path in self._files if done >= 0 else ():
            if not (form := format_of(path)).streams:
                form.write(results, path)
        if self._observer is not None and done >= 0:
            getattr(self._observer, "end", lambda results: None)(results)
        return results

    def _saved(self) -> str:
        self._results()
        files = " and ".join(map(str, self._files))
        return f" The rows so far are in {files}." if files and self._done >= 0 else ""
