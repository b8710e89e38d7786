"""Laws of rigid bodies and chains: definiteness, skew symmetry, momentum, virtual power, inversion."""

import numpy as np
import pytest

from vdfmu.arm.equations.inverse_dynamics import inverse_dynamics, joint_torques, link_forces, link_motion
from vdfmu.arm.equations.kinematics import end_effector_pose, tool_transform
from vdfmu.arm.equations.mapping import (
    extended_jacobian,
    joint_space_jacobian,
    joint_space_mass_matrix,
    velocity_mapping,
)
from vdfmu.arm.equations.rigid_body import coriolis_force, coriolis_matrix, mass_matrix, net_force
from vdfmu.arm.equations.spatial import force_transform, homogeneous_transform, skew
from vdfmu.compiler.scalar.jet import derivative, jets

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


def test_net_force_is_the_rate_of_momentum_plus_weight():
    # Newton and Euler in {I}: d/dt (U M_B V_B) for a body that moves freely, by jets of its pose.
    random = np.random.default_rng(3)
    m, r = 1.7, random.normal(size=3)
    points = random.normal(size=(6, 3))
    points -= points.mean(axis=0)
    I_B = sum(np.dot(p, p) * np.eye(3) - np.outer(p, p) for p in points)
    R, _ = np.linalg.qr(random.normal(size=(3, 3)))
    R *= np.linalg.det(R)
    p, V, V_dot = random.normal(size=3), random.normal(size=6), random.normal(size=6)
    # R_dot = R (w x), p_dot = R v: a jet of first order of the transform (32) and of V
    R_jet = jets(R, R @ skew(V[3:]), 0.0)
    p_jet = jets(p, R @ V[:3], 0.0)
    U = force_transform(R_jet, p_jet)
    momentum = U @ (mass_matrix(m, r, I_B) @ jets(V, V_dot, 0.0))
    g = np.array([0.0, 0.0, 9.81])
    F = force_transform(R, p) @ net_force(m, r, I_B, R.T @ g, V, V_dot)
    weight = np.concatenate([m * g, np.cross(p + R @ r, m * g)])
    # Sums of some 100 products; 1e-12 of the largest entry is 5000 roundings.
    np.testing.assert_allclose(F, derivative(momentum, 1) + weight, rtol=0, atol=1e-12 * np.abs(F).max())


def test_transforms_keep_power_and_follow_the_chained_poses(chain, draw):
    # F_A = U_AB F_B and V_B = U_AB.T V_A: the power of a wrench is the same in every frame.
    random = np.random.default_rng(4)
    Q, _ = np.linalg.qr(random.normal(size=(3, 3)))
    U_AB = force_transform(Q * np.linalg.det(Q), random.normal(size=3))
    V_A, F_B = random.normal(size=6), random.normal(size=6)
    # 42 products of order 1: 50 roundings.
    np.testing.assert_allclose(V_A @ (U_AB @ F_B), (U_AB.T @ V_A) @ F_B, rtol=0, atol=50 * EPS * 10)
    # (33) and (32) describe the same frames: products of one agree with products of the other.
    for state in draw(chain, 5, seed=5):
        T, U = np.eye(4), np.eye(6)
        motion = link_motion(chain, state.q, state.q_dot, state.q_ddot)
        for U_AB in motion.U_AB:
            S = U_AB[3:, :3] @ U_AB[:3, :3].T
            T = T @ homogeneous_transform(U_AB[:3, :3], np.array([S[2, 1], S[0, 2], S[1, 0]]))
            U = U @ U_AB
        p_O, R_O = end_effector_pose(chain, state.q)
        # n products of matrices with entries up to the reach (q of a prismatic joint is up to pi m): 1e-13.
        np.testing.assert_allclose(T[:3, :3] @ chain.tool_rotation, R_O, rtol=0, atol=1e-14)
        np.testing.assert_allclose(T[:3, :3] @ chain.tool_offset + T[:3, 3], p_O, rtol=0, atol=1e-13)
        np.testing.assert_allclose(force_transform(T[:3, :3], T[:3, 3]), U, rtol=0, atol=1e-13)


