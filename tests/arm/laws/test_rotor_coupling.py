"""The rotors as bodies on the links, (4), (7), (10)-(11): feedforward, momentum, energy, limit of Spong's model."""

import dataclasses

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from tests.arm.laws.counting import count_operations, counting_chain
from vdfmu.arm.equations.desired_drive import desired_drive_motion
from vdfmu.arm.equations.feedforward import feedforward_inverse
from vdfmu.arm.equations.flexible_joint import driven_rotor_forces, rotor_acceleration, rotor_velocities, split_state
from vdfmu.arm.equations.forward_dynamics import forward_dynamics
from vdfmu.arm.equations.inverse_dynamics import inverse_dynamics, link_motion, link_velocities
from vdfmu.arm.equations.kinematics import joint_transforms
from vdfmu.arm.equations.plant import equilibrium_torque, plant_derivative
from vdfmu.arm.equations.rigid_body import mass_matrix
from vdfmu.arm.equations.trajectory import desired_motion
from vdfmu.arm.robot import load_robot

EPS = np.finfo(float).eps


@pytest.fixture(scope="module")
def coupled(arm):
    return dataclasses.replace(arm, rotor_coupling=True)


def test_a_robot_file_that_does_not_say_has_coupled_rotors(arm):
    assert load_robot("planar_2dof").rotor_coupling
    assert not arm.rotor_coupling  # the paper's (46), (53) and (56)


def test_the_first_rotor_stands_on_the_ground(coupled, draw):
    # Joint 1 alone, rotors 2 to 6 without inertia: both forms give the same accelerations.
    light = coupled.with_parameters(I_m=[0.00114, 1e-12, 1e-12, 1e-12, 1e-12, 1e-12])
    for state in draw(coupled, 3, seed=80):
        tau = np.zeros(6)
        tau[1:] = state.tau_s[1:] / coupled.ell[1:]  # no torque on the light rotors, which would spin up
        light_free = light.with_parameters(f_c=0.0, f_s=0.0, f_v=0.0)
        a, b = (
            plant_derivative(dataclasses.replace(light_free, rotor_coupling=coupling), state.x, tau, np.zeros(6))
            for coupling in (True, False)
        )
        # Torques of 1e-12 kg m2 times 200 rad/s squared, over 0.002 kg m2: 1e-9 for the links and rotor 1.
        np.testing.assert_allclose(a[6:13], b[6:13], rtol=0, atol=1e-7)


@pytest.mark.heavy
def test_free_fall_of_the_paper_s_arm_differs_by_0_3_degrees_and_the_inverse_by_a_microradian(
    coupled, arm, plant_solver
):
    """From q = 0 and static equilibrium, 0.5 s, joint 5."""
    for friction, degrees in ((1.0, 0.307), (0.0, 0.393)):
        ends = []
        for robot in (coupled, arm):
            robot = robot.with_parameters(f_c=friction * robot.f_c, f_s=friction * robot.f_s, f_v=friction * robot.f_v)
            integrator = plant_solver(robot)
            integrator.tolerance = 1e-9
            integrator.x[:] = np.concatenate([np.zeros(18), equilibrium_torque(robot, np.zeros(6))])
            integrator.advance(0.0, 0.5)
            ends.append(np.degrees(integrator.x[:6]))
        difference = np.abs(ends[0] - ends[1])
        assert difference.argmax() == 4
        assert difference[4] == pytest.approx(degrees, abs=0.0005)  # the digits of the figures
    # The rotor's place lacks D' I_m D_ddot. Along the paper's motion D = 0.002 rad changes within 10 s: D_ddot is of
    # order 0.002 (2 pi / 10)^2 = 1e-3 rad/s2 and what is left out 1e-4 rad/N.m * 1e-3 kg.m2 * 1e-3 = 1e-10 rad.
    end = np.radians([90.0, 60.0, 60.0, 90.0, 60.0, 90.0])
    compliance = 1.0 / coupled.K_f0 + 1.0 / (coupled.ell**2 * coupled.K_w0)
    for t in np.linspace(0.1, 9.9, 50):
        desired = desired_motion(t, np.zeros(6), end, 10.0)
        left_out = feedforward_inverse(coupled, desired).tau_s - desired_drive_motion(coupled, desired).tau_s
        assert np.abs(compliance * left_out).max() < 1e-9


