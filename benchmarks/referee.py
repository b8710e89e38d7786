"""Evaluates `judge` on random linear coupled systems, with the masters of this package and FMUs of `linear_unit`.

    python -m benchmarks.referee [--systems 200] [--seed 5]

The exact solution is a matrix exponential. Printed are, by master, how near the estimate is, and how many verdicts are
false at wanted errors of 10, 1 and 0.1 %.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from scipy.linalg import block_diag, expm

import vdfmu
from vdfmu.engine.algorithms import ALGORITHMS
from vdfmu.engine.plan.check import check_system
from vdfmu.study.referee import RIGHT, WRONG, differences, error_of, verdict_of
from vdfmu.unit import linear_unit

STEPS = (0.01, 0.1, 0.3, 1.0)
"""Steps, as shares of the fastest time constant of the coupled system, of the median one if it is stiff."""
WANTED = (0.1, 0.01, 0.001)
_MOST_STEPS = 300
"""A step of three: the shortest run is four times as long."""


class Coupled:
    """2 to 4 linear components with 1 to 6 signals between them: stiff, with feed-through or unstable, by lot."""

    def __init__(self, rng: np.random.Generator) -> None:
        while not self._drawn(rng):
            pass

    def _drawn(self, rng: np.random.Generator) -> bool:
        n = int(rng.integers(2, 5))
        self.sizes = rng.integers(1, 5, n)
        self.stiff = bool(rng.random() < 0.3)
        self.owner = np.repeat(np.arange(n), self.sizes)
        blocks: list[Any] = []
        for i, size in enumerate(self.sizes):
            matrix = rng.normal(size=(size, size))
            rate = 10 ** rng.uniform(-0.3, 0.7) * (10 ** rng.uniform(1, 2.5) if self.stiff and i == 0 else 1.0)
            matrix *= rate / max(np.abs(np.linalg.eigvals(matrix)).max(), 1e-9)
            blocks.append(matrix - (max(np.linalg.eigvals(matrix).real.max(), 0.0) + 0.1 * rate) * np.eye(size))
        k = int(rng.integers(2, 7))
        self.source = rng.integers(0, n, k)
        self.target = np.array([(s + rng.integers(1, n)) % n for s in self.source])
        self.target[1], self.source[1] = self.source[0], self.target[0]  # a loop at least
        rows = len(self.owner)
        self.A: Any = np.asarray(block_diag(*blocks))
        self.B, self.C, self.D = np.zeros((rows, k)), np.zeros((k, rows)), np.zeros((k, k))
        gain = 10 ** rng.uniform(-0.5, 0.7)
        for j in range(k):
            into, out = self.owner == self.target[j], self.owner == self.source[j]
            self.B[into, j] = rng.normal(size=into.sum()) * gain * np.abs(blocks[self.target[j]]).max() ** 0.5
            self.C[j, out] = rng.normal(size=out.sum())
        if rng.random() < 0.4:  # an output depends on an input of its component, without an algebraic loop
            for j in range(k):
                for i in np.flatnonzero(self.target == self.source[j]):
                    if self.source[i] < self.source[j] and rng.random() < 0.5:
                        self.D[j, i] = 0.7 * rng.normal()
        self.closed: Any = self.A + self.B @ np.linalg.solve(np.eye(k) - self.D, self.C)
        self.start = rng.normal(size=len(self.A))
        return np.linalg.eigvals(self.closed).real.max() < 1.5

    def connect(self) -> vdfmu.System:
        """Return the system as FMUs."""
        parts, wires, values = {}, [], {}
        inputs = [np.flatnonzero(self.target == c) for c in range(len(self.sizes))]
        outputs = [np.flatnonzero(self.source == c) for c in range(len(self.sizes))]
        for c in range(len(self.sizes)):
            mine, u, y = self.owner == c, inputs[c], outputs[c]
            # a component without inputs or outputs gets an idle one
            B = self.B[np.ix_(mine, u)] if len(u) else np.zeros((mine.sum(), 1))
            C = self.C[np.ix_(y, mine)] if len(y) else np.zeros((1, mine.sum()))
            D = self.D[np.ix_(y, u)] if len(u) and len(y) else np.zeros((len(C), B.shape[1]))
            parts[f"c{c}"] = linear_unit(self.A[np.ix_(mine, mine)], B, C, D, name=f"Linear{c}")
            values[f"c{c}.x_0"] = self.start[mine]
        for j, (source, target) in enumerate(zip(self.source, self.target, strict=True)):
            a, b = (int(np.flatnonzero(each == j)[0]) + 1 for each in (outputs[source], inputs[target]))
            wires.append((f"c{source}.y[{a}]", f"c{target}.u[{b}]"))
        self.names = [start for start, _ in wires]
        return vdfmu.connect(parts, wires, values=values, algorithm="jacobi")


def evaluate(rng: np.random.Generator, counts: dict[str, Counter[str]]) -> None:
    """Add the cases of one system to the counts of each master."""
    coupled = Coupled(rng)
    rates = np.sort(np.abs(np.linalg.eigvals(coupled.closed)))
    rate, slowest = (rates[len(rates) // 2] if coupled.stiff else rates[-1]), max(float(rates[0]), 0.6)
    system, names = coupled.connect(), coupled.names
    outputs = np.linalg.solve(np.eye(len(coupled.D)) - coupled.D, coupled.C)
    for algorithm, count in counts.items():
        try:
            check_system(vdfmu.load_ssp(system.path), algorithm=algorithm)
        except vdfmu.VdfmuError:
            count["refused"] += 1  # gauss-seidel has an order for most systems, not for all
            continue
        with system.instance(algorithm=algorithm) as instance:
            for share in STEPS:
                step = share / rate
                n = int(min(max(np.ceil(min(5.0, 3.0 / slowest) / step), 8), _MOST_STEPS))
                runs: list[Any] = []
                try:
                    for divisor in (1, 2, 4):
                        results = instance.run(stop=n * step, step=step / divisor)
                        runs.append(np.column_stack([results[name] for name in names]))
                except vdfmu.VdfmuError:
                    count["failed"] += 1
                    continue
                motion, once = [coupled.start], expm(coupled.closed * step)
                for _ in range(n):
                    motion.append(once @ motion[-1])
                exact = np.array(motion) @ outputs.T
                count_case(count, ALGORITHMS[algorithm].order, names, runs, exact)


def count_case(
    count: Counter[str], order: int, names: Sequence[str], runs: Sequence[Any], exact: Any, sampled: Sequence[str] = ()
) -> None:
    """Add the verdicts on three runs, and how near their estimate is to the true error, to a count."""
    size = np.abs(exact).max(axis=0)
    true = float((np.abs(runs[0] - exact).max(axis=0) / np.where(size > 0.0, size, np.inf)).max())
    seen = differences(runs, names, sampled)
    error = error_of(seen.d1, order)
    count["cases"] += 1
    if 1e-12 < true < 1.0:
        count["compared"] += 1
        for factor in (2, 3):
            count[f"within {factor}"] += 1.0 / factor < error.max() / true < factor
    for wanted in WANTED:
        verdict = verdict_of(seen, order, wanted)
        count[f"right {wanted}"] += verdict == RIGHT
        count[f"not right {wanted}"] += verdict == WRONG
        count[f"false right {wanted}"] += verdict == RIGHT and true > wanted
        count[f"false not right {wanted}"] += verdict == WRONG and true <= wanted
        if true <= 0.5 * wanted:
            count[f"truly right {wanted}"] += 1
            count[f"called right {wanted}"] += verdict == RIGHT


def show(title: str, counts: Mapping[str, Counter[str]]) -> None:
    """Print the counts of each master."""
    print(f"{title}, wanted {', '.join(f'{100 * wanted:g}' for wanted in WANTED)} %")
    kinds = ("right", "false right", "not right", "false not right", "truly right", "called right")
    for algorithm, count in counts.items():
        near = [f"{count[f'within {factor}'] / max(count['compared'], 1):.3f} within {factor}" for factor in (2, 3)]
        print(f"  {algorithm}: {', '.join(f'{count[kind]} {kind}' for kind in ('cases', 'failed', 'refused'))}; "
              f"{', '.join(near)}")  # fmt: skip
        numbers = (" ".join([kind, *(str(count[f"{kind} {wanted}"]) for wanted in WANTED)]) for kind in kinds)
        print(f"    {', '.join(numbers)}")


def main() -> None:
    """Evaluate and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--systems", type=int, default=200)
    parser.add_argument("--seed", type=int, default=5)
    chosen = parser.parse_args()
    rng = np.random.default_rng(chosen.seed)
    counts: dict[str, Counter[str]] = {name: Counter() for name in ALGORITHMS.names()}
    for _ in range(chosen.systems):
        evaluate(rng, counts)
    show(f"{chosen.systems} systems, seed {chosen.seed}", counts)


if __name__ == "__main__":
    main()
