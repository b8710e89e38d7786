"""Evaluates `judge` on 11 kinds of random coupled systems with a known solution.

    python -m benchmarks.judge [--systems 200] [--seed 7] [--kind linear ...]

The true solution comes from matrix exponentials, closed forms, fine steps, or from scipy, which finds the time of each
event. None of them uses a master of this package. Each system is judged at two steps, with the masters in turn, at a
wanted error of 10, 1 or 0.1 % by lot. A verdict is false if the largest error of any real output, as a share of its
true swing, is on the other side of the wanted one.
"""

from __future__ import annotations

import argparse
import tempfile
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

import vdfmu
from benchmarks.judge_events import bounce, chaotic, sampled_thermostat, step, stick
from benchmarks.judge_kinds import Case, as_one, delay, hidden, linear, tone, unseen
from vdfmu.engine.algorithms import ALGORITHMS
from vdfmu.study.coupling_error import OPEN, RIGHT, WRONG

WANTED = (0.1, 0.01, 0.001)
SMOOTH = {"linear": linear, "unread output": unseen, "model-exchange chain": as_one}
"""Kinds with a smooth solution that does not depend on small errors."""
KINDS: dict[str, Any] = {
    **SMOOTH, "tone above the rate": tone, "delay": delay, "undeclared sampler": hidden, "bounce": bounce,
    "stick-slip": stick, "sampled thermostat": sampled_thermostat, "step between points": step, "chaotic": chaotic,
}  # fmt: skip
_LEAST = 1e-5
"""Smallest true error with which an estimate is compared: solvers have 1e-7 in a step."""


def evaluate(kind: str, case: Case, number: int, rng: Any, count: Counter[str]) -> None:
    """Judge a system at two steps; add verdicts, their faults, and how near the estimates are, to a count."""
    masters = [*ALGORITHMS.names()]
    for n in case.steps:
        h, wanted = case.stop / n, float(rng.choice(WANTED))
        algorithm = masters[(number + (n == case.steps[1])) % len(masters)]
        options: dict[str, Any] = {"algorithm": algorithm, "isolate": False, "tolerance": 1e-9}
        try:
            judged = case.system.judge(wanted, stop=n * h, step=h, **options)
        except vdfmu.VdfmuError:  # not for this master
            options["algorithm"] = "jacobi"
            judged = case.system.judge(wanted, stop=n * h, step=h, **options)
        options["algorithm"] = judged.algorithm
        count["cases"] += 1
        count[judged.verdict] += 1
        count[f": {judged.kind}"] += bool(judged.kind)
        if judged.verdict == OPEN:
            continue
        assert {each.name for each in judged.signals} == {*case.names}  # the truth is known of all that is judged
        run = case.system.run(stop=n * h, step=h, **options)
        exact = case.exact(run.time, case.system.run(stop=n * h, step=h / 4, **options))
        swing, size = np.ptp(exact, axis=0), np.abs(exact).max(axis=0)
        scale = np.where(swing > 1e-6 * size, swing, np.maximum(size, 1e-300))
        errors = np.abs(np.column_stack([run[name] for name in case.names]) - exact).max(axis=0) / scale
        errors[size == 0.0] = 0.0
        true = float(errors.max())
        count["false right"] += judged.verdict == RIGHT and true > wanted
        count["false not right"] += judged.verdict == WRONG and true <= wanted
        estimate = max(each.error for each in judged.signals)
        if kind in SMOOTH and _LEAST < true < 1.0:
            count["compared"] += 1
            count["within 2"] += 0.5 < estimate / true < 2.0
        if judged.verdict == RIGHT and true > wanted or judged.verdict == WRONG and true <= wanted:
            print(f"  false: {kind} {number}, {judged.algorithm}, {n} steps: {judged} Truly {true:.3g}.", flush=True)


def main() -> None:
    """Evaluate and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--systems", type=int, default=200)
    parser.add_argument("--seed", type=int, default=7)
    parser.add_argument("--kind", choices=KINDS, action="append")
    chosen = parser.parse_args()
    kinds, total, smooth = chosen.kind or [*KINDS], Counter[str](), Counter[str]()
    columns = ("cases", RIGHT, "false right", WRONG, "false not right", OPEN)
    print(f"{chosen.systems} systems, seed {chosen.seed}\n| kind | {' | '.join(columns)} | met |")
    with tempfile.TemporaryDirectory() as folder:
        for place, kind in enumerate(kinds):
            count = Counter[str]()
            for number in range(place, chosen.systems, len(kinds)):
                rng = np.random.default_rng([chosen.seed, number])
                case = KINDS[kind](rng, Path(folder, kind))
                evaluate(kind, case, number // len(kinds), rng, count)
            met = ", ".join(f"{name[2:]} {n}" for name, n in count.most_common() if name[:2] == ": " and n)
            print(f"| {kind} | {' | '.join(str(count[column]) for column in columns)} | {met} |", flush=True)
            total += count
            smooth += count if kind in SMOOTH else Counter()
    print(f"| all | {' | '.join(str(total[column]) for column in columns)} | |")
    print(
        f"smooth: {smooth[OPEN]} of {smooth['cases']} not decided; {smooth['within 2']} of {smooth['compared']} "
        "estimates within a factor of 2"
    )


if __name__ == "__main__":
    main()
