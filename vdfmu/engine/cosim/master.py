"""`simulate`: run a system structure package with fixed communication steps."""

from __future__ import annotations

import shutil
import signal
import tempfile
import time as clock
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vdfmu.engine.algorithms import ALGORITHMS, CONTINUOUS, MOST_STEPS
from vdfmu.engine.cosim.check import Value, check_system
from vdfmu.engine.cosim.checked import Checked
from vdfmu.engine.cosim.components import CONVERGENCE, Components, failure_message
from vdfmu.engine.cosim.continuous import ContinuousStepper
from vdfmu.engine.cosim.exchange import SampledStepper, largest_step
from vdfmu.engine.cosim.exits import exits_said
from vdfmu.engine.cosim.inputs import Inputs, outside, read_inputs
from vdfmu.engine.cosim.isolated import Isolated, Limits
from vdfmu.engine.cosim.messages import LogMessage, MessageBox
from vdfmu.engine.cosim.multirate import with_steps
from vdfmu.engine.cosim.recorder import ROWS, Recorder
from vdfmu.engine.cosim.results import Results
from vdfmu.engine.cosim.schedule import DEFAULT
from vdfmu.engine.cosim.unpacked import no_room, unpack_units
from vdfmu.engine.ssp.experiment import Experiment
from vdfmu.engine.ssp.read import load_ssp
from vdfmu.engine.ssp.structure import System
from vdfmu.errors import CosimError, UsageError
from vdfmu.interrupt import InterruptGuard
from vdfmu.temporary import temporary_folder


class Interrupted(KeyboardInterrupt):
    """The signal `number` stopped the run between two steps; `results` holds the rows so far."""

    def __init__(self, time: float, results: Results, number: int = signal.SIGINT) -> None:
        super().__init__(f"interrupted at t = {time:.9g} s")
        self.time = time
        self.results = results
        self.number = number


