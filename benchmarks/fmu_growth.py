"""How building and stepping the FMUs grows with the number of joints, for chains without structural zeros."""

from __future__ import annotations

import os
import tempfile
import time
from dataclasses import astuple, dataclass
from pathlib import Path

import numpy as np

from benchmarks.chains import random_motion, repeated_link
from benchmarks.compiled import CompiledFunction, write_library
from benchmarks.fit import fit_exponent
from benchmarks.report import Report, Table
from benchmarks.timing import Case, measure
from vdfmu.equations.plant import equilibrium_torque
from vdfmu.fmu.native.generate import kernel_source
from vdfmu.kernel.structure import values
from vdfmu.unit.program import Program, UnitFunctions
from vdfmu.units import find_unit

__all__ = ["run"]

TITLE = "Growth of the FMUs with the number of joints"
_UNITS = ("trajectory", "feedforward", "controller", "plant")
_JOINTS = (1, 2, 3, 6, 9, 12, 16, 24, 32, 48, 64)


@dataclass
class _Row:
    """Processor times, sizes, and the time of one step of the plant's solver."""

    n: int
    trace_s: float
    operations: int
    text_MB: float
    step_operations: int
    compile_step_s: float
    step_library_kB: float
    step_us: float = 0.0


def run(report: Report, quick: bool = False) -> None:
    """Trace all units and write their C; compile the plant's step and time it."""
    rows: list[_Row] = []
    cases: list[Case] = []
    with tempfile.TemporaryDirectory() as folder:
        for n in [n for n in _JOINTS if n <= (6 if quick else 64)]:
            report.say(f"n = {n}")
            row, case = _measured(n, Path(folder) / str(n))
            rows.append(row)
            cases.append(case)
        measure(cases, 10 if quick else 40, limit=1.0)
    for row, case in zip(rows, cases, strict=True):
        row.step_us = 1e6 * case.best
    table = Table(
        "fmu_growth", TITLE,
        [("n", "d"), ("trace [s]", ".1f"), ("operations", "d"), ("C text [MB]", ".1f"), ("of a step", "d"),
         ("compile step [s]", ".1f"), ("its library [kB]", ".0f"), ("step [µs]", ".1f")],
        [list(astuple(row)) for row in rows],
    )  # fmt: skip
    high = [row for row in rows if row.n >= 6]
    if len(high) > 2:
        for what, y in (
            ("operations", [r.step_operations for r in high]),
            ("time", [r.step_us for r in high]),
        ):
            fit = fit_exponent([r.n for r in high], [float(v) for v in y])
            table.notes.append(
                f"Exponent of a step's {what} for n = {high[0].n} to {high[-1].n}: {fit.slope:.2f}."
            )
    report.show(table)
    report.facts["rows"] = [astuple(row) for row in rows]


def _measured(n: int, folder: Path) -> tuple[_Row, Case]:
    robot = repeated_link(n)
    began = time.process_time()
    operations = size = 0
    for unit in map(find_unit, _UNITS):
        functions = UnitFunctions(unit, robot if unit.needs_robot() else None, None)
        program = Program(functions)
        names = [c.function for c in (*program.update, *program.step)]
        for call in (*program.start, *program.outputs, *program.derivatives):
            names += [f"{call.function}{ending}" for ending in ("", "_forward", "_reverse")]
        for name in names:
            function = functions.casadi_function(name)
            operations += function.n_instructions()
            size += len(kernel_source(function))
    traced = time.process_time() - began
    plant = UnitFunctions(find_unit("plant"), robot, None)
    folder.mkdir()
    before = os.times()
    library = write_library(plant, ["plant_step"], folder)
    after = os.times()
    step = CompiledFunction(library, plant, "plant_step")
    q, q_dot, _ = random_motion(n)
    tau_s = equilibrium_torque(robot, q)
    state = {"x": np.concatenate([q, 0.01 * q_dot, 0.01 * q_dot, tau_s]), "tau": tau_s / robot.ell}
    for name, value in (state | {"p": values(robot), "h": 1e-4, "tolerance": 1e-7}).items():
        step.args[name][:] = value
    step.run()
    assert np.isfinite(step.results["x_new"]).all()
    row = _Row(
        n, traced, operations, size / 1e6, plant.casadi_function("plant_step").n_instructions(),
        after.children_user - before.children_user, library.stat().st_size / 1e3,
    )  # fmt: skip
    return row, Case(f"step {n}", step.run, step)
