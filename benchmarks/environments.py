"""Steps a second of the environments: one arm in the master, many in lanes."""

from __future__ import annotations

from time import process_time

import numpy as np

from benchmarks.report import Report, Table
from vdfmu.extras.learn.environments import ArmEnv, ArmVectorEnv

TITLE = "Environments for learning"


def run(report: Report, quick: bool) -> None:
    """Measure actions of 10 ms with random torques, least processor time of some rounds."""
    columns = [("scenario", ""), ("environment", ""), ("µs an action", ".1f")]
    table = Table("environments", "Actions of 10 ms, random torques", columns)
    for scenario, limit in (("planar_tracking", 0.3), ("tracking", 0.3)):
        rng = np.random.default_rng(0)
        single, many = ArmEnv(scenario, limit=limit, hold=10), ArmVectorEnv(64, scenario, limit=limit, hold=10)
        steps, rounds = (20, 2) if quick else (200, 5)
        actions = rng.uniform(-limit, limit, (steps, 64, len(single.task.limit)))
        best = np.full(2, np.inf)
        for _ in range(rounds):
            single.reset(seed=0)
            many.reset(seed=0)
            began = process_time()
            for each in actions:
                if any(single.step(each[0])[2:4]):
                    single.reset()
            between = process_time()
            for each in actions:
                many.step(each)
            best = np.minimum(best, [(between - began) / steps, (process_time() - between) / (64 * steps)])
        single.close()
        for form, each in zip(("ArmEnv", "ArmVectorEnv, 64 arms"), best.tolist(), strict=True):
            table.add(scenario, form, 1e6 * each)
    report.show(table)
