"""Laws of rigid bodies and chains: definiteness, kinetic energy, skew symmetry, the extended Jacobian."""

import numpy as np
import pytest

from vdfmu.arm.equations.inverse_dynamics import link_motion
from vdfmu.arm.equations.mapping import extended_jacobian, joint_space_jacobian
from vdfmu.arm.equations.rigid_body import coriolis_force, coriolis_matrix, mass_matrix

EPS = np.finfo(float).eps


def test_body_mass_matrix_is_positive_definite_and_gives_the_kinetic_energy_of_its_points(chain):
    for i in range(chain.n):
        M_B = mass_matrix(*chain.body(i))
        # The two halves are the same products in another order: one rounding of the largest entry.
        np.testing.assert_allclose(M_B, M_B.T, rtol=0, atol=EPS * np.abs(M_B).max())
        assert np.linalg.eigvalsh(M_B).min() > 0
    # A body of eight points: its kinetic energy is the sum over the points, whatever frame (60) uses.
    random = np.random.default_rng(1)
    points, m = random.normal(size=(8, 3)), random.uniform(0.1, 1.0, 8)
    r = m @ points / m.sum()
    I_B = sum(k * (np.dot(p - r, p - r) * np.eye(3) - np.outer(p - r, p - r)) for k, p in zip(m, points, strict=True))
    V_B = random.normal(size=6)
    energy = sum(0.5 * k * np.sum((V_B[:3] + np.cross(V_B[3:], p)) ** 2) for k, p in zip(m, points, strict=True))
    # A sum of about 100 products of order 1: 100 roundings.
    np.testing.assert_allclose(0.5 * V_B @ mass_matrix(m.sum(), r, I_B) @ V_B, energy, rtol=100 * EPS)


def test_coriolis_force_is_the_product_with_a_skew_symmetric_matrix(chain, draw):
    for state in draw(chain, 20, seed=12):
        V_B = state.F_e
        for i in range(chain.n):
            body = chain.body(i)
            C_B = coriolis_matrix(*body, V_B[3:])
            # Both are sums of at most 100 products below max|C_B| max|V_B|: 100 roundings.
            bound = 100 * EPS * np.abs(C_B).max() * np.abs(V_B).max()
            np.testing.assert_allclose(coriolis_force(*body, V_B), C_B @ V_B, rtol=0, atol=bound)
    for state in draw(chain, 20, seed=2):
        omega = state.F_e[3:]
        for i in range(chain.n):
            C_B = coriolis_matrix(*chain.body(i), omega)
            # Every entry is a sum of at most 18 products below max|C_B|: 20 roundings.
            np.testing.assert_allclose(C_B, -C_B.T, rtol=0, atol=20 * EPS * np.abs(C_B).max())


def test_extended_jacobian_maps_the_end_effector_to_all_velocities(arm, draw):
    for state in draw(arm, 5, seed=19):
        motion = link_motion(arm, state.q, state.q_dot, state.q_ddot)
        V_O = motion.V_B[-1]
        J_a = joint_space_jacobian(arm, state.q)
        # The inverse costs cond(J_q) roundings; 100 for the products.
        atol = 100 * EPS * np.linalg.cond(J_a) * 10
        np.testing.assert_allclose(J_a @ V_O, state.q_dot, rtol=0, atol=atol)
        expected = np.concatenate([V_O, state.q_dot, *motion.V_B])
        np.testing.assert_allclose(extended_jacobian(arm, state.q) @ V_O, expected, rtol=0, atol=atol)


def test_joint_space_jacobian_needs_six_joints(planar):
    with pytest.raises(ValueError, match="needs a square Jacobian, so six joints; robot 'planar_2dof' has 2"):
        joint_space_jacobian(planar, np.zeros(2))
