"""Laws of friction (54)-(55), trajectory (57), PD (58), and of the feedforward as the plant's inverse."""

import dataclasses

import numpy as np
import pytest

from tests.arm.balanced import EVERY_CHAIN
from tests.arm.laws.ends import rounded_ends
from vdfmu.arm.equations.desired_drive import desired_drive_motion
from vdfmu.arm.equations.feedforward import FeedbackGains, feedforward_inverse, feedforward_vdc
from vdfmu.arm.equations.friction import coulomb_friction, joint_friction, stribeck_friction
from vdfmu.arm.equations.pd import pd_control
from vdfmu.arm.equations.trajectory import Desired, desired_motion
from vdfmu.compiler.scalar.jet import Jet

EPS = np.finfo(float).eps
VELOCITIES = (0.0, 1e-5, 1e-3, 0.02, 0.15, 2.0)


@pytest.mark.parametrize("velocity", VELOCITIES)
def test_friction_is_odd_and_dissipative(chain, velocity):
    v = np.full(chain.n, velocity)
    for law in (stribeck_friction, coulomb_friction):
        xi = law(chain, v)
        # Every operation on -v is that on v with the other sign: exact.
        np.testing.assert_array_equal(law(chain, -v), -xi)
        assert (xi * v > 0).all() if velocity else (xi == 0).all()


def test_friction_is_that_of_equation_54_on_rotor_or_link(arm):
    # At 1 rad/s, 1000 times eps, tanh is 1 to the last bit; what is left is (54) as printed, in plain Python.
    for v in (1.0, -1.0):
        xi = stribeck_friction(arm, np.full(6, v))
        for i in range(6):
            stribeck = (arm.f_s[i] - arm.f_c[i]) * np.exp(-(abs(v / arm.v_s[i]) ** 2))
            assert xi[i] == pytest.approx((arm.f_c[i] + stribeck) * np.sign(v) + arm.f_v[i] * v, rel=10 * EPS)
    q_dot, kappa_dot = np.full(6, 0.3), np.full(6, -0.4)
    xi_l, xi_m = joint_friction(arm, q_dot, kappa_dot)
    np.testing.assert_array_equal(xi_l, np.zeros(6))
    np.testing.assert_array_equal(xi_m, stribeck_friction(arm, kappa_dot) / arm.ell)
    xi_l, xi_m = joint_friction(dataclasses.replace(arm, friction="split"), q_dot, kappa_dot)
    np.testing.assert_array_equal(xi_l, stribeck_friction(arm, q_dot))
    np.testing.assert_array_equal(xi_m, coulomb_friction(arm, kappa_dot))


Q_START, Q_END, T, T_START = np.array([0.2, -0.4]), np.array([1.7, 0.9]), 10.0, 0.5


def motion(t):
    return desired_motion(t, Q_START, Q_END, T, T_START)


@pytest.mark.parametrize("order", [1, 2, 3, 4])
@pytest.mark.parametrize("t", [0.6, 2.0, 5.5, 7.3, 10.4])
def test_trajectory_derivatives_agree_with_central_differences(t, order):
    h = 1e-3
    difference = (motion(t + h)[order - 1] - motion(t - h)[order - 1]) / (2 * h)
    # Truncation h^2/6 times the derivative two orders up, at most distance / T * w^(order + 1), w = 2 pi / T;
    # rounding 1e-16 * 2 / 1e-3 = 2e-13, and some of them.
    w = 2 * np.pi / T
    atol = h**2 / 6 * 1.5 / T * w ** (order + 1) + 1e-12
    np.testing.assert_allclose(motion(t)[order], difference, rtol=0, atol=atol)


def test_trajectory_goes_from_rest_to_rest_and_holds():
    for t, q in ((0.0, Q_START), (T_START, Q_START), (T_START + T, Q_END), (20.0, Q_END)):
        desired = motion(t)
        # sin(2 pi) is 2.4e-16.
        np.testing.assert_allclose(desired.q_d, q, rtol=0, atol=1e-15)
        for k in (1, 2):
            np.testing.assert_allclose(desired[k], 0.0, rtol=0, atol=1e-15)
    for t in (0.0, 20.0):
        for k in (3, 4):
            np.testing.assert_array_equal(motion(t)[k], np.zeros(2))


def test_trajectory_jerk_jumps_at_both_ends_whatever_the_rounding():
    jump = 4 * np.pi**2 * (Q_END - Q_START) / T**3
    for t, outside in ((T_START, T_START - 1e-7), (T_START + T - 1e-7, T_START + T)):
        # cos(0) is 1, cos(2 pi - 6e-8) too but for 2e-15: a few roundings.
        np.testing.assert_allclose(motion(t).q_d_dddot, jump, rtol=1e-14)
        np.testing.assert_array_equal(motion(outside).q_d_dddot, np.zeros(2))
    # At the start it moves already, at the end no more, however a time was summed up; see `desired_motion`.
    for duration, t_start, pairs in rounded_ends():
        for begin, end in pairs:
            jerk = desired_motion(begin, Q_START, Q_END, duration, t_start).q_d_dddot
            # A start that is 1e-12 s late, a sum of 6000 roundings, over the shortest T, 1e-4 s: 1 - cos(6e-8) = 2e-15.
            np.testing.assert_allclose(jerk, 4 * np.pi**2 * (Q_END - Q_START) / duration**3, rtol=1e-14)
            for value in desired_motion(end, Q_START, Q_END, duration, t_start)[1:]:
                np.testing.assert_array_equal(value, np.zeros(2))


