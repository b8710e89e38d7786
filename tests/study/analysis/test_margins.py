"""Linearisation and margins: against closed forms, and against the nonlinear sampled simulation."""

import dataclasses

import numpy as np
import pytest
from vdfmu.study.analysis.margins import ArmLoops

import vdfmu
from tests.conftest import heavy
from vdfmu.arm.equations.harmonic_drive import deformation_derivative
from vdfmu.base.errors import UsageError
from vdfmu.base.state_space import Linear, held
from vdfmu.engine.linear.loops import Loop, _margins
from vdfmu.unit import Output, Unit

STEP = 1e-3
AT_REST = {  # the planar arm held where it starts, without dry friction
    "trajectory.q_end": [-1.2, 0.4], "trajectory.q_start": [-1.2, 0.4], "plant.q_0": [-1.2, 0.4],
    "plant.f_c": 0.0, "plant.f_s": 0.0, "feedforward.f_c": 0.0, "feedforward.f_s": 0.0,
}  # fmt: skip


def test_two_masses_on_a_spring_are_discretised_exactly():
    m, j, k, h = 2.0, 0.5, 3e4, STEP
    # x, y, their velocities; a force on the first mass
    A = np.array([[0, 0, 1, 0], [0, 0, 0, 1], [-k / m, k / m, 0, 0], [k / j, -k / j, 0, 0]], float)
    B = np.array([[0], [0], [1 / m], [0]])
    found = held(Linear(A, B), h)
    # centre of mass: uniformly accelerated; distance x - y: an oscillator under the acceleration 1 / m
    M, w = m + j, np.sqrt(k * (1 / m + 1 / j))
    c, s = np.cos(w * h), np.sin(w * h)
    middle = np.array([[1, h], [0, 1]]), np.array([h**2 / 2, h]) / M
    apart = np.array([[c, s / w], [-w * s, c]]), np.array([(1 - c) / w**2, s / w]) / m
    from_parts = np.array([[1, 0, j / M, 0], [1, 0, -m / M, 0], [0, 1, 0, j / M], [0, 1, 0, -m / M]])
    wanted = np.block([[middle[0], np.zeros((2, 2))], [np.zeros((2, 2)), apart[0]]])
    # of the exponential: rounding of entries up to k / j h = 60
    np.testing.assert_allclose(found.A, from_parts @ wanted @ np.linalg.inv(from_parts), atol=1e-11)
    np.testing.assert_allclose(found.B[:, 0], from_parts @ np.concatenate([middle[1], apart[1]]), atol=1e-14)


@pytest.mark.parametrize("share", [0.1, 0.6, 0.9])
def test_margins_of_an_integrator_have_their_closed_form(share):
    """One state, x_dot = u, u = -k x with k h = `share`: L = k h / (z - 1), with delay k h / (z (z - 1))."""
    loop = Loop(0.0, Linear(np.zeros((1, 1)), np.ones((1, 1))), np.array([[-share / STEP]]), STEP)
    now, late = loop.margins(delay=0), loop.margins(delay=1)
    angle = 2 * np.arcsin(share / 2)  # w h where |L| = 1
    # the grid ends at half the sampling frequency, where the least distance is: exact to rounding
    assert now.modulus[0] == pytest.approx(1 - share / 2, rel=1e-9)
    assert now.radius == pytest.approx(1 - share, rel=1e-12)
    # between frequencies 2.3 % apart the logarithm of L is linear to their square, 3e-4 of each at most
    assert now.gain[0] == pytest.approx(2 / share, rel=1e-3)
    assert now.phase[0] == pytest.approx(np.pi / 2 - angle / 2, rel=1e-3)
    assert now.delay[0] == pytest.approx((np.pi / 2 - angle / 2) / angle * STEP, rel=1e-3)
    assert late.gain[0] == pytest.approx(1 / share, rel=1e-3)
    assert late.phase[0] == pytest.approx(np.pi / 2 - 1.5 * angle, rel=1e-3, abs=1e-3)
    assert late.radius == pytest.approx(np.abs(np.roots([1, -1, share])).max(), rel=1e-12)


def test_what_stays_constant_takes_no_margin():
    """A mass held by a spring and by an element that is one at rest, as hysteresis is: the states of both are one."""
    m, k, k_h, d = 2.0, 3e4, 2e3, 5.0
    one = np.array([[-d / m, -1 / m], [k + k_h, 0.0]])  # speed, torque of both springs
    two = np.array([[-d / m, -1 / m, -1 / m], [k, 0.0, 0.0], [k_h, 0.0, 0.0]])
    push, K = np.array([[1 / m], [0.0], [0.0]]), np.array([[-20.0, 0.0, 0.0]])
    apart = Loop(0.0, Linear(two, push), K, STEP)
    wanted = Loop(0.0, Linear(one, push[:2]), K[:, :2], STEP).margins()
    assert apart.constants == 1
    for found, margin in zip(apart.margins(), wanted, strict=True):
        # the same loop except for rounding, and at frequencies around the same poles
        np.testing.assert_allclose(found, margin, rtol=1e-6)
    assert wanted.modulus[0] > 0.1


def test_margins_may_allow_growth():
    """The integrator with k h = 2.002 grows by 1 / s at half the sampling frequency."""
    loop = Loop(0.0, Linear(np.zeros((1, 1)), np.ones((1, 1))), np.array([[-2.002 / STEP]]), STEP)
    assert loop.margins(delay=0).modulus[0] == 0.0
    allowed = dataclasses.replace(loop, growth=50.0).margins(delay=0)
    # L = k h / (z - 1) at z = -exp(0.05), the last of the grid
    assert allowed.modulus[0] == pytest.approx(1 - 2.002 / (1 + np.exp(0.05)), rel=1e-9)


