"""FMI calls in random order and with random arguments, on the native FMUs as the sanitizers of gcc compile them."""

import tempfile
import zipfile
from functools import cache
from pathlib import Path

from tests.compiler.native.conftest import fuzz_program, run, sanitized_objects
from tests.hostile.commands import workshop
from tests.hostile.table import Corpus
from vdfmu.arm.fmus import build_fmus
from vdfmu.arm.robot import load_robot

CALLS = 25_000
UNITS = (
    ("controller", "3.0"), ("plant", "2.0"), ("plant", "3.0"), ("feedforward", "2.0"), ("feedforward", "3.0"),
)  # fmt: skip


@cache
def _program(unit: str, version: str) -> Path:
    folder = Path(tempfile.mkdtemp(dir=workshop()))
    robot = load_robot("planar_2dof")
    fmu = build_fmus(robot, folder, units=[unit], backend="native", fmi_version=version, folded=True)[unit]
    with zipfile.ZipFile(fmu) as archive:
        archive.extractall(folder)
    objects = sanitized_objects(folder / "sources", folder)
    return fuzz_program(folder / "sources", objects, version, folder / "fuzz")


def called(number: int, folder: Path) -> None:
    """Make calls; a wrong access, undefined behaviour, a leak or an instance that a refused call changed ends them."""
    program, seed = _program(*UNITS[number % len(UNITS)]), 1000 + number
    said = run([program, CALLS, seed], ASAN_OPTIONS="detect_leaks=1", seconds=300)
    assert said == f"{CALLS} calls\n", said


CORPORA = [Corpus("FMI calls under sanitizers", 40, called, quick=1, seconds=120.0, each=CALLS)]
