"""Margins of loops: against closed forms, and against the response of the sampled plant at a million frequencies."""

import numpy as np
import pytest
from scipy.signal import cont2discrete

from tests.conftest import heavy
from vdfmu.base.errors import UsageError
from vdfmu.base.state_space import Linear, held
from vdfmu.engine.linear.loops import SLOW, Loop, margins_of
from vdfmu.unit import Output, Unit

STEP = 1e-3


def late(loop):
    (A, B), n = loop.plant, len(loop.plant.A)
    whole = np.zeros((n + 1, n + 1))
    whole[:n, :n], whole[:n, n:] = A, B
    return Loop(Linear(whole, np.eye(n + 1)[:, n:]), np.append(loop.K, [[0.0]], axis=1), loop.step)


def distances(loop, w, i=0):
    """Return ``|1 + L_i|`` at frequencies [rad/s], all other loops closed: by a linear solve at each."""
    (A, B), K = loop.plant, loop.K
    rest = np.delete(np.arange(len(K)), i)
    open_i = A + B[:, rest] @ K[rest]
    z = np.exp(1j * w * loop.step) if loop.sampled else 1j * w
    x = np.linalg.solve(z[:, None, None] * np.eye(len(A)) - open_i, B[:, [i]].astype(complex))
    return np.abs(1.0 - (K[[i]] @ x)[:, 0, 0])


def test_a_system_is_sampled_as_by_scipy():
    random = np.random.default_rng(4)
    A, B = random.normal(scale=30.0, size=(4, 4)), random.normal(size=(4, 2))
    expected = cont2discrete((A, B, np.eye(4), np.zeros((4, 2))), STEP)
    # some 20 roundings of the exponential of a matrix of norm 0.1
    for ours, theirs in zip(held(Linear(A, B), STEP), expected[:2], strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-14)


@pytest.mark.parametrize("share", [0.1, 0.6, 0.9])
def test_margins_of_an_integrator_have_their_closed_form(share):
    """One state, x_dot = u, u = -k x with k h = `share`: L = k h / (z - 1), with delay k h / (z (z - 1))."""
    loop = Loop(held(Linear(np.zeros((1, 1)), np.ones((1, 1))), STEP), np.array([[-share / STEP]]), STEP)
    now, then = loop.margins(), late(loop).margins()
    angle = 2 * np.arcsin(share / 2)  # w h where |L| = 1
    # the grid ends at half the sampling frequency, where the least distance is: exact to rounding
    assert now.modulus[0] == pytest.approx(1 - share / 2, rel=1e-9)
    assert now.rate == pytest.approx(np.log(1 - share) / STEP, rel=1e-6)  # matrices are exact to 1e-11
    # between frequencies 17 % / 125 apart the logarithm of L is linear to their square, 2e-6 of each at most
    assert now.gain[0] == pytest.approx(2 / share, rel=1e-5)
    assert now.phase[0] == pytest.approx(np.pi / 2 - angle / 2, rel=1e-5)
    assert now.delay[0] == pytest.approx((np.pi / 2 - angle / 2) / angle * STEP, rel=1e-5)
    assert then.gain[0] == pytest.approx(1 / share, rel=1e-5)
    assert then.phase[0] == pytest.approx(np.pi / 2 - 1.5 * angle, rel=1e-5, abs=1e-5)
    assert then.rate == pytest.approx(np.log(np.abs(np.roots([1, -1, share])).max()) / STEP, rel=1e-6)


def masses_on_springs(seed, scale=1.0):
    """Return A, B, and gains times a scale, of four modes and two motors."""
    random = np.random.default_rng(seed)
    n = 4
    Q, stiffness = np.linalg.qr(random.normal(size=(n, n)))[0], random.uniform(1e3, 3e4, n)
    damping = random.uniform(5.0, 20.0, n)  # of the modes [1/s]: none is slow
    B = np.vstack([np.zeros((n, 2)), random.uniform(1.0, 3.0, (n, 2))])
    A = np.block([[np.zeros((n, n)), np.eye(n)], [-Q @ np.diag(stiffness) @ Q.T, -Q @ np.diag(2 * damping) @ Q.T]])
    K = -scale * np.hstack([random.uniform(0.0, 20.0, (2, n)), random.uniform(0.0, 0.8, (2, n))])
    return A, B, K


@pytest.mark.parametrize("seed", [0, *heavy(1, 2, 3)])
@pytest.mark.parametrize("form", ["sampled", "late", "continuous"])
def test_the_modulus_is_the_least_distance_on_the_circle_or_the_axis(seed, form):
    """Masses on springs with two motors, or one whose torque waits in a row of places, which share an eigenvector."""
    A, B, K = masses_on_springs(seed)
    loop = Loop(held(Linear(A, B), STEP), K, STEP)
    if form == "continuous":
        loop = Loop(Linear(A, B), K, STEP, sampled=False)
    if form == "late":
        loop = Loop(loop.plant._replace(B=loop.plant.B[:, :1]), K[:1], STEP)
        for _ in range(3):
            loop = late(loop)
    w = np.geomspace(1e-4, 1.0, 40_000) * np.pi / STEP
    for i, modulus in enumerate(loop.modulus):
        least = distances(loop, w, i).min() if loop.rate < 0.0 else 0.0
        # frequencies 2e-4 apart, of peaks that are 1e-2 wide: 1e-4 of them; and of those of the loop, ten times closer
        # together around the least than 20 %: a parabola is exact to 1e-3
        assert modulus == pytest.approx(least, rel=2e-3)


