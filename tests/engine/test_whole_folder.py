"""The folder of results: whole, old or new, wherever the disk fails."""

import errno
import json
import os
import sys

import pytest

from tests.power import Power
from vdfmu.base.errors import UsageError, VdfmuError
from vdfmu.base.files import temporary_folder, write_whole
from vdfmu.engine.results.folder import SYSTEM_OUTPUTS, replacing_results

FILES = ("results.csv", "summary.json")


def write(folder, text):
    with replacing_results(folder, SYSTEM_OUTPUTS, overwrite=False) as partial:
        (partial / "results.csv").write_text(f"time\ns\n{text}\n")
        (partial / "summary.json").write_text(json.dumps({"files": FILES, "text": text}))


def content(folder):
    return {path.name: path.read_text() for path in folder.iterdir() if path.is_file()}


@pytest.mark.parametrize("number", [1, 2, 3, 4])
def test_a_run_that_cannot_take_its_place_leaves_the_earlier_one(tmp_path, monkeypatch, number):
    """The four moves of two files, old and new: each fails once."""
    write(tmp_path, "old")
    before, replace, moves = content(tmp_path), os.replace, []

    def failing(source, target):
        moves.append(source)
        if len(moves) == number:
            raise OSError(errno.ENOSPC, "No space left on device")
        replace(source, target)

    with monkeypatch.context() as patch:
        patch.setattr(os, "replace", failing)
        with pytest.raises(VdfmuError, match="cannot be written: .*No space left") as error:
            write(tmp_path, "new")
    assert content(tmp_path) == before
    assert "new" in (tmp_path / "partial" / "results.csv").read_text()
    assert str(tmp_path / "partial") in error.value.__notes__[0]
    write(tmp_path, "newer")
    assert "newer" in content(tmp_path)["results.csv"]
    assert [path.name for path in tmp_path.iterdir() if path.is_dir()] == ["partial"]


def test_a_folder_of_the_name_of_a_result_is_refused_and_a_passing_error_leaves_none(tmp_path, monkeypatch):
    write(tmp_path, "old")
    (tmp_path / "results.csv").unlink()
    (tmp_path / "results.csv").mkdir()
    with pytest.raises(UsageError, match=r"results\.csv must be files, got folders"):
        write(tmp_path, "new")
    place = tmp_path / "temporary"
    place.mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(place))
    rmdir, failed = os.rmdir, []

    def failing(*arguments, **options):
        if not failed:
            failed.append(arguments)
            raise OSError(errno.EIO, "Input/output error")
        rmdir(*arguments, **options)

    monkeypatch.setattr(os, "rmdir", failing)
    with temporary_folder("vdfmu_") as folder:
        os.mkdir(os.path.join(folder, "inside"))
    assert failed and list(place.iterdir()) == []


@pytest.mark.skipif(sys.platform != "linux", reason="reads the names of open files from /proc")
def test_after_a_power_failure_each_result_is_whole_and_a_finished_run_is_there(tmp_path, monkeypatch):
    root = tmp_path / "disk"
    root.mkdir()
    with monkeypatch.context() as patch:
        power = Power(root, patch)
        for text in ("old", "new"):
            with replacing_results(root / "results" / "run", SYSTEM_OUTPUTS, overwrite=False) as partial:
                write_whole(partial / "results.csv", [f"time\ns\n{text}\n".encode()])
                write_whole(partial / "summary.json", [json.dumps({"files": FILES, "text": text}).encode()])
            power.done(text)
    for promised, folder in power.states(tmp_path):
        there = content(folder / "results" / "run") if (folder / "results" / "run").is_dir() else {}
        assert all("old" in text or "new" in text for text in there.values())
        if "new" in promised:
            assert {*there} == {*FILES} and all("new" in text for text in there.values())
