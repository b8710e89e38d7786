"""The answer of a study: best point, ranking, the axis that matters, failures, roles of the points of a search."""

import json

import numpy as np
import pytest

import vdfmu
from tests.study.sweeps.conftest import study_of
from vdfmu.base.errors import UsageError

GRID = {"f.a": "lin(0, 4, 5)", "f.b": "*lin(1, 5, 5)"}


def bowl(a, b):
    return 1.0 + (a - 2.0) ** 2 + 0.1 * (b - 3.0) ** 2


def test_a_study_says_best_and_largest_point_ranking_and_the_axis_that_matters(tmp_path):
    answer = study_of(tmp_path / "s", GRID, bowl, fail=[0, 24]).answer
    assert answer.state == "good"
    first, *rest = answer.sentences
    # bowl: 1 at (2, 3); the corners left have 5.4; of 23 values the twelfth is 2.4, as at (1, 1)
    assert first == (
        "Best: y 1 rad at f.a 2, f.b × 3 (point 12). It is 2.4 times less than the median, and 5.4 times less than the "
        "largest, 5.4 rad at f.a 0, f.b × 5 (point 4)."
    )
    # means over b: 1.2 at a = 2, and of 4 values 1 + 4 + 0.1 * (1 + 0 + 1 + 4) / 4 at the ends; over a: 1 + 1.5 + 0.4,
    # 1 + 2 + 0.1, 1 + 2 at b = 1, 2, 3
    assert rest == [
        "The ranking is clear: the next, point 11, has 10 % more.",
        "f.a matters most: it moves the mean of y from 1.2 rad to 5.15 rad, f.b from 2.9 rad to 3.1 rad.",
        "2 of 25 points failed: it broke (2).",
    ]


@pytest.mark.parametrize(("over", "function", "words"), [
    ({"f.a": "lin(0, 1, 5)"}, lambda a: 1 - a, "y falls as f.a grows."),
    ({"f.a": "lin(0, 1, 5)"}, lambda a: 1 - a, "It is at the upper end of f.a: a better point may be beyond."),
    ({"f.a": "lin(0, 1, 5)"}, lambda a: a * 0 + 3.0, "y is 3 rad at each point."),
    ({"f.a": "lin(-2, 2, 5)"}, lambda a: a**2 + 1, "The ranking is clear: the next, point 1, has 100 % more."),
    ({"f.a": "lin(-2, 1, 4)"}, lambda a: 1 + 1e-3 * a**2, "3 other points tie with it, within 1 %."),
    (GRID, lambda a, b: np.random.default_rng(1).permutation(25.0 + np.arange(25)), "No axis stands out"),
])  # fmt: skip
def test_what_is_known_of_the_ranking_and_of_axes_is_said(tmp_path, over, function, words):
    sentences = " ".join(study_of(tmp_path / "s", over, function).answer.sentences)
    assert words in sentences


def test_a_drawn_study_has_a_spread_and_no_best(tmp_path):
    over = {"f.a": "normal(0, 1)", "f.b": "lognormal(1, 0.1)"}
    sentences = study_of(tmp_path / "s", over, lambda a, b: 10 + a, "lhs", 40).answer.sentences
    assert sentences[0].startswith("y is 10 rad in the median, at most 11.") and "in 95 % of the points" in sentences[0]
    assert not any("Best" in each or "ranking" in each for each in sentences)


def test_a_study_without_a_value_says_why(tmp_path):
    failed = study_of(tmp_path / "t", {"f.a": "lin(0, 1, 4)"}, lambda a: a, fail=range(4))
    assert failed.answer == ("failed", ("4 of 4 points failed: it broke (4).",))
    text = failed.report().read_text("utf-8")
    assert '<p class="verdict failed">4 of 4 points failed: it broke (4).</p>' in text


def searched(folder, **roles):
    """Write a study as the search of a tuning, whose points have these roles."""
    study_of(folder, {"f.a": "lin(0, 4, 5)"}, lambda a: 9.0 - 2.0 * a)
    rows = [{"name": "cost", "before": 9.0, "after": 3.0}, {"name": "modulus[1]", "before": 0.8, "after": 0.51}]
    points = {"start": [0], "chosen": [3], "infeasible": [4], **roles}
    (folder / "tune.json").write_text(json.dumps({"points": points, "comparison": rows}))
    return opened(folder)


def opened(folder):
    search = vdfmu.Sweep(folder)
    search.facts |= {"tune": {"margin": [0.5]}, "n": 1}
    return search


def test_a_search_says_its_chosen_point_and_margin_and_its_best_point_is_feasible(tmp_path):
    search = searched(tmp_path / "s")
    assert search.answer.state == "good"
    assert search.answer.sentences[:2] == (
        "Chosen: cost 3 at f.a 3 (point 3). It is 3 times less than the cost at the start, 9.",
        "It holds the margin: the modulus margin is 0.51, 0.5 demanded, 0.8 at the start.",
    )
    assert "1 of 5 runs misses a limit or the margin." in search.answer.sentences
    assert "The ranking is clear: the next, point 2, has 67 % more." in search.answer.sentences
    assert (search.row("best")["point"], search.row("worst")["point"]) == (3, 0)
    text = search.report(simulate=False).read_text("utf-8")
    assert "<h1>Tuning of f</h1>" in text and "5 runs of a search over f.a; 0 failed" in text
    assert '"roles":{"start":[0],"chosen":[3],"infeasible":[4]}' in text.replace(" ", "")


def test_a_search_without_a_feasible_point_is_doubtful_and_a_damaged_file_is_an_error(tmp_path):
    search = searched(tmp_path / "s", infeasible=[0, 1, 2, 3, 4])
    assert search.answer.state == "doubtful"
    assert search.answer.sentences[0].startswith("The search found no values within the limits and the margin.")
    (tmp_path / "s" / "tune.json").write_text('{"points": 1}')
    with pytest.raises(UsageError, match="expected the results of a search"):
        _ = opened(tmp_path / "s").search
