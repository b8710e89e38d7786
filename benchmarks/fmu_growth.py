"""How building and stepping the FMUs grows with the number of joints, for chains without structural zeros."""

from __future__ import annotations

import json
import math
import os
import resource
import subprocess
import sys
import tempfile
import time
import zipfile
from dataclasses import astuple, dataclass
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
from fmpy import extract, read_model_description
from fmpy.fmi2 import FMU2Slave
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, ScalarFormatter

from benchmarks.chains import random_motion, repeated_link
from benchmarks.engines import mujoco_spec
from benchmarks.report import Report, Table
from benchmarks.timing import Case, measure
from vdfmu.arm.equations.plant import equilibrium_torque
from vdfmu.arm.fmus import build_fmus
from vdfmu.arm.robot import Robot
from vdfmu.base import style
from vdfmu.base.cache import COMPILER, cache_folder

pin: Any = import_module("pinocchio")  # a binary module that no type checker sees into

TITLE = "Growth of the FMUs with the number of joints"
_UNITS = ("trajectory", "feedforward", "controller", "plant")
_JOINTS = (1, 2, 3, 6, 12, 24, 48, 96, 256)
_STEP = 1e-3


@dataclass
class _Row:
    """A cold build of all four FMUs, and one step of 1 ms of the plant beside rigid-body libraries."""

    n: int
    python_s: float
    compiler_s: float
    wall_s: float
    build_MB: float
    C_kB: float
    library_kB: float
    memory_MB: float
    step_us: float
    others_us: dict[str, float]


def pinocchio_model(robot: Robot) -> Any:
    """Model of the same rigid links in Pinocchio."""
    model = pin.Model()
    joint = 0
    for i in range(robot.n):
        kind = pin.JointModelPZ() if robot.joint_types[i] == "prismatic" else pin.JointModelRZ()
        placement = pin.SE3(np.array(robot.rotation[i]), np.array(robot.offset[i]))
        joint = model.addJoint(joint, kind, placement, f"joint_{i + 1}")
        body = pin.Inertia(float(robot.mass[i]), np.array(robot.centroid[i]), np.array(robot.inertia[i]))
        model.appendBodyToJoint(joint, body, pin.SE3.Identity())
    model.gravity.linear = -np.array(robot.gravity)  # Eq. (62) has g upward
    return model


def run(report: Report, quick: bool = False) -> None:
    """Build all units in an empty cache, each number of joints in a process of its own; time the plant."""
    rows: list[_Row] = []
    sizes = Table(
        "fmu_growth_memory", "Library on disk and memory of a process that it adds with one instance",
        [("n", "d")] + [(f"{unit} [{size}]", ".1f") for unit in _UNITS for size in ("MB on disk", "MB")],
    )  # fmt: skip
    with tempfile.TemporaryDirectory() as folder:
        for n in [n for n in _JOINTS if n <= (6 if quick else _JOINTS[-1])]:
            report.say(f"n = {n}")
            place = Path(folder) / str(n)
            built = _child({"VDFMU_CACHE_DIR": str(place / "cache")}, "build", n, place)
            ran = {unit: _child({}, "instance", n, built["fmus"][unit]) for unit in _UNITS}
            sizes.add(n, *(ran[unit][size] for unit in _UNITS for size in ("library_MB", "memory_MB")))
            rows.append(
                _Row(
                    n,
                    built["python_s"],
                    built["compiler_s"],
                    built["wall_s"],
                    built["memory_MB"],
                    built["C_kB"],
                    1e3 * sum(unit_run["library_MB"] for unit_run in ran.values()),
                    sum(unit_run["memory_MB"] for unit_run in ran.values()),
                    ran["plant"]["step_us"],
                    _others(repeated_link(n), 10 if quick else 40),
                )  # fmt: skip
            )
    engines = list(rows[0].others_us)
    table = Table(
        "fmu_growth", TITLE,
        [("n", "d"), ("Python [s]", ".1f"), ("compiler [s]", ".1f"), ("wall [s]", ".1f"), ("build [MB]", ".0f"),
         ("C [kB]", ".0f"), ("libraries [kB]", ".0f"), ("memory [MB]", ".1f"), ("step [µs]", ".1f"),
         *((f"{name} [µs]", ".1f") for name in engines)],
        [[*astuple(row)[:-1], *row.others_us.values()] for row in rows],
    )  # fmt: skip
    high = [row for row in rows if row.n >= 6]
    if len(high) > 2:
        measured = {"a step": [row.step_us for row in high]}
        measured |= {"a build": [row.python_s + row.compiler_s for row in high], "C": [row.C_kB for row in high]}
        measured |= {"memory of the build": [row.build_MB for row in high]}
        figure = {quantity: (y, _exponent(high, y)) for quantity, y in measured.items()}
        measured |= {name: [row.others_us[name] for row in high] for name in engines}
        for quantity, y in measured.items():
            slope = _exponent(high, y)
            table.notes.append(f"Exponent of {quantity} for n = {high[0].n} to {high[-1].n}: {slope:.2f}.")
        _draw([row.n for row in high], figure, report.out / "fmu_growth.svg")
    report.show(table)
    report.show(sizes)
    report.facts["rows"] = [[*astuple(row)[:-1], row.others_us] for row in rows]


