"""The folder of packages and results for users of other tools, and its script, in a Python with nothing else."""

import csv
import subprocess
import sys

import pytest

from tests.conftest import ran
from vdfmu.engine.run import simulate


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("reference") / "made"
    ran("ssp", "planar_tracking", "--reference", "--out", folder)
    return folder


def compare(folder, mine, *options, table="planar_tracking_jacobi.csv"):
    command = [sys.executable, "-I", "-S", folder / "compare.py", mine, folder / table, *options]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    return done.returncode, done.stdout + done.stderr


def rows_of(folder):
    with open(folder / "planar_tracking_jacobi.csv", newline="") as file:
        return list(csv.reader(file))


def written(path, rows, delimiter=","):
    with open(path, "w", newline="") as file:
        csv.writer(file, delimiter=delimiter).writerows(rows)
    return path


@pytest.mark.heavy
def test_the_folder_stands_alone(folder):
    names = {path.name for path in folder.iterdir()}
    assert names == {
        "planar_tracking.ssp", "planar_tracking_2.0.ssp", "planar_tracking_jacobi.csv",
        "planar_tracking_gauss-seidel.csv", "README.md", "compare.py",
    }  # fmt: skip
    text = (folder / "README.md").read_text()
    assert "{" not in text
    assert "planar_tracking_2.0.ssp" in text
    assert "step 0.001 s" in text


@pytest.mark.heavy
@pytest.mark.parametrize("package", ["planar_tracking.ssp", "planar_tracking_2.0.ssp"])
def test_a_run_of_either_package_agrees(folder, tmp_path, package):
    for algorithm in ("jacobi", "gauss-seidel"):
        simulate(folder / package, algorithm=algorithm).write(tmp_path / "mine.csv")
        code, said = compare(folder, tmp_path / "mine.csv", table=f"planar_tracking_{algorithm}.csv")
        assert code == 0, said
        assert "45 of 45 signals agree, 1001 rows; largest error 0," in said


@pytest.mark.heavy
def test_results_that_are_a_row_late_differ_and_names_of_other_tools_are_understood(folder, tmp_path):
    rows = rows_of(folder)
    late = [*rows[:3], *([now[0], *before[1:]] for before, now in zip(rows[2:], rows[3:], strict=False))]
    assert compare(folder, written(tmp_path / "late.csv", late))[0] == 1
    assert compare(folder, folder / "planar_tracking_gauss-seidel.csv")[0] == 1
    head = ["Time [s]", *(f"root::{name.replace('.', '::', 1)} [rad]" for name in rows[0][1:])]
    code, said = compare(folder, written(tmp_path / "mine.csv", [head, *rows[2:]], ";"))
    assert code == 0, said
    # every other row is read on a line: off by h^2 / 8 q'' = 2e-5 for h = 4 ms and some 10 rad/s^2
    _, said = compare(folder, written(tmp_path / "half.csv", [head, *rows[2::2]], ";"), "--tolerance", "1e-4")
    assert "plant.q[" not in said
    assert "no number" not in said


@pytest.mark.heavy
def test_what_is_missing_ends_early_or_cannot_be_read_counts(folder, tmp_path):
    rows = [[row[0], *row[2:]] for row in rows_of(folder)]
    mine = written(tmp_path / "mine.csv", rows)
    code, said = compare(folder, mine)
    assert (code, "not in" in said) == (1, True)
    assert compare(folder, mine, "--partial")[0] == 0
    code, said = compare(folder, written(tmp_path / "short.csv", rows_of(folder)[:-10]))
    assert code == 1
    assert "got no number" in said
    for text in ("", "a,b\n1,2\n", "time,a\n", "time,a\n1\n"):
        (tmp_path / "mine.csv").write_text(text)
        code, said = compare(folder, tmp_path / "mine.csv")
        assert (code, "cannot be read" in said) == (2, True)
    assert compare(folder, tmp_path / "none.csv")[0] == 2
