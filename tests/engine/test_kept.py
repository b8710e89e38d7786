"""Runs whose components stay loaded between them: each is what it would be alone."""

import gc
import os
import subprocess
import sys
import threading

import pytest

from tests.engine.files import assert_same_bits, edited
from tests.engine.reference import models
from tests.wild import build, write
from vdfmu.base.errors import CosimError, UsageError
from vdfmu.engine.fmu import instance
from vdfmu.engine.run import KeptRuns, session, simulate

ARM = {"stop": 0.02, "step": 1e-3, "record": ["*"]}
SYSTEMS = ["arm native", "arm python", "scaled 2.0", "scaled 3.0", "arrays", "exchange"]


@pytest.fixture
def made(monkeypatch):
    """Return the list of the components that are instantiated, and of those that are freed."""
    made, freed = [], []
    for listed, name in ((made, "instantiate"), (freed, "close")):
        plain = getattr(instance.Instance, name)
        monkeypatch.setattr(
            instance.Instance, name,
            lambda self, listed=listed, plain=plain: (listed.append(self.name), plain(self))[1],
        )  # fmt: skip
    return made, freed


@pytest.fixture
def ours(monkeypatch):
    """Let all FMUs be of this project, so that they last."""
    monkeypatch.setattr(session, "is_own", lambda unit: True)


@pytest.fixture
def case(system, pack, built, xml, arm_package):
    """Return a function for a package by its name, and values that change its run."""

    def make(name):
        kind, _, version = name.partition(" ")
        if kind == "arm":
            return arm_package(version), [{}, {"plant.I_m[1]": 2e-3}, {"plant.I_m": [3e-3, 1e-3]}]
        if kind == "scaled":
            link = xml.connection("b.x -> a.u", '<ssc:LinearTransformation factor="-1.5" offset="0.5"/>')
            lags = [f"{name} Lagging u:input x:output" for name in "ab"]
            path = pack(lags, ["a.x -> b.u", link], extra={"resources/Lagging.fmu": built(models.LAG, version)})
            return path, [{"a.x": 1.0}, {"b.x": 2.0, "a.x": 0.5}, {"a.x": 3.0}]
        if kind == "exchange":
            return system({"m": (models.VAN_DER_POL, "3.0")}), [{"m.x0": 1.0}, {"m.x0": 2.0}, {"m.x0": -1.0}]
        units = {"s": (models.STATE_SPACE, "3.0"), "t": (models.STATE_SPACE, "3.0")}
        values = [{"s.u": [1.0, 2.0, 3.0]}, {"s.u": [0.0, 1.0, 0.0], "t.u[2]": 5.0}, {"t.u[2]": 7.0}]
        return system(units, ["s.y[3] -> t.u[1]", "s.y[1] -> t.u[3]"]), values

    return make


@pytest.mark.parametrize("name", SYSTEMS)
def test_each_run_is_that_of_components_that_are_new(ours, case, made, name):
    path, values = case(name)
    options = ARM if name.startswith("arm") else {"stop": 1.0, "step": 0.1, "record": ["*"]}
    alone = [simulate(path, parameters=each, **options) for each in values]
    assert any((alone[0][x] != alone[1][x]).any() for x in alone[0])
    del made[0][:], made[1][:]
    runs = KeptRuns(path)
    kept = []
    for k in (0, 1, 0, 2, 1):
        kept.append((runs.run(parameters=values[k], **options), alone[k]))
    for results, expected in kept:  # after all runs: none changes the results of another
        assert_same_bits(results, expected)
        assert results.messages == expected.messages
        summary, expected_summary = ({**r.summary, "wall_s": 0.0} for r in (results, expected))
        assert summary == expected_summary
    assert sorted(made[0]) == sorted(set(made[0])) and made[1] == []
    del runs
    gc.collect()
    assert sorted(made[1]) == sorted(made[0])


def test_times_and_records_may_change_and_options_load_anew(case, made):
    path, _ = case("arm native")
    runs = KeptRuns(path)
    assert len(runs.run(stop=0.02, step=1e-3)) == 21
    assert len(runs.run(stop=0.02, step=2e-3)) == 11
    assert runs.run(stop=0.03, step=1e-3, record=["plant.q[*]"]).names == ["plant.q[1]", "plant.q[2]"]
    long = runs.run(stop=1.0, step=1e-3)  # too long for its plan to be kept
    assert_same_bits(long, simulate(path, stop=1.0, step=1e-3))
    assert len(made[0]) == 2 * 4
    assert_same_bits(runs.run(algorithm="jacobi", **ARM), simulate(path, algorithm="jacobi", **ARM))
    assert len(made[0]) == 4 * 4


def test_a_package_that_changes_is_loaded_anew(pack):
    runs = KeptRuns(pack(["a Ramp y:output"]))
    assert runs.run(stop=0.2, step=0.1).names == ["a.y"]
    pack(["b Ramp y:output", "c Gain y:output"])
    assert runs.run(stop=0.2, step=0.1).summary["order"] == ["b", "c"]