def test_the_least_delay_margin_of_many_loops_is_that_of_the_one_that_has_it():
    loops = [
        Loop(held(Linear(A, B), STEP), K, STEP)
        for A, B, K in (masses_on_springs(seed, scale) for seed in range(30) for scale in (0.2, 1.0, 4.0))
    ]
    for some in (loops, *([loop] for loop in loops)):
        every, least = margins_of(some)[2], margins_of(some, least=True)[2]
        assert least.min() == every.min()
        assert ((least == every) | np.isinf(least)).all()
    assert np.isinf(margins_of(loops, least=True)[2]).sum() > len(loops)


def oscillator(rate, moved, frequency=600.0):
    """Return a sampled loop of an integrator, and a mode that grows with a rate, which is larger by the loop."""
    A = np.zeros((3, 3))
    A[1:, 1:] = [[rate - moved, frequency], [-frequency, rate - moved]]
    size = np.sqrt(2.0 * moved)  # of 2 moved on one of two states
    return Loop(held(Linear(A, np.array([[1.0], [size], [0.0]])), STEP), np.array([[-100.0, size, 0.0]]), STEP)


def test_a_slow_mode_that_the_loop_hardly_moves_is_left_out_of_its_margin():
    plain = Loop(held(Linear(np.zeros((1, 1)), np.ones((1, 1))), STEP), np.array([[-100.0]]), STEP).modulus[0]
    for rate in (-0.5, 0.01, 1.5):  # with a margin, at the border, and growing
        slow = oscillator(rate, 1.0)
        assert slow.rate == pytest.approx(rate, abs=0.05)  # the integrator's loop turns and holds it by some per cent
        # 1 1/s of a frequency of 600 rad/s, which the loop of 100 rad/s sees from afar
        assert slow.modulus[0] == pytest.approx(plain, abs=5e-3)


@pytest.mark.parametrize(("rate", "moved"), [(1.5, 2.0 * SLOW), (1.5 * SLOW, 1.0)])
def test_a_mode_that_grows_fast_or_by_the_loop_leaves_no_margin(rate, moved):
    margins = oscillator(rate, moved).margins()
    assert margins.rate > 0.0 and margins.modulus[0] == margins.phase[0] == margins.delay[0] == 0.0


def test_a_mode_that_decays_faster_than_the_loop_could_move_it_counts_and_what_stays_constant_does_not():
    loop = oscillator(-1.8, 1.0)
    w = np.linspace(500.0, 700.0, 200_000)  # 2e-3 rad/s apart, of a peak of 1.8 rad/s
    assert loop.modulus[0] == pytest.approx(distances(loop, w).min(), rel=1e-3)
    assert 0.5 < loop.modulus[0] < 0.8  # 1.8 of 2.8 1/s
    # A mass held by a spring and by an element that is one at rest, as hysteresis is: the states of both are one.
    m, k, k_h, d = 2.0, 3e4, 2e3, 5.0
    single = np.array([[-d / m, -1 / m], [k + k_h, 0.0]])  # speed, torque of both springs
    two = np.array([[-d / m, -1 / m, -1 / m], [k, 0.0, 0.0], [k_h, 0.0, 0.0]])
    push, K = np.array([[1 / m], [0.0], [0.0]]), np.array([[-20.0, 0.0, 0.0]])
    apart = late(Loop(held(Linear(two, push), STEP), K, STEP)).margins()
    wanted = late(Loop(held(Linear(single, push[:2]), STEP), K[:, :2], STEP)).margins()
    for margin_apart, margin in zip(apart, wanted, strict=True):
        # the same loop except for rounding, and at frequencies around the same poles
        np.testing.assert_allclose(margin_apart, margin, rtol=1e-6)
    assert wanted.modulus[0] > 0.1


def test_a_mass_that_nothing_holds_an_unstable_loop_and_one_that_is_zero_at_a_frequency_have_their_margins():
    """Position and speed have one eigenvector."""
    plant = held(Linear(np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[0.0], [1.0]])), STEP)
    margins = Loop(plant, np.zeros((1, 2)), STEP).margins()
    assert margins.modulus.tolist() == [1.0] and margins.gain.tolist() == [np.inf] and margins.rate == -np.inf
    loop = Loop(held(Linear(np.zeros((1, 1)), np.ones((1, 1))), STEP), np.array([[-1.1 / STEP]]), STEP)
    assert loop.modulus[0] > 0.0  # k h below 2
    then = late(loop).margins()  # k h above 1
    assert then.rate > 0.0 and then.modulus[0] == then.phase[0] == then.delay[0] == 0.0
    with pytest.raises(UsageError, match="Plain is not traced and has no derivatives"):
        Plain().linearize()
    k = 0.8  # of a loop k (z + 1) / z^2, which is unstable from k = 1 on, and passes 1 where 2 k cos(w / 2) does
    loop = Loop(Linear(np.array([[0.0, 0.0], [1.0, 0.0]]), np.array([[1.0], [0.0]])), np.array([[-k, -k]]), STEP)
    with np.errstate(all="raise"):
        margins = loop.margins()
    lag = 3.0 * np.arccos(0.5 / k)
    assert margins.gain[0] == pytest.approx(1.0 / k, rel=1e-5) and lag < np.pi
    assert margins.phase[0] == pytest.approx(np.pi - lag, rel=1e-5)


class Plain(Unit):
    """A unit that cannot be traced."""

    backend = "python"
    y = Output("1", text="signal")

    def outputs(self):
        """Set y."""
        self.y = 1.0
