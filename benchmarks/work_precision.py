"""Work and precision of the plant's solver against CVODE and scipy's, all on the same generated equations."""

from __future__ import annotations

import ctypes
import math
import shutil
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Generic, Protocol, TypeVar

import numpy as np
from fmpy import extract, read_model_description
from fmpy.fmi2 import FMU2Model, FMU2Slave
from fmpy.sundials import CVodeSolver
from matplotlib.figure import Figure
from scipy.integrate import solve_ivp

from benchmarks.compiled import CompiledFunction, write_library
from benchmarks.native_plan import loop_library
from benchmarks.report import COLOURS, Report, Table, new_figure, tidy
from benchmarks.timing import Case, measure
from vdfmu.arm.fmus import build_fmus
from vdfmu.arm.robot import Robot, load_robot
from vdfmu.arm.robot.structure import values
from vdfmu.arm.units.plant import Plant
from vdfmu.compiler.c.compile import native_available
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
    calls: int | None = None
    """Evaluations of the right-hand side; None where they are inside a compiled solver."""
    generated: float | None = None
    """What these evaluations and those of the Jacobian take in compiled code [s], without any solver."""


@dataclass
class WorkPrecision:
    """All points, and what they are measured by."""

    robot: str
    stop: float
    check: float
    """Difference of the reference to one of another method and code [rad]."""
    derivative: float
    jacobian: float
    points: list[Point] = field(default_factory=list)

    def of(self, method: str) -> list[Point]:
        """Points of a method, the loosest tolerance first."""
        return [p for p in self.points if p.method == method]

    def time_at(self, method: str, error: float, what: str = "time") -> float | None:
        """Time of a method at an error [s], between its points; None outside of them."""
        points = sorted((p.error, getattr(p, what)) for p in self.of(method))
        if not points or not points[0][0] <= error <= points[-1][0]:
            return None
        x, y = np.log([[a, b] for a, b in points]).T
        return float(np.exp(np.interp(math.log(error), x, y)))


class _Solver(Protocol):
    """Solves the motion at a tolerance; returns the positions at the compared times."""

    def __call__(self, tolerance: float) -> np.ndarray: ...


def run(report: Report, quick: bool = False) -> None:
    """Measure, tabulate and draw."""
    if not native_available():
        report.facts["skipped"] = "the compiler of native FMUs is not installed (pip install .[native])"
        report.say(f"skipped: {report.facts['skipped']}")
        return
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
    report.save(draw(found))


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
        solvers: dict[str, _Solver] = {COSIM: cosim, CVODE: exchange}
        solvers |= {name: _bind(scipy, name) for name in SCIPY}

        say(f"reference at tolerance {_REFERENCE_TOLERANCE:g}, {stop:g} s")
        reference = cosim(_REFERENCE_TOLERANCE)
        other = scipy("LSODA", _REFERENCE_TOLERANCE)
        derivative, jacobian = scipy.cost()
        found = WorkPrecision(
            robot.name, stop, float(np.max(np.abs(reference - other))), derivative, jacobian
        )
        say(f"{len(solvers)} methods at {len(tolerances)} tolerances")
        cases: list[Case] = []
        solved: dict[str, tuple[np.ndarray, int, int]] = {}
        for method, solver in solvers.items():
            for tolerance in tolerances:
                name = f"{method} {tolerance:g}"
                counter: Any = {CVODE: exchange, COSIM: cosim}.get(method, scipy)

                def solve(name: str, solver: _Solver, tolerance: float, counter: Any) -> None:
                    counter.calls = counter.jacobians = 0
                    solved[name] = solver(tolerance), counter.calls, counter.jacobians

                cases.append(Case(name, _bind(solve, name, solver, tolerance, counter)))
                found.points.append(Point(method, tolerance, math.inf, math.inf))
        measure(cases, rounds, batch=0.0, limit=2.0 * rounds)
        for point, case in zip(found.points, cases, strict=True):
            q, calls, jacobians = solved[case.name]
            point.time, point.error = case.best, float(np.max(np.abs(q - reference)))
            if calls:
                point.calls, point.generated = calls, calls * derivative + jacobians * jacobian
        cosim.close()
        exchange.close()
    return found


def _bind(function: Callable[..., Any], *given: Any) -> Callable[..., Any]:
    return lambda *rest: function(*given, *rest)


# ------------------------------------------------------------------ solvers


