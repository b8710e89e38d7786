"""`compare`: laws tuned alike, then run with every mismatch: one table, a page, and a text that says which to take."""

from __future__ import annotations

import itertools
import json
from collections.abc import Iterator, Mapping, Sequence
from ctypes import c_double
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from time import perf_counter
from typing import Any, NamedTuple, Unpack

import numpy as np

from vdfmu.arm.dynamics import forward_kinematics
from vdfmu.base.errors import UnitError, UsageError, VdfmuError
from vdfmu.base.files import temporary_folder, write_whole
from vdfmu.base.once import one_job
from vdfmu.base.option import pick, with_options
from vdfmu.base.progress import counted, with_progress
from vdfmu.base.text import close_to
from vdfmu.base.toml_file import locate
from vdfmu.base.version import __version__
from vdfmu.engine.run.simulator import Simulator
from vdfmu.study.compare.axes import ARMS, LAWS, MISMATCHES, MOTIONS, ComparedLaw, corner_of
from vdfmu.study.compare.cells import PAYLOAD, ComparedArm
from vdfmu.study.compare.measures import MEASURES, OF_A_RUN, SIGNALS, OfRun, path_accuracy, path_repeatability
from vdfmu.study.compare.page import AXES, LawComparison, in_words, write_comparison
from vdfmu.study.options import CompareOptions, TuneOptions
from vdfmu.study.run.at_limits import LIMITED, limits_of
from vdfmu.study.run.scenario_run import prepare
from vdfmu.study.sweeps.axes import Points
from vdfmu.study.sweeps.job import Job, Row, Task, WiredSystem
from vdfmu.study.sweeps.ledger import Ledger, files_of
from vdfmu.study.sweeps.local import check_workers
from vdfmu.study.sweeps.measures import read_measures
from vdfmu.study.sweeps.plan import Plan, digest, of_scenario
from vdfmu.study.sweeps.sweep import run_plan
from vdfmu.study.tuning.tune import tune
from vdfmu.system.package.description import SystemDescription
from vdfmu.system.scenario import Scenario
from vdfmu.system.scenario.values import system_values

COST = "rms_tool"
"""Measure that the search makes smallest, of the motion point to point with a force at the tool on the way."""
_OFF = 0.05
"""Tool error, as a share of the arm's length, from which an arm has left its path."""
_STEPS, _TIMES = 200, 7
"""Steps that are timed together, and how often; the shortest run has 1500."""

_KNOWN: Mapping[str, Mapping[str, Any]] = {"laws": LAWS, "motions": MOTIONS, "mismatches": MISMATCHES}


class Tuning(NamedTuple):
    """How a law was tuned on an arm."""

    values: dict[str, Any]
    """Values of the unit's parameters."""
    before: float
    after: float
    """Cost of the start and of the values [m]."""
    evaluations: int
    failed: int
    step_us: float
    """Time of a step of the law's FMU, with its inputs and outputs [us]."""
    why_not: str = ""
    """Why it is not tuned."""


@dataclass(frozen=True)
class _CellPlan(Plan):
    """Cells of a law on an arm: each has settings of its own."""

    settings: Sequence[Mapping[str, Any]] = ()

    def task(self, point: int) -> Task:
        return point, int(self.chosen[point]), dict(self.settings[point])


