"""Results: access, and the form of CSV; that it reads back to the same bits is shown beside Parquet."""

import math
from decimal import Decimal

import numpy as np
import pytest

from vdfmu.base.errors import StorageError, UsageError
from vdfmu.engine.results import csv_file
from vdfmu.engine.run import Results, Signal


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
            Signal("a.q[2]", "real", "rad", 1), Signal("a.q[1]", "real", "rad", 0), Signal("a.n", "integer", "", 0),
            Signal("a.m[1,2]", "real", "", 2), Signal("a.on", "boolean", "", 0),
        ],
        {
            "real": real,
            "integer": rng.integers(-(2**31), 2**31 - 1, (m, 1), dtype=np.int32),
            "boolean": rng.integers(0, 2, (m, 1), dtype=np.int32),
        },
    )  # fmt: skip


def test_csv_has_the_same_bytes_with_any_kinds_and_without_a_compiler(results, monkeypatch):
    """Reals alone are written whole rows at a time, else column by column; without a compiler by scipy's `mmwrite`."""
    real, time = results.data, results.time
    signals = [signal for signal in results.signals if signal.kind == "real"]
    rows = csv_file.csv_lines(time, signals, real, slice(None))
    mixed = csv_file.csv_lines(time, [*signals, results.signals[2]], real, slice(None))
    assert rows == "".join(line.rpartition(",")[0] + "\n" for line in mixed.splitlines())
    monkeypatch.setattr(csv_file, "_library", lambda: None)
    assert csv_file.csv_lines(time, signals, real, slice(None)) == rows


def test_numbers_in_csv_have_the_digits_of_python_which_are_the_fewest_that_read_back():
    """All powers of two and ten, whole and random numbers, and random bits: those of all exponents, and NaN."""
    rng = np.random.default_rng(8)
    special = [0.0, -0.0, math.inf, -math.inf, math.nan, 5e-324, 1e23, 9007199254740993.0, 2.2250738585072014e-308]
    numbers = np.concatenate([
        special, 2.0 ** np.arange(-1074, 1024), 10.0 ** np.arange(-308, 309), np.arange(3000) * 1e-3,
        rng.normal(size=3000), rng.integers(0, 2**64, 30_000, np.uint64).view(np.float64),
        rng.integers(0, 2**52, 3000, np.uint64).view(np.float64),
    ])  # fmt: skip
    written = csv_file.csv_lines(numbers, [], {"real": np.empty((len(numbers), 0))}, slice(None)).split()

    def parts(text: str) -> tuple[str, int]:
        """Return the digits of a finite number, and the power of ten of the last one."""
        sign, digits, exponent = Decimal(text).normalize().as_tuple()
        return f"{sign} {digits}", exponent

    finite = np.isfinite(numbers)
    assert [parts(text) for text in np.array(written)[finite]] == [parts(repr(x)) for x in numbers[finite].tolist()]
    assert {text for text, number in zip(written, numbers, strict=True) if not np.isfinite(number)} == {
        "NaN",
        "Infinity",
        "-Infinity",
    }


@pytest.mark.parametrize("name", [
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
])  # fmt: skip
def test_every_name_reads_back_from_csv(tmp_path, name):
    signals = [Signal(name, "real", name, 0), Signal("last", "real", "m", 1)]
    results = Results(np.arange(3.0), signals, {"real": np.arange(6.0).reshape(3, 2)})
    results.write(tmp_path / "r.csv")
    again = Results.read(tmp_path / "r.csv")
    assert again.names == [name, "last"]
    assert again.units == {name: name, "last": "m"}
    np.testing.assert_array_equal(again[name], results[name])


