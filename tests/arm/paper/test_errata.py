"""Every erratum of the paper: what is printed, what it would do, and what is built instead.

The second entry of omega_B5 is in test_link_velocities.py, the direction of l2 in test_table_3.py.
"""

import dataclasses

import numpy as np
import pytest

from vdfmu.arm.equations.feedforward import FeedbackGains, feedforward_inverse, feedforward_vdc
from vdfmu.arm.equations.flexible_joint import rotor_acceleration, rotor_torque
from vdfmu.arm.equations.friction import coulomb_friction, joint_friction, stribeck_friction
from vdfmu.arm.equations.harmonic_drive import wave_generator_position
from vdfmu.arm.equations.inverse_dynamics import inverse_dynamics, link_motion
from vdfmu.arm.equations.kinematics import end_effector_pose, joint_rotation
from vdfmu.arm.equations.mapping import (
    extended_jacobian,
    jacobian,
    joint_space_jacobian,
    joint_space_mass_matrix,
    velocity_mapping,
)
from vdfmu.arm.equations.plant import equilibrium_torque, plant_outputs
from vdfmu.arm.equations.spatial import joint_axis
from vdfmu.arm.equations.trajectory import desired_motion
from vdfmu.compiler.scalar.jet import derivative, jets

EPS = np.finfo(float).eps
Q = np.array([0.3, 0.4, -0.9, 0.7, 0.8, -0.2])


def test_erratum_1_has_ratio_minus_ell_or_ell_plus_1_where_the_rest_has_ell(arm):
    # (1): circular spline fixed, the wave generator turns by -ell; flexspline fixed, by ell + 1.
    assert wave_generator_position(0.0, 0.01, 100.0) == -1.0
    assert wave_generator_position(0.01, 0.0, 100.0) == pytest.approx(1.01, rel=2 * EPS)
    # Everywhere else the rotor is at +ell kappa, and kappa follows q: built so.
    q = np.full(6, 0.01)
    kappa = plant_outputs(arm, np.concatenate([q, np.zeros(18)])).kappa
    np.testing.assert_array_equal(arm.ell * kappa, np.ones(6))


def test_erratum_15_to_17_and_50_need_the_required_acceleration(arm):
    # Printed: F*_r = F* + K (V_r - V), with F* of the actual motion. At the start of a motion, where nothing
    # moves yet (V = V_r, V_dot = 0), that is weight alone: nothing would accelerate the arm. Built: F*_r = M
    # V_r_dot + C V_r + G.
    zero = np.zeros(6)
    q_ddot_d = np.linspace(0.5, 2.0, 6)
    desired = desired_motion(0.0, Q, Q, 1.0)._replace(q_d_ddot=q_ddot_d)
    gains = FeedbackGains(*np.full((4, 6), 3.0))
    built = feedforward_vdc(arm, gains, desired, Q, zero, zero * 0.0).tau_s
    printed = inverse_dynamics(arm, Q, zero, zero)
    M = joint_space_mass_matrix(arm, Q)
    # Torques of up to 30 N m and some 1000 products.
    np.testing.assert_allclose(built - printed, M @ q_ddot_d, rtol=0, atol=1e-11)
    assert np.abs(built - printed).max() > 1.0


def test_erratum_28_counts_the_spring_torque_twice(arm):
    # At rest under gravity (27) gives tau = tau_t = tau_s / ell, which holds the rotor still.
    zero = np.zeros(6)
    tau_s = equilibrium_torque(arm, Q)
    desired = desired_motion(0.0, Q, Q, 1.0)
    tau = feedforward_inverse(arm, desired).tau_m
    # D is evaluated on jets, the same operations: some roundings of 0.3 N m.
    np.testing.assert_allclose(tau, tau_s / arm.ell, rtol=0, atol=1e-15)
    assert np.abs(rotor_acceleration(arm, rotor_torque(arm, tau, tau_s, zero))).max() <= 1e-15 / 0.00114
    # Printed, tau_m = tau + tau_f adds the link-side torque: 1 + ell times what is needed.
    printed = tau + tau_s
    np.testing.assert_allclose(printed, 101.0 * tau_s / arm.ell, rtol=0, atol=1e-13)
    # Brought to the motor side it still is twice the torque, and the rotor runs away at tau_s / (ell I_m).
    same_side = tau + tau_s / arm.ell
    np.testing.assert_allclose(same_side, 2.0 * tau_s / arm.ell, rtol=0, atol=1e-14)
    assert np.abs(rotor_acceleration(arm, rotor_torque(arm, same_side, tau_s, zero))).max() > 100.0


