"""Units of a user under the sanitizers: sampled states, choices, events, none of the robot's parameters."""

from pathlib import Path

import fmpy
import pytest

from tests.compiler.native.conftest import fuzz_program, run, sanitized_objects
from vdfmu.arm.fmus import build_fmus

FOLDER = Path(__file__).parents[1]
UNITS = {"fmu/own_units.py": ("Words", "Encoder", "Mixer"), "eventful.py": ("Clutch", "Relay", "Endless", "Ball")}


@pytest.mark.heavy
@pytest.mark.parametrize("unit", [f"{file}:{name}" for file, names in UNITS.items() for name in names])
def test_random_calls_find_nothing(tmp_path, unit, version):
    """Not in steps over several samples or events, in saved states or in a call that fails, either."""
    (path,) = build_fmus(None, tmp_path, units=[f"{FOLDER}/{unit}"], backend="native", fmi_version=version).values()
    sources = Path(fmpy.extract(path, tmp_path / "unpacked")) / "sources"
    (tmp_path / "objects").mkdir()
    objects = sanitized_objects(sources, tmp_path / "objects")
    target = fuzz_program(sources, objects, version, tmp_path / "fuzz")
    for seed in (1, 2, 3):
        assert run([target, 10_000, seed], ASAN_OPTIONS="detect_leaks=1", seconds=600) == "10000 calls\n"