def test_inputs_are_read_for_each_run(case, tmp_path):
    path, _ = case("arm native")
    runs, table = KeptRuns(path), tmp_path / "force.csv"
    last = []
    for force in (0.0, 50.0):
        table.write_text(f"time,plant.F_e[2] [N]\n0,{force}\n1,{force}\n")
        last.append(runs.run(inputs=str(table), **ARM)["plant.q[1]"][-1])
    assert last[0] != last[1]


def test_foreign_fmus_and_those_of_one_instance_are_freed_after_each_run(pack, xml, fmus, ours, made, monkeypatch):
    old = b'canBeInstantiatedOnlyOncePerProcess="false"'
    once = edited(fmus["Gain"], replace=[(old, old.replace(b"false", b"true"))])
    for extra, options in (({"resources/once.fmu": once}, {}), ({"resources/once.fmu": fmus["Gain"].read_bytes()}, {})):
        if extra["resources/once.fmu"] is not once:
            monkeypatch.setattr(session, "is_own", lambda unit: False)
            options = {"isolate": False}
        runs = KeptRuns(pack([xml.component("a", "Gain").replace("Gain.fmu", "once.fmu")], extra=extra))
        for _ in range(3):
            runs.run(stop=0.2, step=0.1, **options)
            assert made[0] == made[1]
    assert len(made[0]) == 2 * 3


def test_a_run_that_fails_leaves_the_next_as_it_was(case, made):
    path, _ = case("arm native")
    runs = KeptRuns(path)
    first = runs.run(**ARM)
    for values, kind in (({"plant.q_dot_0[1]": 1e11}, CosimError), ({"plant.mess": 1.0}, UsageError)):
        with pytest.raises(kind, match="plant"):
            runs.run(parameters=values, **ARM)
        assert_same_bits(runs.run(**ARM), first)
    assert len(made[0]) == 2 * 4  # a wrong name is found before any call


def test_the_end_of_each_run_is_told_with_its_results(pack, tmp_path, ours):
    wild = write(tmp_path / "Wild.fmu", build(tmp_path)).read_bytes()
    runs = KeptRuns(pack(["unit Wild y:output"], extra={"resources/Wild.fmu": wild}))
    for way, ends in ((0.0, True), (6.0, False), (0.0, True)):  # 6: fmi2Terminate fails
        if ends:
            assert len(runs.run(stop=1.0, step=0.25, parameters={"unit.way": way})) == 5
            continue
        with pytest.raises(CosimError, match="unit failed at t = 1 s in terminate: the brake does not close") as info:
            runs.run(stop=1.0, step=0.25, parameters={"unit.way": way})
        assert info.value.results is not None and len(info.value.results) == 5


def test_a_unit_that_ends_the_simulation_runs_again(pack, strict, ours):
    runs = KeptRuns(pack(["unit Strict y:output"], extra={"resources/Strict.fmu": strict.read_bytes()}))
    for end in (0.6, 9.0, 0.3):
        results = runs.run(stop=2.0, step=0.25, parameters={"unit.end": end})
        assert results.summary.get("ended") == ({"component": "unit", "time": end} if end < 2.0 else None)
        assert results.time[-1] == min(end, 2.0)


def test_threads_share_a_system(case):
    path, values = case("arm native")
    alone = [simulate(path, parameters=each, **ARM) for each in values]
    runs, results = KeptRuns(path), {}

    def run(k):
        results[k] = [runs.run(parameters=values[k], **ARM) for _ in range(5)]

    threads = [threading.Thread(target=run, args=(k,)) for k in range(3)]
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
from pathlib import Path
from vdfmu.engine.run import KeptRuns
runs = KeptRuns(Path(sys.argv[1]))
for _ in range(2):
    runs.run(stop=0.01, step=1e-3)
print(len(os.listdir(os.environ["TMPDIR"])), flush=True)
def end_of(stop):
    return runs.run(stop=stop, step=1e-3).time[-1]
if sys.argv[2] == "fork":
    child = get_context("fork").Process(target=runs.run, kwargs={"stop": 0.01, "step": 1e-3})
    child.start()
    child.join()
    runs.run(stop=0.01, step=1e-3)
    print(len(os.listdir(os.environ["TMPDIR"])), flush=True)
if sys.argv[2] == "pool":  # its end kills the workers
    with get_context("fork").Pool(2) as pool:
        assert pool.map(end_of, [0.01, 0.02]) == [0.01, 0.02]
if sys.argv[2] == "exit":
    ctypes.CDLL(None).exit(7)
"""


@pytest.mark.parametrize(("way", "code"), [("end", 0), ("fork", 0), ("pool", 0), ("exit", 7)])
def test_a_process_may_end_or_fork_between_runs(case, tmp_path, way, code):
    path, _ = case("arm native")
    done = subprocess.run(
        [sys.executable, "-c", CODE, path, way], capture_output=True, text=True, timeout=300, check=False,
        env={**os.environ, "TMPDIR": str(tmp_path)},
    )  # fmt: skip
    assert (done.returncode, done.stderr, set(done.stdout.split())) == (code, "", {"1"})
    assert way == "exit" or not list(tmp_path.iterdir())
