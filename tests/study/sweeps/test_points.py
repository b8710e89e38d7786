"""What varies, and how its values are combined."""

import re

import numpy as np
import pytest
from scipy import stats

from vdfmu.base.errors import UsageError
from vdfmu.study.sweeps.axes import draw, read_axes


def axis_of(text):
    return read_axes([text])[0]


@pytest.mark.parametrize(("form", "values"), [
    ("lin(1, 3, 5)", [1.0, 1.5, 2.0, 2.5, 3.0]), ("log(1, 100, 3)", [1.0, 10.0, 100.0]),
    ("log(-1, -100, 3)", [-1.0, -10.0, -100.0]), ("1, 2.5, 7", [1, 2.5, 7]), ("[4, 5]", [4, 5]),
    ("inverse, vdc", ["inverse", "vdc"]), ("1, two", ["1", "two"]),
])  # fmt: skip
def test_values_of_a_grid(form, values):
    axis = axis_of(f"a.b={form}")
    exact = isinstance(values[0], str)
    assert list(axis.values) == (values if exact else pytest.approx(values, rel=1e-15))
    assert not axis.factor
    starred = axis_of("a.b=*lin(0.9, 1.1, 3)")
    assert starred.factor and str(starred) == "a.b=*lin(0.9, 1.1, 3)"


@pytest.mark.parametrize(("form", "law"), [
    ("lin(2, 5)", stats.uniform(2.0, 3.0)), ("log(0.1, 10)", stats.loguniform(0.1, 10.0)),
    ("normal(3, 0.5)", stats.norm(3.0, 0.5)), ("lognormal(2, 0.3)", stats.lognorm(0.3, scale=2.0)),
])  # fmt: skip
def test_shares_are_those_of_the_distribution(form, law):
    u = np.linspace(0.01, 0.99, 99)
    # the same functions in another order: rounding of a few units
    np.testing.assert_allclose(axis_of(f"a.b={form}").at(u), law.ppf(u), rtol=1e-12)
    assert np.isfinite(axis_of(f"a.b={form}").at([0.0, 1.0])).all()


REFUSED = {
    "expected TARGET=FORM": ["a.b", "=lin(1, 2)"],
    "got nothing|expected lin": ["a.b="],
    r"expected lin\(FROM, TO\)": ["a.b=lin(1)", "a.b=lin(1, x)", "a.b=lin(1, inf)"],
    "from 1 to 10000000": ["a.b=lin(1, 2, 0)", "a.b=lin(1, 2, 2.5)", "a.b=lin(1, 2, 1e12)"],
    "the same sign": ["a.b=log(0, 2)"],
    "not negative": ["a.b=normal(1, -1)"],
    "expected lin": ["a.b=triangle(1, 2)", "a.b=1,,2"],
    "finite": ["a.b=1, nan"],
}


@pytest.mark.parametrize("words", REFUSED)
def test_what_cannot_be_read_is_said(words):
    for text in REFUSED[words]:
        with pytest.raises(UsageError, match=words):
            read_axes([text])


@pytest.mark.parametrize(("form", "fix"), [("500:4000:8", "lin(500, 4000, 8)"), ("*0.5:2", "*lin(0.5, 2, N)")])
def test_a_range_with_colons_is_answered_by_the_form_that_it_has_here(form, fix):
    with pytest.raises(UsageError, match=re.escape(f"got {form}. Write {fix}.")):
        axis_of(f"a.b={form}")


def test_all_that_is_wrong_is_said_at_once():
    with pytest.raises(UsageError) as info:
        read_axes(["a.b", "c.d=lin(1)", "e.f=1", "e.f=2"])
    assert len(str(info.value).splitlines()) == 3


