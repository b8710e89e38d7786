"""The components of one system in use: loaded, stepped, reset, freed."""

from __future__ import annotations

import shutil
import signal
import tempfile
import time as clock
from collections.abc import Callable, Sequence
from contextlib import ExitStack, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from vdfmu.base.arrays import Floats
from vdfmu.base.errors import CosimError
from vdfmu.base.interrupt import InterruptGuard
from vdfmu.base.temporary import temporary_folder
from vdfmu.engine.fmu.messages import LogMessage, MessageBox
from vdfmu.engine.masters.components import Components, failure_message
from vdfmu.engine.masters.continuous import ContinuousStepper
from vdfmu.engine.masters.exchange import SampledStepper, largest_step
from vdfmu.engine.masters.observer import Observer, Visitor, observed, visited
from vdfmu.engine.masters.pace import Pace
from vdfmu.engine.masters.probe import Probe
from vdfmu.engine.plan.checked import Checked
from vdfmu.engine.plan.unpacked import no_room, unpack_units
from vdfmu.engine.results.formats import format_of, suffix_of
from vdfmu.engine.results.recorded import copies_of
from vdfmu.engine.results.recorder import ROWS, SECONDS, Recorder
from vdfmu.engine.results.results import Results
from vdfmu.engine.run.exits import report_exits
from vdfmu.engine.run.isolated import Isolated, Limits

if TYPE_CHECKING:
    from vdfmu.engine.run.elsewhere import Elsewhere, Making


class Interrupted(KeyboardInterrupt):
    """The signal `number` stopped the run between two steps; `results` holds the rows so far."""

    def __init__(self, time: float, results: Results, number: int = signal.SIGINT) -> None:
        super().__init__(f"interrupted at t = {time:.9g} s")
        self.time = time
        self.results = results
        self.number = number


