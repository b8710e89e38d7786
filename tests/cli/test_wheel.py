"""The wheel works alone: built, installed into an empty environment, run from an empty folder."""

import json
import subprocess
import sys
import venv
from pathlib import Path

import pytest

import vdfmu

ROOT = Path(vdfmu.__file__).resolve().parents[1]


@pytest.mark.heavy
def test_the_wheel_alone_gives_the_same_tracking_run(tmp_path):
    pip = [sys.executable, "-m", "pip", "--quiet", "--disable-pip-version-check"]
    build = [*pip, "wheel", "--no-deps", "--wheel-dir", tmp_path / "dist", ROOT]
    subprocess.run(build, check=True)
    (wheel,) = (tmp_path / "dist").glob("vdfmu-*.whl")
    venv.create(tmp_path / "env", with_pip=False)
    python = tmp_path / "env" / ("Scripts" if sys.platform == "win32" else "bin") / "python"
    install = [*pip, "--python", python, "install", "--no-compile", "-c", ROOT / "constraints.txt", wheel]
    subprocess.run(install, check=True)

    empty = tmp_path / "empty"
    empty.mkdir()
    command = [python.parent / "vdfmu", "run", "tracking", "--stop", "2", "--no-reference"]
    done = subprocess.run(command, cwd=empty, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    installed = json.loads((empty / "results" / "tracking" / "summary.json").read_text())
    here = vdfmu.run("tracking", out=tmp_path / "here", stop=2.0, reference=False).summary
    for key in ("rms_position_error_deg", "max_position_error_deg", "rms_torque_compensation_error_nm"):
        assert installed[key] == here[key]  # the same arithmetic: equal to the last bit

    # the example units are in it
    command = [python.parent / "vdfmu", "unit", "examples"]
    assert subprocess.run(command, cwd=empty, check=False).returncode == 0
    assert {file.name for file in (empty / "units").iterdir()} == {
        file.name for file in (ROOT / "examples" / "units").iterdir() if file.is_file()
    }

    # a user's own file given by path wins over a shipped one of the same name
    shipped = (ROOT / "models" / "scenarios" / "planar_tracking.toml").read_text()
    (empty / "planar_tracking.toml").write_text(shipped.replace("planar_tracking", "my_own"))
    command = [python.parent / "vdfmu", "run", "planar_tracking.toml", "--no-reference", "--stop", "0.1"]
    done = subprocess.run(command, cwd=empty, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert (empty / "results" / "my_own" / "summary.json").exists()
