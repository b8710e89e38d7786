"""The native FMUs under the master, folded into a container and in a loop of compiled code, and where the time goes."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from benchmarks.importers import PACKAGES, ask, missing
from benchmarks.native_plan import Plan, interpreter_parts, ready
from benchmarks.report import Report, Table
from benchmarks.system import Clock, container_run, least, median, packed, quiet_run, write_emptied
from vdfmu.engine.container import write_container
from vdfmu.engine.run import Results
from vdfmu.system.scenario import Scenario, load_scenario
from vdfmu.system.scenario.replace import with_units

TITLE = "Native FMUs: real-time factor and where the time of a step goes"
UNITS = ("trajectory", "feedforward", "controller", "plant")
PYTHON, NATIVE, ISOLATED, JACOBI, CONTAINER = (
    "Python FMUs", "native FMUs, gauss-seidel", "native FMUs in a process of their own", "native FMUs, jacobi",
    "container FMU",
)  # fmt: skip
OWN = "native FMUs, the controller a user's file"
EMPTY, EMPTY_CONTAINER = "empty FMUs, gauss-seidel", "container FMU of empty FMUs"
LOOP, LOOP_CONTAINER = "native FMUs in a compiled loop", "container FMU in a compiled loop"


@dataclass
class Native:
    """Times of one step [s].

    Attributes
    ----------
    wall, processor : dict of case to list of (100,) arrays
        Blocks of each round, see :class:`benchmarks.system.Clock`; all cases take turns.
    units : dict of unit to (dict of "set" | "do_step" | "get" to time)
        Inside the units' libraries; that of the user's controller is `OWN`.
    container : dict of "do_step" | "get" to time
        Inside the container's library, with its units.
    master : dict of "calls" | "gather" | "record" to time
        Parts of the master's step with the four empty units.
    differences : dict of case to float [rad]
        Largest difference of the plant's positions to those of the same algorithm in another form.
    """

    step: float
    stop: float
    stop_python: float
    wall: dict[str, list[np.ndarray]] = field(default_factory=dict)
    processor: dict[str, list[np.ndarray]] = field(default_factory=dict)
    units: dict[str, dict[str, float]] = field(default_factory=dict)
    container: dict[str, float] = field(default_factory=dict)
    master: dict[str, float] = field(default_factory=dict)
    differences: dict[str, float] = field(default_factory=dict)

    def least(self, case: str) -> float:
        """Time of a step, of each block the least over the rounds [s]."""
        return least(self.wall[case])

    def ratio(self, a: str, b: str) -> float:
        """Time of `a` over that of `b`."""
        return self.least(a) / self.least(b)

    @property
    def in_units(self) -> float:
        """Time inside the libraries of the four units [s]."""
        return sum(sum(self.units[unit].values()) for unit in UNITS)

    @property
    def more_of_own(self) -> float:
        """What the user's controller takes in its library more than that of the package [s]."""
        return sum(self.units[OWN].values()) - sum(self.units["controller"].values())


def run(report: Report, quick: bool = False) -> None:
    """Measure and tabulate."""
    scenario = load_scenario("tracking")
    stop_python = 0.5 if quick else scenario.stop
    found = study(
        scenario,
        stop=2.0 if quick else scenario.stop,
        stop_python=stop_python,
        rounds=3 if quick else 5,
        say=report.say,
        others=[importer for importer in PACKAGES if not missing(importer)],
    )
    tabulate(found, report)


