"""Commands that the tries of signals and faults start, what they begin with, and the files that they leave."""

import atexit
import json
import os
import shutil
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from functools import cache
from importlib import import_module
from pathlib import Path
from types import ModuleType

from vdfmu.base.cache import COMPILER, cache_folder

SECONDS = 1.0
"""Time [s] from a signal to the end of the command that is promised, where a processor is free for it."""
PATIENCE = 300.0
"""Time [s] after which a command is ended that does not end."""
SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
RUN = ("run", "planar_tracking", "--out", "out", "--stop")
SIMULATE = ("run", "arm.ssp", "--out", "out", "--stop")
BUILD = ("build", "planar_tracking", "--out", "out")
SSP = ("ssp", "planar_tracking", "--out")
OTHER = ("--set", "controller.K_p=1500")
"""Arguments with which a command writes something else."""


class Process:
    """A command that runs in `folder`, with temporary folders and its output there."""

    def __init__(
        self, folder: Path, words: Sequence[str], *, cold: bool = False, before: Sequence[str] = (), **changes: str
    ) -> None:
        """Start it, with an empty cache or that of this process, by another program, and in a changed environment."""
        self.temporary = folder / "tmp"
        self.temporary.mkdir(exist_ok=True)
        cache = folder / "cache" if cold else cache_folder()
        self._said = folder / "said"
        with self._said.open("wb") as said:
            self.process = subprocess.Popen(
                [*before, sys.executable, "-m", "vdfmu.cli", *words],
                cwd=folder, stdin=subprocess.DEVNULL, stdout=said, stderr=subprocess.STDOUT,
                env={
                    **os.environ, "TMPDIR": str(self.temporary), "VDFMU_CACHE_DIR": str(cache),
                    "ZIG_GLOBAL_CACHE_DIR": str(cache_folder() / COMPILER), **changes,
                },
                preexec_fn=_default_signals,
            )  # fmt: skip

    @property
    def said(self) -> str:
        """What it printed so far, errors too."""
        return self._said.read_text(errors="replace")

    def listens(self) -> bool:
        """Whether it takes SIGTERM: not before its first line of Python, nor after its last."""
        status = Path(f"/proc/{self.process.pid}/status").read_text()
        caught = int(status.partition("SigCgt:")[2].split()[0], 16)
        return bool(caught >> (signal.SIGTERM - 1) & 1)

    def end(self) -> tuple[float, float]:
        """Wait for its end; return how long that took, and how long it may take."""
        # Where more processes are ready to run than there are processors, each gets its share of one only.
        begin, ready = time.monotonic(), [_ready()]
        while self.process.poll() is None:
            if time.monotonic() > begin + PATIENCE:
                self.process.kill()
                self.process.wait()
                raise AssertionError(f"does not end within {PATIENCE:.0f} s: {self.said[-500:]}")
            time.sleep(0.005)
            ready.append(_ready())
        return time.monotonic() - begin, SECONDS * max(1.0, statistics.mean(ready) / (os.cpu_count() or 1))

    def left(self) -> list[str]:
        """Return what remains of it: temporary files, and processes that have its environment."""
        deadline = time.monotonic() + SECONDS  # a process that was killed is there for a moment
        while (processes := self._processes()) and time.monotonic() < deadline:
            time.sleep(0.01)
        return [*processes, *(str(path.relative_to(self.temporary)) for path in self.temporary.rglob("*"))]

    def _processes(self) -> list[str]:
        mark, commands = f"TMPDIR={self.temporary}\0".encode(), []
        for path in Path("/proc").glob("[0-9]*/environ"):
            try:
                if mark in path.read_bytes() + b"\0":
                    commands.append(path.with_name("cmdline").read_bytes().replace(b"\0", b" ").decode())
            except OSError:  # it has just ended
                continue
        return commands


def _default_signals() -> None:
    """Take all signals: a runner in the background may ignore Ctrl-C, which its children inherit."""
    for number in SIGNALS:
        signal.signal(number, signal.SIG_DFL)


def _ready() -> int:
    """Return how many threads of this machine run or are ready to."""
    return int(Path("/proc/loadavg").read_text().split()[3].partition("/")[0])


def results(folder: Path, out: str = "out") -> dict[str, object]:
    """Return the files of results in a folder, without those aside in ``partial``; of a summary what is no time."""
    content: dict[str, object] = {}
    for path in sorted((folder / out).rglob("*")):
        name = path.relative_to(folder / out)
        if path.is_file() and not name.parts[0].startswith("partial"):
            content[str(name)] = path.read_bytes()
            if name.name == "summary.json":
                summary = json.loads(path.read_text())
                content[str(name)] = [summary.get(key) for key in ("scenario", "stop", "files", "error")]
    return content


@cache
def workshop() -> Path:
    """Folder for what the tries begin with, removed at the end of this process."""
    folder = Path(tempfile.mkdtemp(prefix="vdfmu_hostile_"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return folder


def done(folder: Path, words: tuple[str, ...], *, cold: bool = False) -> float:
    """Run a command that must succeed; return its time [s]."""
    begin = time.monotonic()
    process = Process(folder, words, cold=cold)
    process.end()
    assert process.process.returncode == 0, process.said
    assert process.left() == []
    return time.monotonic() - begin


@cache
def begun(earlier: tuple[str, ...]) -> Path:
    """Folder with a package, its FMUs, and the results of an earlier command."""
    folder = Path(tempfile.mkdtemp(dir=workshop()))
    if earlier:
        shutil.copytree(begun(()), folder, dirs_exist_ok=True)
        done(folder, earlier)
    else:
        done(folder, ("ssp", "planar_tracking", "--out", "arm.ssp"))
        done(folder, ("build", "planar_tracking", "--out", "fmus"))
    return folder


def extra_tests(name: str) -> list[ModuleType]:
    """Return the modules of this name among the tests of extras."""
    files = sorted((Path(__file__).parents[1] / "extras").glob(f"*/{name}.py"))
    return [import_module(f"tests.extras.{file.parent.name}.{name}") for file in files]
