"""The shortest motion of the planar arm by IPOPT: through CasADi's importer of FMUs, and through the trace itself."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from benchmarks.report import Report, Table
from benchmarks.timing import processor_time
from vdfmu.arm.fmus import build_fmus
from vdfmu.arm.robot import Robot, load_robot
from vdfmu.arm.units import shipped_units
from vdfmu.compiler.unit.program import UnitFunctions

TITLE = "The shortest motion through an FMU"
ROBOT = "planar_2dof"
INTERVALS = 15
FROM, TO = (0.3, -0.5), (0.9, 0.2)
"""Positions of the links [rad] at which the arm rests."""
MOST = 1.0
"""Limit of the motor torques [N.m]."""


def traced_rate(robot: Robot) -> ca.Function:
    """Return ``rate(x, u)`` of the plant as it is traced: states and their derivatives, u = (tau, F_e)."""
    function = UnitFunctions(shipped_units()["plant"], robot).casadi_function("plant_derivatives")
    x, tau, F_e = (ca.SX.sym(name, function.size1_in(name)) for name in ("x", "tau", "F_e"))
    rate = function(robot.values(), x, tau, F_e)
    return ca.Function("rate", [x, ca.vertcat(tau, F_e)], [rate], ["x", "u"], ["ode"])


def imported_rate(fmu: Path, **options: Any) -> ca.Function:
    """Return the same of the plant's FMU in CasADi's importer.

    Without ``new_forward`` derivatives along a direction are products with the Jacobian. The importer's own, as of
    CasADi 3.8.2, repeats the last answer where a direction is all zero.
    """
    return ca.DaeBuilder("plant", str(fmu), {}).create("rate", ["x", "u"], ["ode"], {"new_forward": False} | options)


def shortest_motion(rate: ca.Function, exact_hessian: bool = False) -> tuple[NDArray[np.float64], dict[str, Any]]:
    """Solve for the shortest motion from rest to rest by direct collocation; Radau IIA of third order.

    Parameters
    ----------
    rate : casadi.Function
        ``rate(x, u)`` of a plant with two joints.
    exact_hessian : bool, optional
        Second derivatives of `rate`, instead of IPOPT's approximation of limited memory.

    Returns
    -------
    ndarray
        States at the points of collocation, spring torques in 100 N.m, motor torques of the intervals [N.m], the
        duration [s] and the torques that hold the arm at both ends.
    dict
        What IPOPT says of it, with ``time``, the processor time [s].
    """
    N, points = INTERVALS, 2 * INTERVALS + 1
    size = np.array([1.0] * 6 + [100.0] * 2)[:, None]
    x, u, T, hold = ca.MX.sym("x", 8, points), ca.MX.sym("u", 2, N), ca.MX.sym("T"), ca.MX.sym("hold", 2, 2)
    X = x * size

    def inputs(tau: ca.MX) -> ca.MX:
        return ca.vertcat(tau, ca.DM.zeros(6, tau.shape[1]))

    rates = rate.map(2 * N)(X[:, 1:], inputs(u[:, [k // 2 for k in range(2 * N)]]))
    first, second, before = rates[:, 0::2], rates[:, 1::2], X[:, 0:-1:2]
    inner = X[:, 1::2] - before - T / N * (5.0 * first - second) / 12.0
    end = X[:, 2::2] - before - T / N * (3.0 * first + second) / 4.0
    rest = rate.map(2)(X[:, [0, 2 * N]], inputs(hold))[2:6, :]
    cost = T + 1e-3 * ca.sumsqr(u) / N  # so that the torques are unique
    problem = {"x": ca.veccat(x, u, T, hold), "f": cost, "g": ca.veccat(inner / size, end / size, rest)}

    low, high = np.full((8, points), -np.inf), np.full((8, points), np.inf)
    for k, q in ((0, FROM), (-1, TO)):
        low[:, k][:6] = high[:, k][:6] = [*q, 0.0, 0.0, 0.0, 0.0]
    s, way = np.linspace(0.0, 1.0, points), np.subtract(TO, FROM)
    guess = np.zeros((8, points))
    guess[:2] = np.array(FROM)[:, None] + np.outer(way, s)
    guess[2:4] = guess[4:6] = np.outer(way, 6.0 * s * (1.0 - s))
    free, torques = np.full(4, np.inf), np.full(2 * N, MOST)
    options: dict[str, Any] = {"tol": 1e-10, "print_level": 0, "sb": "yes", "max_iter": 500}
    if not exact_hessian:
        options["hessian_approximation"] = "limited-memory"
    solver = ca.nlpsol("motion", "ipopt", problem, {"ipopt": options, "print_time": False})
    began = processor_time()
    optimum = solver(
        x0=np.concatenate([guess.T.ravel(), np.zeros(2 * N), [1.0], np.zeros(4)]),
        lbx=np.concatenate([low.T.ravel(), -torques, [0.05], -free]),
        ubx=np.concatenate([high.T.ravel(), torques, [5.0], free]),
        lbg=0.0, ubg=0.0,
    )  # fmt: skip
    return optimum["x"].full().ravel(), {**solver.stats(), "time": processor_time() - began}


def run(report: Report, quick: bool = False) -> None:
    """Solve through the trace and through the FMU, and tabulate."""
    robot = load_robot(ROBOT)
    table = Table(
        "optimal_motion", f"The shortest motion of {ROBOT}, {INTERVALS} intervals",
        [("second derivatives", ""), ("through", ""), ("to the trace", ".1e"), ("time [ms]", ".0f"), ("ratio", ".2f")],
    )  # fmt: skip
    with tempfile.TemporaryDirectory(prefix="vdfmu-bench-") as folder:
        fmu = build_fmus(robot, folder, units=["plant"], backend="native", folded=True)["plant"]
        rates = {"the trace": traced_rate(robot), "the FMU": imported_rate(fmu)}
        for exact in (False, True):
            solved = {
                name: [shortest_motion(rate, exact) for _ in range(1 if quick else 5)] for name, rate in rates.items()
            }
            times = {name: float(np.median([said["time"] for _, said in each])) for name, each in solved.items()}
            (expected, _), *_ = solved["the trace"]
            for name, [(motion, _), *_] in solved.items():
                difference = float(np.abs(motion - expected).max())
                kind = "exact" if exact else "approximated"
                table.add(kind, name, difference, 1e3 * times[name], times[name] / times["the trace"])
    report.show(table)