class Run:
    """The components of one run; leaving it terminates and frees them and removes the unpacked FMUs.

    For `isolate` and `limits` see `simulate`; `apart`, if given, replaces `Isolated`.
    """

    def __init__(
        self,
        checked: Checked,
        log: Callable[[LogMessage], None] | None,
        isolate: bool | None,
        limits: Limits,
        apart: Making | None = None,
    ) -> None:
        self.checked = checked
        self.box = MessageBox(log)
        self.summary: dict[str, Any] = {}
        self.components: Components | Elsewhere
        self.results: Results
        self.isolated = isolate if apart is None else True
        self.stepper: SampledStepper | ContinuousStepper | Elsewhere
        self._limits = limits
        self._apart = apart or Isolated
        self._stack = ExitStack()
        self._save: Callable[[], str] = lambda: ""

    def __enter__(self) -> Run:
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
        return self._save()

    def __exit__(self, _: object, error: BaseException | None, *__: object) -> None:
        results = getattr(self, "results", None)
        if results is not None:
            self.box.time = float(results.time[-1])
        failure = None
        try:
            if hasattr(self, "components"):
                failure = self.components.close()
        finally:
            self._stack.close()
            self._save = lambda: ""  # nothing may hold the run and the files of its memory any more
        if failure is not None and error is not None:
            self.box.pending.append(failure_message(failure))
        self.box.flush()
        if results is not None:
            results.messages = list(self.box.kept)
        if failure is not None and error is None:
            failure.results = results
            raise failure

    def reset(self, checked: Checked) -> None:
        """Return components that are not isolated to their state after loading; `checked` has their start values."""
        assert isinstance(self.components, Components)
        self.checked = self.components.checked = checked
        self.box.flush()
        self.box.kept.clear()
        self.box.ended.clear()
        self.summary, self._save = {}, lambda: ""
        self.components.reset()

    def stepping(self, begin: float, end: float, step: float, n: int) -> Callable[[int], None]:
        """Return the function for step k of `n`, which checks that values read are finite."""
        box, advance, exchange, finite = self.box, self.stepper.advance, self.exchange, self.exchange.finite

        last = n - 1

        def one(k: int) -> None:
            box.time = time = begin + k * step
            stop = begin + (k + 1) * step if k < last else end
            advance(time, step if k < last or time + step == end else largest_step(time, end), stop)
            if not finite():
                exchange.refuse_not_finite("doStep", stop)

        return one

    def steps(
        self,
        begin: float,
        end: float,
        step: float,
        n: int,
        record: Sequence[str] | None,
        progress: Callable[[int, int], None] | None,
        stream: Sequence[Path] = (),
        observer: Observer | None = None,
        probe: Probe | None = None,
        visitor: Visitor | None = None,
        speed: float | None = None,
    ) -> Results:
        """Do the steps, at a `speed` if there is one, and return the results."""
        box, stepper = self.box, self.stepper
        exchange, one = self.exchange, self.stepping(begin, end, step, n)
        signals, data, store = exchange.recorders(ROWS if stream and speed is None else n + 1, record)
        recorder = None
        pending = box.pending
        done = -1  # the last complete row

        def times(first: int, after: int) -> Floats:
            return begin + step * np.arange(first, after, dtype=np.float64)

        def results() -> Results:
            self.summary["wall_s"] = clock.perf_counter() - began - (recorder.seconds if recorder else 0.0)
            if pace is not None:
                self.summary["wall_s"] -= pace.waited
                self.summary["pace"] = pace.facts()
            self.summary |= stepper.facts()
            if recorder:
                self.summary["copies"] = copies_of(signals)
            time = times(0, done + 1)
            if done == n or box.ended:
                time[done] = self.summary["stop"]
            rows = slice(0, done + 1)
            kept = recorder.finish(time) if recorder else {kind: array[rows] for kind, array in data.items()}
            found = Results(time, signals, kept, self.summary, box.kept)
            for path in stream if done >= 0 else ():
                if not (form := format_of(path)).streams:
                    form.write(found, path)
                else:  # tells a reader that the copies belong to this file
                    self.summary[f"{suffix_of(path)[1:]}_bytes"] = path.stat().st_size
            if observer is not None and done >= 0:
                getattr(observer, "end", lambda results: None)(found)
            return found

        def save() -> str:
            results()
            return f" The rows so far are in {' and '.join(map(str, stream))}." if stream and done >= 0 else ""

        if stream:
            recorder = Recorder(stream, signals, data, store, times, SECONDS if speed is None else np.inf)
            store = recorder.store
        if observer is not None:
            store = observed(observer, exchange, self.summary, begin, step, store)
        if probe is not None:
            assert isinstance(self.components, (Components, Isolated))
            store = probe.keeping(self.components, self.checked, begin, n, store)
        if visitor is not None and isinstance(self.components, Components):
            store = visited(visitor, self.components, n, begin, step, store)
        guard = InterruptGuard()
        pace = None if speed is None else Pace(speed, step, store, lambda: guard.number != 0)
        if pace is not None:
            store = pace.store
        self._save = save
        began = clock.perf_counter()
        stride = max(1, -(-n // 100))
        try:
            with guard, pace or nullcontext(), np.errstate(invalid="ignore"):  # finite() looks for them
                stepper.pressed = lambda: guard.number != 0
                exchange.refuse_not_finite("initialization", begin)
                store(0)
                done = 0
                if progress is not None:
                    progress(0, n)
                while done < n and not box.ended:
                    for k in range(done, min(n, done + stride)):
                        one(k)
                        store(k + 1)
                        done = k + 1
                        if box.ended:
                            done = self._end(k, box.time)
                            break
                        if pending:
                            box.flush()
                        if guard.number:
                            raise KeyboardInterrupt
                    if progress is not None:
                        progress(done, n)
        except CosimError as error:
            box.flush()
            error.results = results()
            if np.isnan(error.time):
                error.time = box.time
            raise
        except KeyboardInterrupt:
            box.flush()
            raise Interrupted(begin + done * step, results(), guard.number or signal.SIGINT) from None
        for note in stepper.notes():
            self.summary["notes"].append(note)
            pending.append(LogMessage("", box.time, "note", "", note))
        box.flush()
        found = results()
        if probe is not None and not box.ended:
            assert isinstance(self.components, (Components, Isolated))
            probe.read(self.components, self.checked, end)
        return found

    def _end(self, k: int, time: float) -> int:
        """Note that a unit ended the simulation in the step after row k, at `time`; return the last row."""
        unit, at = min(self.box.ended.items(), key=lambda item: item[1])
        reached = self.exchange.clock.value + self.exchange.size.value
        if not time <= at <= reached:  # the unit knows no last successful time, or rounds it differently
            at = reached
        last = k + 1 if at > time else k
        note = f"{unit} ended the simulation at t = {at:.9g} s"
        if at < reached and last > k:
            note += f"; the last row has its values of then, and those of the others of t = {reached:.9g} s"
        self.summary |= {"stop": at, "steps": last, "ended": {"component": unit, "time": at}}
        self.summary["notes"].append(note)
        self.box.pending.append(LogMessage("", at, "note", "", note))
        return last
