"""The folder of results: runs that go into one at once do not mix."""

import os
import subprocess
import sys
import threading

import pytest

from tests.conftest import heavy
from vdfmu.engine.results.folder import replacing_results, write_summary

OUTPUTS = ("results.csv", "figure.png", "summary.json")


def write(folder, text, files=("results.csv",)):
    for name in files:
        (folder / name).write_text(text)
    write_summary({"text": text}, folder)


def test_two_runs_of_a_process_into_one_folder_keep_apart_and_what_a_killed_one_left_is_not_kept(tmp_path):
    """The second ends within the first, whose files then take the place of all of its."""
    with replacing_results(tmp_path, OUTPUTS, False) as first:
        write(first, "first")
        with replacing_results(tmp_path, OUTPUTS, False) as second:
            assert first != second and (first / "results.csv").read_text() == "first"
            write(second, "second", OUTPUTS[:2])
        assert (tmp_path / "figure.png").read_text() == "second"
    assert (tmp_path / "results.csv").read_text() == "first"
    assert sorted(p.name for p in tmp_path.iterdir()) == ["results.csv", "summary.json"]
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


RUN = """
import sys
from pathlib import Path
from vdfmu.engine.results.folder import replacing_results
with replacing_results(Path(sys.argv[1]), ("results.csv", "summary.json"), False) as partial:
    (partial / "results.csv").write_text("time\\ns\\n0\\n")
    for name in sys.argv[2:]:
        (partial / name).write_text("")
    print(partial.name, flush=True)
    sys.stdin.read()
"""


@pytest.fixture
def running(tmp_path):
    """Return what starts a run of another process, which waits after its first rows, and its folder of rows."""
    processes = []

    def start(*names):
        words = [sys.executable, "-c", RUN, tmp_path, *names]
        process = subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        processes.append(process)
        return process, tmp_path / process.stdout.readline().strip()

    yield start
    for process in processes:
        process.kill()
        process.communicate()


@pytest.mark.skipif(os.name != "posix", reason="locks of folders are those of POSIX")
def test_what_a_killed_run_left_is_removed_by_the_next_and_that_of_a_living_one_is_kept(tmp_path, running):
    (killed, orphan), (living, rows) = running("0123456789abcdef.tmp"), running()
    killed.kill()
    killed.wait()
    notes = tmp_path / "partial_1_notes"
    notes.mkdir()
    assert orphan.exists() and rows.exists()
    with replacing_results(tmp_path, OUTPUTS, False) as partial:
        write(partial, "mine")
    assert not orphan.exists()
    assert (rows / "results.csv").exists() and notes.exists()
    assert living.poll() is None


@pytest.mark.few(1)
@pytest.mark.skipif(os.name != "posix", reason="locks of folders are those of POSIX")
@pytest.mark.parametrize("name", ["notes.txt", *heavy("before")])
def test_what_no_run_wrote_or_an_earlier_one_is_not_removed(tmp_path, running, name):
    """Of a run that is killed while it takes its place, ``before`` has the files of the earlier one."""
    killed, orphan = running(name)
    killed.kill()
    killed.wait()
    with replacing_results(tmp_path, OUTPUTS, False) as partial:
        write(partial, "mine")
    assert sorted(path.name for path in orphan.iterdir()) == sorted(["results.csv", name])
