"""Motions that are worked out before the run: no jump up to the fourth derivative, limits kept, paths followed."""

import dataclasses
import math
import re
from functools import partial

import numpy as np
import pytest
from scipy.interpolate import CubicSpline, PPoly, make_interp_spline
from scipy.optimize import linprog
from scipy.sparse import diags_array, vstack
from scipy.spatial.transform import Rotation

import vdfmu
from vdfmu.arm import motion as motions
from vdfmu.arm.motion.inverse_kinematics import follow
from vdfmu.arm.motion.minimum_time import overload
from vdfmu.arm.motion.read import check_motion
from vdfmu.base.errors import UsageError

POINTS = np.array([[0.0, 0.2], [0.7, -0.4], [0.9, 0.5], [-0.3, 0.1], [0.0, 0.2]])
TIMES = np.array([0.0, 0.6, 1.0, 1.9, 2.5])


def jumps(motion):
    """Largest jump of each derivative at a knot, from rest at the start and to rest at the end, (5,)."""
    h = np.diff(motion.knots)
    before = np.array(
        [
            [sum(math.perm(k, order) * c[k] * dt ** (k - order) for k in range(order, 6)) for order in range(5)]
            for c, dt in zip(motion.coefficients, h, strict=True)
        ]
    )
    after = np.array([[math.factorial(order) * c[order] for order in range(5)] for c in motion.coefficients])
    still = np.zeros((1, 5, motion.n))
    change = np.concatenate([after, still]) - np.concatenate([still, before])
    change[[0, -1], 0] = 0.0  # of the position there is nothing to compare with
    return np.abs(change).max(axis=(0, 2))


def rounding(motion):
    """Return what roundings of the positions make of the derivatives, differences over the shortest interval, (5,).

    The differences of order 4 in six points have factors of up to some hundred.
    """
    size = np.abs(motion.coefficients[:, 0]).max() + 1.0
    return 1000.0 * np.finfo(float).eps * size / np.diff(motion.knots).min() ** np.arange(5.0)


def made(planar, arm):
    """One motion of each kind."""
    yield motions.waypoints(POINTS, TIMES)
    yield motions.waypoints(POINTS, TIMES, dwell=[0.1, 0.0, 0.2, 0.0, 0.3])
    yield motions.waypoints(POINTS, velocity=2.0, acceleration=[5.0, 9.0], dwell=[0.0, 0.0, 0.1, 0.0, 0.0])
    yield motions.waypoints(POINTS[:2], duration=2.0)
    t = np.linspace(0.0, 1.0, 201)
    yield motions.samples(t, np.column_stack([np.sin(np.pi * t) ** 6, np.cos(np.pi * t) ** 6]))
    yield motions.line(planar, [0.3, 0.8], [0.5, 0.0, 0.6], velocity=1.0, acceleration=3.0)
    yield motions.circle(arm, [0.3, 0.5, 0.7, 0.2, 0.8, 0.1], [0.13, 0.0, 1.18], [0, 1, 0], speed=0.2)
    yield motions.sweep([0.1, 0.2], 0.1, (0.5, 5.0), 4.0)
    yield motions.multisine([0.1, 0.2], 0.1, [1, 3, 5], 2.0)


@pytest.mark.heavy
def test_no_derivative_up_to_the_fourth_jumps_and_all_motions_rest_at_both_ends(planar, arm):
    for motion in made(planar, arm):
        assert np.all(jumps(motion) < rounding(motion))
        assert np.all(rounding(motion)[1:] < 1e-3 * motion.peaks.max(axis=1))  # so that a jump would show
        assert np.abs(motion.at(0.0)[1:]).max() == 0.0


def test_derivatives_are_those_of_an_independent_spline_and_of_differences():
    motion = motions.waypoints(POINTS, TIMES)
    other = PPoly(np.moveaxis(motion.coefficients[:, ::-1], 0, 1), motion.knots)
    t = np.linspace(0.0, 2.5, 1001)
    for order in range(5):
        # sums of six terms of the size of the peak
        assert np.abs(motion.at(t)[order] - other(t, order)).max() < 1e-13 * np.abs(other(t, order)).max()
    h = 1e-4
    for order in range(4):
        difference = (motion.at(t[1:-1] + h)[order] - motion.at(t[1:-1] - h)[order]) / (2.0 * h)
        # h^2/6 of the third derivative after, or a bend of snap next to a knot: h/2 times its change of slope
        slope = 120.0 * np.abs(motion.coefficients[:, 5]).max()
        assert np.abs(difference - motion.at(t[1:-1])[order + 1]).max() < h * slope
    assert np.abs(motion.at(TIMES)[0] - POINTS).max() < 1e-13  # positions of size 1 through the points


