"""How often the verdict on the loops is right: random gains, against the growth of a nudge in longer simulations.

The simulation knows nothing of the linearisation: a run is done twice, once with start velocities larger by `NUDGE`. It
is unstable if it fails, if the nudge does not decay or grows by a factor of 50 beyond a rate of 2 1/s, or if a rotor
chatters or sticks and slips.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from benchmarks.report import Report, Table
from vdfmu.base.errors import CosimError
from vdfmu.engine.linear.growth import Poses
from vdfmu.engine.linear.loops import SLOW
from vdfmu.engine.run import Simulator
from vdfmu.study.analysis.arm_space import packaged
from vdfmu.study.analysis.loops import TIED
from vdfmu.system.scenario import load_scenario
from vdfmu.system.scenario.values import group_value

TITLE = "The verdict on the loops"
NUDGE = 1e-3
"""In rad/s, of all joints."""
FLOOR = 1e-9
"""Differences [rad/s] below which rounding and the solver's tolerance count."""
WINDOWS = 20
START, ROWS, CHATTER = 100, 20, 1e-4
"""Chatter and stick-slip: second differences of a rotor's velocity [rad/s] in the middle of so many rows of 1 ms, after
the start, where it decays from the nudge of static friction."""
CASES = (
    # scenario, algorithm, end of the motion and of the longer run [s], factors of the gains, number of gain sets
    ("planar_tracking", "gauss-seidel", 2.0, 4.0, (0.1, 8.0), 200),
    ("planar_tracking", "jacobi", 2.0, 4.0, (0.1, 5.0), 200),
    ("tracking", "gauss-seidel", 4.0, 5.0, (0.1, 4.0), 70),
    ("tracking", "jacobi", 4.0, 5.0, (0.1, 2.0), 30),
)


def is_unstable(simulator: Simulator, n: int, end: float, parameters: dict[str, Any]) -> bool:
    """Return whether a simulation fails, grows or chatters."""
    nudged = {f"plant.q_dot_0[{i + 1}]": NUDGE for i in range(n)}
    try:
        run, other = (
            simulator.run(stop=end, parameters=parameters | more, record=["plant.kappa_dot[*]"])["plant.kappa_dot"]
            for more in ({}, nudged)
        )
    except CosimError:
        return True
    parts = np.array_split(np.abs(other - run), WINDOWS)
    largest = np.maximum([float(part.max()) for part in parts], FLOOR)
    grown = np.log(largest) - SLOW * end / WINDOWS * np.arange(WINDOWS)
    if largest[-1] > NUDGE or (grown - np.minimum.accumulate(grown)).max() > np.log(50.0):
        return True
    turns = np.abs(np.diff(run, 2, axis=0))  # of the desired motion they are 1e-5 rad/s at most
    turns = turns[START : START + (len(turns) - START) // ROWS * ROWS]
    # a kick is not chatter, as where the motion ends
    median = np.median(turns.reshape(-1, ROWS, n), axis=1)
    return bool(median.max() > CHATTER)


def count(name: str, algorithm: str, motion: float, end: float, factors: tuple[float, float], sets: int) -> list[int]:
    """Judge gain sets of a scenario; count those that are unstable, missed, and stable but called unstable."""
    scenario = load_scenario(name)
    n, generator = scenario.arm.n, np.random.default_rng(22)
    gains = {key: np.asarray(group_value(scenario, f"controller.{key}")) for key in ("K_p", "K_v")}
    counts = np.zeros(3, dtype=int)
    with packaged(scenario) as (package, options):
        changed: dict[str, Any] = {**options, "algorithm": algorithm, "log": lambda _: None}
        with Simulator(package, isolate=False, **changed) as simulator:
            for _ in range(sets):
                low, high = np.log(factors)
                chosen: dict[str, Any] = {"trajectory.T": motion}
                for key, values in gains.items():
                    scaled = values * np.exp(generator.uniform(low, high, n))
                    chosen |= {f"controller.{key}[{i + 1}]": float(scaled[i]) for i in range(n)}
                truth = is_unstable(simulator, n, end, chosen)
                try:
                    simulator.run(stop=motion, parameters=chosen, record=(), taps=[poses := Poses("tau", TIED)])
                    called = poses.loops.growth(0.0, motion).unstable
                except CosimError:  # the run fails, which is its verdict
                    called = True
                counts += [truth, truth and not called, called and not truth]
    return counts.tolist()


def run(report: Report, quick: bool = False) -> None:
    """Judge the gain sets of all scenarios."""
    heads = ("sets", "unstable", "missed", "false alarms")
    table = Table("verdict", TITLE, [("scenario, algorithm", ""), *((head, "d") for head in heads)])
    for name, algorithm, motion, end, factors, sets in CASES:
        report.say(f"{name}, {algorithm}")
        sets = 3 if quick else sets
        table.add(f"{name}, {algorithm}", sets, *count(name, algorithm, motion, end, factors, sets))
    report.show(table)
