"""The gradient of a tuning's cost, by differences of runs and by the adjoint of the traced closed loop."""

from __future__ import annotations

import dataclasses
import time
from ctypes import c_int, c_void_p
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from benchmarks.report import COLOURS, Report, Table, new_figure, tidy
from benchmarks.system import packed
from vdfmu.arm.robot import Robot
from vdfmu.arm.robot.structure import values
from vdfmu.arm.units.plant import Plant
from vdfmu.compiler.c.files import kernel_source
from vdfmu.compiler.c.functions import c_prototype
from vdfmu.compiler.c.loaded import SHOWN, loaded
from vdfmu.compiler.functions import traced_function
from vdfmu.compiler.unit.interface import Interface
from vdfmu.engine.run import Simulator
from vdfmu.system.scenario import load_scenario

TITLE = "One gradient of a cost by 12 gains: differences and the adjoint"
MASS = 1.1
"""Factor of the plant's masses: what the feedforward does not know."""
_DRIVER = """
void chain(const double *p, const double *d, const double *gains, double *x, double *u, int m, double *cost)
{{
    for (int k = 0; k < m; k++, d += {d}) {{
        double *at = x + k * {x};
        for (int i = 0; i < {n}; i++) {{
            double e = d[i] - at[i];
            cost[i] += e * e / m;
            u[k * {n} + i] = d[{n} + i] + gains[i] * e + gains[{n} + i] * (d[2 * {n} + i] - at[2 * {n} + i]);
        }}
        step(p, at, u + k * {n}, at + {x});
    }}
}}

void adjoint(const double *p, const double *d, const double *gains, const double *x, const double *u, int m,
             const double *weight, double *gradient)
{{
    double bar[{x}] = {{0}}, before[{x}], torque[{n}];
    for (int k = m - 1; k >= 0; k--) {{
        const double *at = x + k * {x}, *now = d + k * {d};
        step_back(p, at, u + k * {n}, bar, before, torque);
        for (int i = 0; i < {n}; i++) {{
            double e = now[i] - at[i];
            gradient[i] += torque[i] * e;
            gradient[{n} + i] += torque[i] * (now[2 * {n} + i] - at[2 * {n} + i]);
            before[i] -= torque[i] * gains[i] + weight[i] * 2.0 * e / m;
            before[2 * {n} + i] -= torque[i] * gains[{n} + i];
        }}
        memcpy(bar, before, sizeof bar);
    }}
}}
"""


class Chain:
    """The sampled loop of an arm: one step of the plant's solver a communication step, and its adjoint, in C.

    Parameters
    ----------
    robot : Robot
        The plant's.
    step : float [s]
    desired : (m, 3 n) array
        q_d, tau_m and kappa_dot_d at the communication points.
    x_0 : (4 n,) array
        State at the start.
    """

    def __init__(self, robot: Robot, step: float, desired: np.ndarray, x_0: np.ndarray) -> None:
        self.n, self.m, self._ell = robot.n, len(desired), np.asarray(robot.ell, dtype=float)
        whole = Interface(Plant, robot).functions.casadi_function("plant_step")
        sizes = {"p": whole.numel_in(0), "x": 4 * robot.n, "tau": robot.n, "bar": 4 * robot.n}
        p, x, tau, bar = (ca.SX.sym(name, size) for name, size in sizes.items())
        new = whole(p, x, tau, ca.SX.zeros(6), ca.SX.zeros(robot.n), ca.SX.zeros(6), step, 1.0)[0]
        parts = [ca.jtimes(new, argument, bar, True) for argument in (x, tau)]
        functions = [
            traced_function("step", {"p": p, "x": x, "tau": tau}, {"x_new": new}),
            traced_function(
                "step_back",
                {"p": p, "x": x, "tau": tau, "bar": bar},
                {"bar_x": parts[0], "bar_tau": parts[1]},
            ),
        ]
        driver = _DRIVER.format(d=3 * robot.n, x=4 * robot.n, n=robot.n)
        marked = driver.replace("void chain", "SHOWN void chain").replace(
            "void adjoint", "SHOWN void adjoint"
        )
        heads = "".join(f"{c_prototype(f)};\n" for f in functions)
        declared = "".join(
            f"SHOWN {line.split('{')[0].strip()};\n"
            for line in driver.replace("\n             ", " ").splitlines()
            if line.startswith("void")
        )
        files = {f"{f.name()}.c": kernel_source(f).encode() for f in functions}
        files["chain.c"] = ("#include <string.h>\n" + SHOWN + heads + declared + marked).encode()
        self.operations = [f.n_instructions() for f in functions]
        self._library = loaded(files, "gradient")
        self._p, self._desired = values(robot), np.ascontiguousarray(desired)
        self._x, self._u = np.zeros((self.m + 1, 4 * robot.n)), np.zeros((self.m, robot.n))
        self._x[0] = x_0

    def cost(self, gains: np.ndarray) -> np.ndarray:
        """Mean square position error of each joint, (n,), for K_p and K_v, (2 n,)."""
        cost = np.zeros(self.n)
        g = gains / np.tile(self._ell, 2)
        self._call("chain", self._p, self._desired, g, self._x, self._u, self.m, cost)
        return cost

    def gradient(self, gains: np.ndarray, weight: np.ndarray) -> np.ndarray:
        """Return the derivative of ``weight @ cost`` by the gains, (2 n,), along the last run."""
        found = np.zeros(2 * self.n)
        g = gains / np.tile(self._ell, 2)
        self._call("adjoint", self._p, self._desired, g, self._x, self._u, self.m, weight, found)
        return found / np.tile(self._ell, 2)

    def _call(self, name: str, *arguments: Any) -> None:
        function = self._library[name]
        function.argtypes = [c_int if isinstance(a, int) else c_void_p for a in arguments]
        function.restype = None
        function(*(a if isinstance(a, int) else a.ctypes.data for a in arguments))


