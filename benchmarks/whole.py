"""What whole commands and calls take, against the co-simulation inside them."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import fmpy

import vdfmu
from benchmarks.report import Report, Table
from benchmarks.timing import Case, measure, processor_time

TITLE = "Whole commands and calls"


def run(report: Report, quick: bool = False) -> None:
    """Measure and tabulate."""
    with tempfile.TemporaryDirectory(prefix="vdfmu-bench-") as folder:
        _commands(report, Path(folder), "planar_tracking" if quick else "tracking", 1 if quick else 3)
        if not quick:
            _first_runs(report, Path(folder))
    _short(report, 3 if quick else 30)


BYTECODE = tempfile.TemporaryDirectory(prefix="vdfmu-bench-")
"""Folder of the modules that Python keeps compiled, as it does for users. The first command fills it."""


def command(*arguments: str, cache: str = "") -> float:
    """Run a command and return the processor time [s] of it and of what it starts. `cache` is another cache."""
    environment = {**os.environ, "PYTHONPYCACHEPREFIX": BYTECODE.name}
    environment.pop("PYTHONDONTWRITEBYTECODE", None)
    began = processor_time()
    code = "import vdfmu.cli; vdfmu.cli.main()"
    caches = {"VDFMU_CACHE_DIR": f"{cache}/vdfmu", "ZIG_GLOBAL_CACHE_DIR": f"{cache}/zig"} if cache else {}
    words = [sys.executable, "-c", code, *arguments]
    subprocess.run(words, check=True, capture_output=True, timeout=900, env=environment | caches)
    return processor_time() - began


def _least(report: Report, title: str, jobs: Mapping[str, Callable[[], float]], rounds: int) -> None:
    """Show the least processor time of each job; the jobs take turns."""
    best = dict.fromkeys(jobs, float("inf"))
    for name in [*jobs] * rounds:
        best[name] = min(best[name], jobs[name]())
    columns = [("command", ""), ("time [s]", ".2f")]
    report.show(Table("commands", f"Processor time of {title}", columns, [[*row] for row in best.items()]))


def _first_runs(report: Report, folder: Path) -> None:
    """Processor time of first runs: without FMUs, objects, references and margins in the cache."""
    urdf, robot, out = (str(folder / name) for name in ("arm.urdf", "arm.toml", "first"))
    command("robot", "export", "manipulator_6dof", "--to", "urdf", "--out", urdf)

    def first(*commands: Sequence[str]) -> float:
        Path(robot).unlink(missing_ok=True)
        with tempfile.TemporaryDirectory(prefix="vdfmu-bench-") as cache:
            return sum(command(*each, cache=cache) for each in commands)

    imported = ["robot", "import", urdf, "--out", robot]
    jobs = {
        "vdfmu run tracking": partial(first, ["run", "tracking", "--out", out]),
        "vdfmu run reach --robot snake_24dof": partial(first, ["run", "reach", "--robot", "snake_24dof", "--out", out]),
        "vdfmu robot import arm.urdf, vdfmu run reach": partial(
            first, imported, ["run", "reach", "--robot", robot, "--out", out]
        ),
    }
    _least(report, "first runs, empty cache", jobs, 2)


def _commands(report: Report, folder: Path, scenario: str, rounds: int) -> None:
    """Processor time of commands whose FMUs are built."""
    fmus, done, out = (str(folder / name) for name in ("fmus", "run", "again"))
    command("build", scenario, "--out", fmus)
    command("run", scenario, "--out", done)

    def solved() -> float:
        new = f"controller.K_p[1]={1000.0 + time.time() % 1000.0!r}"  # no solution of it is kept
        return command("run", scenario, "--out", out, "--set", new)

    jobs: dict[str, Callable[[], float]] = {
        "vdfmu run, references kept": partial(command, "run", scenario, "--out", out),
        "vdfmu run, references solved": solved,
        "vdfmu run system.ssp": partial(command, "run", f"{done}/system.ssp", "--out", out),
        "vdfmu --help": partial(command, "--help"),
        "vdfmu check Plant.fmu": partial(command, "check", f"{fmus}/Plant.fmu"),
    }
    if scenario == "tracking":
        command("run", "two_joint", "--out", out)
        jobs["vdfmu run two_joint, references kept"] = partial(command, "run", "two_joint", "--out", out)
    _least(report, f"commands, {scenario}", jobs, rounds)


def _short(report: Report, rounds: int) -> None:
    """Compare many runs of one FMU, and steps by hand, with FMPy's runs of an instance that stays loaded."""
    step, long = 1e-3, 10_000
    with tempfile.TemporaryDirectory(prefix="vdfmu-bench-") as folder:
        fmu = vdfmu.build(Path(__file__).parents[1] / "examples" / "units" / "low_pass.py", Path(folder, "filter.fmu"))
        short, system = vdfmu.load(fmu), vdfmu.load(fmu)
        description, unpacked = fmpy.read_model_description(str(fmu)), fmpy.extract(str(fmu))
        instance: Any = fmpy.instantiate_fmu(unpacked, description, "CoSimulation")

        def ours(system: vdfmu.System, steps: int) -> None:
            system.run(stop=steps * step, step=step, parameters={"filter.T": 0.05})

        def theirs(steps: int) -> None:
            instance.reset()
            fmpy.simulate_fmu(
                unpacked, start_values={"T": 0.05}, stop_time=steps * step, output_interval=step, step_size=step,
                fmi_type="CoSimulation", model_description=description, fmu_instance=instance,
            )  # fmt: skip

        with system.instance() as simulator:

            def by_hand() -> None:
                simulator.reset(stop=long * step, step=step, parameters={"filter.T": 0.05})
                for _ in range(long):
                    simulator.step()

            cases = [
                Case("system.run, 10 steps", lambda: ours(short, 10)),
                Case("fmpy.simulate_fmu, 10 steps", lambda: theirs(10)),
                Case("system.run, 10,000 steps", lambda: ours(system, long)),
                Case("fmpy.simulate_fmu, 10,000 steps", lambda: theirs(long)),
                Case("simulator.step, 10,000 times", by_hand),
            ]
            for case in cases:
                case.run()  # loads and plans
            measure(cases, rounds, batch=2e-2)
        instance.freeInstance()
    table = Table(
        "runs", "Runs of a low-pass filter, instances kept",
        [("call", ""), ("a run [us]", ".1f"), ("a step [us]", ".3f"), ("over fmpy", ".2f")],
    )  # fmt: skip
    for case, steps, other in zip(cases, (10, 10, long, long, long), (1, 1, 3, 3, 3), strict=True):
        table.add(case.name, 1e6 * case.best, 1e6 * case.best / steps, case.best / cases[other].best)
    report.show(table)
