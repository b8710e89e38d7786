"""Runs of a system whose components stay loaded between them: each is what it would be alone."""

import os
import shutil
import subprocess
import sys
import threading
from functools import partial

import numpy as np
import pytest

import vdfmu
from tests.engine.files import assert_same_bits
from vdfmu.base.errors import CosimError, UsageError
from vdfmu.base.files import data_path
from vdfmu.engine.run import simulate

RUN = {"stop": 0.02, "step": 1e-3, "record": ["*"]}
VALUES = [{}, {"plant.I_m[1]": 2e-3}, {"plant.I_m": [3e-3, 1e-3]}]


@pytest.fixture(scope="module")
def package(tmp_path_factory):
    return vdfmu.load("planar_tracking").write(tmp_path_factory.mktemp("arm") / "arm.ssp")


@pytest.fixture(scope="module")
def ramp(tmp_path_factory):
    return vdfmu.build(data_path("examples") / "units" / "low_pass.py", tmp_path_factory.mktemp("ramp") / "ramp.fmu")


def test_each_run_is_that_of_components_that_are_new(package):
    alone = [simulate(package, parameters=each, **RUN) for each in VALUES]
    assert any((alone[0][x] != alone[1][x]).any() for x in alone[0])
    system = vdfmu.load(package)
    pairs = [(system.run(parameters=VALUES[k], **RUN), alone[k]) for k in (0, 1, 0, 2, 1)]
    for results, expected in pairs:  # after all runs: none changes the results of another
        assert_same_bits(results, expected)
        assert results.messages == expected.messages
        assert {**results.summary, "wall_s": 0.0} == {**expected.summary, "wall_s": 0.0}


def test_values_that_are_equal_but_not_the_same_are_set_anew(ramp):
    """A run with the values of the run before is not checked again: 0.0 == -0.0, and an array may change in place."""
    system, value = vdfmu.load(ramp), np.array([1.0])
    first = system.run(parameters={"ramp.u": value}, **RUN)["ramp.y"][-1]
    value[:] = 2.0
    assert system.run(parameters={"ramp.u": value}, **RUN)["ramp.y"][-1] == pytest.approx(2.0 * first, rel=1e-5)
    signs = [np.signbit(system.run(parameters={"ramp.y_0": zero}, **RUN)["ramp.y"][0]) for zero in (0.0, -0.0, 0.0)]
    assert signs == [False, True, False]
    system.run(parameters={"ramp.y_0": 1.0}, **RUN)
    with pytest.raises(UsageError, match=r"'ramp\.y_0': expected a number"):
        system.run(parameters={"ramp.y_0": True}, **RUN)


def test_times_records_and_options_may_change(package):
    system = vdfmu.load(package)
    assert len(system.run(stop=0.02, step=1e-3)) == 21
    assert len(system.run(stop=0.02, step=2e-3)) == 11
    assert system.run(stop=0.03, step=1e-3, record=["plant.q[*]"]).names == ["plant.q[1]", "plant.q[2]"]
    long = system.run(stop=1.0, step=1e-3)  # too long for its plan to be kept
    assert_same_bits(long, simulate(package, stop=1.0, step=1e-3))
    assert_same_bits(system.run(algorithm="jacobi", **RUN), simulate(package, algorithm="jacobi", **RUN))


def test_a_package_and_a_table_that_change_are_read_anew(package, ramp, tmp_path):
    path, table = vdfmu.load(ramp).write(tmp_path / "changes.ssp"), tmp_path / "force.csv"
    system = vdfmu.load(path)
    assert system.run(**RUN).summary["order"] == ["ramp"]
    shutil.copyfile(package, path)
    last = []
    for force in (0.0, 50.0):
        table.write_text(f"time,plant.F_e[2] [N]\n0,{force}\n1,{force}\n")
        last.append(system.run(inputs=str(table), **RUN)["plant.q[1]"][-1])
    assert last[0] != last[1]


def test_a_run_that_fails_leaves_the_next_as_it_was(package):
    system = vdfmu.load(package)
    first = system.run(**RUN)
    for values, kind in (({"plant.q_dot_0[1]": 1e11}, CosimError), ({"plant.mess": 1.0}, UsageError)):
        with pytest.raises(kind, match="plant"):
            system.run(parameters=values, **RUN)
        assert_same_bits(system.run(**RUN), first)


@pytest.mark.heavy
def test_threads_share_a_system(package):
    alone = [simulate(package, parameters=each, **RUN) for each in VALUES]
    system, results = vdfmu.load(package), {}

    def run(k):
        results[k] = [system.run(parameters=VALUES[k], **RUN) for _ in range(5)]

    threads = [threading.Thread(target=partial(run, k)) for k in range(3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for k, listed in results.items():
        for each in listed:
            assert_same_bits(each, alone[k])


CODE = """
import ctypes, os, sys
from multiprocessing import get_context
import vdfmu
system = vdfmu.load(sys.argv[1])
for _ in range(2):
    system.run(stop=0.01, step=1e-3)
print(len(os.listdir(os.environ["TMPDIR"])), flush=True)
def end_of(stop):
    return [each.run(stop=stop, step=1e-3).time[-1] for each in (system, vdfmu.load(sys.argv[1]))]
if sys.argv[2] == "fork":
    child = get_context("fork").Process(target=end_of, args=(0.01,))
    child.start()
    child.join()
    system.run(stop=0.01, step=1e-3)
    print(len(os.listdir(os.environ["TMPDIR"])), flush=True)
if sys.argv[2] == "pool":  # its end kills the workers
    with get_context("fork").Pool(2) as pool:
        assert pool.map(end_of, [0.01, 0.02]) == [[0.01, 0.01], [0.02, 0.02]]
if sys.argv[2] == "exit":
    ctypes.CDLL(None).exit(7)
"""


@pytest.mark.few(1)
@pytest.mark.parametrize(("way", "code"), [("end", 0), ("fork", 0), ("pool", 0), ("exit", 7)])
def test_a_process_may_end_or_fork_between_runs(package, tmp_path, way, code):
    done = subprocess.run(
        [sys.executable, "-c", CODE, package, way], capture_output=True, text=True, timeout=300, check=False,
        env={**os.environ, "TMPDIR": str(tmp_path)},
    )  # fmt: skip
    assert (done.returncode, done.stderr, set(done.stdout.split())) == (code, "", {"1"})
    assert way == "exit" or not list(tmp_path.iterdir())