def simulate(
    system: System | str | Path,
    *,
    start: float | None = None,
    stop: float | None = None,
    step: float | None = None,
    algorithm: str | None = None,
    adaptive: float | None = None,
    convergence: float | None = None,
    tolerance: float | None = None,
    parameters: Mapping[str, Value] | None = None,
    inputs: Inputs = None,
    input_hold: bool = False,
    record: Sequence[str] | None = None,
    progress: Callable[[int, int], None] | None = None,
    log: Callable[[LogMessage], None] | None = None,
    strict: bool = False,
    ignore_unmatched: bool = False,
    isolate: bool | None = None,
    time_limit: float | None = None,
    memory_limit: float | None = None,
    stream: Path | None = None,
) -> Results:
    """Co-simulate a system of FMUs of FMI 2.0 and 3.0; those for model exchange are integrated.

    Row k is at ``start + k * step``, the last at `stop`; time is never accumulated. How the algorithms pass values on
    is told in `vdfmu.engine.cosim.schedule.make_schedule`.

    Parameters
    ----------
    system : System, str or Path
        An SSP 1.0, or what `vdfmu.ssp.load_ssp` made of it.
    start, stop : float, optional
        Simulated time [s]. Default: the default experiment of the SSD; its start else 0.
    step : float, optional
        Communication step [s]; of components that the package gives a step of their own the part that all have.
        `stop` - `start` must be a multiple of it, within 1e-9 relative. With `adaptive` the
        longest step, and the interval of the rows. Default: that of the default experiment's annotation, of this
        project or of libcosim.
    algorithm : str, optional
        Default: that of the default experiment's annotation, with its `adaptive`; else ``gauss-seidel``, or, with a
        note, ``jacobi`` where the dependencies leave no order to that.
        ``gauss-seidel`` or ``jacobi``, which sample the coupled signals at the communication points; ``extrapolated``
        or ``iterative``, which take them as continuous and are of second order in the step.
    adaptive : float, optional
        Largest error of a coupled signal in a step, relative to its size and at least to its nominal value; steps are
        shortened to it. For ``extrapolated`` and ``iterative``.
    convergence : float, optional
        Where ``iterative`` ends its repetitions: change of a coupled signal, relative in the same way. Default: a
        hundredth of `adaptive`, else 1e-8.
    tolerance : float, optional
        Relative tolerance for the units' solvers.
    parameters : mapping of str to value, optional
        Values of ``component.variable`` in the unit of the FMU; they win over those of the package. Without an index
        for all ``component.variable[...]``: one value, or a list or array with one for each.
    inputs : path, sequence of paths or mapping of str to (t, values), optional
        Signals for inputs that nothing is connected to, from CSV files or as arrays; see
        `vdfmu.engine.cosim.inputs.read_inputs`.
    input_hold : bool
        Whether their values hold until the next row; else reals run linearly between the rows.
    record : sequence of str, optional
        Names of signals to record, with ``*`` for any text. Default: all outputs and connected inputs; text is not
        recorded.
    progress : callable, optional
        Called as ``progress(k, n)`` at the start, at the end and at most 100 times in between.
    log : callable, optional
        Receives each `LogMessage` of the units. Default: the logger ``vdfmu.engine.cosim``.
    strict, ignore_unmatched : bool
        See `vdfmu.engine.cosim.check.check_system`.
    isolate : bool, optional
        Whether the components run in a process of their own: if they crash it, end it, take too long or too much
        memory, that is a CosimError, and else it would be the end of this process, or of its patience. Default: if one
        of the FMUs was not built by this project.
    time_limit : float, optional
        Time [s] that isolated components have for a step, and for loading, initialization and freeing each. Default:
        300.
    memory_limit : float, optional
        Memory [MB] that isolated components have. Default: half of that of the machine.
    stream : Path, optional
        CSV file to which the rows go as they come, in the form of `Results.to_csv` and at least every two seconds. The
        results are read from disk then, where they take as much room again while they are in use; memory does not
        grow with the number of rows, but for their times.

    Returns
    -------
    Results
        Its `summary` has algorithm, order, step, number of steps and ``wall_s``, the wall time of the steps;
        ``extrapolated`` and ``iterative`` add ``communication``: the numbers of steps, of rejected steps and of the
        units' steps, and the shortest and the longest step. A unit that ends the simulation (fmi2Discard with
        fmi2Terminated) ends the run as if its stop were there; ``ended`` has the component and the time.

    Raises
    ------
    SspError, UsageError
        Before the run; see `load_ssp` and `check_system`.
    CosimError
        A unit failed, or an output that is read or recorded is no finite number. `results` of the
        error holds the rows so far, or None before the first row.
    Interrupted
        The user pressed Ctrl-C. It is a KeyboardInterrupt with `results`.
    VdfmuError
        The disk is full.
    """
    if not isinstance(system, System):
        system = load_ssp(system)
    experiment = system.experiment
    if algorithm is None:
        algorithm = experiment.algorithm
        adaptive = experiment.adaptive if adaptive is None else adaptive
    begin, end, step, n = _grid(experiment, start, stop, step)
    if tolerance is not None and not 0.0 < tolerance < np.inf:
        raise UsageError(f"tolerance must be positive and finite, got {tolerance}")
    check_coupling(algorithm or DEFAULT, adaptive, convergence)
    tables = read_inputs(inputs, input_hold)
    checked = check_system(
        system, parameters, inputs=tables, algorithm=algorithm, repeats=adaptive is not None, strict=strict,
        ignore_unmatched=ignore_unmatched,
    )  # fmt: skip
    checked = with_steps(checked, step)
    reach = outside(tables, begin, end)
    algorithm = checked.algorithm
    with _Run(checked, log, isolate, Limits(time_limit, memory_limit)) as run:
        run.box.pending += [LogMessage("", begin, "note", "", note) for note in reach]
        run.components.initialize(begin, end, tolerance, convergence or CONVERGENCE)
        run.summary |= {
            "system": system.name, "algorithm": algorithm, "adaptive": adaptive, "order": list(checked.schedule.units),
            "start": begin, "stop": end, "step": step, "steps": n, "isolated": run.isolated,
            "notes": [*checked.notes, *reach],
        }  # fmt: skip
        run.stepper = run.components.couple(adaptive, convergence, end - begin, record)
        run.results = run.steps(begin, end, step, n, record, progress, stream)
    return run.results


