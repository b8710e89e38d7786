"""The components of one system, unpacked, loaded and freed, and their runs."""

from __future__ import annotations

import shutil
import signal
import tempfile
import time as clock
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack, nullcontext
from pathlib import Path
from typing import Any

import fmpy
import numpy as np

from vdfmu.base.errors import LOG, CosimError, UsageError, VdfmuError
from vdfmu.base.files import temporary_folder
from vdfmu.base.interrupt import InterruptGuard
from vdfmu.base.process import is_contained
from vdfmu.engine.fmu.description import is_own
from vdfmu.engine.fmu.messages import LogMessage, MessageBox
from vdfmu.engine.masters.components import Components, failure_message, report_exits
from vdfmu.engine.masters.observer import Observed, Pace
from vdfmu.engine.options import AUTO, FMPY, C, Limits
from vdfmu.engine.package.archive import Archive
from vdfmu.engine.plan.check import Checked
from vdfmu.engine.plan.grid import Grid
from vdfmu.engine.results.formats import format_of
from vdfmu.engine.results.recorder import ROWS, SECONDS, Blocks, Recorder, RowsInMemory, Tap, announce_size
from vdfmu.engine.results.results import Results
from vdfmu.engine.run.isolated import Isolated


class Session:
    """The components of a system for runs in a row; its exit frees them and removes the unpacked FMUs.

    For `isolate` and `limits` see `simulate`.
    """

    components: Components | Isolated

    def __init__(
        self,
        checked: Checked,
        log: Callable[[LogMessage], None] | None,
        isolate: bool | None,
        limits: Limits,
        coupling: tuple[float | None, float | None] = (None, None),
        stepper: str = AUTO,
    ) -> None:
        self.checked, self.box, self._limits, self._coupling = checked, MessageBox(log), limits, coupling
        self.resting = False
        """Whether no run uses the components."""
        self.stepper = stepper
        self.plan: RunPlan | None = None
        """Plan of the last run, if the next run may take it."""
        self.isolated = isolate
        self.results: Results | None = None
        """Results of the last run."""
        self.save: Callable[[], str] = lambda: ""
        """Saves the rows of the current run; returns a text about them."""
        self._stack = ExitStack()

    def __enter__(self) -> Session:
        try:
            folder = Path(self._stack.enter_context(temporary_folder("vdfmu-")))
        except OSError as error:
            raise no_room(tempfile.gettempdir(), error) from error
        self._tell()
        try:
            folders, foreign = unpack_units(self.checked, folder)
            once = any(each.once_per_process for each in self.checked.descriptions.values())
            self.isolated = foreign and not is_contained() if self.isolated is None else self.isolated
            if self.isolated:
                self.components = Isolated(self.checked, folders, self.box, folder, self._limits)
            else:
                self._stack.enter_context(report_exits(self.box, lambda: self._left(folder), lambda: self.resting))
                self.components = Components(self.checked, folders, self.box)
            self.lasts = not (foreign or self.isolated or once)
            """Whether components may stay loaded after a run, for others."""
            self.components.load()
        except BaseException as error:
            self.__exit__(type(error), error)
            raise
        self.exchange = self.components.exchange
        return self

    def _left(self, folder: Path) -> str:
        """Save the rows of a process that a component ends; return a text about them."""
        shutil.rmtree(folder, ignore_errors=True)
        return self.save()

    def __exit__(self, _: object, error: BaseException | None, *__: object) -> None:
        if self.results is not None:
            self.box.time = float(self.results.time[-1])
        failure = None
        try:
            if hasattr(self, "components"):
                failure = self.components.close()
        finally:
            self._stack.close()
            self.save = lambda: ""  # releases the run and the files of its memory
        if failure is not None and error is not None:
            self.box.pending.append(failure_message(failure))
        self.box.flush()
        if self.results is not None:
            self.results.messages = list(self.box.kept)
        if failure is not None and error is None:
            failure.results = self.results
            raise failure

    def reset(self, checked: Checked) -> None:
        """Return components to their state after loading; `checked` has their start values."""
        self.checked = checked
        self.box.flush()
        self.box.kept.clear()
        self.box.ended.clear()
        self.results, self.save, self.resting = None, lambda: "", False
        self._tell()
        self.components.reset(checked)

    def _tell(self) -> None:
        for note in self.checked.notes:
            self.box.pending.append(LogMessage("", 0.0, "note", "", note))
        self.box.flush()

    def planned(
        self,
        grid: Grid,
        record: Sequence[str] | None,
        files: Sequence[Path] = (),
        taps: Sequence[Tap] = (),
        paced: bool = False,
    ) -> RunPlan:
        """Return the plan of a run."""
        wanted, plan = (grid, None if record is None else tuple(record)), self.plan
        if plan is not None and plan.wanted == wanted and not (files or taps):
            assert plan.compiled is not None
            plan.compiled.row = 0
            return plan
        self.plan = None
        plan = RunPlan(self, wanted, self._coupling, files, taps, paced)
        if plan.lasts and not (files or taps):
            self.plan = plan
        return plan


