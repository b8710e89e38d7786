"""Commands where names are not UTF-8, or memory is short."""

import random
import shutil
from pathlib import Path

from tests.hostile.commands import PATIENCE, Process
from tests.hostile.jobs import JOBS, files, require_nothing_left, require_whole
from tests.hostile.signals import prepared
from tests.hostile.table import Corpus
from vdfmu.base.errors import VdfmuError

_NAMES = list(JOBS)
_OUT = "out\udcff"  # the byte 0xff, which is not UTF-8
_LIMITS = (150, 300, 600, 700, 900, 1200)
"""Address space [MB]: from where Python cannot start to where most commands run.

Between 300 and 600 the libraries load, and then OpenBLAS waits for its buffer for ever: that is not tried.
"""


def _ended(process: Process, report: str) -> tuple[int, str]:
    """Wait for a command, which says in words what is wrong, and return its exit code and output."""
    process.end()
    code, said = process.process.returncode, process.said
    report = f"{report}: exit code {code}: {said[-1500:]}"
    assert code in (0, 1, 2) and "Traceback" not in said and "Exception ignored" not in said, report
    assert code == 0 or "error" in said.lower(), report
    return code, report


def named(number: int, folder: Path) -> None:
    """Run a command in, and into, a folder whose name is not UTF-8."""
    name = _NAMES[number % len(_NAMES)]
    job = JOBS[name]
    start = prepared(job)
    place = folder / "at\udcff"
    shutil.copytree(start.folder, place)
    (place / "out").rename(place / _OUT)
    process = Process(place, [_renamed(word) for word in job.words])
    code, report = _ended(process, f"{name} into a name that is not UTF-8")
    (place / _OUT).rename(place / "out")
    require_nothing_left(place, report)
    require_whole(job, code, start.before, files(place), start.after, report)
    if code:
        raise VdfmuError(report)


def _renamed(word: str) -> str:
    return _OUT + word[3:] if word == "out" or word.startswith("out/") else word


def short_of_memory(number: int, folder: Path) -> None:
    """Run a command in little memory: it is done, or it says so, and nothing is lost."""
    name = _NAMES[number % len(_NAMES)]
    job, limit = JOBS[name], random.Random(f"memory {number}").choice(_LIMITS)
    start = prepared(job)
    place = folder / "place"
    shutil.copytree(start.folder, place)
    process = Process(place, job.words, before=("prlimit", f"--as={limit * 2**20}"), OPENBLAS_NUM_THREADS="1")
    process.end()
    code, said = process.process.returncode, process.said
    report = f"{name} in {limit} MB: exit code {code}: {said[-1500:]}"
    require_whole(job, code, start.before, files(place), start.after, report)
    if code >= 0:  # a library that crashes for want of memory leaves the temporary folder
        require_nothing_left(place, report)
    if code > 0 and "Traceback" not in said:
        assert code in (1, 2) and "error" in said.lower(), report
        raise VdfmuError(said)
    # Python cannot load its own modules there, or ends before a line of this project has run
    assert code <= 0 or limit < 600, report


CORPORA = [
    Corpus("commands into names that are not UTF-8", len(JOBS), named, quick=0, seconds=PATIENCE),
    Corpus("commands short of memory", 4 * len(JOBS), short_of_memory, quick=0, seconds=PATIENCE),
]
