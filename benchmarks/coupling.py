"""Work and error of the coupled system under the four master algorithms, with and without error control."""

from __future__ import annotations

import numpy as np

from benchmarks.report import Report, Table
from benchmarks.system import packed, quiet_run
from vdfmu.system.package.description import SystemDescription
from vdfmu.system.reference.reference import reference
from vdfmu.system.scenario import load_scenario

TITLE = "Work and precision: the coupled system"
STEPS = {
    "gauss-seidel": (2e-3, 1e-3, 5e-4, 2e-4, 1e-4, 5e-5),
    "jacobi": (1e-3, 5e-4, 2e-4, 1e-4, 5e-5),
    "extrapolated": (1.25e-3, 1e-3, 5e-4, 2e-4, 1e-4),
    "iterative": (5e-3, 4e-3, 2e-3, 1e-3, 5e-4),
}
"""Communication steps [s], the first close to the longest at which the algorithm is stable."""
LONGEST = 5e-3
"""Longest step under error control [s]."""
ERRORS = (1e-3, 1e-4, 1e-5, 1e-6, 1e-7)
TOLERANCE = 1e-9
"""Of the plant's solver; with 1e-11 the errors are the same to two digits."""
GRID = 2e-2
"""Interval of the compared rows [s], a multiple of every step."""
LEVELS = (1e-6, 1e-7, 1e-8)
"""Errors at which the work is compared [rad]."""


def run(report: Report, quick: bool = False) -> None:
    """Run every algorithm at every step, and under error control at every allowed error."""
    scenario = load_scenario("tracking")
    stop, most = (1.0, 3) if quick else (scenario.stop, 9)
    report.say(f"continuous reference over {stop:g} s")
    exact = reference("continuous", SystemDescription(scenario), step=GRID, stop=stop)["plant.q"]
    cases = [(a, None, step) for a, steps in STEPS.items() for step in steps[:most]]
    cases += [("iterative", error, LONGEST) for error in ERRORS[:most]]
    table = Table(
        "coupling", f"Tracking, {stop:g} s, against the continuous closed loop",
        [("method", ""), ("step [ms]", ".4g"), ("allowed error", ".0e"), ("error of q [rad]", ".2e"), ("steps", "d"),
         ("rejected", "d"), ("steps of units", "d")],
        notes=[f"Error: largest over the joints and over rows {1e3 * GRID:g} ms apart. Steps of units include those of "
               "rejected and repeated steps. Under error control the step is the longest allowed."],
    )  # fmt: skip
    points: dict[str, list[tuple[float, int]]] = {}
    with packed(scenario, "native") as package:
        for algorithm, adaptive, step in cases:
            results = quiet_run(
                package,
                step=step,
                stop=stop,
                algorithm=algorithm,
                adaptive=adaptive,
                parameters={"plant.tolerance": TOLERANCE},
            )
            error = float(np.max(np.abs(results["plant.q"][:: round(GRID / step)] - exact)))
            steps = results.summary["steps"]
            counts = {"steps": steps, "rejected": 0, "unit_steps": len(results.summary["order"]) * steps}
            counts |= results.summary.get("communication", {})
            method = algorithm if adaptive is None else f"{algorithm}, adaptive"
            table.add(method, 1e3 * step, adaptive, error, *(counts[k] for k in ("steps", "rejected", "unit_steps")))
            points.setdefault(method, []).append((error, counts["unit_steps"]))
    report.show(table)
    equal = Table(
        "coupling_equal", "Least steps of units for an error, between the measured points",
        [("error [rad]", ".0e"), *((method, ".3g") for method in points)],
    )  # fmt: skip
    for level in LEVELS:
        equal.add(level, *(work_at(each, level) for each in points.values()))
    report.show(equal)


def work_at(points: list[tuple[float, int]], error: float) -> float | None:
    """Least work at which a method has an error of at most `error`, between its points; None: none is as precise.

    A method whose longest stable step is more precise has the work of that step.
    """
    (errors, work) = np.array(sorted(points)).T
    if error < errors[0]:
        return None
    return min(*work[errors <= error], float(np.exp(np.interp(np.log(error), np.log(errors), np.log(work)))))
