"""Order of the co-simulation in its communication step, against the continuous closed loop."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from benchmarks.fit import Exponent, fit_exponent
from benchmarks.report import COLOURS, Report, Table, new_figure, tidy
from benchmarks.system import packed, quiet_run
from vdfmu.cosim.reference import reference
from vdfmu.model import Scenario, load_scenario
from vdfmu.ssp.parameters import system_values

__all__ = ["Convergence", "converge", "run"]

TITLE = "Order in the communication step"
ALGORITHMS = ("gauss-seidel", "jacobi")
STEPS = (1e-3, 5e-4, 2.5e-4, 1.25e-4, 6.25e-5)
"""Communication steps [s]. With the default gains `jacobi` is unstable at 2 ms."""
TOLERANCE = 1e-9
"""Of the plant's solver. With 1e-11 the errors are the same to four digits (seen at 0.25 ms and above)."""
_COLOURS = {"gauss-seidel": COLOURS["blue"], "jacobi": COLOURS["orange"]}
_MARKERS = {"gauss-seidel": "o", "jacobi": "s"}


class Convergence(NamedTuple):
    """Largest differences to the continuous reference on the communication points of the largest step.

    `q` [rad] and `tau_s` [N m], link-side: algorithm to one number a step.
    """

    steps: list[float]
    q: dict[str, list[float]]
    tau_s: dict[str, list[float]]

    def order(self, quantity: str, algorithm: str) -> Exponent:
        """Observed order of ``q`` or ``tau_s``."""
        return fit_exponent(self.steps, getattr(self, quantity)[algorithm])


def run(report: Report, quick: bool = False) -> None:
    """Measure, tabulate and draw."""
    stop = 0.25 if quick else 1.0
    found = converge(load_scenario("tracking"), STEPS, stop, report.say)
    tabulate(found, stop, report)
    report.save(draw(found, stop))


def converge(
    scenario: Scenario, steps: Sequence[float], stop: float, say: Callable[[str], None]
) -> Convergence:
    """Run all steps with both algorithms and compare with one continuous reference.

    Parameters
    ----------
    steps : of which the largest is a multiple of every other
    """
    coarse = max(steps)
    say(f"continuous reference over {stop:g} s")
    exact = reference("continuous", scenario.robot, system_values(scenario), step=coarse, stop=stop)
    n = scenario.robot.n
    q: dict[str, list[float]] = {}
    tau_s: dict[str, list[float]] = {}
    with packed(scenario) as package:
        for algorithm in ALGORITHMS:
            say(f"{algorithm} at {', '.join(f'{1e3 * h:g}' for h in steps)} ms")
            q[algorithm], tau_s[algorithm] = [], []
            for h in steps:
                results = quiet_run(package, step=h, stop=stop, algorithm=algorithm, tolerance=TOLERANCE)
                stride = round(coarse / h)
                q[algorithm].append(float(np.max(np.abs(results.array("plant.q")[::stride] - exact.q))))
                torque = results.array("plant.tau_s")[::stride] - exact.x[:, 3 * n :]
                tau_s[algorithm].append(float(np.max(np.abs(torque))))
    return Convergence(list(steps), q, tau_s)


def tabulate(found: Convergence, stop: float, report: Report) -> None:
    """Show and keep the table and facts."""
    table = Table(
        "order",
        f"Largest difference to the continuous closed loop: tracking, first {stop:g} s",
        [("step [ms]", ".4g"), *[(f"{a} q [rad]", ".2e") for a in ALGORITHMS],
         *[(f"{a} tau_s [N.m]", ".2e") for a in ALGORITHMS], *[(f"{a} q, ratio", ".3f") for a in ALGORITHMS]],
    )  # fmt: skip
    for i, h in enumerate(found.steps):
        ratios = [found.q[a][i - 1] / found.q[a][i] if i else None for a in ALGORITHMS]
        table.add(
            1e3 * h, *[found.q[a][i] for a in ALGORITHMS], *[found.tau_s[a][i] for a in ALGORITHMS], *ratios
        )
    for a in ALGORITHMS:
        q, tau_s = found.order("q", a), found.order("tau_s", a)
        table.notes.append(
            f"{a}: observed order {q.slope:.3f} in q and {tau_s.slope:.3f} in tau_s, over {q.points} steps."
        )
    table.notes.append(
        f"Solver tolerance of the plant {TOLERANCE:g}. Both algorithms hold the torque over a step: order 1. The "
        f"extra delay of jacobi multiplies the error of q by {found.q['jacobi'][-1] / found.q['gauss-seidel'][-1]:.2f}."
    )
    report.show(table)
    report.facts |= {
        "stop_s": stop,
        "steps_s": found.steps,
        "error_q_rad": found.q,
        "error_tau_s_nm": found.tau_s,
        "order_q": {a: found.order("q", a).slope for a in ALGORITHMS},
        "order_tau_s": {a: found.order("tau_s", a).slope for a in ALGORITHMS},
    }


def draw(found: Convergence, stop: float) -> Figure:
    """Errors over the step, log-log, with a triangle of slope 1."""
    figure = new_figure(8.6, 3.9)
    h = 1e3 * np.array(found.steps)
    panels = (("q", "largest error of q [rad]"), ("tau_s", "largest error of the spring torque [N.m]"))
    for i, (quantity, label) in enumerate(panels):
        axes = figure.add_subplot(1, 2, i + 1)
        for a in ALGORITHMS:
            errors = np.array(getattr(found, quantity)[a])
            text = f"{a}: order {found.order(quantity, a).slope:.2f}"
            axes.loglog(
                h, errors, f"{_MARKERS[a]}-", color=_COLOURS[a], markersize=5, linewidth=1.3, label=text
            )
        _triangle(axes, h, np.array(getattr(found, quantity)["gauss-seidel"]))
        axes.set_xlabel("communication step [ms]")
        axes.set_ylabel(label)
        axes.set_xticks(h, [f"{v:.4g}" for v in h])
        tidy(axes)
        axes.legend(loc="upper left", frameon=False, fontsize=8)
    figure.suptitle(
        f"Co-simulation against the continuous closed loop, tracking, first {stop:g} s", x=0.01, ha="left"
    )
    return figure


def _triangle(axes: Axes, h: np.ndarray, errors: np.ndarray) -> None:
    """Slope triangle of order 1 below a curve, over one octave in the middle."""
    right, left = np.sort(h)[-2], np.sort(h)[-3]
    top = 0.62 * errors[np.argsort(h)[-2]]
    bottom = top * left / right
    axes.plot([left, right, right, left], [bottom, bottom, top, bottom], color="#666666", linewidth=0.9)
    style: dict[str, Any] = {"textcoords": "offset points", "fontsize": 8, "color": "#444444"}
    axes.annotate("1", (np.sqrt(left * right), bottom), (0, -9), ha="center", **style)
    axes.annotate("1", (right, np.sqrt(top * bottom)), (4, 0), va="center", **style)
