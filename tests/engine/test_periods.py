"""Loops with samples at every n-th communication point: against the same loop stepped by hand, and at its period."""

import math
from collections.abc import Mapping

import numpy as np
import pytest
from scipy.linalg import expm

from tests.engine.system_loops import system_loop
from vdfmu.base.errors import UsageError
from vdfmu.base.state_space import StateSpace
from vdfmu.engine.linear.loops import fastest_mode
from vdfmu.engine.linear.system import LinearSystem, Samples

H = 0.01
PLANT = np.array([[0.0, 1.0], [-3.0, 0.2]])
"""Position and velocity of a pendulum that falls; both controllers push."""
LAWS = {"c": (-30.0, -2.0, -40.0), "d": (-9.0, -1.5, -15.0)}
"""Gains of each controller on position, velocity, and on the integral that it samples."""
ROUNDING = 1e-9
"""Of eigenvalues: 1e-16 of each number, over the distance of the eigenvalues, 1e-3 of their size or more."""


def loop(every: Mapping[str, int], *, fresh: bool, step: float = H, sets: bool = False) -> LinearSystem:
    """Return the pendulum with controllers of given periods; with `sets` the plant's velocity is in what `c` gives."""
    names = [*every]
    k = len(names)
    inputs = [*(f"p.{n}" for n in names), *(f"{n}.{x}" for n in names for x in ("x", "v"))]
    outputs = ["p.x", "p.v", *(f"{n}.tau" for n in names)]
    sampled = [f"{n}.{s}" for n in names for s in ("z", "held")]
    whole = np.zeros((2 + len(outputs), 2 + len(inputs)))
    whole[:2, :2], whole[1, 2 : 2 + k], whole[2:4, :2] = PLANT, 1.0, np.eye(2)
    links = np.zeros((len(inputs), len(outputs)))
    G, F = np.zeros((len(outputs), 2 * k)), np.zeros((2 * k, 2 + len(inputs) + 2 * k))
    for i, name in enumerate(names):
        links[i, 2 + i] = 1.0
        links[k + 2 * i, 0] = links[k + 2 * i + 1, 1] = 1.0
        G[2 + i, 2 * i + 1] = 1.0
        K, D, I = LAWS[name]
        x, z = 2 + k + 2 * i, 2 + len(inputs) + 2 * i
        F[2 * i, [x, z]] = every[name] * step, 1.0  # z + period x
        F[2 * i + 1, [x, x + 1, z]] = K + I * every[name] * step, D, I
    if sets:
        whole[4, 2 + k + 1] = -0.1  # what c reads of the velocity is in its output at once
    each = [[(name, "1", 0.0) for name in group] for group in (["p.x", "p.v"], inputs, outputs, sampled)]
    samples = Samples(each[3], np.zeros((2, 2 * k)), G, F)
    flags = np.array([fresh and name.startswith("p.") for name in inputs])
    slower = {name: n for name, n in every.items() if n > 1}
    parts = StateSpace.of(whole, *each[:3])
    return LinearSystem(parts, links, flags, step, "gauss-seidel" if fresh else "jacobi", samples, every=slower)


def by_hand(every: Mapping[str, int], *, fresh: bool) -> np.ndarray:
    """Return the matrix over the common period, column by column: from each state, step by step as a master does."""
    n, move = math.lcm(*every.values()), expm(H * np.block([[PLANT, np.array([[0.0], [1.0]])], [np.zeros((1, 3))]]))
    size = 2 + 3 * len(every)  # x, v; z, held and what waits at the plant of each controller
    columns: list[list[float]] = []
    for start in np.eye(size):
        (x, v), rest = start[:2], {name: list(start[2 + 3 * i : 5 + 3 * i]) for i, name in enumerate(every)}
        for k in range(n):
            waits = {name: law[2] for name, law in rest.items()}
            for name, law in rest.items():
                K, D, I = LAWS[name]
                if k % every[name] == 0:
                    law[0] += every[name] * H * x
                    law[1] = K * x + D * v + I * law[0]
                law[2] = law[1]
            force = sum(law[2] if fresh else waits[name] for name, law in rest.items())
            x, v, _ = move @ [x, v, force]
        columns.append([x, v, *(each for law in rest.values() for each in law)])
    return np.array(columns).T