@with_progress
@one_job()
@with_options
def compare(**options: Unpack[CompareOptions]) -> LawComparison:
    """Tune control laws alike, run them on arms, along motions, with mismatches, and write the table and its page.

    Every law is tuned on every arm by the same search: as many evaluations, the same seed, the same cost on the plant
    that it knows, the same least modulus margin. A law that misses the margin is not in the table. What is done stays
    done: after Ctrl-C the same call goes on.

    Parameters
    ----------
    **options
        :class:`vdfmu.study.options.CompareOptions`.

    Returns
    -------
    LawComparison
        The table, which is on disk, with ``report.html``, ``sweep.csv`` and ``summary.md``.

    Raises
    ------
    UsageError, ModelError
        For unknown names, and for another comparison in the folder.
    """
    chosen = {axis: list(names if options[axis] is None else options[axis]) for axis, names in _KNOWN.items()}
    arms = list(ARMS if options["arms"] is None else options["arms"])
    if problems := [*_wrong_names(chosen, arms), *_wrong_numbers(options)]:
        raise UsageError("\n".join(problems))
    check_workers(options)
    folder = Path("results/compare" if options["out"] is None else options["out"])
    rows: list[dict[str, Any]] = []
    tunings: dict[str, dict[str, dict[str, Any]]] = {}
    pairs = [(arm, law) for arm in (ComparedArm(name, folder) for name in arms) for law in chosen["laws"]]
    for arm, law in counted("laws on arms", pairs, len(pairs)):
        found = _tuned(arm, LAWS[law], options)
        tunings.setdefault(arm.name, {})[law] = found._asdict()
        if not found.why_not:
            rows += _cells(arm, LAWS[law], found, chosen, options)
    about = {
        "budget": options["evaluations"], "margin": options["margin"], "seed": options["seed"], "tunings": tunings,
        "repeats": options["repeats"], "delayed": options["delayed"], "cost": COST, **chosen, "arms": list(tunings),
    }  # fmt: skip
    study = _table(folder, rows, about)
    write_whole(folder / "summary.md", [in_words(study).encode()])
    write_comparison(study)
    return study


def _wrong_names(chosen: Mapping[str, Sequence[str]], arms: Sequence[str]) -> Iterator[str]:
    """Yield a line for each name that is unknown, for names that are given twice, and for no name."""
    for axis, names in (*chosen.items(), ("arms", arms)):
        if not names:
            yield f"{axis}: expected at least one, got none. Leave it out for the default."
    for axis, names in chosen.items():
        for name in dict.fromkeys(names):
            if name == "iterative_learning":
                yield f"{axis}: {name} learns over repeated cycles, and none of these motions repeats."
            elif name not in _KNOWN[axis]:
                yield f"{axis}: expected {', '.join(_KNOWN[axis])}, got {name}{close_to(name, _KNOWN[axis]) or '.'}"
            if names.count(name) > 1:
                yield f"{axis}: expected each once, got {name} {names.count(name)} times."
    stems: dict[str, list[str]] = {}
    for arm in arms:
        try:
            stems.setdefault(locate(arm, "robots").stem, []).append(arm)
        except UsageError as error:
            yield f"arms: {error}"
    for stem, same in stems.items():
        if len(same) > 1:
            yield f"arms: expected one of each name, got {', '.join(same)}, all of which are {stem}."


def _wrong_numbers(options: CompareOptions) -> Iterator[str]:
    for name in ("evaluations", "repeats"):
        if options[name] < 1:
            yield f"{name}: expected at least 1, got {options[name]}."
    if not 0.0 < options["margin"] < 1.0:
        yield f"margin: expected a number above 0 and below 1, got {options['margin']:g}."


def _tuned(arm: ComparedArm, law: ComparedLaw, options: CompareOptions) -> Tuning:
    """Tune a law on an arm, or read how it was."""
    folder = arm.folder / law.unit / "tune"
    corner = forward_kinematics(arm.robot, corner_of(arm.start, arm.end))[0]
    measure = {
        name: OfRun(name, arm.robot, corner, least=options["margin"], delayed=options["delayed"])
        for name in (COST, "margin")
    }
    started = arm.started(law)
    shared: Any = {
        **pick(TuneOptions, options), "out": folder, "settings": started, "together": True, "method": "global",
        "units": {"controller": law.searched or law.unit}, "limit": {"margin": measure["margin"]},
    }  # fmt: skip
    for own in ("margin", "progress"):
        shared.pop(own, None)
    vary = {f"controller.{name}": f"*log({low}, {high})" for name, (low, high) in law.vary.items()}
    try:
        found = tune(arm.tuning, vary, measure[COST], **shared)
    except UnitError as error:  # such as gains that do not exist for the arm
        return Tuning({}, np.nan, np.nan, 0, 0, 0.0, str(error))
    why_not = "" if found.after.feasible else "no values keep the margin"
    values = system_values(prepare(arm.tuning, units=shared["units"], settings=started), {**started, **found.settings})
    groups = law.kept or [name.partition(".")[2] for name in started if name.startswith("controller.")]
    kept = {n: x for n, x in values["controller"].items() if n.partition("[")[0] in groups}
    place, step = folder / "step.json", 0.0
    if not why_not:
        if not place.exists():
            path = arm.write("point_to_point", law, kept, "plain")
            write_whole(place, [json.dumps(_step_time(of_scenario(path, [], {}, {}))).encode()])
        step = json.loads(place.read_bytes())
    return Tuning(kept, float(found.before.cost[0]), float(found.after.cost[0]), found.evaluations, found.failed, step,
                  why_not)  # fmt: skip


