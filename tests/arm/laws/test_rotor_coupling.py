"""How much coupled rotors matter to the paper's arm; the plant against bodies is in dynamics/test_rotor_bodies.py."""

import dataclasses

import numpy as np
import pytest

from vdfmu.arm.equations.desired_drive import desired_drive_motion
from vdfmu.arm.equations.feedforward import feedforward_inverse
from vdfmu.arm.equations.plant import equilibrium_torque, plant_derivative
from vdfmu.arm.equations.trajectory import desired_motion
from vdfmu.arm.robot import load_robot


@pytest.fixture(scope="module")
def coupled(arm):
    return dataclasses.replace(arm, rotor_coupling=True)


def test_a_robot_file_that_does_not_say_has_coupled_rotors(arm):
    assert load_robot("planar_2dof").rotor_coupling
    assert not arm.rotor_coupling  # the paper's (46), (53) and (56)


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
    # order 0.002 (2 pi / 10)^2 = 1e-3 rad/s2 and the omitted term 1e-4 rad/N.m * 1e-3 kg.m2 * 1e-3 = 1e-10 rad.
    end = np.radians([90.0, 60.0, 60.0, 90.0, 60.0, 90.0])
    compliance = 1.0 / coupled.K_f0 + 1.0 / (coupled.ell**2 * coupled.K_w0)
    for t in np.linspace(0.1, 9.9, 50):
        desired = desired_motion(t, np.zeros(6), end, 10.0)
        left_out = feedforward_inverse(coupled, desired).tau_s - desired_drive_motion(coupled, desired).tau_s
        assert np.abs(compliance * left_out).max() < 1e-9


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
