"""Gains of state feedback that are optimal: by the symmetric root locus of one joint, and for whole arms."""

import control
import numpy as np
import pytest

import vdfmu
from tests.arm.units.one_joint import one_joint
from tests.conftest import make_optional
from vdfmu.base.errors import UsageError
from vdfmu.base.state_space import Linear, held
from vdfmu.extras.laws import state_gains

STEP = 1e-3


def test_poles_of_one_joint_are_those_of_the_symmetric_root_locus():
    """The optimal loop's poles are the stable roots of 1 + sum of w_i G_i(1/z) G_i(z), whose G_i come from poly()."""
    robot = one_joint()
    K = 1.0 / (1.0 / robot.K_f0[0] + 1.0 / (robot.ell[0] ** 2 * robot.K_w0[0]))
    M, J = vdfmu.dynamics.mass_matrix(robot, np.zeros(1))[0, 0], (robot.ell * robot.I_m)[0]
    A = np.array([[0, 1, 0, 0], [-K / M, 0, K / M, 0], [0, 0, 0, 1], [K / J, 0, -K / J, 0]])
    F, G = held(Linear(A, np.array([[0.0], [0.0], [0.0], [1.0 / J]])), STEP)  # of ell tau
    error, rate, torque = 2e-3, 0.05, 0.02 * robot.ell[0]
    gains = state_gains(robot, [0.0], error=error, rate=rate, torque=0.02, step=STEP)
    poles = np.linalg.eigvals(F - G @ np.hstack(gains))
    a = np.poly(F)
    locus = np.polymul(a, a[::-1])  # z^4 a(z) a(1/z)
    for i, weight in ((0, error), (3, rate)):
        b = np.poly(F - G @ np.eye(4)[i : i + 1]) - a  # numerator of state i
        locus = np.polyadd(locus, (torque / weight) ** 2 * np.polymul(b, b[::-1]))
    # each pole makes locus 0, of terms that cancel: the roundings of poly(), 1e-16 times some 1e6 / (z - 1)^2
    size = np.polyval(np.abs(locus), np.abs(poles))
    assert (np.abs(np.polyval(locus, poles)) <= 1e-9 * size).all()
    assert (np.abs(poles) < 1.0).all() and np.unique(np.round(poles, 6)).size == 4


@pytest.mark.parametrize("name", ["planar_2dof", "slider_3dof", "manipulator_6dof"])
def test_gains_are_those_of_python_control(name):
    """Of the arm with the springs' torques as states, sampled and weighted by python-control."""
    robot = vdfmu.load_robot(name)
    n, q = robot.n, np.full(robot.n, 0.3)
    gains = np.hstack(state_gains(robot, q, error=1e-3, rate=0.02, torque=0.01, step=STEP)) / robot.ell[:, None]
    arm = vdfmu.linearize(robot, q)
    C = arm.C[[arm.outputs.index(f"{x}[{i + 1}]") for x in ("q", "q_dot", "kappa", "kappa_dot") for i in range(n)]]
    sampled = control.c2d(control.ss(arm.A, arm.B[:, :n], C, 0), STEP, "zoh")
    Q = C.T @ np.diag(np.repeat([1e6, 0.0, 0.0, 2500.0], n)) @ C
    K, _, _ = control.dlqr(sampled.A, sampled.B, Q, 1e4 * np.eye(n))
    # Two Riccati equations in other states, of weights from 1 to 1e6 and springs of 1e4: some seven digits of 16
    np.testing.assert_allclose(gains @ C, K, rtol=0, atol=1e-9 * np.abs(K).max())


def test_what_has_no_optimum_is_said(planar):
    with pytest.raises(UsageError, match=r"state_gains: rate, step: expected numbers above 0\."):
        state_gains(planar, [0.0, 0.0], error=1e-3, rate=0.0, torque=0.01, step=0.0)
    robot = make_optional("hysteresis")
    with pytest.raises(UsageError, match=r"expected no states that feedback lacks, got tau_h\."):
        state_gains(robot, [0.0, 0.0], error=1e-3, rate=0.02, torque=0.01)
