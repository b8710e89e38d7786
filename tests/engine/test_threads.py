"""Runs in several threads of one process: each computes what it computes alone, and the process stays as it was."""

import os
import threading
from concurrent.futures import ThreadPoolExecutor

import pytest

from tests.wild import write
from vdfmu.base.errors import CosimError
from vdfmu.engine.run import simulate

THREADS, RUNS = 8, 5


def together(run):
    ready = threading.Barrier(THREADS)

    def several(_: int) -> list:
        ready.wait()
        return [run() for _ in range(RUNS)]

    with ThreadPoolExecutor(THREADS) as pool:
        return [result for results in pool.map(several, range(THREADS)) for result in results]


def test_the_working_folder_is_the_same_after_components_are_loaded_or_cannot_be(arm_package, pack, xml, tmp_path):
    """Fmpy changes it to that of a library, and stays there if it cannot load the library."""
    folder = os.getcwd()
    assert len(simulate(arm_package(), stop=0.002)) == 3
    assert os.getcwd() == folder
    path = tmp_path / "wild.so"
    path.write_bytes(b"no library")
    unit = write(tmp_path / "wild.fmu", path).read_bytes()
    with pytest.raises(CosimError, match="wild failed at t = 0 s in load: "):
        simulate(pack([xml.component("wild", "wild", "")], extra={"resources/wild.fmu": unit}), isolate=False, step=1.0)
    assert os.getcwd() == folder


@pytest.mark.heavy
def test_failures_in_threads_keep_to_their_runs(pack):
    """Each error has the rows and the words of its own run."""
    path = pack(["source Ramp y:output", "arm Fragile y:output"])

    def run():
        with pytest.raises(CosimError) as info:
            simulate(
                path, stop=1.0, step=0.1, parameters={"arm.at": 0.5, "arm.mode": 0}, isolate=False,
                log=lambda message: None,
            )  # fmt: skip
        return info.value

    alone = [message.text for message in run().results.messages]
    assert any("q[3] is not finite" in text for text in alone)
    for error in together(run):
        assert (error.unit, error.call, error.time) == ("arm", "doStep", 0.5)
        assert len(error.results) == 6
        assert [message.text for message in error.results.messages] == alone
