"""Co-simulates the package of a run, with taps that read along it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from vdfmu.base.errors import CosimError
from vdfmu.base.option import pick
from vdfmu.base.progress import report
from vdfmu.engine.linear.growth import Poses
from vdfmu.engine.options import IsolationOptions, SimulatorOptions
from vdfmu.engine.results.folder import keep
from vdfmu.engine.results.recorder import Tap
from vdfmu.engine.results.results import Results
from vdfmu.engine.run import Interrupted, Simulator
from vdfmu.study.run import summary as numbers
from vdfmu.study.run.case import RunCase
from vdfmu.study.verdict import explain, loop_checks


def simulate(case: RunCase, package: Path, parameters: Mapping[str, Any] | None = None, **options: Any) -> Results:
    """Co-simulate a package with the parameters of the case and additional ones.

    `options` are `log` and those of :meth:`vdfmu.engine.run.Simulator.run`.
    """
    scenario = case.scenario
    settings: SimulatorOptions = {
        **scenario.coupling,
        "inputs": scenario.inputs,
        "parameters": {**case.parameters, **(parameters or {})},
        "log": options.pop("log", None),
        "stepper": case.options["stepper"],
        **pick(IsolationOptions, case.options),
    }
    with Simulator(package, **settings) as simulator:
        return simulator.run(start=0.0, stop=scenario.stop, step=scenario.step, **options)


def co_simulate(case: RunCase, package: Path, poses: Poses | None, taps: Sequence[Tap]) -> Results:
    """Co-simulate the package; return rows and summary, written next to it according to the options.

    A run that fails or is stopped keeps its rows and its summary in the folder ``partial``. The error mentions unstable
    loops, or a start away from the motion.
    """
    options, folder = case.options, package.parent
    try:
        return simulate(
            case,
            package,
            progress=partial(report, "co-simulation"),
            log=options["log"],
            about=case.facts,
            observer=options["observer"],
            taps=taps,
            pace=options["pace"],
            record=_recorded(case),
            stream=[folder / f"results.{form}" for form in options["formats"]] if case.written else [],
        )
    except (CosimError, Interrupted) as error:
        figures = explain(error, poses)
        if isinstance(error, CosimError) and error.results:
            for text in numbers.start_notes(error.results, case.scenario, numbers.FAR):
                error.add_note(f"A likely cause: {text.removesuffix('.')}")
        if error.results is not None and figures:
            error.results.summary["key_figures"] = figures
        if case.written:
            keep(error, folder, loop_checks({"key_figures": figures}))
        raise


def _recorded(case: RunCase) -> list[str] | None:
    """Return the names of all outputs and external inputs, and those in `record`; None without this option."""
    if not case.options["record"]:
        return None
    tables = case.system.tables.items()
    names = [f"{unit}.{v.name}" for unit, table in tables for v in table if v.causality == "output"]
    return [*names, *(name for table in case.scenario.inputs for name in table.names), *case.options["record"]]