def test_an_unstable_loop_has_no_margin():
    loop = Loop(0.0, Linear(np.zeros((1, 1)), np.ones((1, 1))), np.array([[-1.1 / STEP]]), STEP)
    assert loop.margins(delay=0).modulus[0] > 0.0  # k h below 2
    late = loop.margins(delay=1)  # k h above 1
    assert late.radius > 1.0 and late.modulus[0] == late.phase[0] == late.delay[0] == 0.0


def test_the_arm_at_rest_is_linearised_as_masses_and_springs():
    robot, n = dataclasses.replace(vdfmu.load_robot("planar_2dof"), rotor_coupling=False), 2
    scenario = vdfmu.load_scenario("planar_tracking", robot)
    loop = ArmLoops(scenario, AT_REST, times=[0.0]).loops[0]
    q = np.array([-1.2, 0.4])
    M = vdfmu.mass_matrix(robot, q)
    e = 1e-6 * np.eye(n)
    slope = np.array([(vdfmu.gravity_torque(robot, q + d) - vdfmu.gravity_torque(robot, q - d)) / 2e-6 for d in e]).T
    stiffness = np.diag(1.0 / deformation_derivative(robot, vdfmu.gravity_torque(robot, q)))
    zero, one = np.zeros((n, n)), np.eye(n)
    rotor = one / robot.I_m
    rows = [
        [zero, one, zero, zero],
        [-np.linalg.solve(M, slope), zero, zero, np.linalg.inv(M)],
        [zero, zero, -np.diag(robot.f_v / robot.ell) @ rotor, -rotor / robot.ell],
        [zero, -stiffness, stiffness, zero],
    ]
    # of the gravity's difference quotient: its rounding, 1e-15 of 30 N.m over 2e-6, times 1 / M of some 100
    np.testing.assert_allclose(loop.plant.A, np.block(rows), rtol=1e-7, atol=1e-5)
    np.testing.assert_allclose(loop.plant.B, np.vstack([zero, zero, rotor, zero]), rtol=1e-12)
    # the controller of the scenario: rounding of a difference over 1e-6
    K = np.hstack([-np.diag([1500.0, 500.0]), zero, -np.diag([40.0, 20.0]), zero]) / robot.ell[:, None]
    np.testing.assert_allclose(loop.K, K, atol=1e-8)


@pytest.mark.parametrize(
    ("master", "factor"), [("gauss-seidel", 6.0), *heavy(("gauss-seidel", 1.0), ("jacobi", 1.0), ("jacobi", 4.0))]
)
def test_the_nonlinear_loop_moves_as_the_linear_one_near_rest(master, factor, tmp_path):
    """Each state of the simulation leads to the next by the closed loop's matrix, stable or not."""
    delay = int(master == "jacobi")
    scenario = vdfmu.load_scenario("planar_tracking")
    settings = AT_REST | {"controller.K_v": [40.0 * factor, 20.0 * factor]}
    loop = ArmLoops(scenario, settings, times=[0.0]).loops[0]
    assert (loop.margins(delay=delay).radius > 1.0) == (factor > 1.0)
    pushed = settings | {"plant.q_0": [-1.2 + 1e-5, 0.4], "plant.tolerance": 1e-9}
    runs = [_rows(scenario, {**s, "plant.tolerance": 1e-9}, master) for s in (settings, pushed)]
    z = runs[1] - runs[0]
    z = z if delay else z[:, : len(loop.plant.A)]
    predicted = z[:-1] @ loop.closed(delay=delay).T
    size = np.abs(z).max(axis=0)
    assert (size > 0.0).all()
    near = np.abs(z[:, :2]).max(axis=1)[:-1] < 2e-5  # while the deviation is as small as at first
    assert near.sum() >= 5
    # curvature: squares of a deviation of 2e-5 rad; the solver's tolerance, 1e-9 of 1 rad or N.m over deviations
    # of 1e-5 rad and 0.1 N.m
    np.testing.assert_allclose((predicted / size)[near], (z[1:] / size)[near], atol=1e-3)


def _rows(scenario, settings, master):
    """States of the plant and torques, (m, 10), of 0.015 s."""
    found = vdfmu.run(scenario, settings=settings, master=master, stop=0.015, reference=False, out=False)
    groups = ("plant.q", "plant.q_dot", "plant.kappa_dot", "plant.tau_s", "controller.tau")
    return np.hstack([found[group] for group in groups])


class Plain(Unit):
    """A unit that cannot be traced."""

    backend = "python"
    y = Output("1", text="signal")

    def outputs(self):
        """Set y."""
        self.y = 1.0


def test_what_cannot_be_traced_cannot_be_linearised():
    with pytest.raises(UsageError, match="Plain: what cannot be traced has no derivatives"):
        Plain().linearize()


def test_a_loop_that_is_zero_at_a_frequency_has_the_margins_of_its_other_frequencies():
    w = np.geomspace(0.1, 10.0, 200)
    loop = 4.0 / (1.0 + 1j * w[:, None]) ** 3
    cut = loop.copy()
    cut[-1] = 0.0  # beyond all crossings
    with np.errstate(all="raise"):
        np.testing.assert_array_equal(_margins(cut, w), _margins(loop, w))