def test_peaks_are_those_between_the_knots():
    motion = motions.waypoints(POINTS, TIMES)
    dense = np.abs(motion.at(np.linspace(0.0, 2.5, 250_001))[1:]).max(axis=1)
    # between two of 250000 times a smooth maximum is lower by (pi dt / T)^2 / 2 at most: 1e-9 of it; snap is linear, so
    # lower by its slope times 1e-5 s, some 1e-4
    assert np.all(motion.peaks >= dense * (1.0 - 1e-12))
    assert motion.peaks[:3] == pytest.approx(dense[:3], rel=1e-6)
    assert motion.peaks[3] == pytest.approx(dense[3], rel=1e-3)


def test_limits_hold_and_one_is_met_and_stops_are_stops():
    velocity, acceleration = np.array([1.0, 2.0]), np.array([4.0, 3.0])
    motion = motions.waypoints(POINTS, velocity=velocity, acceleration=acceleration)
    share = motion.peaks[:2] / [velocity, acceleration]
    assert share.max() == pytest.approx(1.0, rel=1e-12)  # scaled by this very number
    stopping = motions.waypoints(POINTS, TIMES, dwell=[0.0, 0.0, 0.2, 0.0, 0.0])
    assert np.abs(stopping.at(np.array([1.0, 1.1, 1.2]))[0] - POINTS[2]).max() < 1e-13
    assert np.abs(stopping.at(np.array([1.05, 1.15]))[1:]).max() == 0.0
    with pytest.raises(UsageError, match=r"expected at least the .* s that the limits of joint 1 take, got 0.5 s"):
        motions.waypoints(POINTS, duration=0.5, velocity=velocity, acceleration=acceleration)


def test_rests_last_as_long_as_asked_within_a_duration():
    motion = motions.waypoints(POINTS, duration=4.0, dwell=[0.0, 0.0, 0.5, 0.0, 0.25])
    still = np.abs(motion.coefficients[:, 1:]).max(axis=(1, 2)) == 0.0
    assert motion.duration == pytest.approx(4.0, rel=1e-14)  # a sum of roundings
    assert np.diff(motion.knots)[still] == pytest.approx([0.5, 0.25], rel=1e-14)
    with pytest.raises(UsageError, match=r"duration: expected more than the 5 s of rest, got 4 s"):
        motions.waypoints(POINTS, duration=4.0, dwell=1.0)


def test_waypoints_report_every_problem():
    with pytest.raises(UsageError) as caught:
        motions.waypoints([[0.0, 0.0], [1.0, np.nan], [2.0, 2.0]], [0.0, 1.0, 0.5], dwell=[0.0, -1.0, 0.0])
    for words in ("point 2: joint 2: expected a finite number", "dwell: expected", "point 3: time: expected more than"):
        assert words in str(caught.value)
    with pytest.raises(UsageError, match="expected times, a duration, or limits"):
        motions.waypoints(POINTS)
    with pytest.raises(UsageError, match="expected times or a duration, got both"):
        motions.waypoints(POINTS, TIMES, duration=1.0)
    with pytest.raises(UsageError, match="velocity: expected a number above 0"):
        motions.waypoints(POINTS, velocity=np.inf, acceleration=1.0)
    with pytest.raises(UsageError, match="dwell: expected"):
        motions.waypoints(POINTS, duration=1.0, dwell=np.inf)
    with pytest.raises(UsageError, match="point 3: expected another position"):
        motions.waypoints([[0.0], [1.0], [1.0]], duration=1.0)


def test_samples_that_do_not_rest_are_named():
    t = np.linspace(0.0, 1.0, 101)
    assert not motions.samples(t, (t**5 * (1.0 - t) ** 5)[:, None]).notes
    (note,) = motions.samples(t, np.column_stack([t, np.zeros_like(t)])).notes
    assert "joint 1 start or end at speed" in note


# ---------------------------------------------------------------- the shortest


