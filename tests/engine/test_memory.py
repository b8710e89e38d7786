"""A process that has run Python FMUs ends without touching memory that was freed.

The library of pythonfmu 0.7.0 frees what holds its interpreter and counts down in it once more when it is unloaded or
the process ends. ``guard.c`` makes each such access the end of the process.
"""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.cc import CC
from vdfmu.engine.inspect import trial

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="the guard is preloaded by the loader of Linux")

IN_PROCESS = """
import sys, vdfmu
*fmus, end = sys.argv[1:]
system = vdfmu.connect({f"c{i}": fmu for i, fmu in enumerate(fmus)}, [], step=0.1, stop=1.0)
for _ in range(2):
    with system.instance(isolate=False) as simulator:
        simulator.run()
        simulator.reset()
        simulator.step(3)
        if end == "open":
            print("reached", flush=True)
            sys.exit(0)
print("reached")
"""


@pytest.fixture(scope="module")
def guard(tmp_path_factory) -> dict[str, str]:
    """Return the environment of a process in which freed memory is closed."""
    path = tmp_path_factory.mktemp("guard") / "guard.so"
    flags = ["-std=c11", "-Wall", "-Wextra", "-Werror", "-shared", "-fPIC"]
    subprocess.run([*CC, *flags, "-o", path, Path(__file__).with_name("guard.c")], check=True)
    return {**os.environ, "LD_PRELOAD": str(path)}


@pytest.mark.heavy
@pytest.mark.parametrize("end", ["freed", "open"])
@pytest.mark.parametrize("names", [["Gain"], ["Gain", "Stock", "Gain"]], ids="-".join)
def test_a_process_ends_that_had_python_fmus(fmus, guard, names, end):
    command = [sys.executable, "-c", IN_PROCESS, *(fmus[name] for name in names), end]
    done = subprocess.run(command, env=guard, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (0, "reached\n"), done.stderr


@pytest.mark.heavy
def test_a_check_ends_without_a_finding_at_the_end_of_its_process(fmus, guard, monkeypatch):
    monkeypatch.setenv("LD_PRELOAD", guard["LD_PRELOAD"])
    assert trial.run_apart(fmus["Gain"]).problems == []


@pytest.mark.heavy
def test_the_guard_sees_what_fmpy_leaves_behind(fmus, guard):
    """The fault is there: a process that runs the FMU by fmpy alone ends by SIGSEGV."""
    code = "import sys, fmpy; fmpy.simulate_fmu(sys.argv[1], stop_time=0.1); print('reached')"
    command = [sys.executable, "-c", code, fmus["Gain"]]
    done = subprocess.run(command, env=guard, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (-11, "reached\n"), done.stderr
