"""Every shipped arm: its rigid-body dynamics against Pinocchio's."""

import numpy as np
import pinocchio as pin
import pytest

from vdfmu.arm.equations.forward_dynamics import forward_dynamics
from vdfmu.arm.equations.inverse_dynamics import inverse_dynamics
from vdfmu.arm.robot import load_robot, robot_names


@pytest.mark.parametrize("name", robot_names())
def test_inverse_and_forward_dynamics_are_pinocchios(name: str, draw, pinocchio_model, pinocchio_force) -> None:
    robot = load_robot(name)
    model = pinocchio_model(robot)
    data = model.createData()
    for state in draw(robot, 5, seed=90):
        force = pinocchio_force(robot, state.F_e)
        tau = pin.rnea(model, data, state.q, state.q_dot, state.q_ddot, force).copy()
        found = inverse_dynamics(robot, state.q, state.q_dot, state.q_ddot, state.F_e)
        # Some 100 n products of the size of the largest torque: 1e-12 with 24 joints.
        np.testing.assert_allclose(found, tau, rtol=0, atol=1e-12 * np.abs(tau).max())
        q_ddot = pin.aba(model, data, state.q, state.q_dot, tau, force)
        found = forward_dynamics(robot, state.q, state.q_dot, tau, state.F_e)
        # The same, times the condition of the mass matrix, some 1e5 with 24 joints; most of it cancels.
        np.testing.assert_allclose(found, q_ddot, rtol=0, atol=1e-10 * np.abs(q_ddot).max())