def test_the_shortest_motion_keeps_limits_and_path_and_says_what_it_costs(planar):
    points = np.array([[-1.5, 0.0], [-0.5, 0.6], [0.4, 0.2]])
    velocity, acceleration = np.array([3.0, 4.0]), np.array([12.0, 20.0])
    motion = motions.fastest(points, velocity, acceleration)
    assert np.all(motion.peaks[0] <= velocity * (1.0 + 1e-9)) and np.all(motion.peaks[1] <= acceleration * (1.0 + 1e-9))
    assert np.all(jumps(motion) < rounding(motion))
    # shorter than the other way, and longer than what speed alone takes
    assert motion.duration < motions.waypoints(points, velocity=velocity, acceleration=acceleration).duration
    assert motion.duration > np.abs(np.diff(points, axis=0)).sum(axis=0).max() / 3.0
    assert "more than the shortest time" in motion.notes[0]
    t = np.linspace(0.0, motion.duration, 20_001)
    q, q_dot = motion.at(t)[:2]
    # it passes the point in the middle: the nearest of times dt apart is within half of the way between them, and
    # the spline's error, seen below 1e-6
    near = np.linalg.norm(q - points[1], axis=1).min()
    assert near < 0.5 * np.linalg.norm(q_dot, axis=1).max() * (t[1] - t[0]) + 1e-5
    # with torques below what this takes it is slower, and keeps them
    free = overload(partial(vdfmu.inverse_dynamics, planar), motion, np.ones(2))
    least = np.abs(vdfmu.gravity_torque(planar, q[::100])).max()
    between = 0.5 * (free + least)
    weak = motions.fastest(points, velocity, acceleration, robot=planar, torque=between)
    taken = overload(partial(vdfmu.inverse_dynamics, planar), weak, np.full(2, between))
    assert taken <= 1.0 and weak.duration > motion.duration
    with pytest.raises(UsageError, match=r"smoothing: expected from .* s to .* s, got 0.0001"):
        motions.fastest(points, velocity, acceleration, smoothing=1e-4)
    with pytest.raises(UsageError, match="torque"):
        motions.fastest(points, velocity, acceleration, robot=planar, torque=5.0)  # 11.8 N.m hold it level


def shortest_between(a, b, velocity, acceleration):
    """Time of a trapezoid of speed, or a triangle, along the straight line: closed form."""
    way = np.abs(b - a)
    moving = way > 0.0
    v = (velocity / np.where(moving, way, 1.0))[moving].min()
    u = (acceleration / np.where(moving, way, 1.0))[moving].min()
    return 1.0 / v + v / u if v * v < u else 2.0 / np.sqrt(u)


def test_between_two_points_the_shortest_motion_is_the_straight_line():
    random = np.random.default_rng(7)
    for k in range(60):
        n = 1 + k % 6
        a, b = random.uniform(-2.0, 2.0, (2, n)) * 10.0 ** random.uniform(-4, 1)
        if n > 1 and k % 4 == 0:
            b[0] = a[0]  # a joint that stands still
        velocity, acceleration = random.uniform(0.5, 3.0, n), random.uniform(2.0, 20.0, n)
        motion = motions.fastest([a, b], velocity, acceleration)
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
        said = float(re.search(r"([\d.]+) % more", motion.notes[0])[1])
        # of the true shortest time: off by those 0.5 %, and by its one printed digit
        assert said == pytest.approx(100.0 * (motion.duration / shortest - 1.0), abs=0.6)


def shortest_along(points, velocity, acceleration, robot=None, torque=None):
    """Shortest time along the natural spline by a linear programme: the largest squares of the speed on 1000 intervals.

    Their sum is largest where each is, which is the fastest motion (Verscheure et al. 2009); limits hold in the middle
    of each interval. It shares nothing with toppra, which goes along the path twice.
    """
    points = np.array(points, dtype=float)
    s = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1)))
    free = [(order, np.zeros(points.shape[1])) for order in (3, 4)]
    path = make_interp_spline(s, points, k=5, bc_type=(free, free))
    places = np.linspace(0.0, s[-1], 1001)
    step, middle = places[1], 0.5 * (places[1:] + places[:-1])
    q, first, second = (path(middle, order) for order in range(3))
    rows = [(first, second, 0.0 * q, np.broadcast_to(acceleration, q.shape))]
    if torque is not None:
        still = np.zeros_like(q)
        weight = vdfmu.inverse_dynamics(robot, q, still, still)
        rows += [
            (
                vdfmu.inverse_dynamics(robot, q, still, first) - weight,
                vdfmu.inverse_dynamics(robot, q, first, second) - weight,
                weight,
                np.broadcast_to(torque, q.shape),
            )
        ]
    A, b = [], []
    for by_change, by_square, constant, most in rows:
        for j in range(q.shape[1]):
            change, square = by_change[:, j] / (2.0 * step), by_square[:, j] / 2.0
            part = diags_array([square - change, square + change], offsets=[0, 1], shape=(1000, 1001))
            A += [part, -part]
            b += [most[:, j] - constant[:, j], most[:, j] + constant[:, j]]
    most = ((velocity / np.maximum(np.abs(path(places, 1)), 1e-12)) ** 2).min(axis=1)
    most[[0, -1]] = 0.0
    found = linprog(-np.ones(1001), vstack(A), np.concatenate(b), bounds=[(0.0, one) for one in most])
    assert found.status == 0
    speed = np.sqrt(found.x)
    return float((2.0 * step / (speed[1:] + speed[:-1])).sum())


