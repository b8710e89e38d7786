"""How building and stepping the FMUs grows with the number of joints, for chains without structural zeros."""

from __future__ import annotations

import json
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

from benchmarks.chains import random_motion, repeated_link
from benchmarks.engines import mujoco_spec
from benchmarks.report import Report, Table
from benchmarks.timing import Case, measure, processor_time
from benchmarks.work_precision import CoSimulation
from vdfmu.arm.equations.plant import equilibrium_torque
from vdfmu.arm.fmus import build_fmus
from vdfmu.arm.robot import Robot
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
    build_s: float
    build_MB: float
    C_kB: float
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
    """Build all units in an empty cache, each number of joints in a separate process; time the plant."""
    rows: list[_Row] = []
    with tempfile.TemporaryDirectory() as folder:
        for n in [n for n in _JOINTS if n <= (6 if quick else _JOINTS[-1])]:
            report.say(f"n = {n}")
            place = Path(folder) / str(n)
            built = _child(n, place)
            step_us = _step_time(repeated_link(n), built.pop("plant"))
            rows.append(_Row(n, **built, step_us=step_us, others_us=_others(repeated_link(n), 10 if quick else 40)))
    engines = list(rows[0].others_us)
    table = Table(
        "fmu_growth", TITLE,
        [("n", "d"), ("build [s]", ".1f"), ("build [MB]", ".0f"), ("C [kB]", ".0f"), ("step [µs]", ".1f"),
         *((f"{name} [µs]", ".1f") for name in engines)],
        [[*astuple(row)[:-1], *row.others_us.values()] for row in rows],
    )  # fmt: skip
    high = [row for row in rows if row.n >= 6]
    if len(high) > 2:
        measured = {"a step": [row.step_us for row in high]}
        measured |= {"a build": [row.build_s for row in high], "C": [row.C_kB for row in high]}
        measured |= {"memory of the build": [row.build_MB for row in high]}
        measured |= {name: [row.others_us[name] for row in high] for name in engines}
        for quantity, y in measured.items():
            slope = _exponent(high, y)
            table.notes.append(f"Exponent of {quantity} for n = {high[0].n} to {high[-1].n}: {slope:.2f}.")
    report.show(table)


def _exponent(rows: list[_Row], y: list[float]) -> float:
    return float(np.polyfit(np.log([row.n for row in rows]), np.log(y), 1)[0])


def _others(robot: Robot, rounds: int) -> dict[str, float]:
    """Time of calls of rigid-body libraries from Python for the links of `robot`, each a call of compiled code [us]."""
    model = pinocchio_model(robot)
    data = model.createData()
    q, q_dot, tau = random_motion(robot.n)
    cases = [Case("Pinocchio ABA derivatives", lambda: pin.computeABADerivatives(model, data, q, q_dot, tau))]
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


def _child(n: int, place: Path) -> Any:
    """Return what :func:`_built` gives in a separate process with an empty cache."""
    command = [sys.executable, "-m", "benchmarks.fmu_growth", str(n), str(place)]
    support = os.environ.get("ZIG_GLOBAL_CACHE_DIR", str(cache_folder() / COMPILER))
    variables = os.environ | {"ZIG_GLOBAL_CACHE_DIR": support, "VDFMU_CACHE_DIR": str(place / "cache")}
    return json.loads(subprocess.run(command, env=variables, check=True, stdout=subprocess.PIPE).stdout)


def _built(robot: Robot, place: Path) -> dict[str, Any]:
    began = processor_time()
    fmus = build_fmus(robot, place, units=_UNITS, backend="native", folded=True)
    return {
        "plant": str(fmus["plant"]),
        "build_s": processor_time() - began,
        "build_MB": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3,
        "C_kB": sum(map(_size_of_sources, fmus.values())) / 1e3,
    }


def _size_of_sources(fmu: Path) -> int:
    """Size of the generated C [bytes]."""
    with zipfile.ZipFile(fmu) as archive:
        return sum(
            file.file_size for file in archive.infolist() if Path(file.filename).name.startswith(("kernel_", "unit.c"))
        )


def _step_time(robot: Robot, fmu: str) -> float:
    """Median time of 200 steps of 1 ms of the plant at rest under the torque that holds it [us]."""
    times = np.arange(201) * _STEP
    plant = CoSimulation(Path(fmu), times, robot.n)
    held = equilibrium_torque(robot, np.zeros(robot.n)) / robot.ell
    torques = [plant.references[f"tau[{i + 1}]"] for i in range(robot.n)]
    plant.initialize(1e-7)
    plant.unit.setReal(torques, held.tolist())
    spent: list[float] = []
    for time_of_step in times[:-1].tolist():
        began = time.perf_counter()
        plant.unit.doStep(time_of_step, _STEP)
        spent.append(time.perf_counter() - began)
    plant.close()
    return 1e6 * median(spent)


if __name__ == "__main__":
    print(json.dumps(_built(repeated_link(int(sys.argv[1])), Path(sys.argv[2]))))
