"""Laws of harmonic drive and flexible joint: (2)-(11), D and its derivative, the limit of stiff joints."""

import dataclasses

import numpy as np
import pytest
from scipy.integrate import quad

from tests.arm.balanced import EVERY_CHAIN
from vdfmu.arm.equations.flexible_joint import (
    PlantState,
    link_torques,
    rotor_acceleration,
    rotor_position,
    rotor_torque,
    rotor_velocity,
    spring_rate,
)
from vdfmu.arm.equations.forward_dynamics import forward_dynamics
from vdfmu.arm.equations.harmonic_drive import (
    deformation,
    deformation_derivative,
    kinematic_error,
    kinematic_error_slope,
    spring_energy,
)
from vdfmu.arm.equations.mapping import joint_space_mass_matrix
from vdfmu.arm.equations.plant import equilibrium_torque, plant_derivative
from vdfmu.arm.equations.spatial import force_transform, joint_axis
from vdfmu.compiler.scalar.jet import derivative, jets

EPS = np.finfo(float).eps
TORQUES = (-80.0, -7.0, -1e-3, 0.0, 1e-6, 0.3, 20.0, 80.0)


def test_deformation_is_odd_and_strictly_increasing(chain):
    torque = np.linspace(0.0, 100.0, 400)
    D = np.array([deformation(chain, np.full(chain.n, t)) for t in torque])
    assert (np.diff(D, axis=0) > 0).all()
    # Every operation on -t is that on t with the other sign: exact.
    mirrored = np.array([deformation(chain, np.full(chain.n, -t)) for t in torque])
    np.testing.assert_array_equal(mirrored, -D)


@pytest.mark.parametrize("torque", TORQUES)
def test_compliance_is_the_derivative_of_the_deformation(chain, torque):
    t = np.full(chain.n, torque)
    by_jet = derivative(deformation(chain, jets(t, 1.0, 0.0)), 1)
    # Two forms of the same few operations: 10 roundings.
    np.testing.assert_allclose(deformation_derivative(chain, t), by_jet, rtol=10 * EPS)
    assert (by_jet > 0).all()


@pytest.mark.parametrize("torque", [-40.0, -0.1, 3.0, 40.0])
def test_spring_energy_is_the_work_done_on_the_spring(chain, torque):
    for i in range(chain.n):

        def power(t, i=i):
            return t * deformation_derivative(chain, np.full(chain.n, t))[i]

        work, _ = quad(power, 0.0, torque, epsabs=0.0, epsrel=1e-12)
        # The quadrature's own tolerance is 1e-12. The closed form subtracts two terms of order a = c_w |t| /
        # ell from one another down to a^2 / 2: relative rounding 1e-16 / a <= 1e-12 for the smallest a, 6e-4,
        # and more.
        assert spring_energy(chain, np.full(chain.n, torque))[i] == pytest.approx(work, rel=1e-11)


def test_slope_of_the_kinematic_error_is_its_derivative(general, draw):
    for state in draw(general, 10, seed=23):
        slope = derivative(kinematic_error(general, jets(state.q, np.ones(general.n), 0.0)), 1)
        # the same product in another order: 4 roundings of 2 ell A, below 1
        np.testing.assert_allclose(kinematic_error_slope(general, state.q), slope, rtol=0, atol=4 * EPS)


def test_rotor_position_solves_the_spring_equation_whose_rate_is_its_derivative(chain, draw):
    for state in draw(chain, 20, seed=20):
        kappa = rotor_position(chain, state.q, state.tau_s)
        residual = kappa - state.q - kinematic_error(chain, kappa) - deformation(chain, state.tau_s)
        # |kappa| up to 4: 4 roundings. 2 ell kappa, the error's argument, is rounded to 1e-13 and weighs A <=
        # 3e-4.
        np.testing.assert_allclose(residual, 0.0, rtol=0, atol=4 * EPS * 4)
    # Along any motion of q and tau_s, kappa_dot from the jet of rotor_position must give tau_s_dot back.
    for state in draw(chain, 10, seed=21):
        rate = state.tau
        kappa = rotor_position(chain, jets(state.q, state.q_dot, 0.0), jets(state.tau_s, rate, 0.0))
        tau_s_dot = spring_rate(chain, PlantState(state.q, state.q_dot, derivative(kappa, 1), state.tau_s))
        # kappa_dot - q_dot = D' rate cancels: roundings of 2 rad/s (4e-16, some 10 of them, 50 with the
        # error's slope), divided by D'.
        atol = 50 * EPS * 2.0 / deformation_derivative(chain, state.tau_s)
        assert (np.abs(tau_s_dot - rate) <= atol).all()


def test_the_rotor_differs_from_its_base_by_its_turn_only_and_accelerates_by_torque_over_inertia(arm):
    # (4) is the sum of (31) for one joint: the base's velocity in the new frame, and the turn about z.
    random = np.random.default_rng(22)
    V_B, p = random.normal(size=6), random.normal(size=3)
    U = force_transform(np.eye(3), p)
    carried = np.concatenate([V_B[:3] + np.cross(V_B[3:], p), V_B[3:]])
    turn = 30.0 * joint_axis("revolute")
    # Sums of 3 products of order 1.
    np.testing.assert_allclose(rotor_velocity(V_B, U, 100.0, 0.3), carried + turn, rtol=0, atol=20 * EPS * 30)
    # J_r ell kappa_ddot = tau: I_m is J_r times ell, so kappa_ddot = tau / I_m without spring and friction.
    zero = np.zeros(6)
    tau_k = rotor_torque(arm, np.full(6, 0.00114), zero, zero)
    np.testing.assert_array_equal(rotor_acceleration(arm, tau_k), np.ones(6))


def test_arm_at_rest_with_gravity_compensated_stays_at_rest(chain, draw):
    for state in draw(chain, 10, seed=24):
        zero, none = np.zeros(chain.n), np.zeros(6)
        tau_s = equilibrium_torque(chain, state.q)
        x = np.concatenate([state.q, zero, zero, tau_s])
        x_dot = plant_derivative(chain, x, tau_s / chain.ell, none)
        q_dot, q_ddot, kappa_ddot, tau_s_dot = np.split(x_dot, 4)
        np.testing.assert_array_equal(q_dot, zero)
        np.testing.assert_array_equal(tau_s_dot, zero)
        # tau - tau_s / ell is the same division twice.
        np.testing.assert_array_equal(kappa_ddot, zero)
        # Torques balance to 100 n roundings; the smallest eigenvalue of M turns them into accelerations.
        M = joint_space_mass_matrix(chain, state.q)
        size = 100 * chain.n * EPS * np.abs(tau_s).max() / np.linalg.eigvalsh(M).min()
        np.testing.assert_allclose(q_ddot, zero, rtol=0, atol=size)


def in_pure_rotation(robot):
    return dataclasses.replace(robot, rotor_coupling=False)


@EVERY_CHAIN
def test_plant_without_springs_between_is_the_rigid_arm(chain, draw):
    # The links' rows of the plant are the forward dynamics under the spring torque, whatever rotors in pure rotation
    # do.
    for state in draw(chain, 5, seed=25):
        rigid = in_pure_rotation(chain.with_parameters(f_c=0.0, f_s=0.0, f_v=0.0))
        x_dot = plant_derivative(rigid, state.x, state.tau, state.F_e)
        tau = state.tau_s + link_torques(rigid, state.q)
        q_ddot = forward_dynamics(rigid, state.q, state.q_dot, tau, state.F_e)
        np.testing.assert_array_equal(x_dot[chain.n : 2 * chain.n], q_ddot)