@pytest.mark.parametrize(
    "points",
    [
        [[-1.5, 0.0], [-0.5, 0.6], [0.4, 0.2]],
        [[0.0, 0.2], [0.7, -0.4], [0.9, 0.5], [-0.3, 0.1]],
        [[0.0, 0.0], [0.02, 0.01], [1.0, 1.0]],
    ],
)
@pytest.mark.parametrize("torque", [None, 14.0])
def test_more_than_the_shortest_is_measured_against_the_shortest(planar, points, torque):
    velocity, acceleration = np.array([3.0, 4.0]), np.array([12.0, 20.0])
    shortest = shortest_along(points, velocity, acceleration, planar, torque)
    motion = motions.fastest(points, velocity, acceleration, robot=planar, torque=torque)
    said = float(re.search(r"([\d.]+) % more", motion.notes[0])[1])
    # two discretisations, of 200 intervals between points and of 1000 in all, each some 1 / 200 of the time at worst
    assert motion.duration / (1.0 + said / 100.0) == pytest.approx(shortest, rel=5e-3)


def test_points_too_near_for_a_path_are_refused():
    with pytest.raises(UsageError, match=r"point 2: expected at least 0.00141 from the point before, got 1e-09"):
        motions.fastest([[0, 0], [1e-9, 0], [1, 1]], 1.0, 4.0)
    with pytest.raises(UsageError, match=r"point 2: expected at least 1e-09"):
        motions.fastest([[1.0], [1.0 + 1e-12]], 1.0, 4.0)
    # as near as they may be, the spline passes the point within the 1e-6 of the path that its constant says
    points = np.array([[0.0, 0.0], [1.0, 1.0], [1.0, 1.0 + 1.5e-3]])
    motion = motions.fastest(points, 1.0, 4.0)
    t = np.linspace(0.0, motion.duration, 200_001)
    assert np.linalg.norm(motion.at(t)[0] - points[1], axis=1).min() < 2e-6
    assert np.abs(motion.at(t)[0]).max() < 1.01


def test_the_shortest_motion_takes_the_limits_of_the_motors(planar):
    with pytest.raises(UsageError, match=r"expected limits of velocity and acceleration, or a robot with"):
        motions.fastest([[0.0, 0.0], [0.5, 0.3]], robot=planar)
    for full in (0.0, 0.95):
        limited = dataclasses.replace(planar, limits=True).with_parameters(
            q_min=-2.0, q_max=2.0, tau_stall=[0.6, 0.3], kappa_dot_max=3.0, full_speed=full
        )
        motion = motions.fastest([[0.0, 0.0], [0.5, 0.3]], robot=limited)
        check_motion(motion, limited)
        share = max(full, 0.5)  # half of each is the largest rectangle under a line
        assert np.all(motion.peaks[0] <= 3.0 * share * (1.0 + 1e-9))
        q, q_dot, q_ddot = motion.at(np.linspace(0.0, motion.duration, 20_001))[:3]
        tau = vdfmu.inverse_dynamics(limited, q, q_dot, q_ddot) / limited.ell + limited.I_m * q_ddot
        given = limited.tau_stall * min(1.0, (1.0 - share) / (1.0 - full))
        # torques are looked at at 1001 times, between which they change by less than a percent
        assert 0.8 < (np.abs(tau) / given).max() < 1.01
        assert "by the robot's motors: speeds up to" in motion.notes[1]
    slow = motions.fastest([[0.0, 0.0], [0.5, 0.3]], 0.3, robot=limited)
    assert slow.peaks[0].max() == pytest.approx(0.3, rel=1e-9)  # scaled to it


# ---------------------------------------------------------------- excitation