class RunPlan:
    """Stepper, rows and steps of runs at the same times; `wanted` are their grid and the names of their signals."""

    def __init__(
        self,
        session: Session,
        wanted: tuple[Grid, Sequence[str] | None],
        coupling: tuple[float | None, float | None],
        files: Sequence[Path],
        taps: Sequence[Tap],
        paced: bool,
    ) -> None:
        self.wanted, exchange = wanted, session.exchange
        grid, record = wanted
        self.stepper = session.components.couple(*coupling, grid.end - grid.begin, record)
        block, longest = (ROWS, SECONDS) if files and not paced else (grid.n + 1, np.inf)
        self.signals, *_ = kept = exchange.recorders(block, record)
        announce_size(files, self.signals, grid.n + 1)
        self.rows = Recorder(files, *kept, grid.times, longest) if files else RowsInMemory(*kept[1:])
        self.blocks: list[Blocks] = []
        for tap in taps:
            names, memory, places = exchange.reals(tap.wanted)
            tap.begin(grid, names)
            self.blocks += [Blocks(tap, grid, names, memory, places)] if names else []
        keepers = [self.rows, *self.blocks]
        steps = "chosen" if session.stepper == FMPY else session.components.compiled(grid, keepers)
        if isinstance(steps, str) and session.stepper == C:
            raise UsageError(
                f"stepper: must be {FMPY} or {AUTO} here, got {C}. The steps cannot be made in C: {steps}."
            )
        self.how, self.compiled = (f"{FMPY}: {steps}", None) if isinstance(steps, str) else (C, steps)
        self.lasts = self.compiled is not None and self.compiled.lasting and grid.n <= ROWS
        box, advance = session.box, self.stepper.advance
        begin, end, step, n = grid
        last, rest = n - 1, grid.last

        def do_step(k: int) -> None:
            box.time = time = begin + k * step
            advance(time, step if k < last else rest, begin + (k + 1) * step if k < last else end)

        self.do_step = do_step


def unpack_units(checked: Checked, folder: Path) -> tuple[dict[str, Path], bool]:
    """Unpack the FMUs of a system; return their folders by source, and whether any of them is foreign.

    VdfmuError if the disk is full, or if Python FMUs cannot run in a folder of this name.
    """
    unpacked: dict[str, Path] = {}
    path, foreign = checked.system.path, False
    with Archive(path, path.name) as package:
        for source in dict.fromkeys(d.source for d in checked.descriptions.values()):
            unpacked[source] = folder / f"{len(unpacked)}"
            try:
                with package.opened(source, source) as unit:
                    foreign = foreign or not is_own(unit)
                    unit.extract(unpacked[source], _needed)
            except OSError as error:
                raise no_room(str(folder), error) from error
            _refuse_escapes(unpacked[source])
    return unpacked, foreign


def _refuse_escapes(folder: Path) -> None:
    """Raise if a Python FMU would crash the process: its wrapper decodes no URI escapes except of spaces."""
    uri = folder.as_uri()
    if (folder / "resources" / "slavemodule.txt").is_file() and "%" in uri.replace("%20", " "):
        raise VdfmuError(
            f"{folder}: the folder of Python FMUs must be ASCII letters, digits and spaces only. Choose another folder "
            "for temporary files with TMPDIR."
        )


def no_room(folder: str, error: OSError) -> VdfmuError:
    """Return the error of FMUs that cannot be unpacked."""
    return VdfmuError(f"{folder}: FMUs cannot be unpacked: {error}. Free space, or choose another folder with TMPDIR.")


