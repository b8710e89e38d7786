"""The main job: build what is stale, pack, co-simulate, solve the references, compare, write tables and figures."""

from __future__ import annotations

import dataclasses
import math
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial as bound
from pathlib import Path
from typing import Any, Literal

import numpy as np

from vdfmu.arm.robot import Robot, load_robot
from vdfmu.base.errors import CosimError, UsageError
from vdfmu.base.once import one_job
from vdfmu.base.progress import doing, report
from vdfmu.base.show_progress import Shown, with_progress
from vdfmu.base.temporary import temporary_folder
from vdfmu.compiler.fmu.build import build_notes, choose_backend
from vdfmu.engine.algorithms import ALGORITHMS, choice, count_steps
from vdfmu.engine.inspect.loops import Poses
from vdfmu.engine.masters.observer import Observer
from vdfmu.engine.plan.inputs import Inputs, read_inputs
from vdfmu.engine.results.folder import (
    DRAWN,
    PICTURES,
    SYSTEM_OUTPUTS,
    keep,
    known_formats,
    known_pictures,
    replacing_results,
    write_summary,
)
from vdfmu.engine.results.verdict import verdict_of
from vdfmu.engine.run import Interrupted, LogMessage, Results
from vdfmu.engine.run.simulator import check_coupling
from vdfmu.study.report.content import arm_of
from vdfmu.study.report.page import NAME, ShownRun, write_report
from vdfmu.study.run.at_limits import limits_of, time_at_limits
from vdfmu.study.run.contrast import contrast
from vdfmu.study.run.stability import explain, loop_checks, simulated
from vdfmu.study.run.summary import (
    compare,
    compared,
    estimation_errors,
    has_signals,
    implied_gains,
    power_bond,
    run_facts,
    start_notes,
    tracking_errors,
)
from vdfmu.study.run.verdict import run_checks
from vdfmu.system.package.description import SystemDescription
from vdfmu.system.package.write import write_ssp
from vdfmu.system.reference.reference import BLOCK, reference_blocks
from vdfmu.system.reference.witness import Witness
from vdfmu.system.scenario import Scenario, load_scenario
from vdfmu.system.scenario.check import model_notes
from vdfmu.system.scenario.parts import cached_fmus
from vdfmu.system.scenario.replace import with_payload, with_units
from vdfmu.system.scenario.values import system_values

RUN_OUTPUTS = (
    *SYSTEM_OUTPUTS,
    "system.ssp",
    *(
        f"{name}.{suffix}"
        for name in (*(f"figure_{k}" for k in (7, 8, 10, 11, 13, 14)), "torques", "errors", "tool")
        for suffix in PICTURES
    ),
    "signals.svg",
    "signals.pdf",
    NAME,
)
"""Files that the run of a scenario writes and replaces."""
_VISIBLE = 1e-3
"""Share of the largest position error above which a difference to a reference shows in the tables of three digits."""
_DRAWN = (
    "trajectory.q_d", "plant.q", "plant.kappa", "plant.p_O", "controller.tau", "controller.tau_m",
)  # fmt: skip
"""Signals that the figures of a run show; a system without them gets a picture of its signals."""
_LEFT_OUT = "left out, since the unit in place of the system's has no such signal"
_NUDGE = 1e-9
"""Relative change of the rotor inertias that must not show; below every tolerance that a scenario has."""


def prepare(
    scenario: Scenario | str | os.PathLike[str],
    *,
    robot: Robot | str | os.PathLike[str] | None = None,
    step: float | None = None,
    stop: float | None = None,
    master: str | None = None,
    adaptive: float | None = None,
    units: Mapping[str, Any] | None = None,
    inputs: Inputs = None,
    input_hold: bool | None = None,
    settings: Iterable[str] | None = None,
) -> Scenario:
    """Load a scenario and replace what the options name, with the checks of a scenario file.

    `settings` are names of what will be set: those of a payload give the robot one, see `with_payload`.

    Raises
    ------
    UsageError, ModelError
        For an unknown name, a bad file or options that do not fit together.
    """
    if isinstance(robot, (str, os.PathLike)):
        robot = load_robot(robot)
    if not isinstance(scenario, Scenario):
        scenario = load_scenario(scenario, robot)
    elif robot is not None:
        raise UsageError("robot: give it with the name or path of a scenario, not with a loaded one.")
    scenario = with_payload(scenario, settings or ())
    if units:
        scenario = with_units(scenario, units)
    if input_hold is not None:
        scenario = dataclasses.replace(scenario, input_hold=input_hold)
    tables = read_inputs(scenario.inputs if inputs is None else inputs, scenario.input_hold)
    scenario = dataclasses.replace(scenario, inputs=tables)
    changes = {"step": step, "stop": stop, "master": master, "adaptive": adaptive}
    scenario = dataclasses.replace(scenario, **{k: v for k, v in changes.items() if v is not None})
    if scenario.master not in ALGORITHMS:
        raise UsageError(f"master: expected {choice()}, got {scenario.master!r}.")
    check_coupling(scenario.master, scenario.adaptive)
    count_steps(scenario.step, scenario.stop)
    return scenario


