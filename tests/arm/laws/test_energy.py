"""The kinematic error trades energy with the rotor; that all else is balanced is in test_inverse_and_power.py."""

import numpy as np
import pytest

from vdfmu.arm.equations.flexible_joint import split_state
from vdfmu.arm.equations.friction import joint_friction
from vdfmu.arm.equations.harmonic_drive import kinematic_error
from vdfmu.arm.equations.mapping import jacobian
from vdfmu.arm.equations.plant import plant_derivative, plant_outputs
from vdfmu.compiler.scalar.jet import derivative, jets

EPS = np.finfo(float).eps


def power_in(robot, x, tau, F_e):
    state = split_state(robot, x)
    xi_l, xi_m = joint_friction(robot, state.q_dot, state.kappa_dot)
    rotor_speed = robot.ell * state.kappa_dot
    V_O = jacobian(robot, state.q) @ state.q_dot
    return tau @ rotor_speed - xi_m @ rotor_speed - xi_l @ state.q_dot - F_e @ V_O


def rate_of_energy(robot, state):
    x_dot = plant_derivative(robot, state.x, state.tau, state.F_e)
    outputs = plant_outputs(robot, jets(state.x, x_dot, 0.0))
    rates = [derivative(getattr(outputs, name), 1) for name in ("E_kin", "E_pot", "E_spring")]
    spring = np.abs(state.tau_s) @ (np.abs(state.kappa_dot) + np.abs(state.q_dot))
    links = np.abs(x_dot[robot.n : 2 * robot.n]).max() * 10
    return float(sum(rates)), float(sum(map(abs, rates))) + spring + links


def test_kinematic_error_trades_energy_with_the_rotor(general, draw):
    # The rotor feels tau_s / ell whatever the kinematic error does, so the model with an error is not
    # lossless: the spring sees kappa_dot (1 - theta_err') where the rotor turns with kappa_dot.
    for state in draw(general, 10, seed=27):
        rate, size = rate_of_energy(general, state)
        kappa = plant_outputs(general, state.x).kappa
        slope = derivative(kinematic_error(general, jets(kappa, 1.0, 0.0)), 1)
        trade = -(state.tau_s * slope) @ state.kappa_dot
        flow = power_in(general, state.x, state.tau, state.F_e) + trade
        # Sums of some 1000 products; the phase 2 ell kappa, up to 4e3 rad, has 1e4 roundings of its own.
        assert rate == pytest.approx(flow, abs=1e4 * EPS * size)
        assert abs(trade) > 1e-3
