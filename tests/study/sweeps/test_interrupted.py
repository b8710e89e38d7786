"""Studies that are killed, stopped, begun twice, or whose files are damaged: nothing is lost, or occurs twice."""

import os
import re
import signal
import subprocess
import sys
import tempfile
import threading
import time
from contextlib import suppress
from pathlib import Path

import pyarrow.parquet
import pytest

import vdfmu
from tests.study.sweeps.conftest import study, table
from vdfmu.base.errors import UsageError, VdfmuError
from vdfmu.study.sweeps import ledger, worker
from vdfmu.study.sweeps.sweep import Sweep


@pytest.mark.heavy
def test_a_table_that_cannot_be_read_is_made_again_with_retry(wild, tmp_path, undisturbed):
    made = study(wild, tmp_path / "study")
    made.path.write_text("x")
    again = study(wild, tmp_path / "study", retry=True)
    assert table(again) == undisturbed and "is not whole" in again.notes[0]


SCRIPT = """
import sys
import numpy as np
import vdfmu
vdfmu.sweep(sys.argv[1], {"unit.at": np.linspace(0.0, 1.0, 40)}, out=sys.argv[2], workers=2, chunk=4, step=0.01,
            measure=["end=final(unit.y)", "count=integral(unit.y)"])
"""


def begin(wild, out) -> subprocess.Popen[bytes]:
    return subprocess.Popen(
        [sys.executable, "-c", SCRIPT, str(wild), str(out)], stderr=subprocess.DEVNULL, start_new_session=True
    )


def parts(out: Path) -> list[Path]:
    return sorted((out / "parts").glob("part_*.parquet"))


def lasting(wild, out, undisturbed, kill, moments):
    """End the study at moments, each as many parts later, then let it go on, and compare."""
    for moment in moments:
        process = begin(wild, out)
        end = time.monotonic() + 60
        while process.poll() is None and len(parts(out)) < moment and time.monotonic() < end:
            time.sleep(0.002)
        kill(process)
        process.wait(60)
        points = [p for file in parts(out) for p in pyarrow.parquet.read_table(file)["point"].to_pylist()]
        assert len(points) == len(set(points))
    assert table(study(wild, out)) == undisturbed
    assert not parts(out)


def kill(process):
    with suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)


def press(process):
    with suppress(ProcessLookupError):
        os.kill(process.pid, signal.SIGINT)


@pytest.mark.heavy
@pytest.mark.parametrize(("end", "moments"), [(kill, (1, 3, 6)), (press, (1, 4))], ids=["SIGKILL", "Ctrl-C"])
def test_a_study_that_is_ended_goes_on_where_it_was(wild, tmp_path, undisturbed, end, moments):
    lasting(wild, tmp_path / "study", undisturbed, end, moments)


@pytest.mark.heavy
@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="needs /proc of Linux")
def test_workers_end_with_a_killed_study(wild, tmp_path):
    process = begin(wild, tmp_path / "study")
    pids: list[int] = []
    while len(pids) < 2:
        assert process.poll() is None
        with suppress(OSError):  # a thread that has just ended
            places = Path(f"/proc/{process.pid}/task").glob("*/children")
            pids = [int(pid) for place in places for pid in place.read_text().split()]
    process.kill()
    process.wait(60)
    end = time.monotonic() + 10
    while any(Path(f"/proc/{pid}").exists() for pid in pids):
        assert time.monotonic() < end
        time.sleep(0.02)


def stopped(wild, out, monkeypatch):
    """Return the parts of a study that ends before it makes a table of them."""
    with monkeypatch.context() as patch:
        patch.setattr(ledger.Ledger, "finish", lambda self: (_ for _ in ()).throw(VdfmuError("stop")))
        with pytest.raises(VdfmuError, match="stop"):
            study(wild, out)
    return parts(out)


