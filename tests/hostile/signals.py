"""Ctrl-C, SIGTERM and SIGHUP at random moments of every command."""

import fcntl
import random
import shutil
import tempfile
import time
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from tests.hostile.commands import BUILD, OTHER, PATIENCE, RUN, SIGNALS, SSP, Process, done, workshop
from tests.hostile.jobs import JOBS, Job, begin, files, require_nothing_left, require_whole
from tests.hostile.table import Corpus
from vdfmu.base.errors import VdfmuError

_PACKAGE = (*SSP, "arm.ssp")
COMMANDS = (
    *JOBS.values(),
    Job(BUILD, ((*BUILD, *OTHER),), cold=True),
    Job((*RUN, "0.2"), ((*RUN, "0.1"),), together=True, cold=True),
    Job((*RUN, "0.05", "--backend", "python"), ((*RUN, "0.1"),), together=True),
    Job(
        ("run", "arm.ssp", "--out", "out", "--stop", "1.0", "--isolate"), (_PACKAGE, (*RUN, "0.1")), together=True
    ),
    Job(("doctor", "--clear-cache"), cold=True),
    *(
        Job(tuple(words.split()))
        for words in (
            "robot list", "robot show manipulator_6dof", 
            "unit examples out", "doctor", "doctor --cache",
        )
    ),
)  # fmt: skip


@dataclass(frozen=True)
class Prepared:
    """What is known of a command: its folder before, how long it takes [s], and the files before and after it."""

    folder: Path
    seconds: float
    before: dict[str, object]
    after: dict[str, object]


@cache
def prepared(job: Job) -> Prepared:
    folder = Path(tempfile.mkdtemp(dir=workshop()))
    begin(folder)
    for step in job.before:
        if callable(step):
            step(folder)
        else:
            done(folder, step)
    if not job.cold:  # so that all it needs is in the cache
        _again(folder, job)
    after, seconds = _again(folder, job)
    return Prepared(folder, seconds, files(folder), after)


def _again(folder: Path, job: Job) -> tuple[dict[str, object], float]:
    with tempfile.TemporaryDirectory(prefix="vdfmu_hostile_") as name:
        copy = Path(name, "copy")
        shutil.copytree(folder, copy)
        seconds = done(copy, job.words, cold=job.cold)
        return files(copy), seconds


def stopped(number: int, folder: Path) -> None:
    """Send a signal at a random moment; the command ends at once, and what it leaves is whole."""
    dice = random.Random(f"signal {number}")
    job = COMMANDS[number % len(COMMANDS)]
    start = prepared(job)
    place = folder / "place"
    shutil.copytree(start.folder, place)
    which, moment = dice.choice(SIGNALS), dice.uniform(0.0, 1.0) * start.seconds
    process = Process(place, job.words, cold=job.cold)
    time.sleep(moment)
    listened = process.process.poll() is None and process.listens()
    process.process.send_signal(which)
    seconds, most = process.end()
    code, said = process.process.returncode, process.said
    report = (
        f"{which.name} after {moment:.2f} s of {' '.join(job.words)}: exit code {code} after {seconds:.2f} s: "
        f"{said[-800:]}"
    )
    assert seconds < most, f"expected at most {most:.1f} s: {report}"
    assert process.left() == [], report
    require_nothing_left(place, report)
    require_whole(job, code, start.before, files(place), start.after, report)
    for lock in place.glob("out/.lock"):
        with lock.open() as file:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    loud = "Traceback" in said or "Exception ignored" in said
    # Python's own import of modules may drop Ctrl-C before this project listens
    assert not loud or not (listened or (code == 0 and "vdfmu/" in said.partition("out/")[0])), report
    if code == 0:
        return
    if listened:
        assert code == 128 + which, report
        raise VdfmuError(said)
    # Python that has read nothing of this project yet ends with 1 and its own words where it imports its first modules
    assert code in (-which, 128 + which) or (code == 1 and "vdfmu" not in said), report


CORPORA = [
    Corpus("signals at random moments of every command", 8 * len(COMMANDS), stopped, quick=4, seconds=3 * PATIENCE)
]
