"""Results in Parquet: the bits of the CSV, units and provenance in the file, and what is said when it cannot be."""

import csv
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet
import pytest

import vdfmu
from tests.engine.files import assert_same_bits, hollow_results
from vdfmu.base.errors import CosimError, UsageError
from vdfmu.engine.package_run import run_system
from vdfmu.engine.results.formats import FORMATS
from vdfmu.engine.run import Results


def test_numbers_of_all_kinds_read_back_to_the_same_bits(results, tmp_path, monkeypatch):
    monkeypatch.setattr("vdfmu.engine.results.parquet._GROUP", 400)
    for name in (f"r{suffix}" for suffix in FORMATS):
        path = tmp_path / name
        results.write(path)
        again, text = Results.read(path), path.read_bytes()
        assert_same_bits(again, results)
        assert again.summary == ({} if name == "r.csv" else {**results.summary, "limit": "inf"})
        results.write(path)
        assert path.read_bytes() == text
    assert pa.parquet.ParquetFile(tmp_path / "r.parquet").num_row_groups == 4


@pytest.mark.parametrize("form", ["csv", "parquet"])
def test_results_without_rows_or_signals_read_back(tmp_path, form):
    for some in hollow_results():
        some.write(tmp_path / f"r.{form}")
        assert_same_bits(Results.read(tmp_path / f"r.{form}"), some)


def test_a_run_writes_all_forms_alike_and_says_in_parquet_what_it_was(package, tmp_path):
    options = {"stop": 0.05, "parameters": {"controller.K_p": 900.0}}
    run = run_system(package, out=tmp_path, formats=("parquet", "csv"), **options)
    for form in ("parquet", "csv"):
        assert_same_bits(Results.read(tmp_path / f"results.{form}"), run)
    schema = pa.parquet.read_schema(tmp_path / "results.parquet")
    units = [schema.field(name).metadata[b"unit"].decode() for name in schema.names]
    with open(tmp_path / "results.csv", encoding="utf-8", newline="") as file:
        rows = csv.reader(file)
        assert (schema.names, units) == (next(rows), next(rows))
    facts = json.loads(schema.metadata[b"vdfmu"])
    assert facts["vdfmu"] == vdfmu.__version__ and facts["package"] == str(package)
    assert facts["parameters"] == {"controller.K_p": "900.0"}
    assert "controller.q" in facts["held"]
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert {key: summary[key] for key in facts} == facts
    assert {"results.csv", "results.parquet"} < set(summary["files"])


def test_a_run_that_fails_leaves_its_rows_in_parquet(tmp_path):
    # a proportional gain of 1e9 drives the arm beyond what any solver step can follow
    with pytest.raises(CosimError) as caught:
        vdfmu.run("planar_tracking", out=tmp_path, parameters={"controller.K_p": 1e9}, formats=["parquet"])
    verdict, rows = caught.value.__notes__
    assert verdict.startswith("Stability: Unstable from the start, joint")
    assert rows == f"Rows up to {caught.value.time:.9g} s are in {tmp_path / 'partial' / 'results.parquet'}."
    assert_same_bits(Results.read(tmp_path / "partial" / "results.parquet"), caught.value.results)


WITHOUT = "import sys; sys.modules['pyarrow'] = None; import vdfmu.cli; vdfmu.cli.main()"
"""A command where pyarrow cannot be imported."""


@pytest.mark.heavy
def test_without_pyarrow_the_command_ends_before_the_run_and_says_how_to_get_it(tmp_path):
    options = ["run", "planar_tracking", "--stop", "0.01", "--format", "csv,parquet", "--out", str(tmp_path / "out")]
    done = subprocess.run(
        [sys.executable, "-c", WITHOUT, *options], check=False, capture_output=True, text=True, timeout=120
    )
    said = " ".join(done.stderr.split())
    assert done.returncode == 2, said
    assert "error: Parquet needs the package pyarrow, which cannot be imported: " in said
    assert "Install it with 'pip install vdfmu[parquet]'. Runs can also write CSV" in said
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("formats", ["xls", "csv;parquet", "", "csv,"])
def test_a_format_that_there_is_not(package, formats):
    with pytest.raises(UsageError, match="format: expected csv, parquet.*, or csv,.* for all, got "):
        run_system(package, formats=formats.split(",") if formats else ())


def written(path: Path, table: pa.Table) -> None:
    pa.parquet.write_table(table, path)


@pytest.mark.parametrize(("table", "message"), [
    ({"t": [0.0]}, "expected 'time' as the first column, .*; got 't'"),
    ({"time": [0.0], "name": ["x"], "n": [2**40]}, r"got 'n', name \(string\)"),
    ({"time": [0, 1], "a": [0.5, 1.0]}, "columns of float64, int32 and bool; got 'time'"),
])  # fmt: skip
def test_parquet_of_another_form(tmp_path, table, message):
    written(tmp_path / "r.parquet", pa.table(table))
    with pytest.raises(UsageError, match=message):
        Results.read(tmp_path / "r.parquet")


def test_parquet_of_another_tool_is_read_and_a_file_that_is_none_refused(tmp_path):
    (tmp_path / "r.parquet").write_text("time,a\n")
    with pytest.raises(UsageError, match=r"r\.parquet: expected a Parquet file, got unreadable content: "):
        Results.read(tmp_path / "r.parquet")
    with pytest.raises(UsageError, match="cannot read .*none.parquet: No such file"):
        Results.read(tmp_path / "none.parquet")
    table = pa.table({"time": [0.0, 1.0], "a": [0.5, None], "on": [True, False]})
    written(tmp_path / "r.parquet", table.replace_schema_metadata({"vdfmu": "{"}))
    results = Results.read(tmp_path / "r.parquet")
    assert (results.kinds, results.units) == ({"a": "real", "on": "boolean"}, {"a": "", "on": ""})
    np.testing.assert_array_equal(results["on"], [True, False])
    np.testing.assert_array_equal(results["a"], [0.5, np.nan])
    assert results.summary == {}
