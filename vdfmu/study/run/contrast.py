"""The contrast study, section IV-A: joint torques along the motion by virtual decomposition and by Newton-Euler."""

from __future__ import annotations

import numpy as np

from vdfmu.arm.equations.trajectory import desired_motion
from vdfmu.arm.kernel import Kernel
from vdfmu.arm.robot import Robot
from vdfmu.base.arrays import Floats
from vdfmu.study.report.contrast import LOW_GRAVITY, Contrast
from vdfmu.system.scenario import Scenario
from vdfmu.system.scenario.values import group_value


def contrast(scenario: Scenario) -> Contrast:
    """Compute the torques along Eq. (57) at every step of the scenario.

    The two formulations share no line of code. The third variant shows one reading of Table 3: the difference
    that a gravity constant of 9.80 in place of 9.81 m/s2 makes. The other is a thousandth of the torques themselves.
    """
    robot = scenario.arm
    motion = [group_value(scenario, f"trajectory.{name}") for name in ("q_start", "q_end", "T", "t_start")]
    time: Floats = scenario.step * np.arange(round(scenario.stop / scenario.step) + 1, dtype=np.float64)
    desired = [desired_motion(float(t), *motion) for t in time]
    q, q_dot, q_ddot = (
        np.array([getattr(d, name) for d in desired]) for name in ("q_d", "q_d_dot", "q_d_ddot")
    )
    low = robot.with_parameters(gravity=LOW_GRAVITY * robot.gravity)

    def torques(name: str, arm: Robot) -> Floats:
        n = arm.n
        return Kernel(arm).rows(name, (q, q_dot, q_ddot, np.zeros(6)), (n, n, n, 6))

    return Contrast(
        robot,
        time,
        torques("inverse_dynamics", robot),
        torques("newton_euler", robot),
        torques("newton_euler", low),
    )