@pytest.mark.parametrize("phases", ["schroeder", "random"])
def test_a_multisine_has_the_lines_asked_for_and_no_others(phases):
    lines, period, n = [1, 2, 5, 9], 4.0, 512
    motion = motions.multisine([0.1, -0.2, 0.3], [0.2, 0.1, 0.0], lines, period, periods=2, phases=phases)
    assert motion.duration == 16.0 and motion.closed
    t = period + period * np.arange(n) / n
    found = 2.0 / n * np.abs(np.fft.rfft(motion.at(t)[0], axis=0))
    amplitudes = found[lines]
    # Knots 1/24 of the shortest period apart: the error of a spline of degree 5 is some h^6/30000 of the sixth
    # derivative, (2 pi / 24)^6 / 30000 = 1e-8 of an amplitude, and its ends add as much.
    assert np.abs(amplitudes - amplitudes[0]).max() < 1e-6 * amplitudes.max()
    assert np.delete(found, [0, *lines], axis=0).max() < 1e-6 * amplitudes.max()
    assert found[1:, 2].max() < 1e-15  # of a joint without amplitude: the rounding of the transform
    deviation = np.abs(motion.at(np.linspace(period, 3.0 * period, 40_001))[0] - [0.1, -0.2, 0.3]).max(axis=0)
    # the peak is found at 24 points of the shortest period: (pi / 24)^2 / 2 = 0.9 % of the fastest line at most
    assert deviation == pytest.approx([0.2, 0.1, 0.0], rel=0.01)


def test_amplitudes_shrink_to_keep_limits_and_say_so():
    motion = motions.multisine([0.0, 1.0], 0.2, [1, 4], 2.0, velocity=[10.0, 0.5], acceleration=[10.0, 100.0])
    assert motion.peaks[1, 0] == pytest.approx(10.0, rel=1e-12)  # scaled by this number
    assert motion.peaks[0, 1] == pytest.approx(0.5, rel=1e-12)
    assert [note.split(":")[0] for note in motion.notes] == ["joint 1", "joint 2"]
    assert motion.start == pytest.approx([0.0, 1.0], abs=0.0)


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({"lines": [2, 2]}, "lines: expected whole numbers of at least 1, each once"),
        ({"periods": np.nan}, "periods: expected a whole number"),
        ({"seed": -1}, "seed: expected a whole number of at least 0"),
        ({"seed": np.nan}, "seed: expected a whole number of at least 0, got nan"),
        ({"start": []}, "start: expected a position for each joint"),
        ({"amplitude": np.inf}, "amplitude: expected one above 0"),
    ],
)
def test_a_multisine_that_does_not_fit_is_named(keys, words):
    with pytest.raises(UsageError, match=words):
        motions.multisine(**({"start": [0.0], "amplitude": 0.1, "lines": [1, 2], "period": 1.0} | keys))


@pytest.mark.parametrize("law", ["linear", "logarithmic"])
def test_a_sweep_goes_from_one_frequency_to_the_other(law):
    first, last, T = 1.0, 8.0, 10.0
    motion = motions.sweep([0.0], 0.1, (first, last), T, law=law)
    t = np.linspace(0.1 * T, 0.9 * T, 200_001)
    q = motion.at(t)[0][:, 0]
    crossings = t[1:][(q[:-1] < 0.0) & (q[1:] >= 0.0)]
    frequency = 1.0 / np.diff(crossings)
    middle = 0.5 * (crossings[1:] + crossings[:-1])
    if law == "linear":
        expected = first + (last - first) * middle / T
    else:
        expected = first * (last / first) ** (middle / T)
    # crossings are found to 4e-5 s of periods of at least 0.125 s; the mean over a period differs by curvature, < 1 %
    assert frequency == pytest.approx(expected, rel=0.01)
    with pytest.raises(UsageError, match="frequencies: expected two above 0 Hz"):
        motions.sweep([0.0], 0.1, (0.0, 1.0), 1.0)


# ---------------------------------------------------------------- lines and circles


