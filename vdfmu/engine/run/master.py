"""`simulate`: run a system structure package with fixed communication steps."""

from __future__ import annotations

from pathlib import Path
from typing import Unpack

from vdfmu.base.option import pick, with_options
from vdfmu.engine.options import RowOptions, SimulateOptions, SimulatorOptions
from vdfmu.engine.package.system import System
from vdfmu.engine.results.results import Results
from vdfmu.engine.run.simulator import Simulator


@with_options
def simulate(system: System | str | Path, **options: Unpack[SimulateOptions]) -> Results:
    """Co-simulate a system of FMUs of FMI 2.0 and 3.0; those for model exchange are integrated.

    Row k is at ``start + k * step``, the last at `stop`; time is never accumulated. How the algorithms pass values on
    is described in `vdfmu.engine.plan.schedule.make_schedule`.

    Parameters
    ----------
    system : System, str or Path
        An SSP 1.0 or 2.0, or the result of `vdfmu.load_ssp`.
    **options
        :class:`vdfmu.engine.options.SimulateOptions`.

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
        A unit failed, or an output that is read or recorded is not finite. `results` of the
        error holds the rows so far, or None before the first row.
    Interrupted
        The user pressed Ctrl-C. It is a KeyboardInterrupt with `results`.
    VdfmuError
        The disk is full.
    """
    simulator = Simulator(system, **pick(SimulatorOptions, options))
    rows = pick(RowOptions, options)
    simulator.grid(rows["start"], rows["stop"], rows["step"])  # faults are reported before anything is loaded
    with simulator:
        return simulator.run(**rows)
