"""Native FMUs of this machine's own C compilers: the same positions as by zig, each the same bits twice."""

import re
import shutil

import fmpy
import numpy as np
import pytest

import vdfmu
from vdfmu.arm.fmus import build_fmus
from vdfmu.arm.robot import load_robot
from vdfmu.base import platforms
from vdfmu.base.compile import Compilation
from vdfmu.base.errors import FmuError, UsageError

OWN = [name for name in ("gcc", "clang") if shutil.which(name)]
SMALL = {"small.c": b"double twice(double x);\ndouble twice(double x) { return 2.0 * x; }\n"}


@pytest.fixture
def without_zig(monkeypatch):
    """Hide ziglang."""
    monkeypatch.setattr(platforms, "find_spec", lambda name: None)
    platforms.zig.cache_clear()
    platforms._compiler.cache_clear()
    yield
    platforms.zig.cache_clear()
    platforms._compiler.cache_clear()


@pytest.mark.heavy
@pytest.mark.skipif(not OWN, reason="this machine has no C compiler")
def test_a_compiler_of_the_machine_builds_without_ziglang(without_zig, monkeypatch, tmp_path):
    monkeypatch.setenv("VDFMU_CACHE_DIR", str(tmp_path / "cache"))
    here = platforms.this_platform()
    machine_compiler = platforms.compiler(here)
    assert platforms.native_available() and not machine_compiler.is_zig
    assert re.search(r"\d+\.\d+", platforms.compiler_version())
    robot = load_robot("planar_2dof")
    build_fmus(robot, tmp_path, units=["controller"], backend="native", folded=True)
    made = tmp_path / "PDController.fmu"
    assert machine_compiler.name in fmpy.read_model_description(made).generationTool
    with pytest.raises(FmuError, match=r"for other platforms need .* ziglang.*pip install .vdfmu\[native\]"):
        build_fmus(robot, tmp_path / "all", units=["controller"], backend="native", platforms="all", folded=True)


def test_a_chosen_program_that_is_no_compiler_is_refused(monkeypatch):
    monkeypatch.setenv("VDFMU_COMPILER", "true")
    with pytest.raises(UsageError, match="compiler must be zig or a gcc or clang for this machine, got 'true'"):
        platforms.native_available()


@pytest.mark.parametrize("program", OWN)
def test_a_choice_is_reported_and_has_its_own_objects(program, monkeypatch):
    job, here = Compilation("Small", SMALL, platforms.this_platform()), platforms.this_platform()
    by_default = job.key
    monkeypatch.setenv("VDFMU_COMPILER", program)
    assert program in platforms.compiler(here).name.lower()
    other = Compilation("Small", SMALL, here)
    assert other.key != by_default
    assert Compilation("Small", SMALL, here, zig=True).compiler.is_zig


@pytest.mark.heavy
@pytest.mark.parametrize("program", OWN)
def test_each_gives_the_bits_of_zig_and_the_same_fmus_twice(program, monkeypatch, tmp_path):
    """Without contraction and with elementary functions of its own the C has one meaning."""
    runs = {}
    for name in ("zig", program, f"{program} again"):
        monkeypatch.setenv("VDFMU_COMPILER", name.partition(" ")[0])
        monkeypatch.setenv("VDFMU_CACHE_DIR", str(tmp_path / name))
        runs[name] = run = vdfmu.run("planar_tracking", out=False, stop=1.0, reference=False)
        assert name.partition(" ")[0] in run.summary["compiler"].lower()
    q = {name: np.stack([run["plant.q[1]"], run["plant.q[2]"]]) for name, run in runs.items()}
    assert np.ptp(q["zig"]) > 0.1  # the arm moves
    assert q["zig"].tobytes() == q[program].tobytes() == q[f"{program} again"].tobytes()
    fmus = [tmp_path / name / "fmus" for name in (program, f"{program} again")]
    first, second = ({path.name: path.read_bytes() for path in folder.iterdir()} for folder in fmus)
    assert first and first == second
