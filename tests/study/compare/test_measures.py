"""Measures of a comparison against closed forms: paths that are known to be off by a known distance."""

import math

import numpy as np
import pytest

from vdfmu.study.compare.measures import (
    BAND,
    corner_deviation,
    crossings,
    overshoot,
    path_accuracy,
    path_repeatability,
    planes,
    stabilisation,
)

T = np.linspace(0.0, 1.0, 2001)
CIRCLE = 0.2 * np.stack([np.cos(2.0 * np.pi * T), np.sin(2.0 * np.pi * T), 0.0 * T], axis=1)
LINE = np.stack([T**2 * (3.0 - 2.0 * T), 0.0 * T, 0.0 * T], axis=1)


class Run:
    """What the measures of a `PathRun` read."""

    def __init__(self, **values):
        self.__dict__.update(values)


@pytest.mark.parametrize("offset", [1e-3, -2e-3])
def test_path_accuracy_of_a_circle_of_another_radius_is_the_difference_of_the_radii(offset):
    attained = CIRCLE * (1.0 + offset / 0.2)
    found = path_accuracy(planes(CIRCLE, 2000), crossings(CIRCLE, attained, 2000)[None])
    # between rows the attained path is taken as straight: off by r phi^2 / 8, phi the angle of a row; and a plane
    # that is normal to the chord of two steps meets both circles at the same angle
    assert found == pytest.approx(abs(offset), abs=0.2 * (2.0 * np.pi / 2000) ** 2 / 8.0 + 1e-15)


def test_path_accuracy_does_not_see_how_late_the_tool_is():
    late = np.stack([np.interp(T - 0.02, T, LINE[:, 0]), np.full_like(T, 3e-3), 0.0 * T], axis=1)
    found = path_accuracy(planes(LINE, 2000), crossings(LINE, late, 2000)[None])
    assert found == pytest.approx(3e-3, abs=1e-15)  # rounding of numbers of 1 m


def test_path_accuracy_is_of_the_mean_of_the_cycles_and_repeatability_of_their_spread():
    shifts = np.array([-1e-3, 0.0, 1e-3, 2e-3])
    cycles = np.stack([crossings(LINE, LINE + [0.0, shift, 0.0], 2000) for shift in shifts])
    assert path_accuracy(planes(LINE, 2000), cycles) == pytest.approx(0.5e-3, abs=1e-15)
    distance = np.abs(shifts - shifts.mean())
    # ISO 9283, 8.3: the mean distance from the mean path and three of its standard deviations
    expected = distance.mean() + 3.0 * math.sqrt(np.sum((distance - distance.mean()) ** 2) / 3.0)
    assert path_repeatability(cycles) == pytest.approx(expected, rel=1e-9)  # rounding, of 1e-16 m in 1e-3 m
    assert path_repeatability(cycles[:1]) == 0.0
    assert path_repeatability(np.stack([cycles[0]] * 3)) < 1e-15  # rounding of a mean of numbers of 1 m


def test_the_corner_deviation_is_the_distance_of_the_nearest_place_between_rows():
    corner = np.array([1.0, 0.0, 0.0])
    commanded = np.array([[0.0, 0.0, 0.0], corner, [1.0, 1.0, 0.0]])
    attained = np.array([[0.0, 0.0, 0.0], [0.9, 0.0, 0.0], [1.0, 0.1, 0.0], [1.0, 1.0, 0.0]])
    # of a corner that is cut at 45 degrees, 0.1 m before it
    assert corner_deviation(Run(p_d=commanded, p=attained, corner=corner)) == pytest.approx(0.1 / math.sqrt(2.0))
    assert math.isnan(corner_deviation(Run(p_d=commanded, p=attained, corner=corner + 0.5)))


def test_stabilisation_and_overshoot_of_a_decaying_oscillation():
    """Of a exp(-t / 0.1 s) cos(w t) about the end: within the band for good after its last peak beyond it."""
    time = np.arange(0.0, 3.0, 1e-3)
    a, w = 1e-3, 20.0 * np.pi
    p = np.stack([a * np.exp(-time / 0.1) * np.cos(w * time), 0.0 * time, 0.0 * time], axis=1)
    run = Run(time=time, p=p, end=0)
    beyond = time[np.abs(p[:, 0] - p[-1, 0]) > BAND][-1]
    assert stabilisation(run) == pytest.approx(beyond + 1e-3, abs=1e-12)  # the row after, times are sums of 1e-3
    assert 0.1 * math.log(a / BAND) - 0.05 < stabilisation(run) < 0.1 * math.log(a / BAND)  # half a period
    # the first swing through the band ends at the trough after half a period, 0.05 s
    assert overshoot(run) == pytest.approx(np.abs(p[:, 0] - p[-1, 0])[25:].max())
    still = Run(time=time, p=0.0 * p, end=0)
    assert stabilisation(still) == overshoot(still) == 0.0
