"""How the cost of inverse dynamics grows with the number of joints: VD, Newton-Euler and Lagrange."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import casadi as ca
import numpy as np
from matplotlib.figure import Figure

from benchmarks.chains import counting_chain, random_motion, repeated_link
from benchmarks.counting import Count, Counter, count_operations
from benchmarks.fit import Exponent, Polynomial, exact_polynomial, fit_exponent, upper_half
from benchmarks.lagrange import lagrange_inverse_dynamics
from benchmarks.report import COLOURS, Report, Table, new_figure, tidy
from benchmarks.timing import Case, measure
from vdfmu.arm.equations.inverse_dynamics import inverse_dynamics
from vdfmu.arm.equations.newton_euler import newton_euler
from vdfmu.arm.robot import Robot
from vdfmu.arm.robot.structure import symbolic_robot, values
from vdfmu.compiler.functions import KernelFunction
from vdfmu.compiler.scalar.symbol import from_sx, to_sx

TITLE = "Growth of inverse dynamics with the number of joints"
FORMULATIONS: dict[str, Callable[..., np.ndarray]] = {
    "VD": inverse_dynamics,
    "Newton-Euler": newton_euler,
    "Lagrange": lagrange_inverse_dynamics,
}
_COLOURS = {"VD": COLOURS["blue"], "Newton-Euler": COLOURS["orange"], "Lagrange": COLOURS["green"]}
_MARKERS = {"VD": "o", "Newton-Euler": "s", "Lagrange": "^"}
_JOINTS = (1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64, 96)
_SMALL = (1, 2, 3, 4, 5, 6, 7, 8)
"""Lengths at which operations are counted besides the measured ones, for the exact polynomials."""


@dataclass
class Growth:
    """What was measured at every number of joints: formulation to {n: value}."""

    plain: dict[str, dict[int, float]] = field(default_factory=dict)
    generated: dict[str, dict[int, float]] = field(default_factory=dict)
    instructions: dict[str, dict[int, int]] = field(default_factory=dict)
    counts: dict[str, dict[int, Count]] = field(default_factory=dict)
    trace_s: dict[str, dict[int, float]] = field(default_factory=dict)
    samples: int = 0
    disagreement: float = 0.0


def trace(equations: Callable[..., np.ndarray], robot: Robot) -> ca.Function:
    """Trace a formulation as the kernel does: numbers of the robot stay parameters, rotations are folded."""
    symbols, p = symbolic_robot(robot)
    inputs = {name: ca.SX.sym(name, robot.n) for name in ("q", "q_dot", "q_ddot")}
    tau = equations(symbols, *[np.atleast_1d(from_sx(v)) for v in inputs.values()])
    inputs["p"] = p
    return ca.Function(
        "tau", list(inputs.values()), [ca.cse(ca.densify(to_sx(tau)))], list(inputs), ["tau"], {"cse": False}
    )


def count(name: str, n: int) -> Count:
    """Operations of a formulation for a chain of `n` joints."""

    def equations(counter: Counter) -> Any:
        motion = [counter.array(n) for _ in range(3)]
        return FORMULATIONS[name](counting_chain(n, counter), *motion)

    return count_operations(equations)


def run(report: Report, quick: bool = False) -> None:
    """Measure, tabulate and draw."""
    joints = [n for n in _JOINTS if n <= (16 if quick else 96)]
    traced = {name: joints for name in FORMULATIONS} | {
        "Lagrange": [n for n in joints if n <= (6 if quick else 12)]
    }
    counted = {name: joints for name in FORMULATIONS} | {"Lagrange": [n for n in joints if n <= 32]}
    rounds = 10 if quick else 40
    growth = grow(joints, traced, counted, rounds, 0.5 if quick else 3.0, report.say)
    tabulate(growth, report, rounds)
    report.save(draw(growth))


def grow(
    joints: Sequence[int],
    traced: dict[str, list[int]],
    counted: dict[str, list[int]],
    rounds: int,
    limit: float,
    say: Callable[[str], None],
) -> Growth:
    """Measure all formulations.

    Parameters
    ----------
    joints : lengths of the chains
    traced, counted : formulation to the lengths at which it is traced, and at which operations are counted
    rounds, limit : see :func:`benchmarks.timing.measure`
    """
    growth = Growth()
    for name in FORMULATIONS:
        lengths = sorted({*counted[name], *_SMALL})
        say(f"{name}: counting operations for n = {lengths[0]} to {lengths[-1]}")
        growth.counts[name] = {n: count(name, n) for n in lengths}

    plain: dict[tuple[str, int], Case] = {}
    generated: dict[tuple[str, int], Case] = {}
    functions: dict[tuple[str, int], KernelFunction] = {}
    robots = {n: repeated_link(n) for n in joints}
    for name, equations in FORMULATIONS.items():
        growth.instructions[name], growth.trace_s[name] = {}, {}
        if traced[name]:
            say(f"{name}: tracing for n = {traced[name][0]} to {traced[name][-1]}")
        for n in joints:
            robot, motion = robots[n], random_motion(n)
            plain[name, n] = Case(f"{name} {n}", lambda f=equations, r=robot, m=motion: f(r, *m))
            if n not in traced[name]:
                continue
            began = time.perf_counter()
            function = KernelFunction(trace(equations, robot))
            growth.trace_s[name][n] = time.perf_counter() - began
            for argument, value in zip(("q", "q_dot", "q_ddot", "p"), (*motion, values(robot)), strict=True):
                function.args[argument][:] = value
            growth.instructions[name][n] = function.function.n_instructions()
            functions[name, n] = function
            generated[name, n] = Case(f"{name} {n} generated", function.run, function)

    say("timing, in turns")
    measure([*generated.values(), *plain.values()], rounds, limit=limit)
    growth.disagreement = _disagreement(functions, robots)
    for name in FORMULATIONS:
        growth.plain[name] = {n: plain[name, n].best for n in joints}
        growth.generated[name] = {n: generated[name, n].best for n in joints if (name, n) in generated}
    growth.samples = min(case.samples for case in [*plain.values(), *generated.values()])
    return growth


def _disagreement(functions: dict[tuple[str, int], KernelFunction], robots: dict[int, Robot]) -> float:
    """Largest difference of any formulation and form to plain VD, relative to the largest torque."""
    worst = 0.0
    for n, robot in robots.items():
        q, q_dot, q_ddot = motion = random_motion(n)
        expected = inverse_dynamics(robot, q, q_dot, q_ddot)
        torques = [f.results["tau"] for (_, k), f in functions.items() if k == n]
        if n <= 24:  # beyond, plain Lagrange costs seconds
            torques += [equations(robot, *motion) for equations in FORMULATIONS.values()]
        for tau in torques:
            worst = max(worst, float(np.max(np.abs(tau - expected)) / np.max(np.abs(expected))))
    return worst


# -------------------------------------------------------------------- tables


def _exponents(growth: Growth) -> dict[str, dict[str, tuple[Exponent, Polynomial | None]]]:
    """Quantity to formulation to its exponent over the upper half, and the exact polynomial of counts."""
    found: dict[str, dict[str, tuple[Exponent, Polynomial | None]]] = {}
    quantities: dict[str, dict[str, dict[int, Any]]] = {
        "time, plain numpy": growth.plain,
        "time, generated": growth.generated,
        "instructions, generated": growth.instructions,
        "multiplications": {
            k: {n: c.multiplications for n, c in v.items()} for k, v in growth.counts.items()
        },
        "additions": {k: {n: c.additions for n, c in v.items()} for k, v in growth.counts.items()},
    }
    for quantity, formulations in quantities.items():
        found[quantity] = {}
        for name, by_n in formulations.items():
            if len(by_n) < 3:
                continue
            n = sorted(by_n)
            exact = None if "time" in quantity else _polynomial(n, [by_n[k] for k in n])
            if exact is not None and name in growth.counts and "instructions" not in quantity:
                by_n = {k: by_n.get(k, exact(k)) for k in growth.plain[name]}
            measured = [k for k in sorted(by_n) if k in growth.plain[name]]
            found[quantity][name] = (
                fit_exponent(*upper_half(measured, [float(by_n[k]) for k in measured])),
                exact,
            )
    return found


def _polynomial(n: list[int], y: list[int]) -> Polynomial | None:
    """Exact polynomial through all points, or all but the first: a single link has no coupling terms."""
    return exact_polynomial(n, y) or exact_polynomial(n[1:], y[1:])


def tabulate(growth: Growth, report: Report, rounds: int) -> None:
    """Show and keep tables and facts."""
    names = list(FORMULATIONS)
    joints = sorted(growth.plain["VD"])
    found = _exponents(growth)

    columns = [("n", "d"), *[(f"{k} [ms]", ".3f") for k in names]]
    times = Table("growth_plain", "Inverse dynamics in plain numpy", columns)
    for n in joints:
        times.add(n, *[1e3 * growth.plain[k][n] for k in names])
    times.notes.append(
        f"Least processor time of {rounds} samples of 2 ms or more, fewer for the slow ({growth.samples} for the "
        "slowest); all cases in turns."
    )
    report.show(times)

    longest = max(growth.generated["Lagrange"], default=0)
    generated = Table(
        "growth_generated",
        "Inverse dynamics generated: CasADi function called through its buffer",
        [("n", "d"), *[(f"{k} [us]", ".2f") for k in names], *[(f"{k} instr.", "d") for k in names]],
    )
    for n in joints:
        seconds = [growth.generated[k].get(n) for k in names]
        instructions = [growth.instructions[k].get(n) for k in names]
        generated.add(n, *[None if t is None else 1e6 * t for t in seconds], *instructions)
    took = growth.trace_s["Lagrange"].get(longest, 0.0)
    generated.notes += [
        f"Lagrange is traced up to n = {longest} only: that took {took:.1f} s, and grows like its instructions.",
        f"All forms give the torques of plain VD to {growth.disagreement:.0e} of the largest torque.",
    ]
    report.show(generated)

    shown = sorted({n for k in names for n in growth.counts[k] if n in joints})
    operations = Table(
        "growth_operations",
        "Operations of the equations as written, counted",
        [("n", "d"), *[(f"{k} mult.", ",d") for k in names], *[(f"{k} add.", ",d") for k in names]],
    )
    polynomials = {k: (found["multiplications"][k][1], found["additions"][k][1]) for k in names}
    for n in shown:
        row: list[Any] = [n]
        for i in range(2):
            for k in names:
                p = polynomials[k][i]
                row.append(
                    growth.counts[k][n][i] if n in growth.counts[k] else int(p(n)) if p is not None else None
                )
        operations.add(*row)
    last = max(growth.counts["Lagrange"])
    operations.notes.append(
        "Counted by running the equations on a scalar that counts; products with the zeros of dense matrices "
        f"count, as numpy does them. Lagrange beyond n = {last}: from its polynomial."
    )
    for k in names:
        for what, p in zip(("multiplications", "additions"), polynomials[k], strict=True):
            if p is not None:
                operations.notes.append(f"{k} {what}: {p}, exact at {p.checked + p.degree + 1} values of n.")
    report.show(operations)

    exponents = Table(
        "growth_exponents",
        "Growth exponents: slope of log(quantity) over log(n), upper half of the measured n",
        [("quantity", ""), ("formulation", ""), ("slope", ".3f"), ("std. error", ".3f"), ("points", "d"),
         ("n", ""), ("degree of exact polynomial", "d")],
    )  # fmt: skip
    facts: dict[str, Any] = {}
    for quantity, formulations in found.items():
        for name, (fit, exact) in formulations.items():
            degree = exact.degree if exact is not None else None
            exponents.add(quantity, name, fit.slope, fit.error, fit.points, fit.range, degree)
            facts.setdefault(quantity, {})[name] = {
                "slope": fit.slope, "standard_error": fit.error, "points": fit.points, "n": [fit.low, fit.high],
                "polynomial": None if exact is None else str(exact), "degree": degree,
            }  # fmt: skip
    exponents.notes += _remarks(growth, found)
    report.show(exponents)
    report.facts |= {
        "exponents": facts,
        "plain_s": growth.plain,
        "generated_s": growth.generated,
        "instructions": growth.instructions,
        "disagreement": growth.disagreement,
    }


def _remarks(growth: Growth, found: dict[str, dict[str, tuple[Exponent, Polynomial | None]]]) -> list[str]:
    """Say what the exponents show, and what hides them."""
    remarks: list[str] = []
    products = {name: exact for name, (_, exact) in found["multiplications"].items()}
    if all(p is not None for p in products.values()):
        degrees = ", ".join(f"{name} {p.degree}" for name, p in products.items() if p is not None)
        remarks.append(
            "The paper says that VD grows linearly and Lagrange with the fourth power of n. Degrees of the exact "
            f"polynomials of multiplications: {degrees}."
        )
    plain = found["time, plain numpy"]["Lagrange"][0]
    if plain.slope < 3.8:
        remarks.append(
            f"Plain Lagrange takes time with a slope of {plain.slope:.2f} only: it calls numpy in the order of n^3 "
            "times on small arrays, and that hides the n^4 multiplications in its matrix products up to the longest "
            "chain measured."
        )
    exact = products.get("Lagrange")
    if exact is not None and exact.degree == 4:
        last = max(growth.plain["Lagrange"])
        share = float(exact.coefficients[4] * last**4 / exact(last))
        remarks.append(f"At n = {last} the fourth-power term is {share:.0%} of Lagrange's multiplications.")
    instructions = found["instructions, generated"].get("Lagrange")
    if instructions is not None:
        remarks.append(
            f"Generated Lagrange is seen on {instructions[0].points} short chains only (n = {instructions[0].range}), "
            "where the lower powers still weigh: its slope is no limit."
        )
    return remarks


# ------------------------------------------------------------------- picture


def draw(growth: Growth) -> Figure:
    """Draw times of both forms and counted multiplications over n, log-log, with the fitted lines."""
    found = _exponents(growth)
    figure = new_figure(11.0, 4.2)
    panels: list[tuple[str, str, str, dict[str, dict[int, float]]]] = [
        ("plain numpy", "time, plain numpy", "time of one call [ms]", _scaled(growth.plain, 1e3)),
        ("generated", "time, generated", "time of one call [µs]", _scaled(growth.generated, 1e6)),
        ("operations as written", "multiplications", "multiplications", _multiplications(growth)),
    ]
    scale = {"time, plain numpy": 1e3, "time, generated": 1e6, "multiplications": 1.0}
    for i, (title, quantity, label, series) in enumerate(panels):
        axes = figure.add_subplot(1, 3, i + 1)
        for name, by_n in series.items():
            n = np.array(sorted(by_n))
            y = np.array([by_n[k] for k in n])
            fit = found[quantity].get(name)
            text = name if fit is None else f"{name}: slope {fit[0].slope:.2f}"
            if fit is not None and fit[1] is not None:
                text += f", degree {fit[1].degree}"
            axes.loglog(n, y, _MARKERS[name], color=_COLOURS[name], markersize=4.5, label=text, zorder=3)
            axes.loglog(n, y, "-", color=_COLOURS[name], linewidth=0.8, alpha=0.5)
            if fit is not None:
                ends = np.array([fit[0].low, fit[0].high])
                line = scale[quantity] * np.array([fit[0].at(v) for v in ends])
                axes.loglog(ends, line, "-", color=_COLOURS[name], linewidth=2.2, alpha=0.55)
        axes.set_title(title, loc="left")
        axes.set_xlabel("number of joints n")
        axes.set_ylabel(label)
        ticks = [t for t in (1, 2, 4, 8, 16, 32, 64) if t <= max(growth.plain["VD"])]
        axes.set_xticks(ticks, [str(t) for t in ticks])
        tidy(axes)
        low, high = axes.get_ylim()
        axes.set_ylim(low, high * (high / low) ** 0.12)  # room for the legend
        axes.legend(loc="upper left", frameon=False, fontsize=8, handletextpad=0.2, borderaxespad=0.2)
    figure.supxlabel(
        "thick lines: fitted slopes, upper half of the measured n",
        fontsize=8,
        color="#666666",
        x=0.01,
        ha="left",
    )
    return figure


def _scaled(series: dict[str, dict[int, float]], factor: float) -> dict[str, dict[int, float]]:
    return {name: {n: factor * v for n, v in by_n.items()} for name, by_n in series.items()}


def _multiplications(growth: Growth) -> dict[str, dict[int, float]]:
    """Return counts at the measured lengths; beyond the counted ones from the exact polynomial."""
    out: dict[str, dict[int, float]] = {}
    for name, counts in growth.counts.items():
        n = sorted(counts)
        exact = _polynomial(n, [counts[k].multiplications for k in n])
        out[name] = {
            k: float(counts[k].multiplications if k in counts else exact(k) if exact is not None else np.nan)
            for k in sorted(growth.plain[name])
        }
    return out
