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
from benchmarks.timing import Clock
from vdfmu.engine.run import Results
from vdfmu.system.scenario import Scenario, load_scenario

TITLE = "Native FMUs in all forms, and what of a step is the master's"
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
    blocks : dict of case to list of (100,) arrays
        Processor times of each round, see :class:`benchmarks.timing.Clock`; all cases take turns.
    differences : dict of case to float [rad]
        Largest difference of the plant's positions to those of the same algorithm in another form.
    """

    blocks: dict[str, list[np.ndarray]] = field(default_factory=dict)
    differences: dict[str, float] = field(default_factory=dict)

    def least(self, case: str) -> float:
        """Time of a step, of each block the least over the rounds [s]."""
        return float(np.sum(np.min(self.blocks[case], axis=0)))


def run(report: Report, quick: bool = False) -> None:
    """Measure and tabulate."""
    scenario = load_scenario("tracking")
    importers = [importer for importer in PACKAGES if not missing(importer)]
    stop, stop_python, rounds = (2.0, 0.5, 3) if quick else (scenario.stop, scenario.stop, 5)
    times = study(scenario, stop=stop, stop_python=stop_python, rounds=rounds, say=report.say, importers=importers)
    table = Table(
        "native", f"Tracking at {1e3 * scenario.step:g} ms in all forms",
        [("form", ""), ("processor time of a step [us]", ".2f"), ("over steps by fmpy", ".2f")],
    )  # fmt: skip
    for case in times.blocks:
        table.add(case, 1e6 * times.least(case), times.least(case) / times.least(BY_FMPY))
    table.notes += [
        f"Processor times of the steps alone, of {rounds} rounds in which all forms take turns: the sum over a hundred "
        "blocks of the run, of each its shortest in any round.",
        "Empty FMUs: the same interface with functions that return at once, what remains is the time of the master.",
        f"Positions differ by at most {times.differences[PYTHON]:.1e} rad between Python and native FMUs, "
        f"{times.differences[CONTAINER]:.1e} rad between container and jacobi; all signals by at most "
        f"{times.differences[BY_FMPY]:.1e} between steps in C and by fmpy.",
    ]
    report.show(table)


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
    from vdfmu.extras.container import write_container

    times = Native()
    step, n = scenario.step, round(stop / scenario.step)
    with packed(scenario) as python, packed(scenario, "native") as package:
        folder = package.parent
        container = write_container(package, folder / "container.fmu", step=step)
        empty = write_emptied(package, folder / "empty.ssp")
        last: dict[str, Results] = {}

        def note(case: str, blocks: Any) -> None:
            times.blocks.setdefault(case, []).append(np.asarray(blocks))

        def under_master(case: str, package: Path, stop: float, algorithm: str = "gauss-seidel") -> None:
            clock, stepper = Clock(), "fmpy" if case == BY_FMPY else "auto"
            last[case] = quiet_run(
                package, step=step, stop=stop, algorithm=algorithm, progress=clock.progress, isolate=False,
                stepper=stepper,
            )  # fmt: skip
            note(case, clock.blocks)

        def in_container(case: str, fmu: Path) -> None:
            clock = Clock()
            last[case] = container_run(fmu, stop=stop, step=step, progress=clock.progress)
            note(case, clock.blocks)

        def elsewhere(case: str, path: Path, importer: str) -> None:
            whole: dict[str, Any] = {"path": str(path), "step": step, "steps": n}
            if importer == "fmpy":
                answer = ask(fmpy_timed, **whole)
            else:
                whole["parameter_set"] = "scenario" if importer == "ecos" else None
                answer = ask(timed, importer=importer, **whole)
            note(case, answer)

        say(f"{rounds} rounds of all forms: {stop:g} s at {step * 1e3:g} ms, Python FMUs {stop_python:g} s")
        quiet_run(python, step=step, stop=20 * step, algorithm="gauss-seidel")  # loads what is loaded once
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
