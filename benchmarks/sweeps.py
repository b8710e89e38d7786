"""Points of a parameter study on one core: with the FMUs and with the batch engine."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.report import Report, Table
from vdfmu.extras.batch.engine import LANES, Engine
from vdfmu.study.sweeps.job import Bench
from vdfmu.study.sweeps.measures import measured
from vdfmu.study.sweeps.plan import make_plan

TITLE = "Parameter studies"
AXIS, MEASURE = "controller.K_v[2]", "rms(trajectory.q_d - plant.q)"
STEP = 1e-3


def run(report: Report, quick: bool = False) -> None:
    """Measure and tabulate."""
    with tempfile.TemporaryDirectory(prefix="vdfmu-bench-") as name:
        _engines(report, Path(name), 1.0 if quick else 10.0, 3 if quick else 10)


def _engines(report: Report, folder: Path, stop: float, rounds: int) -> None:
    """Compare the engines on one core: processor time of a point, with its measures; the ways take turns."""
    table = Table(
        "sweep_engines",
        f"Engines on one core, points of {stop:g} s at 1 kHz, tracking",
        [("engine", ""), ("lanes", "d"), ("a point [ms]", ".1f"), ("of the FMUs", ".1f")],
        notes=[f"Processor time of a point with its measure, best of {rounds} rounds, in which the ways take turns."],
    )
    axis = {AXIS: f"*lin(0.5, 1.5, {LANES})"}
    plan = make_plan("tracking", axis, measure={"error": MEASURE}, stop=stop, step=STEP, engine="batch")
    system, measures = plan.job.systems[0], plan.job.measures
    assert system.program is not None
    tasks = [plan.task(k) for k in range(LANES)]
    points = [system.parameters(values) for _, _, values in tasks]
    best = Engine(system.program, plan.job.record)
    engines = [Engine(system.program, plan.job.record, level) for level in range(best.level)] + [best]
    bench = Bench(plan.job, folder)
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
        table.add(name, lanes, 1e3 * each, spent["FMUs", 1] / each)
    report.show(table)
