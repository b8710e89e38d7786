"""Results: access, and CSV that reads back to the same bits."""

from __future__ import annotations

import numpy as np
import pytest

from vdfmu.engine.cosim import Results, Signal
from vdfmu.errors import UsageError


@pytest.fixture
def results() -> Results:
    rng = np.random.default_rng(7)
    m = 1300  # more than two blocks of lines
    real = rng.standard_normal((m, 3)) * 10.0 ** rng.integers(-300, 300, (m, 3))
    real[0] = [np.nan, np.inf, -0.0]
    real[1] = [5e-324, 0.1, 1.0]
    return Results(
        0.001 * np.arange(m),
        [
            Signal("a.q[2]", "real", "rad", 1),
            Signal("a.q[1]", "real", "rad", 0),
            Signal("a.n", "integer", "", 0),
            Signal("a.m[1,2]", "real", "", 2),
            Signal("a.on", "boolean", "", 0),
        ],
        {
            "real": real,
            "integer": rng.integers(-(2**31), 2**31 - 1, (m, 1), dtype=np.int32),
            "boolean": rng.integers(0, 2, (m, 1), dtype=np.int32),
        },
    )


def test_csv_reads_back_to_the_same_bits(results, tmp_path):
    results.to_csv(tmp_path / "r.csv")
    again = Results.from_csv(tmp_path / "r.csv")
    assert again.names == results.names
    assert again.units == results.units
    assert again.kinds == results.kinds
    assert again.time.tobytes() == results.time.tobytes()
    for name in results:
        assert again[name].dtype == results[name].dtype
        assert again[name].tobytes() == results[name].tobytes()


@pytest.mark.parametrize(
    "name",
    [
        "a,b",
        'a"b',
        "a\nb",
        "a\r\nb",
        "a\rb",
        "\n",
        "",
        " a ",
        "a\u2028b",
        "a\x85b",
        "\u00e4\u4e2d",
        "'",
        "#a",
        "time",
        "1.0",
    ],
)
def test_every_name_reads_back_from_csv(tmp_path, name):
    signals = [Signal(name, "real", name, 0), Signal("last", "real", "m", 1)]
    results = Results(np.arange(3.0), signals, {"real": np.arange(6.0).reshape(3, 2)})
    results.to_csv(tmp_path / "r.csv")
    again = Results.from_csv(tmp_path / "r.csv")
    assert again.names == [name, "last"]
    assert again.units == {name: name, "last": "m"}
    np.testing.assert_array_equal(again[name], results[name])


def test_csv_has_a_line_of_names_and_a_line_of_units(results, tmp_path):
    results.to_csv(tmp_path / "r.csv")
    lines = (tmp_path / "r.csv").read_text().splitlines()
    assert lines[0] == 'time,a.q[2],a.q[1],a.n,"a.m[1,2]",a.on'
    assert lines[1] == "s,rad,rad,integer,,boolean"
    assert len(lines) == 1302


def test_array_stacks_by_index(results):
    np.testing.assert_array_equal(results.array("a.q")[:, 0], results["a.q[1]"])
    np.testing.assert_array_equal(results.array("a.q")[:, 1], results["a.q[2]"])
    assert results["a.on"].dtype == bool


def test_array_of_two_indices_has_two_axes():
    names = [f"a.R[{j},{k}]" for k in (2, 10, 1) for j in (2, 1)]  # in no order
    values = np.arange(24.0).reshape(4, 6)
    signals = [Signal(name, "real", "", i) for i, name in enumerate(names)]
    R = Results(np.arange(4.0), signals, {"real": values}).array("a.R")
    assert R.shape == (4, 2, 3)
    for (j, k), column in {(0, 0): 5, (1, 0): 4, (0, 1): 1, (1, 1): 0, (0, 2): 3, (1, 2): 2}.items():
        np.testing.assert_array_equal(R[:, j, k], values[:, column])
    triangle = Results(np.arange(4.0), signals[:5], {"real": values})
    with pytest.raises(UsageError, match=r"a\.R\[2,2\], .* are not all elements of an array; take them one"):
        triangle.array("a.R")
    empty = Results(np.empty(0), signals, {"real": np.empty((0, 6))})
    assert empty.array("a.R").shape == (0, 2, 3)


def test_unknown_names(results):
    with pytest.raises(UsageError, match=r"no signal 'a\.q\[3\]'; did you mean a\.q\["):
        results["a.q[3]"]
    with pytest.raises(UsageError, match=r"no signals a\.p\[1\]"):
        results.array("a.p")
    assert "a.q[1]" in results
    assert "a.p" not in results


def test_an_empty_result_can_be_written(tmp_path):
    empty = Results(np.empty(0), [Signal("a", "real", "m", 0)], {"real": np.empty((0, 1))})
    empty.to_csv(tmp_path / "r.csv")
    assert len(Results.from_csv(tmp_path / "r.csv")) == 0


def test_a_file_that_cannot_be_written(results, tmp_path):
    with pytest.raises(UsageError, match="cannot write .*: No such file or directory"):
        results.to_csv(tmp_path / "nowhere" / "r.csv")
    (tmp_path / "r.csv").mkdir()
    with pytest.raises(Exception, match="cannot write .*: Is a directory"):
        results.to_csv(tmp_path / "r.csv")
    assert [p.name for p in tmp_path.iterdir()] == ["r.csv"]  # no half file is left


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "expected a line of names and a line of units"),
        ("a,b\ns,m\n1,2\n", "'time' as the first column"),
        ("time,b\ns\n", "as many units as names"),
        ("time,b\ns,m\n1,x\n", "could not convert string 'x'"),
        ("time,b\ns,m\n1,2,3\n", "expected 2 columns, got 3"),
    ],
)
def test_csv_of_another_form(tmp_path, text, message):
    (tmp_path / "r.csv").write_text(text)
    with pytest.raises(UsageError, match=message):
        Results.from_csv(tmp_path / "r.csv")


def test_a_missing_csv(tmp_path):
    with pytest.raises(UsageError, match="cannot read .*No such file"):
        Results.from_csv(tmp_path / "r.csv")