def test_a_grid_has_all_combinations_and_a_latin_hypercube_a_point_in_each_stretch():
    _, points = draw(read_axes({"a": [1, 2], "b": "lin(0, 1, 3)"}), "grid")
    assert points["a"].tolist() == [1, 1, 1, 2, 2, 2]
    assert points["b"].tolist() == [0.0, 0.5, 1.0] * 2
    _, points = draw(read_axes(["a=lin(0, 1)", "b=log(1, 10)"]), "lhs", 50, seed=3)
    for column in (points["a"], np.log10(points["b"])):
        assert sorted((50 * column).astype(int)) == list(range(50))


@pytest.mark.parametrize("sample", ["lhs", "sobol", "random"])
def test_the_same_seed_draws_the_same_points_and_another_one_others(sample):
    axes = read_axes(["a=lin(0, 1)", "b=normal(0, 1)", "c=x, y, z"])
    first, again, other = (draw(axes, sample, 16, seed)[1] for seed in (1, 1, 2))
    assert all((first[name] == again[name]).all() for name in first)
    assert any((first[name] != other[name]).any() for name in first)
    assert set(first["c"]) <= {"x", "y", "z"}


def test_sobol_points_fill_the_square_evenly():
    from scipy.stats import qmc

    axes = read_axes(["a=lin(0, 1)", "b=lin(0, 1)"])
    even, random = (
        qmc.discrepancy(np.column_stack(list(draw(axes, sample, 256)[1].values()))) for sample in ("sobol", "random")
    )
    assert even < random / 5


def test_a_file_has_targets_and_points(tmp_path):
    path = tmp_path / "points.csv"
    path.write_text("plant.q_0[1], algorithm\n0.1, jacobi\n0.2,gauss-seidel\n", encoding="utf-8-sig")
    axes, points = draw([], str(path))
    assert [axis.target for axis in axes] == ["plant.q_0[1]", "algorithm"]
    assert points["plant.q_0[1]"].tolist() == [0.1, 0.2]
    assert points["algorithm"].tolist() == ["jacobi", "gauss-seidel"]
    with pytest.raises(UsageError, match="has the points; omit it"):
        draw([], str(path), 3)


@pytest.mark.parametrize(
    ("content", "words"),
    [("a,b\n", "a line for each point"), ("a,b\n1\n", "line 2: expected 2 values, got 1"), ("a,a\n1,2\n", "once"),
     ("a\nnan\n", "finite"), (None, "expected grid"),
     ('a,b\n600,"500,5"\n601,"501,5"\n', "line 2: b: expected one value, got '500,5'"),
     ("a,b\n\n1,2\n3,\n", "line 4: b: expected one value, got ''")],
)  # fmt: skip
def test_a_file_that_cannot_be_read_is_said(tmp_path, content, words):
    path = tmp_path / "points.csv"
    if content is not None:
        path.write_text(content)
    with pytest.raises(UsageError, match=words):
        draw([], str(path))


@pytest.mark.parametrize(("over", "sample", "n", "words"), [
    (["a=lin(0, 1)"], "grid", None, "or their number"),
    (["a=lin(0, 1, 3)"], "grid", 10, "^points: a grid .* Omit it"),
    (["a=lin(0, 1)"], "lhs", None, "number of points"),
    (["a=lin(0, 1)"], "lhs", 0, "number of points"),
    ([], "grid", None, "^vary: expected at least one axis"),
    ([f"a{i}=lin(0, 1, 100)" for i in range(4)], "grid", None, "at most"),
    (["a=1"], "points.csv", None, "points.csv has its own axes"),
    (["a=1"], "lhz", 3, "expected grid, lhs"),
    (["a=lin(0, 1)"], "saltelli", 10**7, "at most"),
    (["a=lin(0, 1)"], "lhs", -1, "seed: expected a number of at least 0, got -1"),
])  # fmt: skip
def test_what_does_not_fit_together_is_said(over, sample, n, words):
    with pytest.raises(UsageError, match=words):
        draw(read_axes(over), sample, *((3, -1) if words.startswith("seed") else (n,)))