@pytest.mark.parametrize("fresh", [True, False])
@pytest.mark.parametrize("every", [{"c": 1}, {"c": 2}, {"c": 7}, {"c": 2, "d": 3}, {"c": 1, "d": 4}])
def test_the_system_over_the_common_period_is_the_loop_stepped_by_hand(every, fresh):
    system = loop(every, fresh=fresh)
    sampled = system.sampled()
    assert sampled.step == pytest.approx(H * math.lcm(*every.values()), rel=1e-15)
    computed = np.sort_complex(np.linalg.eigvals(sampled.A))
    hand = np.sort_complex(np.linalg.eigvals(by_hand(every, fresh=fresh)))
    # both have more states that keep nothing (what waits): eigenvalues of 0, many at one place
    computed, hand = (each[np.abs(each) > 1e-3] for each in (computed, hand))
    np.testing.assert_allclose(computed, hand, rtol=0.0, atol=ROUNDING)
    rate, _ = fastest_mode(system)
    assert rate == pytest.approx(np.log(np.abs(hand).max()) / sampled.step, abs=ROUNDING / sampled.step)


def test_a_slow_sample_makes_a_stable_loop_grow():
    rates = [fastest_mode(loop({"c": n}, fresh=True))[0] for n in (1, 20, 40, 80)]
    assert rates[0] < 0.0 < rates[-1]


@pytest.mark.parametrize("n", [2, 5])
def test_margins_of_a_slow_controller_are_those_at_its_period(n):
    """Under gauss-seidel nothing else is sampled, so a longer communication step gives the same loop."""
    slow = system_loop(loop({"c": n}, fresh=True), ["p.c"]).margins()
    long = system_loop(loop({"c": 1}, fresh=True, step=n * H), ["p.c"]).margins()
    for margin, expected in zip(slow, long, strict=True):
        np.testing.assert_allclose(margin, expected, rtol=1e-9)  # of the same matrices: rounding, as of eigenvalues


def test_a_signal_that_acts_later_has_less_margin_and_one_that_changes_within_the_period_none():
    """Under jacobi the same loop has a delay of one step more: that much less of it is left."""
    short = H / 10.0
    at_once, later = (
        system_loop(loop({"c": 4}, fresh=fresh, step=short), ["p.c"]).margins() for fresh in (True, False)
    )
    assert later.modulus[0] < at_once.modulus[0] and later.rate < 0.0
    # the sample of the loop's crossing is read off straight lines between frequencies 4 % apart: to 1 % of the delay
    assert at_once.delay[0] - later.delay[0] == pytest.approx(short, abs=0.01 * at_once.delay[0])
    system = loop({"c": 2}, fresh=False, sets=True)
    assert math.isfinite(fastest_mode(system)[0])
    with pytest.raises(UsageError, match=r"p\.c: expected a signal that changes once in 0\.02 s"):
        system_loop(system, ["p.c"]).margins()
    with pytest.raises(UsageError, match=r"c, d: expected a common period .* at most 2000 steps, got 2991"):
        loop({"c": 997, "d": 3}, fresh=True).sampled()
    two = loop({"c": 2, "d": 3}, fresh=True)
    with pytest.raises(UsageError, match=r"p\.c: expected a signal that changes once in 0\.06 s"):
        system_loop(two, ["p.c"]).margins()
    two = loop({"c": 1, "d": 3}, fresh=True)
    alone = two.around(["p.c"])
    assert alone.period == 3 * H  # d is in the loop
    links = two.links.copy()
    links[1] = 0.0  # what d gives goes nowhere
    cut = LinearSystem(two.parts, links, two.fresh, H, two.algorithm, two.samples, every=two.every)
    assert cut.around(["p.c"]).period == H
