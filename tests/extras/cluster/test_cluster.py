"""Parameter studies on a Dask scheduler and worker processes on loopback: what ends there, goes on elsewhere."""

import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import closing

import numpy as np
import pytest

import vdfmu
from tests.study.sweeps.conftest import table
from vdfmu.base.errors import VdfmuError
from vdfmu.extras.cluster import workers
from vdfmu.study.sweeps.sweep import Sweep

MEASURES = ["end=final(unit.y)"]
AXES = {"unit.at": np.linspace(0.0, 1.0, 60)}


class Cluster:
    """A scheduler and workers of Dask, each a process."""

    def __init__(self, folder) -> None:
        with closing(socket.create_server(("127.0.0.1", 0))) as place:
            self.address = f"tcp://127.0.0.1:{place.getsockname()[1]}"
        self._folder = folder
        self._begin()

    def _begin(self) -> None:
        self.scheduler = self._start("scheduler", "--port", self.address.rpartition(":")[2], "--no-dashboard")
        self.workers = [self.worker() for _ in range(2)]

    def _start(self, role: str, *words: str) -> subprocess.Popen[bytes]:
        return subprocess.Popen(
            [sys.executable, "-m", "distributed.cli.dask_" + role, *words, "--host", "127.0.0.1"],
            cwd=self._folder, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )  # fmt: skip

    def worker(self) -> subprocess.Popen[bytes]:
        """Start a worker of one thread."""
        return self._start("worker", self.address, "--nthreads", "1", "--no-nanny", "--no-dashboard")

    def restart(self) -> None:
        """End the scheduler, and its workers with it, and start all anew."""
        self.close()
        self._begin()

    def close(self) -> None:
        """End all."""
        for process in (self.scheduler, *self.workers):
            process.kill()
            process.wait()


@pytest.fixture
def dask(tmp_path) -> Iterator[Cluster]:
    started = Cluster(tmp_path)
    yield started
    started.close()


@pytest.fixture(scope="module")
def local(wild, tmp_path_factory):
    return table(vdfmu.sweep(wild, AXES, measure=MEASURES, step=0.01, out=tmp_path_factory.mktemp("local") / "study"))


def begin(wild, out, dask, **options):
    outcome: list[object] = []
    half = threading.Event()

    def look(stage, done, total):
        if stage == "points" and done >= 10:
            half.set()

    def work():
        try:
            outcome.append(
                vdfmu.sweep(
                    wild, AXES, measure=MEASURES, step=0.01, chunk=5, out=out, scheduler=dask.address, progress=look,
                    **options,
                )
            )  # fmt: skip
        except Exception as error:
            outcome.append(error)
        finally:
            half.set()

    thread = threading.Thread(target=work)
    thread.start()
    assert half.wait(120)
    return thread, outcome


def end(thread, outcome) -> Sweep:
    thread.join(180)
    assert not thread.is_alive()
    assert isinstance(outcome[0], Sweep), outcome
    return outcome[0]


@pytest.mark.heavy
def test_the_workers_of_a_scheduler_find_what_this_machine_does(wild, tmp_path, dask, local):
    assert table(end(*begin(wild, tmp_path / "study", dask))) == local


@pytest.mark.heavy
def test_a_worker_that_is_killed_loses_nothing(wild, tmp_path, dask, local):
    running = begin(wild, tmp_path / "study", dask)
    dask.workers[0].kill()
    assert table(end(*running)) == local


@pytest.mark.heavy
def test_a_scheduler_that_is_restarted_loses_nothing(wild, tmp_path, dask, local):
    running = begin(wild, tmp_path / "study", dask)
    dask.restart()
    assert table(end(*running)) == local


@pytest.mark.heavy
def test_a_point_that_crashes_is_a_row_there_too(wild, tmp_path, dask):
    ways = np.zeros(20)
    ways[7] = 1.0
    swept = vdfmu.sweep(
        wild, {"unit.way": ways}, measure=MEASURES, step=0.1, chunk=5, out=tmp_path / "study", scheduler=dask.address
    )
    assert list(swept.failed) == [7] and "SIGSEGV" in swept.failed[7]


@pytest.mark.heavy
def test_without_a_scheduler_it_ends_with_what_is_done(wild, tmp_path, dask, local, monkeypatch):
    monkeypatch.setattr(workers, "_PATIENCE", 2.0)
    thread, outcome = begin(wild, tmp_path / "study", dask)
    dask.scheduler.kill()
    thread.join(120)
    assert isinstance(outcome[0], VdfmuError | Sweep), outcome
    if isinstance(outcome[0], VdfmuError):
        assert "repeat the command" in str(outcome[0])
    # and continues where it stopped, without a scheduler
    again = vdfmu.sweep(wild, AXES, measure=MEASURES, step=0.01, out=tmp_path / "study")
    assert table(again) == local


@pytest.mark.heavy
def test_what_is_no_address_is_said_and_leaves_no_noise(wild, tmp_path):
    """In a process of its own: a client that is left over complains when Python ends."""
    code = f"""
import vdfmu
try:
    vdfmu.sweep({str(wild)!r}, {{"unit.at": [0.0]}}, measure={MEASURES!r}, step=0.1, out={str(tmp_path)!r},
                scheduler="nowhere")
except vdfmu.VdfmuError as error:
    print(error)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120, check=True)
    assert "no Dask scheduler answers at nowhere: missing port" in done.stdout and not done.stderr
