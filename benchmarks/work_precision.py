"""Work and precision of the plant's solver against CVODE and scipy's, all on the same generated equations."""

from __future__ import annotations

import ctypes
import math
import shutil
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Generic, TypeVar

import numpy as np
from fmpy import extract, read_model_description
from fmpy.fmi2 import FMU2Model, FMU2Slave
from fmpy.sundials import CVodeSolver
from scipy.integrate import solve_ivp

from benchmarks.compiled import CompiledFunction, write_library
from benchmarks.report import Report, Table
from benchmarks.timing import Case, measure
from vdfmu.arm.fmus import build_fmus
from vdfmu.arm.robot import Robot, load_robot
from vdfmu.arm.robot.structure import values
from vdfmu.arm.units.plant import Plant
from vdfmu.compiler.unit.interface import Interface

TITLE = "Work and precision: the plant alone"
COSIM, CVODE = "FMU, co-simulation", "FMU, model exchange, CVODE"
SCIPY = ("Radau", "BDF", "LSODA")
METHODS = (COSIM, CVODE, *SCIPY)
INTERVAL = 0.01
"""Time between two compared states [s]; all solvers make many steps in it."""
_REFERENCE_TOLERANCE = 1e-12
_LEVELS = (1e-5, 1e-6, 1e-7, 1e-8)
"""Errors at which the times are compared [rad]."""
Unit = TypeVar("Unit", FMU2Slave, FMU2Model)


@dataclass
class Point:
    """One method at one tolerance."""

    method: str
    tolerance: float
    time: float
    """Processor time of the whole motion [s], least of the rounds."""
    error: float
    """Largest error of a position [rad] over all joints and compared times."""


@dataclass
class WorkPrecision:
    """All points, and what they are measured by."""

    robot: str
    stop: float
    check: float
    """Difference of the reference to one of another method and code [rad]."""
    points: list[Point] = field(default_factory=list)

    def of(self, method: str) -> list[Point]:
        """Points of a method, the loosest tolerance first."""
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
    stop = 0.05 if quick else 0.5
    tolerances = [10.0**-k for k in ((4, 6, 8) if quick else range(4, 10))]
    found = study(
        load_robot("manipulator_6dof"),
        stop=stop,
        tolerances=tolerances,
        rounds=1 if quick else 3,
        say=report.say,
    )
    tabulate(found, report)


def study(
    robot: Robot, *, stop: float, tolerances: Sequence[float], rounds: int, say: Callable[[str], None]
) -> WorkPrecision:
    """Solve the motion with every method at every tolerance, in turns.

    The motion: the arm starts at rest in equilibrium with gravity, its motors free, and falls against drives
    and friction. Nothing in it is discontinuous, and no input changes, so that no solver has to restart.
    """
    times = np.linspace(0.0, stop, round(stop / INTERVAL) + 1)
    with tempfile.TemporaryDirectory(prefix="vdfmu-bench-") as name:
        folder = Path(name)
        fmu = build_fmus(robot, folder / "fmus", units=["plant"], backend="native")["plant"]
        cosim, exchange = CoSimulation(fmu, times, robot.n), _ModelExchange(fmu, times, robot.n)
        scipy = _Scipy(robot, folder, times, exchange.start())
        solvers: dict[str, Callable[[float], np.ndarray]] = {COSIM: cosim, CVODE: exchange}
        solvers |= {name: partial(scipy, name) for name in SCIPY}
        say(f"reference at tolerance {_REFERENCE_TOLERANCE:g}, {stop:g} s")
        reference = cosim(_REFERENCE_TOLERANCE)
        other = scipy("LSODA", _REFERENCE_TOLERANCE)
        found = WorkPrecision(robot.name, stop, float(np.max(np.abs(reference - other))))
        say(f"{len(solvers)} methods at {len(tolerances)} tolerances")
        cases: list[Case] = []
        for method, solver in solvers.items():
            for tolerance in tolerances:
                point = Point(method, tolerance, math.inf, math.inf)
                found.points.append(point)

                def solve(point: Point, solver: Callable[[float], np.ndarray]) -> None:
                    point.error = float(np.max(np.abs(solver(point.tolerance) - reference)))

                cases.append(Case(method, partial(solve, point, solver)))
        measure(cases, rounds, batch=0.0, limit=2.0 * rounds)
        for point, case in zip(found.points, cases, strict=True):
            point.time = case.best
        cosim.close()
        exchange.close()
    return found


# ------------------------------------------------------------------ solvers


class _Unpacked(Generic[Unit]):
    """An unpacked FMU and its instance."""

    def __init__(self, fmu: Path, times: np.ndarray, n: int, make: type[Unit]) -> None:
        self.times = times
        self.n = n
        description = read_model_description(str(fmu))
        self.references = {v.name: v.valueReference for v in description.modelVariables}
        self._q = [self.references[f"q[{i + 1}]"] for i in range(n)]
        self._folder = extract(str(fmu))
        interface = description.coSimulation if issubclass(make, FMU2Slave) else description.modelExchange
        assert interface is not None
        self.nx = description.numberOfContinuousStates
        self.unit = make(
            guid=description.guid, modelIdentifier=interface.modelIdentifier, unzipDirectory=self._folder,
            instanceName="plant",
        )  # fmt: skip
        self.unit.instantiate()

    def initialize(self, tolerance: float) -> None:
        self.unit.reset()
        self.unit.setReal([self.references["tolerance"]], [tolerance])  # the loosest of the two
        self.unit.setupExperiment(startTime=0.0, tolerance=tolerance)
        self.unit.enterInitializationMode()
        self.unit.exitInitializationMode()

    def q(self) -> list[float]:
        return self.unit.getReal(self._q)

    def close(self) -> None:
        self.unit.terminate()
        self.unit.freeInstance()
        shutil.rmtree(self._folder, ignore_errors=True)