class _Unpacked(Generic[Unit]):
    """An unpacked FMU and its instance."""

    def __init__(self, fmu: Path, times: np.ndarray, n: int, make: type[Unit]) -> None:
        self.times = times
        self.n = n
        self.calls = self.jacobians = 0
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

    def _derivatives(self, x_dot: Any, n: int) -> None:
        self.calls += 1
        self.unit.getDerivatives(x_dot, n)

    def __call__(self, tolerance: float) -> np.ndarray:
        self.initialize(tolerance)
        self.unit.newDiscreteStates()
        self.unit.enterContinuousTimeMode()
        unit = self.unit
        solver = CVodeSolver(
            nx=self.nx, nz=0, get_x=unit.getContinuousStates, set_x=unit.setContinuousStates,
            get_dx=self._derivatives, get_z=unit.getEventIndicators,
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
        self.calls = self.jacobians = 0

    def derivative(self, t: float, x: np.ndarray) -> np.ndarray:
        self.calls += 1
        self._f.args["x"][:] = x
        self._f.run()
        return self._f.results["x_dot"].copy()

    def jacobian(self, t: float, x: np.ndarray) -> np.ndarray:
        self.jacobians += 1
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

    def cost(self) -> tuple[float, float]:
        """Time of one right-hand side and of one Jacobian in compiled code [s]."""
        library, times = loop_library(), []
        for function in (self._f, self._J):
            function.args["x"][:] = self._start
            address, calls = ctypes.cast(function.call, ctypes.c_void_p), ctypes.c_long(2000)
            times.append(min(library.call_time(address, *function.pointers, calls) for _ in range(20)))
        return times[0], times[1]


# ------------------------------------------------------------------ reporting


def tabulate(found: WorkPrecision, report: Report) -> None:
    """Show and keep the tables and facts."""
    table = Table(
        "work_precision",
        f"{found.robot}, {found.stop:g} s of free fall",
        [("method", ""), ("tolerance", ".0e"), ("error [rad]", ".1e"), ("time [ms]", ".2f"),
         ("right-hand sides", "d"), ("generated code in it [ms]", ".2f")],
    )  # fmt: skip
    for p in found.points:
        table.add(
            p.method, p.tolerance, p.error, 1e3 * p.time, p.calls, None if p.generated is None else 1e3 * p.generated
        )  # fmt: skip
    table.notes += [
        f"Error: largest of all positions at times {INTERVAL * 1e3:g} ms apart, to the FMU's co-simulation at "
        f"tolerance {_REFERENCE_TOLERANCE:g}, from which LSODA at the same differs by {found.check:.1e} rad.",
        "Time: least processor time of the whole motion, all in turns. Tolerances are relative and absolute; FMU and "
        "CVODE take the mean of all states, CVODE with differences for the Jacobian.",
        f"scipy and the FMU call the same generated code. One right-hand side takes {1e6 * found.derivative:.2f} us "
        f"and one Jacobian {1e6 * found.jacobian:.2f} us in compiled code. Generated code in it: their number times "
        "that, which is what the solver would take at least in a compiled program.",
    ]
    report.show(table)

    equal = Table(
        "work_precision_equal",
        "Time at equal error [ms], between the measured points",
        [("error [rad]", ".0e"), *[(method, ".2f") for method in METHODS], ("fastest other over FMU", ".1f"),
         ("generated code of it over FMU", ".2f")],
    )  # fmt: skip
    ratios: dict[str, float] = {}
    for level in _LEVELS:
        times = [found.time_at(method, level) for method in METHODS]
        ours, others = times[0], [t for t in times[1:] if t is not None]
        least = [found.time_at(method, level, "generated") for method in METHODS[1:]]
        bounds = [t for t in least if t is not None]
        ratio = min(others) / ours if ours and others else None
        bound = min(bounds) / ours if ours and bounds else None
        if ratio is not None:
            ratios[f"{level:g}"] = ratio
        equal.add(level, *[None if t is None else 1e3 * t for t in times], ratio, bound)
    equal.notes.append(
        "Last column: that of the least generated code among the other methods. Below 1 a solver in compiled code "
        "could be faster than the FMU's on this motion."
    )
    report.show(equal)
    report.facts |= {
        "points": [vars(p) for p in found.points],
        "fastest_other_over_fmu": ratios,
        "reference_check_rad": found.check,
        "derivative_us": 1e6 * found.derivative,
        "jacobian_us": 1e6 * found.jacobian,
    }


_MARKS = {
    COSIM: (COLOURS["blue"], "o"), CVODE: (COLOURS["green"], "s"), "Radau": ("#7a4ea3", "^"),
    "BDF": (COLOURS["grey"], "v"), "LSODA": (COLOURS["orange"], "D"),
}  # fmt: skip


def draw(found: WorkPrecision) -> Figure:
    """Time over error, both logarithmic: further down and left is better."""
    figure = new_figure(7.6, 4.4)
    axes = figure.add_subplot()
    for method, (colour, mark) in _MARKS.items():
        points = found.of(method)
        error = [p.error for p in points]
        axes.plot(
            error, [1e3 * p.time for p in points], color=colour, marker=mark, markersize=5, label=method
        )
        generated = [(p.error, 1e3 * p.generated) for p in points if p.generated is not None]
        if generated:
            axes.plot(*zip(*generated, strict=True), color=colour, linewidth=0.9, linestyle=":")
    axes.plot([], [], color="#333333", linewidth=0.9, linestyle=":", label="generated code alone")
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlabel("largest error of a position [rad]")
    axes.set_ylabel("processor time [ms]")
    axes.set_title(f"{found.robot}: {found.stop:g} s of free fall, plant alone", loc="left")
    tidy(axes)
    figure.legend(loc="outside lower center", ncols=3, frameon=False, fontsize=8)
    return figure
