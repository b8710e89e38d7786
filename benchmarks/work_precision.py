"""Work and precision of the plant's solver, and of CVODE on the same generated equations."""

from __future__ import annotations

import math
import shutil
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from fmpy import extract, instantiate_fmu, read_model_description
from fmpy.sundials import CVodeSolver

from benchmarks.report import Report, Table
from benchmarks.timing import Case, measure
from vdfmu.arm.fmus import build_fmus
from vdfmu.arm.robot import Robot, load_robot

TITLE = "Work and precision: the plant alone"
COSIM, CVODE = "FMU, co-simulation", "FMU, model exchange, CVODE"
INTERVAL = 0.01
"""Time between two compared states [s]; all solvers make many steps in it."""
_REFERENCE_TOLERANCE = 1e-12
_ERRORS = (1e-4, 1e-5, 1e-6, 1e-7, 1e-8)
"""Errors at which the times are compared [rad]."""
Motion = Callable[[float], np.ndarray]
"""Positions at the compared times, (m, n) [rad], at a level of precision."""


@dataclass
class Point:
    """One method at one tolerance, accuracy or step [s]."""

    method: str
    level: float
    time: float = math.inf
    """Processor time of the whole motion [s], least of the rounds."""
    error: float = math.inf
    """Largest error of a position [rad] over all joints and compared times."""


@dataclass
class WorkPrecision:
    """All points."""

    points: list[Point]

    @property
    def check(self) -> float:
        """Least difference of the reference to another method [rad]."""
        return min((p.error for p in self.points if p.method != COSIM), default=math.nan)

    def of(self, method: str) -> list[Point]:
        """Points of a method, the least precise first."""
        return [p for p in self.points if p.method == method]

    def time_at(self, method: str, error: float) -> float | None:
        """Time of a method at an error [s], between its points; None outside of them."""
        points = sorted((p.error, p.time) for p in self.of(method))
        if not points or not points[0][0] <= error <= points[-1][0]:
            return None
        x, y = np.log([[a, b] for a, b in points]).T
        return float(np.exp(np.interp(math.log(error), x, y)))


def run(report: Report, quick: bool = False) -> None:
    """Measure and tabulate."""
    tolerances = [10.0**-k for k in ((4, 6, 8) if quick else range(4, 10))]
    robot, stop = load_robot("manipulator_6dof"), 0.05 if quick else 0.5
    tabulate(study(robot, stop, tolerances, 1 if quick else 3), report, f"{robot.name}, {stop:g} s of free fall")


def study(robot: Robot, stop: float, tolerances: Sequence[float], rounds: int) -> WorkPrecision:
    """Solve the motion with both methods at every tolerance, in turns.

    The motion: the arm starts at rest in equilibrium with gravity, its motors free, and falls against drives
    and friction. Nothing in it is discontinuous, and no input changes, so that no solver has to restart.
    """
    with tempfile.TemporaryDirectory(prefix="vdfmu-bench-") as name:
        fmu = build_fmus(robot, Path(name), units=["plant"], backend="native", folded=True)["plant"]
        cosim, exchange = Fall(fmu, robot.n, stop), Fall(fmu, robot.n, stop, "ModelExchange")
        precision = compare({COSIM: (cosim.own_solver, tolerances), CVODE: (exchange.cvode, tolerances)}, rounds)
        cosim.close()
        exchange.close()
    return precision


def compare(methods: Mapping[str, tuple[Motion, Sequence[float]]], rounds: int) -> WorkPrecision:
    """Solve a motion with methods at their levels of precision, in turns; the first one's at 1e-12 is the reference."""
    reference = methods[COSIM][0](_REFERENCE_TOLERANCE)
    points = [Point(method, level) for method, (_, levels) in methods.items() for level in levels]

    def solve(point: Point) -> None:
        point.error = float(np.max(np.abs(methods[point.method][0](point.level) - reference)))

    cases = [Case(point.method, partial(solve, point)) for point in points]
    measure(cases, rounds, batch=0.0, limit=2.0 * rounds)
    for point, case in zip(points, cases, strict=True):
        point.time = case.best
    return WorkPrecision(points)


