"""The plant with coupled rotors against Pinocchio: every rotor a body of its own, the gear set by hand."""

import dataclasses

import numpy as np
import pytest

from tests.arm.dynamics.rotor_bodies import RotorBodies
from vdfmu.arm.equations.friction import joint_friction
from vdfmu.arm.equations.plant import plant_derivative


@pytest.mark.few(1)
def test_plant_agrees_with_rotors_as_bodies(chain, draw):
    robot = dataclasses.replace(chain, rotor_coupling=True)
    n, bodies = robot.n, RotorBodies(robot)
    for state in draw(robot, 200, seed=82):
        xi_l, xi_m = joint_friction(robot, state.q_dot, state.kappa_dot)
        theta = 17.0 * state.kappa_dot  # any angle: the rotor is the same all around
        q_ddot, theta_ddot = bodies.accelerations(
            state.q, state.q_dot, theta, robot.ell * state.kappa_dot,
            state.tau_s - xi_l, state.tau - state.tau_s / robot.ell - xi_m, state.F_e,
        )  # fmt: skip
        x_dot = plant_derivative(robot, state.x, state.tau, state.F_e)
        # 1e-12 of the largest: some 5000 roundings, as for the rigid arm.
        np.testing.assert_allclose(x_dot[n : 2 * n], q_ddot, rtol=0, atol=1e-12 * np.abs(q_ddot).max())
        kappa_ddot = theta_ddot / robot.ell
        np.testing.assert_allclose(x_dot[2 * n : 3 * n], kappa_ddot, rtol=0, atol=1e-12 * np.abs(kappa_ddot).max())
