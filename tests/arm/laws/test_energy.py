"""The plant neither makes nor loses energy, except for motors, friction and the wrench on the surroundings."""

import dataclasses

import numpy as np
import pytest

from tests.arm.balanced import EVERY_CHAIN
from tests.arm.laws.energies import ENERGIES
from vdfmu.arm.equations.flexible_joint import split_state
from vdfmu.arm.equations.friction import joint_friction
from vdfmu.arm.equations.harmonic_drive import kinematic_error
from vdfmu.arm.equations.inverse_dynamics import inverse_dynamics
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
    rates = [derivative(getattr(outputs, name), 1) for name in ENERGIES]
    spring = np.abs(state.tau_s) @ (np.abs(state.kappa_dot) + np.abs(state.q_dot))
    links = np.abs(x_dot[robot.n : 2 * robot.n]).max() * 10
    return float(sum(rates)), float(sum(map(abs, rates))) + spring + links


@pytest.mark.few(9)
@pytest.mark.parametrize("friction", ["lumped", "split", "none"])
@EVERY_CHAIN
def test_power_balance_at_any_state(chain, draw, friction):

    chain = chain.with_parameters(theta_err_amplitude=0.0)
    if friction == "none":
        chain = chain.with_parameters(f_c=0.0, f_s=0.0, f_v=0.0, f_ck=0.0)
    else:
        chain = dataclasses.replace(chain, friction=friction)
    for state in draw(chain, 10, seed=26):
        rate, size = rate_of_energy(chain, state)
        # Sums of some 1000 products of the size of the powers that flow.
        assert rate == pytest.approx(power_in(chain, state.x, state.tau, state.F_e), abs=1000 * EPS * size)
        assert size > 10.0


def test_kinematic_error_trades_energy_with_the_rotor(general, draw):
    # The rotor feels tau_s / ell whatever the kinematic error does, so the model with an error is not
    # lossless: the spring sees kappa_dot (1 - theta_err') where the rotor turns with kappa_dot.
    for state in draw(general, 10, seed=27):
        rate, size = rate_of_energy(general, state)
        kappa = plant_outputs(general, state.x).kappa
        slope = derivative(kinematic_error(general, jets(kappa, 1.0, 0.0)), 1)
        trade = -(state.tau_s * slope) @ state.kappa_dot
        flow = power_in(general, state.x, state.tau, state.F_e) + trade
        # As above, and the phase 2 ell kappa, up to 4e3 rad, has 1e4 roundings of its own.
        assert rate == pytest.approx(flow, abs=1e4 * EPS * size)
        assert abs(trade) > 1e-3


def test_potential_energy_gives_the_gravity_torque(chain, draw):
    zero = np.zeros(chain.n)
    for state in draw(chain, 5, seed=28):
        torque = inverse_dynamics(chain, state.q, zero, zero)
        for j in range(chain.n):
            direction = np.eye(chain.n)[j]
            x = jets(np.concatenate([state.q, zero, zero, zero]), np.concatenate([direction, zero, zero, zero]), 0.0)
            # Some 100 n products of up to 10 kg * 10 m/s2 * 1 m.
            assert derivative(plant_outputs(chain, x).E_pot, 1) == pytest.approx(torque[j], abs=1e-11)
