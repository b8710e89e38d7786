"""Modes, linear models and margins of arms whose drives have options."""

import numpy as np
import pytest

import vdfmu
from vdfmu.arm.equations.harmonic_drive import deformation_derivative
from vdfmu.study.analysis.arm_space import least_dry_friction
from vdfmu.study.analysis.loops import run_along
from vdfmu.study.analysis.modes import natural_modes
from vdfmu.system.scenario import load_scenario
from vdfmu.system.scenario.values import system_values

POSE = (0.3, -0.5)


def test_the_linear_arm_has_the_states_of_options(with_options):
    linear = vdfmu.linearize(with_options(), POSE)
    more = ("tau_h", "tau_z", "i_m", "T_j")
    assert linear.states[8:] == tuple(f"{name}[{i}]" for name in more for i in (1, 2))
    assert linear.state_units[8:] == ("N.m",) * 4 + ("A",) * 2 + ("K",) * 2
    assert np.isfinite(linear.A).all() and linear.A.shape == (16, 16) and linear.B.shape == (16, 8)
    assert (linear.x[12:14] != 0.0).all()  # currents that hold the arm
    # torques reach the rotors by the current loop alone, which is of first order
    np.testing.assert_allclose(linear.A[12:14, 12:14], -3e3 * np.eye(2), rtol=1e-12)
    np.testing.assert_allclose(linear.B[12:14, :2], 3e3 / 0.1 * np.eye(2), rtol=1e-12)
    assert not linear.B[4:6, :2].any()


@pytest.mark.parametrize("motors", ["free", "held"])
def test_hysteresis_at_rest_is_a_stiffer_spring(with_options, motors):
    bent = with_options("hysteresis").with_parameters(gravity=0.0)
    K = 1.0 / deformation_derivative(bent, np.zeros(2))
    share = 1.0 + 5e3 / K
    plain = vdfmu.load_robot("planar_2dof").with_parameters(gravity=0.0)
    stiff = plain.with_parameters(K_f0=plain.K_f0 * share, K_w0=plain.K_w0 * share)
    modes, expected = (natural_modes(robot, POSE, motors=motors) for robot in (bent, stiff))
    # eigenvalues of up to 1e3 1/s of a matrix with entries of 1e6
    np.testing.assert_allclose(modes.frequency, expected.frequency, rtol=1e-9)
    assert (modes.frequency > 1.05 * natural_modes(plain, POSE, motors=motors).frequency).all()


@pytest.mark.parametrize("option", ["load_loss", "bristles", "winding", "thermal"])
def test_modes_without_dry_friction_are_those_of_the_bare_arm(with_options, option):
    robot = with_options(option, T_ref=300.0)
    for motors in ("free", "held"):
        modes, bare = (natural_modes(arm, POSE, motors=motors) for arm in (robot, with_options("backlash", w_gap=0.0)))
        np.testing.assert_allclose(modes.frequency, bare.frequency, rtol=1e-8)
        np.testing.assert_allclose(modes.damping, bare.damping, rtol=0, atol=1e-9)


@pytest.mark.heavy
def test_margins_know_the_delay_of_the_current_loop_and_without_dry_friction_nothing_of_it(with_options):
    def modulus(*options, **changes):
        scenario = load_scenario("planar_tracking", with_options(*options, **changes))
        with run_along(scenario, again=True) as (poses, _, _):
            return poses.changed({"plant": least_dry_friction(system_values(scenario)["plant"])}).modulus

    bare = modulus("backlash", w_gap=0.0)
    # at the states of runs with other friction: errors of 1e-5 rad
    np.testing.assert_allclose(modulus("load_loss", "bristles"), bare, rtol=0.02)
    np.testing.assert_allclose(modulus("thermal", T_ref=300.0), bare, rtol=0.02)
    late = modulus("winding")
    assert (late < bare - 0.02).all() and (late > 0.0).all()