def _exponent(rows: list[_Row], y: list[float]) -> float:
    return float(np.polyfit(np.log([row.n for row in rows]), np.log(y), 1)[0])


@style.styled
def _draw(n: list[int], measured: dict[str, tuple[list[float], float]], path: Path) -> Figure:
    """Draw what grows with the joints on logarithmic axes, each with its fitted slope; write and return it."""
    units = {"a step": "µs", "a build": "s of processor time", "C": "kB", "memory of the build": "MB"}
    figure = style.new_figure("Growth with the joints", "Logarithmic axes; dashed: the fitted power.", height=5.8)
    panels = figure.subplots(2, 2)
    for axes, (quantity, (y, slope)) in zip(panels.flat, measured.items(), strict=True):
        axes.loglog(n, y, "o", base=10, color=style.COLORS[0])
        middle = np.exp(np.mean(np.log(y)) + slope * (np.log(n) - np.mean(np.log(n))))
        axes.loglog(n, middle, "--", color="0.4", label=f"n^{slope:.2f}")
        axes.set_title(quantity[0].upper() + quantity[1:])
        axes.set_ylabel(f"[{units[quantity]}]")
        axes.set_xticks(n, map(str, n))
        axes.minorticks_off()
        middle_of_axis = math.sqrt(min(y) * max(y))
        axes.set_ylim(min(min(y) / 1.5, middle_of_axis / 4.0), max(1.5 * max(y), middle_of_axis * 4.0))
        axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axes.yaxis.set_major_formatter(ScalarFormatter())
        axes.legend()
    style.label_time(panels.ravel().tolist(), 2)
    for axes in panels[1]:
        axes.set_xlabel("Joints")
    style.save(figure, path)
    return figure


def _others(robot: Robot, rounds: int) -> dict[str, float]:
    """Time of calls of rigid-body libraries from Python for the links of `robot`, each a call of compiled code [us]."""
    model = pinocchio_model(robot)
    data = model.createData()
    q, q_dot, tau = random_motion(robot.n)
    cases = [
        Case("Pinocchio aba", lambda: pin.aba(model, data, q, q_dot, tau)),
        Case("Pinocchio ABA derivatives", lambda: pin.computeABADerivatives(model, data, q, q_dot, tau)),
    ]
    if find_spec("mujoco") is not None:
        cases.append(_mujoco(robot, q, q_dot))
    measure(cases, rounds, limit=1.0)
    return {case.name: 1e6 * case.best for case in cases}


