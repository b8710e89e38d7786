"""``vdfmu linear``: modes of a robot, margins of a scenario, of a package and of a run that is unstable."""

import json

import pytest

import vdfmu
from tests.conftest import ran, refused
from vdfmu.extras.linear.along import ranges
from vdfmu.study.analysis.loops import margins_along
from vdfmu.study.analysis.modes import natural_modes


@pytest.mark.heavy
def test_margins_and_modes_as_json(tmp_path):
    answer = json.loads(ran("linear", "planar_tracking", "--at", "0.5", "--json").output)
    assert [row["opened_at"] for row in answer["margins"]] == ["plant.tau[1]", "plant.tau[2]"]
    assert answer["state"] == "good" and all(0.0 < row["modulus"] < 1.0 for row in answer["margins"])
    stricter = ran("scenario", "show", "planar_tracking").output + "\n[limits]\nmargin = 0.99\n"
    (tmp_path / "stricter.toml").write_text(stricter, encoding="utf-8")
    answer = json.loads(ran("linear", tmp_path / "stricter.toml", "--at", "0.5", "--json").output)
    assert answer["state"] == "doubtful" and "(limit 0.99 by [limits] of the scenario)" in answer["text"]
    answer = json.loads(ran("linear", "planar_2dof", "--json").output)
    assert answer["pose"] == [0.0, 0.0]
    assert len(answer["motors_free"]["frequency"]) == len(answer["motors_held"]["frequency"]) == 2


@pytest.mark.heavy
def test_the_command_prints_a_pose_or_a_path(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    said = ran("linear", "planar_2dof", "--pose", "0.3, -0.5")
    modes = natural_modes(vdfmu.load_robot("planar_2dof"), [0.3, -0.5])
    assert all(f"{f:.2f}" in said.output for f in modes.frequency)
    assert "Motors held at 0.3 -0.5" in said.output and "Not oscillating, 1/s:" in said.output
    assert " to " in ran("linear", "planar_tracking", "--modes").output
    assert (tmp_path / "planar_tracking_modes.png").read_bytes().startswith(b"\x89PNG")
    for options, message in (
        (["planar_tracking", "--modes"], "a file of this name exists"),
        (["planar_tracking", "--modes", "--pose", "0 0"], "--pose is for a robot at a pose"),
        (["planar_tracking", "--modes", "--set", "a.b=1"], "--set is for margins"),
        (["planar_2dof", "--out", "here.png"], "--out is the picture of --modes or --bode"),
        (["planar_2dof", "--at", "1"], "--at is only for a scenario, but planar_2dof is a robot"),
        (["planar_2do"], "no robot or scenario 'planar_2do'. Did you mean \"planar_2dof\"?"),
        (["planar_2dof", "--pose", "0 left"], "expected numbers, such as '0.3 -0.5'"),
    ):
        assert message in refused("linear", *options), options


def test_a_mode_that_nowhere_oscillates_has_no_range():
    modes = natural_modes(vdfmu.load_robot("planar_2dof"), [0.3, -0.5])
    assert ranges([modes], len(modes.frequency) + 1) == [None, *((f, f) for f in modes.frequency)]


@pytest.mark.heavy
def test_the_command_prints_margins_of_a_scenario_and_of_a_package(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    wanted = margins_along("planar_tracking", at=[0.5], algorithm="jacobi")
    assert wanted.names == ("plant.tau[1]", "plant.tau[2]") and wanted.step == 1e-3
    said = ran("linear", "planar_tracking", "--algorithm", "jacobi", "--at", "0.5")
    assert "Step 0.001 s, jacobi" in said.output
    assert all(f"{m:.3f}" in said.output for m in wanted.margins[0].modulus)
    (marked,) = [line for line in said.output.splitlines() if "smallest" in line]
    assert f" {min(wanted.margins[0].modulus):.3f} " in marked
    # gauss-seidel samples
    assert refused("linear", "planar_tracking", "--adaptive", "1e-4").startswith("adaptive: gauss-seidel")
    ran("ssp", "planar_tracking", "--out", "p.ssp")
    again = ran("linear", "p.ssp", "--algorithm", "jacobi", "--at", "0.5")
    assert again.output.splitlines()[2:] == said.output.splitlines()[2:]
    said = ran("linear", "planar_tracking", "--loop", "controller.q")
    assert [line.split()[0] for line in said.output.splitlines()[3:5]] == ["controller.q[1]", "controller.q[2]"]


def test_margins_says_unstable_where_and_since_when():
    done = ran("linear", "planar_tracking", "--set", "controller.K_v=400", "--at", "0", "--at", "0.1", code=1)
    assert done.output.count("none") == 4 and "0.000" not in done.output
    assert "Unstable from the start, joint 1" in " ".join(done.output.split())