@dataclass
class Gradients:
    """Times [s] and gradients of one cost."""

    times: dict[str, float]
    found: dict[str, np.ndarray]
    operations: list[int]
    runs: dict[str, float]


def study(name: str, stop: float) -> Gradients:
    """Take the gradient of the sum of mean square errors of a scenario by the gains in all ways."""
    scenario = load_scenario(name)
    n = scenario.arm.n
    gains = np.concatenate(
        [np.asarray(scenario.sections["controller"][key], float) for key in ("K_p", "K_v")]
    )
    mass = (MASS * scenario.arm.mass).tolist()
    names = [f"controller.{key}" for key in ("K_p", "K_v")]

    with packed(scenario, "native") as package, Simulator(package, isolate=False) as simulator:
        record = ["trajectory.q_d*", "feedforward.*", "plant.*"]

        def run_fmus(values_: np.ndarray) -> Any:
            parameters: dict[str, Any] = {
                "plant.mass": mass,
                **dict(zip(names, np.split(values_, 2), strict=True)),
            }
            return simulator.run(parameters=parameters, record=record, step=scenario.step, stop=stop)

        def cost_fmus(values_: np.ndarray) -> float:
            results = run_fmus(values_)
            return float(np.mean((results["trajectory.q_d"] - results["plant.q"])[:-1] ** 2, axis=0).sum())

        results = run_fmus(gains)
        first = {key: results[f"plant.{key}"][0] for key in ("q", "q_dot", "kappa_dot", "tau_s")}
        # the feedforward of the row at the end of a step is that which the step had
        q_d, tau_m, kappa = (
            results[key] for key in ("trajectory.q_d", "feedforward.tau_m", "feedforward.kappa_dot_d")
        )
        desired = np.hstack([q_d[:-1], tau_m[1:], kappa[1:]])
        timed = _Timed()
        found = {
            "differences of the FMUs": timed(
                "differences of the FMUs", lambda: _differences(cost_fmus, gains)
            )
        }
        run_time = timed.once(lambda: cost_fmus(gains))
    robot = scenario.arm
    heavy = dataclasses.replace(robot, mass=MASS * robot.mass)
    chain = Chain(heavy, scenario.step, desired, np.concatenate(list(first.values())))
    weight = np.ones(n)

    def cost(values_: np.ndarray) -> float:
        return float(chain.cost(values_).sum())

    found["differences of the chain"] = timed("differences of the chain", lambda: _differences(cost, gains))

    def adjoint() -> np.ndarray:
        chain.cost(gains)
        return chain.gradient(gains, weight)

    found["adjoint of the chain"] = timed("adjoint of the chain", adjoint)
    runs = {"FMUs": run_time, "chain": timed.once(lambda: cost(gains))}
    return Gradients(timed.times, found, chain.operations, runs)


class _Timed:
    """Runs functions, and keeps the least of three times of each."""

    def __init__(self) -> None:
        self.times: dict[str, float] = {}

    def once(self, function: Any) -> float:
        """Return the least of three times [s]."""
        least = np.inf
        for _ in range(3):
            begin = time.perf_counter()
            self.result = function()
            least = min(least, time.perf_counter() - begin)
        return least

    def __call__(self, name: str, function: Any) -> Any:
        self.times[name] = self.once(function)
        return self.result


def _differences(cost: Any, gains: np.ndarray, share: float = 1e-3) -> np.ndarray:
    """Forward differences, one run more than there are gains."""
    start = cost(gains)
    steps = share * np.diag(gains)
    return np.array([(cost(gains + step) - start) / step.sum() for step in steps])


def run(report: Report, quick: bool) -> None:
    """Measure one gradient by the gains of the tracking scenario, or the planar arm in a quick run."""
    name, stop = ("planar_tracking", 0.5) if quick else ("tracking", 10.0)
    found = study(name, stop)
    best = found.found["adjoint of the chain"]
    table = Table(
        "gradient", f"One gradient by {len(best)} gains, {name}, {stop:g} s",
        (("way", ""), ("time [s]", ".3g"), ("runs of the FMUs", ".3g"), ("largest relative difference", ".1e")),
        notes=[
            f"One run takes {found.runs['FMUs']:.3g} s with the FMUs, {found.runs['chain']:.3g} s as the chain, one "
            "step of the solver a communication step, in C.",
            f"Operations of a step: {found.operations[0]}; of its adjoint: {found.operations[1]}.",
            "Differences: forward, of 0.1 % of each gain. The last column: to the adjoint, of the largest element.",
        ],
    )  # fmt: skip
    for way, seconds in found.times.items():
        error = np.abs(found.found[way] - best).max() / np.abs(best).max()
        table.add(way, seconds, seconds / found.runs["FMUs"], float(error))
    report.show(table)
    report.facts |= {"scenario": name, "stop_s": stop, "times_s": found.times, "runs_s": found.runs}
    figure = new_figure(6.0, 2.0)
    axes = figure.add_subplot()
    axes.barh(list(found.times), list(found.times.values()), color=COLOURS["blue"])
    axes.invert_yaxis()
    axes.set_xlabel("time of one gradient [s]")
    tidy(axes, "x")
    report.save(figure)
