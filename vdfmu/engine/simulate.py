"""Run a system package, of this project or of any other."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from functools import partial as bound
from pathlib import Path
from typing import Any

from vdfmu.base.errors import CosimError, UsageError, VdfmuError
from vdfmu.base.progress import doing, report
from vdfmu.base.show_progress import Shown, with_progress
from vdfmu.base.version import __version__
from vdfmu.engine.federation import Federation
from vdfmu.engine.masters.observer import Observer
from vdfmu.engine.package.read import DEFAULT, load_ssp
from vdfmu.engine.plan.inputs import Inputs, read_inputs
from vdfmu.engine.results.folder import (
    DRAWN,
    SYSTEM_OUTPUTS,
    keep,
    known_formats,
    replacing_results,
    write_summary,
)
from vdfmu.engine.run import Interrupted, LogMessage, Results, simulate


def default_folder(package: str | os.PathLike[str]) -> Path:
    """Return ``results/NAME_ssp``."""
    return Path("results") / f"{Path(package).stem}_ssp"


@with_progress
def run_system(
    package: str | os.PathLike[str],
    *,
    variant: str = DEFAULT,
    start: float | None = None,
    stop: float | None = None,
    step: float | None = None,
    master: str | None = None,
    adaptive: float | None = None,
    tolerance: float | None = None,
    settings: Mapping[str, Any] | None = None,
    inputs: Inputs = None,
    input_hold: bool = False,
    record: Sequence[str] | None = None,
    ignore_unmatched: bool = False,
    isolate: bool | None = None,
    time_limit: float | None = None,
    memory_limit: float | None = None,
    federation: Federation | None = None,
    out: str | os.PathLike[str] | None = None,
    overwrite: bool = False,
    formats: Sequence[str] = ("csv",),
    progress: Shown = None,
    log: Callable[[LogMessage], None] | None = None,
    plot: bool = False,
    observer: Observer | None = None,
) -> Results:
    """Run an SSP and write its results and ``summary.json``.

    Parameters
    ----------
    package : path
        The ``.ssp`` file.
    variant : str, optional
        The SSD to run, where the package has several at its root.
    start, stop, step : float, optional [s]
        Simulated time and communication step; default those of the package's default experiment and its annotations.
    master, adaptive, tolerance, record, ignore_unmatched, isolate, time_limit, memory_limit, federation : optional
        As ``algorithm`` and the others of these names of :func:`vdfmu.engine.run.simulate`.
    settings : mapping of str to value, optional
        Values of ``component.variable``, as ``parameters`` of :func:`vdfmu.engine.run.simulate`.
    out : path, optional
        Folder for the files; default :func:`default_folder`. Files of an earlier run in it are replaced once
        this one is complete.
    overwrite : bool, optional
        Whether to replace files of these names too that no run wrote.
    formats : sequence of str
        The files ``results.csv`` and so on to write, of `vdfmu.engine.results.formats.FORMATS`: "csv", "parquet" ...
    inputs, input_hold : optional
        Signals for inputs that nothing is connected to, see :func:`vdfmu.engine.run.simulate`.
    progress : callable or bool, optional
        Called with stage, done, total; True shows bars, on the terminal or in the notebook.
    log : callable, optional
        Receives the messages of the units.
    plot : bool, optional
        Whether to draw the signals, but for those that copy others: ``signals.png``.
    observer : Observer, optional
        See :func:`vdfmu.engine.run.simulate`.

    Returns
    -------
    Results
        Recorded signals; `summary` is what ``summary.json`` holds.

    Raises
    ------
    UsageError, SspError
        Before the run, for what is wrong with the package or the options.
    CosimError, vdfmu.engine.run.Interrupted
        A unit failed, or the user stopped the run. The rows so far are in ``partial`` of the folder.
    """
    package = Path(package)
    if package.suffix.lower() != ".ssp":
        raise UsageError(f"{package}: expected a system package, NAME.ssp. 'vdfmu ssp' writes one.")
    known_formats(formats)
    tables = read_inputs(inputs, input_hold)
    system = load_ssp(package, variant)
    folder = Path(out) if out is not None else default_folder(package)
    summary: dict[str, Any] = {
        "package": str(package),
        "vdfmu": __version__,
        "settings": {name: str(value) for name, value in (settings or {}).items()},
        "inputs": [table.where for table in tables],
    }

    with replacing_results(folder, SYSTEM_OUTPUTS, overwrite) as partial:
        try:
            results = simulate(
                system, start=start, stop=stop, step=step, algorithm=master, adaptive=adaptive, tolerance=tolerance,
                parameters=settings, inputs=tables, record=record, ignore_unmatched=ignore_unmatched, isolate=isolate,
                time_limit=time_limit, memory_limit=memory_limit, log=log,
                stream=[partial / f"results.{form}" for form in formats], about=summary,
                federation=federation, observer=observer,
                progress=bound(report, "co-simulation"),
            )  # fmt: skip
        except (CosimError, Interrupted) as error:
            keep(error, partial)
            raise
        done = results.summary
        done["real_time_factor"] = (done["stop"] - done["start"]) / done["wall_s"]
        write_summary(results.summary, partial)
        copies = {".".join(connection.end) for connection in system.connections}
        try:
            if plot:
                from vdfmu.engine.results.picture import signals_figure  # takes long to import

                with doing("picture"):
                    signals_figure(results.thinned(DRAWN), partial, () if record else copies)
        except VdfmuError:
            raise
        except Exception as error:
            # whatever another tool's names and values do to the picture, the results are there
            note = f"the picture could not be drawn: {error}"
            results.summary["notes"].append(note)
            if log is not None:
                log(LogMessage("", float(results.time[-1]), "note", "", note))
        write_summary(results.summary, partial)
    return results
