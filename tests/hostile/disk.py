"""Each file operation of each command fails once: with an error of the disk, for want of a right, or of room."""

import atexit
import errno
import json
import mmap
import os
import random
import re
import shutil
import signal
import struct
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from tests.cc import CC
from tests.hostile.commands import PATIENCE, workshop
from tests.hostile.jobs import JOBS, begin, differing, files, require_nothing_left, require_whole
from tests.hostile.table import Corpus
from vdfmu.base.cache import COMPILER, cache_folder
from vdfmu.base.errors import VdfmuError

_PLAN = struct.Struct("=qqqiii4096s4096s")
"""As ``struct plan`` of `disk.c`."""
_DATA, _NAME, _ROOM = 1, 2, 4
ERRORS = {errno.EIO: _DATA | _NAME, errno.EACCES: _NAME, errno.ENOSPC: _ROOM}
"""Each error, and the kinds of operations that it may come of."""


class Disk:
    """Commands in a folder whose file operations are counted and fail as planned."""

    def __init__(self) -> None:
        self.home = Path(tempfile.mkdtemp(dir=workshop())).resolve()
        self.place, self._log, self._said = (self.home / name for name in ("place", "log", "said"))
        (self.home / "user").mkdir()
        library, plan = self.home / "disk.so", self.home / "plan"
        subprocess.run([*CC, "-shared", "-fPIC", "-O2", "-o", library, Path(__file__).with_name("disk.c")], check=True)
        plan.write_bytes(bytes(_PLAN.size))
        with plan.open("r+b") as file:
            self._plan = mmap.mmap(file.fileno(), _PLAN.size)
        self._server = subprocess.Popen(
            [sys.executable, Path(__file__).with_name("disk_server.py")],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
            env={
                **os.environ, "LD_PRELOAD": str(library), "DISK_PLAN": str(plan), "PYTHONWARNINGS": "ignore",
                "MPLBACKEND": "agg",
            },
        )  # fmt: skip
        atexit.register(self._server.kill)

    def command(
        self, words: tuple[str, ...], fault: tuple[int, int] | None = None, logging: bool = False
    ) -> tuple[int, str]:
        """Run a command and return its exit code and what it said; `fault` is an error and the operation it is of."""
        # Where there is no room, there is none for what comes later; the other errors pass.
        error, number = fault or (0, 0)
        last = 2**62 if error == errno.ENOSPC else number
        kinds = ERRORS.get(error, 0)
        self._log.unlink(missing_ok=True)
        self._plan[:] = _PLAN.pack(
            0, number, last, kinds, error, logging, os.fsencode(self.place), os.fsencode(self._log)
        )
        environment = {
            "TMPDIR": str(self.place / "tmp"), "VDFMU_CACHE_DIR": str(self.place / "cache"),
            "HOME": str(self.home / "user"), "ZIG_GLOBAL_CACHE_DIR": str(cache_folder() / COMPILER),
        }  # fmt: skip
        asked = {"words": words, "folder": str(self.place), "said": str(self._said), "environment": environment}
        assert self._server.stdin is not None and self._server.stdout is not None
        self._server.stdin.write(json.dumps(asked) + "\n")
        self._server.stdin.flush()
        child = int(self._server.stdout.readline())
        timer = threading.Timer(PATIENCE, os.killpg, (child, signal.SIGKILL))
        timer.start()
        code = int(self._server.stdout.readline())
        timer.cancel()
        self._plan[:] = bytes(_PLAN.size)
        return code, self._said.read_text(errors="replace")

    def operations(self) -> list[tuple[int, str]]:
        """Return kinds and names of the operations of the last command."""
        lines = self._log.read_text(errors="replace").splitlines()
        return [(int(kinds), operation) for kinds, _, operation in (line.partition(" ") for line in lines)]


@cache
def disk() -> Disk:
    """Return the server of this process."""
    return Disk()