@with_progress
@one_job()
def run(
    scenario: Scenario | str | os.PathLike[str],
    *,
    robot: Robot | str | os.PathLike[str] | None = None,
    step: float | None = None,
    stop: float | None = None,
    master: str | None = None,
    adaptive: float | None = None,
    out: str | os.PathLike[str] | Literal[False] | None = None,
    overwrite: bool = False,
    reference: bool = True,
    backend: str | None = None,
    fmi_version: str = "2.0",
    settings: Mapping[str, Any] | None = None,
    units: Mapping[str, Any] | None = None,
    inputs: Inputs = None,
    input_hold: bool | None = None,
    formats: Sequence[str] = ("csv",),
    pictures: Sequence[str] = ("png",),
    simulate: bool = False,
    progress: Shown = None,
    log: Callable[[LogMessage], None] | None = None,
    observer: Observer | None = None,
) -> Results:
    """Run a scenario and write its results, ``summary.json`` and figures.

    Parameters
    ----------
    scenario : Scenario, str or path
        Loaded, or the name of a shipped one, or a file; of `vdfmu.run` also "reach", a first motion of any robot.
    robot : Robot, str or path, optional
        Robot in place of the scenario's.
    step : float [s], optional
        Communication step.
    stop : float [s], optional
        End of the run.
    master : "gauss-seidel", "jacobi", "extrapolated" or "iterative", optional
    adaptive : float, optional
        Largest relative error of a coupled signal in a communication step, which is shortened to it and never longer
        than `step`; see :func:`vdfmu.engine.run.simulate`.
    out : path, optional
        Folder for the files; default ``results/<scenario>``. Files of an earlier run in it are replaced once this one
        is complete. False writes nothing: results and summary are in what is returned.
    overwrite : bool, optional
        Whether to replace files of these names too that no run wrote.
    reference : bool, optional
        Whether to solve the references and compare, which takes longer than the run itself.
    backend : "native" or "python", optional
        Kind of FMU; default native where its compiler is installed.
    fmi_version : "2.0" or "3.0", optional
        Of the units' FMUs; Python FMUs are of FMI 2.0.
    settings : mapping of str to value, optional
        Parameters and inputs that nothing feeds, ``{"controller.K_p[1]": 3000}``; without an index for all elements,
        one value or a list or array with one for each.
    units : mapping of str to unit, optional
        Component to the unit that takes its place: a class, ``my_unit.py``, ``my_units.py:Name``, the name of a unit
        of the package, or an FMU of any tool, ``My.fmu``. Values of the scenario that it has no parameter for are left
        out, and connections to signals that it lacks, with a note in the log and ``left_out`` in the summary.
    inputs : path, sequence of paths or mapping of str to (t, values), optional
        Signals for inputs that nothing is connected to, in place of those of the scenario; see
        :func:`vdfmu.engine.run.simulate`.
    input_hold : bool, optional
        Whether their values hold until the next row.
    formats : sequence of str
        The files ``results.csv`` and so on to write, of `vdfmu.engine.results.formats.FORMATS`: "csv", "parquet" ...
    pictures : sequence of "png", "svg" and "pdf"
        Kinds of files of the figures.
    simulate : bool, optional
        Whether the page of the run can run it again by itself, for which its units are compiled once more, for
        WebAssembly.
    progress : callable or bool, optional
        Called with stage, done, total; True shows bars, on the terminal or in the notebook.
    log : callable, optional
        Receives the messages of the units.
    observer : Observer, optional
        Is shown rows while the units step, such as a :class:`vdfmu.LiveView`.

    Returns
    -------
    Results
        Recorded signals; `summary` is what ``summary.json`` holds.

    Raises
    ------
    UsageError, ModelError, SspError
        Before the run, for what is wrong with scenario, robot, options or system.
    CosimError, vdfmu.engine.run.Interrupted
        A unit failed, or the user stopped the run. The rows so far are in ``partial`` of the folder.
    """
    scenario = prepare(
        scenario, robot=robot, step=step, stop=stop, master=master, adaptive=adaptive, units=units,
        inputs=inputs, input_hold=input_hold, settings=settings,
    )  # fmt: skip
    known_formats(formats)
    known_pictures(pictures)
    folder = Path(out or "") if out is not None else Path("results") / scenario.name
    place = (
        temporary_folder("vdfmu_run_") if out is False else replacing_results(folder, RUN_OUTPUTS, overwrite)
    )
    if scenario.kind == "contrast":
        if observer is not None:
            raise UsageError(
                f"scenario {scenario.name} has no units, so there is no run to look at while it goes on."
            )
        if backend is not None or fmi_version != "2.0":
            raise UsageError(
                f"scenario {scenario.name} has no units, so there is no backend and no version of FMI."
            )
        if settings or scenario.inputs:
            names = [*(settings or {}), *(table.where for table in scenario.inputs)]
            raise UsageError(
                f"scenario {scenario.name} has no units, so there is nothing to set: {', '.join(names)}."
            )
        with place as partial:
            return _run_contrast(scenario, None if out is False else Path(partial), formats, pictures)

    if backend is None and fmi_version != "2.0":
        backend = "native"
    backend = choose_backend(backend)
    robot = scenario.robot
    text_settings = {key: str(value) for key, value in (settings or {}).items()}
    values = system_values(scenario, settings)
    if log is not None:
        for connection in scenario.system.dropped:
            log(LogMessage("", 0.0, "note", "", f"{connection}: {_LEFT_OUT}"))
        for note in (*model_notes(scenario), *build_notes(scenario.robot, backend)):
            log(LogMessage("", 0.0, "note", "", f"{(scenario.robot or scenario).name}: {note}"))
    with place as made:
        partial = Path(made)
        with doing("build"), temporary_folder("vdfmu_fmus_") as fmus:
            built = cached_fmus(scenario, fmus, backend, fmi_version)
            package = write_ssp(scenario, built, partial / "system.ssp", values, mixed=True)
        summary = run_facts(scenario) | {
            "backend": backend,
            "fmi": fmi_version,
            "settings": text_settings,
            "left_out": list(scenario.system.dropped),
            **({} if robot is None else {"arm": arm_of(robot, values.get("plant", {}))}),
        }
        witness = Witness(scenario, values)
        poses = Poses("tau")
        try:
            results = simulated(
                scenario, package, progress=bound(report, "co-simulation"), log=log, about=summary, observer=observer,
                stream=[] if out is False else [partial / f"results.{form}" for form in formats], probe=witness.probe,
                visitor=poses,
            )  # fmt: skip
        except (CosimError, Interrupted) as error:
            unstable = explain(error, poses)
            if out is not False:
                keep(error, partial, unstable)
            raise
        summary = results.summary
        summary["witness"] = witness.summary(results)
        for note in start_notes(results, scenario):
            summary["notes"].append(note)
            if log is not None:
                log(LogMessage("", 0.0, "note", "", note))
        summary["real_time_factor"] = scenario.stop / summary["wall_s"]
        limits = limits_of(scenario, values)
        if robot is not None:
            summary |= tracking_errors(results, robot, limits) | power_bond(results, robot)
            summary |= implied_gains(scenario.paper, robot, values)
        summary |= time_at_limits(results, limits)
        if has_signals(results, "plant.tau_s", "estimator.tau_s_hat", "estimator.tau_f_hat"):
            summary |= estimation_errors(results, scenario.master)
        summary["paper"] = dict(scenario.paper)
        if out is not False:
            write_summary(summary, partial)
        if reference:
            summary |= _references(scenario, package, values, results)
        found = [*loop_checks(poses, scenario, package, values), *run_checks(summary)]
        summary["verdict"] = verdict_of(found, [f"stability: {poses.lacking}"] if poses.lacking else [])
        if out is False:
            return results
        with doing("figures"):
            if robot is not None and has_signals(results, *_DRAWN):
                from vdfmu.study.report.plots import run_figures  # takes long to import

                run_figures(results.thinned(DRAWN), scenario, partial, pictures)
            else:
                from vdfmu.engine.results.picture import signals_figure

                signals_figure(results.thinned(DRAWN), partial, pictures=pictures)
        _write(results, scenario, partial, simulate)
        return results