@pytest.mark.heavy
def test_a_line_is_straight_and_a_circle_round(planar, arm):
    q = np.array([0.3, 0.5, 0.7, 0.2, 0.8, 0.1])
    p_0, R_0 = vdfmu.forward_kinematics(arm, q)
    target, R_1 = p_0 + [-0.1, 0.1, 0.0], Rotation.from_rotvec([0.2, 0.1, -0.3]).as_matrix() @ R_0
    motion = motions.line(arm, q, target, orientation=R_1, velocity=1.0, acceleration=3.0, tolerance=1e-7)
    p, R = vdfmu.forward_kinematics(arm, motion.at(np.linspace(0.0, motion.duration, 3001))[0])
    along = (target - p_0) / np.linalg.norm(target - p_0)
    off = p - p_0 - ((p - p_0) @ along)[:, None] * along
    # the tolerance, which holds at five points a knot, and is looked at at some forty here
    assert np.linalg.norm(off, axis=1).max() < 2e-7
    assert np.linalg.norm(p[-1] - target) < 1e-10 and np.abs(R[-1] - R_1).max() < 1e-10  # Newton's 1e-11
    turned = np.array([Rotation.from_matrix(R_0.T @ one).as_rotvec() for one in R])
    axis = turned[-1] / np.linalg.norm(turned[-1])
    assert np.abs(turned - (turned @ axis)[:, None] * axis).max() < 2e-7  # about one axis: slerp
    share = ((p - p_0) @ along) / np.linalg.norm(target - p_0)
    assert np.abs(turned @ axis / np.linalg.norm(turned[-1]) - share).max() < 1e-5  # 2e-7 m of 0.15 m, 2e-7 rad of 0.37
    centre = p_0 + [-0.05, 0.0, 0.0]
    motion = motions.circle(arm, q, centre, [0, 1, 0], speed=0.2, tolerance=1e-7)
    t = np.linspace(0.0, motion.duration, 3001)
    p, R = vdfmu.forward_kinematics(arm, motion.at(t)[0])
    assert np.abs(np.linalg.norm(p - centre, axis=1) - 0.05).max() < 2e-7 and np.abs(p[:, 1] - p_0[1]).max() < 2e-7
    assert np.abs(R - R_0).max() < 2e-7 and motion.closed
    speed = np.linalg.norm(np.diff(p, axis=0), axis=1) / (t[1] - t[0])
    assert speed.max() == pytest.approx(0.2, rel=1e-4)  # chords of arcs of 2e-3 rad: 1e-6; 2e-7 m in 8e-4 s adds more


@pytest.mark.heavy
def test_the_end_effector_keeps_its_speed(planar, arm):
    q = [0.3, 0.5, 0.7, 0.2, 0.8, 0.1]
    p, R = vdfmu.forward_kinematics(arm, q)
    for robot, motion in (
        (arm, motions.circle(arm, q, [0.13, 0.0, 1.18], [0, 1, 0], speed=0.2)),
        (arm, motions.line(arm, q, [p + [0.0, 0.05, 0.0], p], speed=0.2)),
        (planar, motions.line(planar, [0.3, 0.8], [0.5, 0.0, 0.6], speed=0.2)),
    ):
        q_all, q_dot = motion.at(np.linspace(0.0, motion.duration, 100_001))[:2]
        J = vdfmu.jacobian(robot, q_all)[:, :3]
        speed = np.linalg.norm(np.einsum("tij,tj->ti", J, q_dot), axis=1).max()
        # 400 looks a piece: 1e-5 of the ripple, which is 1e-5 of the speed; and it is not much slower than it may be
        assert 0.2 * (1.0 - 1e-5) < speed <= 0.2 * (1.0 + 1e-9)
    turn = R @ Rotation.from_rotvec([0.0, 0.0, 0.2]).as_matrix()
    with pytest.raises(UsageError, match="speed: expected a path along which the end effector moves"):
        motions.line(arm, q, p, orientation=turn, speed=0.2)
    assert motions.line(arm, q, p, orientation=turn, speed=0.2, duration=1.0).duration == 1.0


def test_knots_are_doubled_until_the_line_is_as_straight_as_asked(planar, monkeypatch):
    monkeypatch.setattr("vdfmu.arm.motion.cartesian._FIRST", 16)
    coarse, fine = (
        motions.line(planar, [0.3, 0.8], [0.1, 0.0, 0.6], duration=1.0, tolerance=tolerance)
        for tolerance in (0.1, 1e-5)
    )
    assert len(fine.knots) > len(coarse.knots) == 21  # 16 intervals, and two more knots at each end
    monkeypatch.setattr("vdfmu.arm.motion.cartesian._MOST", 16)
    with pytest.raises(UsageError, match="expected at most 1e-17 m or rad from the path"):
        motions.line(planar, [0.3, 0.8], [0.5, 0.0, 0.6], duration=1.0, tolerance=1e-17)


