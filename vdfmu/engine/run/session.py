"""The components of one system, unpacked, loaded and freed, and their runs; a handler for calls of C's ``exit``."""

from __future__ import annotations

import ctypes
import inspect
import os
import platform
import shutil
import signal
import sys
import tempfile
import time as clock
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, nullcontext, suppress
from pathlib import Path
from typing import Any

import fmpy
import numpy as np

from vdfmu.base.errors import LOG, CosimError, VdfmuError
from vdfmu.base.files import temporary_folder
from vdfmu.base.interrupt import InterruptGuard
from vdfmu.engine.fmu.description import is_ours
from vdfmu.engine.fmu.instance import Instance
from vdfmu.engine.fmu.messages import LogMessage, MessageBox
from vdfmu.engine.masters.compiled import CompiledSteps, obstacle
from vdfmu.engine.masters.components import Components, failure_message
from vdfmu.engine.masters.observer import Finite, Observed, Pace, Tap
from vdfmu.engine.masters.sampled import Stepper
from vdfmu.engine.package.archive import Archive
from vdfmu.engine.plan.check import Checked
from vdfmu.engine.plan.grid import Grid
from vdfmu.engine.results.formats import format_of
from vdfmu.engine.results.recorder import ROWS, SECONDS, Recorder, RowsInMemory
from vdfmu.engine.results.results import Results
from vdfmu.engine.run.isolated import Elsewhere, Isolated, Limits, Making


class Session:
    """The components of a system for runs in a row; its exit frees them and removes the unpacked FMUs.

    For `isolate` and `limits` see `simulate`; `apart`, if given, replaces `Isolated`.
    """

    components: Components | Elsewhere
    stepper: Stepper

    def __init__(
        self, checked: Checked, log: Callable[[LogMessage], None] | None, isolate: bool | None, limits: Limits,
        apart: Making | None = None,
    ) -> None:  # fmt: skip
        self.checked, self.box, self._limits = checked, MessageBox(log), limits
        self.isolated = isolate if apart is None else True
        self.results: Results | None = None
        """Results of the last run."""
        self.save: Callable[[], str] = lambda: ""
        """Saves the rows of the current run; returns a text about them."""
        self._apart = apart or Isolated
        self._stack = ExitStack()

    def __enter__(self) -> Session:
        try:
            folder = Path(self._stack.enter_context(temporary_folder("vdfmu-")))
        except OSError as error:
            raise no_room(tempfile.gettempdir(), error) from error
        for note in self.checked.notes:
            self.box.pending.append(LogMessage("", 0.0, "note", "", note))
        self.box.flush()
        try:
            folders, isolated = unpack_units(self.checked, folder)
            self.isolated = isolated if self.isolated is None else self.isolated
            if self.isolated:
                self.components = self._apart(self.checked, folders, self.box, folder, self._limits)
            else:
                self._stack.enter_context(report_exits(self.box, lambda: self._left(folder)))
                self.components = Components(self.checked, folders, self.box)
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
        """Return components that are not isolated to their state after loading; `checked` has their start values."""
        assert isinstance(self.components, Components)
        self.checked = self.components.checked = checked
        self.box.flush()
        self.box.kept.clear()
        self.box.ended.clear()
        self.results, self.save = None, lambda: ""
        self.components.reset()

    def stepping(self, grid: Grid) -> Callable[[int], None]:
        """Return the function for step k of a run."""
        box, advance = self.box, self.stepper.advance
        begin, end, step, n = grid
        last, rest = n - 1, grid.last

        def do_step(k: int) -> None:
            box.time = time = begin + k * step
            advance(time, step if k < last else rest, begin + (k + 1) * step if k < last else end)

        return do_step


def unpack_units(checked: Checked, folder: Path) -> tuple[dict[str, Path], bool]:
    """Unpack the FMUs of a system; return their folders by source, and whether to isolate them by default.

    FMUs without the mark of this project are isolated; the mark can be forged. VdfmuError if the disk is full, or if
    Python FMUs cannot run in a folder of this name.
    """
    unpacked: dict[str, Path] = {}
    path, isolated = checked.system.path, False
    with Archive(path, path.name) as package:
        for source in dict.fromkeys(d.source for d in checked.descriptions.values()):
            unpacked[source] = folder / f"{len(unpacked)}"
            try:
                with package.opened(source, source) as unit:
                    isolated = isolated or not is_ours(unit.names)
                    unit.extract(unpacked[source], _needed)
            except OSError as error:
                raise no_room(str(folder), error) from error
            _refuse_escapes(unpacked[source])
    return unpacked, isolated


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
    """Whether a member of an FMU is needed to run it."""
    places = "resources/", f"binaries/{fmpy.platform}/", f"binaries/{fmpy.platform_tuple}/"
    return member == "modelDescription.xml" or member.startswith(places)


@contextmanager
def report_exits(box: MessageBox, save: Callable[[], str]) -> Generator[None]:
    """Report a component that ends the process, save the rows, and make the exit code 1; `save` returns a text on them.

    For the C libraries of Linux (glibc) and macOS; no others can remove a handler.
    """
    if platform.libc_ver()[0] != "glibc" and sys.platform != "darwin":
        yield
        return
    process, over = os.getpid(), False

    @ctypes.CFUNCTYPE(None, ctypes.c_void_p)
    def at_exit(_: int | None) -> None:
        if over or os.getpid() != process:  # in a process that the component has forked
            return
        with suppress(BaseException):
            where = save()
            sys.stderr.write(f"error: {_caller()} ended the process at t = {box.time:.9g} s.{where}\n")
            sys.stderr.flush()
        os._exit(1)

    library, key = ctypes.CDLL(None), ctypes.byref(ctypes.c_char())
    library.__cxa_atexit(at_exit, None, key)
    try:
        yield
    finally:
        over = True
        library.__cxa_finalize(key)  # calls and removes the handler


def _caller() -> str:
    """Return the names of the components in the local variables of the calls above in this thread."""
    frame = inspect.currentframe()
    while frame is not None:
        values = [(value, getattr(value, "instance", None)) for value in frame.f_locals.values()]
        if names := dict.fromkeys(each.name for pair in values for each in pair if isinstance(each, Instance)):
            return f"component {' or '.join(names)}"
        frame = frame.f_back
    return "a component"


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
        why = obstacle(session.stepper, exchange)
        summary["stepper"] = f"Python: {why}" if why else "C"
        LOG.info("stepper: %s", summary["stepper"])
        self._compiled = None if why else CompiledSteps(exchange, grid, data)
        self._do_step = session.stepping(grid)

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

    def _in_python(self, end: int) -> None:
        """Do a step with its row."""
        self._do_step(self._done)
        self._row(self._done + 1)
        self._done += 1

    def _in_c(self, end: int) -> None:
        """Do steps with their rows to row `end` at most, one if taps look at each row."""
        assert self._compiled is not None
        first, full = self._rows.room(self._done + 1)
        taps = self._taps[2:]  # C has the work of the first two
        try:
            self._done = self._compiled.run(self._done + 1 if taps else min(end, full - 1), first)
        except BaseException:
            self._done = self._compiled.row
            raise
        for rows, take in taps:
            if self._done in rows:
                take(self._done, self._grid.time(self._done), self._session.components)

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
        if self._compiled is not None and not self._session.box.ended:
            self._done = max(self._done, self._compiled.row)
        self._results()
        files = " and ".join(map(str, self._files))
        return f" The rows so far are in {files}." if files and self._done >= 0 else ""
