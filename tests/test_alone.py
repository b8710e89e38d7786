"""Each package works without those above it, and a run without the features that it does not use."""

import os
import shutil
import subprocess
import sys
import sysconfig
import venv
import zipfile
from collections.abc import Sequence
from importlib.metadata import distribution
from pathlib import Path

import numpy as np
import pytest

from tests.engine.reference import models
from vdfmu.base.sources import imported
from vdfmu.engine.run import Results

ROOT = Path(__file__).parents[1]
BUILD = """
from pathlib import Path
from vdfmu.compiler.fmu.build import build_units
from vdfmu.compiler.unit.load import load_units

unit = load_units(Path("low_pass.py"))["low_pass"]
form = {"backend": "native", "fmi_version": "3.0", "platforms": None, "sources": True}
build_units(None, ".", [unit], parameters={}, target="fmi", precision="double", step=1e-3, **form)
"""
RUN = """
import numpy as np
import vdfmu
from vdfmu.engine.run import simulate

start = {"first.y_0": 1.0}
results = simulate("two.ssp", stop=0.5, step=1e-3, algorithm="jacobi", parameters=start)
np.save("y.npy", np.stack([results.time, results["second.y"]]))
"""
SSD = """<?xml version="1.0" encoding="UTF-8"?>
<SystemStructureDescription xmlns="http://ssp-standard.org/SSP1/SystemStructureDescription"
 xmlns:c="http://ssp-standard.org/SSP1/SystemStructureCommon" version="1.0" name="two">
<System name="two"><Elements>{components}</Elements>
<Connections><Connection startElement="first" startConnector="y" endElement="second" endConnector="u"/></Connections>
</System></SystemStructureDescription>"""
COMPONENT = """<Component name="{name}" type="application/x-fmu-sharedlibrary" source="resources/LowPass.fmu">
<Connectors><Connector name="u" kind="input"><c:Real/></Connector>
<Connector name="y" kind="output"><c:Real/></Connector>
</Connectors></Component>"""


def without(folder: Path, left_out: Sequence[str]) -> None:
    """Copy the package and its data into a folder, without some of its parts."""
    for name in ("vdfmu", "fmu_src", "models", "ssp"):
        shutil.copytree(ROOT / name, folder / name, ignore=shutil.ignore_patterns("__pycache__"))
    for name in left_out:
        shutil.rmtree(folder / "vdfmu" / name)


def python(folder: Path, *arguments: str) -> str:
    env = {**os.environ, "PYTHONPATH": str(folder)}
    done = subprocess.run([sys.executable, *arguments], cwd=folder, env=env, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.mark.heavy
def test_a_unit_becomes_an_fmu_and_two_run_together_without_arm_system_study_and_cli(tmp_path):
    without(tmp_path, ["arm", "system", "study", "cli"])
    shutil.copy(ROOT / "examples" / "units" / "low_pass.py", tmp_path)
    python(tmp_path, "-c", BUILD)
    components = "".join(COMPONENT.format(name=name) for name in ("first", "second"))
    with zipfile.ZipFile(tmp_path / "two.ssp", "w") as package:
        package.writestr("SystemStructure.ssd", SSD.format(components=components))
        package.write(tmp_path / "LowPass.fmu", "resources/LowPass.fmu")
    python(tmp_path, "-c", RUN)
    t, y = np.load(tmp_path / "y.npy")
    a, expected = np.exp(-1e-3 / 0.1), np.zeros(len(t))
    for k in range(len(t) - 1):  # jacobi holds the value of the first over each step
        expected[k + 1] = a * expected[k] + (1.0 - a) * a**k
    # the solver's tolerance of 1e-7 in each step, which the filter forgets in a hundred of them
    np.testing.assert_allclose(y, expected, rtol=0, atol=1e-5)


@pytest.mark.heavy
def test_tracking_runs_without_the_features_beside_it(tmp_path):
    without(tmp_path, ["extras", "arm/units/laws", "study/sweeps"])
    said = python(tmp_path, "-m", "vdfmu.cli", "run", "tracking", "--no-simulate", "--out", "results")
    assert "6 of 6 checks pass" in said


@pytest.mark.heavy
def test_no_build_imports_efmi_and_the_digest_of_an_own_fmu_knows_no_arm():
    code = "import sys, vdfmu.arm.fmus, vdfmu.study.runs; print([m for m in sys.modules if 'efmi' in m])"
    assert python(ROOT, "-c", code).strip() == "[]"
    # Else a comment in a motion changes the GUID of a filter.
    assert not [name for name in imported("compiler") if name.startswith(("arm", "system", "study", "cli"))]


JOINS = ("numpy", "fmpy", "lxml", "attrs", "msgpack", "click", "rich", "platformdirs")
"""All packages that joining and running FMUs needs."""


def small_environment(folder: Path) -> Path:
    """Make an environment that has only `JOINS` and the project, as links; return its folder of packages."""
    venv.create(folder, symlinks=True)
    packages = Path(sysconfig.get_path("purelib", "venv", {"base": str(folder)}))
    for name in JOINS:
        for top in {file.parts[0] for file in distribution(name).files or ()} - {"..", "__pycache__"}:
            (packages / top).symlink_to(str(distribution(name).locate_file(top)))
    for name in ("vdfmu", "fmu_src", "models", "ssp"):
        (packages / name).symlink_to(ROOT / name)
    return packages


def size_of(folder: Path) -> int:
    """Return the size of the files below a folder, with those of links, without Python's caches."""
    files = (Path(place, name) for place, _, names in os.walk(folder, followlinks=True) for name in names)
    return sum(file.stat().st_size for file in files if "__pycache__" not in file.parts)


def test_fmus_are_joined_and_run_in_an_environment_without_casadi_scipy_and_matplotlib(tmp_path):
    lag = models.build(models.LAG, "2.0", tmp_path)
    packages = small_environment(tmp_path / "env")
    assert size_of(packages) < 120e6  # 100 MB on Linux, half of which are numpy and its libraries
    env = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}

    def run(*arguments: str) -> subprocess.CompletedProcess[str]:
        words = [str(tmp_path / "env" / "bin" / "python"), *arguments]
        return subprocess.run(words, cwd=tmp_path, env=env, capture_output=True, text=True, check=False)

    for name in ("casadi", "scipy", "matplotlib"):
        assert f"No module named '{name}'" in run("-c", f"import {name}").stderr
    words = [f"a={lag}", f"b={lag}", "--connect", "a.x=b.u", "--set", "a.u=1", "--step", "0.01", "--stop", "1"]
    done = run("-m", "vdfmu.cli", "run", *words, "--out", "run")
    assert done.returncode == 0 and not done.stderr, done.stdout + done.stderr
    assert {file.name for file in (tmp_path / "run").iterdir()} >= {"report.html", "results.csv", "system.ssp"}
    assert Results.read(tmp_path / "run" / "results.csv")["a.x"][-1] == pytest.approx(1 - np.exp(-1), rel=1e-2)  # Euler
