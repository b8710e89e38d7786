"""What is made of a finished study: indices of sensitivity, a page."""

import json
import re

import numpy as np
import pytest

import vdfmu
from tests.conftest import ran, refused
from tests.study.sweeps.conftest import study_of
from vdfmu.base.errors import UsageError
from vdfmu.study.sweeps.axes import shares
from vdfmu.study.sweeps.failures import cause_of, failed_groups
from vdfmu.study.sweeps.indices import morris_indices, sobol_indices
from vdfmu.study.sweeps.measures import read_measures, unit_of
from vdfmu.study.sweeps.table import groups, view

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


def test_axes_come_by_influence(tmp_path):
    over = {"f.a": "lin(0, 1, 3)", "f.b": "lin(0, 1, 3)", "f.c": "lin(0, 1, 3)"}
    shown = view(study_of(tmp_path / "s", over, lambda a, b, c: a - 5 * b + 3 * c))
    assert [side.name for side in shown.sides] == ["f.b", "f.c", "f.a"]
    # means over the other two axes, 0.5 - 0.5 * 5 and so on: rounding
    ends = [groups(side, shown.value) for side in shown.sides]
    np.testing.assert_allclose([e[-1][1] - e[0][1] for e in ends], [-5.0, 3.0, 1.0], rtol=1e-12)


def test_a_measure_without_values_is_shown_as_such_and_what_cannot_be_drawn_said(tmp_path):
    undefined = study_of(tmp_path / "s", {"f.a": "lin(0, 1, 3)"}, lambda a: a * np.nan)
    assert undefined.ranges() == [["y", "no value", "", "", "", ""]]
    failed = study_of(tmp_path / "t", {"f.a": "lin(0, 1, 4)"}, lambda a: a, fail=range(4))
    with pytest.raises(UsageError, match="no point has a value of y: all failed"):
        failed["y"]
    assert failed.undefined() == []
    some = study_of(tmp_path / "w", {"f.a": "lin(0, 1, 3)"}, lambda a: np.where(a == 0.0, np.nan, a), fail=[2])
    assert some.undefined() == ["y has no finite value at 1 of 3 points."]
    plain = study_of(tmp_path / "v", {"f.a": "lin(0, 1, 4)"}, lambda a: a)
    fixed = study_of(tmp_path / "u", {"f.a": "1"}, lambda a: a * 1.0)
    for each, measure, words in (
        (plain, "z", "expected y, got 'z'"),
        (failed, None, "all failed"),
        (fixed, None, "expected an axis with at least two values"),
    ):
        with pytest.raises(UsageError, match=words):
            view(each, measure)


@pytest.mark.heavy
def test_the_commands_write_a_page_and_a_table(saltelli, tmp_path):
    made = ran("sweep", "indices", saltelli.folder, "--by", "y")
    assert re.search(r"f\.x1 +0\.\d+ ± 0\.\d+", made.output), made.output
    (tmp_path / "p.html").write_text("mine")
    words = ["sweep", "report", str(saltelli.folder), "--no-simulate", "-o", str(tmp_path / "p.html")]
    assert "replace it with --overwrite" in refused(*words)
    for more in (["--overwrite"], []):  # the second time it is ours
        ran(*words, *more)


@pytest.mark.heavy
def test_the_page_stands_alone_and_says_how_to_run_the_worst_point(tmp_path):
    from lxml import html

    over = {"f.a": "lin(0, 1, 5)", "f.b": "lin(0, 1, 5)"}
    made = study_of(tmp_path / "a <study>", over, lambda a, b: a + b, fail=[24])
    text = made.report().read_text("utf-8")
    page = html.fromstring(text)
    assert not page.xpath("//img | //link[not(starts-with(@href, 'data:'))] | //script[@src]")
    content = json.loads(page.xpath("//script[@id='data']")[0].text)["study"]
    assert content["command"] == f"vdfmu run --from '{made.path}' --row"
    assert [column["name"] for column in content["columns"]] == ["f.a", "f.b", "y"]
    assert content["columns"][2]["values"][19] == 1.75 and content["columns"][2]["values"][24] is None
    assert content["changes"] is None and content["reason"]  # no scenario, so that it cannot be run
    worst = page.xpath("//button[@data-point='19']")[0].text_content()
    assert worst == "f.a 0.75, f.b 1"
    assert "it broke" in page.text_content()


def test_failures_are_grouped_by_cause_and_units_are_kept_by_expressions(tmp_path):
    made = study_of(tmp_path / "study", {"f.a": "lin(0, 1, 3)", "f.b": "1, 2"}, lambda a, b: a + b, fail=[4, 5])
    (group,) = failed_groups(made)
    assert (group.points, group.where) == ([4, 5], "f.a 1")
    kinds = {
        "solver": "solver of plant: its step reached the minimum, as in an unstable loop",
        "unstable": "unstable loop",
        "component": "f: y[…] is … at …",
    }
    assert {kind: cause_of("f: y[3] is 12.5 at 3e-4", kind, "plant") for kind in kinds} == kinds
    units = {"a.q": "rad", "a.q[1]": "rad", "b.tau": "N.m"}
    texts = {
        "rms(a.q - a.q[1])": "rad", "worst(peak(b.tau))": "N.m", "degrees(final(a.q))": "deg", "settling(a.q)": "s",
        "mean(a.q * b.tau)": "", "rms(a.q - b.tau)": "", "integral(a.q)": "", "-max(abs(a.q))": "rad",
        40 * "-" + "rms(a.q)": "rad",  # each part is read once, not twice in the part around it
    }  # fmt: skip
    for text, unit in texts.items():
        assert unit_of(read_measures([f"m={text}"])[0], units) == unit, text


@pytest.mark.heavy
def test_a_study_knows_the_units_of_its_axes_and_measures(tmp_path):
    swept = vdfmu.sweep(
        "planar_tracking", ["plant.K_f0[2]=1e4, 2e4", "plant.mass=*1", "feedforward.mode=vdc"], stop=0.01, workers=1,
        measure=["error=rms(trajectory.q_d - plant.q)"], out=tmp_path / "study",
    )  # fmt: skip
    assert swept.facts["units"] == {
        "plant.K_f0[2]": "N.m/rad", "plant.mass": "", "feedforward.mode": "", "error": "rad",
    }  # fmt: skip
