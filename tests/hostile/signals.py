"""Ctrl-C, SIGTERM and SIGHUP at random moments of every command."""

from __future__ import annotations

import random
import shutil
import tempfile
import time
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from vdfmu.errors import VdfmuError

from .commands import BUILD, OTHER, PATIENCE, RUN, SIGNALS, SIMULATE, SSP, Process, begun, done, results
from .table import Corpus


@dataclass(frozen=True)
class Command:
    """A command whose results are in ``out``; `earlier` are the arguments of the one that wrote there before."""

    words: tuple[str, ...]
    earlier: tuple[str, ...] = ()
    cold: bool = False  # with an empty cache: all is traced and compiled


_CONTAINER = ("container", "planar_tracking", "--out", "out/arm.fmu")
COMMANDS = (
    Command(("models", "show", "manipulator_6dof")),
    Command(("models", "list")),
    Command(("check", "fmus/Plant.fmu", "--json")),
    Command(("check", "arm.ssp")),
    Command(_CONTAINER, (*_CONTAINER, *OTHER), cold=True),
    Command(_CONTAINER, (*_CONTAINER, *OTHER)),
    Command((*SSP, "out", "--format", "osp"), (*SSP, "out", "--format", "osp", *OTHER)),
    Command((*SSP, "out/arm.ssp"), (*SSP, "out/arm.ssp", *OTHER)),
    Command(BUILD, (*BUILD, *OTHER), cold=True),
    Command(BUILD, (*BUILD, *OTHER)),
    Command((*SIMULATE, "1.0", "--isolate"), (*SIMULATE, "0.1")),
    Command((*SIMULATE, "1.0"), (*SIMULATE, "0.1")),
    Command(("run", "contrast", "--out", "out"), (*RUN, "0.1")),
    Command((*RUN, "0.05", "--backend", "python"), (*RUN, "0.1")),
    Command((*RUN, "0.2"), (*RUN, "0.1"), cold=True),
    Command((*RUN, "0.2"), (*RUN, "0.1")),
)


@dataclass(frozen=True)
class Known:
    """What is known of a command: its folder before, how long it takes [s], and the results before and after it."""

    folder: Path
    seconds: float
    before: dict[str, object]
    after: dict[str, object]


@cache
def known(command: Command) -> Known:
    """Run a command to its end, after the earlier one."""
    folder = begun(command.earlier)
    if not command.cold:  # so that all it needs is in the cache
        _again(folder, command)
    after, seconds = _again(folder, command)
    before = results(folder)
    assert before != after or not command.earlier
    return Known(folder, seconds, before, after)


def _again(folder: Path, command: Command) -> tuple[dict[str, object], float]:
    with tempfile.TemporaryDirectory(prefix="vdfmu_hostile_") as name:
        copy = Path(name, "copy")
        shutil.copytree(folder, copy)
        seconds = done(copy, command.words, cold=command.cold)
        return results(copy), seconds


def stopped(number: int, folder: Path) -> None:
    """Send a signal at a random moment; the command ends at once, and what it leaves is whole."""
    dice = random.Random(f"signal {number}")
    command = COMMANDS[number % len(COMMANDS)]
    start = known(command)
    place = folder / "place"
    shutil.copytree(start.folder, place)
    which, moment = dice.choice(SIGNALS), dice.uniform(0.0, 1.0) * start.seconds
    process = Process(place, command.words, cold=command.cold)
    time.sleep(moment)
    listened = process.process.poll() is None and process.listens()
    process.process.send_signal(which)
    seconds, most = process.end()
    code, said, found = process.process.returncode, process.said, results(place)
    told = (
        f"{which.name} after {moment:.2f} s of {' '.join(command.words)}: exit code {code} after {seconds:.2f} s: "
        f"{said[-800:]}"
    )
    assert seconds < most, f"expected at most {most:.1f} s: {told}"
    assert process.left() == [], told
    assert not list(place.glob("**/*.tmp")), told
    if code == 0:
        assert found == start.after, f"not complete: {told}"
        return
    assert _whole(command, found, start), f"results are lost: {told}"
    if listened:
        assert code == 128 + which and "Traceback" not in said, told
        raise VdfmuError(said)
    # Python that has read nothing of this project yet ends with 1 and its own words where it imports its first modules
    assert code in (-which, 128 + which) or (code == 1 and "vdfmu" not in said), told


def _whole(command: Command, found: dict[str, object], start: Known) -> bool:
    """Whether the results are those before or those after; of several FMUs each."""
    if command.words[0] in ("build", "ssp"):
        return found.keys() == start.before.keys() and all(
            content in (start.before[name], start.after[name]) for name, content in found.items()
        )
    return found in (start.before, start.after)


CORPORA = [Corpus("signals at random moments of every command", 102, stopped, quick=4, seconds=3 * PATIENCE)]
