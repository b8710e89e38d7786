"""What whole commands and calls take, against the co-simulation inside them."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import fmpy

import vdfmu
from benchmarks.report import Report, Table
from benchmarks.timing import Case, measure

TITLE = "Whole commands and calls"


def run(report: Report, quick: bool = False) -> None:
    """Measure and tabulate."""
    with tempfile.TemporaryDirectory(prefix="vdfmu-bench-") as folder:
        _commands(report, Path(folder), "planar_tracking" if quick else "tracking", 1 if quick else 3)
        if not quick:
            _first_runs(report, Path(folder), 2)
    _short(report, 3 if quick else 30)


BYTECODE = tempfile.TemporaryDirectory(prefix="vdfmu-bench-")
"""Folder of the modules that Python keeps compiled, as it does for users. The first command fills it."""


def command(*arguments: str, cache: str = "") -> float:
    """Run a command and return the processor time [s] of it and of what it starts. `cache` is another cache."""
    environment = {**os.environ, "PYTHONPYCACHEPREFIX": BYTECODE.name}
    environment.pop("PYTHONDONTWRITEBYTECODE", None)
    before = os.times()
    code = "import vdfmu.cli; vdfmu.cli.main()"
    caches = {"VDFMU_CACHE_DIR": f"{cache}/vdfmu", "ZIG_GLOBAL_CACHE_DIR": f"{cache}/zig"} if cache else {}
    words = [sys.executable, "-c", code, *arguments]
    subprocess.run(words, check=True, capture_output=True, timeout=900, env=environment | caches)
    after = os.times()
    return after.children_user + after.children_system - before.children_user - before.children_system


def _first_runs(report: Report, folder: Path, rounds: int) -> None:
    """Processor time of first runs: without FMUs, objects, references and margins in the cache."""
    urdf, robot, out = (str(folder / name) for name in ("arm.urdf", "arm.toml", "first"))
    command("robot", "export", "manipulator_6dof", "--to", "urdf", "--out", urdf)
    jobs = {
        "vdfmu run tracking": [["run", "tracking", "--out", out]],
        "vdfmu run reach --robot snake_24dof": [["run", "reach", "--robot", "snake_24dof", "--out", out]],
        "vdfmu robot import arm.urdf, vdfmu run reach": [
            ["robot", "import", urdf, "--out", robot], ["run", "reach", "--robot", robot, "--out", out],
        ],
    }  # fmt: skip
    best = dict.fromkeys(jobs, float("inf"))
    for name in [*jobs] * rounds:
        with tempfile.TemporaryDirectory(prefix="vdfmu-bench-") as cache:
            best[name] = min(best[name], sum(command(*each, cache=cache) for each in jobs[name]))
        Path(robot).unlink(missing_ok=True)
    table = Table("first_runs", "Processor time of first runs, empty cache", [("command", ""), ("time [s]", ".1f")])
    for name, seconds in best.items():
        table.add(name, seconds)
    report.show(table)


def _commands(report: Report, folder: Path, scenario: str, rounds: int) -> None:
    """Processor time of commands whose FMUs are built."""
    command("build", scenario, "--out", str(folder / "fmus"))
    command("run", scenario, "--out", str(folder / "run"))

    def new() -> list[str]:
        return ["--set", f"controller.K_p[1]={1000.0 + time.time() % 1000.0!r}"]  # no solution of it is kept

    commands: dict[str, Callable[[], list[str]]] = {
        "vdfmu run, references kept": lambda: ["run", scenario],
        "vdfmu run, references solved": lambda: ["run", scenario, *new()],
        "vdfmu run system.ssp": lambda: ["run", str(folder / "run" / "system.ssp")],
        "vdfmu --help": lambda: ["--help"],
        "vdfmu check Plant.fmu": lambda: ["check", str(folder / "fmus" / "Plant.fmu")],
    }
    if scenario == "tracking":
        command("run", "two_joint", "--out", str(folder / "run two_joint"))
        commands["vdfmu run two_joint, references kept"] = lambda: ["run", "two_joint"]
    best = dict.fromkeys(commands, float("inf"))
    for _ in range(rounds):
        for k, (name, arguments) in enumerate(commands.items()):
            words = arguments()
            out = ["--out", str(folder / str(k))] if words[0] == "run" else []
            best[name] = min(best[name], command(*words, *out))
    table = Table("commands", f"Processor time of commands, {scenario}", [("command", ""), ("time [s]", ".2f")])
    for name, seconds in best.items():
        table.add(name, seconds)
    report.show(table)


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