def study(
    scenario: Scenario, *, stop: float, stop_python: float, rounds: int, say: Callable[[str], None],
    others: Sequence[str] = (),
) -> Native:  # fmt: skip
    """Run the system in all forms, in turns.

    Parameters
    ----------
    stop, stop_python : float [s]
        Simulated time, and that of the Python FMUs, which are slower by orders.
    others : sequence of str
        Importers of `benchmarks.importers.PACKAGES`, which record nothing while they are timed.
    """
    found = Native(scenario.step, stop, stop_python)
    step, n = scenario.step, round(stop / scenario.step)
    own_scenario = with_units(scenario, {"controller": Path(__file__).with_name("own_controller.py")})
    with packed(scenario) as python, packed(scenario, "native") as package, packed(own_scenario, "native") as own:
        folder = package.parent
        container = write_container(package, folder / "container.fmu", step=step)
        empty = write_emptied(package, folder / "empty.ssp")
        empty_container = write_container(empty, folder / "empty.fmu", step=step)
        last: dict[str, Results] = {}
        loop: dict[str, dict[str, np.ndarray]] = {}

        def under_master(case: str, package: Path, stop: float, algorithm: str = "gauss-seidel") -> None:
            isolate = case == ISOLATED
            clock = Clock()
            last[case] = quiet_run(
                package, step=step, stop=stop, algorithm=algorithm, progress=clock.progress, isolate=isolate
            )
            _note(found, case, clock.wall, clock.processor)

        def in_container(case: str, fmu: Path) -> None:
            clock = Clock()
            last[case] = container_run(fmu, stop=stop, step=step, progress=clock.progress)
            _note(found, case, clock.wall, clock.processor)

        def elsewhere(case: str, path: Path, importer: str) -> None:
            chosen = {"parameter_set": "scenario"} if importer == "ecos" else {}
            request = {"run": "timed", "importer": importer, "path": str(path), "step": step, "steps": n}
            _note(found, case, np.divide(ask(request | chosen)["wall"], n), None)

        def in_loop(case: str, path: Path, algorithm: str) -> None:
            with ready(path, algorithm, stop) as exchange:
                plan = Plan(exchange, step)
                wall, _, rows = plan.run(n)
                loop[case] = dict(zip(plan.signals, rows.T, strict=True))
            _note(found, case, wall, None)

        say(f"{rounds} rounds of all forms: {stop:g} s at {step * 1e3:g} ms, Python FMUs {stop_python:g} s")
        quiet_run(python, step=step, stop=20 * step)  # loads what is loaded once
        for _ in range(rounds):
            under_master(PYTHON, python, stop_python)
            under_master(NATIVE, package, stop)
            under_master(OWN, own, stop)
            under_master(ISOLATED, package, stop)
            under_master(JACOBI, package, stop, "jacobi")
            in_container(CONTAINER, container)
            in_loop(LOOP, package, "gauss-seidel")
            in_loop(LOOP_CONTAINER, container, "jacobi")
            under_master(EMPTY, empty, stop)
            in_container(EMPTY_CONTAINER, empty_container)
            for importer in others:
                elsewhere(importer, package, importer)
                elsewhere(f"empty FMUs, {importer}", empty, importer)

        say("parts of a step")
        units: dict[tuple[str, str], list[np.ndarray]] = defaultdict(list)
        inner: dict[tuple[str, str], list[np.ndarray]] = defaultdict(list)
        of_own: dict[tuple[str, str], list[np.ndarray]] = defaultdict(list)
        plans = (
            (package, "gauss-seidel", units), (own, "gauss-seidel", of_own), (container, "jacobi", inner)
        )  # fmt: skip
        for _ in range(rounds):
            for path, algorithm, kept in plans:
                with ready(path, algorithm, stop) as exchange:
                    for name, blocks in Plan(exchange, step).run(n, clocks=True)[1].items():
                        kept[name].append(blocks)
        found.units = {unit: {} for unit in (*UNITS, OWN)}
        controller = {(OWN, what): kept for (unit, what), kept in of_own.items() if unit == "controller"}
        for (unit, what), rounds_of in (units | controller).items():
            if what != "gather":
                found.units[unit][what] = max(least(rounds_of), 0.0)
        found.container = {what: least(rounds_of) for (_, what), rounds_of in inner.items()}
        found.master = interpreter_parts(empty, "gauss-seidel", step, 20 * rounds)

    q = {case: results["plant.q"] for case, results in last.items()}
    shared = min(len(q[PYTHON]), len(q[NATIVE]))
    found.differences = {
        PYTHON: float(np.max(np.abs(q[PYTHON][:shared] - q[NATIVE][:shared]))),
        ISOLATED: float(np.max(np.abs(q[ISOLATED] - q[NATIVE]))),
        OWN: float(np.max(np.abs(q[OWN] - q[NATIVE]))),
        CONTAINER: float(np.max(np.abs(q[CONTAINER] - q[JACOBI]))),
        LOOP: max(float(np.max(np.abs(loop[LOOP][name] - last[NATIVE][name]))) for name in last[NATIVE].names),
    }
    return found


def _note(found: Native, case: str, wall: np.ndarray, processor: np.ndarray | None) -> None:
    found.wall.setdefault(case, []).append(wall)
    if processor is not None:
        found.processor.setdefault(case, []).append(processor)


# ------------------------------------------------------------------ reporting


