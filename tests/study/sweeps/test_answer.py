"""The answer of a study: best point, ranking, the axis that matters, failures, roles of the points of a search."""

import json
import math

import numpy as np
import pytest

import vdfmu
from tests.study.sweeps.conftest import study_of
from vdfmu.base.errors import UsageError
from vdfmu.engine.results.verdict import DOUBTFUL, FAILED, GOOD
from vdfmu.study.sweeps import answer as answers
from vdfmu.study.sweeps import page
from vdfmu.study.sweeps.candidates import JudgedPoint, neighbours
from vdfmu.study.sweeps.sweep import Sweep

GRID = {"f.a": "lin(0, 4, 5)", "f.b": "*lin(1, 5, 5)"}


def bowl(a, b):
    return 1.0 + (a - 2.0) ** 2 + 0.1 * (b - 3.0) ** 2


@pytest.mark.parametrize(("state", "said"), [
    (GOOD, "Its neighbour in the grid is good too, with a modulus margin of 0.7 or more."),
    (FAILED, "Its neighbour in the grid is not good: point 1 fails."),
])  # fmt: skip
def test_the_only_neighbour_is_not_counted(tmp_path, monkeypatch, state, said):
    def judge(study, point, value):
        return JudgedPoint(point, value, state if point else GOOD, "", 0.7)

    monkeypatch.setattr("vdfmu.study.sweeps.candidates.judge_point", judge)
    monkeypatch.setattr(answers, "judge_point", judge)
    assert said in study_of(tmp_path / "s", {"f.a": "1,2"}, lambda a: a).answer.sentences


def test_a_study_says_best_and_largest_point_ranking_and_the_axis_that_matters(tmp_path):
    answer = study_of(tmp_path / "s", GRID, bowl, fail=[0, 24]).answer
    # a study of a function has no scenario to run, so its best point is not judged
    assert answer.headline == "Good: best point 12 (y 1 rad); not judged: verdict on the best point"
    assert answer.best == 12
    first, *rest = answer.sentences
    # bowl: 1 at (2, 3); the corners left have 5.4; of 23 values the twelfth is 2.4, as at (1, 1)
    assert first == (
        "Point 12: f.a 2, f.b × 3. Its y is a factor of 2.4 below the median, and a factor of 5.4 below the "
        "largest, 5.4 rad at f.a 0, f.b × 5 (point 4)."
    )
    # means over b: 1.2 at a = 2, and of 4 values 1 + 4 + 0.1 * (1 + 0 + 1 + 4) / 4 at the ends; over a: 1 + 1.5 + 0.4,
    # 1 + 2 + 0.1, 1 + 2 at b = 1, 2, 3
    assert rest == [
        "The ranking is clear: the next, point 11, has 10 % more.",
        "f.a matters most: it changes the mean of y from 1.2 rad to 5.15 rad, f.b from 2.9 rad to 3.1 rad.",
        "2 of 25 points failed: it broke (2).",
    ]


@pytest.mark.parametrize(("over", "function", "words"), [
    ({"f.a": "lin(0, 1, 5)"}, lambda a: 1 - a, "y falls as f.a grows."),
    ({"f.a": "lin(0, 1, 5)"}, lambda a: 1 - a, "It is at the upper end of f.a: a better point may lie beyond it."),
    ({"f.a": "lin(0, 1, 5)"}, lambda a: a * 0 + 3.0, "y is 3 rad at each point."),
    ({"f.a": "lin(-2, 2, 5)"}, lambda a: a**2 + 1, "The ranking is clear: the next, point 1, has 2 times as much."),
    ({"f.a": "lin(-2, 1, 4)"}, lambda a: 1 + 1e-3 * a**2, "3 other points tie with it, within 1 %."),
    (GRID, lambda a, b: np.random.default_rng(1).permutation(25.0 + np.arange(25)), "No axis stands out"),
])  # fmt: skip
def test_what_is_known_of_the_ranking_and_of_axes_is_said(tmp_path, over, function, words):
    sentences = " ".join(study_of(tmp_path / "s", over, function).answer.sentences)
    assert words in sentences


def test_a_drawn_study_has_a_spread_and_no_best(tmp_path):
    over = {"f.a": "normal(0, 1)", "f.b": "lognormal(1, 0.1)"}
    answer = study_of(tmp_path / "s", over, lambda a, b: 10 + a, "lhs", 40).answer
    sentences = answer.sentences
    assert answer.headline.startswith("Good: y is 10 rad in the median") and answer.best is None
    assert sentences[0].startswith("y is 10 rad in the median, at most 11.") and "in 95 % of the points" in sentences[0]
    assert not any("Best" in each or "ranking" in each for each in sentences)


