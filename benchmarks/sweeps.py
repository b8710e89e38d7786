"""Points of a parameter study: how many a second, beside FMPy's way, and what a cluster adds."""

from __future__ import annotations

import json
import multiprocessing
import os
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Generator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import fmpy
import numpy as np

import vdfmu
from benchmarks.report import Report, Table
from benchmarks.system import packed
from benchmarks.timing import processor_time
from vdfmu.compiler.c.compile import native_available
from vdfmu.engine.container import write_container
from vdfmu.study.batch.engine import Engine
from vdfmu.study.batch.program import LANES
from vdfmu.study.sweeps.axes import read_axes
from vdfmu.study.sweeps.job import Bench, Job, Row
from vdfmu.study.sweeps.ledger import Ledger
from vdfmu.study.sweeps.measures import measured
from vdfmu.study.sweeps.plan import Plan, make_plan
from vdfmu.system.scenario import load_scenario

TITLE = "Parameter studies"
AXIS, MEASURE = "controller.K_v[2]", "rms(trajectory.q_d - plant.q)"
STEP = 1e-3
_fmu: dict[str, Any] = {}


def run(report: Report, quick: bool = False) -> None:
    """Measure and tabulate."""
    if not native_available():
        report.facts["skipped"] = "the compiler of native FMUs is not installed (pip install .[native])"
        report.say(f"skipped: {report.facts['skipped']}")
        return
    with tempfile.TemporaryDirectory(prefix="vdfmu-bench-") as name:
        folder = Path(name)
        _throughput(report, folder, 1.0 if quick else 10.0, 8 if quick else 40, 1 if quick else 3)
        _point(report, folder, (1.0,) if quick else (1.0, 10.0), 3 if quick else 20)
        _engines(report, folder, 1.0 if quick else 10.0, 3 if quick else 10)
        _growth(report, folder, (50, 100) if quick else (250, 1000), (2000,) if quick else (10_000, 100_000))
        _cluster(report, folder, (1, 20), 20 if quick else 200)


def _plan(n: int, stop: float, engine: str = "fmu") -> Plan:
    return make_plan(
        "tracking",
        {AXIS: f"*lin(0.5, 1.5, {n})"},
        measure={"error": MEASURE},
        options={"stop": stop, "step": STEP},
        engine=engine,
    )


def _throughput(report: Report, folder: Path, stop: float, points: int, rounds: int) -> None:
    """Compare studies by one worker and two with simulate_fmu in a pool of as many, in turns."""
    scenario = load_scenario("tracking")
    with packed(scenario, "native") as package:
        container = write_container(package, folder / "tracking.fmu", step=STEP)
        axis = _plan(points, stop)
        values = axis.points[AXIS] * float(axis.job.systems[0].bindings[AXIS].nominal[0])
        batch = points * LANES
        given: dict[str, tuple[int, int, Callable[..., None]]] = {  # points, those at a time, how
            "vdfmu.sweep, engine fmu": (points, 1, partial(_ours, folder / "study", points, "fmu")),
            "vdfmu.sweep, engine batch": (batch, LANES, partial(_ours, folder / "study", batch, "batch")),
            "fmpy.simulate_fmu in a pool": (points, 1, partial(_fmpy, container, values)),
        }
        ways = [(way, workers) for workers in (1, 2) for way in given]
        spent: dict[tuple[str, int], list[tuple[float, float]]] = {way: [] for way in ways}
        for _ in range(rounds):
            for way, workers in ways:
                count, together, call = given[way]
                marks, processor = [], processor_time()
                call(stop, workers, lambda marks=marks: marks.append(time.perf_counter()))
                first = workers * together
                rate = (marks[-1] - marks[first - 1]) / (count - first)
                spent[way, workers].append((rate, (processor_time() - processor) / count))
    table = Table(
        "sweep_points",
        f"{points} points of {stop:g} s at 1 kHz, tracking",
        [("way", ""), ("workers", "d"), ("points/s", ".2f"), ("of one", ".2f"), ("processor [ms]", ".0f")],
        notes=["Points/s from the first point of each worker on; processor time of a point with the start. "
               f"Best of {rounds} rounds, in which the ways take turns."],
    )  # fmt: skip
    for (way, workers), rounds_ in spent.items():
        wall, processor = (min(one[k] for one in rounds_) for k in (0, 1))
        ratio = min(rate for rate, _ in spent[way, 1]) / wall
        table.add(way, workers, 1.0 / wall, ratio, 1e3 * processor)
        report.facts[f"{way}_{workers}"] = {
            "points_per_s": 1.0 / wall,
            "of_one": ratio,
            "processor_s": processor,
        }
    report.show(table)


