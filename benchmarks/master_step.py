"""Where the time of one master step goes: the tracking system with the four Python FMUs."""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Iterable, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from benchmarks.report import COLOURS, Report, Table, new_figure, tidy
from benchmarks.system import packed, quiet_run
from benchmarks.timing import Case, Stopwatch, measure, stopwatch_cost
from vdfmu.arm.robot.structure import values
from vdfmu.arm.units import shipped_units
from vdfmu.compiler.functions import KernelFunction
from vdfmu.compiler.unit.integrator import Integrator
from vdfmu.compiler.unit.interface import Interface
from vdfmu.engine.fmu.component import Slave
from vdfmu.engine.masters.bank import Call
from vdfmu.engine.masters.exchange import Exchange, SampledStepper
from vdfmu.engine.run import Results
from vdfmu.system.scenario import Scenario, load_scenario
from vdfmu.system.scenario.values import group_value

TITLE = "Where the time of one master step goes"
UNITS = ("trajectory", "feedforward", "controller", "plant")
_ALGORITHM = "gauss-seidel"


@dataclass
class MasterStep:
    """Times of one step [s].

    Attributes
    ----------
    set, do_step, get, gather : dict of unit to time
        Of the FMI calls, and of bringing the unit's inputs up to date in the master.
    kernel : dict of unit to time
        Traced functions inside the unit's doStep.
    solver : float
        Python around the traced steps in the plant's solver.
    in_run, alone, calls : dict of function to time or number
        One call of a traced function in the run, the same alone in a loop, and calls a master step.
    record, opening, rest : float
        Storing the row; gathering all inputs at the start of the step; the loop itself.
    plain : float
        Whole step in a run without instruments, the best of `runs`.
    instrumented : float
        Whole step in the instrumented run that all parts are from, watches included.
    watches : float
        What the watches cost in it, calibrated; it is taken off every part.
    steps, rejected : float
        Internal steps of the plant's solver, accepted and rejected, per master step.
    """

    step: float
    stop: float
    runs: int
    plain: float
    instrumented: float
    watches: float
    set: dict[str, float]
    do_step: dict[str, float]
    get: dict[str, float]
    gather: dict[str, float]
    opening: float
    record: float
    rest: float
    kernel: dict[str, float]
    solver: float
    in_run: dict[str, float]
    alone: dict[str, float]
    calls: dict[str, float]
    steps: float
    rejected: float

    @property
    def total(self) -> float:
        """Sum of all parts."""
        units = sum(sum(part.values()) for part in (self.set, self.do_step, self.get, self.gather))
        return units + self.opening + self.record + self.rest

    @property
    def real_time_factor(self) -> float:
        """Simulated over wall time, of the plain run."""
        return self.step / self.plain


def run(report: Report, quick: bool = False) -> None:
    """Measure, tabulate and draw."""
    scenario = load_scenario("tracking")
    found = study(scenario, stop=1.0 if quick else scenario.stop, runs=2 if quick else 3, say=report.say)
    tabulate(found, report)
    report.save(draw(found))


def study(scenario: Scenario, *, stop: float, runs: int, say: Callable[[str], None]) -> MasterStep:
    """Run the system plain and instrumented, and its kernel functions alone, in turns; keep the fastest of each."""
    step, n = scenario.step, round(stop / scenario.step)
    plain = wall = math.inf
    best = _Watches()
    cases: list[Case] = []
    with packed(scenario) as package:
        say(
            f"{runs} times: {stop:g} s at {step * 1e3:g} ms plain, the same instrumented, kernel functions alone"
        )
        quiet_run(package, step=step, stop=min(stop, 50 * step))  # loads libraries and warms up
        for _ in range(runs):
            results = quiet_run(package, step=step, stop=stop)
            plain = min(plain, results.summary["wall_s"])
            watches = _Watches()
            with instrumented(watches):
                spent = quiet_run(package, step=step, stop=stop).summary["wall_s"]
            if spent < wall:
                wall, best = spent, watches
            cases = cases or kernel_cases(scenario, results)
            measure(cases, 20)
    parts = best.parts(wall, n)
    alone = {case.name: case.best for case in cases}
    return MasterStep(step=step, stop=stop, runs=runs, plain=plain / n, alone=alone, **parts)


# ----------------------------------------------------- the run under watches


