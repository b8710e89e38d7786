"""A command loads no library of a foreign FMU into its own process, whatever the FMU does in any of its calls."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import vdfmu
from tests.wild import write_brittle
from vdfmu.base.errors import CosimError
from vdfmu.cli.commands import app
from vdfmu.engine.linear.linearise import linear_system
from vdfmu.study.judgement import judge

CALLS = ("load", "instantiate", "enterInitializationMode", "getReal", "doStep", "terminate")
COMMANDS = {
    "run": ("run", "pair.ssp", "--overwrite"),
    "judge": ("judge", "pair.ssp", "--wanted", "20"),
    "linear": ("linear", "pair.ssp", "--loop", "a.u"),
    "check": ("check", "pair.ssp"),
    "check Brittle.fmu": ("check", "Brittle.fmu"),
    "run --judge": ("run", "pair.ssp", "--judge", "20", "--overwrite"),
    "run Brittle.fmu": ("run", "Brittle.fmu", "--step", "0.1", "--stop", "1", "--overwrite"),
    "sweep": ("sweep", "pair.ssp", "--vary", "a.x=1,2", "--measure", "m=max(b.x)", "--overwrite"),
}
COMMANDS = {name: words for name, words in COMMANDS.items() if words[0] in app.commands}  # linear is of an extra

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="the FMU crashes by a signal")


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """Return a folder with the brittle FMU, and two of them in a ring as a package."""
    folder = tmp_path_factory.mktemp("brittle")
    fmu = write_brittle(folder)
    vdfmu.connect({"a": fmu, "b": fmu}, [("a.x", "b.u"), ("b.x", "a.u")], step=0.1, stop=1.0).write(folder / "pair.ssp")
    return folder


@pytest.fixture
def loaded(folder, monkeypatch):
    """Work in the folder; return a function for the processes that loaded the FMU since the last call."""
    log = folder / "log"
    monkeypatch.chdir(folder)
    monkeypatch.setenv("BRITTLE_LOG", str(log))

    def processes() -> set[int]:
        numbers = {int(line) for line in log.read_text().split()} if log.exists() else set()
        log.unlink(missing_ok=True)
        return numbers

    processes()
    return processes


def ended(*arguments: str) -> tuple[int, int, str]:
    """Run a command; return its process, its exit code and all that it said."""
    process = subprocess.Popen(
        [sys.executable, "-m", "vdfmu.cli", *arguments], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    )
    words, _ = process.communicate()
    return process.pid, process.returncode, words


def assert_elsewhere(loaded, command: int | None = None) -> None:
    """Assert that some process loaded the FMU, and that it was neither this one nor that of the command."""
    processes = loaded()
    assert processes
    assert not processes & {os.getpid(), command}
    if Path("/proc/self/maps").exists():
        assert "brittle" not in Path("/proc/self/maps").read_text()


@pytest.mark.heavy
@pytest.mark.parametrize("command", COMMANDS)
def test_no_command_loads_a_foreign_fmu_into_its_process(loaded, command):
    process, code, words = ended(*COMMANDS[command])
    assert code == 0, words
    assert_elsewhere(loaded, process)


@pytest.mark.heavy
@pytest.mark.parametrize("call", CALLS)
@pytest.mark.parametrize("command", [name for name in COMMANDS if name != "sweep"])  # it has a row for each failure
def test_a_crash_ends_every_command_with_component_and_call(loaded, monkeypatch, command, call):
    monkeypatch.setenv("BRITTLE", call)
    process, code, words = ended(*COMMANDS[command])
    assert code == 1, words
    assert_elsewhere(loaded, process)
    assert "Traceback" not in words
    assert "SIGSEGV" in words or "signal 11" in words
    assert call in words
    assert command.endswith(".fmu") or "a failed" in words


def test_judge_and_linear_name_call_and_component_of_a_crash_and_go_on_in_the_next(loaded, folder, monkeypatch):
    """What is derived is the ring: x_a' = x_b - 2 x_a and x_b' = x_a - 2 x_b."""
    for run, call in (
        (lambda: judge(folder / "pair.ssp"), "instantiate"),
        (lambda: linear_system(folder / "pair.ssp"), "getDirectionalDerivative"),
    ):
        monkeypatch.setenv("BRITTLE", call)
        with pytest.raises(CosimError, match=f"a failed at t = 0 s in {call}: .*SIGSEGV"):
            run()
    monkeypatch.delenv("BRITTLE")
    system = linear_system(folder / "pair.ssp", 0.5)
    np.testing.assert_array_equal(system.continuous().A, [[-2.0, 1.0], [1.0, -2.0]])
    assert_elsewhere(loaded)


@pytest.mark.heavy
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("command", [name for name in ("run", "judge", "linear") if name in COMMANDS])
@pytest.mark.parametrize("call", ["instantiate", "getReal", "doStep"])
def test_a_signal_ends_a_command_whose_component_hangs(folder, tmp_path, command, call, number):
    log = tmp_path / "log"
    process = subprocess.Popen(
        [sys.executable, "-m", "vdfmu.cli", *COMMANDS[command]], cwd=folder, stderr=subprocess.PIPE, text=True,
        env={**os.environ, "BRITTLE": f"-{call}", "BRITTLE_LOG": str(log)},
    )  # fmt: skip
    while not log.exists():
        assert process.poll() is None, process.communicate()
        time.sleep(0.01)
    process.send_signal(number)
    _, errors = process.communicate(timeout=60.0)  # the wait limit is 300 s
    assert process.returncode == 128 + number, errors
    assert "stopped" in errors
    for line in log.read_text().split():
        with pytest.raises(ProcessLookupError):
            os.kill(int(line), 0)


def test_a_time_limit_names_the_call_that_hangs(folder, monkeypatch):
    monkeypatch.setenv("BRITTLE", "-getReal")
    with pytest.raises(CosimError, match="a failed at t = 0 s in getReal: no return within 5 s"):
        judge(folder / "pair.ssp", wait_limit=5.0)
