"""The package works alone: installed into an empty environment as the README says, run from an empty folder."""

import json
import shutil
import subprocess
import sys

import pytest

import vdfmu
from tests.docs.pages import ROOT, readme_blocks, run_process


@pytest.mark.heavy
def test_what_the_readme_installs_gives_the_same_tracking_run(tmp_path):
    (block,) = (body for _, body, _ in readme_blocks() if "pip install" in body)
    clone = tmp_path / "clone"
    shutil.copytree(
        ROOT, clone, ignore=shutil.ignore_patterns(".venv", ".git", ".*_cache", ".hypothesis", "__pycache__")
    )
    for written in ("results", "site"):
        shutil.rmtree(clone / written, ignore_errors=True)
    # modules are compiled when they are imported: a third of them
    done = run_process("sh", f"set -e\n{block}", clone, PYTHONPATH="", PIP_NO_COMPILE="1")
    assert done.returncode == 0, done.stdout

    summary = json.loads((clone / "results" / "tracking" / "summary.json").read_text())
    here = vdfmu.run("tracking", reference=False, out=False).summary
    for key in ("rms_position_error_deg", "max_position_error_deg", "rms_torque_compensation_error_nm"):
        assert summary[key] == here[key]  # the same arithmetic: equal to the last bit

    # the example units are in it
    empty = tmp_path / "empty"
    empty.mkdir()
    (clone / "vdfmu").rename(clone / "away")
    command = clone / ".venv" / ("Scripts" if sys.platform == "win32" else "bin") / "vdfmu"
    unit = [command, "unit", "examples"]
    assert subprocess.run(unit, cwd=empty, check=False).returncode == 0
    assert {file.name for file in (empty / "units").iterdir()} == {
        file.name for file in (ROOT / "examples" / "units").iterdir() if file.is_file()
    }
