"""First motions of an imported arm."""

import json

import fmpy
import numpy as np
import pytest

from tests.conftest import ran, refused
from tests.extras.robots.conftest import ARM
from vdfmu import run
from vdfmu.arm.robot import load_robot
from vdfmu.base.toml_file import locate
from vdfmu.engine.results.verdict import checks_of
from vdfmu.extras.robots import import_robot
from vdfmu.extras.robots.reach import reach_scenario
from vdfmu.extras.robots.reach_file import write_reach
from vdfmu.study.analysis.loops import margins_along
from vdfmu.study.report.page import run_command
from vdfmu.study.run.prepare import prepare
from vdfmu.study.run.summary import run_facts
from vdfmu.study.verdict import loop_checks
from vdfmu.system.scenario import load_scenario
from vdfmu.system.scenario.check import model_notes


@pytest.fixture
def arm(tmp_path):
    """Return the path of an imported arm."""
    (tmp_path / "arm.urdf").write_text(f"<robot name='arm'>{ARM}</robot>", encoding="utf-8")
    path = tmp_path / "arm.toml"
    path.write_text(import_robot(tmp_path / "arm.urdf").text, encoding="utf-8")
    return path


@pytest.mark.heavy
def test_the_motion_keeps_clear_of_end_stops_and_motors_that_are_too_weak_are_said(arm, tmp_path):
    reach = write_reach(arm, tmp_path / "reach.toml")
    scenario = load_scenario(tmp_path / "reach.toml")
    robot = scenario.robot
    for key in ("q_start", "q_end"):
        at = np.array(scenario.sections["trajectory"][key])
        away = np.minimum(at - robot.q_min, robot.q_max - at)
        assert (away > 0.09 * np.minimum(robot.q_max - robot.q_min, 10.0)).all()
    assert scenario.sections["controller"]["K_p"] == [float(f"{k:.4g}") for k in reach.gains.K_p]
    assert reach.notes == []
    text = arm.read_text(encoding="utf-8")
    assert text.count("tau_stall = 0.5\n") == 2
    arm.write_text(text.replace("tau_stall = 0.5\n", "tau_stall = 0.01\n"), encoding="utf-8")
    note, *_ = write_reach(arm, tmp_path / "reach.toml").notes  # others are on what grows
    assert note.startswith("the motors are too weak")
    assert "The motors are too weak" in (tmp_path / "reach.toml").read_text(encoding="utf-8")
    # what is run without being written says so too
    scenario = reach_scenario(load_robot(arm))
    assert scenario.notes == (note,) and note in model_notes(scenario)


@pytest.mark.heavy
@pytest.mark.parametrize("shipped", [None, "scara_4dof"])
def test_an_imported_or_shipped_arm_moves_well_at_once(arm, shipped):
    robot = load_robot(arm if shipped is None else shipped)
    scenario = reach_scenario(robot)
    results = run("reach", robot=robot, out=False, reference=False)
    assert results.summary["scenario"] == f"{robot.name}_reach"
    torque = results["controller.tau"] * robot.ell
    # The torque is held over a step, on average half a step late: the feedback of a deviation balances that.
    late = np.abs(np.diff(torque, axis=0)).max(axis=0)
    error = np.abs(results["trajectory.q_d"] - results["plant.q"]).max(axis=0)
    assert (error < late / np.array(scenario.sections["controller"]["K_p"])).all()
    # a thousandth of the motion: K_p is as low as friction that falls with speed asks for
    ends = [np.array(scenario.sections["trajectory"][name]) for name in ("q_start", "q_end")]
    assert np.abs(results["plant.q"][-1] - ends[1]).max() < 1e-3 * np.abs(ends[1] - ends[0]).max()


@pytest.mark.heavy
@pytest.mark.parametrize("algorithm", ["gauss-seidel", "jacobi"])
def test_all_commands_have_one_margin(algorithm, tmp_path):
    """Of an arm along its first motion."""
    path = tmp_path / "reach.toml"
    written = write_reach("scara_4dof", path)
    reach = margins_along(path).judged
    np.testing.assert_array_equal(written.margins.modulus, reach.loops.margins().modulus)
    options = ["--algorithm", algorithm, "--no-reference", "--out", str(tmp_path / "run")]
    ran("run", path, *options)
    summary = json.loads((tmp_path / "run" / "summary.json").read_text())
    said = [check.sentence for check in checks_of(summary) if check.key in ("growth", "margin", "delay")]
    margins = margins_along(path, algorithm=algorithm).judged
    loops = [check.sentence for check in loop_checks({"key_figures": margins.figures})][1:]
    assert loops == said and (algorithm == "jacobi" or reach.figures == margins.figures)
    least, shown = margins.loops.modulus, summary["key_figures"]["margin"]["value"]
    assert shown == least.min() > 0.3


def test_the_command_of_a_first_motion_names_the_robot(tmp_path):
    path = tmp_path / "bot.toml"
    path.write_text(locate("planar_2dof", "robots").read_text())
    reach = run_facts(prepare(reach_scenario(str(path))))
    assert run_command(reach).startswith(f"vdfmu run reach --robot {path} --stop ")
    reach = run_facts(prepare(reach_scenario("planar_2dof"), step=0.002))
    assert "vdfmu run reach --robot planar_2dof --stop" in run_command(reach) and "--step 0.002" in run_command(reach)


@pytest.mark.few(1)
@pytest.mark.parametrize(("words", "starts"), [
    (("--robot", "planar_2dof", "--folded"), None),
    (("reach", "--robot", "planar_2dof", "--set", "plant.payload_mass=2"), "2.0"),
])  # fmt: skip
def test_a_robot_without_a_scenario_is_built_for_its_first_motion(tmp_path, words, starts):
    ran("build", *words, "--backend", "python", "--out", tmp_path)
    assert sorted(path.stem for path in tmp_path.iterdir()) == ["Feedforward", "PDController", "Plant", "Trajectory"]
    variables = fmpy.read_model_description(str(tmp_path / "Plant.fmu")).modelVariables
    assert {v.name: v.start for v in variables}.get("payload_mass") == starts


def test_drives_are_listed():
    assert "CSG-25-100" in ran("robot", "drives").output
    assert "N.m" not in ran("robot", "drives", "CSG-25-100").output
    assert "no gear or motor 'CSG'" in refused("robot", "drives", "CSG")