def test_pd_acts_on_errors_link_side_and_limits_the_motor_torque():
    ell, tau_max = np.array([100.0, 50.0]), np.array([np.inf, 0.4])
    K_p, K_v = np.array([2000.0, 500.0]), np.array([50.0, 20.0])
    e, e_dot, tau_m = np.array([1e-3, -0.05]), np.array([0.02, -0.1]), np.array([0.3, -0.2])
    command = pd_control(K_p, K_v, ell, tau_max, e, e_dot, np.zeros(2), np.zeros(2), tau_m)
    # 2000 * 1e-3 + 50 * 0.02 = 3 and -25 - 2 = -27 N m; 0.3 + 0.03 and max(-0.2 - 0.54, -0.4): 3 roundings.
    np.testing.assert_allclose(command.tau_e, [3.0, -27.0], rtol=3 * EPS)
    np.testing.assert_allclose(command.tau, [0.33, -0.4], rtol=3 * EPS)


F_E = np.array([5.0, -3.0, 4.0, 0.3, -0.2, 0.4])
"""A wrench that the feedforward knows."""


def inside(robot, t=4.0):
    n = robot.n
    return desired_motion(t, np.linspace(-0.2, 0.2, n), np.linspace(1.0, 1.6, n), 10.0)


@EVERY_CHAIN
def test_desired_rotor_motion_agrees_with_central_differences_in_time(chain):
    h, t = 1e-3, 4.0
    middle = desired_drive_motion(chain, inside(chain, t))
    high, low = (desired_drive_motion(chain, inside(chain, t + s * h)) for s in (1.0, -1.0))
    # Truncation h^2/6 kappa''' (kinematic error: 2 ell kappa_dot = 300 rad/s, amplitude 3e-4: 300^3 * 3e-4 =
    # 8e3, and 300^4 * 3e-4 for the next), rounding 1e-16 / h and 1e-16 / h^2. Without the error, 1e-6 is
    # ample.
    third, fourth = (8e3, 2.4e6) if chain.theta_err_amplitude.any() else (1.0, 10.0)
    velocity = (high.kappa - low.kappa) / (2 * h)
    acceleration = (high.kappa_dot - low.kappa_dot) / (2 * h)
    np.testing.assert_allclose(middle.kappa_dot, velocity, rtol=0, atol=h**2 / 6 * third + 1e-10)
    np.testing.assert_allclose(middle.kappa_ddot, acceleration, rtol=0, atol=h**2 / 6 * fourth + 1e-10)


def gains(robot):
    n = robot.n
    return FeedbackGains(np.full(n, 10.0), np.full(n, 5.0), np.full(n, 0.1), np.full(n, 0.05))


@pytest.mark.parametrize("coupling", [False, True])
@EVERY_CHAIN
def test_vdc_without_errors_is_the_exact_inverse(chain, coupling):
    chain = dataclasses.replace(chain, rotor_coupling=coupling)
    desired = inside(chain)
    drive = desired_drive_motion(chain, desired, F_E)
    vdc = feedforward_vdc(chain, gains(chain), desired, desired.q_d, desired.q_d_dot, drive.kappa_dot, F_E)
    exact = feedforward_inverse(chain, desired, F_E)
    # Both run some 1000 products on torques of up to 100 N m.
    np.testing.assert_allclose(vdc.tau_s, exact.tau_s, rtol=0, atol=1e-10)
    np.testing.assert_allclose(vdc.tau_m, exact.tau_m, rtol=0, atol=1e-11)


def test_jets_follow_product_quotient_and_chain_rules():
    x = Jet(0.7, 1.3, -0.4)
    h = 1e-4

    def at(t):  # a function of time with that jet at 0
        return 0.7 + 1.3 * t - 0.2 * t * t

    for f in (
        lambda u: u * u * u - 2.0 * u + 1.0,
        lambda u: 1.0 / (1.0 + u) - u / 3.0,
        lambda u: u**3 / (2.0 - u),
        lambda u: np.sin(u) * np.cos(2.0 * u),
        lambda u: np.exp(-u) + np.expm1(u) * np.tanh(u),
        lambda u: np.arctan(3.0 * u) + np.log1p(u * u),
        lambda u: abs(-u) * 3.0,
    ):
        jet = f(np.array([x], dtype=object))[0]
        low, middle, high = f(at(-h)), f(at(0.0)), f(at(h))
        assert jet.x == pytest.approx(middle, rel=10 * EPS)
        # Truncation h^2/6 f''' and h^2/12 f'''' with derivatives up to 100: 2e-7; rounding 1e-16 / h^2 =
        # 1e-8.
        assert jet.x_dot == pytest.approx((high - low) / (2 * h), abs=1e-6)
        assert jet.x_ddot == pytest.approx((high - 2 * middle + low) / h**2, abs=1e-5)


def test_jets_refuse_to_become_floats_and_desired_has_four_derivatives():
    with pytest.raises(TypeError, match=r"derivative\(jet, 0\) for its value"):
        np.zeros(2)[0] = Jet(1.0)
    assert repr(Jet(1.0, 2.0)) == "Jet(1.0, 2.0, 0.0)"
    assert Desired._fields == ("q_d", "q_d_dot", "q_d_ddot", "q_d_dddot", "q_d_ddddot")
