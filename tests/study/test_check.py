"""The check of a file: what it says, and that a unit that crashes or hangs does not take it along."""

import os
import subprocess
import sys
import zipfile

import pytest

from vdfmu.errors import UsageError
from vdfmu.fmu import build_fmus
from vdfmu.model import load_robot
from vdfmu.study import check
from vdfmu.study.check import check_fmu


@pytest.fixture(scope="module")
def fmus(tmp_path_factory):
    return build_fmus(load_robot("planar_2dof"), tmp_path_factory.mktemp("fmus"), backend="python")


@pytest.fixture
def changed(fmus, tmp_path):
    """Copy an FMU without the files whose name starts with `left_out`, with other texts in place of some."""

    def change(left_out, texts=None):
        path = tmp_path / "Plant.fmu"
        with zipfile.ZipFile(fmus["plant"]) as source, zipfile.ZipFile(path, "w") as target:
            for name in source.namelist():
                if not name.startswith(left_out):
                    target.writestr(name, (texts or {}).get(name, source.read(name)))
        return path

    return change


SCRIPT = "resources/vdfmu_plant_slave.py"


def test_a_good_fmu_has_no_problems(fmus):
    for path in fmus.values():
        assert check_fmu(path) == []


def test_what_the_process_leaves_is_removed(fmus, tmp_path, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    assert check_fmu(fmus["plant"]) == []
    assert list(tmp_path.iterdir()) == []


def test_a_unit_without_its_script_is_a_problem_and_not_a_crash(changed, tmp_path):
    path = changed(SCRIPT)
    (problem,) = check_fmu(path)
    assert "10 steps" in problem
    done = subprocess.run(
        [sys.executable, "-m", "vdfmu.cli", "check", str(path)],
        cwd=tmp_path, capture_output=True, text=True, timeout=120, check=False,
    )  # fmt: skip
    assert done.returncode == 1, done.stderr
    assert "1 problem(s)" in done.stdout
    assert check_fmu(path, run=False) == []


@pytest.mark.skipif(os.name != "posix", reason="signals")
def test_a_unit_that_ends_its_process_is_reported_with_the_signal(changed):
    path = changed("none", {SCRIPT: "import os, signal\nos.kill(os.getpid(), signal.SIGSEGV)\n"})
    (problem,) = check_fmu(path)
    assert problem.startswith("the process crashed (signal 11) in a run of 10 steps")


def test_a_unit_that_ends_its_process_without_an_error_is_reported(changed):
    path = changed("none", {SCRIPT: "import os\nos._exit(0)\n"})
    assert check_fmu(path) == ["the unit ended the process in a run of 10 steps"]


def test_a_unit_that_never_ends_is_stopped(changed, monkeypatch):
    monkeypatch.setattr(check, "_SECONDS", 3.0)
    path = changed("none", {SCRIPT: "import time\ntime.sleep(1000)\n"})
    assert check_fmu(path) == ["10 steps did not end within 3 s"]


def test_a_binary_for_another_platform_only_is_named(fmus, tmp_path):
    path = tmp_path / "Plant.fmu"
    with zipfile.ZipFile(fmus["plant"]) as source, zipfile.ZipFile(path, "w") as target:
        for name in source.namelist():
            if not name.startswith("binaries/"):
                target.writestr(name, source.read(name))
        target.writestr("binaries/plan9/Plant.so", b"")
    (problem,) = check_fmu(path)
    assert problem.startswith("no binary for this platform")


def test_a_missing_file_is_a_wrong_option(tmp_path):
    with pytest.raises(UsageError, match="there is no such file"):
        check_fmu(tmp_path / "missing.fmu")
