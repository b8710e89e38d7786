"""Gains of state feedback that are optimal: by the symmetric root locus of one joint, and for whole arms."""

import control
import numpy as np
import pytest

import vdfmu
from tests.conftest import make_optional
from vdfmu.base.errors import UsageError
from vdfmu.extras.laws import state_gains

STEP = 1e-3


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
    with pytest.raises(UsageError, match=r"expected no states without feedback, got tau_h\."):
        state_gains(robot, [0.0, 0.0], error=1e-3, rate=0.02, torque=0.01)
