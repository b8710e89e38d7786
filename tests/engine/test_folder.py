"""The folder of results: runs that go into one at once do not mix."""

from __future__ import annotations

import os
import subprocess
import sys
import threading

import pytest

from vdfmu.engine.results.folder import replacing_results, write_summary

OUTPUTS = ("results.csv", "figure.png", "summary.json")


def write(folder, text, files=("results.csv",)):
    for name in files:
        (folder / name).write_text(text)
    write_summary({"text": text}, folder)


def test_two_runs_of_a_process_into_one_folder_keep_apart(tmp_path):
    """The second ends within the first, whose files then take the place of all of its."""
    with replacing_results(tmp_path, OUTPUTS, False) as first:
        write(first, "first")
        with replacing_results(tmp_path, OUTPUTS, False) as second:
            assert first != second and (first / "results.csv").read_text() == "first"
            write(second, "second", OUTPUTS[:2])
        assert (tmp_path / "figure.png").read_text() == "second"
    assert (tmp_path / "results.csv").read_text() == "first"
    assert sorted(p.name for p in tmp_path.iterdir()) == ["results.csv", "summary.json"]


def test_what_a_killed_run_of_this_number_left_is_not_kept(tmp_path):
    left = tmp_path / f"partial_{os.getpid()}"
    left.mkdir()
    (left / "figure.png").write_text("old")
    with replacing_results(tmp_path, OUTPUTS, False) as partial:
        assert partial.samefile(left) and not (partial / "figure.png").exists()
        write(partial, "new")
    assert not left.exists()


@pytest.mark.skipif(os.name != "posix", reason="locks of folders are those of POSIX")
def test_a_run_waits_until_another_process_has_its_files_in_place(tmp_path):
    code = (
        "import fcntl, os, sys\nhandle = os.open(sys.argv[1], os.O_RDONLY)\nfcntl.flock(handle, fcntl.LOCK_EX)\n"
        "print('has it', flush=True)\nsys.stdin.read()\n"
    )
    other = subprocess.Popen([sys.executable, "-c", code, tmp_path], stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    done = threading.Event()

    def run():
        with replacing_results(tmp_path, OUTPUTS, False) as partial:
            write(partial, "mine")
        done.set()

    assert other.stdout.readline() == b"has it\n"
    thread = threading.Thread(target=run)
    thread.start()
    assert not done.wait(0.3)
    assert not (tmp_path / "results.csv").exists()
    other.stdin.close()
    assert done.wait(30.0)
    thread.join()
    other.wait()
    assert (tmp_path / "results.csv").read_text() == "mine"