def test_erratum_30_31_run_to_joint_6(arm, draw):
    # Printed for i = 2..5; (40), (44) and (47) then have no V_B6. Built to i = n.
    state = draw(arm, 1, seed=52)[0]
    motion = link_motion(arm, state.q, state.q_dot, state.q_ddot)
    assert len(motion.V_B) == len(motion.U_AB) == 6
    z = joint_axis("revolute")
    np.testing.assert_array_equal(motion.V_B[5], z * state.q_dot[5] + motion.U_AB[5].T @ motion.V_B[4])
    # Without link 6 the arm would be lighter by 1.2 kg: other torques at every joint but the ones gravity
    # misses.
    cut = arm.with_parameters(
        mass=np.append(arm.mass[:5], 0.0), inertia=arm.inertia * (np.arange(6) < 5)[:, None, None]
    )
    difference = np.subtract(*(inverse_dynamics(r, state.q, state.q_dot, state.q_ddot) for r in (arm, cut)))
    assert (np.abs(difference) > 1e-3).all()


def test_erratum_34_to_36_are_relative_to_the_previous_link_not_to_I(arm):
    # Printed label: {I}. Read so, {B_2} in {I} would not turn with joint 1.
    q = Q.copy()
    printed_T_B2 = joint_rotation(arm, 1, q[1])
    c2, s2 = np.cos(q[1]), np.sin(q[1])
    np.testing.assert_array_equal(printed_T_B2, [[c2, -s2, 0.0], [0.0, 0.0, -1.0], [s2, c2, 0.0]])
    motion = link_motion(arm, q, np.eye(6)[0], np.zeros(6))
    # Turning joint 1 alone turns link 2 by 1 rad/s: its printed omega_B2 says so as well. One rounding.
    np.testing.assert_allclose(motion.V_B[1][3:], [s2, c2, 0.0], rtol=0, atol=EPS)
    # The product of the relative matrices is the pose: its columns move with q1.
    R = end_effector_pose(arm, q)[1]
    q[0] += 0.5
    assert np.abs(end_effector_pose(arm, q)[1] - R).max() > 0.1


def test_erratum_T_i_has_the_axes_of_the_previous_link(arm):
    # The paper says that the z axis of {T_i} is joint i's. {T_i} is {B_(i-1)} moved without turning, so joint
    # 2's axis in {T_2} is the third column of (34), -y, not z.
    for i, axis in ((1, [0, -1, 0]), (3, [1, 0, 0]), (4, [0, -1, 0]), (5, [0, 1, 0])):
        np.testing.assert_array_equal(joint_rotation(arm, i, 0.7)[:, 2], axis)


def test_erratum_38_has_an_outer_transpose_too_many(arm, draw):
    for state in draw(arm, 5, seed=53):
        V_O = link_motion(arm, state.q, state.q_dot, state.q_ddot).V_B[5]
        J_q = jacobian(arm, state.q)
        # Some 50 products of order 1 m/s.
        np.testing.assert_allclose(J_q @ state.q_dot, V_O, rtol=0, atol=1e-14)
        assert np.abs(J_q.T @ state.q_dot - V_O).max() > 0.1  # as printed


def test_erratum_39_has_no_solution_at_q5_0(arm):
    # Joints 4 and 6 then turn about one line: J_q has rank 5. Trajectory (57) starts there.
    start = desired_motion(0.0, np.zeros(6), np.ones(6), 10.0).q_d
    for q in (start, np.where(np.arange(6) == 4, 0.0, Q)):
        singular = np.linalg.svd(jacobian(arm, q), compute_uv=False)
        # Zero to rounding, over a largest value of about 2.
        assert singular[5] < 1e-15
        with pytest.raises(np.linalg.LinAlgError, match=r"J_q is singular: Eq. \(39\)"):
            joint_space_jacobian(arm, q)
        # The generalized velocities that the paper maps by (41) exist all the same, from q_dot.
        assert np.isfinite(velocity_mapping(arm, q)).all()
    # Away from there the inverse exists; its error is cond(J_q) roundings.
    J_q = jacobian(arm, Q)
    error = np.abs(J_q @ joint_space_jacobian(arm, Q) - np.eye(6)).max()
    assert error < 10 * EPS * np.linalg.cond(J_q)


def test_erratum_J_ba_is_42_by_6_not_72_by_6(arm):
    # (40) has 6 (6 + 1) = 42 rows, (42) 48.
    assert velocity_mapping(arm, Q).shape == (42, 6)
    assert extended_jacobian(arm, Q).shape == (48, 6)


def test_erratum_f_v_is_in_newton_metre_seconds_per_radian(arm):
    # Table 2 prints kg m/s. The same arm in mm (mass in kg, time in s): torque in kg mm2/s2 is 1e6 times that
    # in N m. A coefficient in kg m2/s scales as torque does; one in kg m/s by 1e3, and the friction would
    # depend on the unit.
    v = np.array([0.3, -0.2, 1.0, 0.05, 0.4, -1.0])
    xi = stribeck_friction(arm, v)
    torque, length = 1e6, 1e3
    consistent = arm.with_parameters(f_c=torque * arm.f_c, f_s=torque * arm.f_s, f_v=torque * arm.f_v)
    # One rounding for each factor.
    np.testing.assert_allclose(stribeck_friction(consistent, v), torque * xi, rtol=10 * EPS)
    printed = arm.with_parameters(f_c=torque * arm.f_c, f_s=torque * arm.f_s, f_v=length * arm.f_v)
    lost = np.abs(stribeck_friction(printed, v) / torque - xi)
    np.testing.assert_allclose(lost, (1.0 - 1e-3) * arm.f_v * np.abs(v), rtol=1e-9)


