"""Run a system package from vdfmu or any other tool."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from functools import partial as bound
from pathlib import Path
from typing import Any, Unpack

from vdfmu.base.errors import CosimError, UsageError, VdfmuError
from vdfmu.base.option import pick, with_options
from vdfmu.base.progress import doing, report, with_progress
from vdfmu.base.version import FORMAT, __version__
from vdfmu.engine.options import SimulateOptions, SystemOptions
from vdfmu.engine.package.read import load_ssp
from vdfmu.engine.plan.inputs import read_inputs
from vdfmu.engine.results.folder import (
    DRAWN,
    SYSTEM_OUTPUTS,
    keep,
    known_formats,
    known_pictures,
    picture_module,
    replacing_results,
    write_summary,
)
from vdfmu.engine.run import Interrupted, LogMessage, Results, simulate


def default_folder(package: str | os.PathLike[str]) -> Path:
    """Return ``results/NAME_ssp``."""
    return Path("results") / f"{Path(package).stem}_ssp"


@with_progress
@with_options
def run_system(
    package: str | os.PathLike[str], source: str | None = None, outputs: Sequence[str] = SYSTEM_OUTPUTS,
    finish: Callable[[Path, Results], None] | None = None,
    failed: Callable[[Path, CosimError | Interrupted], None] | None = None, **options: Unpack[SystemOptions],
) -> Results:  # fmt: skip
    """Run an SSP, write its results and ``summary.json``, and return the results.

    Parameters
    ----------
    package : path
        The ``.ssp`` file.
    source : str, optional
        Its name in the summary, by default the path.
    outputs : sequence of str, optional
        Names of the files of an earlier run that this run replaces.
    finish : callable, optional
        Called with the folder and the results before the summary is written for the last time, to add further files
        of `outputs`. If it raises an error, the earlier run stays unchanged, and the new rows are in ``partial``.
    failed : callable, optional
        Called with the folder and the error of a run that failed or was stopped, to add further files of `outputs`.
    **options
        :class:`vdfmu.engine.options.SystemOptions`.

    Raises
    ------
    UsageError, SspError
        Before the run, if the package or the options have faults.
    CosimError, vdfmu.engine.run.Interrupted
        A unit failed, or the user stopped the run. The rows up to then are in the folder's ``partial``.
    """
    package = Path(package)
    if package.suffix.lower() != ".ssp":
        raise UsageError(f"{package}: expected a system package, NAME.ssp. 'vdfmu ssp' writes one.")
    known_formats(options["formats"])
    width = known_pictures(options["pictures"], options["width"])
    tables = read_inputs(options["inputs"], bool(options["input_hold"]))
    system = load_ssp(package, options["variant"])
    folder = Path(options["out"]) if options["out"] is not None else default_folder(package)
    about: dict[str, Any] = {
        "package": source or str(package), "vdfmu": __version__, "format": FORMAT,
        "parameters": {name: str(value) for name, value in (options["parameters"] or {}).items()},
        "inputs": [table.where for table in tables],
    }  # fmt: skip
    simulated = pick(SimulateOptions, options) | {
        "inputs": tables, "about": about, "progress": bound(report, "co-simulation"),
    }  # fmt: skip
    with replacing_results(folder, outputs, options["overwrite"]) as partial:
        simulated["stream"] = [partial / f"results.{form}" for form in options["formats"]]
        try:
            results = simulate(system, **simulated)
        except (CosimError, Interrupted) as error:
            keep(error, partial)
            if failed is not None:
                failed(partial, error)
            raise
        done = results.summary
        done["real_time_factor"] = (done["stop"] - done["start"]) / done["wall_s"]
        write_summary(done, partial)

        def say(note: str) -> None:
            done["notes"].append(note)
            if options["log"] is not None:
                options["log"](LogMessage("", float(results.time[-1]), "note", "", note))

        try:
            if options["pictures"]:
                with doing("picture"):
                    draw = picture_module().write_signals
                    left = draw(results.thinned(DRAWN), partial, options["pictures"], width, options["serif"])
                if left:
                    say(f"signals: not drawn: {', '.join(left)}; select others with --record")
        except VdfmuError:
            raise
        except Exception as error:
            # names and values from other tools may break the picture, but must not break the results
            say(f"the picture could not be drawn: {error}")
        if finish is not None:
            finish(partial, results)
        write_summary(done, partial)
    return results