def coriolis_in_joint_space(robot, q, q_dot):
    """Return C of ``C q_dot`` by the mapping (40)-(41): J.T (M J_dot + C_B J), summed over the links."""
    zero = np.zeros(robot.n)
    J = velocity_mapping(robot, q)
    J_dot = derivative(velocity_mapping(robot, jets(q, q_dot, zero)), 1)
    C = np.zeros((robot.n, robot.n))
    for i in range(robot.n):
        rows = slice(6 * (i + 1), 6 * (i + 2))
        body = robot.body(i)
        omega = J[rows][3:] @ q_dot
        C += J[rows].T @ (mass_matrix(*body) @ J_dot[rows] + coriolis_matrix(*body, omega) @ J[rows])
    return C


def test_coriolis_matrix_in_joint_space_gives_the_velocity_torques_and_the_rate_less_twice_it_is_skew(chain, draw):
    for state in draw(chain, 10, seed=10):
        q, q_dot = state.q, state.q_dot
        C = coriolis_in_joint_space(chain, q, q_dot)
        M_dot = derivative(joint_space_mass_matrix(chain, jets(q, q_dot, np.zeros(chain.n))), 1)
        N = M_dot - 2.0 * C
        # Sums of some 1000 products of the size of the largest entries.
        np.testing.assert_allclose(N, -N.T, rtol=0, atol=1000 * EPS * np.abs(C).max())
    for state in draw(chain, 10, seed=11):
        zero = np.zeros(chain.n)
        torque = inverse_dynamics(chain, state.q, state.q_dot, zero) - inverse_dynamics(chain, state.q, zero, zero)
        product = coriolis_in_joint_space(chain, state.q, state.q_dot) @ state.q_dot
        # As above; the subtraction of gravity adds roundings of its torques, up to some 100 N m.
        np.testing.assert_allclose(product, torque, rtol=0, atol=1e-12 * max(100.0, np.abs(torque).max()))


def test_virtual_power_flows_at_cutting_points_cancel(chain, draw):
    # What leaves link i-1 at its driving cutting point {T_i} enters link i and joint i, for any difference of
    # required and actual quantities: the flows are bilinear, so it holds for V and F as for V_r - V and F_r -
    # F.
    for state, other in zip(draw(chain, 10, seed=13), draw(chain, 10, seed=14), strict=True):
        motion = link_motion(chain, state.q, state.q_dot, state.q_ddot)
        wanted = link_motion(chain, state.q, other.q_dot, other.q_ddot)
        F = np.subtract(link_forces(chain, wanted, other.F_e), link_forces(chain, motion, state.F_e))
        V = np.subtract(wanted.V_B, motion.V_B)
        tau, rate = joint_torques(chain, list(F)), other.q_dot - state.q_dot
        F_star = [F[i] - motion.U_AB[i + 1] @ F[i + 1] for i in range(chain.n - 1)]
        F_star.append(F[-1] - tool_transform(chain) @ (other.F_e - state.F_e))
        V_O = tool_transform(chain).T @ V[-1]
        size = sum(abs(V[i] @ F[i]) + abs(tau[i] * rate[i]) for i in range(chain.n))
        for i in range(1, chain.n):
            driving = V[i - 1] @ (motion.U_AB[i] @ F[i])  # {T_i} is fixed to link i-1
            driven = V[i] @ F[i]
            # 42 products for a flow: 100 roundings of the sum of all flows.
            np.testing.assert_allclose(driven - driving, tau[i] * rate[i], rtol=0, atol=100 * EPS * size)
        # So all inner flows cancel: joints in, end effector out, the rest is the power of the net forces.
        net = sum(V[i] @ F_star[i] for i in range(chain.n))
        outer = tau @ rate - V_O @ (other.F_e - state.F_e)
        np.testing.assert_allclose(net, outer, rtol=0, atol=100 * chain.n * EPS * size)


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
