"""Work and precision of the whole coupled system under the four master algorithms, with and without error control."""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from benchmarks.fit import Exponent, fit_exponent
from benchmarks.order import EXPECTED, triangle
from benchmarks.report import COLOURS, Report, Table, new_figure, tidy
from benchmarks.system import Clock, least, packed, quiet_run
from vdfmu.arm.robot import Robot
from vdfmu.compiler.c.compile import native_available
from vdfmu.engine.masters.continuous import ContinuousStepper
from vdfmu.engine.results.recorded import Signal
from vdfmu.engine.run import Results
from vdfmu.study.run.summary import power_bond
from vdfmu.system.package.description import SystemDescription
from vdfmu.system.reference.reference import reference
from vdfmu.system.scenario import Scenario, load_scenario

TITLE = "Work and precision: the coupled system"
STEPS = {
    "gauss-seidel": (2e-3, 1e-3, 5e-4, 2e-4, 1e-4, 5e-5),
    "jacobi": (1e-3, 5e-4, 2e-4, 1e-4, 5e-5),
    "extrapolated": (1.25e-3, 1e-3, 5e-4, 2e-4, 1e-4),
    "iterative": (5e-3, 4e-3, 2e-3, 1e-3, 5e-4),
}
"""Communication steps [s], the first close to the longest at which the algorithm is stable."""
CONTROLLED = ("extrapolated", "iterative")
LONGEST = 5e-3
"""Longest step under error control, and the interval of its rows [s]."""
ERRORS = (1e-3, 1e-4, 1e-5, 1e-6, 1e-7)
TOLERANCE = 1e-9
"""Of the plant's solver; with 1e-11 the errors are the same to two digits."""
CONVERGENCE = 1e-8
"""Of `iterative` with a fixed step: the default."""
GRID = 2e-2
"""Interval of the compared rows [s], a multiple of every step."""
_LEVELS = (1e-6, 1e-7, 1e-8)
"""Errors at which the work is compared [rad]."""
_ENOUGH = 5.0
"""Time after which a case is not repeated [s]."""
_MARKS = {
    "gauss-seidel": (COLOURS["blue"], "o"), "jacobi": (COLOURS["orange"], "s"),
    "extrapolated": (COLOURS["green"], "^"), "iterative": ("#7a4ea3", "D"),
}  # fmt: skip


@dataclass
class Point:
    """One run.

    Attributes
    ----------
    adaptive : float or None
        Allowed error of the error control.
    step : float [s]
        Under error control the longest.
    error : float [rad]
        Largest difference of a position to the continuous reference.
    steps, rejected, unit_steps : int
        Communication steps, those of them that were rejected, steps of all units.
    time : float [s]
        Processor time of the steps: of each hundredth of the run the least over the rounds.
    residual, exchanged, bound : float or None [J]
        Energy at the power bond after the first compared row, over all joints; what `iterative` may leave of it.
        None under error control, whose rows are no steps.
    """

    algorithm: str
    adaptive: float | None
    step: float
    error: float = math.inf
    steps: int = 0
    rejected: int = 0
    unit_steps: int = 0
    time: float = math.inf
    residual: float | None = None
    exchanged: float | None = None
    bound: float | None = None

    @property
    def method(self) -> str:
        """Name of the algorithm with or without error control."""
        return self.algorithm if self.adaptive is None else f"{self.algorithm}, adaptive"


@dataclass
class Coupling:
    """All points; `chosen` holds the mean step in each row of one run under error control, over the time."""

    stop: float
    points: list[Point] = field(default_factory=list)
    chosen: dict[str, tuple[np.ndarray, np.ndarray]] = field(default_factory=dict)
    chosen_error: float = 0.0

    @property
    def methods(self) -> list[str]:
        """Names of the methods, in the order of the points."""
        return list(dict.fromkeys(p.method for p in self.points))

    def of(self, method: str) -> list[Point]:
        """Points of a method, the longest step or largest allowed error first."""
        return [p for p in self.points if p.method == method]

    def work_at(self, method: str, error: float, what: str = "unit_steps") -> float | None:
        """Least work at which a method has an error of at most `error`.

        That of a point, or between two of them on the line through their logarithms; None where no point is as
        precise. A method whose longest stable step is more precise has the work of that step.
        """
        points = self.of(method)
        found = [float(getattr(p, what)) for p in points if p.error <= error]
        for a, b in pairwise(points):
            if min(a.error, b.error) <= error <= max(a.error, b.error) and a.error != b.error:
                part = math.log(error / a.error) / math.log(b.error / a.error)
                found.append(getattr(a, what) * (getattr(b, what) / getattr(a, what)) ** part)
        return min(found) if found else None

    def energy_order(self, algorithm: str) -> Exponent:
        """Observed order of the energy residual in the step."""
        points = [p for p in self.of(algorithm) if p.residual]
        return fit_exponent([p.step for p in points], [p.residual or 0.0 for p in points])