def _mujoco(robot: Robot, q: np.ndarray, q_dot: np.ndarray) -> Case:
    """One step of MuJoCo's integrator `implicit` from a state of the same rigid links."""
    mujoco: Any = import_module("mujoco")
    model = mujoco_spec(robot).compile()
    model.opt.timestep, model.opt.integrator = _STEP, mujoco.mjtIntegrator.mjINT_IMPLICIT
    data = mujoco.MjData(model)

    def step() -> None:
        data.qpos[:], data.qvel[:] = q, q_dot
        mujoco.mj_step(model, data)

    return Case("MuJoCo implicit step", step, data)


def _child(environment: dict[str, str], *arguments: object) -> Any:
    """Return what :func:`_main` prints in a process of its own."""
    command = [sys.executable, "-m", "benchmarks.fmu_growth", *map(str, arguments)]
    support = os.environ.get("ZIG_GLOBAL_CACHE_DIR", str(cache_folder() / COMPILER))
    variables = os.environ | {"ZIG_GLOBAL_CACHE_DIR": support} | environment
    return json.loads(subprocess.run(command, env=variables, check=True, stdout=subprocess.PIPE).stdout)


def _main(task: str, n: int, place: str) -> dict[str, Any]:
    return _built(repeated_link(n), Path(place)) if task == "build" else _ran(repeated_link(n), place)


def _built(robot: Robot, place: Path) -> dict[str, Any]:
    began, wall = os.times(), time.perf_counter()
    fmus = build_fmus(robot, place, units=_UNITS, backend="native", folded=True)
    ended = os.times()
    return {
        "fmus": {name: str(path) for name, path in fmus.items()},
        "python_s": ended.user + ended.system - began.user - began.system,
        "compiler_s": ended.children_user + ended.children_system - began.children_user - began.children_system,
        "wall_s": time.perf_counter() - wall,
        "memory_MB": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3,
        "C_kB": sum(map(_size_of_sources, fmus.values())) / 1e3,
    }


def _size_of_sources(fmu: Path) -> int:
    """Size of the generated C [bytes]."""
    with zipfile.ZipFile(fmu) as archive:
        return sum(
            file.file_size for file in archive.infolist() if Path(file.filename).name.startswith(("kernel_", "unit.c"))
        )


def _ran(robot: Robot, fmu: str) -> dict[str, Any]:
    """Run one instance for 0.2 s in steps of 1 ms, the plant at rest under the torque that holds it."""
    description: Any = read_model_description(fmu)
    with tempfile.TemporaryDirectory() as folder:
        extract(fmu, folder)
        (library,) = Path(folder, "binaries").glob("*/*.*")
        size = library.stat().st_size / 1e6
        before = _memory()
        instance = FMU2Slave(
            guid=description.guid, unzipDirectory=folder, instanceName="unit",
            modelIdentifier=description.coSimulation.modelIdentifier,
        )  # fmt: skip
        instance.instantiate()
        instance.setupExperiment(startTime=0.0)
        instance.enterInitializationMode()
        torques = {v.name: v.valueReference for v in description.modelVariables if v.causality == "input"}
        held = equilibrium_torque(robot, np.zeros(robot.n)) / robot.ell
        for i, value in enumerate(held, 1):
            if description.modelName.startswith("Plant"):
                instance.setReal([torques[f"tau[{i}]"]], [value])
        instance.exitInitializationMode()
        spent: list[float] = []
        for k in range(200):
            began = time.perf_counter()
            instance.doStep(k * _STEP, _STEP)
            spent.append(time.perf_counter() - began)
        memory = _memory() - before
        instance.terminate()
        instance.freeInstance()
    return {"library_MB": size, "memory_MB": memory, "step_us": 1e6 * median(spent)}


def _memory() -> float:
    """Memory of the process [MB]: what it holds on Linux, the most that it had elsewhere."""
    held = Path("/proc/self/statm")
    if held.exists():
        return int(held.read_text().split()[1]) * resource.getpagesize() / 1e6
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3


if __name__ == "__main__":
    print(json.dumps(_main(sys.argv[1], int(sys.argv[2]), sys.argv[3])))