class _Watches:
    """One watch for each part of the step."""

    def __init__(self) -> None:
        self.calls: dict[tuple[str, str], Stopwatch] = {}
        self.gathers: dict[str, Stopwatch] = {}
        self.opening = Stopwatch()
        self.record = Stopwatch()
        self.kernel: dict[str, Stopwatch] = {}
        self.advance = Stopwatch()
        self.integrators: set[Integrator] = set()

    def stage(self, slave: Slave, gathers: list[Callable[[], None]], calls: list[Call]) -> Any:
        """Put watches around the calls of one unit."""
        watch = self.gathers.setdefault(slave.name, Stopwatch())
        timed: list[Any] = []
        for function, *arguments, name in calls:
            kind = "do_step" if name == "doStep" else name[:3]
            timer = self.calls.setdefault((slave.name, kind), Stopwatch())
            timed.append((timer.wrap(function), *arguments, name))
        return slave, [watch.wrap(gather) for gather in gathers], timed

    def parts(self, wall: float, n: int) -> dict[str, Any]:
        """Fields of :class:`MasterStep` for a run of `n` steps in `wall` seconds.

        A watch costs time inside and outside of its own reading. Both are taken off: the first from the
        reading, the whole from the readings of the watches around it.
        """
        costs = {k: stopwatch_cost(k) for k in (0, 1, 3, 4)}

        def part(watch: Stopwatch | None, arguments: int) -> float:
            return (watch.seconds - watch.calls * costs[arguments][0]) / n if watch is not None else 0.0

        def cost(arguments: int, watches: Iterable[Stopwatch]) -> float:
            return sum(w.calls for w in watches) * costs[arguments][1] / n

        calls = {k: {u: part(self.calls.get((u, k)), 4) for u in UNITS} for k in ("set", "do_step", "get")}
        kernel = {unit: 0.0 for unit in UNITS}
        for name, watch in self.kernel.items():
            unit = name.split("_")[0]
            kernel[unit] += part(watch, 0)
            calls["do_step"][unit] -= cost(0, [watch])
        calls["do_step"]["plant"] -= cost(3, [self.advance])
        traced_step = self.kernel["plant_step"]
        inner = cost(0, self.kernel.values()) + cost(3, [self.advance])
        outer = (
            cost(4, self.calls.values())
            + cost(0, [*self.gathers.values(), self.opening])
            + cost(1, [self.record])
        )
        found = calls | {
            "gather": {unit: part(self.gathers.get(unit), 0) for unit in UNITS},
            "opening": part(self.opening, 0),
            "record": part(self.record, 1),
        }
        inside = sum(sum(v.values()) if isinstance(v, dict) else v for v in found.values())
        steps = sum(i.steps for i in self.integrators)
        rejected = sum(i.rejected for i in self.integrators)
        return found | {
            "rest": wall / n - inner - outer - inside,
            "instrumented": wall / n,
            "watches": inner + outer,
            "kernel": kernel,
            "solver": part(self.advance, 3) - cost(0, [traced_step]) - part(traced_step, 0),
            "in_run": {name: part(w, 0) * n / w.calls for name, w in self.kernel.items() if w.calls},
            "calls": {name: w.calls / n for name, w in self.kernel.items() if w.calls},
            "steps": steps / n,
            "rejected": rejected / n,
        }


@contextmanager
def instrumented(watches: _Watches) -> Generator[None]:
    """While this lasts, what a run makes has watches around it: FMI calls, traced functions and the solver.

    The Python FMUs run in this process and use the same classes, so that their insides are seen too.
    """
    plan, recorders = SampledStepper.__init__, Exchange.recorders
    make, advance = KernelFunction.__init__, Integrator.advance

    def timed_plan(self: SampledStepper, exchange: Exchange) -> None:
        plan(self, exchange)
        for watch in watches.kernel.values():  # the steps begin: forget what the initialization called
            watch.seconds, watch.calls = 0.0, 0
        self.opening = [watches.opening.wrap(gather) for gather in self.opening]
        self.stages = [watches.stage(*stage) for stage in self.stages]

    def timed_recorders(self: Exchange, rows: int, record: Sequence[str] | None) -> Any:
        signals, data, store = recorders(self, rows, record)
        return signals, data, watches.record.wrap(store)

    def timed_make(self: KernelFunction, *arguments: Any, **named: Any) -> None:
        make(self, *arguments, **named)
        self.run = watches.kernel.setdefault(self.function.name(), Stopwatch()).wrap(self.run)

    timed = watches.advance.wrap(advance)

    def timed_advance(self: Integrator, t: float, duration: float) -> None:
        watches.integrators.add(self)
        timed(self, t, duration)

    SampledStepper.__init__, Exchange.recorders = timed_plan, timed_recorders
    KernelFunction.__init__, Integrator.advance = timed_make, timed_advance
    try:
        yield
    finally:
        SampledStepper.__init__, Exchange.recorders = plan, recorders
        KernelFunction.__init__, Integrator.advance = make, advance