def tabulate(found: Native, report: Report) -> None:
    """Show and keep the tables and facts."""
    us = 1e6
    table = Table(
        "native",
        f"Tracking at {found.step * 1e3:g} ms in all forms, time of one step [us]",
        [("form", ""), ("simulated [s]", "g"), ("least", ".2f"), ("median", ".2f"), ("processor", ".2f"),
         ("real-time factor", ".1f"), ("times as fast as Python FMUs", ".1f"), ("as native, gauss-seidel", ".2f")],
    )  # fmt: skip
    for case in found.wall:
        time = found.least(case)
        real = "empty" not in case
        processor = found.processor.get(case)
        table.add(
            case, found.stop_python if case == PYTHON else found.stop, us * time, us * median(found.wall[case]),
            us * least(processor) if processor else None, found.step / time if real else None,
            found.ratio(PYTHON, case) if real else None, found.ratio(NATIVE, case),
        )  # fmt: skip
    table.notes += [
        f"Times of the steps alone, of {len(found.wall[NATIVE])} rounds in which all forms take turns. Least: the sum "
        "over a hundred blocks of the run, of each its shortest wall time in any round; processor: the same of the "
        "processor's time; median: of the whole runs. Factor and ratios are of the least.",
        "In a compiled loop: the same calls and copies from C, what remains is the time of the units. "
        "Empty FMUs: the same interface with functions that return at once, what remains is the time of the master.",
        f"Positions differ by at most {found.differences[PYTHON]:.1e} rad between Python and native FMUs, "
        f"{found.differences[CONTAINER]:.1e} rad between container and jacobi; all signals by at most "
        f"{found.differences[LOOP]:.1e} between the compiled loop and the master.",
    ]
    report.show(table)

    parts = Table(
        "native_parts",
        "Where the time of a step goes [us], native FMUs, gauss-seidel",
        [("part", ""), ("set", ".3f"), ("doStep", ".3f"), ("get", ".3f"), ("sum", ".3f"), ("share", ".1%")],
    )
    total = found.least(NATIVE)
    for unit in (*UNITS, OWN):
        own = found.units[unit]
        values = [us * own[k] if k in own else None for k in ("set", "do_step", "get")]
        label = "in controller, a user's file" if unit == OWN else f"in {unit}"
        parts.add(label, *values, us * sum(own.values()), sum(own.values()) / total)
    parts.add("in all units of the package", None, None, None, us * found.in_units, found.in_units / total)
    for key, value in _master(found).items():
        parts.add(f"master: {_LABELS[key]}", None, None, None, us * value, value / total)
    parts.add("total", None, None, None, us * total, 1.0)
    floor = found.master["calls"]
    above = total - found.in_units
    parts.notes += [
        "In the units: clocks around the calls in the compiled loop, less their own cost, least as above. "
        "Master: its parts with empty units, each in a loop; the rest is what they leave of the run.",
        f"{found.master['number of calls']:.0f} FMI calls through ctypes take {us * floor:.2f} us even if they do "
        f"nothing. That is the floor for a master in this interpreter; this one takes {us * above:.2f} us above the "
        f"units, {above / floor:.2f} times the floor.",
        f"Container: {us * sum(found.container.values()):.2f} us inside its library, of which "
        f"{us * found.container['do_step']:.2f} us in doStep and {us * found.container['get']:.2f} us in getReal of "
        f"all outputs; {us * (found.least(CONTAINER) - sum(found.container.values())):.2f} us in the master.",
        f"The controller's law takes {us * found.more_of_own:+.3f} us a step where it comes from a user's file: the "
        f"calls and the copies are the same, and positions differ by {found.differences[OWN]:.0e} rad.",
        f"The units alone take {us * found.in_units:.2f} us, so no form of these FMUs can be more than "
        f"{total / found.in_units:.2f} times as fast as they are under the master.",
    ]
    report.show(parts)
    report.facts |= {
        "us_per_step": {case: us * found.least(case) for case in found.wall},
        "real_time_factor": {case: found.step / found.least(case) for case in (PYTHON, NATIVE, JACOBI, CONTAINER)},
        "native_over_python": found.ratio(PYTHON, NATIVE),
        "container_over_native": found.ratio(NATIVE, CONTAINER),
        "units_us": {unit: {k: us * v for k, v in own.items()} for unit, own in found.units.items()},
        "master_us": {k: us * v for k, v in _master(found).items()},
        "container_us": {k: us * v for k, v in found.container.items()},
        "ctypes_floor_us": us * floor,
        "more_of_own_us": us * found.more_of_own,
        "differences_rad": found.differences,
    }


_LABELS = {"calls": "FMI calls through ctypes", "gather": "gather inputs", "record": "record the row", "rest": "rest"}


def _master(found: Native) -> dict[str, float]:
    """Parts of the master [s], which with the units make up the run."""
    parts = {key: found.master[key] for key in ("calls", "gather", "record")}
    return parts | {"rest": found.least(NATIVE) - found.in_units - sum(parts.values())}
