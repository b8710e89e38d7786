"""Points of a parameter study: how many a second, with the FMUs and with the batch engine."""

from __future__ import annotations

import shutil
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

import vdfmu
from benchmarks.report import Report, Table
from benchmarks.timing import processor_time
from vdfmu.study.batch.engine import LANES, Engine
from vdfmu.study.sweeps.job import Bench, Job
from vdfmu.study.sweeps.measures import measured
from vdfmu.study.sweeps.plan import Plan, make_plan

TITLE = "Parameter studies"
AXIS, MEASURE = "controller.K_v[2]", "rms(trajectory.q_d - plant.q)"
STEP = 1e-3
_fmu: dict[str, Any] = {}


def run(report: Report, quick: bool = False) -> None:
    """Measure and tabulate."""
    with tempfile.TemporaryDirectory(prefix="vdfmu-bench-") as name:
        folder = Path(name)
        _throughput(report, folder, 1.0 if quick else 10.0, 8 if quick else 40, 1 if quick else 3)
        _engines(report, folder, 1.0 if quick else 10.0, 3 if quick else 10)


def _plan(n: int, stop: float, engine: str = "fmu") -> Plan:
    return make_plan(
        "tracking", {AXIS: f"*lin(0.5, 1.5, {n})"}, measure={"error": MEASURE}, stop=stop, step=STEP, engine=engine
    )


def _throughput(report: Report, folder: Path, stop: float, points: int, rounds: int) -> None:
    """Compare studies by one worker and two, in turns."""
    counts = {"fmu": (points, 1), "batch": (points * LANES, LANES)}  # points, those at a time
    ways = [(engine, workers) for workers in (1, 2) for engine in counts]
    spent: dict[tuple[str, int], list[tuple[float, float]]] = {way: [] for way in ways}
    for _ in range(rounds):
        for engine, workers in ways:
            count, together = counts[engine]
            processor = processor_time()
            marks = _study(folder / "study", count, engine, stop, workers)
            first = workers * together
            rate = (marks[-1] - marks[first - 1]) / (count - first)
            spent[engine, workers].append((rate, (processor_time() - processor) / count))
    table = Table(
        "sweep_points",
        f"{points} points of {stop:g} s at 1 kHz, tracking",
        [("engine", ""), ("workers", "d"), ("points/s", ".2f"), ("of one", ".2f"), ("processor [ms]", ".0f")],
        notes=["Points/s from the first point of each worker on; processor time of a point with the start. "
               f"Best of {rounds} rounds, in which the ways take turns."],
    )  # fmt: skip
    for (way, workers), rounds_ in spent.items():
        wall, processor = (min(round_[k] for round_ in rounds_) for k in (0, 1))
        ratio = min(rate for rate, _ in spent[way, 1]) / wall
        table.add(way, workers, 1.0 / wall, ratio, 1e3 * processor)
        report.facts[f"{way}_{workers}"] = {"points_per_s": 1.0 / wall, "processor_s": processor}
    report.show(table)


def _study(folder: Path, points: int, engine: str, stop: float, workers: int) -> list[float]:
    """Run a study, anew; return when each point was done."""
    shutil.rmtree(folder, ignore_errors=True)
    marks: list[float] = []

    def note(stage: str, done: int, total: int) -> None:
        if stage == "points" and done:
            marks.append(time.perf_counter())

    vdfmu.sweep(
        "tracking", {AXIS: f"*lin(0.5, 1.5, {points})"}, measure={"error": MEASURE}, stop=stop, workers=workers,
        engine=engine, out=folder, progress=note,
    )  # fmt: skip
    return marks


def _engines(report: Report, folder: Path, stop: float, rounds: int) -> None:
    """Compare the engines on one core: processor time of a point, with its measures; the ways take turns."""
    table = Table(
        "sweep_engines",
        f"Engines on one core, points of {stop:g} s at 1 kHz, tracking",
        [("engine", ""), ("lanes", "d"), ("a point [ms]", ".1f"), ("points/s", ".1f"), ("of the FMUs", ".1f")],
        notes=[f"Processor time of a point with its measure, best of {rounds} rounds, in which the ways take turns."],
    )
    plan = _plan(LANES, stop, "batch")
    system, measures = plan.job.systems[0], plan.job.measures
    assert system.program is not None
    tasks = [plan.task(k) for k in range(LANES)]
    points = [system.parameters(values) for _, _, values in tasks]
    best = Engine(system.program, plan.job.record)
    engines = [Engine(system.program, plan.job.record, level) for level in range(best.level)] + [best]
    bench = _bench(folder / "engines", plan.job)
    spent: dict[tuple[str, int], float] = {}

    def in_lanes(engine: Engine) -> None:
        for results in engine.run(points[: engine.lanes]):
            assert results is not None
            measured(measures, results)

    ways: dict[tuple[str, int], Callable[[], Any]] = {("FMUs", 1): lambda: bench.run(tasks[:1], apart=True)}
    for name, engine in zip(("any processor", "AVX2", "AVX-512"), engines, strict=False):
        ways[f"batch, {name}", engine.lanes] = partial(in_lanes, engine)
    try:
        for _ in range(rounds):
            for way, call in ways.items():
                began = time.process_time()
                call()
                each = (time.process_time() - began) / way[1]
                spent[way] = min(each, spent.get(way, np.inf))
    finally:
        bench.close()
    for (name, lanes), each in spent.items():
        table.add(name, lanes, 1e3 * each, 1.0 / each, spent["FMUs", 1] / each)
        report.facts[f"engine_{name}"] = {"lanes": lanes, "point_s": each, "of_fmus": spent["FMUs", 1] / each}
    report.show(table)


def _bench(folder: Path, job: Job) -> Bench:
    folder.mkdir()
    return Bench(job, folder)
