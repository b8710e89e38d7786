"""``vdfmu robot import`` as a user meets it."""

import json
import subprocess
from pathlib import Path

import pytest

from tests.extras.robots.conftest import ARM, joint, link
from tests.warm import command
from vdfmu.arm.robot import load_robot


def vdfmu(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    return command(*arguments, cwd=folder)


@pytest.mark.heavy
def test_a_robot_file_is_written_and_not_replaced_unasked(urdf, tmp_path):
    urdf(ARM)
    done = vdfmu(tmp_path, "robot", "import", "arm.urdf")
    assert done.returncode == 0, done.stderr
    assert done.stdout == "Written to arm.toml, 3 joints\n"
    assert "note: the tool is at the origin of tool, which is fixed to the last link that moves\n" in done.stderr
    assert "note: assumed: drive.ell, drive.I_m, " in done.stderr
    assert load_robot(tmp_path / "arm.toml").n == 3
    again = vdfmu(tmp_path, "robot", "import", "arm.urdf", "--tip", "one")
    assert again.returncode == 2
    assert again.stderr == (
        "error: arm.toml: a file of this name exists. Replace it with --overwrite, or choose another name with -o.\n"
    )
    assert vdfmu(tmp_path, "robot", "import", "arm.urdf", "--tip", "one", "--overwrite").returncode == 0
    assert load_robot(tmp_path / "arm.toml").n == 1


def test_what_is_no_arm_ends_with_every_problem_and_no_file(urdf, tmp_path):
    urdf(ARM + link("flap") + joint("d", "one", "flap"))
    done = vdfmu(tmp_path, "robot", "import", "arm.urdf", "-o", "robot.toml")
    assert done.returncode == 2
    assert done.stderr.startswith("error: arm.urdf: --tip: expected a link, got nothing, and 2 joints branch off")
    assert not (tmp_path / "robot.toml").exists()


@pytest.mark.heavy
def test_a_folder_that_is_missing_is_named(urdf, tmp_path):
    urdf(ARM)
    done = vdfmu(tmp_path, "robot", "import", "arm.urdf", "-o", "gone/robot.toml")
    assert done.returncode == 2
    assert "cannot write gone/robot.toml" in done.stderr


@pytest.mark.heavy
def test_a_first_motion_is_written_with_its_margins_and_runs_by_its_name_too(tmp_path):
    written = vdfmu(tmp_path, "robot", "reach", "planar_2dof")
    assert written.returncode == 0, written.stderr
    assert "modulus margin" in written.stdout
    assert "Written to planar_2dof_reach.toml, with a step of 1 ms. Run it with" in written.stdout
    again = vdfmu(tmp_path, "robot", "reach", "planar_2dof")
    assert (again.returncode, again.stderr[:50]) == (2, "error: planar_2dof_reach.toml: a file of this name")
    for words in (("planar_2dof_reach.toml",), ("reach", "--robot", "planar_2dof")):
        done = vdfmu(tmp_path, "run", *words, "--no-reference", "--overwrite")
        assert done.returncode == 0, done.stderr
        summary = json.loads((tmp_path / "results" / "planar_2dof_reach" / "summary.json").read_text())
        assert max(summary["max_position_error_deg"]) < 0.01  # as in tests/extras/robots/test_gains.py
    assert vdfmu(tmp_path, "run", "reach", "--robot", "nonsense").returncode == 2
