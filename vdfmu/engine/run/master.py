"""`simulate`: run a system structure package with fixed communication steps."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vdfmu.base.show_progress import Steps
from vdfmu.engine.fmu.messages import LogMessage
from vdfmu.engine.masters.observer import Observer
from vdfmu.engine.package.system import System
from vdfmu.engine.plan.check import Value
from vdfmu.engine.plan.inputs import Inputs
from vdfmu.engine.results.results import Results
from vdfmu.engine.run.simulator import Simulator

if TYPE_CHECKING:
    from vdfmu.engine.run.elsewhere import Division


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
    progress: Steps | bool | None = None,
    log: Callable[[LogMessage], None] | None = None,
    strict: bool = False,
    ignore_unmatched: bool = False,
    isolate: bool | None = None,
    time_limit: float | None = None,
    memory_limit: float | None = None,
    stream: Path | Sequence[Path] | None = None,
    about: Mapping[str, Any] | None = None,
    observer: Observer | None = None,
    federation: Division | None = None,
) -> Results:
    """Co-simulate a system of FMUs of FMI 2.0 and 3.0; those for model exchange are integrated.

    Row k is at ``start + k * step``, the last at `stop`; time is never accumulated. How the algorithms pass values on
    is described in `vdfmu.engine.plan.schedule.make_schedule`.

    Parameters
    ----------
    system : System, str or Path
        An SSP 1.0 or 2.0, or what `vdfmu.load_ssp` made of it.
    start, stop : float [s], optional
        Simulated time. Default: the default experiment of the SSD; its start else 0.
    step : float [s], optional
        Communication step; of components that the package gives a step of their own the part that all have.
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
        `vdfmu.engine.plan.inputs.read_inputs`.
    input_hold : bool
        Whether their values hold until the next row; else reals run linearly between the rows.
    record : sequence of str, optional
        Names of signals to record, with ``*`` for any text. Default: all outputs and connected inputs; text is not
        recorded.
    progress : callable or bool, optional
        Called as ``progress(k, n)`` at the start, at the end and at most 100 times in between; True shows a bar, on the
        terminal or in the notebook.
    log : callable, optional
        Receives each `LogMessage` of the units. Default: the logger ``vdfmu.engine.run``.
    strict, ignore_unmatched : bool
        See `vdfmu.engine.plan.check.check_system`.
    isolate : bool, optional
        Whether the components run in a process of their own: if they crash it, end it, take too long or too much
        memory, that is a CosimError, and else it would be the end of this process, or of its patience. Default: if one
        of the FMUs was not built by this project.
    time_limit : float [s], optional
        Time that isolated components have for a step, and for loading, initialization and freeing each. Default:
        300.
    memory_limit : float [MB], optional
        Memory that isolated components have. Default: half of that of the machine.
    stream : Path or two of them, optional
        CSV file to which the rows go as they come, in the form of `Results.write` and at least every two seconds. An
        input with the values of another signal, or those of a row before, is left out: `copies` of the summary names
        both. With the suffix ``.parquet`` a Parquet file, which is written when the run ends, by an error too, but not
        if the process is killed; see `Results.write`. The results are read from disk then, where they take as much room
        again while they are in use; memory does not grow with the number of rows, but for their times.
    about : mapping, optional
        Facts with which the summary begins, and that of a Parquet file.
    observer : Observer, optional
        Is shown rows while the run goes on; see `vdfmu.engine.masters.observer`.
    federation : Division, optional
        Says which part of the system runs here, and how, as :func:`vdfmu.federate` does.

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
    simulator = Simulator(
        system, algorithm=algorithm, adaptive=adaptive, convergence=convergence, tolerance=tolerance,
        parameters=parameters, inputs=inputs, input_hold=input_hold, log=log, strict=strict,
        ignore_unmatched=ignore_unmatched, isolate=isolate, time_limit=time_limit, memory_limit=memory_limit,
        federation=federation,
    )  # fmt: skip
    simulator.grid(start, stop, step)  # what is wrong with it is said before anything is loaded
    with simulator:
        return simulator.run(
            start=start, stop=stop, step=step, record=record, progress=progress, stream=stream, about=about,
            observer=observer,
        )  # fmt: skip
