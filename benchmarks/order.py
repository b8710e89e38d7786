"""Order of the co-simulation in its communication step, against the continuous closed loop."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from benchmarks.fit import Exponent, fit_exponent
from benchmarks.report import COLOURS, Report, Table, new_figure, tidy
from benchmarks.system import packed, quiet_run
from vdfmu.compiler.c.compile import native_available
from vdfmu.system.package.description import SystemDescription
from vdfmu.system.reference.reference import reference
from vdfmu.system.scenario import Scenario, load_scenario

TITLE = "Order in the communication step"
ALGORITHMS = ("gauss-seidel", "jacobi", "extrapolated", "iterative")
EXPECTED: dict[str, int] = dict(zip(ALGORITHMS, (1, 1, 2, 2), strict=True))
"""Order that each algorithm has by its derivation, in `docs/cosimulation.md`."""
_SHORT = (1e-3, 5e-4, 2.5e-4, 1.25e-4, 6.25e-5)
STEPS: dict[str, Sequence[float]] = dict(
    zip(ALGORITHMS, (_SHORT, _SHORT, _SHORT, (4e-3, 2e-3, 1e-3, 5e-4)), strict=True)
)
"""Communication steps [s]. With the default gains `gauss-seidel` is unstable at 4 ms, `jacobi` and `extrapolated` at
2 ms. Those of `iterative` are longer: its error is the first to come down to that of the start, where the rotors take
up speed within 0.03 ms, which no step resolves. Below 0.5 ms that is most of its error of tau_s."""
TOLERANCE = 1e-10
"""Of the plant's solver."""
CONVERGENCE = 1e-10
"""Of `iterative`: with the default of 1e-8 the change that is left is a tenth of its error at 0.5 ms."""
_MARKS = {
    "gauss-seidel": (COLOURS["blue"], "o"), "jacobi": (COLOURS["orange"], "s"),
    "extrapolated": (COLOURS["green"], "^"), "iterative": ("#7a4ea3", "D"),
}  # fmt: skip


class Convergence(NamedTuple):
    """Largest differences to the continuous reference on the communication points of the largest step of all.

    `q` [rad] and `tau_s` [N m], link-side: algorithm to one number for each of its `steps` [s].
    """

    steps: dict[str, list[float]]
    q: dict[str, list[float]]
    tau_s: dict[str, list[float]]

    def order(self, quantity: str, algorithm: str) -> Exponent:
        """Observed order of ``q`` or ``tau_s``."""
        return fit_exponent(self.steps[algorithm], getattr(self, quantity)[algorithm])


def run(report: Report, quick: bool = False) -> None:
    """Measure, tabulate and draw."""
    stop = 0.2 if quick else 1.0
    found = converge(load_scenario("tracking"), STEPS, stop, report.say)
    tabulate(found, stop, report)
    report.save(draw(found, stop))


def converge(
    scenario: Scenario, steps: Mapping[str, Sequence[float]], stop: float, say: Callable[[str], None]
) -> Convergence:
    """Run all algorithms with their steps and compare with one continuous reference.

    Native FMUs where they can be built, else Python FMUs: the errors are those of the algorithms.

    Parameters
    ----------
    steps : of which the largest is a multiple of every other
    """
    coarse = max(h for each in steps.values() for h in each)
    say(f"continuous reference over {stop:g} s")
    exact = reference("continuous", SystemDescription(scenario), step=coarse, stop=stop)
    q: dict[str, list[float]] = {}
    tau_s: dict[str, list[float]] = {}
    with packed(scenario, "native" if native_available() else "python") as package:
        for algorithm, each in steps.items():
            say(f"{algorithm} at {', '.join(f'{1e3 * h:g}' for h in each)} ms")
            q[algorithm], tau_s[algorithm] = [], []
            for h in each:
                results = quiet_run(
                    package, step=h, stop=stop, algorithm=algorithm, tolerance=TOLERANCE,
                    convergence=CONVERGENCE if algorithm == "iterative" else None,
                )  # fmt: skip
                stride = round(coarse / h)
                for name, errors in (("plant.q", q), ("plant.tau_s", tau_s)):
                    difference = results[name][::stride] - exact[name]
                    errors[algorithm].append(float(np.max(np.abs(difference))))
    return Convergence({a: list(each) for a, each in steps.items()}, q, tau_s)