@pytest.mark.heavy
@pytest.mark.parametrize("rotor", [True, False])
def test_angular_momentum_changes_by_the_torque_of_the_base_alone(coupled, plant_function, rotor):
    """H about the base axis, with the rotors' spin: the ground turns link 1 by tau_s and rotor 1 by its own torque."""
    robot = coupled.with_parameters(f_c=0.0, f_s=0.0, f_v=0.0)
    if not rotor:
        robot = dataclasses.replace(robot, rotor_coupling=False)
    tau = np.array([0.05, -0.1, 0.1, 0.02, -0.02, 0.03])
    derivative = plant_function(robot, "derivatives")

    def momentum(x):
        state = split_state(robot, x)
        motion = link_motion(robot, state.q, state.q_dot, np.zeros(6))
        V_D = rotor_velocities(robot, motion.V_B, state.kappa_dot, np.zeros(6))
        H, U = 0.0, np.eye(6)
        for i, U_AB in enumerate(joint_transforms(robot, state.q)):
            # Rotor i lies on the link before it, with axis `rotation @ z` there.
            axis = (U[3:, 3:] @ robot.rotation[i][:, 2])[2]
            H += robot.I_m[i] / robot.ell[i] * V_D[i][5] * axis
            U = U @ U_AB
            body = mass_matrix(robot.mass[i], robot.centroid[i], robot.inertia[i])
            H += (U @ (body @ motion.V_B[i]))[5]
        return H

    def rate(_, y):
        x_dot = derivative(y[:-1], tau, np.zeros(6))
        tau_s = y[18]
        return np.append(x_dot, tau_s + (tau[0] - tau_s / robot.ell[0]))

    x = np.concatenate([np.linspace(0.3, 0.9, 6), np.full(6, 0.4), np.full(6, 0.2), np.full(6, 2.0)])
    solution = solve_ivp(rate, (0.0, 0.1), np.append(x, 0.0), method="DOP853", rtol=1e-10, atol=1e-10)
    change = momentum(solution.y[:-1, -1]) - momentum(x)
    # 1e-10 in every state, some 500 steps, times momenta of up to 2 kg m2: 1e-7. Without the reaction the balance is
    # off by the rotors' own moments, J_r ell kappa_ddot = I_m kappa_ddot of 1e-1 N m: it does not close.
    error = abs(change - solution.y[-1, -1])
    assert error < 1e-7 if rotor else error > 1e-4


def test_pure_rotation_is_the_limit_of_large_ratios(coupled, draw):
    """Spong's reduced model: with the reflected inertia I_m ell kept, the reaction vanishes as 1 / ell."""
    state = draw(coupled, 1, seed=81)[0]
    free = coupled.with_parameters(f_c=0.0, f_s=0.0, f_v=0.0)
    distance = []
    for k in (1.0, 10.0, 100.0):
        robot = free.with_parameters(ell=k * free.ell, I_m=free.I_m / k, K_w0=free.K_w0 / k**2, c_w=k * free.c_w)
        a, b = (
            plant_derivative(dataclasses.replace(robot, rotor_coupling=on), state.x, state.tau / k, state.F_e)
            for on in (True, False)
        )
        distance.append(np.abs(a - b).max())
    # First order in 1 / ell, and the gyroscopic part too: ratios of 10, the rest is rounding (1e-13 of 1e4 rad/s2).
    assert distance[0] / distance[1] == pytest.approx(10.0, rel=0.2)
    assert distance[1] / distance[2] == pytest.approx(10.0, rel=0.02)


def test_the_cost_stays_linear_in_the_number_of_joints():
    """Operations of the plant's acceleration and of the inverse dynamics with rotors: no quadratic part, exactly."""

    def count(n):
        def equations(counter):
            drives = {"ell": counter.array(n), "I_m": counter.array(n)}
            robot = dataclasses.replace(counting_chain(n, counter), **drives)
            x = counter.array(n)
            F_Dk = driven_rotor_forces(robot, link_velocities(robot, x, x), x, x)
            q_ddot = forward_dynamics(robot, x, x, x, np.zeros(6), F_Dk)
            rotor_acceleration(robot, x, link_motion(robot, x, x, q_ddot))
            inverse_dynamics(robot, x, x, x, rotors=(x, x))

        return np.array(count_operations(equations))

    counts = np.array([count(n) for n in (2, 3, 4, 5)])
    np.testing.assert_array_equal(np.diff(counts, 2, axis=0), 0)
    assert (np.diff(counts, axis=0)[0] > 0).all()