def _ours(
    folder: Path, points: int, engine: str, stop: float, workers: int, done: Callable[[], None]
) -> None:
    """Run a study, anew."""
    shutil.rmtree(folder, ignore_errors=True)
    vdfmu.sweep(
        "tracking", {AXIS: f"*lin(0.5, 1.5, {points})"}, measure={"error": MEASURE}, stop=stop, workers=workers,
        engine=engine, out=folder, progress=lambda stage, k, total: done() if stage == "points" and k else None,
    )  # fmt: skip


def _fmpy(container: Path, values: Any, stop: float, workers: int, done: Callable[[], None]) -> None:
    """Run a container FMU as FMPy's example of a parameter variation does: unpacked once, an instance a process."""
    with multiprocessing.get_context("spawn").Pool(workers, _fmpy_begin, (str(container), stop)) as pool:
        for _ in pool.imap_unordered(_fmpy_point, values.tolist(), chunksize=1):
            done()


def _fmpy_begin(container: str, stop: float) -> None:
    folder = fmpy.extract(container)
    description = fmpy.read_model_description(folder)
    _fmu.update(
        {"filename": folder, "stop_time": stop, "model_description": description, "output_interval": STEP},
        fmu_instance=fmpy.instantiate_fmu(folder, description, "CoSimulation"),
        output=[f"{name}[{i}]" for name in ("trajectory.q_d", "plant.q") for i in range(1, 7)],
    )


def _fmpy_point(value: float) -> float:
    _fmu["fmu_instance"].reset()
    result: Any = fmpy.simulate_fmu(**_fmu, start_values={AXIS: value}, step_size=STEP)
    error = [result[f"trajectory.q_d[{i}]"] - result[f"plant.q[{i}]"] for i in range(1, 7)]
    return float(np.sqrt(np.mean(np.square(error))))


def _point(report: Report, folder: Path, stops: tuple[float, ...], points: int) -> None:
    """Say where the processor time of a point goes above the steps."""
    table = Table(
        "sweep_point",
        "Processor time of a point [ms]",
        [("stop [s]", "g"), ("point", ".1f"), ("of it steps", ".1f"), ("rest", ".1f"), ("rest [%]", ".1f")],
        notes=[
            "Steps: a long run less a short one. Rest: reset, values, initialization, table of the results, measures."
        ],
    )
    for stop in stops:
        spent = {stop: np.inf, 2.0 * stop: np.inf}
        benches = {
            length: _bench(folder / f"bench_{length:g}", _plan(points, length).job) for length in spent
        }
        try:
            for k in range(points):
                for length, bench in benches.items():
                    began = time.process_time()
                    bench.run([(k, 0, {AXIS: 1.0})])
                    spent[length] = min(spent[length], time.process_time() - began) if k else np.inf
        finally:
            for bench in benches.values():
                bench.close()
        steps = spent[2.0 * stop] - spent[stop]
        rest = spent[stop] - steps
        table.add(stop, *(1e3 * t for t in (spent[stop], steps, rest)), 100.0 * rest / spent[stop])
        report.facts[f"point_{stop:g}s"] = {"point_s": spent[stop], "steps_s": steps}
    report.show(table)


