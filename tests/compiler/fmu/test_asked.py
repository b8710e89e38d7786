"""What users of other exporters asked for, in issues that docs/tutorials/python-to-fmu.md names."""

import platform
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import fmpy
import numpy as np
import pytest

from vdfmu.arm.fmus import build_fmus

UNIT = '''
import numpy as np
from vdfmu.unit import Derivative, Input, Parameter, State, Unit

class Rotation(Unit):
    """Rotation of a vector, in numpy."""
    u = Input("1", 3)
    w = Parameter("1/s", 3, start=[0.3, -0.2, 0.5])
    x = State("1", 3)
    der_x = Derivative(x)

    def derivatives(self) -> None:
        self.der_x = np.cross(self.w, self.x) + np.linalg.norm(self.w) * self.u
'''
START = {f"x_0[{i}]": value for i, value in ((1, 1.0), (2, 0.0), (3, -1.0))}


@pytest.fixture(scope="module")
def fmu(tmp_path_factory):
    folder = tmp_path_factory.mktemp("asked")
    (folder / "rotation.py").write_text(UNIT)
    (path,) = build_fmus(None, folder, units=[folder / "rotation.py"], sources=False).values()
    return path


def rotated(t):
    w = np.array([0.3, -0.2, 0.5])
    axis, angle, x = w / np.linalg.norm(w), np.linalg.norm(w) * t, np.array([1.0, 0.0, -1.0])
    return np.cos(angle) * x + np.sin(angle) * np.cross(axis, x) + (1.0 - np.cos(angle)) * axis * (axis @ x)


@pytest.mark.parametrize("kind", ["CoSimulation", "ModelExchange"])
def test_a_class_in_numpy_runs_as_co_simulation_and_model_exchange(fmu, kind):
    """PyFMI 241, FMPy 390, pathsim 79, FMIExport.jl 10, PythonFMU 152."""
    result = fmpy.simulate_fmu(
        str(fmu), fmi_type=kind, stop_time=2.0, output_interval=0.1, start_values=START, relative_tolerance=1e-8
    )
    # the tolerance of the unit's solver is 1e-7, that of CVODE 1e-8 in each of 20 intervals
    assert np.abs([result[f"x[{i}]"][-1] for i in (1, 2, 3)] - rotated(2.0)).max() < 1e-6


@pytest.mark.skipif(
    platform.system() != "Linux" or not shutil.which("readelf"), reason="needs Linux and readelf: apt install binutils"
)
def test_the_library_needs_no_python(fmu):
    """PythonFMU 192."""
    with zipfile.ZipFile(fmu) as archive:
        (name,) = (name for name in archive.namelist() if name.endswith(".so"))
        library = archive.read(name)
        file = Path(archive.extract(name, fmu.parent))
    assert b"libpython" not in library and b"Py_Initialize" not in library
    dynamic = subprocess.run(["readelf", "-d", file], capture_output=True, text=True, check=True).stdout
    needed = {line.split("[")[1].rstrip("]\n").split(".")[0] for line in dynamic.splitlines() if "(NEEDED)" in line}
    assert needed <= {"libc", "libm", "ld-linux-x86-64"}


def test_it_is_loaded_many_times_in_one_process_and_nobody_reads_the_source(fmu):
    """PythonFMU 222: the second run crashed the importer, or its end."""
    script = f"""
import fmpy
runs = [fmpy.simulate_fmu({str(fmu)!r}, stop_time=0.1, output_interval=0.1, start_values={START})["x[1]"][-1]
        for _ in range(5)]
assert len(set(runs)) == 1
print("ended")
"""
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (0, "ended\n"), done.stderr
    # PythonFMU 234, PythonFMU3 22.
    with zipfile.ZipFile(fmu) as archive:
        for name in archive.namelist():
            assert not name.endswith((".py", ".pyc", ".c", ".h"))
            assert b"np.cross" not in archive.read(name)
