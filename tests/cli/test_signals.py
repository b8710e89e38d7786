"""Ctrl-C, SIGTERM and SIGHUP end every command within a second, in each of its phases, and leave nothing behind."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="Windows has no such signals for a process")

SECONDS = 1.0
"""Processor time that a command may take from the signal to its end, its threads together; waits come on top."""
PATIENCE = 120.0
"""Time after which a test gives up: nothing that it waits for takes more than some seconds."""


class Command:
    """A command that runs: `folder` is where it works, `temporary` where its temporary folders are."""

    def __init__(self, folder: Path, arguments: tuple[str, ...], cache: str | None) -> None:
        self.folder, self.temporary = folder, folder / "tmp"
        self.temporary.mkdir(exist_ok=True)
        environment = {**os.environ, "TMPDIR": str(self.temporary)}
        if cache is not None:
            environment["VDFMU_CACHE_DIR"] = cache
        self.process = subprocess.Popen(
            [sys.executable, "-m", "vdfmu.cli", *arguments],
            cwd=folder, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        )  # fmt: skip

    def wait_for(self, sign: Callable[[], object]) -> None:
        """Wait for a sign that the command has come as far as it should."""
        deadline = time.monotonic() + PATIENCE
        while not sign():
            assert self.process.poll() is None, f"ended before: {self.process.communicate()}"
            assert time.monotonic() < deadline, "no sign"
            time.sleep(0.005)

    def files(self, pattern: str) -> list[Path]:
        """Files and folders of a pattern in the folder."""
        return list(self.folder.glob(pattern))

    def stop(self, number: int) -> str:
        """Send a signal; return what the command said, once it has ended as it should."""
        used = self._seconds()
        self.process.send_signal(number)
        while os.waitid(os.P_PID, self.process.pid, os.WEXITED | os.WNOHANG | os.WNOWAIT) is None:
            assert self._seconds() - used < SECONDS, "it goes on"
            time.sleep(0.005)
        _, errors = self.process.communicate(timeout=PATIENCE)
        assert self.process.returncode == 128 + number, errors
        assert "stopped" in errors
        assert "Traceback" not in errors
        assert list(self.temporary.iterdir()) == []
        return errors

    def _seconds(self) -> float:
        """Processor time [s] of the process so far."""
        fields = Path(f"/proc/{self.process.pid}/stat").read_text().rpartition(")")[2].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


@pytest.fixture
def start(tmp_path: Path) -> Iterator[Callable[..., Command]]:
    """Return a function that starts a command; it is ended with the test."""
    commands: list[Command] = []

    def start(*arguments: str, cache: str | None = None) -> Command:
        commands.append(Command(tmp_path, arguments, cache))
        return commands[-1]

    yield start
    for command in commands:
        command.process.kill()
        command.process.communicate()


LONG = ("run", "planar_tracking", "--stop", "1000", "--set", "plant.tolerance=1e-12")
"""A run that does not end, with many solver steps in each row."""


@pytest.fixture
def under_way(start, tmp_path):
    """Return the folder of results, a run into it that is under way, and its files, of an earlier run."""
    folder = tmp_path / "results" / "planar_tracking"
    before = start("run", "planar_tracking", "--stop", "0.1", "--no-reference")
    assert before.process.wait(PATIENCE) == 0
    before.temporary.rmdir()
    kept = {path.name: path.read_bytes() for path in folder.iterdir()}
    command = start(*LONG)
    command.wait_for(lambda: any(path.stat().st_size > 10_000 for path in command.files("*/*/*/results.csv")))
    return folder, command, kept


@pytest.mark.heavy
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_keeps_the_rows_and_the_results_before(under_way, number):
    folder, command, kept = under_way
    errors = " ".join(command.stop(number).split())
    assert "stopped: interrupted at t =" in errors
    assert " s are in results/planar_tracking/partial/results.csv; results/planar_tracking is unchanged." in errors
    rows = (folder / "partial" / "results.csv").read_text().splitlines()
    assert len(rows) > 3
    assert len({row.count(",") for row in rows[1:]}) == 1
    assert {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()} == kept


DROPPED = """
import signal, sys, time
from vdfmu.cli import commands, main
def command():
    try:
        signal.raise_signal(signal.SIGINT)
    except:
        pass
    time.sleep(60)
