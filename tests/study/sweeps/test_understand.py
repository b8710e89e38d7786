"""What is made of a finished study: a page."""

import json

import numpy as np
import pytest

import vdfmu
from tests.conftest import ran, refused
from tests.study.sweeps.conftest import study_of
from vdfmu.base.errors import UsageError
from vdfmu.study.sweeps.failures import cause_of, failed_groups
from vdfmu.study.sweeps.measures import read_measures, unit_of
from vdfmu.study.sweeps.table import groups, view


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
def test_the_command_writes_a_page(tmp_path):
    made = study_of(tmp_path / "s", {"f.a": "lin(0, 1, 3)"}, lambda a: a)
    (tmp_path / "p.html").write_text("mine")
    words = ["sweep", "report", str(made.folder), "--no-simulate", "-o", str(tmp_path / "p.html")]
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