@dataclass(frozen=True)
class Prepared:
    """What is known of a job: what is there before and after it, and where it can fail: error, operation, its name."""

    folder: Path
    after: dict[str, Any]
    faults: list[tuple[int, int, str]]


@cache
def prepared(name: str) -> Prepared:
    job, server = JOBS[name], disk()
    warm, folder, place = server.home / "warm", server.home / name, server.place
    shutil.rmtree(place, ignore_errors=True)
    place.mkdir()
    begin(place)
    warm.mkdir(mode=0o700, exist_ok=True)
    shutil.copytree(warm, place / "cache")
    for step in job.before:
        if callable(step):
            step(place)
        else:
            _succeeds(step)
    shutil.copytree(place, folder)
    _succeeds(job.words)
    after = files(place)
    for cached in (warm, folder / "cache"):
        shutil.rmtree(cached)
        shutil.copytree(place / "cache", cached)
    _begin_again(folder)
    _succeeds(job.words, logging=True)
    assert not (names := differing(files(place), after)), f"{name}: {names} are not the same twice"
    return Prepared(folder, after, list(_faults(server.operations())))


def _succeeds(words: tuple[str, ...], logging: bool = False) -> None:
    code, said = disk().command(words, logging=logging)
    assert code == 0, f"{' '.join(words)}: {said}"


def _begin_again(folder: Path) -> dict[str, Any]:
    shutil.rmtree(disk().place)
    shutil.copytree(folder, disk().place)
    return files(disk().place)


def _faults(operations: list[tuple[int, str]]) -> Iterator[tuple[int, int, str]]:
    """Yield each error with the operations that get it: of those alike the first and the last."""
    # Of temporary files, and of those of the cache, all with the same suffix are alike.
    for error, kinds in ERRORS.items():
        ends: dict[str, list[int]] = {}
        for number, text in enumerate((text for kind, text in operations if kind & kinds), 1):
            call, _, path = text.replace(f"{disk().place}/", "").partition(" ")
            alike = re.sub(r"[0-9a-f]{8,}|\d+", "#", path)
            if path.startswith(("tmp", "cache")):
                alike = f"{path[:3]} *{Path(path).suffix if Path(path).stem.isalpha() else ''}"
            alike = f"{call} {alike}"
            ends[alike] = [*ends.get(alike, [])[:1], number]
        for operation, numbers in ends.items():
            yield from ((error, number, operation) for number in numbers)


def failed(name: str, fault: tuple[int, int, str]) -> None:
    """Let an operation of a job fail: nothing is lost, nothing half done, and the same command succeeds then."""
    job, start, server = JOBS[name], prepared(name), disk()
    before = _begin_again(start.folder)
    error, number, operation = fault
    code, said = server.command(job.words, (error, number))
    report = f"{name}: {errno.errorcode[error]} at {number}, {operation}: exit code {code}: {said[-1500:]}"
    if not operation.startswith("unlink tmp"):  # the file itself that cannot be removed
        require_nothing_left(server.place, report)
    assert "the output cannot be written" not in said, report  # it was none of the output: a file, which has a name
    assert "Traceback" not in said and "Exception ignored" not in said, report
    require_whole(job, code, before, files(server.place), start.after, report)
    if code == 0:
        return
    assert code in (1, 2) and ("error" in said.lower() or "problem:" in said), report  # `check` lists problems
    again, words = server.command(job.words)
    report = f"{report}; again: exit code {again}: {words[-1500:]}"
    assert again == 0, report
    require_whole(job, again, before, files(server.place), start.after, report)
    raise VdfmuError(said)


def tried(number: int, folder: Path) -> None:
    """Let an operation of a command fail, at random."""
    name = list(JOBS)[number % len(JOBS)]
    failed(name, random.Random(f"disk {number}").choice(prepared(name).faults))


CORPORA = [Corpus("errors of single file operations of every command", 460, tried, quick=0, seconds=3 * PATIENCE)]
