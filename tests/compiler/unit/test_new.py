"""``vdfmu unit new``: the file builds and its own test passes; ``vdfmu unit examples``: the examples are there."""

import errno
import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.compiler.unit.conftest import command
from vdfmu.base.errors import StorageError, UsageError
from vdfmu.compiler.unit.new import copy_examples, new_unit
from vdfmu.system.scenario import load_scenario


@pytest.mark.heavy
@pytest.mark.parametrize(("name", "stem", "model"), [("MyFilter2", "my_filter2", "MyFilter2"),
                                                     ("joint_pi", "joint_pi", "JointPi")])  # fmt: skip
def test_a_new_unit_builds_and_passes_its_own_test(tmp_path, monkeypatch, name, stem, model):
    monkeypatch.chdir(tmp_path)
    done = command("unit", "new", name)
    assert done.exit_code == 0, done.output
    assert sorted(path.name for path in tmp_path.iterdir()) == [f"{stem}.py", f"test_{stem}.py"]
    built = command("build", f"{stem}.py", "--fmi", "3.0")
    assert built.exit_code == 0 and (tmp_path / "fmus" / f"{model}.fmu").is_file(), built.output
    tested = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", f"test_{stem}.py"],
        capture_output=True, text=True, check=False, timeout=300,
    )  # fmt: skip
    assert tested.returncode == 0 and "2 passed" in tested.stdout, tested.stdout + tested.stderr


def test_out_names_the_file(tmp_path):
    path, test = new_unit("my_filter", tmp_path / "deep" / "other.py")
    assert "class MyFilter(Unit)" in path.read_text()
    assert test.name == "test_other.py" and "from other import MyFilter" in test.read_text()


@pytest.mark.parametrize("there", ["my_filter.py", "test_my_filter.py"])
def test_a_file_that_is_there_is_not_replaced(tmp_path, there):
    (tmp_path / there).write_text("mine")
    with pytest.raises(UsageError, match=f"{there} exists and is not replaced"):
        new_unit("MyFilter", tmp_path / "my_filter.py")
    assert [path.name for path in tmp_path.iterdir()] == [there]
    assert (tmp_path / there).read_text() == "mine"


REFUSED = {
    "expected CamelCase or snake_case": ["my-filter", "2nd", "my_Filter", "Größe"],
    "State is a name that units import from vdfmu.unit": ["state"],
    "random is a name of Python's own": ["Random"],
    "lambda is a name of Python's own": ["lambda"],
    "expected a Python file": ["MyFilter --out my_filter.txt", "MyFilter --out my-filter.py"],
}


@pytest.mark.parametrize("match", REFUSED)
def test_a_name_that_cannot_be_one_is_refused(tmp_path, monkeypatch, match):
    monkeypatch.chdir(tmp_path)
    for words in REFUSED[match]:
        done = command("unit", "new", *words.split())
        assert isinstance(done.exception, UsageError) and match in str(done.exception)
    assert not list(tmp_path.iterdir())


def test_the_examples_are_written_and_load(tmp_path, monkeypatch):
    pytest.importorskip("vdfmu.extras.laws")  # their controller is a law of it
    pytest.importorskip("vdfmu.extras.laws")  # of which their controller is one
    monkeypatch.chdir(tmp_path)
    done = command("unit", "examples", "mine")
    assert done.exit_code == 0 and "vdfmu run mine" in done.output, done.output
    files = {file.name for file in Path("mine").iterdir()}
    parts = load_scenario("mine/scenario.toml").system.parts.values()
    assert {part.unit.name for part in parts if isinstance(part.unit, Path)} <= files
    assert {"encoder.py", "friction_torque.py", "waypoints.csv"} <= files
    Path("mine/wall.py").write_text("mine")
    with pytest.raises(UsageError, match="exist and are not replaced"):
        copy_examples(Path("mine"))
    assert Path("mine/wall.py").read_text() == "mine"


@pytest.mark.parametrize("number", [1, 2])
def test_files_that_cannot_both_be_written_are_both_not_there(tmp_path, monkeypatch, number):
    """Else the same command would refuse the one that is there."""
    replace, moves = os.replace, []

    def failing(source, target):
        moves.append(source)
        if len(moves) == number:
            raise OSError(errno.EIO, "Input/output error")
        replace(source, target)

    with monkeypatch.context() as patch:
        patch.setattr(os, "replace", failing)
        with pytest.raises(StorageError, match="Input/output error"):
            new_unit("my_filter", tmp_path / "my_filter.py")
    assert list(tmp_path.iterdir()) == []
    new_unit("my_filter", tmp_path / "my_filter.py")