def test_a_singular_pose_is_found_where_the_closed_form_has_it(planar):
    l_1, l_2 = 0.5, 0.4
    q = np.array([0.3, 0.8])
    p, _ = vdfmu.forward_kinematics(planar, q)
    outward = p / np.linalg.norm(p)
    with pytest.raises(UsageError, match=r"got a singular one: joint 2, at (\S+), would") as caught:
        motions.line(planar, q, 0.9 * outward, duration=1.0)  # to the stretched arm
    (at,) = np.array(str(caught.value).split("joint 2, at ")[1].split(",")[:1], dtype=float)

    def ratio(q_2):
        J = np.array([[-l_2 * np.sin(q_2), -l_2 * np.sin(q_2)], [l_1 + l_2 * np.cos(q_2), l_2 * np.cos(q_2)]])
        sigma = np.linalg.svd(J)[1]
        return sigma[1] / sigma[0]

    # the first pose on the path whose singular values are 100 apart: in 64 knots the last is within 2.5 mm of the end
    assert 0.0 < at and ratio(at) < 0.01 < ratio(at + 0.1)
    with pytest.raises(UsageError, match=r"expected a pose that the arm reaches, got one that is .* m away"):
        motions.line(planar, q, 2.0 * outward, duration=1.0)
    with pytest.raises(UsageError, match="a pose that the arm reaches"):
        motions.line(planar, q, p + [0.0, 0.1, 0.0], duration=1.0)  # out of the plane


def test_end_stops_on_the_way_are_named_with_place_and_joint(planar):
    limited = dataclasses.replace(planar, limits=True).with_parameters(q_min=[-2.0, 0.7], q_max=[2.0, 2.0])
    p, _ = vdfmu.forward_kinematics(limited, [0.3, 0.8])
    with pytest.raises(
        UsageError, match=r"line: at .* % of it, .* m: expected joint 2 between its end stops, 0.7 and 2"
    ):
        motions.line(limited, [0.3, 0.8], 0.87 / np.linalg.norm(p) * p, duration=1.0)


def test_a_redundant_arm_takes_least_norms_and_goes_to_the_middle_of_its_range(arm):
    q = np.array([0.3, 0.5, 0.7, 0.2, 0.8, 0.1])
    p, R = vdfmu.forward_kinematics(arm, q)
    s = np.linspace(0.0, 1.0, 201)
    poses = [(p + x * np.array([0.1, 0.0, -0.1]), R) for x in s]
    found = follow(arm, q, poses, 3, "line", 100.0 * s)
    assert np.abs(vdfmu.forward_kinematics(arm, found)[0] - [one for one, _ in poses]).max() < 1e-10
    for here, step in zip(found[:-1:20], np.diff(found, axis=0)[::20], strict=True):
        J = vdfmu.jacobian(arm, here)[:3]
        # of a step of 5e-4 m the part that moves nothing is of second order: the change of J over it
        assert np.linalg.norm(step - np.linalg.pinv(J) @ J @ step) < 0.01 * np.linalg.norm(step)
    limited = dataclasses.replace(arm, limits=True).with_parameters(q_min=-3.0, q_max=3.0)
    drawn = follow(limited, q, poses, 3, "line", 100.0 * s)
    assert np.linalg.norm(drawn[-1]) < np.linalg.norm(found[-1])  # 0 is the middle


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({"points": [0.5, 0.0]}, "points: expected positions of three finite numbers"),
        ({"orientation": "up"}, "orientation: expected keep, free or a rotation"),
        ({"orientation": 2.0 * np.eye(3)}, "orientation: expected a rotation, three rows"),
        ({"start": [0.1]}, "start: expected the positions of 2 joints"),
        ({"duration": None}, "expected a duration, a speed, or limits"),
        ({"dwell": [0.1, 0.2]}, "dwell: expected one number"),
        ({"dwell": -0.1}, "dwell: expected one time above 0 s"),
        ({"tolerance": 0.0}, "tolerance: expected more than 0"),
        ({"speed": np.inf}, "speed: expected more than 0"),
        ({"start": [0.3, 0.0]}, "line: at 0 % of it, .* got a singular one: joint 2, at 0,"),
        ({"speed": 0.1}, "duration: expected at least the"),
        ({"velocity": [1.0, 1.0, 1.0]}, "velocity: expected a number above 0 for all joints, or 2"),
    ],
)
def test_what_does_not_fit_is_named(planar, keys, words):
    good = {"start": [0.3, 0.8], "points": [0.5, 0.0, 0.6], "duration": 1.0}
    with pytest.raises(UsageError, match=words):
        motions.line(planar, **(good | keys))


