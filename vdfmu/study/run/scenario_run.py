"""The run of a scenario: build stale FMUs, pack, co-simulate, solve the references, compare, judge."""

from __future__ import annotations

import dataclasses
import json
import math
import os
from collections.abc import Iterable, Iterator
from functools import partial
from hashlib import sha256
from pathlib import Path
from typing import Any, Unpack

import numpy as np

from vdfmu.arm.robot import load_robot
from vdfmu.base.cache import cache_folder, load, store
from vdfmu.base.errors import CosimError, UsageError
from vdfmu.base.files import temporary_folder
from vdfmu.base.option import pick, with_options
from vdfmu.base.platforms import compiler_version
from vdfmu.base.progress import doing, report
from vdfmu.base.standards import PYTHON_FMI
from vdfmu.base.text import nearest
from vdfmu.compiler.fmu.build import build_notes, choose_backend
from vdfmu.compiler.functions.sources import source_digest
from vdfmu.engine.algorithms import ALGORITHMS, choice
from vdfmu.engine.masters.observer import Tap
from vdfmu.engine.options import CouplingOptions, SimulatorOptions
from vdfmu.engine.plan.grid import count_steps
from vdfmu.engine.plan.inputs import read_inputs
from vdfmu.engine.results.folder import keep, write_summary
from vdfmu.engine.results.results import Results
from vdfmu.engine.run import Interrupted, LogMessage, Simulator, check_coupling
from vdfmu.study.analysis.loops import loops_of, poses_of
from vdfmu.study.analysis.reach import scenario_of
from vdfmu.study.judgement import check_wanted, judge
from vdfmu.study.limits import own_limits, read_limits
from vdfmu.study.options import ScenarioOptions, ScenarioRunOptions
from vdfmu.study.run import summary as numbers
from vdfmu.study.run.accuracy import PowerBond, accuracy_notes
from vdfmu.study.run.key_figures import key_figures
from vdfmu.study.run.scene import arm_of, scene_of
from vdfmu.study.verdict import explain, loop_checks, verdict
from vdfmu.system.package.description import SystemDescription
from vdfmu.system.package.write import cached_fmus, write_ssp
from vdfmu.system.reference.reference import BLOCK, reference_blocks
from vdfmu.system.reference.witness import Witness
from vdfmu.system.scenario import Scenario
from vdfmu.system.scenario.check import model_notes, remarks
from vdfmu.system.scenario.replace import with_units
from vdfmu.system.scenario.values import robot_with, system_values

_LEFT_OUT = "left out, since the unit instead of the system's has no such signal"
_JOINED = "connected too, since the unit instead of the system's has such a signal, in a terminal of one name"
_NUDGE = 1e-9
"""Relative change of the rotor inertias that must not show; below every tolerance that a scenario has."""


@with_options
def prepare(
    scenario: Scenario | str | os.PathLike[str], names: Iterable[str] = (), **options: Unpack[ScenarioOptions]
) -> Scenario:
    """Load a scenario and apply options to it, with the checks of a scenario file.

    Names in `parameters`, and `names`, will be set later: the robot gets parameters for them, see `with_parameters`.

    Raises
    ------
    UsageError, ModelError
        For an unknown name, a bad file or options that do not fit together.
    """
    changes = {name: value for name, value in options.items() if value is not None}
    robot = options["robot"]
    if isinstance(robot, (str, os.PathLike)):
        robot = load_robot(robot)
    if robot is not None and isinstance(scenario, Scenario):
        raise UsageError("robot: give it with the name or path of a scenario, not with a loaded one.")
    scenario = scenario_of(scenario, robot, [*names, *(options["parameters"] or ())])
    if options["units"]:
        scenario = with_units(scenario, options["units"])
    fields = {field.name for field in dataclasses.fields(Scenario)} - {"robot"}
    scenario = dataclasses.replace(scenario, **{name: changes[name] for name in fields & changes.keys()})
    tables = read_inputs(scenario.inputs, scenario.input_hold)
    more = pick(CouplingOptions, {name: changes[name] for name in changes.keys() - fields})
    scenario = dataclasses.replace(scenario, inputs=tables, options={**scenario.options, **more})
    if scenario.algorithm not in ALGORITHMS:
        ALGORITHMS.names()  # so that the choice has those of other packages
        raise UsageError(f"algorithm: expected {choice()}, got {scenario.algorithm!r}.")
    check_coupling(scenario.algorithm, scenario.adaptive)
    count_steps(scenario.step, scenario.stop)
    return scenario


