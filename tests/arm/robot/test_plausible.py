"""One list of plausibility for files, imports, scenarios and runs: what it says, and what it leaves alone."""

from dataclasses import replace
from typing import Any

import pytest

import vdfmu
from tests.conftest import invoked
from vdfmu.arm.robot import load_robot, robot_from_dict, robot_names
from vdfmu.arm.robot.catalogue import catalogue
from vdfmu.arm.robot.plausible import robot_notes
from vdfmu.base.toml_file import shipped_names, toml_text
from vdfmu.system.inspect_source import inspect_source
from vdfmu.system.scenario import load_scenario
from vdfmu.system.scenario.check import model_notes

ARM, LIMITED = load_robot("planar_2dof"), load_robot("ur5e_6dof")
MISTAKES: list[tuple[Any, dict[str, Any], str]] = [
    (ARM, {"gravity": [0, 0, -9.81]}, "-9.81 m/s2 pulls towards +z, because the vector points up. Write +9.81"),
    (ARM, {"gravity": [0, 0, 981]}, "gravity of 981 m/s2 looks like another unit. Earth has 9.81"),
    (ARM, {"mass": [1.0, 4000.0]}, "joint 2: a mass of 4000 kg looks like grams. Give it in kg."),
    (ARM, {"offset": 1e3 * ARM.offset}, "joint 2: a length of 500 m looks like mm."),
    (ARM, {"tool_offset": [300.0, 0, 0]}, "tool_offset[1] = 300 m looks like mm."),
    (ARM, {"inertia": 1e4 * ARM.inertia}, "joint 1: the inertia of a body 14.1 m wide looks like kg.cm2"),
    (ARM, {"K_f0": 1e3 * ARM.K_f0}, "joint 1: a rotor that oscillates on its flexspline at 1996 Hz"),
    (ARM, {"I_m": ARM.I_m / ARM.ell}, "at 631.2 Hz looks like K_f0 in N.mm/rad, I_m without its factor ell"),
    (ARM, {"K_f0": ARM.K_f0 / 3438, "K_w0": ARM.K_w0 / 3438}, "Hz looks like a stiffness per arc minute"),
    (LIMITED, {"I_m": LIMITED.I_m * LIMITED.ell}, "by 719 rad/s2 looks like I_m with ell twice. Motors reach 5e3"),
    (LIMITED, {"tau_stall": LIMITED.tau_stall * LIMITED.ell}, "by 7.19e+06 rad/s2 looks like tau_stall of the"),
    (LIMITED, {"q_max": 180.0}, "q_max[1] = 180 rad looks like degrees. Write 3.142 rad."),
]  # fmt: skip


@pytest.mark.parametrize(("robot", "fields", "note"), MISTAKES, ids=[note[:30] for *_, note in MISTAKES])
def test_a_wrong_sign_or_unit_of_a_robot_is_noted(robot, fields, note, tmp_path):
    """The same words for a robot, its file, and a scenario with it."""
    changed = robot.with_parameters(**fields)
    assert any(note in line for line in robot_notes(changed))
    path = tmp_path / "arm.toml"
    path.write_text(toml_text(changed.to_dict(looks=False)), encoding="utf-8")
    report = inspect_source(path, "planar_2dof")
    assert not report.problems and any(note in line for line in report.notes)
    if robot is ARM:
        assert any(note in line for line in model_notes(replace(load_scenario("planar_tracking"), robot=changed)))


def test_check_counts_notes(tmp_path):
    path, far = tmp_path / "arm.toml", {"gravity": [0.0, 0.0, 981.0]}
    cases: list[tuple[dict[str, Any], str]] = [({}, ""), (far, ", 1 note"), (far | {"q_max": 180.0}, ", 2 notes")]
    for fields, count in cases:
        path.write_text(toml_text(LIMITED.with_parameters(**fields).to_dict(looks=False)), encoding="utf-8")
        assert invoked("check", path).output.endswith(f"arm.toml (robot): no problems{count}\n")


SETTINGS: list[tuple[dict[str, Any], str]] = [
    ({"trajectory.q_end": [0.5, 90.0]}, "trajectory.q_end[2] = 90 rad looks like degrees. Write 1.571 rad."),
    ({"trajectory.T": 0.01}, "trajectory: speed of joint 1 = 471.2 rad/s is faster than arms, whose joints reach 45"),
    ({"plant.q_dot_0": 100.0}, "plant.q_dot_0[1] = 100 rad/s is faster than arms"),
    ({"plant.gravity": -9.81}, "gravity[3] = -9.81 m/s2 pulls towards +"),
    ({"robot.mass[2]": 4000.0}, "joint 2: a mass of 4000 kg looks like grams"),
    ({"plant.K_f0[1]": 1.6e7}, "looks like K_f0 in N.mm/rad"),
]


@pytest.mark.parametrize(("settings", "note"), SETTINGS, ids=[next(iter(case)) for case, _ in SETTINGS])
def test_a_wrong_sign_or_unit_of_a_setting_is_noted(settings, note):
    assert any(note in line for line in model_notes(load_scenario("planar_tracking"), settings))


def test_degrees_in_a_scenario_and_in_a_run_and_millimetres_of_a_slide_are_noted():
    scenario, heard = load_scenario("planar_tracking"), list[str]()
    motion = {**scenario.sections["trajectory"], "q_end": [0.5, 90.0]}
    written = replace(scenario, sections={**scenario.sections, "trajectory": motion})
    settings, note = SETTINGS[0]
    assert model_notes(written) == model_notes(scenario, settings) == [note]
    vdfmu.run(
        "planar_tracking", parameters=settings, stop=0.01, reference=False, out=False,
        log=lambda message: heard.append(message.text),
    )  # fmt: skip
    assert f"planar_2dof: {note}" in heard
    notes = model_notes(load_scenario("slider_tracking"), {"trajectory.q_end": [0.5, 250.0, 0.3]})
    assert notes == ["trajectory.q_end[2] = 250 m looks like mm. Write 0.25 m."]


@pytest.mark.parametrize("name", robot_names())
def test_shipped_robots_have_no_note(name):
    assert robot_notes(load_robot(name)) == []


@pytest.mark.few(4)
@pytest.mark.parametrize("name", shipped_names("scenarios"))
def test_shipped_scenarios_have_no_note(name):
    assert model_notes(load_scenario(name)) == []


@pytest.mark.parametrize("gear", catalogue()["gears"])
def test_gears_and_motors_of_the_catalogue_have_no_note(gear):
    data = ARM.to_dict()
    for motor in catalogue()["motors"]:
        for joint in data["joints"]:
            joint |= {"gear": gear, "motor": motor, "drive": {}, "limits": STOPS}
        assert robot_notes(robot_from_dict(data)) == []


STOPS = {"q_min": -3.0, "q_max": 3.0, "stop_stiffness": 1e4, "stop_damping": 0.5}
