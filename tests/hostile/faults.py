"""Disks that are full, folders and files that cannot be written or read, and names that lead nowhere."""

import os
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from tests.hostile.commands import BUILD, OTHER, PATIENCE, RUN, SIMULATE, SSP, Process, begun, results
from tests.hostile.table import Corpus
from vdfmu.base.errors import VdfmuError

_SSP = (*SSP, "out/arm.ssp")
_ROOT = os.geteuid() == 0
_PLAIN = ("setpriv", "--bounding-set=-dac_override,-dac_read_search", "--inh-caps=-all") if _ROOT else ()
"""A program that starts another with the rights that modes give, which root has not otherwise."""
LONG = "n" * 300


def _small(folder: str, room: int) -> tuple[str, ...]:
    """Return a program that starts another with a disk for a folder that has little room [kB] left."""
    # What it holds then is copied out of it.
    script = (
        f"mkdir -p {folder} && cp -a {folder} kept && "
        f"mount -t tmpfs -o size=$(($(du -sk kept | cut -f1) + {room}))k none {folder} && "
        f'cp -a kept/. {folder} && mkdir after && "$@"; code=$?; cp -a {folder}/. after && exit $code'
    )
    return ("unshare", "-rm", "sh", "-c", script, "sh")


def _limited(size: int) -> tuple[str, ...]:
    return ("prlimit", f"--fsize={size}")


_READ_ONLY = ("unshare", "-rm", "sh", "-c", 'mount --bind out out && mount -o remount,bind,ro out && exec "$@"', "sh")
_GONE = ("sh", "-c", 'mkdir gone && cd gone && rmdir ../gone && exec "$@"', "sh")
_NO_OUTPUT = ("sh", "-c", 'exec "$@" > /dev/full', "sh")


@dataclass(frozen=True)
class Fault:
    """A fault: what is changed in the folder before a command, the program that starts it, and how it must end."""

    name: str
    words: tuple[str, ...]
    earlier: tuple[str, ...] = ()
    change: Callable[[Path], object] = lambda place: None
    before: tuple[str, ...] = ()
    environment: tuple[tuple[str, str], ...] = ()
    harmless: bool = False  # the command does its work all the same
    named: str = "out"  # what the message names
    results: str = "out"  # where the results are in the end


def _mode(name: str, mode: int) -> Callable[[Path], object]:
    return lambda place: (place / name).chmod(mode)


def _file(name: str) -> Callable[[Path], object]:
    def change(place: Path) -> None:
        shutil.rmtree(place / name, ignore_errors=True)
        (place / name).write_text("mine")

    return change


def _folder(name: str) -> Callable[[Path], object]:
    def change(place: Path) -> None:
        (place / name).unlink(missing_ok=True)
        (place / name / "mine").mkdir(parents=True)

    return change


def _link(name: str, target: str) -> Callable[[Path], object]:
    def change(place: Path) -> None:
        if (place / name).exists():
            (place / name).unlink()
        (place / name).symlink_to(target)

    return change


_COMMANDS = {
    "ssp": (_SSP, (*_SSP, *OTHER)), "build": (BUILD, (*BUILD, *OTHER)),
    "simulate": ((*SIMULATE, "2"), (*SIMULATE, "0.1")), "run": ((*RUN, "2", "--no-reference"), (*RUN, "0.1")),
}  # fmt: skip
"""Each command, and the one that wrote the results before."""
_WRITTEN = {"ssp": 400_000, "build": 50_000, "simulate": 700_000, "run": 400_000}
"""Bytes of which each command writes more into one file."""
_PYTHON = (*RUN, "0.02", "--no-reference", "--backend", "python")
_CACHE = (("VDFMU_CACHE_DIR", "cache"),)

FAULTS = (
    *(Fault("a file for the folder", words, (), _file("out")) for words, _ in _COMMANDS.values()),
    *(Fault("full disk", *both, before=_small("out", 40), results="after") for both in _COMMANDS.values()),
    *(Fault("large files fail", *_COMMANDS[name], before=_limited(size)) for name, size in _WRITTEN.items()),
    *(Fault("folder without right", *both, _mode("out", 0o555), _PLAIN) for both in _COMMANDS.values()),
    *(Fault("read-only disk", *both, before=_READ_ONLY) for both in _COMMANDS.values()),
    Fault("a folder for the file", _SSP, (), _folder("out/arm.ssp")),
    Fault("a folder for a result", *_COMMANDS["simulate"], _folder("out/results.csv")),
    Fault("a folder for an FMU", *_COMMANDS["build"], _folder("out/Plant.fmu")),
    Fault("a link to nowhere", _COMMANDS["run"][0], (), _link("out", "nowhere/at/all")),
    Fault("a link to itself", BUILD, (), _link("out", "out")),
    Fault("a package nowhere", _COMMANDS["simulate"][0], (), _link("arm.ssp", "nowhere.ssp"), named="arm.ssp"),
    Fault("a package without right", *_COMMANDS["simulate"], _mode("arm.ssp", 0), _PLAIN, named="arm.ssp"),
    Fault("a device for the package", *_COMMANDS["simulate"], _link("arm.ssp", "/dev/zero"), named="arm.ssp"),
    Fault("a device for the folder", ("run", "planar_tracking", "--out", "/dev/full"), named="/dev/full"),
    Fault("a device for the file", (*SSP, "/dev/full"), named="/dev/full"),
    Fault("a name too long", ("run", "planar_tracking", "--out", LONG), named="too long"),
    Fault("a name too long", (*SSP, f"{LONG}.ssp"), named="too long"),
    Fault("no working folder", (*RUN, "0.1"), before=_GONE, named="The working directory was deleted"),
    Fault("no working folder", BUILD, before=_GONE, named="The working directory was deleted"),
    Fault("output to a full disk", ("robot", "list"), before=_NO_OUTPUT, named="output"),
    Fault("full temporary folder", *_COMMANDS["run"], before=_small("tmp", 200), named="tmp"),
    Fault("full temporary folder", *_COMMANDS["simulate"], before=_small("tmp", 200), named="tmp"),
    Fault("no temporary folder", _COMMANDS["run"][0], environment=(("TMPDIR", "/nowhere"),), harmless=True),
    Fault("a file for the cache", _PYTHON, (), _file("cache"), environment=_CACHE, harmless=True),
    Fault(
        "cache without right", _PYTHON, (), lambda place: (place / "cache").mkdir(mode=0o555), _PLAIN,
        _CACHE, harmless=True,
    ),
    Fault("full cache", _PYTHON, before=_small("cache", 100), environment=_CACHE, harmless=True),
)  # fmt: skip


def met(number: int, folder: Path) -> None:
    """Start a command that meets a fault; it says so, and leaves what was there."""
    fault = FAULTS[number % len(FAULTS)]
    place = folder / "place"
    shutil.copytree(begun(fault.earlier), place, symlinks=True)
    fault.change(place)
    before = results(place)
    process = Process(place, fault.words, before=fault.before, **dict(fault.environment))
    process.end()
    code, said = process.process.returncode, process.said
    report = f"{fault.name}, {' '.join(fault.words)}: exit code {code}: {said[-1500:]}"
    assert "Traceback" not in said, report
    assert process.left() == [], report
    if fault.harmless:
        assert code == 0, report
        assert "results.csv" in results(place), report
        return
    assert code in (1, 2) and "error" in said.lower() and fault.named in said, report
    after = results(place, fault.results)
    assert after == before, f"results are lost: {report}"
    raise VdfmuError(said)


CORPORA = [Corpus("faults of disk and permission", len(FAULTS), met, quick=2, seconds=3 * PATIENCE)]
