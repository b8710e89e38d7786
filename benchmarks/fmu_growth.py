"""How building and stepping the FMUs grows with the number of joints, for chains without structural zeros."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
import zipfile
from importlib import import_module
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

from benchmarks.chains import random_motion, repeated_link
from benchmarks.engines import passive_spec, rigid_file
from benchmarks.report import Report, Table
from benchmarks.timing import Case, measure, processor_time
from benchmarks.work_precision import Fall
from vdfmu.arm.equations.plant import equilibrium_torque
from vdfmu.arm.fmus import build_fmus
from vdfmu.arm.robot import Robot
from vdfmu.base.cache import COMPILER, cache_folder

pin: Any = import_module("pinocchio")  # binary modules that no type checker sees into
mujoco: Any = import_module("mujoco")

TITLE = "Growth of the FMUs with the number of joints"
_UNITS = ("trajectory", "feedforward", "controller", "plant")
_JOINTS = (1, 2, 3, 6, 12, 24, 48, 96, 256)
_STEP = 1e-3


def run(report: Report, quick: bool = False) -> None:
    """Build all units in an empty cache, each number of joints in a separate process; time the plant."""
    table = Table(
        "fmu_growth", TITLE,
        [("n", "d"), ("build [s]", ".1f"), ("C [kB]", ".0f"), ("step [µs]", ".1f"),
         ("Pinocchio ABA derivatives [µs]", ".1f"), ("MuJoCo implicit step [µs]", ".1f")],
    )  # fmt: skip
    with tempfile.TemporaryDirectory() as folder:
        for n in [n for n in _JOINTS if n <= (6 if quick else _JOINTS[-1])]:
            report.say(f"n = {n}")
            plant, seconds, size = _child(n, Path(folder) / str(n))
            robot = repeated_link(n)
            table.add(n, seconds, size, _step_time(robot, plant), *_others(robot, 10 if quick else 40))
    high = [row for row in table.rows if row[0] >= 6]
    if len(high) > 2:
        n, *columns = np.log(np.array(high)).T
        for (heading, _), column in zip(table.columns[1:], columns, strict=True):
            slope = np.polyfit(n, column, 1)[0]
            table.notes.append(f"Exponent of {heading} for n = {high[0][0]} to {high[-1][0]}: {slope:.2f}.")
    report.show(table)


def _others(robot: Robot, rounds: int) -> list[float]:
    """Time of calls of rigid-body libraries from Python for the links of `robot`, each a call of compiled code [us].

    MuJoCo takes one step of its integrator `implicit`.
    """
    with rigid_file(robot) as path:
        model = pin.buildModelFromMJCF(path)
    data = model.createData()
    q, q_dot, tau = random_motion(robot.n)
    spec = passive_spec(robot)
    spec.option.timestep, spec.option.integrator = _STEP, mujoco.mjtIntegrator.mjINT_IMPLICIT
    rigid = spec.compile()
    state = mujoco.MjData(rigid)

    def step() -> None:
        state.qpos[:], state.qvel[:] = q, q_dot
        mujoco.mj_step(rigid, state)

    cases = [
        Case("Pinocchio ABA derivatives", lambda: pin.computeABADerivatives(model, data, q, q_dot, tau)),
        Case("MuJoCo implicit step", step),
    ]
    measure(cases, rounds, limit=1.0)
    return [1e6 * case.best for case in cases]


def _child(n: int, place: Path) -> Any:
    """Return what :func:`_built` gives in a separate process with an empty cache."""
    command = [sys.executable, "-m", "benchmarks.fmu_growth", str(n), str(place)]
    support = os.environ.get("ZIG_GLOBAL_CACHE_DIR", str(cache_folder() / COMPILER))
    variables = os.environ | {"ZIG_GLOBAL_CACHE_DIR": support, "VDFMU_CACHE_DIR": str(place / "cache")}
    return json.loads(subprocess.run(command, env=variables, check=True, stdout=subprocess.PIPE).stdout)


def _built(robot: Robot, place: Path) -> tuple[str, float, float]:
    """Return the plant's FMU, the processor time of a build [s] and the size of the generated C [kB]."""
    began = processor_time()
    fmus = build_fmus(robot, place, units=_UNITS, backend="native", folded=True)
    return str(fmus["plant"]), processor_time() - began, sum(map(_size_of_sources, fmus.values())) / 1e3


def _size_of_sources(fmu: Path) -> int:
    """Size of the generated C [bytes]."""
    with zipfile.ZipFile(fmu) as archive:
        return sum(
            file.file_size for file in archive.infolist() if Path(file.filename).name.startswith(("kernel_", "unit.c"))
        )


def _step_time(robot: Robot, fmu: str) -> float:
    """Median time of 200 steps of 1 ms of the plant at rest under the torque that holds it [us]."""
    plant = Fall(Path(fmu), robot.n, 0.0)
    held = equilibrium_torque(robot, np.zeros(robot.n)) / robot.ell
    torques = [plant.references[f"tau[{i + 1}]"] for i in range(robot.n)]
    plant.initialize(1e-7)
    plant.unit.setReal(torques, held.tolist())
    spent: list[float] = []
    for k in range(200):
        began = time.perf_counter()
        plant.unit.doStep(k * _STEP, _STEP)
        spent.append(time.perf_counter() - began)
    plant.close()
    return 1e6 * median(spent)


if __name__ == "__main__":
    print(json.dumps(_built(repeated_link(int(sys.argv[1])), Path(sys.argv[2]))))