def test_erratum_55_lacks_its_sign(arm):
    # Printed, xi(kappa) = f_ck whatever the direction: turning backwards it drives the rotor instead of
    # braking it.
    backwards = np.full(6, -0.5)
    assert (arm.f_ck * backwards < 0).all()
    built = coulomb_friction(arm, backwards)
    # tanh(-500) is -1 to the last bit.
    np.testing.assert_array_equal(built, -arm.f_ck)
    assert (built * backwards > 0).all()


def test_sign_of_G_B_is_for_g_upwards(arm):
    # (62) is the force that holds the link: with g = [0, 0, +9.81] it is the slope of the potential energy.
    zero = np.zeros(6)
    holding = inverse_dynamics(arm, Q, zero, zero)
    slope = []
    for j in range(6):
        x = jets(np.concatenate([Q, np.zeros(18)]), np.eye(24)[j], 0.0)
        slope.append(derivative(plant_outputs(arm, x).E_pot, 1))
    # Some 100 products of up to 30 N m.
    np.testing.assert_allclose(holding, slope, rtol=0, atol=1e-12)
    # With the usual g = [0, 0, -9.81] the same equation pushes the arm down.
    down = inverse_dynamics(arm.with_parameters(gravity=[0.0, 0.0, -9.81]), Q, zero, zero)
    np.testing.assert_array_equal(down, -holding)
    assert np.abs(holding).max() > 1.0


def friction_slope(robot, velocities):
    return np.array([derivative(stribeck_friction(robot, jets(np.full(robot.n, v), 1.0, 0.0)), 1) for v in velocities])


def test_falling_branch_of_the_friction_reaches_minus_13_to_minus_17(arm):
    slope = friction_slope(arm, np.linspace(0.01, 0.4, 2000)).min(axis=0)
    # Steepest at v_s / sqrt(2): -(f_s - f_c) / v_s * sqrt(2 / e) + f_v. 2000 points find a minimum that is
    # flat to (spacing / v_s)^2 = 1e-4 or better.
    closed = -(arm.f_s - arm.f_c) / arm.v_s * np.sqrt(2.0 / np.e) + arm.f_v
    np.testing.assert_allclose(slope, closed, rtol=1e-3)
    assert -17.2 < slope.min() < -17.0 and -13.5 < slope.max() < -13.2


def closed_loop_growth(robot, jacobian_of, K_p, K_v):
    """Return the largest real part [1/s] of the eigenvalues under PD, at the steepest friction."""
    n = robot.n
    v = robot.v_s / np.sqrt(2.0)
    x = np.concatenate([Q, v, v, equilibrium_torque(robot, Q)])
    J = jacobian_of(x, np.zeros(n), np.zeros(6))
    rotor = slice(2 * n, 3 * n)
    J[rotor, :n] -= np.diag(K_p / robot.ell / robot.I_m)
    J[rotor, rotor] -= np.diag(K_v / robot.ell / robot.I_m)
    return np.linalg.eigvals(J).real.max()


def test_split_friction_self_excites_and_lumped_does_not(arm, plant_function):
    K_p = np.array([2000.0, 2000.0, 2000.0, 1000.0, 1000.0, 500.0])
    K_v = np.array([50.0, 50.0, 40.0, 30.0, 25.0, 20.0])
    split = dataclasses.replace(arm, friction="split")
    of_split, of_arm = (plant_function(r, "jacobian") for r in (split, arm))
    # On the link of the wrist, 0.002 kg m2 and somewhat more: a growth of up to 17 / 0.002 = 8000 1/s, which
    # PD on the rotor cannot reach through the spring, whatever its gain.
    for gain in (1.0, 10.0):
        assert closed_loop_growth(split, of_split, K_p, gain * K_v) > 1000.0
    # On the rotor K_v of 20 and more outweighs a slope of -17.
    assert closed_loop_growth(arm, of_arm, K_p, K_v) < 0.0
    # Without control both have growing modes: the falling branch is a negative damper.
    assert closed_loop_growth(arm, of_arm, 0 * K_p, 0 * K_v) > 10.0


def test_lumped_friction_leaves_out_the_rotors_own(arm):
    assert "lumped" == arm.friction
    strong = arm.with_parameters(f_ck=1e3)
    friction, expected = (joint_friction(r, np.ones(6), np.ones(6)) for r in (arm, strong))
    np.testing.assert_array_equal(friction, expected)
