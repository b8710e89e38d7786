"""Gains by one rule: poles, steps and friction of one joint, and the margins of the whole arm."""

import numpy as np
import pytest

from vdfmu.arm.equations.friction import stribeck_friction
from vdfmu.arm.robot import load_robot, robot_names
from vdfmu.base.errors import UsageError
from vdfmu.extras.robots.reach import arm_gains, joint_gains, reach_scenario, steepest_fall, whole_arm
from vdfmu.study.analysis.loops import margins_along

STEP = 1e-3


def test_a_stiff_joint_has_the_poles_that_are_placed_and_a_soft_one_a_quarter_of_its_spring():
    J, M = 0.1, 0.5
    K_p, K_v, _ = joint_gains(J, 1e9, np.array([M]), STEP)
    damping = K_v / (2 * np.sqrt(K_p * (J + M)))
    assert damping == pytest.approx(0.5, rel=1e-12)  # by its formula
    assert 0.1 < K_v * STEP / J <= 0.4
    K_p, _, _ = joint_gains(0.1, 500.0, np.array([0.02]), STEP)
    assert K_p <= 125.0
    lightest = joint_gains(0.1, 1e4, np.array([0.5]), STEP)
    both = joint_gains(0.1, 1e4, np.array([0.5, 5.0]), STEP)
    assert both[0] < lightest[0]
    assert both[2] >= 0.5


@pytest.mark.heavy
@pytest.mark.parametrize("name", robot_names())
def test_the_loops_of_every_shipped_arm_keep_clear_of_minus_one(name):
    """The rule knows of no other joint. The friction of the paper's wrist falls by 17 N.m.s/rad."""
    scenario = reach_scenario(name)
    motion = scenario.sections["trajectory"]
    assert np.abs(np.subtract(motion["q_end"], motion["q_start"])).sum() < 4.1  # rad: a long arm does not coil
    loops = margins_along(scenario).judged.loops
    assert loops.modulus.min() > 0.65 and loops.delay().samples >= 1.0


def test_friction_that_falls_takes_its_slope_from_the_damping():
    """The formula is the slope of Eq. (54), by differences. K_v is at least twice as large, or there are no gains."""
    robot = load_robot("manipulator_6dof")
    v = robot.v_s / np.sqrt(2.0)
    slope = (stribeck_friction(robot, v * 1.001) - stribeck_friction(robot, v * 0.999)) / (0.002 * v)
    np.testing.assert_allclose(steepest_fall(robot), -slope, rtol=1e-5)  # third derivative, 1e-6, at the inflection
    J, M, K, fall = 0.114, 0.1, 20e3, 17.0
    K_p, K_v, margin = joint_gains(J, K, np.array([M]), STEP, fall=fall)
    assert margin >= 0.5 and K_v >= 2.0 * fall  # 1 + L at high gain of a slow rotor: K_v over K_v - fall is 2 at most
    assert K_p == pytest.approx((K_v - fall) ** 2 / (J + M), rel=1e-12)  # a damping ratio of 0.5, by its formula
    with pytest.raises(UsageError, match="no gains have a modulus margin of 0.5 and"):
        joint_gains(J, K, np.array([M]), STEP, fall=60.0)  # above J / (2 h) = 57


def test_gains_follow_the_step_and_those_that_miss_their_margin_are_refused():
    robot = load_robot("planar_2dof")
    q = np.zeros((1, 2))
    fast, slow = arm_gains(robot, q, 1e-3), arm_gains(robot, q, 2e-3)
    assert (slow.K_v < fast.K_v / 2).all()
    assert (slow.K_p < fast.K_p).all()
    # No gains have more than the 1 of none at all.
    with pytest.raises(UsageError, match=r"joint 1: no gains have a modulus margin of 1.1 .* smaller"):
        arm_gains(load_robot("planar_2dof"), np.zeros((1, 2)), 1e-3, margin=1.1)


@pytest.mark.heavy
def test_a_wrist_with_fast_undamped_modes_gets_a_smaller_step():
    """Joint 6 of the paper's arm has a mode at 230 to 270 Hz: at 1 ms its peak leaves three quarters of a sample."""
    robot = load_robot("manipulator_6dof")
    with pytest.raises(UsageError, match="a delay margin of a sample at a step of 0.001 s"):
        arm_gains(robot, np.zeros((1, 6)), 1e-3)
    scenario = reach_scenario(robot)
    assert scenario.step == 5e-4
    gains = arm_gains(robot, np.zeros((1, 6)), scenario.step)
    modulus, samples = whole_arm(robot, np.zeros((1, 6)), gains, scenario.step)
    assert modulus > 0.65 and samples > 1.0
    # where nothing damps, the joints alone have what the rule promises, and a step twice as large has less
    assert whole_arm(robot, np.zeros((1, 6)), gains, 2.0 * scenario.step)[1] < samples