def _needed(member: str) -> bool:
    places = "resources/", f"binaries/{fmpy.platform}/", f"binaries/{fmpy.platform_tuple}/"
    return member == "modelDescription.xml" or member.startswith(places)


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
    :class:`vdfmu.engine.options.RowOptions`, and writes rows to `files`. For `taps` see
    :meth:`vdfmu.engine.run.Simulator.run`.
    """

    def __init__(
        self,
        session: Session,
        grid: Grid,
        summary: dict[str, Any],
        options: Mapping[str, Any],
        files: Sequence[Path] = (),
        taps: Sequence[Tap] = (),
    ) -> None:
        self._session, self._grid, self.summary, self._files = session, grid, summary, files
        self._observer, speed = options["observer"], options["pace"]
        self._done = -1
        """The last complete row."""
        self._plan = plan = session.planned(grid, options["record"], files, taps, speed is not None)
        self._rows, self._compiled = plan.rows, plan.compiled
        self._taps: list[Tap] = []
        """Taps of single rows, in their order."""
        if self._observer is not None:
            self._taps.append(Observed(self._observer, session.exchange, summary))
        guard = self._guard = InterruptGuard()
        self._stopped = lambda: guard.number != 0  # the stepper keeps this, and not the rows
        self._pace = None if speed is None else Pace(speed, grid.step, self._stopped)
        self._taps += [*taps, *([] if self._pace is None else [self._pace])]
        summary["stepper"] = plan.how
        LOG.info("stepper: %s", plan.how)

    def steps(self, progress: Any) -> Results:
        """Do the steps and return the results; call ``progress(k, n)`` if it is not None."""
        session, grid, guard, box = self._session, self._grid, self._guard, self._session.box
        session.save = self._saved
        self._began = clock.perf_counter()
        stride = grid.n if progress is None else max(1, -(-grid.n // 100))
        try:
            with guard, self._pace or nullcontext(), np.errstate(invalid="ignore"):  # Finite reports them
                self._plan.stepper.pressed = self._stopped
                self._row(0)
                self._done = 0
                if progress is not None:
                    progress(0, grid.n)
                while self._done < grid.n and not box.ended:
                    self._do(min(grid.n, self._done + stride))
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
        for note in self._plan.stepper.notes():
            self.summary["notes"].append(note)
            box.pending.append(LogMessage("", box.time, "note", "", note))
        box.flush()
        return self._results()

    def _row(self, k: int) -> None:
        """Check and keep row `k`, and show it to the taps."""
        self._session.exchange.refuse_not_finite("doStep" if k else "initialization", self._grid.time(k))
        for keeper in (self._rows, *self._plan.blocks):
            keeper.keep(k)
        self._show(k)

    def _show(self, k: int) -> None:
        for tap in self._taps:
            if tap.due(k) == k:
                tap.take(k, self._grid.time(k), self._session.components)

    def _in_python(self, end: int) -> None:
        """Do a step with its row."""
        self._plan.do_step(self._done)
        self._row(self._done + 1)
        self._done += 1

    def _in_c(self, end: int) -> None:
        """Do steps with their rows to row `end` at most, and to the next row that a tap looks at."""
        assert self._compiled is not None
        due = min((tap.due(self._done + 1) for tap in self._taps), default=end)
        try:
            self._done = self._compiled.run(int(min(end, due)))
        except BaseException:
            self._done = self._compiled.row
            raise
        self._show(self._done)

    def _do(self, end: int) -> None:
        """Do steps to row `end`, until a component ends the simulation."""
        box, guard, advance = self._session.box, self._guard, self._in_c if self._compiled else self._in_python
        while self._done < end:
            advance(end)
            if box.ended:
                self._done = self._end(self._done - 1, box.time)
                break
            if box.pending:
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
        summary |= self._plan.stepper.facts()
        time = self._grid.times(0, done + 1)
        if done == self._grid.n or "ended" in summary:
            time[done] = summary["stop"]
        for block in self._plan.blocks:
            block.flush(done + 1)
        data = rows.finish(time)
        if self._session.plan is self._plan:  # the next run takes the memory
            data = {kind: array.copy() for kind, array in data.items()}
        results = Results(time, self._plan.signals, data, summary, box.kept)
        for path in self._files if done >= 0 else ():
            if not (form := format_of(path)).streams:
                form.write(results, path)
        if self._observer is not None and done >= 0:
            getattr(self._observer, "end", lambda results: None)(results)
        return results

    def _saved(self) -> str:
        if self._compiled is not None and not self._session.box.ended:
            self._done = max(self._done, self._compiled.row)
        self._results()
        files = " and ".join(map(str, self._files))
        return f" The rows so far are in {files}." if files and self._done >= 0 else ""