def _loops_from(stored: bytes) -> dict[str, Any]:
    """Return the entries about the loops of a run from the cache; KeyError for other content."""
    loops = json.loads(stored)
    return {"key_figures": {name: {**figure} for name, figure in loops["key_figures"].items()}}


@with_options
def judge_results(results: Results, scenario: Scenario, package: Path, **options: Unpack[ScenarioRunOptions]) -> None:
    """Add the verdict of :func:`vdfmu.run` to the summary of a run of the package of a scenario."""
    ScenarioRun(prepare(scenario, **pick(ScenarioOptions, options)), options).judge_made(results, package)


class ScenarioRun:
    """The run of a scenario of :func:`prepare`: pack, simulate, judge. If `out` is False, it only packs files."""

    _place: Path | None = None
    _loops: dict[str, Any] | None = None
    """Place of the loops in the cache, and the loops that it has."""

    def __init__(self, scenario: Scenario, options: ScenarioRunOptions) -> None:
        self.scenario, self._options = scenario, options
        check_wanted(options["judge"], options["sampled"], scenario.adaptive)
        native = options["backend"] is None and options["fmi_version"] != PYTHON_FMI.name
        self._backend = choose_backend("native" if native else options["backend"])
        self.system = SystemDescription(scenario, system_values(scenario, options["parameters"]))
        for note in self._notes():
            self._say(note)
        self.limits = read_limits(
            options["limits"] or {}, "--limit", read_limits(scenario.limits, "[limits] of the scenario")
        )
        self.poses = poses_of(self.system, again=bool(options["simulate"]))
        self._facts, self._limits = self._entries(), numbers.limits_of(self.system)
        self._bond = PowerBond(scenario.robot) if scenario.robot else None

    def _notes(self) -> Iterator[str]:
        scenario, robot = self.scenario, self.scenario.robot
        yield from (f"{connection}: {_LEFT_OUT}" for connection in scenario.system.dropped)
        yield from (f"{connection}: {_JOINED}" for connection in scenario.system.joined)
        with_values = {
            *(self._options["parameters"] or ()),
            *(name for table in scenario.inputs for name in table.names),
        }
        with_values |= {f"{name}.{key}" for name, values in scenario.sections.items() for key in values}
        groups = {name.partition("[")[0] for name in with_values}
        for end, names in scenario.system.unfed.items():
            if end not in groups:
                way_out = nearest(end.partition(".")[2], names) if names else "Give it by --set or --input."
                yield f"{end}: not connected, keeps its start value. {way_out}"
        for note in (*model_notes(scenario, self._options["parameters"]), *build_notes(robot, self._backend)):
            yield f"{(robot or scenario).name}: {note}"

    def _entries(self) -> dict[str, Any]:
        """Return the entries of the summary that are known before a run."""
        scenario, options, robot = self.scenario, self._options, self.scenario.robot
        return numbers.run_facts(scenario) | {
            "backend": self._backend,
            **({"compiler": compiler_version()} if self._backend == "native" else {}),
            "fmi": options["fmi_version"],
            "parameters": {key: str(value) for key, value in (options["parameters"] or {}).items()},
            "units": {name: str(unit) for name, unit in (options["units"] or {}).items()},
            "left_out": list(scenario.system.dropped),
            "joined": list(scenario.system.joined),
            **({"own_limits": limits} if (limits := own_limits(self.limits)) else {}),
            **remarks(scenario, options["parameters"], self.system.values, options["stop"] is not None),
            **({} if robot is None else {"arm": arm_of(robot, self.system.values.get("plant", {}))}),
            "scene": scene_of(self.system),
        }

    def pack(self, folder: Path) -> None:
        """Build the FMUs, and write the package into the folder of the run."""
        self.folder, values = folder, self.system.values
        with doing("build"), temporary_folder("vdfmu_fmus_") as fmus:
            built = cached_fmus(self.scenario, fmus, self._backend, self._options["fmi_version"])
            self.package = write_ssp(self.scenario, built, folder / "system.ssp", values, mixed=True)
        self._place = self._place_of_loops()
        self._loops = load(self._place, _loops_from) if self._place else None

    def _place_of_loops(self) -> Path | None:
        """Return the place of the loops in the cache, by all that decides them and a page; None for unknown masters."""
        scenario, algorithm = self.scenario, ALGORITHMS[self.scenario.algorithm]
        if not algorithm.stepper.startswith("vdfmu."):
            return None
        facts = [source_digest("study.runs"), np.__version__, sha256(self.package.read_bytes()).hexdigest(), algorithm]
        facts += [table.digest for table in read_inputs(scenario.inputs, scenario.input_hold)]
        facts += [scenario.coupling, scenario.stop, scenario.step, bool(self._options["simulate"])]
        return cache_folder() / "loops" / sha256(repr(facts).encode()).hexdigest()

    def simulate(self) -> Results:
        """Co-simulate; return rows and the numbers that need no reference. A failed run keeps its summary."""
        options, written = self._options, self._options["out"] is not False
        compared = Witness(self.system)
        try:
            results = self._simulated(
                progress=partial(report, "co-simulation"), log=options["log"],
                about=self._facts, observer=options["observer"],
                taps=self._taps(compared),
                pace=options["pace"], record=self._recorded(),
                stream=[self.folder / f"results.{form}" for form in options["formats"]] if written else [],
            )  # fmt: skip
        except (CosimError, Interrupted) as error:
            figures = explain(error, self.poses)
            if isinstance(error, CosimError) and error.results:
                for note in numbers.start_notes(error.results, self.scenario, numbers.FAR):
                    error.add_note(f"A likely cause: {note.removesuffix('.')}")
            if error.results is not None and figures:
                error.results.summary["key_figures"] = figures
            if written:
                keep(error, self.folder, loop_checks({"key_figures": figures}))
            raise
        self._measure(results, compared)
        if written:
            write_summary(results.summary, self.folder)
        return results

    def _taps(self, compared: Witness) -> list[Tap]:
        return [compared.probe, *([self.poses] if self._loops is None else []), *filter(None, [self._bond])]

    def _measure(self, results: Results, compared: Witness) -> None:
        """Add the numbers of a run that need no reference to its summary."""
        summary = results.summary
        summary["witness"] = compared.summary(results)
        for note in (*numbers.start_notes(results, self.scenario), *accuracy_notes(results, self.system)):
            summary["notes"].append(note)
            self._say(note)
        summary["real_time_factor"] = self.scenario.stop / summary["wall_s"]
        if self.scenario.robot is not None:
            tau_m = self.scenario.system.fed.get("controller.tau_m", "")
            summary |= numbers.tracking_errors(results, self.scenario.robot, self._limits, tau_m)
        summary |= numbers.time_at_limits(results, self._limits)
        if numbers.has_signals(results, "plant.tau_s", "estimator.tau_s_hat", "estimator.tau_f_hat"):
            summary |= numbers.estimation_errors(results, ALGORITHMS[self.scenario.algorithm].substeps)
        summary |= {"paper": dict(self.scenario.paper)} | (self._bond.summary() if self._bond else {})

    def judge_made(self, results: Results, package: Path) -> None:
        """Judge a run of a package of this scenario that was made elsewhere: it is run again for what its taps see."""
        self.package, compared = package, Witness(self.system)
        self._simulated(self._options["parameters"], record=(), taps=self._taps(compared))
        results.summary.update({**self._facts, **results.summary})
        self._measure(results, compared)
        self.judge(results)

    def _simulated(self, parameters: Any = None, package: Path | None = None, **options: Any) -> Results:
        """Co-simulate; for `options` see :meth:`vdfmu.engine.run.Simulator.run`, and `log`."""
        scenario = self.scenario
        settings: SimulatorOptions = {
            **scenario.coupling, "inputs": scenario.inputs, "parameters": parameters, "log": options.pop("log", None),
            "stepper": self._options["stepper"],
        }  # fmt: skip
        with Simulator(package or self.package, **settings) as simulator:
            return simulator.run(start=0.0, stop=scenario.stop, step=scenario.step, **options)

    def _recorded(self) -> list[str] | None:
        """Return the names of all outputs, inputs from outside and the option `record`; None without this option."""
        if not self._options["record"]:
            return None
        tables = self.system.tables.items()
        names = [f"{unit}.{v.name}" for unit, table in tables for v in table if v.causality == "output"]
        return [*names, *(name for table in self.scenario.inputs for name in table.names), *self._options["record"]]

    def _say(self, note: str) -> None:
        if (log := self._options["log"]) is not None:
            log(LogMessage("", 0.0, "note", "", note))

    def judge(self, results: Results) -> None:
        """Compare with the references if the options ask for it; add key figures and verdict to the summary."""
        summary, scenario, values = results.summary, self.scenario, self.system.values
        if self._options["reference"]:
            summary |= self._references(results)
        if self._options["judge"] is not None:
            coupling: SimulatorOptions = {**scenario.coupling, "inputs": scenario.inputs}
            judgement = judge(
                self.package, self._options["judge"], stop=scenario.stop, step=scenario.step,
                sampled=self._options["sampled"], **coupling,
            )  # fmt: skip
            summary["judgement"] = judgement.to_dict()
        loops = self._loops if self._loops is not None else self._own_loops()
        if self._place and "stability" not in loops:
            store(self._place, json.dumps(loops).encode())
        figures: dict[str, Any] = summary.get("key_figures", {})
        if scenario.robot is not None:
            plant = robot_with(scenario.plant_robot, values.get("plant", {}))
            touch = scenario.system.fed.get("plant.F_e", "")
            figures |= key_figures(results, scenario.robot, self._limits, plant, touch, summary["scene"]["objects"])
        summary |= loops | {"key_figures": figures | loops.get("key_figures", {})}
        summary["verdict"] = verdict(summary, self.limits)

    def _own_loops(self) -> dict[str, Any]:
        """Return the entries of a summary about the loops of this run; those of Python FMUs from their native twins."""
        if self.poses.lacking and self._backend == "python":
            self.poses = poses_of(self.system, again=bool(self._options["simulate"]))
            try:
                with temporary_folder("vdfmu_twin_") as folder:
                    built = cached_fmus(self.scenario, folder, choose_backend("native"), self._options["fmi_version"])
                    package = write_ssp(
                        self.scenario, built, Path(folder) / "system.ssp", self.system.values, mixed=True
                    )
                    self._simulated(package=package, record=(), taps=[self.poses])
            except UsageError as error:  # without a compiler
                return {"stability": {"reason": f"the native FMUs cannot be built: {error}", "expected": True}}
        return loops_of(self.poses, self.system, self.scenario.stop)

    def _references(self, results: Results) -> dict[str, Any]:
        """Solve the sampled reference of the algorithm, if it samples, and the continuous one, and compare.

        If the first of them differs visibly from the run, the run is compared with itself after an invisible change.
        If that shows as well, single solutions separate. Then ``separation`` has their distance, and the references
        are compared by their statistics too.
        """
        scenario, differences = self.scenario, dict[str, Any]()
        entries: dict[str, Any] = {"reference": differences}
        foreign = [name for name, part in scenario.system.parts.items() if part.fmu is not None]
        if foreign:
            return {"no_reference": f"{', '.join(foreign)}: an FMU has no equations to solve here"}
        visible = math.inf
        if numbers.has_signals(results, "trajectory.q_d", "plant.q"):
            visible = self.limits["reference"].value * max(
                float(np.abs(part["trajectory.q_d"] - part["plant.q"]).max()) for part in results.blocks(BLOCK)
            )
        how = ALGORITHMS[scenario.algorithm]
        # without a feedforward torque in the controller there is no compensation error: all outputs are compared
        robot = scenario.robot if "controller.tau_m" in scenario.system.fed else None
        wanted = {"sampled": how.reference} if how.reference else {}
        for key, name in (wanted | {"continuous": "continuous"}).items():
            stage = f"{name} reference"
            report(stage, 0, 1)
            solution = reference_blocks(
                name, self.system, step=scenario.step, stop=scenario.stop,
                substeps=how.substeps if key == "sampled" else 1, groups=numbers.compared(results, robot), overlap=1,
                progress=partial(report, stage),
            )  # fmt: skip
            try:
                differences[key], statistics = numbers.compare(results, solution, robot, how.substeps)
            except UsageError as error:  # an algebraic loop, which the run may have solved
                entries["no_reference"] = str(error).rstrip(".")
                continue
            if len(differences) == 1 and differences[key].get("max_position_difference_rad", 0.0) > visible:
                with doing("separation"):
                    separation = self._separation(results)
                if separation > visible:
                    entries["separation"] = {"change": _NUDGE, "max_position_difference_rad": separation}
            if "separation" in entries:
                differences[key] |= statistics
        return entries

    def _separation(self, results: Results) -> float:
        """Largest difference [rad, m] of link positions to the same run with rotor inertias larger by `_NUDGE`."""
        parameters = {
            f"{plant}.{name}": (1.0 + _NUDGE) * value
            for plant in self.system.resolved.plants
            for name, value in self.system.values[plant].items()
            if name.startswith("I_m[")
        }
        nudged = self._simulated(parameters, record=["plant.q[*]"])
        pairs = zip(nudged.blocks(BLOCK), results.blocks(BLOCK), strict=True)
        return max(float(np.abs(changed["plant.q"] - base["plant.q"]).max()) for changed, base in pairs)