def _engines(report: Report, folder: Path, stop: float, rounds: int) -> None:
    """Compare the engines on one core: processor time of a point, with its measures; the ways take turns."""
    table = Table(
        "sweep_engines",
        f"Engines on one core, points of {stop:g} s at 1 kHz, tracking",
        [
            ("engine", ""),
            ("lanes", "d"),
            ("a point [ms]", ".1f"),
            ("points/s", ".1f"),
            ("of the FMUs", ".1f"),
        ],
        notes=[
            f"Processor time of a point with its measure, best of {rounds} rounds, in which the ways take turns."
        ],
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


def _growth(report: Report, folder: Path, runs: tuple[int, ...], rows: tuple[int, ...]) -> None:
    """Show that time and memory grow with the points, no more: runs of 1 s, and the files alone."""
    table = Table(
        "sweep_growth",
        "Growth with the points",
        [
            ("what", ""),
            ("points", "d"),
            ("processor [s]", ".1f"),
            ("ms a point", ".2f"),
            ("largest process [MB]", ".0f"),
        ],
        notes=[
            "The largest process is that of all so far. Files: chunks of 50 written, looked through, put together."
        ],
    )
    for points in runs:
        began = processor_time()
        vdfmu.sweep("tracking", {AXIS: f"*lin(0.5, 1.5, {points})"}, measure={"error": MEASURE}, stop=1.0,
                    out=folder / f"runs_{points}")  # fmt: skip
        spent = processor_time() - began
        table.add("runs of 1 s", points, spent, 1e3 * spent / points, _memory())
        report.facts[f"runs_{points}_s"] = spent
    for points in rows:
        began = processor_time()
        _files(folder / f"files_{points}", points)
        spent = processor_time() - began
        table.add("files alone", points, spent, 1e3 * spent / points, _memory())
        report.facts[f"files_{points}_s"] = spent
    report.show(table)


def _memory() -> float:
    return (
        max(resource.getrusage(who).ru_maxrss for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
        / 1024.0
    )


def _files(folder: Path, points: int, chunk: int = 50) -> None:
    """Keep rows of a study of so many values, as runs would leave them."""
    values = np.linspace(0.5, 1.5, points)
    axis = str(read_axes({AXIS: values})[0])
    facts = {
        "vdfmu": "0", "scenario": "s", "source": "s", "axes": [axis], "sample": "grid", "n": points, "seed": 0,
        "settings": {}, "options": {}, "systems": [], "measures": {"error": MEASURE}, "units": {"error": "rad"},
    }  # fmt: skip
    with Ledger(folder, facts, "key", {AXIS: values}) as ledger:
        for first in range(0, points, chunk):
            ledger.add([_row(k) for k in range(first, first + chunk)])
        assert ledger.done().all()
        table = vdfmu.Sweep(ledger.finish())
    assert len(table["error[1]"]) == points


def _row(point: int) -> Row:
    return {
        "point": point,
        "failed": None,
        "failed_at": None,
        "wall_s": 0.1,
        "error[1]": 1.0,
        "error[2]": 2.0,
    }


def _cluster(report: Report, folder: Path, sizes: tuple[int, ...], chunks: int) -> None:
    """Measure what Dask adds to a chunk: what the scheduler's process takes, and the time of a chunk of no work."""
    table = Table(
        "sweep_cluster",
        f"Dask on loopback, {chunks} chunks that take no time, two workers",
        [("points a chunk", "d"), ("ms a chunk", ".2f"), ("scheduler [ms]", ".2f"), ("client [ms]", ".2f"),
         ("chunks/s that a scheduler passes", ".0f")],
        notes=["Scheduler and client: processor time of their process over the chunks."],
    )  # fmt: skip
    from distributed import Client

    with _dask(folder) as (address, scheduler), Client(address, set_as_default=False) as client:
        client.wait_for_workers(2, timeout=60)
        job = client.scatter(b"x" * 1_000_000, broadcast=True, hash=False)
        for size in sizes:
            tasks = [(k, 0, {AXIS: 1.0}) for k in range(size)]
            took: list[float] = []
            for count in (10, chunks):  # the first ones import what they need
                began, own, theirs = time.perf_counter(), time.process_time(), _processor_of(scheduler.pid)
                futures = [client.submit(_no_work, job, tasks, pure=False) for _ in range(count)]
                for future in futures:
                    future.result()
                    future.release()
                took = [
                    time.perf_counter() - began,
                    _processor_of(scheduler.pid) - theirs,
                    time.process_time() - own,
                ]
            wall, theirs, own = (t / chunks for t in took)
            table.add(size, 1e3 * wall, 1e3 * theirs, 1e3 * own, 1.0 / theirs)
            report.facts[f"dask_{size}"] = {"chunk_s": wall, "scheduler_s": theirs, "client_s": own}
    report.show(table)


def _no_work(job: bytes, tasks: list[Any]) -> list[Row]:
    return [
        {"point": point, "failed": None, "failed_at": None, "wall_s": 0.1, "error[1]": 1.0}
        for point, *_ in tasks
    ]


def _processor_of(process: int) -> float:
    """Processor time of a process [s], to its tick of 10 ms."""
    fields = Path(f"/proc/{process}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


@contextmanager
def _dask(folder: Path) -> Generator[tuple[str, subprocess.Popen[bytes]]]:
    """Start a scheduler and two workers."""
    place = folder / "scheduler.json"

    def start(what: str, *words: str) -> subprocess.Popen[bytes]:
        return subprocess.Popen(
            [sys.executable, "-m", f"distributed.cli.dask_{what}", *words, "--scheduler-file", str(place),
             "--host", "127.0.0.1", "--no-dashboard"], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )  # fmt: skip

    scheduler = start("scheduler", "--port", "0")
    team = [scheduler]
    try:
        while not place.exists():
            time.sleep(0.1)
        team += [start("worker", "--nthreads", "1", "--no-nanny") for _ in range(2)]
        yield json.loads(place.read_bytes())["address"], scheduler
    finally:
        for process in team:
            process.kill()
            process.wait()
