"""The reader of CSV: every row of every dialect is read once, in time and memory that are linear in cells and bytes."""

import io
import sys

import numpy as np
import pytest

from vdfmu.base import csv_file
from vdfmu.base.csv_file import CsvFile, read_columns, repeated, split_unit
from vdfmu.base.errors import UsageError
from vdfmu.engine.results.results import Results


def written(rng, rows, separator, comma, head, units):
    """Return a text, its names and its values: numbers in their shortest form, which reads back to the same bits."""
    count = int(rng.integers(2, 6))
    values = rng.standard_normal((rows, count)) * 10.0 ** rng.integers(-9, 9, (rows, count))
    values[:, 0] = np.arange(rows)
    names = ["time", *(f"q[{k}]" for k in range(1, count))]
    used = ["s", *(["rad", "1", "N.m", "deg"][int(rng.integers(4))] for _ in names[1:])]
    cells = [f"{name} [{unit}]" if head else name for name, unit in zip(names, used, strict=True)]
    lines = [separator.join(cells), *([separator.join(used)] if units else [])]
    lines += [separator.join(repr(float(x)).replace(".", "," if comma else ".") for x in row) for row in values]
    end = ["\n", "\r\n"][int(rng.integers(2))]
    return end.join(lines) + (end if rng.integers(2) else ""), names, used if head or units else [""] * count, values


@pytest.mark.parametrize("units", [False, True])
@pytest.mark.parametrize(("separator", "comma"), [(",", False), (";", True), (";", False), ("\t", True), ("  ", False)])
def test_every_row_of_every_dialect_reads_back(tmp_path, monkeypatch, separator, comma, units):
    monkeypatch.setattr(csv_file, "_ROWS", 7)  # several blocks
    monkeypatch.setattr(csv_file, "_CELLS", 1)
    rng = np.random.default_rng(11)
    for number in range(20):
        head = separator != "  " and not units and bool(number % 2)
        text, names, used, values = written(rng, int(rng.integers(1, 40)), separator, comma, head, units)
        (tmp_path / "r.csv").write_text(["", "\ufeff"][number % 2] + text, encoding="utf-8")
        columns = read_columns(tmp_path / "r.csv")
        assert (columns.file.names, columns.file.units, columns.faults) == (names, used, [])
        assert columns.values.tobytes() == values.tobytes()
        assert columns.lines.tolist() == [k + 2 + units for k in range(len(values))]
        results = Results.read(tmp_path / "r.csv")
        assert results.time.tobytes() == values[:, 0].tobytes()
        assert np.column_stack([results[name] for name in names[1:]]).tobytes() == values[:, 1:].tobytes()


@pytest.mark.parametrize(("text", "units", "rows"), [
    ("time,q\n0.0,-1.5707963267948966\n1,2\n", [], 2),  # a first row of numbers is no row of units
    ("time,q\nnan,nan\n1,2\n", [], 2),
    ("time,q\ns,1\n0,2\n", ["s", "1"], 1),  # 1 is the unit of a ratio
    ("time,q\ns,\n0,2\n", ["s", ""], 1),
    ("time,q\ns,rad\n", ["s", "rad"], 0),
    ("what,q\nrun 1,1\nrun 2,2\n", [], 2),  # a column of texts is no row of units
    ("what,q\nrun 1,x\nrun 2,y\n", [], 2),
    ("T,R\n°C,Ohm\n20,1.5\n", ["°C", "Ohm"], 1),
    ("\n\ntime,q\n\n0,1\n,\n1,2\n\n", [], 2),
    ("", [], 0),
])  # fmt: skip
def test_a_row_of_units_is_distinguished_from_a_row_of_numbers(text, units, rows):
    file = CsvFile(io.StringIO(text, newline=""))
    assert (file.unit_row, len([*file])) == (units, rows)


def test_headings_have_units_in_brackets_behind_a_blank():
    for heading, parts in {
        "q[1]": ("q[1]", ""), "q[1] [deg]": ("q[1]", "deg"), " x (N.m) ": ("x", "N.m"), "x []": ("x []", ""),
        "a b": ("a b", ""), "x [m/s [2]]": ("x", "m/s [2]"), "[s]": ("[s]", ""), "x [m": ("x [m", ""), "": ("", ""),
    }.items():  # fmt: skip
        assert split_unit(heading) == parts


def test_faults_have_the_line_and_texts_are_nan_on_request(tmp_path):
    (tmp_path / "r.csv").write_text("time,q,what\n0,1,2\n\n1,fast,3\n2,5\n3,4,5\n")
    columns = read_columns(tmp_path / "r.csv")
    assert columns.faults == ["row 5: expected 3 cells, got 2", "row 4: q: expected a number, got 'fast'"]
    np.testing.assert_array_equal(columns.values, [[0, 1, 2], [3, 4, 5]])
    assert columns.lines.tolist() == [2, 6]
    with csv_file.open_csv(tmp_path / "r.csv") as file:
        columns = csv_file.columns_of(file, texts=True)
    np.testing.assert_array_equal(columns.values[:, 1], [1, np.nan, 4])
    (tmp_path / "r.csv").write_text("time,q\n" + "1,x\n" * 100)
    assert read_columns(tmp_path / "r.csv").faults[8:] == ["92 more rows like these"]


@pytest.mark.parametrize(("content", "why"), [
    (b"time,q\n0,\xff\n", "can't decode byte 0xff"), (b'time,q\n0,"1\n', "unexpected end of data"),
    (b"time,q\n" + b"0" * 200_000 + b",1\n", "field larger than field limit"),
])  # fmt: skip
def test_what_is_no_csv_is_refused(tmp_path, content, why):
    (tmp_path / "r.csv").write_bytes(content)
    with pytest.raises(UsageError, match=f"r.csv: expected a CSV file in UTF-8, but it cannot be read: .*{why}"):
        read_columns(tmp_path / "r.csv")


def test_the_work_is_linear_in_columns_and_in_blanks(tmp_path):
    """Counted by calls of Python: 64 times the columns take 64 times the calls, not 4096 times."""

    def calls(columns):
        names = [f"x{k}" for k in range(columns)]
        text = ",".join(names) + "\n" + ",".join("1.5" for _ in names) + "\n"
        number = 0

        def count(*_):
            nonlocal number
            number += 1

        sys.setprofile(count)
        try:
            file = CsvFile(io.StringIO(text, newline=""))
            assert not repeated(file.names)
            assert sum(len(values) for _, values in file.blocks([])) == 1
        finally:
            sys.setprofile(None)
        return number

    assert calls(6400) < 1.1 * 64 * calls(100)
    assert split_unit("x" + " " * 1_000_000 + "[")[1] == ""  # a pattern that tries each blank takes hours
