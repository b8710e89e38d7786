"""The native FMUs under the master, with steps in C and in Python, folded into a container, and without their code."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.importer_worker import fmpy_timed, timed
from benchmarks.importers import PACKAGES, ask, missing
from benchmarks.report import Report, Table
from benchmarks.system import container_run, packed, quiet_run, write_emptied
from benchmarks.timing import Clock, least, median
from vdfmu.engine.container import write_container
from vdfmu.engine.run import Results
from vdfmu.system.scenario import Scenario, load_scenario

TITLE = "Native FMUs: real-time factor, and what of a step is the master's"
PYTHON, NATIVE, JACOBI, CONTAINER = (
    "Python FMUs", "native FMUs, gauss-seidel", "native FMUs, jacobi", "container FMU",
)  # fmt: skip
EMPTY = "empty FMUs, gauss-seidel"
FMPY = "container FMU in fmpy"
BY_FMPY = "native FMUs, steps by fmpy"


@dataclass
class Native:
    """Times of one step [s].

    Attributes
    ----------
    wall, processor : dict of case to list of (100,) arrays
        Blocks of each round, see :class:`benchmarks.timing.Clock`; all cases take turns.
    differences : dict of case to float [rad]
        Largest difference of the plant's positions to those of the same algorithm in another form.
    """

    step: float
    stop: float
    stop_python: float
    wall: dict[str, list[np.ndarray]] = field(default_factory=dict)
    processor: dict[str, list[np.ndarray]] = field(default_factory=dict)
    differences: dict[str, float] = field(default_factory=dict)

    def least(self, case: str) -> float:
        """Time of a step, of each block the least over the rounds [s]."""
        return least(self.wall[case])

    def ratio(self, a: str, b: str) -> float:
        """Time of `a` over that of `b`."""
        return self.least(a) / self.least(b)

    @property
    def in_units(self) -> float:
        """Time that the code of the four units takes [s]."""
        return self.least(NATIVE) - self.least(EMPTY)


def run(report: Report, quick: bool = False) -> None:
    """Measure and tabulate."""
    scenario = load_scenario("tracking")
    stop_python = 0.5 if quick else scenario.stop
    times = study(
        scenario,
        stop=2.0 if quick else scenario.stop,
        stop_python=stop_python,
        rounds=3 if quick else 5,
        say=report.say,
        importers=[importer for importer in PACKAGES if not missing(importer)],
    )
    tabulate(times, report)


def study(
    scenario: Scenario, *, stop: float, stop_python: float, rounds: int, say: Callable[[str], None],
    importers: Sequence[str] = (),
) -> Native:  # fmt: skip
    """Run the system in all forms, in turns.

    Parameters
    ----------
    stop, stop_python : float [s]
        Simulated time, and that of the Python FMUs, which are slower by orders.
    importers : sequence of str
        Those of `benchmarks.importers.PACKAGES`, which record nothing while they are timed.
    """
    times = Native(scenario.step, stop, stop_python)
    step, n = scenario.step, round(stop / scenario.step)
    with packed(scenario) as python, packed(scenario, "native") as package:
        folder = package.parent
        container = write_container(package, folder / "container.fmu", step=step)
        empty = write_emptied(package, folder / "empty.ssp")
        last: dict[str, Results] = {}

        def under_master(case: str, package: Path, stop: float, algorithm: str = "gauss-seidel") -> None:
            clock, stepper = Clock(), "fmpy" if case == BY_FMPY else "auto"
            last[case] = quiet_run(
                package, step=step, stop=stop, algorithm=algorithm, progress=clock.progress, isolate=False,
                stepper=stepper,
            )  # fmt: skip
            _note(times, case, clock.wall, clock.processor)

        def in_container(case: str, fmu: Path) -> None:
            clock = Clock()
            last[case] = container_run(fmu, stop=stop, step=step, progress=clock.progress)
            _note(times, case, clock.wall, clock.processor)

        def elsewhere(case: str, path: Path, importer: str) -> None:
            whole: dict[str, Any] = {"path": str(path), "step": step, "steps": n}
            if importer == "fmpy":
                answer = ask(fmpy_timed, **whole)
            else:
                chosen = {"parameter_set": "scenario"} if importer == "ecos" else {}
                answer = ask(timed, importer=importer, **whole, **chosen)
            _note(times, case, *map(np.array, answer))

        say(f"{rounds} rounds of all forms: {stop:g} s at {step * 1e3:g} ms, Python FMUs {stop_python:g} s")
        quiet_run(python, step=step, stop=20 * step)  # loads what is loaded once
        for _ in range(rounds):
            under_master(PYTHON, python, stop_python)
            under_master(NATIVE, package, stop)
            under_master(JACOBI, package, stop, "jacobi")
            in_container(CONTAINER, container)
            elsewhere(FMPY, container, "fmpy")
            under_master(BY_FMPY, package, stop)
            under_master(EMPTY, empty, stop)
            for importer in importers:
                elsewhere(importer, package, importer)

    q = {case: results["plant.q"] for case, results in last.items()}
    shared = min(len(q[PYTHON]), len(q[NATIVE]))
    times.differences = {
        PYTHON: float(np.max(np.abs(q[PYTHON][:shared] - q[NATIVE][:shared]))),
        CONTAINER: float(np.max(np.abs(q[CONTAINER] - q[JACOBI]))),
        BY_FMPY: max(float(np.max(np.abs(last[BY_FMPY][x] - last[NATIVE][x]))) for x in last[NATIVE].names),
    }
    return times


def _note(times: Native, case: str, wall: np.ndarray, processor: np.ndarray) -> None:
    times.wall.setdefault(case, []).append(wall)
    times.processor.setdefault(case, []).append(processor)


# ------------------------------------------------------------------ reporting


def tabulate(times: Native, report: Report) -> None:
    """Show and keep the table."""
    us = 1e6
    table = Table(
        "native",
        f"Tracking at {times.step * 1e3:g} ms in all forms, time of one step [us]",
        [("form", ""), ("simulated [s]", "g"), ("least", ".2f"), ("median", ".2f"), ("processor", ".2f"),
         ("real-time factor", ".1f"), ("times as fast as Python FMUs", ".1f"), ("as native, gauss-seidel", ".2f")],
    )  # fmt: skip
    for case in times.wall:
        time = times.least(case)
        real = "empty" not in case
        table.add(
            case, times.stop_python if case == PYTHON else times.stop, us * time, us * median(times.wall[case]),
            us * least(times.processor[case]), times.step / time if real else None,
            times.ratio(PYTHON, case) if real else None, times.ratio(NATIVE, case),
        )  # fmt: skip
    table.notes += [
        f"Times of the steps alone, of {len(times.wall[NATIVE])} rounds in which all forms take turns. Least: the sum "
        "over a hundred blocks of the run, of each its shortest wall time in any round; processor: the same of the "
        "processor's time; median: of the whole runs. Factor and ratios are of the least.",
        "Empty FMUs: the same interface with functions that return at once, what remains is the time of the master. "
        f"The code of the units takes {us * times.in_units:.2f} us, and all else {us * times.least(EMPTY):.2f} us.",
        f"Positions differ by at most {times.differences[PYTHON]:.1e} rad between Python and native FMUs, "
        f"{times.differences[CONTAINER]:.1e} rad between container and jacobi; all signals by at most "
        f"{times.differences[BY_FMPY]:.1e} between steps in C and by fmpy.",
    ]
    report.show(table)
