"""The plant with coupled rotors against Pinocchio: every rotor a body of its own, the gear set by hand."""

import dataclasses

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from tests.arm.dynamics.rotor_bodies import RotorBodies
from vdfmu.arm.equations.friction import joint_friction
from vdfmu.arm.equations.harmonic_drive import deformation_derivative
from vdfmu.arm.equations.plant import equilibrium_torque, plant_derivative


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


@pytest.mark.parametrize("coupling", [True, False])
def test_free_fall_is_that_of_rotors_as_bodies(arm, coupling, plant_function):
    robot = dataclasses.replace(arm, rotor_coupling=coupling).with_parameters(f_c=0.0, f_s=0.0, f_v=0.0)
    bodies, n = RotorBodies(robot), robot.n
    zero, none = np.zeros(n), np.zeros(6)
    ours = plant_function(robot, "derivatives")

    def theirs(_, x):
        q, q_dot, kappa_dot, tau_s = np.split(x, 4)
        q_ddot, theta_ddot = bodies.accelerations(
            q, q_dot, zero, robot.ell * kappa_dot, tau_s, -tau_s / robot.ell, none
        )
        rate = (kappa_dot - q_dot) / deformation_derivative(robot, tau_s)
        return np.concatenate([q_dot, q_ddot, theta_ddot / robot.ell, rate])

    start = np.concatenate([np.zeros(3 * n), equilibrium_torque(robot, np.zeros(n))])
    ends = [
        solve_ivp(f, (0.0, 0.2), start, method="DOP853", rtol=1e-9, atol=1e-9).y[:n, -1]
        for f in (theirs, lambda _, x: ours(x, zero, none))
    ]
    distance = np.abs(ends[0] - ends[1]).max()
    # Two runs of one solver with a local error of 1e-9: 1e-7 after some 500 steps. Without the reaction joint 5 falls
    # elsewhere by 0.03 degrees = 6e-4 rad within 0.2 s.
    assert distance < 1e-7 if coupling else distance > 1e-4