def tabulate(found: Convergence, stop: float, report: Report) -> None:
    """Show and keep the tables and facts."""
    table = Table(
        "order",
        f"Largest difference to the continuous closed loop: tracking, first {stop:g} s",
        [("step [ms]", ".4g"), *[(f"{a} q [rad]", ".2e") for a in ALGORITHMS],
         *[(f"{a} tau_s [N.m]", ".2e") for a in ALGORITHMS]],
    )  # fmt: skip
    for h in sorted({h for each in found.steps.values() for h in each}, reverse=True):
        at = {a: found.steps[a].index(h) if h in found.steps[a] else None for a in ALGORITHMS}
        table.add(1e3 * h, *[
            None if (i := at[a]) is None else values[a][i] for values in (found.q, found.tau_s) for a in ALGORITHMS
        ])  # fmt: skip
    table.notes += [
        f"Solver tolerance of the plant {TOLERANCE:g}, convergence of iterative {CONVERGENCE:g}, tolerance of the "
        "reference 1e-11: all below the errors of the coupling shown.",
        "gauss-seidel is unstable at 4 ms, jacobi and extrapolated at 2 ms. The steps of iterative are longer: its "
        "error is the first to come down to that of the start, where the rotors take up speed within 0.03 ms.",
    ]
    report.show(table)
    orders = Table(
        "order_observed",
        "Observed order: slope of log error over log step",
        [("algorithm", ""), ("derived", "d"), ("q", ".3f"), ("tau_s", ".3f"), ("steps [ms]", ""),
         ("q at 1 ms [rad]", ".2e"), ("of gauss-seidel", ".2g")],
    )  # fmt: skip
    for a in ALGORITHMS:
        error, first = (found.q[name][found.steps[name].index(1e-3)] for name in (a, ALGORITHMS[0]))
        orders.add(
            a, EXPECTED[a], found.order("q", a).slope, found.order("tau_s", a).slope,
            f"{1e3 * max(found.steps[a]):g} to {1e3 * min(found.steps[a]):g}", error, error / first,
        )  # fmt: skip
    orders.notes.append(
        "gauss-seidel and jacobi hold the torque over a step: order 1. extrapolated and iterative take the inputs as "
        "lines: order 2."
    )
    report.show(orders)
    report.facts |= {
        "stop_s": stop,
        "steps_s": found.steps,
        "error_q_rad": found.q,
        "error_tau_s_nm": found.tau_s,
        "order_q": {a: found.order("q", a).slope for a in ALGORITHMS},
        "order_tau_s": {a: found.order("tau_s", a).slope for a in ALGORITHMS},
    }


def draw(found: Convergence, stop: float) -> Figure:
    """Errors over the step, log-log, with triangles of slopes 1 and 2."""
    figure = new_figure(8.6, 4.4)
    panels = (("q", "largest error of q [rad]"), ("tau_s", "largest error of the spring torque [N.m]"))
    ticks = sorted({1e3 * h for each in found.steps.values() for h in each})
    for i, (quantity, label) in enumerate(panels):
        axes = figure.add_subplot(1, 2, i + 1)
        for a, (colour, mark) in _MARKS.items():
            errors = np.array(getattr(found, quantity)[a])
            h = 1e3 * np.array(found.steps[a])
            text = f"{a}: order {found.order(quantity, a).slope:.2f}"
            axes.loglog(h, errors, f"{mark}-", color=colour, markersize=5, linewidth=1.3, label=text)
            if a != "jacobi":
                triangle(axes, h, errors, EXPECTED[a])
        axes.set_xlabel("communication step [ms]")
        axes.set_ylabel(label)
        axes.set_xticks(ticks, [f"{v:.3g}" for v in ticks], fontsize=8)
        axes.set_ylim(top=axes.get_ylim()[1] * 30)  # room for the legend
        tidy(axes)
        axes.legend(loc="upper left", frameon=False, fontsize=8, ncols=2, columnspacing=1.0)
    figure.suptitle(
        f"Co-simulation against the continuous closed loop, tracking, first {stop:g} s", x=0.01, ha="left"
    )
    return figure


def triangle(axes: Axes, h: np.ndarray, errors: np.ndarray, order: int) -> None:
    """Slope triangle below a curve, over the second shortest of its intervals."""
    places = np.argsort(h)[1:3]
    left, right = h[places]
    top = 0.6 * errors[places[1]]
    bottom = top * (left / right) ** order
    axes.plot([left, right, right, left], [bottom, bottom, top, bottom], color="#666666", linewidth=0.9)
    style: dict[str, Any] = {"textcoords": "offset points", "fontsize": 8, "color": "#444444"}
    axes.annotate("1", (np.sqrt(left * right), bottom), (0, -9), ha="center", **style)
    axes.annotate(f"{order}", (right, np.sqrt(top * bottom)), (4, 0), va="center", **style)