def test_csv_has_lines_of_names_and_units_and_groups_stack_by_their_indices(results, tmp_path):
    results.write(tmp_path / "r.csv")
    lines = (tmp_path / "r.csv").read_text().splitlines()
    assert lines[0] == 'time,a.q[2],a.q[1],a.n,"a.m[1,2]",a.on'
    assert lines[1] == "s,rad,rad,integer,,boolean"
    assert len(lines) == 1302
    np.testing.assert_array_equal(results["a.q"][:, 0], results["a.q[1]"])
    np.testing.assert_array_equal(results["a.q"][:, 1], results["a.q[2]"])
    assert results["a.on"].dtype == bool
    names = [f"a.R[{j},{k}]" for k in (2, 10, 1) for j in (2, 1)]  # in no order
    values = np.arange(24.0).reshape(4, 6)
    signals = [Signal(name, "real", "", i) for i, name in enumerate(names)]
    R = Results(np.arange(4.0), signals, {"real": values})["a.R"]
    assert R.shape == (4, 2, 3)
    for (j, k), column in {(0, 0): 5, (1, 0): 4, (0, 1): 1, (1, 1): 0, (0, 2): 3, (1, 2): 2}.items():
        np.testing.assert_array_equal(R[:, j, k], values[:, column])
    triangle = Results(np.arange(4.0), signals[:5], {"real": values})
    with pytest.raises(UsageError, match=r"a\.R\[2,2\], .* do not fill an array; read them one"):
        triangle["a.R"]
    empty = Results(np.empty(0), signals, {"real": np.empty((0, 6))})
    assert empty["a.R"].shape == (0, 2, 3)


def test_unknown_names_are_refused(results):
    with pytest.raises(UsageError, match=r"no signal 'a\.q\[3\]'; did you mean a\.q\["):
        results["a.q[3]"]
    with pytest.raises(UsageError, match=r"no signal 'a\.p'"):
        results["a.p"]
    assert "a.q[1]" in results
    assert "a.p" not in results


def test_a_file_that_cannot_be_written(results, tmp_path):
    with pytest.raises(UsageError, match="cannot write .*: No such file or directory"):
        results.write(tmp_path / "nowhere" / "r.csv")
    (tmp_path / "r.csv").mkdir()
    with pytest.raises(StorageError, match="r.csv: is a folder; expected the name of a file"):
        results.write(tmp_path / "r.csv")
    assert [p.name for p in tmp_path.iterdir()] == ["r.csv"]  # no half file is left


@pytest.mark.parametrize(("text", "message"), [
    (None, "r.csv: expected a CSV file in UTF-8, but it cannot be read: No such file"),
    ("", "'time' in s as the first column.*got nothing"),
    ("a,b\ns,m\n1,2\n", "'time' in s as the first column.*got a, b"),
    ("time,b\nms,m\n1,2\n", "'time' in s as the first column"),
    ("time,b,b\n1,2,3\n", "b: more than one column has this name"),
    ("time,b\ns\n", "a unit for each name"),
    ("time,b\ns,m\n1,x\n", "row 3: b: expected a number, got 'x'"),
    ("time,b\ns,m\n1,2,3\n", "row 3: expected 2 cells, got 3"),
])  # fmt: skip
def test_csv_of_another_form_or_none(tmp_path, text, message):
    if text is not None:
        (tmp_path / "r.csv").write_text(text)
    with pytest.raises(UsageError, match=message):
        Results.read(tmp_path / "r.csv")


def made(time, **columns) -> Results:
    values = np.column_stack([np.broadcast_to(column, np.shape(time)) for column in columns.values()])
    signals = [Signal(f"a.{name}[{i}]", "real", "rad", k) for k, name in enumerate(columns) for i in (1,)]
    return Results(np.asarray(time, float), signals, {"real": values.astype(float)}, {"scenario": "mine"})


