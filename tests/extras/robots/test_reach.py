"""First motions of an imported arm."""

import numpy as np
import pytest

from tests.extras.robots.conftest import ARM
from vdfmu import run
from vdfmu.arm.robot import load_robot
from vdfmu.extras.robots import import_robot
from vdfmu.study.analysis.reach import reach_scenario
from vdfmu.study.analysis.reach_file import write_reach
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