def _step_time(system: WiredSystem) -> float:
    """Return the least time [us] of a step of the controller with its inputs and outputs, of some hundred each."""
    with temporary_folder("vdfmu_compare_") as place:
        path = Path(place, "0.ssp")
        path.write_bytes(system.content)
        with Simulator(path, isolate=False, log=lambda message: None, **system.options) as simulator:
            instance = simulator.stand(0.0, system.run["step"]).instances["controller"]
            known = [v for v in instance.description.variables.values() if v.type == "Real"]
            sides = {v: [one for one in known if one.causality == v] for v in ("input", "output")}
            given, got = (np.array([float(instance.get(v)) for v in sides[side]]) for side in sides)
            calls = [*instance.access("Set", sides["input"], given), *instance.access("Get", sides["output"], got)]
            clock, size = c_double(0.0), c_double(system.run["step"])
            calls.insert(-1, instance.step_call(clock, size))
            times: list[float] = []
            for _ in range(_TIMES):
                begin = perf_counter()
                for _ in range(_STEPS):
                    instance.run(calls)
                    clock.value += size.value
                times.append(perf_counter() - begin)
    return 1e6 * min(times) / _STEPS


def _cells(
    arm: ComparedArm, law: ComparedLaw, tuning: Tuning, chosen: Mapping[str, Sequence[str]], options: CompareOptions
) -> Iterator[dict[str, Any]]:
    """Run the cells of a law on an arm, and yield their rows."""
    plan, runs = _plan(arm, law, tuning, chosen, options)
    given: Any = {name: options[name] for name in ("workers", "time_limit", "overwrite")}
    found = run_plan(plan, arm.folder / law.unit / "cells", given).table().to_pylist()
    for _, same in itertools.groupby(found, lambda row: (row["motion"], row["mismatch"])):
        repeats = list(same)
        yield {"arm": arm.name, "law": law.unit, "run": json.dumps(runs[repeats[0]["point"]]), **_cell(arm, repeats)}


def _plan(
    arm: ComparedArm, law: ComparedLaw, tuning: Tuning, chosen: Mapping[str, Sequence[str]], options: CompareOptions
) -> tuple[_CellPlan, list[dict[str, Any]]]:
    """Return the plan of all cells of a law on an arm, and the options with which each is run again."""
    systems: dict[tuple[str, str], int] = {}
    wired: list[WiredSystem] = []
    paths: list[Path] = []
    scenarios: list[Scenario] = []
    cells: list[tuple[str, str, int, int]] = []
    settings: list[dict[str, Any]] = []
    for motion, name in itertools.product(chosen["motions"], chosen["mismatches"]):
        mismatch = MISMATCHES[name]
        key = motion, mismatch.structure
        if key not in systems:
            systems[key] = len(wired)
            paths.append(arm.write(motion, law, tuning.values, mismatch.structure))
            scenarios.append(prepare(paths[-1], settings={PAYLOAD: 0.0}))
            wired.append(of_scenario(scenarios[-1], [], {}, {"settings": {PAYLOAD: 0.0}}))
        scenario = scenarios[systems[key]]
        for repeat in range(options["repeats"] if mismatch.noise else 1):
            cells.append((motion, name, repeat, systems[key]))
            settings.append(arm.differences(scenario, mismatch, options["seed"] + repeat))
    columns: Points = {n: np.array([c[k] for c in cells]) for k, n in enumerate(("motion", "mismatch", "repeat"))}
    known = system_values(scenarios[0], {PAYLOAD: 0.0})
    limits = limits_of(SystemDescription(scenarios[0], known))
    corner = forward_kinematics(arm.robot, corner_of(arm.start, arm.end))[0]
    measures = read_measures({n: OfRun(n, arm.robot, corner, limits) for n in OF_A_RUN})
    job = Job(tuple(wired), tuple(measures), tuple(f"{name}[*" for name in SIGNALS), ())
    facts = {
        **_facts(f"{arm.name}_{law.unit}", [f"{n}={', '.join(dict.fromkeys(map(str, c)))}" for n, c in columns.items()],
                 len(cells), options["seed"]),
        "systems": [{"options": {**s.options, **s.run}, "package": digest(s.content), "inputs": []} for s in wired],
        "points": digest(json.dumps(settings).encode()),
    }  # fmt: skip
    runs = [
        {"scenario": str(paths[c[3]].relative_to(arm.folder.parent)), "settings": s}
        for c, s in zip(cells, settings, strict=True)
    ]
    return _CellPlan(columns, np.array([c[3] for c in cells]), job, facts, [None] * len(wired), settings), runs