class CoSimulation(_Unpacked[FMU2Slave]):
    """The FMU's own solver."""

    def __init__(self, fmu: Path, times: np.ndarray, n: int) -> None:
        super().__init__(fmu, times, n, FMU2Slave)

    def __call__(self, tolerance: float) -> np.ndarray:
        """Return the positions at the compared times."""
        self.initialize(tolerance)
        rows = [self.q()]
        for t, end in zip(self.times[:-1], self.times[1:], strict=True):
            self.unit.doStep(currentCommunicationPoint=float(t), communicationStepSize=float(end - t))
            rows.append(self.q())
        return np.array(rows)


class _Nothing:
    """Input of the solver of fmpy: there is none."""

    def apply(self, time: float) -> None: ...


class _ModelExchange(_Unpacked[FMU2Model]):
    """fmpy's CVODE on the FMU's derivatives; it approximates the Jacobian by differences."""

    def __init__(self, fmu: Path, times: np.ndarray, n: int) -> None:
        super().__init__(fmu, times, n, FMU2Model)

    def start(self) -> np.ndarray:
        """State at the start."""
        self.initialize(1e-6)
        x = (ctypes.c_double * self.nx)()
        self.unit.getContinuousStates(x, self.nx)
        return np.array(x)

    def __call__(self, tolerance: float) -> np.ndarray:
        self.initialize(tolerance)
        self.unit.newDiscreteStates()
        self.unit.enterContinuousTimeMode()
        unit = self.unit
        solver = CVodeSolver(
            nx=self.nx, nz=0, get_x=unit.getContinuousStates, set_x=unit.setContinuousStates,
            get_dx=unit.getDerivatives, get_z=unit.getEventIndicators,
            get_nominals=unit.getNominalsOfContinuousStates, set_time=unit.setTime, input=_Nothing(),
            startTime=0.0, relativeTolerance=tolerance, maxNumSteps=10_000_000,
        )  # fmt: skip
        rows = [self.q()]
        for t, end in zip(self.times[:-1], self.times[1:], strict=True):
            solver.step(float(t), float(end))
            unit.setTime(float(end))
            rows.append(self.q())
        return np.array(rows)


class _Scipy:
    """scipy's solvers on the compiled right-hand side and Jacobian."""

    def __init__(self, robot: Robot, folder: Path, times: np.ndarray, start: np.ndarray) -> None:
        functions = Interface(Plant, robot).functions
        library = write_library(functions, ("plant_derivatives", "plant_jacobian"), folder)
        self._f = CompiledFunction(library, functions, "plant_derivatives")
        self._J = CompiledFunction(library, functions, "plant_jacobian")
        for function in (self._f, self._J):
            function.args["p"][:] = values(robot)
        self._start = start
        self.times = times
        self.n = robot.n

    def derivative(self, t: float, x: np.ndarray) -> np.ndarray:
        self._f.args["x"][:] = x
        self._f.run()
        return self._f.results["x_dot"].copy()

    def jacobian(self, t: float, x: np.ndarray) -> np.ndarray:
        self._J.args["x"][:] = x
        self._J.run()
        m = len(x)
        return self._J.results["J"].reshape(m, m, order="F").copy()

    def __call__(self, method: str, tolerance: float) -> np.ndarray:
        found = solve_ivp(
            self.derivative, (0.0, self.times[-1]), self._start, method=method, jac=self.jacobian,
            rtol=tolerance, atol=tolerance, t_eval=self.times,
        )  # fmt: skip
        if not found.success:
            raise RuntimeError(f"{method} at {tolerance:g}: {found.message}")
        return found.y[: self.n].T


# ------------------------------------------------------------------ reporting


def tabulate(found: WorkPrecision, report: Report) -> None:
    """Show and keep the tables and facts."""
    table = Table(
        "work_precision", f"{found.robot}, {found.stop:g} s of free fall",
        [("method", ""), ("tolerance", ".0e"), ("error [rad]", ".1e"), ("time [ms]", ".2f")],
        [[p.method, p.tolerance, p.error, 1e3 * p.time] for p in found.points],
        [f"Error: largest of all positions at times {INTERVAL * 1e3:g} ms apart, to the FMU's co-simulation at "
         f"tolerance {_REFERENCE_TOLERANCE:g}, from which LSODA at the same differs by {found.check:.1e} rad.",
         "Time: least processor time of the whole motion, all in turns. Tolerances are relative and absolute; FMU and "
         "CVODE take the mean of all states, CVODE with differences for the Jacobian."],
    )  # fmt: skip
    report.show(table)
    equal = Table(
        "work_precision_equal", "Time at equal error [ms], between the measured points",
        [("error [rad]", ".0e"), *[(method, ".2f") for method in METHODS], ("fastest other over FMU", ".1f")],
    )  # fmt: skip
    for level in _LEVELS:
        times = [found.time_at(method, level) for method in METHODS]
        ours, others = times[0], [t for t in times[1:] if t is not None]
        ratio = min(others) / ours if ours and others else None
        equal.add(level, *[None if t is None else 1e3 * t for t in times], ratio)
    report.show(equal)
    report.facts |= {"points": [vars(p) for p in found.points], "reference_check_rad": found.check}