def check_coupling(algorithm: str, adaptive: float | None, convergence: float | None = None) -> None:
    """Raise UsageError for options of the coupling that do not fit together."""
    if adaptive is not None:
        if algorithm in ALGORITHMS and algorithm not in CONTINUOUS:
            raise UsageError(
                f"adaptive: {algorithm} samples the signals with the step, so the step is a property of the system; "
                f"use {' or '.join(CONTINUOUS)}"
            )
        if not 0.0 < adaptive < 1.0:
            raise UsageError(f"adaptive: expected a relative error between 0 and 1, got {adaptive:g}")
    if convergence is not None and algorithm in ALGORITHMS and algorithm != "iterative":
        raise UsageError(f"convergence: {algorithm} repeats nothing; it is for iterative")
    if convergence is not None and not 0.0 < convergence < 1.0:
        raise UsageError(f"convergence: expected a relative change between 0 and 1, got {convergence:g}")


def _grid(
    experiment: Experiment, start: float | None, stop: float | None, step: float | None
) -> tuple[float, float, float, int]:
    """Return start, stop, step and number of steps; UsageError when they do not fit."""
    begin = start if start is not None else experiment.start or 0.0
    end = stop if stop is not None else experiment.stop
    step = step if step is not None else experiment.step
    if end is None:
        raise UsageError("no stop time: the system's default experiment has none, give stop")
    if step is None:
        raise UsageError("no communication step: the system's default experiment has none, give step")
    for name, value in (("start", begin), ("stop", end), ("step", step)):
        if not np.isfinite(value):
            raise UsageError(f"{name} must be finite, got {value}")
    if step <= 0.0:
        raise UsageError(f"step must be positive, got {step} s")
    if end <= begin:
        raise UsageError(f"stop must be after start, got {begin} s to {end} s")
    ratio = (end - begin) / step
    if ratio > MOST_STEPS:
        raise UsageError(f"expected at most {MOST_STEPS:g} steps of {step:g} s, got a stop of {end:g} s")
    n = max(1, round(ratio))
    if abs(ratio - n) > 1e-9 * ratio:
        raise UsageError(
            f"stop - start = {end - begin:.12g} s is no multiple of the step {step:.12g} s; "
            f"the nearest stop is {begin + n * step:.12g} s"
        )
    return float(begin), float(end), float(step), n