# ------------------------------------------------------------ the parts alone


def kernel_cases(scenario: Scenario, results: Results) -> list[Case]:
    """Make the traced functions that a step calls, on values from the middle of a run, to be timed alone."""
    middle = len(results) // 2
    robots = dict.fromkeys(UNITS, scenario.arm) | {"plant": scenario.plant_robot}
    functions = {unit: Interface(shipped_units()[unit], robots[unit]).functions for unit in UNITS}
    x = np.hstack([results[f"plant.{name}"][middle] for name in ("q", "q_dot", "kappa_dot", "tau_s")])
    feedforward = functions["feedforward"].function(
        f"feedforward_outputs_{group_value(scenario, 'feedforward.mode')}", p=values(scenario.arm)
    )
    for name in ("q_d", "q_d_dot", "q_d_ddot", "q_d_dddot", "q_d_ddddot"):
        feedforward.args[name][:] = results[f"trajectory.{name}"][middle]
    trajectory = functions["trajectory"].function("trajectory_outputs")
    controller = functions["controller"].function(
        f"controller_outputs_{group_value(scenario, 'controller.velocity')}"
    )
    trajectory.args["T"][0] = group_value(scenario, "trajectory.T")
    controller.args["ell"][:] = scenario.arm.ell
    plant = {"x": x, "p": values(scenario.plant_robot)}
    step = functions["plant"].function("plant_step", **plant)
    step.args["tau"][:] = results["plant.tau"][middle]
    step.args["h"][0], step.args["tolerance"][0] = scenario.step, scenario.tolerance
    outputs = functions["plant"].function("plant_outputs", **plant)
    called = (trajectory, feedforward, controller, step, outputs)
    return [Case(function.function.name(), function.run, function) for function in called]


# ------------------------------------------------------------------ reporting


def _rows(found: MasterStep) -> list[tuple[str, dict[str, float]]]:
    """Units and master, each with its parts [s]."""
    rows: list[tuple[str, dict[str, float]]] = []
    for unit in UNITS:
        solver = found.solver if unit == "plant" else 0.0
        parts = {"set": found.set[unit], "kernel": found.kernel[unit], "solver": solver}
        parts["slave"] = found.do_step[unit] - found.kernel[unit] - solver
        parts["get"] = found.get[unit]
        rows.append((unit, parts))
    gather = found.opening + sum(found.gather.values())
    rows.append(("master", {"gather": gather, "record": found.record, "loop": found.rest}))
    return rows


