"""Virtual decomposition against formulations of other origin: Newton-Euler and Pinocchio."""

import dataclasses

import numpy as np
import pinocchio as pin
import pytest

from tests.arm.balanced import EVERY_CHAIN
from vdfmu.arm.equations.forward_dynamics import forward_dynamics
from vdfmu.arm.equations.inverse_dynamics import inverse_dynamics
from vdfmu.arm.equations.mapping import joint_space_mass_matrix
from vdfmu.arm.equations.newton_euler import newton_euler
from vdfmu.arm.kernel import Kernel
from vdfmu.arm.robot import load_robot, robot_names

EPS = np.finfo(float).eps


@EVERY_CHAIN
def test_virtual_decomposition_agrees_with_newton_euler(chain, draw):
    for state in draw(chain, 20, seed=60):
        arguments = (chain, state.q, state.q_dot, state.q_ddot, state.F_e)
        a, b = inverse_dynamics(*arguments), newton_euler(*arguments)
        # Some 100 n products of the size of the largest torque.
        np.testing.assert_allclose(a, b, rtol=0, atol=100 * chain.n * EPS * np.abs(b).max())


@pytest.mark.parametrize("name", [*robot_names(), "general"])
def test_numpy_equations_agree_with_pinocchio(name, general, draw, pinocchio_model, pinocchio_force):
    """Of every shipped arm and of the general chain: the links alone, without a counterbalance."""
    robot = general if name == "general" else load_robot(name)
    model = pinocchio_model(robot)
    data = model.createData()
    for state in draw(robot, 10, seed=67):
        force = pinocchio_force(robot, state.F_e)
        tau = pin.rnea(model, data, state.q, state.q_dot, state.q_ddot, force).copy()
        # Some 100 n products of the size of the largest torque: 1e-12 with 24 joints.
        ours = inverse_dynamics(robot, state.q, state.q_dot, state.q_ddot, state.F_e)
        np.testing.assert_allclose(ours, tau, rtol=0, atol=1e-12 * np.abs(tau).max())
        q_ddot = pin.aba(model, data, state.q, state.q_dot, tau, force)
        ours = forward_dynamics(robot, state.q, state.q_dot, tau, state.F_e)
        # The same, times the condition of the mass matrix, some 1e5 with 24 joints; most of it cancels.
        np.testing.assert_allclose(ours, q_ddot, rtol=0, atol=1e-10 * np.abs(q_ddot).max())
        M = pin.crba(model, data, state.q)
        M = np.triu(M) + np.triu(M, 1).T
        ours = joint_space_mass_matrix(robot, state.q)
        np.testing.assert_allclose(ours, M, rtol=0, atol=1e-12 * np.abs(M).max())


def test_a_payload_of_no_mass_changes_no_bit(robot, draw):
    empty = dataclasses.replace(robot, payload=True)
    with_payload, without = Kernel(empty, None), Kernel(robot, None)
    for state in draw(robot, 5, seed=68):
        columns = [state.q, state.q_dot, state.q_ddot, state.F_e]
        sizes = [robot.n] * 3 + [6]
        np.testing.assert_array_equal(inverse_dynamics(empty, *columns), inverse_dynamics(robot, *columns))
        np.testing.assert_array_equal(
            with_payload.rows("inverse_dynamics", columns, sizes), without.rows("inverse_dynamics", columns, sizes)
        )


def test_a_payload_counts_in_every_term(general):
    """The tests of this file, of energy and of momentum run on a chain with a payload: without it they differ."""
    bare = dataclasses.replace(general, payload=False)
    q = np.linspace(-1.0, 1.0, general.n)
    zeros, ones = np.zeros(general.n), np.ones(general.n)
    for motion in ((q, zeros, zeros), (q, ones, zeros), (q, zeros, ones)):
        assert np.abs(inverse_dynamics(general, *motion) - inverse_dynamics(bare, *motion)).max() > 0.1