def run(report: Report, quick: bool = False) -> None:
    """Measure, tabulate and draw."""
    if not native_available():
        report.facts["skipped"] = "the compiler of native FMUs is not installed (pip install .[native])"
        report.say(f"skipped: {report.facts['skipped']}")
        return
    scenario = load_scenario("tracking")
    found = study(
        scenario,
        {a: each[:3] for a, each in STEPS.items()} if quick else STEPS,
        ERRORS[1:4] if quick else ERRORS,
        stop=1.0 if quick else scenario.stop,
        rounds=1 if quick else 3,
        say=report.say,
    )
    tabulate(found, report)
    report.save(draw(found))


def study(
    scenario: Scenario,
    steps: Mapping[str, Sequence[float]],
    errors: Sequence[float],
    *,
    stop: float,
    rounds: int,
    say: Callable[[str], None],
) -> Coupling:
    """Run every algorithm at every step, and under error control at every allowed error, in turns."""
    say(f"continuous reference over {stop:g} s")
    exact = reference("continuous", SystemDescription(scenario), step=GRID, stop=stop)
    found = Coupling(stop)
    found.points = [Point(a, None, h) for a, each in steps.items() for h in each]
    found.points += [Point(a, error, LONGEST) for a in CONTROLLED for error in errors]
    clocks: list[list[Clock]] = [[] for _ in found.points]
    with packed(scenario, "native") as package:
        for i in range(rounds):
            say(f"round {i + 1} of {rounds}: {len(found.points)} runs of {stop:g} s")
            for point, before in zip(found.points, clocks, strict=True):
                if i and sum(float(c.processor.sum()) * c.marks[-1][0] for c in before) > _ENOUGH:
                    continue
                clock = Clock()
                results = _run(package, point, stop, clock)
                before.append(clock)
                if i == 0:
                    _note(point, results, exact["plant.q"], scenario.arm)
        for point, each in zip(found.points, clocks, strict=True):
            point.time = least([c.processor for c in each]) * each[0].marks[-1][0]
        found.chosen_error = errors[len(errors) // 2]
        for a in CONTROLLED:
            with _watched() as counts:
                results = _run(package, Point(a, found.chosen_error, LONGEST), stop, Clock())
            found.chosen[a] = results.time[1:], LONGEST / np.array(counts)
    return found


def _run(package: Path, point: Point, stop: float, clock: Clock) -> Results:
    return quiet_run(
        package, step=point.step, stop=stop, algorithm=point.algorithm, adaptive=point.adaptive,
        convergence=CONVERGENCE if point.algorithm == "iterative" and point.adaptive is None else None,
        tolerance=TOLERANCE, progress=clock.progress,
    )  # fmt: skip


def _note(point: Point, results: Results, exact: np.ndarray, robot: Robot) -> None:
    """Keep the numbers of a run."""
    summary, stride = results.summary, round(GRID / point.step)
    counts = summary.get("communication", {"steps": summary["steps"], "rejected": 0})
    point.steps, point.rejected = counts["steps"], counts["rejected"]
    point.unit_steps = counts.get("unit_steps", len(summary["order"]) * point.steps)
    point.error = float(np.max(np.abs(results["plant.q"][::stride] - exact)))
    if point.adaptive is None:
        later = _from(results, stride)
        bond = power_bond(later, robot)["power_bond"]
        point.residual, point.exchanged = sum(bond["residual_energy_abs_j"]), sum(bond["exchanged_energy_j"])
        # The velocity that goes in and the one that comes out differ by the convergence, relative to the size of the
        # velocity and at least to its nominal value, which is 1 rad/s.
        size = np.maximum(np.abs(later["plant.kappa_dot"]), 1.0)
        power = np.abs(robot.ell * later["plant.tau"]) * size
        point.bound = CONVERGENCE * point.step * float(power[1:].sum())


def _from(results: Results, first: int) -> Results:
    """Return the rows from `first` on."""
    signals = [f"{u}.{v}" for u, v in (("plant", "tau"), ("plant", "kappa_dot"))]
    signals += ["controller.tau", "controller.kappa_dot"]
    n = results["plant.tau"].shape[1]
    names = [f"{name}[{i + 1}]" for name in signals for i in range(n)]
    data = np.column_stack([results[name][first:] for name in names])
    return Results(
        results.time[first:], [Signal(name, "real", "", i) for i, name in enumerate(names)], {"real": data}
    )


@contextmanager
def _watched() -> Generator[list[int]]:
    """Count the communication steps of each row of the runs inside."""
    counts: list[int] = []
    advance = ContinuousStepper.advance

    def counted(self: ContinuousStepper, start: float, step: float, stop: float) -> None:
        before = self.steps
        advance(self, start, step, stop)
        counts.append(self.steps - before)

    ContinuousStepper.advance = counted
    try:
        yield counts
    finally:
        ContinuousStepper.advance = advance


# ------------------------------------------------------------------ reporting


def tabulate(found: Coupling, report: Report) -> None:
    """Show and keep the tables and facts."""
    table = Table(
        "coupling",
        f"Tracking, {found.stop:g} s, against the continuous closed loop",
        [("method", ""), ("step [ms]", ".4g"), ("allowed error", ".0e"), ("error of q [rad]", ".2e"),
         ("steps", "d"), ("rejected", "d"), ("steps of units", "d"), ("time [s]", ".2f")],
    )  # fmt: skip
    for p in found.points:
        table.add(p.method, 1e3 * p.step, p.adaptive, p.error, p.steps, p.rejected, p.unit_steps, p.time)
    table.notes += [
        f"Error: largest over the joints and over rows {1e3 * GRID:g} ms apart. Solver tolerance of the plant "
        f"{TOLERANCE:g}. Steps of units include those of rejected and repeated steps. Under error control the step is "
        "the longest allowed.",
        "Time: processor time of the steps, all in turns, of each hundredth of the run the least. Unlike the counts it "
        "depends on the machine and its load.",
    ]
    report.show(table)
    report.show(_equal(found, report))

    energy = Table(
        "coupling_energy",
        "Energy residual at the power bond of tau and kappa_dot, all joints",
        [("algorithm", ""), ("step [ms]", ".4g"), ("residual [J]", ".2e"), ("of the exchanged", ".1e"),
         ("bound of the convergence [J]", ".1e")],
    )  # fmt: skip
    fixed = [p for p in found.points if p.residual is not None and p.exchanged]
    for p in fixed:
        bound = p.bound if p.algorithm == "iterative" else None
        energy.add(p.algorithm, 1e3 * p.step, p.residual, (p.residual or 0.0) / (p.exchanged or 1.0), bound)
    orders = {a: found.energy_order(a).slope for a in EXPECTED if a != "iterative"}
    energy.notes += [
        f"Observed order: {', '.join(f'{a} {order:.3f}' for a, order in orders.items())}. The residual of iterative is "
        f"what its convergence of {CONVERGENCE:g} leaves, whatever the step.",
        f"Without the first {1e3 * GRID:g} ms: at the start the rotors take up speed within 0.03 ms, less than a step.",
    ]
    report.show(energy)
    report.facts |= {
        "stop_s": found.stop,
        "points": [{"method": p.method} | vars(p) for p in found.points],
        "order_energy": orders,
    }


def _equal(found: Coupling, report: Report) -> Table:
    """Table of the least work for an error, and its facts."""
    table = Table(
        "coupling_equal",
        "Least steps of units for an error, between the measured points",
        [("error [rad]", ".0e"), *[(method, ".3g") for method in found.methods], ("least", "")],
    )
    facts: dict[str, Any] = {}
    for what in ("unit_steps", "time"):
        for level in _LEVELS:
            work = {m: found.work_at(m, level, what) for m in found.methods}
            facts[f"{what}_at_{level:g}"] = work
            known = {m: w for m, w in work.items() if w is not None}
            if what == "unit_steps":
                best = min(known, key=lambda m: known[m]) if known else "-"
                table.add(level, *work.values(), best)
    table.notes.append(
        "A dash: no step was short enough. Where the longest stable step is more precise, its work is shown."
    )
    report.facts |= facts
    return table


def draw(found: Coupling) -> Figure:
    """Error over work and over time, energy residual over the step, and the steps that the error control chose."""
    figure = new_figure(9.2, 7.4)
    handles: tuple[Any, Any] = ((), ())
    for i, (what, label) in enumerate((("unit_steps", "steps of all units"), ("time", "processor time [s]"))):
        axes = figure.add_subplot(2, 2, i + 1)
        for method in found.methods:
            points = found.of(method)
            colour, mark = _MARKS[points[0].algorithm]
            controlled = points[0].adaptive is not None
            axes.loglog(
                [getattr(p, what) for p in points], [p.error for p in points], color=colour, marker=mark,
                markersize=5, linewidth=1.3, linestyle="--" if controlled else "-",
                markerfacecolor="white" if controlled else colour, label=method if i == 0 else None,
            )  # fmt: skip
        axes.set_xlabel(label)
        axes.set_ylabel("largest error of q [rad]")
        tidy(axes)
        _few_ticks(axes, [getattr(p, what) for p in found.points])
        if i == 0:
            handles = axes.get_legend_handles_labels()
    _draw_energy(figure.add_subplot(2, 2, 3), found)
    axes = figure.add_subplot(2, 2, 4)
    for a, (time, step) in found.chosen.items():
        axes.semilogy(time, 1e3 * step, color=_MARKS[a][0], linewidth=0.7, label=f"{a}, adaptive")
    axes.set_xlabel("time [s]")
    axes.set_ylabel(f"step chosen for an error of {found.chosen_error:g} [ms]")
    low, high = axes.get_ylim()
    axes.set_ylim(low, high * (high / low) ** 0.25)  # room for the legend
    ticks = [t for t in (0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10) if t >= low]
    axes.set_yticks(ticks, [f"{t:g}" for t in ticks])
    tidy(axes)
    axes.legend(loc="upper left", frameon=False, fontsize=8, ncols=2)
    figure.suptitle(
        f"Tracking, {found.stop:g} s, native FMUs, against the continuous closed loop", x=0.01, ha="left"
    )
    figure.legend(*handles, loc="outside lower center", ncols=3, frameon=False, fontsize=8)
    return figure


def _few_ticks(axes: Axes, values: Sequence[float]) -> None:
    """Ticks of 1, 2 and 5 times powers of ten over the range of the values."""
    decades = range(math.floor(math.log10(min(values))), math.ceil(math.log10(max(values))) + 1)
    low, high = axes.get_xlim()
    ticks = [t for t in (digit * 10.0**d for d in decades for digit in (1, 2, 5)) if low <= t <= high]
    axes.set_xticks(ticks, [f"{t:,.6g}".replace(",", " ") for t in ticks])


def _draw_energy(axes: Axes, found: Coupling) -> None:
    for a, (colour, mark) in _MARKS.items():
        points = [p for p in found.of(a) if p.residual and p.exchanged]
        if not points:
            continue
        h = 1e3 * np.array([p.step for p in points])
        share = np.array([(p.residual or 0.0) / (p.exchanged or 1.0) for p in points])
        behind = a == "jacobi"  # whose residual is that of gauss-seidel
        axes.loglog(
            h, share, color=colour, marker=mark, markersize=8 if behind else 5, linewidth=1.3,
            markerfacecolor="white" if behind else colour, zorder=1.5 if behind else 2,
        )  # fmt: skip
        if a in ("gauss-seidel", "extrapolated") and len(points) > 2:
            triangle(axes, h, share, EXPECTED[a])
        if a == "iterative":
            bound = [(p.bound or 0.0) / (p.exchanged or 1.0) for p in points]
            axes.loglog(h, bound, color=colour, linewidth=0.9, linestyle=":")
            axes.annotate("bound of convergence", (h[0], bound[0]), (0, -5), textcoords="offset points",
                          ha="right", va="top", fontsize=8, color=colour)  # fmt: skip
    axes.set_xlabel("communication step [ms]")
    axes.set_ylabel("energy residual over exchanged energy")
    ticks = [0.05, 0.1, 0.2, 0.5, 1, 2, 5]
    axes.set_xticks(ticks, [f"{v:g}" for v in ticks])
    tidy(axes)
