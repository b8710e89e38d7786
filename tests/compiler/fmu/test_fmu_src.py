"""The files in ``fmu_src``, built by pythonfmu's own command, and run by nothing but fmpy."""

import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest

from vdfmu.arm.fmus import build_fmus
from vdfmu.arm.robot import load_robot
from vdfmu.base.files import data_path
from vdfmu.system.package.write import write_ssp
from vdfmu.system.scenario import load_scenario

FILES = {
    "Plant": "plant.py", "Feedforward": "feedforward.py", "PDController": "pd_controller.py",
    "Trajectory": "trajectory.py",
}  # fmt: skip
EXAMPLE = Path(__file__).resolve().parents[3] / "examples" / "fmpy_master.py"


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    folder = tmp_path_factory.mktemp("pythonfmu")
    code = "import sys\nfrom pythonfmu.__main__ import cli_main\nfor file in sys.argv[1:]:\n"
    code += "    sys.argv = ['pythonfmu', 'build', '-f', file]\n    cli_main()"
    files = [data_path("fmu_src") / file for file in FILES.values()]
    subprocess.run([sys.executable, "-c", code, *files], cwd=folder, check=True)
    return folder


def run(folder: Path) -> dict[str, np.ndarray]:
    """Return the signals of the loop of the four FMUs, from a process of its own."""
    fmus = {name.removeprefix("PD").lower(): folder / f"{name}.fmu" for name in FILES}
    write_ssp(load_scenario("tracking"), fmus, folder / "tracking.ssp")
    code = (
        f"import sys, numpy; sys.path.insert(0, {str(EXAMPLE.parent)!r}); from fmpy_master import simulate; "
        f"numpy.savez('out.npz', **simulate('tracking.ssp', stop=0.02, step=1e-3))"
    )
    subprocess.run([sys.executable, "-c", code], cwd=folder, check=True)
    return dict(np.load(folder / "out.npz"))


@pytest.mark.heavy
def test_the_files_become_fmus_by_pythonfmu_that_give_the_bits_of_those_of_vdfmu(built, tmp_path):
    assert {file.stem for file in built.glob("*.fmu")} == {*FILES}
    units = [Path(file).stem.removeprefix("pd_") for file in FILES.values()]
    fmus = build_fmus(load_robot("manipulator_6dof"), tmp_path, units=units, backend="python")
    for unit, path in zip(FILES, fmus.values(), strict=True):  # their script is the file
        with zipfile.ZipFile(path) as archive:
            (script,) = [name for name in archive.namelist() if name.endswith("_slave.py")]
            assert archive.read(script) == (data_path("fmu_src") / FILES[unit]).read_bytes()
    ours, theirs = run(tmp_path), run(built)
    assert ours.keys() == theirs.keys() and np.ptp(theirs["plant.tau_s[1]"]) > 0.0
    for name, values in ours.items():
        assert np.array_equal(values, theirs[name]), name


@pytest.mark.heavy
def test_an_fmu_of_other_sources_is_refused_by_name(built, tmp_path):
    with zipfile.ZipFile(built / "Plant.fmu") as archive, zipfile.ZipFile(tmp_path / "Plant.fmu", "w") as changed:
        for name in archive.namelist():
            content = archive.read(name)
            if name == "modelDescription.xml":
                content = content.replace(b'guid="{', b'guid="{0')
            changed.writestr(name, content)
    words = ["-c", "import fmpy; fmpy.simulate_fmu(fmpy.extract('Plant.fmu'), stop_time=0.01)"]
    done = subprocess.run([sys.executable, *words], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert "Plant.fmu does not match the vdfmu of this Python" in done.stderr
