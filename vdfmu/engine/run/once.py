"""`simulate`: run a system package once, with fixed communication steps."""

from __future__ import annotations

from pathlib import Path
from typing import Unpack

from vdfmu.base.option import pick, with_options
from vdfmu.engine.options import RowOptions, SimulateOptions, SimulatorOptions
from vdfmu.engine.package.system import FlatSystem
from vdfmu.engine.results.results import Results
from vdfmu.engine.run.simulator import Simulator


@with_options
def simulate(system: FlatSystem | str | Path, **options: Unpack[SimulateOptions]) -> Results:
    """Co-simulate a system of FMUs; FMUs for model exchange are integrated.

    Row k is at ``start + k * step``, the last at `stop`; time is never accumulated. For the order of values in each
    algorithm see `vdfmu.engine.plan.schedule.make_schedule`.

    Parameters
    ----------
    system : FlatSystem, str or Path
        An SSP 1.0 or 2.0, or the result of `vdfmu.engine.package.read.load_ssp`.
    **options
        :class:`vdfmu.engine.options.SimulateOptions`.

    Returns
    -------
    Results
        Its `summary` contains the algorithm, the order, the step, the number of steps and their wall time, ``wall_s``.
        Continuous algorithms add ``communication``: the numbers of steps, of rejected steps and of the units' steps,
        and the shortest and the longest step. A unit may end the run before its stop (fmi2Discard with fmi2Terminated);
        ``ended`` has the component and the time.

    Raises
    ------
    SspError, UsageError
        Before the run; see `load_ssp` and `check_system`.
    CosimError
        A unit failed, or an output that is read or recorded is not finite. Its `results` are the rows so far, or None.
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
