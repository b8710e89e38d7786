"""The torque estimates: (2)-(3) as printed and the inverse of the deformation, and what both do out of their range."""

from types import SimpleNamespace

import numpy as np
import pytest

from vdfmu.arm.equations.flexible_joint import rotor_position
from vdfmu.arm.equations.harmonic_drive import deformation, deformation_derivative
from vdfmu.arm.equations.torque_estimation import estimate_torque, torque_estimates, torque_of_deformation

EPS = np.finfo(float).eps
TORQUES = (-80.0, -7.0, -1e-3, 0.0, 1e-6, 0.3, 20.0, 80.0)
UNLIMITED = 1e12


@pytest.mark.parametrize("torque", TORQUES)
def test_estimators_and_deformation_are_inverse_to_each_other(chain, torque):
    tau_s = np.full(chain.n, torque)
    delta = deformation(chain, tau_s)
    printed = estimate_torque(chain, delta, tau_s / chain.ell, UNLIMITED)
    consistent = torque_of_deformation(chain, delta, UNLIMITED)
    # tan(arctan(c t)) / c: 10 roundings of the deformation, over the slope of the estimate.
    slope = chain.K_f0 * (1.0 + (chain.c_f * tau_s) ** 2)
    assert (np.abs(printed - tau_s) <= 10 * EPS * (np.abs(delta) * slope + np.abs(tau_s))).all()
    slope = 1.0 / deformation_derivative(chain, tau_s)
    assert (np.abs(consistent - tau_s) <= 10 * EPS * (np.abs(delta) * slope + np.abs(tau_s))).all()


def test_consistent_estimate_converges_for_any_drive():
    random = np.random.default_rng(31)
    n = 2000

    def decades(low, high):
        return 10.0 ** random.uniform(low, high, n)

    drive = SimpleNamespace(
        K_f0=decades(2, 6), c_f=decades(-5, 0), ell=decades(0.5, 2.7), K_w0=decades(-2, 2), c_w=decades(-3, 3)
    )
    limit = 10.0 / drive.c_f
    for share in np.geomspace(1e-6, 1.0, 40):
        tau_s = share * limit
        estimate = torque_of_deformation(drive, deformation(drive, tau_s), limit)
        # As its docstring says; roundings of the deformation, 1e-16 of it, over slopes of up to 1e3, are less.
        np.testing.assert_allclose(estimate, tau_s, rtol=2e-9)


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_estimates_beyond_the_range_are_the_limit(arm, sign):
    limit = 10.0 / arm.c_f
    pole = np.pi / 2.0 / (arm.c_f * arm.K_f0)
    for excess in (1.001, 1.9, 2.1, 1e6):  # 2 is the next branch of the tangent
        delta = sign * excess * (pole + 1.0 / (arm.c_w * arm.ell * arm.K_w0))
        # the roundings of a deformation, 1e-16, over a slope of up to 1e2 there
        np.testing.assert_allclose(torque_of_deformation(arm, delta, limit), sign * limit, rtol=1e-13)
        printed = estimate_torque(arm, delta, np.zeros(arm.n), limit)
        np.testing.assert_allclose(printed, sign * limit, rtol=1e-13)
        assert (np.abs(printed) <= limit).all()
    inside = estimate_torque(arm, 0.9 * sign * pole, np.zeros(arm.n), limit)
    # tan(0.9 pi/2) is 6.3, below the 10 of the limit
    np.testing.assert_allclose(inside, sign * np.tan(0.45 * np.pi) / arm.c_f, rtol=1e-13)


def test_printed_estimate_takes_friction_and_inertia_for_load(chain, draw):
    """To first order its error is the motor's torque that does not reach the spring, over the wave generator."""
    for state in draw(chain, 5, seed=33):
        kappa = rotor_position(chain, state.q, state.tau_s)
        balanced = torque_estimates(chain, state.q, kappa, state.tau_s / chain.ell, UNLIMITED)
        # kappa - q cancels digits of positions of up to 3 rad or m: 1e-15 over compliances of 1e-7 and more.
        np.testing.assert_allclose(balanced.tau_f_hat, state.tau_s, rtol=1e-8, atol=1e-7)
        np.testing.assert_allclose(balanced.tau_s_hat, state.tau_s, rtol=1e-8, atol=1e-7)
        lost = 1e-6
        other = torque_estimates(chain, state.q, kappa, state.tau_s / chain.ell + lost, UNLIMITED)
        slope = np.exp(-chain.c_w * np.abs(state.tau_s) / chain.ell) / (chain.ell * chain.K_w0)
        slope = slope * chain.K_f0 * (1.0 + (chain.c_f * state.tau_s) ** 2)
        # second order: c_w and 2 c_f tan times the slope, 1e2 in all, times 1e-6
        np.testing.assert_allclose(
            (other.tau_f_hat - balanced.tau_f_hat) / lost, -slope, rtol=1e-3, atol=1e-3 * slope.max() + 1e-6
        )
        np.testing.assert_array_equal(other.tau_s_hat, balanced.tau_s_hat)