def test_of_many_points_a_page_shows_some_with_all_that_its_texts_name(tmp_path, monkeypatch):
    study = study_of(tmp_path / "s", GRID, bowl, fail=[0, 24])
    monkeypatch.setattr(page, "MOST_SHOWN", 5)
    shown = page.shown_rows(study, study.answer)
    content = page.study_content(study, study.answer, shown)
    points = content["points"]
    # besides five at random: the best, which is the smallest, the largest and the first that failed
    assert {12, 4, 0} <= set(points) and 5 <= len(points) <= 8 and points == sorted(set(points))
    assert content["roles"] == {"best": [points.index(12)]} and content["failed"][points.index(0)] == "it broke"
    for column in content["columns"]:
        values = study["y" if column["name"] == "y" else column["name"].partition(" ")[0]][shown]
        np.testing.assert_allclose([math.nan if v is None else v for v in column["values"]], values)
    text = study.report(tmp_path / "page.html", simulate=False).read_text("utf-8")
    assert f"pictures show {len(points)}, a random selection with all extremes" in text


def test_a_study_without_a_value_says_why(tmp_path):
    failed = study_of(tmp_path / "t", {"f.a": "lin(0, 1, 4)"}, lambda a: a, fail=range(4))
    assert failed.answer.headline == "Failed: 4 of 4 points failed: it broke (4)"
    text = failed.report().read_text("utf-8")
    assert '<p class="verdict failed">Failed: 4 of 4 points failed: it broke (4) <small>' in text


def searched(folder, after=3.0, **roles):
    """Write a study as the search of a tuning, whose points have these roles, and which lowers the cost from 9."""
    study_of(folder, {"f.a": "lin(0, 4, 5)"}, lambda a: 9.0 - 2.0 * a)
    rows = [{"name": "cost", "before": 9.0, "after": after}, {"name": "modulus[1]", "before": 0.8, "after": 0.51}]
    points = {"start": [0], "chosen": [3], "infeasible": [4], **roles}
    (folder / "tune.json").write_text(json.dumps({"points": points, "comparison": rows}))
    return opened(folder)


def opened(folder):
    search = Sweep(folder)
    search.facts |= {"tune": {"margin": [0.5]}, "n": 1}
    return search


def test_a_search_says_its_chosen_point_and_margin_and_its_best_point_is_feasible(tmp_path):
    search = searched(tmp_path / "s")
    assert search.answer.headline == "Good: cost 3, a factor of 3 below the cost at the start, 9"
    assert search.answer.verdict["results"] == (
        "modulus margin 0.51, 0.5 requested, 0.8 at the start; not judged: verdict on the chosen point"
    )
    assert search.answer.sentences[0] == "Chosen: f.a 3 (point 3)."
    assert f"1 of 5 runs {CANNOT}" in search.answer.sentences
    # of several elements the mean ratio ranks the points of a search, not the largest
    assert not [sentence for sentence in search.answer.sentences if "ranking" in sentence]
    assert (search.row("best")["point"], search.row("worst")["point"]) == (3, 0)
    text = search.report(simulate=False).read_text("utf-8")
    assert "<h1>Tuning of f</h1>" in text and "5 runs of a search over f.a; 0 failed" in text
    assert '"roles":{"start":[0],"chosen":[3],"infeasible":[4]}' in text.replace(" ", "")


def test_a_search_without_a_feasible_point_is_doubtful_and_a_damaged_file_is_an_error(tmp_path):
    search = searched(tmp_path / "s", infeasible=[0, 1, 2, 3, 4])
    assert search.answer.headline == "Doubtful: no values that were tried meet the limits and the margin"
    assert search.answer.sentences[0] == "The nearest is f.a 3 (point 3)."
    (tmp_path / "s" / "tune.json").write_text('{"points": 1}')
    with pytest.raises(UsageError, match="expected the results of a search"):
        _ = opened(tmp_path / "s").search


@pytest.mark.parametrize(("after", "begin"), [
    (8.95, "no better values found than the start, cost 9"),  # 0.6 % less
    (8.9, "cost 8.9, 1.1 % below the cost at the start, 9"),
])  # fmt: skip
def test_a_search_that_gains_less_than_a_per_cent_has_found_nothing_better(tmp_path, after, begin):
    assert searched(tmp_path / "s", after).answer.headline.startswith(f"Good: {begin}")