class _Run:
    """The components of one run; leaving it terminates and frees them and removes the unpacked FMUs.

    `isolate` and `limits` as of `simulate`.
    """

    def __init__(
        self,
        checked: Checked,
        log: Callable[[LogMessage], None] | None,
        isolate: bool | None,
        limits: Limits,
    ) -> None:
        self.checked = checked
        self.box = MessageBox(log)
        self.summary: dict[str, Any] = {}
        self.components: Components | Isolated
        self.results: Results
        self.isolated = isolate
        self.stepper: SampledStepper | ContinuousStepper | Isolated
        self._limits = limits
        self._stack = ExitStack()
        self._save: Callable[[], str] = lambda: ""

    def __enter__(self) -> _Run:
        try:
            folder = Path(self._stack.enter_context(temporary_folder("vdfmu-")))
        except OSError as error:
            raise no_room(tempfile.gettempdir(), error) from error
        for note in self.checked.notes:
            self.box.pending.append(LogMessage("", 0.0, "note", "", note))
        self.box.flush()
        try:
            folders, foreign = unpack_units(self.checked, folder)
            self.isolated = foreign if self.isolated is None else self.isolated
            if self.isolated:
                self.components = Isolated(self.checked, folders, self.box, folder, self._limits)
            else:
                self._stack.enter_context(exits_said(self.box, lambda: self._left(folder)))
                self.components = Components(self.checked, folders, self.box)
            self.components.load()
        except BaseException as error:
            self.__exit__(type(error), error)
            raise
        self.exchange = self.components.exchange
        return self

    def _left(self, folder: Path) -> str:
        """Save the rows of a process that a component ends; return what is said of them."""
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
            self._save = lambda: ""  # nothing is to hold the run, and the files of its memory, any more
        if failure is not None and error is not None:
            self.box.pending.append(failure_message(failure))
        self.box.flush()
        if results is not None:
            results.messages = list(self.box.kept)
        if failure is not None and error is None:
            failure.results = results
            raise failure

    def steps(
        self,
        begin: float,
        end: float,
        step: float,
        n: int,
        record: Sequence[str] | None,
        progress: Callable[[int, int], None] | None,
        stream: Path | None = None,
    ) -> Results:
        """Do the steps and return the results."""
        box, stepper = self.box, self.stepper
        advance, exchange = stepper.advance, self.exchange
        signals, data, store = exchange.recorders(n + 1 if stream is None else ROWS, record)
        recorder = None
        finite = exchange.finite
        pending = box.pending
        done = -1  # the last complete row

        def times(first: int, after: int) -> NDArray[np.float64]:
            return begin + step * np.arange(first, after, dtype=np.float64)

        def results() -> Results:
            self.summary["wall_s"] = clock.perf_counter() - began - (recorder.seconds if recorder else 0.0)
            self.summary |= stepper.facts()
            time = times(0, done + 1)
            if done == n or box.ended:
                time[done] = self.summary["stop"]
            rows = slice(0, done + 1)
            kept = recorder.finish(time) if recorder else {kind: array[rows] for kind, array in data.items()}
            return Results(time, signals, kept, self.summary, box.kept)

        def save() -> str:
            results()
            return f" The rows so far are in {stream}." if stream is not None and done >= 0 else ""

        if stream is not None:
            recorder = Recorder(stream, signals, data, store, times)
            store = recorder.store
        self._save = save
        began = clock.perf_counter()
        stride = max(1, -(-n // 100))
        guard = InterruptGuard()
        try:
            with guard, np.errstate(invalid="ignore"):  # they are looked for
                stepper.pressed = lambda: guard.number != 0
                exchange.refuse_not_finite("initialization", begin)
                store(0)
                done = 0
                if progress is not None:
                    progress(0, n)
                while done < n and not box.ended:
                    for k in range(done, min(n, done + stride)):
                        time, stop = begin + k * step, begin + (k + 1) * step if k < n - 1 else end
                        box.time = time
                        fits = k < n - 1 or time + step == end
                        advance(time, step if fits else largest_step(time, end), stop)
                        if not finite():
                            exchange.refuse_not_finite("doStep", stop)
                        store(k + 1)
                        done = k + 1
                        if box.ended:
                            done = self._end(k, time)
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
        return results()

    def _end(self, k: int, time: float) -> int:
        """Note the end that a unit has made in the step after row k, at `time`; return the last row."""
        unit, at = min(self.box.ended.items(), key=lambda item: item[1])
        reached = self.exchange.clock.value + self.exchange.size.value
        if not time <= at <= reached:  # a unit that knows no last successful time, or another rounding of it
            at = reached
        last = k + 1 if at > time else k
        note = f"{unit} ended the simulation at t = {at:.9g} s"
        if at < reached and last > k:
            note += f"; the last row has its values of then, and those of the others of t = {reached:.9g} s"
        self.summary |= {"stop": at, "steps": last, "ended": {"component": unit, "time": at}}
        self.summary["notes"].append(note)
        self.box.pending.append(LogMessage("", at, "note", "", note))
        return last