class _Nothing:
    """Input of the solver of fmpy: there is none."""

    def apply(self, time: float) -> None: ...


class Fall:
    """The plant's FMU unpacked, and its motion at the compared times."""

    def __init__(self, fmu: Path, n: int, stop: float, kind: str = "CoSimulation") -> None:
        self.times = np.linspace(0.0, stop, round(stop / INTERVAL) + 1).tolist()
        description = read_model_description(str(fmu))
        self.references = {v.name: v.valueReference for v in description.modelVariables or ()}
        self._q = [self.references[f"q[{i + 1}]"] for i in range(n)]
        self._folder = extract(str(fmu))
        self.nx = description.numberOfContinuousStates
        self.unit: Any = instantiate_fmu(self._folder, description, kind)

    def initialize(self, tolerance: float) -> None:
        """Start anew."""
        self.unit.reset()
        self.unit.setReal([self.references["tolerance"]], [tolerance])  # the loosest of the two
        self.unit.setupExperiment(startTime=0.0, tolerance=tolerance)
        self.unit.enterInitializationMode()
        self.unit.exitInitializationMode()

    def own_solver(self, tolerance: float) -> np.ndarray:
        """Return the positions by the FMU's own solver."""
        self.initialize(tolerance)
        return self._rows(lambda t, end: self.unit.doStep(t, end - t))

    def cvode(self, tolerance: float) -> np.ndarray:
        """Return the positions by fmpy's CVODE, which approximates the Jacobian by differences."""
        unit = self.unit
        self.initialize(tolerance)
        unit.newDiscreteStates()
        unit.enterContinuousTimeMode()
        solver = CVodeSolver(
            nx=self.nx, nz=0, get_x=unit.getContinuousStates, set_x=unit.setContinuousStates,
            get_dx=unit.getDerivatives, get_z=unit.getEventIndicators,
            get_nominals=unit.getNominalsOfContinuousStates, set_time=unit.setTime, input=_Nothing(),
            startTime=0.0, relativeTolerance=tolerance, maxNumSteps=10_000_000,
        )  # fmt: skip

        def advance(t: float, end: float) -> None:
            solver.step(t, end)
            unit.setTime(end)

        return self._rows(advance)

    def _rows(self, advance: Callable[[float, float], Any]) -> np.ndarray:
        rows = [self.unit.getReal(self._q)]
        for t, end in pairwise(self.times):
            advance(t, end)
            rows.append(self.unit.getReal(self._q))
        return np.array(rows)

    def close(self) -> None:
        """Free the instance."""
        self.unit.terminate()
        self.unit.freeInstance()
        shutil.rmtree(self._folder, ignore_errors=True)


def tabulate(precision: WorkPrecision, report: Report, title: str) -> None:
    """Show and keep the times at equal errors."""
    methods = list(dict.fromkeys(p.method for p in precision.points))
    table = Table(
        report.name, f"{title}: time at equal error [ms], between the measured points",
        [("error [rad]", ".0e"), *[(m, ".2f") for m in methods], *[(f"{m} over FMU", ".1f") for m in methods[1:]]],
        notes=[f"Error: largest of all positions at times {INTERVAL * 1e3:g} ms apart, to the FMU's co-simulation at "
               f"{_REFERENCE_TOLERANCE:g}, to which others come as close as {precision.check:.1e} rad.",
               "Time: least processor time of the whole motion, all in turns, of steps in compiled code."],
    )  # fmt: skip
    for error in _ERRORS:
        ours, *rivals = times = [precision.time_at(method, error) for method in methods]
        ratios = [t / ours if t and ours else None for t in rivals]
        table.add(error, *[None if t is None else 1e3 * t for t in times], *ratios)
    report.show(table)