def _facts(name: str, axes: list[str], n: int, seed: int) -> dict[str, Any]:
    return {
        "vdfmu": __version__, "scenario": name, "source": name, "axes": axes, "sample": "grid", "n": n, "seed": seed,
        "settings": {}, "options": {}, "measures": {n: m.title for n, m in MEASURES.items()},
        "units": {n: m.unit for n, m in MEASURES.items()}, "keep": [], "engine": "fmu", "systems": [],
    }  # fmt: skip


def _cell(arm: ComparedArm, repeats: Sequence[Row]) -> dict[str, Any]:
    """Return the row of a cell from those of its runs: measures are of the first, AT and RT of all."""
    first = repeats[0]
    cell: dict[str, Any] = {name: first[name] for name in ("motion", "mismatch", "failed", "failed_at")}
    cell |= {"runs": len(repeats), "wall_s": sum(row["wall_s"] for row in repeats)}
    why = next((row["failed"] for row in repeats if row["failed"]), None)
    if why is not None:
        return cell | {"failed": why, "verdict": "unstable" if "unstable" in why else "failed"}
    cell |= {name: first[name] for name in MEASURES if name in first}
    size = sum(name.startswith("crossing[") for name in first)
    of = {n: np.array([[row[f"{n}[{i + 1}]"] for i in range(size)] for row in repeats]) for n in ("crossing", "place")}
    cycles = of["crossing"].reshape(len(repeats), -1, 3)
    cell |= {"AT": path_accuracy(of["place"][0].reshape(-1, 3), cycles), "RT": path_repeatability(cycles)}
    verdict = "not judged" if np.isnan(first["unstable"]) else "no margin" if first["modulus"] == 0.0 else "stable"
    verdict = "off the path" if cell["peak_tool"] > _OFF * arm.length else verdict
    verdict = "at limits" if first["limited"] >= LIMITED else verdict  # what a run is known by, as in its own verdict
    return cell | {"verdict": "unstable" if first["unstable"] == 1.0 else verdict, "limited": first["limited"]}


def _table(folder: Path, rows: Sequence[dict[str, Any]], about: dict[str, Any]) -> LawComparison:
    if not rows:
        reasons = [f"{arm}: {law}: {t['why_not']}" for arm, laws in about["tunings"].items() for law, t in laws.items()]
        raise VdfmuError("no law is tuned:\n" + "\n".join(reasons))
    words = (*AXES, "verdict", "run")
    points = {name: np.array([row[name] for row in rows]) for name in words}
    axes = [f"{name}={', '.join(dict.fromkeys(points[name].tolist()))}" for name in AXES]
    facts = _facts("compare", axes, len(rows), about["seed"]) | {"compare": about}
    for file in files_of(folder):
        file.unlink()
    with Ledger(folder, facts, digest(json.dumps(about).encode()), points, overwrite=True) as ledger:
        ledger.add([{n: x for n, x in row.items() if n not in words} | {"point": k} for k, row in enumerate(rows)])
        study = LawComparison(ledger.finish())
    import_module("pyarrow.csv").write_csv(study.table(), folder / "sweep.csv")
    return study