def test_results_show_what_is_in_them(results):
    lines = repr(results).splitlines()
    assert lines[0] == "Results: 5 signals, 1300 rows from 0 to 1.299 s"
    assert [line.split()[:2] for line in lines[2:]] == [
        ["a.q", "2"], ["a.n", results["a.n"].min().astype(float).__format__(".4g")], ["a.m", "1"], ["a.on", "0"],
    ]  # fmt: skip
    html = made([0.0, 1.0], **{"<b>": [1.0, 2.0]})._repr_html_()
    assert "a.&lt;b&gt;" in html
    assert "<b>" not in html.replace("<tbody>", "")
    assert "Results of mine: 1 signal, 2 rows" in html
    assert made([0.0, 1.0], q=-0.0).contents()._repr_html_().count("<td>0</td>") == 2  # and none of -0
    assert "0 rows" in repr(Results(np.empty(0), [Signal("a", "real", "m", 0)], {"real": np.empty((0, 1))}))


def test_pandas_and_xarray_have_the_numbers_and_their_units(results):
    frame = results.to_pandas()
    assert list(frame.columns) == results.names
    assert frame.attrs["units"]["a.q[1]"] == "rad"
    assert frame["a.on"].dtype == bool
    np.testing.assert_array_equal(frame["a.q[2]"].to_numpy(), results["a.q[2]"])
    np.testing.assert_array_equal(frame.index, results.time)
    dataset = results.to_xarray()
    assert dataset["a.q"].dims == ("time", "a.q_1")
    assert dataset["a.q"].attrs == {"units": "rad"}
    np.testing.assert_array_equal(dataset["a.q"].sel({"a.q_1": 2}), results["a.q[2]"])
    assert dataset["a.m"].dims == ("time", "a.m_1", "a.m_2")
    assert dataset["a.n"].dims == ("time",)
    assert dataset.time.attrs == {"units": "s"}


def test_differences_of_results_on_other_times():
    time = np.linspace(0.0, 1.0, 11)
    mine, other = made(time, q=time, w=time), made(time[::5] + 0.0, q=time[::5] + 0.25, p=0.0)
    differences = mine.compare(other)
    ((group, unit, largest, rms, name, _),) = differences.rows  # what both have
    assert (group, unit, name) == ("a.q", "rad", "a.q[1]")
    # a straight line is interpolated to rounding
    np.testing.assert_allclose([largest, rms], 0.25, rtol=1e-14)
    assert differences.notes == ("only in the first: a.w[1]", "only in the other: a.p[1]")
    assert mine.compare(mine).rows[0][2] == 0.0
    half = made([0.5, 0.75], q=[0.5, np.nan])
    assert np.isnan(mine.compare(half).rows[0][2])  # NaN is not passed over
    with pytest.raises(UsageError, match=r"results that overlap in time, got 0 to 1 s and 2 to 3 s"):
        mine.compare(made([2.0, 3.0], q=0.0))
    with pytest.raises(UsageError, match="results with signals of the same names"):
        mine.compare(made(time, other=0.0))


@pytest.mark.heavy
def test_runs_over_each_other_in_one_picture(tmp_path):
    time = np.linspace(0.0, 1.0, 11)
    mine, other = made(time, q=time, w=time), made(time, q=2 * time)
    figure = mine.plot("a.q", over={"twice": other}, path=tmp_path / "q.svg")
    (axes,) = figure.axes
    assert [line.get_ydata()[-1] for line in axes.lines] == [1.0, 2.0]
    assert len({line.get_linestyle() for line in axes.lines}) == 2
    assert [text.get_text() for text in axes.get_legend().get_texts()] == ["mine", "twice"]
    assert (tmp_path / "q.svg").read_text().startswith("<?xml")
    with pytest.raises(UsageError, match=r"expected a picture \.png, \.svg, \.pdf, got \.jpg"):
        mine.plot(path=tmp_path / "q.jpg")
    with pytest.raises(UsageError, match=r"no signal 'a\.x'"):
        mine.plot("a.x")
    for wrong in (other, {"twice": "q.csv"}):
        with pytest.raises(UsageError, match=r"expected results by label, over=\{'soft': other\}"):
            mine.plot("a.q", over=wrong)
