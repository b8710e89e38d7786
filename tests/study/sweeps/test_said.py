"""What a study says of files that are none of its, and of points that all fail."""

import sys
from functools import partial
from pathlib import Path

import pyarrow
import pytest
from pyarrow import parquet

import vdfmu
from tests.conftest import invoked, ran, refused
from tests.engine.reference import models
from tests.study.sweeps.conftest import study_of
from vdfmu.base.errors import SspError, UsageError
from vdfmu.study.sweeps.candidates import judge_point
from vdfmu.study.sweeps.sweep import Sweep


def test_faults_of_a_package_name_the_file_of_the_user(tmp_path):
    (tmp_path / "mine.ssp").write_text("no zip file")
    with pytest.raises(SspError, match=r"^mine\.ssp: "):
        vdfmu.sweep(tmp_path / "mine.ssp", {"unit.at": [1.0]}, out=tmp_path / "study")


def test_a_table_of_others_is_no_study(tmp_path):
    file = tmp_path / "sweep.parquet"
    parquet.write_table(pyarrow.table({"point": [0]}), file)
    said = refused("sweep", "report", file)
    assert "sweep.parquet has no facts of a study, so no study of vdfmu wrote it." in said


@pytest.mark.heavy
def test_a_study_of_joined_fmus_keeps_their_package(tmp_path):
    lag = models.build(models.LAG, "2.0", tmp_path)
    axis = ("--vary", "a.u=1, 3", "--measure", "end=final(b.x)", "--stop", "1", "--step", "0.1")
    done = invoked("sweep", f"a={lag}", f"b={lag}", "--connect", "a.x=b.u", *axis, "--out", tmp_path / "study")
    assert done.exit_code == 0, done.output
    low, high = Sweep(tmp_path / "study")["end"]
    # linear in u: the bits differ by the rounding of three times each number
    assert high == pytest.approx(3.0 * low, rel=1e-12)
    package = tmp_path / "study" / "system.ssp"
    assert vdfmu.load(package).run(stop=1.0, step=0.1, parameters={"a.u": 3.0})["b.x"][-1] == high
    assert f"Use 'vdfmu run {package}' and set a.u=3." in refused("run", "--from", tmp_path / "study", "--row", "1")
    assert f"must be NAME=FILE if there are several. Write {lag.stem}={lag}." in refused("sweep", lag, lag, *axis)


def test_a_study_without_pyarrow_is_csv(tmp_path, monkeypatch):
    """It is resumed, read, shown and compared with the table in Parquet of the same study."""
    lag = models.build(models.LAG, "2.0", tmp_path)
    words = ["sweep", lag, "--vary", f"{lag.stem}.x=0.1, 2, 3", "--vary", "algorithm=jacobi, gauss-seidel"]
    words += ["--measure", f"end=final({lag.stem}.x)", "--record", "*.x", "--stop", "1", "--step", "0.25"]
    ran(*words, "--out", tmp_path / "parquet")
    for module in ("pyarrow", "pyarrow.parquet"):
        monkeypatch.setitem(sys.modules, module, None)
    done = ran(*words, "--out", tmp_path / "csv")
    assert "note: The table is CSV, because pyarrow is not installed" in done.output
    assert "sweep.csv, report.html; 6 points" in done.output
    plain = Sweep(tmp_path / "csv" / "sweep.csv").table().to_pylist()
    (tmp_path / "csv" / "sweep.csv").write_text("point,failed\n0,\n1")  # cut off by a full disk
    again = ran(*words, "--out", tmp_path / "csv")
    assert "sweep.csv: is not whole: " in again.output.replace("\n", " ")
    repeated = Sweep(tmp_path / "csv").table().to_pylist()
    ran("sweep", "report", tmp_path / "csv", "--out", tmp_path / "page.html")
    with pytest.raises(UsageError, match="Parquet needs the package pyarrow"):
        Sweep(tmp_path / "parquet")
    monkeypatch.undo()
    columns = Sweep(tmp_path / "parquet").table()
    expected = columns.to_pylist()
    assert Sweep(tmp_path / "csv").columns == columns.column_names
    for rows in (plain, repeated):
        for row, same in zip(rows, expected, strict=True):
            assert row | {"wall_s": 0.0} == same | {"wall_s": 0.0}


@pytest.mark.parametrize(("fail", "code"), [((0, 1, 2), 1), ((0, 1), 0)])
def test_the_exit_code_of_a_study_is_1_if_all_points_fail(tmp_path, monkeypatch, fail, code):
    swept = study_of(tmp_path, ["f.x=1, 2, 3"], lambda x: x, fail=fail)
    monkeypatch.setattr("vdfmu.study.sweeps.sweep.sweep", lambda *_, **__: swept)
    done = invoked("sweep", "run", "f.ssp")
    assert done.exit_code == code
    assert "report.html" in done.output


def test_a_study_that_is_the_same_is_neither_judged_nor_written_again(tmp_path, monkeypatch):
    scenario, folder = tmp_path / "mine.toml", tmp_path / "study"
    shipped = Path(vdfmu.__file__).parents[1] / "models" / "scenarios" / "planar_tracking.toml"
    scenario.write_text(shipped.read_text())
    words = ["sweep", scenario, "--vary", "controller.K_p=*0.9, 1", "--stop", "0.05", "--out", folder]
    words += ["--measure", "error=rms(trajectory.q_d - plant.q)"]
    judged = []
    monkeypatch.setattr("vdfmu.study.sweeps.candidates.judge_point", partial(_counted, judged, judge_point))
    lines = ran(*words).output.splitlines()
    page, count = folder / "report.html", len(judged)
    content, written = page.read_bytes(), page.stat().st_mtime_ns
    assert count and lines[-1].startswith("Written to")
    again = ran(*words).output.splitlines()
    assert again[:-1] == lines[:-1]
    assert again[-1] == f"Nothing has changed in {folder}: sweep.parquet, report.html; 2 points"
    assert len(judged) == count and page.stat().st_mtime_ns == written

    page.write_bytes(content[:-1])  # no longer the page of the study
    assert ran(*words).output.splitlines()[-1].startswith("Written to") and len(judged) == count
    assert page.read_bytes().endswith(content[-1:])
    # the runs are the same, their verdicts are not
    scenario.write_text(scenario.read_text() + "\n[limits]\nmargin = 0.9\n")
    assert "Good" not in ran(*words).output.splitlines()[0]
    assert len(judged) > count and page.read_bytes() != content


def _counted(calls, function, *arguments):
    calls.append(arguments)
    return function(*arguments)
