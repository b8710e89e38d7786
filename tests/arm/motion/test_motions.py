"""Motions that are worked out before the run: no jump up to the fourth derivative, limits kept."""

import re

import numpy as np
import pytest
from scipy.interpolate import CubicSpline, PPoly

from tests.arm.motion.jumps import jumps, rounding
from vdfmu.arm import motion as motions
from vdfmu.base.errors import UsageError

POINTS = np.array([[0.0, 0.2], [0.7, -0.4], [0.9, 0.5], [-0.3, 0.1], [0.0, 0.2]])
TIMES = np.array([0.0, 0.6, 1.0, 1.9, 2.5])


def made():
    yield motions.waypoints(POINTS, TIMES)
    yield motions.waypoints(POINTS, TIMES, dwell=[0.1, 0.0, 0.2, 0.0, 0.3])
    yield motions.waypoints(POINTS, velocity=2.0, acceleration=[5.0, 9.0], dwell=[0.0, 0.0, 0.1, 0.0, 0.0])
    yield motions.waypoints(POINTS[:2], duration=2.0)
    t = np.linspace(0.0, 1.0, 201)
    yield motions.samples(t, np.column_stack([np.sin(np.pi * t) ** 6, np.cos(np.pi * t) ** 6]))


@pytest.mark.heavy
def test_no_derivative_up_to_the_fourth_jumps_and_all_motions_rest_at_both_ends():
    for motion in made():
        assert np.all(jumps(motion) < rounding(motion))
        assert np.all(rounding(motion)[1:] < 1e-3 * motion.peaks.max(axis=1))  # so that a jump would show
        assert np.abs(motion.at(0.0)[1:]).max() == 0.0


def test_derivatives_and_peaks_are_those_of_an_independent_spline_and_of_differences():
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
    dense = np.abs(motion.at(np.linspace(0.0, 2.5, 250_001))[1:]).max(axis=1)
    # between two of 250000 times a smooth maximum is lower by (pi dt / T)^2 / 2 at most: 1e-9 of it; snap is linear, so
    # lower by its slope times 1e-5 s, some 1e-4
    assert np.all(motion.peaks >= dense * (1.0 - 1e-12))
    assert motion.peaks[:3] == pytest.approx(dense[:3], rel=1e-6)
    assert motion.peaks[3] == pytest.approx(dense[3], rel=1e-3)


def test_limits_hold_and_rests_last_as_long_as_asked_within_a_duration():
    velocity, acceleration = np.array([1.0, 2.0]), np.array([4.0, 3.0])
    motion = motions.waypoints(POINTS, velocity=velocity, acceleration=acceleration)
    share = motion.peaks[:2] / [velocity, acceleration]
    assert share.max() == pytest.approx(1.0, rel=1e-12)  # scaled by this very number
    stopping = motions.waypoints(POINTS, TIMES, dwell=[0.0, 0.0, 0.2, 0.0, 0.0])
    assert np.abs(stopping.at(np.array([1.0, 1.1, 1.2]))[0] - POINTS[2]).max() < 1e-13
    assert np.abs(stopping.at(np.array([1.05, 1.15]))[1:]).max() == 0.0
    with pytest.raises(UsageError, match=r"expected at least .* s, because of the limits of joint 1, got 0.5 s"):
        motions.waypoints(POINTS, duration=0.5, velocity=velocity, acceleration=acceleration)
    motion = motions.waypoints(POINTS, duration=4.0, dwell=[0.0, 0.0, 0.5, 0.0, 0.25])
    still = np.abs(motion.coefficients[:, 1:]).max(axis=(1, 2)) == 0.0
    assert motion.duration == pytest.approx(4.0, rel=1e-14)  # a sum of roundings
    assert np.diff(motion.knots)[still] == pytest.approx([0.5, 0.25], rel=1e-14)
    with pytest.raises(UsageError, match=r"duration: expected more than the 5 s of rest, got 4 s"):
        motions.waypoints(POINTS, duration=4.0, dwell=1.0)


def test_waypoints_report_every_problem_and_samples_that_do_not_rest():
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
    with pytest.raises(UsageError, match="point 3: expected a position other than"):
        motions.waypoints([[0.0], [1.0], [1.0]], duration=1.0)
    t = np.linspace(0.0, 1.0, 101)
    assert not motions.samples(t, (t**5 * (1.0 - t) ** 5)[:, None]).notes
    (note,) = motions.samples(t, np.column_stack([t, np.zeros_like(t)])).notes
    assert "joint 1: the samples start or end with a speed" in note


def test_motions_that_meet_can_be_joined_without_the_jumps_of_a_cubic_spline():
    motion = motions.waypoints(POINTS, TIMES)
    both = motions.joined([motion, motion.slower(2.0)])
    assert both.duration == 7.5 and both.closed
    # twice as slow: the same positions, 1/2, 1/4 .. of the derivatives
    scale = 0.5 ** np.arange(5.0)[:, None]
    assert both.at(2.5 + 2.0 * 0.8) == pytest.approx(scale * motion.at(0.8), rel=1e-11)
    first, second = motions.waypoints(POINTS, TIMES), motions.waypoints(POINTS[1:], TIMES[1:])
    for parts in ([first, second], [first, motions.rest(np.zeros(3), 1.0)]):
        with pytest.raises(UsageError, match=r"joined: expected motion 2 to start at .*, the end of motion 1, got"):
            motions.joined(parts)
    with pytest.raises(UsageError, match="joined: expected motions, got none"):
        motions.joined([])
    with pytest.raises(UsageError, match="factor: expected a number above 0"):
        first.slower(-1.0)
    cubic = CubicSpline(TIMES, POINTS, bc_type="clamped")
    coefficients = np.zeros((4, 6, 2))
    coefficients[:, :4] = np.moveaxis(cubic.c[::-1], 0, 1)
    motion = motions.Motion(TIMES, coefficients)
    assert jumps(motion)[3] > 0.1 * motion.peaks[2].max()


@pytest.mark.parametrize(("make", "words"), [
    (lambda arm: motions.waypoints([[0.0, 0.0], [1.0]], duration=1.0), ["points: expected a number, or a list"]),
    (lambda arm: motions.rest("here", 1.0), ["q: expected a number, or a list"]),
    (
        lambda arm: motions.waypoints([[0, 0], [1, "far"]], velocity=True, duration=[1.0]),
        ["points: expected a number", "velocity: expected a number", "duration: expected a number, got [1.0]"],
    ),
])  # fmt: skip
def test_what_is_no_number_is_named_all_at_once(planar, make, words):
    with pytest.raises(UsageError) as caught:
        make(planar)
    lines = str(caught.value).splitlines()
    assert len(lines) == len(words)
    for line, text in zip(lines, words, strict=True):
        assert re.match(text.replace("[", r"\["), line)


def test_unknown_arguments_of_a_motion_are_reported_with_its_name():
    with pytest.raises(TypeError, match=r"waypoints\(\) got an unexpected keyword argument 'speed'"):
        motions.waypoints([[0.0], [1.0]], speed=1.0)


def test_a_motion_of_an_extra_says_where_it_is():
    with pytest.raises(ImportError, match=r"Write: from vdfmu.extras.identify import multisine$"):
        from vdfmu.motion import multisine  # noqa: F401
