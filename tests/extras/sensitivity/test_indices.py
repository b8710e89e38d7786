"""Indices of sensitivity against their analytic values, and what studies say of them."""

import re

import numpy as np
import pytest

from tests.conftest import ran
from tests.study.sweeps.conftest import study_of
from vdfmu.base.errors import UsageError
from vdfmu.engine.results.verdict import DOUBTFUL
from vdfmu.extras.sensitivity.sensitivities import morris_indices, sobol_indices
from vdfmu.study.sweeps.axes import draw, read_axes, shares

A, B = 7.0, 0.1
PART = {"a": 0.5 * (1 + B * np.pi**4 / 5) ** 2, "b": A**2 / 8, "ac": 8 * B**2 * np.pi**8 / 225}
VARIANCE = sum(PART.values())
"""Ishigami and Homma (1990): variance of sin x1 + A sin2 x2 + B x3^4 sin x1 over (-pi, pi)^3, and its parts."""


def ishigami(x1, x2, x3):
    return np.sin(x1) + A * np.sin(x2) ** 2 + B * x3**4 * np.sin(x1)


CUBE = {f"f.x{i}": f"lin({-np.pi}, {np.pi})" for i in (1, 2, 3)}


@pytest.fixture(scope="module")
def saltelli(tmp_path_factory):
    return study_of(tmp_path_factory.mktemp("saltelli") / "study", CUBE, ishigami, "saltelli", 512)


@pytest.mark.heavy
def test_sobol_indices_are_the_analytic_ones_and_narrow_with_the_root_of_the_points(saltelli):
    indices = saltelli.indices("y")
    first = np.array([PART["a"], PART["b"], 0.0]) / VARIANCE
    total = np.array([PART["a"] + PART["ac"], PART["b"], PART["ac"]]) / VARIANCE
    # the half-width is of 95 %; the true value of each of nine is within twice it except for one in 10^4
    assert (np.abs(indices.values["first"] - first) < 2 * indices.widths["first"]).all()
    assert (np.abs(indices.values["total"] - total) < 2 * indices.widths["total"]).all()
    pair = indices.values["second"][0, 2]
    assert abs(pair - PART["ac"] / VARIANCE) < 2 * indices.widths["second"][0, 2]
    # and is narrow enough to tell them apart: x3 has 0.24 in all, of which none alone
    assert indices.widths["total"].max() < 0.12 and indices.widths["first"].max() < 0.12
    widths = []
    for n in (128, 2048):
        x = np.pi * (2 * shares(3, "saltelli", n, 0) - 1)
        widths.append(sobol_indices(ishigami(*x.T), "abc").widths["total"].mean())
    # 16 times the points: a quarter; the spread itself is estimated, to some ten percent
    assert 0.15 < widths[1] / widths[0] < 0.4


def test_morris_gives_slopes_and_bends_of_functions_and_of_the_points_of_a_study(tmp_path):
    u = shares(3, "morris", 20, 0)
    effects = morris_indices(3 * u[:, 0] - 2 * u[:, 1], u, "abc")
    # differences of numbers near 1: rounding
    np.testing.assert_allclose(effects.values["mu"], [3, -2, 0], atol=1e-12)
    np.testing.assert_allclose(effects.values["mu_star"], [3, 2, 0], atol=1e-12)
    np.testing.assert_allclose(effects.values["sigma"], 0, atol=1e-12)
    bent = morris_indices(u[:, 0] * u[:, 1], u, "abc")
    assert bent.values["sigma"][0] > 0.1 and bent.values["sigma"][2] == 0.0
    over = {"f.a": "log(1, 100)", "f.b": "lin(0, 5)"}
    effects = study_of(tmp_path / "s", over, lambda a, b: np.log10(a) + b, "morris", 10).indices()
    # over the whole range of each axis: two decades, and 5
    np.testing.assert_allclose(effects.values["mu_star"], [2, 5], rtol=1e-12)


def test_points_that_failed_are_said_where_indices_need_all(tmp_path):
    broken = study_of(tmp_path / "s", CUBE, ishigami, "saltelli", 8, fail=[3])
    grid = study_of(tmp_path / "t", {"f.x": "lin(0, 1, 5)"}, lambda x: x)
    still = study_of(tmp_path / "u", CUBE, lambda *x: 0 * x[0], "saltelli", 8)
    for call, words in (
        (broken.indices, "need all points, 1 of 64 have no value; point 3: it broke.*--retry"),
        (grid.indices, "--sample saltelli or morris, got grid"),
        (still.indices, "no axis matters"),
    ):
        with pytest.raises(UsageError, match=words):
            call()


@pytest.mark.heavy
def test_the_command_prints_the_indices(saltelli):
    made = ran("sweep", "indices", saltelli.folder, "--by", "y")
    assert re.search(r"f\.x1 +0\.\d+ ± 0\.\d+", made.output), made.output


@pytest.mark.parametrize(("sample", "n", "words"), [
    ("saltelli", 64, r"f\.a matters most: 93\.6 % ± [\d.]+ % of the variance of y; f\.b"),
    # slopes 8 and 2 over ranges of 1, without bends
    ("morris", 8, r"f\.a matters most: over its range it changes y by 8 rad"),
])  # fmt: skip
def test_a_study_of_sensitivity_begins_with_what_matters_most(tmp_path, sample, n, words):
    over = {"f.a": "lin(0, 1)", "f.b": "lin(0, 1)"}
    answer = study_of(tmp_path / "s", over, lambda a, b: 8 * a + 2 * b, sample, n).answer
    assert re.match(f"Good: {words}", answer.headline), answer.headline
    assert not re.search("[Bb]est", " ".join([answer.headline, answer.verdict["results"], *answer.sentences]))
    broken = study_of(tmp_path / "t", over, lambda a, b: 8 * a + 2 * b, sample, n, fail=[3]).answer
    assert broken.state == DOUBTFUL and "indices need all points, 1 of" in broken.headline


@pytest.mark.parametrize(("sample", "points"), [("saltelli", 8 * (2 * 3 + 2)), ("morris", 8 * (3 + 1))])
def test_the_points_are_as_many_as_needed_and_the_same_for_the_same_seed(sample, points):
    axes = read_axes(["a=lin(0, 1)", "b=normal(0, 1)", "c=x, y, z"])
    first, again, other = (draw(axes, sample, 8, seed)[1] for seed in (1, 1, 2))
    assert all(len(first[name]) == points and (first[name] == again[name]).all() for name in first)
    assert any((first[name] != other[name]).any() for name in first)