def tabulate(found: MasterStep, report: Report) -> None:
    """Show and keep the tables and facts."""
    us = 1e6
    total = found.total
    table = Table(
        "master_step",
        f"Time of one step [us]: tracking, {found.stop:g} s at {found.step * 1e3:g} ms, four Python FMUs, {_ALGORITHM}",
        [("unit", ""), ("set", ".2f"), ("doStep", ".2f"), ("kernel in it", ".2f"), ("solver loop in it", ".2f"),
         ("get", ".2f"), ("sum", ".2f"), ("share", ".1%")],
    )  # fmt: skip
    for unit in UNITS:
        whole = found.set[unit] + found.do_step[unit] + found.get[unit]
        solver = us * found.solver if unit == "plant" else None
        table.add(
            unit, us * found.set[unit], us * found.do_step[unit], us * found.kernel[unit], solver,
            us * found.get[unit], us * whole, whole / total,
        )  # fmt: skip
    units = {k: sum(getattr(found, k).values()) for k in ("set", "do_step", "get")}
    whole = sum(units.values())
    table.add(
        "all units", us * units["set"], us * units["do_step"], us * sum(found.kernel.values()), us * found.solver,
        us * units["get"], us * whole, whole / total,
    )  # fmt: skip
    _, master = _rows(found)[-1]
    for name, text in (
        ("gather", "master: gather inputs"),
        ("record", "master: record"),
        ("loop", "master: loop"),
    ):
        table.add(text, None, None, None, None, None, us * master[name], master[name] / total)
    table.add("total", None, None, None, None, None, us * total, 1.0)
    table.notes += [
        f"Run without instruments: {us * found.plain:.1f} us a step, real-time factor {found.real_time_factor:.2f} "
        f"(best of {found.runs}, in turns with all else).",
        f"Instrumented: {us * found.instrumented:.1f} us, of which the watches cost {us * found.watches:.1f} us "
        f"(calibrated, taken off every part). The parts sum to {total / found.plain:.1%} of the plain run.",
        f"Solver: {found.steps:.2f} accepted and {found.rejected:.2f} rejected internal steps a master step; "
        f"one traced Rodas4 step takes {us * found.in_run['plant_step']:.1f} us.",
        "What kernel and solver loop leave of doStep is the slave's Python, pythonfmu and ctypes.",
    ]
    report.show(table)

    functions = Table(
        "master_step_kernel",
        "Traced functions in the step",
        [
            ("function", ""),
            ("calls a step", ".2f"),
            ("one call in the run [us]", ".2f"),
            ("alone [us]", ".2f"),
        ],
    )
    for name, calls in found.calls.items():
        functions.add(name, calls, us * found.in_run[name], us * found.alone[name])
    functions.notes.append("Alone: the same call again and again, with all its memory in the cache.")
    report.show(functions)
    report.facts |= {
        "us_per_step": us * found.plain,
        "real_time_factor": found.real_time_factor,
        "parts_us": {name: {k: us * v for k, v in parts.items()} for name, parts in _rows(found)},
        "parts_over_plain": total / found.plain,
        "instrument_us": us * found.watches,
        "kernel_functions_us": {
            k: {"in_run": us * found.in_run[k], "alone": us * v} for k, v in found.alone.items()
        },
        "solver_steps_per_step": found.steps,
        "solver_rejected_per_step": found.rejected,
    }


_PARTS = {
    "kernel": ("kernel functions", COLOURS["blue"]),
    "solver": ("Python loop of the solver", "#86b6de"),
    "slave": ("rest of doStep: slave, pythonfmu, ctypes", COLOURS["orange"]),
    "set": ("set inputs", COLOURS["green"]),
    "get": ("get outputs", "#9ccba5"),
    "gather": ("gather inputs", "#555555"),
    "record": ("record the row", "#8c8c8c"),
    "loop": ("master loop", "#c4c4c4"),
}


def draw(found: MasterStep) -> Figure:
    """Horizontal bars: units and master, split into their parts."""
    figure = new_figure(8.6, 3.4)
    axes = figure.add_subplot()
    rows = _rows(found)
    labelled: set[str] = set()
    for y, (_, parts) in enumerate(rows):
        left = 0.0
        for key, (label, colour) in _PARTS.items():
            width = 1e6 * max(parts.get(key, 0.0), 0.0)
            if key not in parts:
                continue
            axes.barh(
                y, width, left=left, height=0.62, color=colour, edgecolor="white", linewidth=0.6,
                label=None if key in labelled else label,
            )  # fmt: skip
            labelled.add(key)
            left += width
        share = sum(parts.values()) / found.total
        axes.annotate(
            f"{1e6 * sum(parts.values()):.1f} µs, {share:.0%}", (left, y), (4, 0), textcoords="offset points",
            va="center", fontsize=8,
        )  # fmt: skip
    axes.set_yticks(range(len(rows)), [name for name, _ in rows])
    axes.invert_yaxis()
    axes.margins(x=0.14)
    axes.set_xlim(left=0.0)
    axes.set_xlabel("time in one communication step [µs]")
    axes.set_title(
        f"tracking at {1e-3 / found.step:g} kHz, four Python FMUs: {1e6 * found.plain:.0f} µs a step, "
        f"real-time factor {found.real_time_factor:.1f}",
        loc="left",
    )
    tidy(axes, "x")
    axes.tick_params(axis="y", length=0)
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3, frameon=False, fontsize=8)
    return figure