commands.command = command
main()
"""
SLOW = """
import threading, time
start = threading.Thread.start
threading.Thread.start = lambda thread: (start(thread), time.sleep(0.05))
"""
"""A busy machine: a thread has slept before the call that started it returns."""
FREED = """
import signal, sys, time, weakref
from vdfmu.cli import commands, main
class Lock: pass
def command():
    lock = Lock()
    text = "import signal\\ndef cb(_): signal.raise_signal(signal.SIGINT)"
    space = {}
    exec(compile(text, "<frozen importlib._bootstrap>", "exec"), space)
    kept = weakref.ref(lock, space["cb"])
    del lock
    time.sleep(60)
commands.command = command
main()
"""
"""As an import does that frees the lock of a module."""
ENDING = """
import atexit, signal, sys
from vdfmu.cli import main
atexit.register(lambda: [signal.raise_signal(s) for s in (signal.SIGINT, signal.SIGTERM)])
sys.argv = ["vdfmu", "--version"]
main()
"""
LATE = """
import os, signal, sys
from vdfmu.cli import main
class Last:
    def __del__(self, kill=os.kill, process=os.getpid(), number=signal.SIGINT):
        kill(process, number)
sys.last = Last()
sys.argv = ["vdfmu", "--version"]
main()
"""
"""While Python frees its modules, when it has given the handlers of signals back."""


@pytest.mark.few(2)
@pytest.mark.parametrize(("code", "ended", "said"), [
    (DROPPED, 130, "stopped\n"), (SLOW + DROPPED, 130, "stopped\n"), (FREED, 130, "stopped\n"), (ENDING, 0, ""),
    (LATE, 0, ""),
])  # fmt: skip
def test_a_signal_that_a_library_drops_comes_again_and_one_at_the_end_adds_nothing(code, ended, said):
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=300, check=False)
    assert (done.returncode, done.stderr) == (ended, said)


@pytest.mark.heavy
def test_ctrl_c_before_the_co_simulation_says_so(start):
    command = start("run", "tracking", cache="empty")  # the FMUs must be traced first
    command.wait_for(lambda: command.files("results/tracking"))
    assert command.stop(signal.SIGINT) == "stopped\n"
    assert not command.files("results/tracking")


@pytest.mark.heavy
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_acts_while_equations_are_traced(start, number):
    """CasADi drops what a handler of signals raises while it looks at its arguments, which is most of the time."""
    command = start("build", "tracking", cache="empty")
    command.wait_for(lambda: command.files("empty/*/*.casadi"))
    command.stop(number)


@pytest.mark.heavy
def test_a_signal_ends_the_compilers_and_acts_while_references_are_solved(start):
    command = start("build", "planar_tracking", cache="empty")
    command.wait_for(lambda: command.files("tmp/vdfmu_native_*/*/*.o*"))
    command.stop(signal.SIGTERM)
    assert not [p for p in Path("/proc").glob("[0-9]*/cwd") if str(command.temporary) in _link(p)]
    command = start("run", "planar_tracking", "--stop", "2")
    command.wait_for(lambda: command.files("results/*/*/summary.json"))
    errors = command.stop(signal.SIGHUP)
    assert " are in results/planar_tracking/partial/results.csv." in errors
    assert len((command.folder / "results/planar_tracking/partial/results.csv").read_text().splitlines()) == 2003


def _link(path: Path) -> str:
    try:
        return os.readlink(path)
    except OSError:
        return ""


def test_a_signal_acts_while_modules_are_imported(start):
    command = start("run", "tracking")
    command.wait_for(lambda: "multiarray" in Path(f"/proc/{command.process.pid}/maps").read_text())
    command.stop(signal.SIGINT)


@pytest.mark.heavy
def test_a_killed_run_leaves_the_results_before_and_its_rows(under_way):
    folder, command, kept = under_way
    command.process.kill()
    command.process.wait(PATIENCE)
    (rows,) = folder.glob(f"partial_{command.process.pid}/results.csv")
    assert len(rows.read_text().splitlines()) > 3
    assert {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()} == kept
