"""A first motion: the motors can make it, with torque in reserve for what the model does not know."""

import dataclasses
import re

import numpy as np
import pytest

import vdfmu
from vdfmu.arm.drive.limits import motor_torque
from vdfmu.arm.equations.trajectory import desired_motion
from vdfmu.arm.robot import load_robot
from vdfmu.extras.robots import reach


def shares(robot, start, end, T):
    """Return the largest share of what each motor can give at its speed that a motion takes, (n,)."""
    motions = [desired_motion(t, start, end, T) for t in np.linspace(0.0, T, reach._POINTS)]
    q, q_dot, q_ddot = (np.array([motion[k] for motion in motions]) for k in range(3))
    tau = vdfmu.dynamics.inverse_dynamics(robot, q, q_dot, q_ddot) / robot.ell + robot.I_m * q_ddot
    return np.abs(tau / motor_torque(robot, np.where(tau < 0.0, -1e6, 1e6), q_dot)).max(axis=0)


@pytest.mark.parametrize("name", ["kr_6dof", "panda_7dof", "ur5e_6dof"])
def test_a_motion_leaves_the_motors_the_reserve_that_its_file_states(name):
    robot = load_robot(name)
    reserved = float(re.search(r"at most (\d+) % of the capacity", reach._STRONG)[1]) / 100.0
    assert 0.0 < reserved < 1.0  # a motor has nothing beyond its capacity
    start, end, T, _ = reach._motion(robot)
    fastest = shares(robot, start, end, reach._TIMES[0])
    for taken in (0.5, 0.9, 1.2):  # of the torque at standstill, by the fastest motion that is tried
        weaker = dataclasses.replace(robot, tau_stall=robot.tau_stall * fastest / taken)
        start, end, T, notes = reach._motion(weaker)
        assert notes or shares(weaker, start, end, T).max() <= reserved * (1.0 + 1e-9)
        assert T > reach._TIMES[0] or taken < reserved