@pytest.mark.heavy
def test_a_byte_that_the_disk_changes_is_seen(wild, tmp_path, undisturbed, monkeypatch):
    """In the values of a measure, which Parquet alone would read as another number."""
    broken = stopped(wild, tmp_path / "study", monkeypatch)[2]
    group = pyarrow.parquet.ParquetFile(broken).metadata.row_group(0)
    columns = (group.column(i) for i in range(group.num_columns))
    column = next(each for each in columns if each.path_in_schema == "end")
    data = bytearray(broken.read_bytes())
    data[column.data_page_offset + column.total_compressed_size - 2] ^= 1
    broken.write_bytes(data)
    with pytest.raises(VdfmuError, match="is not whole.*repeat the command"):
        study(wild, tmp_path / "study")
    assert broken.with_name(f"{broken.name}.broken").read_bytes() == data
    assert table(study(wild, tmp_path / "study")) == undisturbed


@pytest.mark.heavy
def test_a_study_that_is_complete_runs_nothing(wild, tmp_path, undisturbed):
    study(wild, tmp_path / "study")
    stages = []
    made = study(wild, tmp_path / "study", progress=lambda *stage: stages.append(stage))
    assert ("points", 40, 40) in stages and ("points", 0, 40) not in stages
    assert table(made) == undisturbed


@pytest.mark.heavy
def test_another_study_does_not_take_its_folder(wild, tmp_path, undisturbed):
    study(wild, tmp_path / "study")
    with pytest.raises(UsageError, match=r"holds another study.*differ in measures\. .*--out.*--overwrite"):
        study(wild, tmp_path / "study", measure=["end=final(unit.y)"])
    with pytest.raises(UsageError, match=r"differ in units, values or files\."):
        study(wild, tmp_path / "study", step=0.02)
    assert table(Sweep(tmp_path / "study")) == undisturbed
    other = study(wild, tmp_path / "study", measure=["end=final(unit.y)"], overwrite=True)
    assert other.measures == ["end"]


@pytest.mark.heavy
def test_two_processes_do_not_share_a_study(wild, tmp_path):
    inside, outside = threading.Event(), threading.Event()

    def wait(stage, done, total):
        if stage == "points" and done and not inside.is_set():
            inside.set()
            outside.wait(60)

    worker = threading.Thread(target=lambda: study(wild, tmp_path / "study", progress=wait))
    worker.start()
    try:
        assert inside.wait(60)
        with pytest.raises(UsageError, match="another process runs this study"):
            study(wild, tmp_path / "study")
    finally:
        outside.set()
        worker.join()
    assert len(Sweep(tmp_path / "study")) == 40


def killing(results, times, place):
    """Kill the process, as the system does for want of memory, a number of times."""
    with Path(place).open("a+") as file:
        file.seek(0)
        if len(file.read()) < times:
            file.write("x")
            file.flush()
            os.kill(os.getpid(), signal.SIGKILL)
    return 1.0


@pytest.mark.heavy
@pytest.mark.parametrize("times", [2, 3])
def test_a_point_whose_process_is_killed_is_tried_again_and_blames_no_model(wild, tmp_path, monkeypatch, times):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "tmp"))
    (tmp_path / "tmp").mkdir()
    place = tmp_path / "killed"

    def measure(results, times=times, place=str(place)):
        return killing(results, times, place)

    def sweep():
        return vdfmu.sweep(
            wild, {"unit.at": [0.0, 1.0]}, measure={"m": measure}, step=0.5, out=tmp_path / "study", workers=1
        )

    swept = sweep()
    if times == 2:
        assert swept.failed == {}
    else:
        assert re.search(r"the process was killed \(SIGKILL\) 3 times: memory may be short", swept.failed[0])
        assert sweep().failed == {}  # without being asked to
    assert len(place.read_text()) == times
    assert list((tmp_path / "tmp").iterdir()) == []


ROW = {"point": 0, "failed": None, "failed_at": None, "wall_s": 0.1}


@pytest.mark.parametrize(
    "message",
    [[], [1], [{}], *([ROW | change] for change in ({"point": 1}, {"failed": 7}, {"m": "text"}, {"m": [{}]}))],
)
def test_what_a_component_writes_for_the_worker_is_refused(message):
    assert worker._rows(message, [0]) == "a component wrote to the worker's pipe"