def test_motions_can_be_joined_and_slowed_down():
    motion = motions.waypoints(POINTS, TIMES)
    both = motions.joined([motion, motion.slower(2.0)])
    assert both.duration == 7.5 and both.closed
    # twice as slow: the same positions, 1/2, 1/4 .. of the derivatives
    scale = 0.5 ** np.arange(5.0)[:, None]
    assert both.at(2.5 + 2.0 * 0.8) == pytest.approx(scale * motion.at(0.8), rel=1e-11)


def test_motions_that_do_not_meet_are_not_joined():
    one, other = motions.waypoints(POINTS, TIMES), motions.waypoints(POINTS[1:], TIMES[1:])
    for parts in ([one, other], [one, motions.rest(np.zeros(3), 1.0)]):
        with pytest.raises(UsageError, match=r"joined: expected motion 2 to start at .*, where motion 1 ends, got"):
            motions.joined(parts)
    with pytest.raises(UsageError, match="joined: expected motions, got none"):
        motions.joined([])
    with pytest.raises(UsageError, match="factor: expected a number above 0"):
        one.slower(-1.0)


def test_a_cubic_spline_jumps_where_these_do_not():
    cubic = CubicSpline(TIMES, POINTS, bc_type="clamped")
    coefficients = np.zeros((4, 6, 2))
    coefficients[:, :4] = np.moveaxis(cubic.c[::-1], 0, 1)
    motion = motions.Motion(TIMES, coefficients)
    assert jumps(motion)[3] > 0.1 * motion.peaks[2].max()


def test_a_circle_that_does_not_fit_is_named(planar):
    for keys, words in (
        ({"orientation": np.eye(3)}, "orientation: expected keep, turn or free"),
        ({"axis": [0.0, 0.0, 0.0]}, "circle: expected centre and axis"),
        ({"angle": 0.0}, "angle: expected a finite number other than 0"),
        ({"angle": 720.0}, r"angle: expected at most 10 turns, 62.83 rad, got 720 rad. As degrees .* 12.57"),
        ({"centre": vdfmu.forward_kinematics(planar, [0.3, 0.8])[0]}, "centre: expected an axis away"),
    ):
        with pytest.raises(UsageError, match=words):
            motions.circle(
                planar, [0.3, 0.8], **({"centre": [0.6, 0.0, 0.5], "axis": [0, 1, 0], "duration": 1.0} | keys)
            )


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda arm: motions.waypoints([[0.0, 0.0], [1.0]], duration=1.0), ["points: expected a number, or a list"]),
        (lambda arm: motions.rest("here", 1.0), ["q: expected a number, or a list"]),
        (lambda arm: motions.rest(0.5, 1.0), ["q: expected a position for each joint"]),
        (lambda arm: motions.circle(arm.name, [0.3, 0.8], [0.6, 0, 0.5]), ["expected a Robot, got str"]),
        (lambda arm: motions.samples([0.0, "x"], None), ["times: expected a number, or a list or rows of them"]),
        (
            lambda arm: motions.fastest([[0, 0], [1, "far"]], True, 1.0, smoothing=[1.0]),
            ["points: expected a number", "velocity: expected a number", "smoothing: expected one number, got [1.0]"],
        ),
        (lambda arm: motions.line(arm, "home", [0.5, 0, 0.6]), ['start: expected a number, .* got "home"']),
        (lambda arm: motions.circle(arm, [0.3, 0.8], [0.6, 0, 0.5], angle="90"), ["angle: expected one number"]),
        (lambda arm: motions.multisine([0, 0], "large", [1], 2.0), ["amplitude: expected a number"]),
        (lambda arm: motions.sweep([0, 0], 0.1, [[1.0], [2.0, 3.0]], 4.0), ["frequencies: expected a number"]),
    ],
)
def test_what_is_no_number_is_named_all_at_once(planar, make, words):
    with pytest.raises(UsageError) as caught:
        make(planar)
    lines = str(caught.value).splitlines()
    assert len(lines) == len(words)
    for line, text in zip(lines, words, strict=True):
        assert re.match(text.replace("[", r"\["), line)


def test_arguments_that_a_motion_has_not_are_told_with_its_name():
    with pytest.raises(TypeError, match=r"waypoints\(\) got an unexpected keyword argument 'speed'"):
        motions.waypoints([[0.0], [1.0]], speed=1.0)
