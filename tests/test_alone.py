"""Each package works without those above it, and a run without the features that it does not use."""

import os
import shutil
import subprocess
import sys
import zipfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from tests.engine.reference import models
from vdfmu.base.sources import imported

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


JOIN = """
import sys

import vdfmu


class Missing:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in ("casadi", "scipy", "matplotlib"):
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)


sys.meta_path.insert(0, Missing())
system = vdfmu.connect({"a": "Lag_2.fmu", "b": "Lag_2.fmu"}, {"a.x": "b.u"}, step=1e-2, stop=1.0)
print(system.run(parameters={"a.u": 1.0})["a.x"][-1])
"""


def test_fmus_are_connected_and_run_without_casadi_scipy_and_matplotlib(tmp_path):
    models.build(models.LAG, "2.0", tmp_path)
    assert float(python(tmp_path, "-c", JOIN)) == pytest.approx(1.0 - np.exp(-1.0), rel=1e-2)  # Euler, 100 steps