CANNOT = (
    "cannot be chosen: they fail, miss a limit or the margin, or have an element of the cost that is larger than at "
    "the start."
)
UNSTABLE, NEAR = "unstable from 1.31 s on, joint 1", "modulus margin 0.32 at joint 1, 0.98 s (limit 0.5)"


@pytest.mark.parametrize(("runs", "headline", "best"), [
    ({}, "Good: best point 12 (y 1 rad); modulus margin 0.7", 12),
    ({12: (FAILED, UNSTABLE)}, "Good: best good point 11 (y 1.1 rad)", 11),
    ({12: (FAILED, UNSTABLE), 11: (DOUBTFUL, NEAR)}, "Good: best good point 13 (y 1.1 rad)", 13),
    (dict.fromkeys(range(25), (DOUBTFUL, NEAR)), "Doubtful: best y 1 rad (point 12): modulus margin 0.32", 12),
    ({12: (FAILED, UNSTABLE)} | dict.fromkeys([*range(12), *range(13, 25)], (DOUBTFUL, NEAR)),
     "Doubtful: best y 1.1 rad (point 11): modulus margin 0.32 at joint 1, 0.98 s", 11),
    (dict.fromkeys(range(25), (FAILED, UNSTABLE)), "Doubtful: best y 1 rad (point 12) unstable from 1.31 s on", 12),
])  # fmt: skip
def test_the_best_point_is_the_best_good_one(tmp_path, monkeypatch, runs, headline, best):
    judged = []

    def judge(study, point, value, without=()):
        judged.append(point)
        state, why = runs.get(point, (GOOD, ""))
        return JudgedPoint(point, value, state, why, 0.7 if state == GOOD else 0.32)

    monkeypatch.setattr("vdfmu.study.sweeps.candidates.judge_point", judge)
    monkeypatch.setattr(answers, "judge_point", judge)
    answer = study_of(tmp_path / "s", GRID, bowl).answer
    text = " ".join([answer.headline, answer.verdict["results"], *answer.sentences])
    assert answer.headline.startswith(headline)
    assert answer.best == best and answer.sentences[0].startswith(f"Point {best}: ")
    assert ("point 12 has 1 rad but is unstable from 1.31 s on" in text) == (best != 12)
    # points 11 and 13 have 1.1 rad; the smaller value of a point that is not good is no value behind the best
    assert ("The ranking is clear: the next, point 11, has 10 % more." in text) == (best == 12)
    assert ("1 other point ties with it, within 1 %." in text) == (best in (11, 13))
    if answer.state == GOOD:
        assert answer.verdict["results"].endswith(f"; point {best} has modulus margin 0.7") == (best in (11, 13))
    # none of the eight best and the 15th is good, or the search ends at the first that is, with neighbours
    assert ("None of 9 points is good; the other 16 were not judged" in text) == (answer.state != GOOD)
    assert len(judged) == (9 if answer.state != GOOD else judged.index(best) + 1 + 4)
    if answer.state == GOOD:
        wrong = sum(point in runs for point in judged[judged.index(best) + 1 :])
        said = "Its 4 neighbours in the grid are good too, with a modulus margin of 0.7 or more."
        assert (said if not wrong else f"{wrong} of its 4 neighbours in the grid") in text


def test_neighbours_in_a_grid_are_a_step_of_one_axis_away(tmp_path):
    grid = study_of(tmp_path / "s", {"f.a": "3, 1, 2", "f.m": "one, two"}, lambda a, m: a)
    # a = 3, 1, 2 with each m: points 0, 1 have a = 3, whose neighbour is a = 2 with the same word
    assert [*neighbours(grid, 0)] == [4] and [*neighbours(grid, 5)] == [1, 3]
    drawn = study_of(tmp_path / "t", {"f.a": "lin(0, 1)"}, lambda a: a, "lhs", 5)
    assert not [*neighbours(drawn, 0)]


@pytest.mark.heavy
def test_the_best_number_of_a_grid_of_gains_belongs_to_a_loop_that_is_not_good(tmp_path):
    """The smallest error of 8 x 7 gains of the planar arm is near the border of stability."""
    over = {"controller.K_p": "*lin(1, 8, 8)", "controller.K_v": "*lin(0.5, 3.5, 7)"}
    study = vdfmu.sweep(
        "planar_tracking", over, measure=["error=rms(trajectory.q_d - plant.q)"], out=tmp_path / "s", workers=2
    )
    smallest = int(study.row("best")["point"])
    judged = vdfmu.run(**study.options(smallest), out=False, reference=False).summary["verdict"]
    assert judged["state"] != GOOD
    answer = study.answer
    assert answer.state != GOOD or answer.best != smallest
    assert "point" in answer.headline
