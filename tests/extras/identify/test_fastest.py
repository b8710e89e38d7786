"""The shortest motions: limits and path kept, against the closed form of a straight line."""

import dataclasses
import re

import numpy as np
import pytest

from tests.arm.motion.jumps import jumps, rounding
from vdfmu import dynamics
from vdfmu.arm import motion as motions
from vdfmu.arm.motion.read import check_motion
from vdfmu.base.errors import UsageError
from vdfmu.extras.identify.minimum_time import fastest


def test_the_shortest_motion_keeps_limits_and_path_and_says_what_it_costs(planar):
    points = np.array([[-1.5, 0.0], [-0.5, 0.6], [0.4, 0.2]])
    velocity, acceleration = np.array([3.0, 4.0]), np.array([12.0, 20.0])
    motion = fastest(points, velocity, acceleration)
    assert np.all(motion.peaks[0] <= velocity * (1.0 + 1e-9)) and np.all(motion.peaks[1] <= acceleration * (1.0 + 1e-9))
    assert np.all(jumps(motion) < rounding(motion))
    # shorter than the other way, and longer than what speed alone takes
    assert motion.duration < motions.waypoints(points, velocity=velocity, acceleration=acceleration).duration
    assert motion.duration > np.abs(np.diff(points, axis=0)).sum(axis=0).max() / 3.0
    assert "longer than the shortest motion" in motion.notes[0]
    t = np.linspace(0.0, motion.duration, 20_001)
    q, q_dot = motion.at(t)[:2]
    # it passes the point in the middle: the nearest of times dt apart is within half of the way between them, and
    # the spline's error, seen below 1e-6
    near = np.linalg.norm(q - points[1], axis=1).min()
    assert near < 0.5 * np.linalg.norm(q_dot, axis=1).max() * (t[1] - t[0]) + 1e-5
    with pytest.raises(UsageError, match="torque"):
        fastest(points, velocity, acceleration, robot=planar, torque=5.0)  # 11.8 N.m hold it level


def shortest_between(a, b, velocity, acceleration):
    """Time of a trapezoid of speed, or a triangle, along the straight line: closed form."""
    way = np.abs(b - a)
    moving = way > 0.0
    v = (velocity / np.where(moving, way, 1.0))[moving].min()
    u = (acceleration / np.where(moving, way, 1.0))[moving].min()
    return 1.0 / v + v / u if v * v < u else 2.0 / np.sqrt(u)


def test_between_two_points_the_shortest_motion_is_the_straight_line():
    random = np.random.default_rng(7)
    for k in range(24):
        n = 1 + k % 6
        a, b = random.uniform(-2.0, 2.0, (2, n)) * 10.0 ** random.uniform(-4, 1)
        if n > 1 and k % 4 == 0:
            b[0] = a[0]  # a joint that stands still
        velocity, acceleration = random.uniform(0.5, 3.0, n), random.uniform(2.0, 20.0, n)
        motion = fastest([a, b], velocity, acceleration)
        q, q_dot, q_ddot = motion.at(np.linspace(0.0, motion.duration, 2001))[:3]
        size, way = np.abs([a, b]).max(), b - a
        share = (q - a) @ way / (way @ way)
        # On the line, forward, within limits: the spline's solution has some 100 roundings of its points.
        assert np.abs(q - a - share[:, None] * way).max() < 1e-13 * size
        assert (q_dot @ way / (way @ way)).min() > -1e-9 * (1.0 / motion.duration)
        assert np.all(np.abs(q_dot) <= velocity * (1.0 + 1e-9) + 1e-12)
        assert np.all(np.abs(q_ddot) <= acceleration * (1.0 + 1e-9) + 1e-9)
        assert q[0] == pytest.approx(a, abs=1e-13 * size) and q[-1] == pytest.approx(b, abs=1e-13 * size)
        # The three means of a fiftieth each add 6 %; toppra's 200 intervals add at most one of them, 0.5 %, where the
        # speed limit is met.
        shortest = shortest_between(a, b, velocity, acceleration)
        assert 1.0 <= motion.duration / shortest < 1.066
        said = float(re.search(r"([\d.]+) % longer", motion.notes[0])[1])
        # of the true shortest time: off by those 0.5 %, and by its one printed digit
        assert said == pytest.approx(100.0 * (motion.duration / shortest - 1.0), abs=0.6)


def test_points_too_near_for_a_path_are_refused():
    with pytest.raises(UsageError, match=r"point 2: expected at least 0.00141 from the point before, got 1e-09"):
        fastest([[0, 0], [1e-9, 0], [1, 1]], 1.0, 4.0)
    with pytest.raises(UsageError, match=r"point 2: expected at least 1e-09"):
        fastest([[1.0], [1.0 + 1e-12]], 1.0, 4.0)
    # as near as they may be, the spline passes the point within the 1e-6 of the path that its constant says
    points = np.array([[0.0, 0.0], [1.0, 1.0], [1.0, 1.0 + 1.5e-3]])
    motion = fastest(points, 1.0, 4.0)
    t = np.linspace(0.0, motion.duration, 200_001)
    assert np.linalg.norm(motion.at(t)[0] - points[1], axis=1).min() < 2e-6
    assert np.abs(motion.at(t)[0]).max() < 1.01


def test_the_shortest_motion_takes_the_limits_of_the_motors(planar):
    with pytest.raises(UsageError, match=r"expected limits of velocity and acceleration, or a robot with"):
        fastest([[0.0, 0.0], [0.5, 0.3]], robot=planar)
    for full in (0.0, 0.95):
        limited = dataclasses.replace(planar, limits=True).with_parameters(
            q_min=-2.0, q_max=2.0, tau_stall=[0.6, 0.3], kappa_dot_max=3.0, full_speed=full
        )
        motion = fastest([[0.0, 0.0], [0.5, 0.3]], robot=limited)
        check_motion(motion, limited)
        share = max(full, 0.5)  # half of each is the largest rectangle under a line
        assert np.all(motion.peaks[0] <= 3.0 * share * (1.0 + 1e-9))
        q, q_dot, q_ddot = motion.at(np.linspace(0.0, motion.duration, 20_001))[:3]
        tau = dynamics.inverse_dynamics(limited, q, q_dot, q_ddot) / limited.ell + limited.I_m * q_ddot
        limits = limited.tau_stall * min(1.0, (1.0 - share) / (1.0 - full))
        # torques are looked at at 1001 times, between which they change by less than a percent
        assert 0.8 < (np.abs(tau) / limits).max() < 1.01
        assert "by the robot's motors: speeds up to" in motion.notes[1]
    slow = fastest([[0.0, 0.0], [0.5, 0.3]], 0.3, robot=limited)
    assert slow.peaks[0].max() == pytest.approx(0.3, rel=1e-9)  # scaled to it
