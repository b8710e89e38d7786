"""Many runs in one process: in threads at once, and one after another; all give the same, and nothing grows."""

import gc
import os
import threading
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path

import numpy as np

from tests.hostile.table import Corpus
from vdfmu.engine.run import Results, simulate
from vdfmu.system.package.write import cached_fmus, write_ssp
from vdfmu.system.scenario import load_scenario

THREADS = 8
STOP = 0.02
"""End of a run [s]: 20 steps."""
GROWTH = 1.0
"""Memory [kB] that a run may leave behind on average; its rows alone, 21 of 77 numbers, have 13."""
SLACK = 4096.0
"""Growth [kB] that is no run's: the allocator takes memory in parts, of which it asked for one of 3.7 MB once."""


def _package(folder: Path) -> Path:
    scenario = load_scenario("planar_tracking")
    return write_ssp(scenario, cached_fmus(scenario, folder), folder / "arm.ssp")


def _require_same(actual: Results, expected: Results) -> None:
    assert actual.names == expected.names
    for name in expected.names:
        np.testing.assert_array_equal(actual[name], expected[name], err_msg=name)


def threads(runs: int, number: int, folder: Path) -> None:
    """Run in eight threads that begin at once, so many times each; each result is that of a run alone."""
    package, before = _package(folder), os.getcwd()
    alone = simulate(package, stop=STOP)
    ready = threading.Barrier(THREADS)

    def several(_: int) -> None:
        ready.wait()
        for _ in range(runs):
            _require_same(simulate(package, stop=STOP), alone)

    with ThreadPoolExecutor(THREADS) as pool:
        list(pool.map(several, range(THREADS)))
    assert os.getcwd() == before


def _held() -> tuple[float, int, int]:
    """Return what this process holds: memory [kB], open files, mapped files."""
    gc.collect()
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    mapped = Path("/proc/self/maps").read_text().count(".so")
    return pages * os.sysconf("SC_PAGE_SIZE") / 1024, len(os.listdir("/proc/self/fd")), mapped


def in_a_row(runs: int, number: int, folder: Path) -> None:
    """Run one after another; after a quarter of them, to warm up, what the process holds no longer grows."""
    package = _package(folder)
    alone = simulate(package, stop=STOP)
    warm = runs // 4
    for k in range(runs):
        if k == warm:
            before = _held()
        _require_same(simulate(package, stop=STOP), alone)
    after = _held()
    grown = after[0] - before[0]
    most = SLACK + GROWTH * (runs - warm)
    assert grown < most, f"memory grows by {grown:.0f} kB in {runs - warm} runs; expected less than {most:.0f} kB"
    assert after[1:] == before[1:], f"open and mapped files: {before[1:]} before, {after[1:]} after {runs - warm} runs"


CORPORA = [
    Corpus("8 threads x 50 runs in a process", 1, partial(threads, 50), quick=0, seconds=600.0, each=8 * 50),
    Corpus(
        "2,000 runs in a process, one after another", 1, partial(in_a_row, 2000), quick=0, seconds=1800.0, each=2000
    ),
]