def _run_contrast(
    scenario: Scenario, folder: Path | None, formats: Sequence[str], pictures: Sequence[str]
) -> Results:
    """Compare the torques of formulations; without a folder nothing is written."""
    with doing("torques"):
        study = contrast(scenario)
        results = study.results()
    results.summary = run_facts(scenario) | study.summary(dict(scenario.paper))
    results.summary["verdict"] = verdict_of(run_checks(results.summary))
    if folder is None:
        return results
    from vdfmu.study.report.plots import run_figures  # takes long to import

    for form in formats:
        results.write(folder / f"results.{form}")
    with doing("figures"):
        run_figures(study, scenario, folder, pictures)
    _write(results, scenario, folder)
    return results


def _write(results: Results, scenario: Scenario, folder: Path, simulate: bool = False) -> None:
    """Write the page and the summary of a complete run."""
    page = [ShownRun(scenario.name, results, results.summary, folder / "system.ssp")]
    with doing("page"):
        write_report(page, folder / NAME, simulate=simulate)
    write_summary(results.summary, folder)


def _references(
    scenario: Scenario,
    package: Path,
    values: Mapping[str, Mapping[str, Any]],
    results: Results,
) -> dict[str, Any]:
    """Solve the sampled reference of the algorithm, if it samples, and the continuous one, and compare.

    If the first of them differs visibly from the run, the run is held against itself with a change that should not
    show. If that shows as well, single solutions separate: then ``separation`` says how far, and the references are
    compared by their statistics too.
    """
    differences: dict[str, Any] = {}
    found: dict[str, Any] = {"reference": differences}
    foreign = [name for name, part in scenario.system.parts.items() if part.fmu is not None]
    if foreign:
        return {"no_reference": f"{', '.join(foreign)}: an FMU has no equations to solve here"}
    visible = math.inf
    if has_signals(results, "trajectory.q_d", "plant.q"):
        visible = _VISIBLE * max(
            float(np.abs(part["trajectory.q_d"] - part["plant.q"]).max()) for part in results.blocks(BLOCK)
        )
    description = SystemDescription(scenario, values)
    sampled = ALGORITHMS[scenario.master].reference
    wanted = {"sampled": sampled} if sampled else {}
    for key, name in (wanted | {"continuous": "continuous"}).items():
        stage = f"{name} reference"
        report(stage, 0, 1)
        solution = reference_blocks(
            name,
            description,
            step=scenario.step,
            stop=scenario.stop,
            groups=compared(results, scenario.robot),
            progress=bound(report, stage),
        )
        try:
            differences[key], statistics = compare(results, solution, scenario.robot, scenario.master)
        except UsageError as error:  # of an algebraic loop, which the run may have solved
            found["no_reference"] = str(error).rstrip(".")
            continue
        if len(differences) == 1 and differences[key].get("max_position_difference_rad", 0.0) > visible:
            with doing("separation"):
                separation = _separation(scenario, package, values, results)
            if separation > visible:
                found["separation"] = {"change": _NUDGE, "max_position_difference_rad": separation}
        if "separation" in found:
            differences[key] |= statistics
    return found


def _separation(
    scenario: Scenario, package: Path, values: Mapping[str, Mapping[str, Any]], results: Results
) -> float:
    """Largest difference [rad, m] of link positions to the same run with rotor inertias larger by `_NUDGE` of them."""
    inertias = {f"I_m[{i + 1}]": values["plant"][f"I_m[{i + 1}]"] for i in range(scenario.arm.n)}
    parameters = {f"plant.{name}": (1.0 + _NUDGE) * inertia for name, inertia in inertias.items()}
    nudged = simulated(scenario, package, record=["plant.q[*]"], parameters=parameters)
    return float(np.abs(nudged["plant.q"] - results["plant.q"]).max())
