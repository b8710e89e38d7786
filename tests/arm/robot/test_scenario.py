"""Faults of a scenario are named; a scalar applies to all joints; plant factors scale the robot."""

import json
import math
import tomllib
from typing import Any

import numpy as np
import pytest

from vdfmu.arm.equations.mapping import joint_space_mass_matrix
from vdfmu.arm.robot import load_robot
from vdfmu.base.errors import ModelError, UsageError
from vdfmu.base.files import data_path
from vdfmu.compiler.unit.declaration import NO_LIMIT
from vdfmu.system.scenario import load_scenario
from vdfmu.system.scenario.values import group_value, system_values

# (path to the entry, its new value, what the message says)
FAULTS: list[tuple[tuple[str, ...], Any, str]] = [
    (("friction",), "splt", r'friction: expected "lumped" or "split", got "splt"\. Did you mean "split"\?'),
    (("algorithm",), "gauss", r'algorithm: expected "gauss-seidel" or "jacobi" or .*, got "gauss"'),
    (("adaptive",), 1e-6, r"adaptive: expected algorithm = 'extrapolated' or 'iterative', got 'gauss-seidel'"),
    (("adaptive",), 2, "adaptive: expected a relative error < 1, got 2"),
    (("adaptive",), 0, "adaptive: expected .* > 0"),
    (("controller", "velocity"), "kappa", r"velocity: expected kappa_dot or q_dot or mixed, got 'kappa'"),
    (("controller", "K_q"), 1.0, r'controller\.K_q: controller has no K_q\. Did you mean "K_v"\?'),
    (("controller", "q"), 1.0, r"controller\.q: q\[1\] is a connected input of controller"),
    (("stop",), 0, r"stop: expected a finite number > 0 in s, got 0"),
    (("stop",), 2.0004, r"stop: expected a multiple of step = 0\.001 s, got 2\.0004 s\. The nearest is 2 s"),
    (("tolerance",), 2.0, r"tolerance: expected a relative tolerance < 1, got 2\.0"),
    (("stepp",), 1.0, r'stepp: expected a known key, got an unknown one\. Did you mean "step"\?'),
    (("trajectory",), 5, r"trajectory: expected a table, got 5"),
    (("trajectory", "T"), 0, r"trajectory\.T: expected at least 1e-06 s, got 0 s"),
    (("trajectory", "q_end"), [1.0],
     r"trajectory\.q_end: expected one value, or 2 for q_end\[1\] to q_end\[2\], got 1"),
    (("trajectory", "q_end"), [1.0, "x"], r"trajectory\.q_end\[2\]: expected a number in rad, got 'x'"),
    (("feedforward", "Lambda"), -1.0, r"feedforward\.Lambda: expected at least 0 1/s, got -1 1/s"),
    (("controller", "K_p"), [1.0, math.inf], r"controller\.K_p\[2\]: expected a finite number, got inf"),
    (("plant_factors",), {"mas": 1.1}, r'plant_factors\.mas: .* an unknown one\. Did you mean "mass"\?'),
    (("plant_factors",), {"mass": 0}, r"plant_factors\.mass: expected a finite number > 0, got 0"),
    (("plant_factors",), {"mass": [1.0]}, r"plant_factors\.mass: expected 2 finite numbers or one for all > 0, got 1"),
    (("plant_factors",), {"gravity": [1, 1]}, r"plant_factors\.gravity: expected a finite number > 0, got \[1, 1\]"),
    (("plant_factors",), {"ell": 0.001}, r"plant_factors: the plant: joints\[1\]\.drive\.ell: expected .* >= 1"),
    (("paper",), {"rms_position_error_deg": [1, 2, 3]}, r"paper\.rms_position_error_deg: expected 2 finite numbers"),
]  # fmt: skip


@pytest.mark.parametrize(("path", "value", "message"), FAULTS, ids=lambda v: None if isinstance(v, str) else "")
def test_fault_is_named(write, scenario_data, path, value, message):
    table = scenario_data
    for key in path[:-1]:
        table = table[key]
    table[path[-1]] = value
    with pytest.raises(ModelError, match=r"own\.toml: (feedforward\.|controller\.)?" + message) as caught:
        load_scenario(write("own.toml", scenario_data))
    assert len(caught.value.problems) >= 1


@pytest.mark.parametrize("key", ["name", "stop", "step"])
def test_missing_key(write, scenario_data, key):
    del scenario_data[key]
    with pytest.raises(ModelError, match=rf"own\.toml: {key}: expected .* got nothing\. The key is missing: add it"):
        load_scenario(write("own.toml", scenario_data))


def test_every_problem_at_once_and_one_number_stands_for_all_joints(write, scenario_data):
    scenario_data["friction"] = "x"
    scenario_data["step"] = 0
    scenario_data["trajectory"]["q_end"] = [1.0, 2.0, 3.0]
    scenario_data["controller"]["K_v"] = -1
    scenario_data["plant_factors"] = {"mass": -1}
    with pytest.raises(ModelError) as caught:
        load_scenario(write("own.toml", scenario_data))
    assert len(caught.value.problems) == 5
    scenario = load_scenario("tracking")
    np.testing.assert_array_equal(group_value(scenario, "feedforward.Lambda"), np.full(6, 1.0))
    np.testing.assert_array_equal(group_value(scenario, "controller.tau_max"), np.full(6, NO_LIMIT))


def test_groups_of_a_shared_value_have_it_unless_they_have_their_own(write, scenario_data):
    scenario_data["trajectory"]["q_start"] = [0.1, 0.2]
    shared = load_scenario(write("own.toml", scenario_data))
    assert group_value(shared, "plant.q_0").tolist() == [0.1, 0.2]
    scenario_data["plant"] = {"q_0": 0.3}
    separate = load_scenario(write("own.toml", scenario_data))
    assert group_value(separate, "plant.q_0").tolist() == [0.3, 0.3]
    assert group_value(separate, "trajectory.q_start").tolist() == [0.1, 0.2]


def test_defaults(write, scenario_data):
    for key in ("algorithm", "tolerance", "description"):
        del scenario_data[key]
    del scenario_data["trajectory"]["t_start"]
    del scenario_data["controller"]["tau_max"], scenario_data["controller"]["velocity"]
    del scenario_data["feedforward"]["mode"]
    scenario = load_scenario(write("own.toml", scenario_data))
    assert (scenario.algorithm, scenario.tolerance) == ("gauss-seidel", 1e-7)
    assert group_value(scenario, "trajectory.t_start") == 0.0
    assert group_value(scenario, "feedforward.mode") == "inverse"
    assert group_value(scenario, "controller.velocity") == "kappa_dot"
    assert (group_value(scenario, "controller.tau_max") == NO_LIMIT).all()
    assert scenario.paper == {} and scenario.plant_factors == {}
    assert scenario.plant_robot is scenario.robot


def test_friction_of_a_scenario_goes_first_and_variants_differ_by_what_they_are_for(write, scenario_data):
    scenario_data["friction"] = "split"
    scenario_data["plant_factors"] = {"mass": 2.0}
    path = write("own.toml", scenario_data)
    robot = load_robot("planar_2dof")
    assert robot.friction == "lumped"
    for scenario in (load_scenario(path), load_scenario(path, robot)):
        assert (scenario.robot.friction, scenario.plant_robot.friction) == ("split", "split")
        np.testing.assert_array_equal(scenario.robot.f_s, robot.f_s)
    del scenario_data["friction"]
    assert load_scenario(write("own.toml", scenario_data), robot).robot is robot

    def content(name: str) -> dict[str, Any]:
        data = tomllib.loads((data_path("models") / "scenarios" / f"{name}.toml").read_text(encoding="utf-8"))
        return {key: value for key, value in data.items() if key not in ("name", "description")}

    split = content("tracking_split")
    assert split.pop("friction") == "split"
    assert split == content("tracking")
    nominal, implied = content("two_joint"), content("two_joint_table5")
    gains, nominal_gains = implied.pop("controller"), nominal.pop("controller")
    assert implied == nominal
    assert [gains[key][2:] for key in ("K_p", "K_v")] == [nominal_gains[key][2:] for key in ("K_p", "K_v")]


def test_gains_of_the_variant_of_two_joint_are_those_of_table_5():
    scenario = load_scenario("two_joint_table5")
    torque, position = (
        np.array(scenario.paper[key]) for key in ("rms_torque_compensation_error_nm", "rms_position_error_deg")
    )
    # written in whole N.m/rad
    K_p, K_v = (group_value(scenario, f"controller.{name}") for name in ("K_p", "K_v"))
    np.testing.assert_allclose(K_p[:2], torque / np.radians(position), rtol=0, atol=0.5)
    robot, q = scenario.robot, group_value(scenario, "trajectory.q_start")
    inertia = np.diag(joint_space_mass_matrix(robot, q)) + robot.ell * robot.I_m
    critical = 2.0 * np.sqrt(K_p * inertia)[:2]
    # written in whole N.m.s/rad, and at most the 50 of two_joint
    np.testing.assert_allclose(K_v[:2], np.minimum(critical, 50.0), rtol=0, atol=0.5)
    assert critical[1] > 50.0


def test_plant_factors_scale_scalars_vectors_and_matrices_by_the_stated_per_cent(write, scenario_data):
    scenario_data["plant_factors"] = {"mass": [1.5, 1.25], "centroid": [2.0, 0.5], "inertia": 2, "gravity": 0.5}
    scenario = load_scenario(write("own.toml", scenario_data))
    nominal, plant = scenario.robot, scenario.plant_robot
    # Factors are powers of two or exact in binary, so the products are exact.
    np.testing.assert_array_equal(plant.mass, nominal.mass * [1.5, 1.25])
    np.testing.assert_array_equal(plant.centroid, nominal.centroid * [[2.0], [0.5]])
    np.testing.assert_array_equal(plant.inertia, 2 * nominal.inertia)
    np.testing.assert_array_equal(plant.gravity, nominal.gravity / 2)
    np.testing.assert_array_equal(plant.K_f0, nominal.K_f0)
    scenario = load_scenario("two_joint")
    assert scenario.plant_factors == {
        "mass": 1.02, "inertia": 1.02, "f_c": 1.05, "f_s": 0.95, "f_v": 1.05, "K_f0": 0.95,
    }  # fmt: skip
    # One rounded product each: equal to one unit in the last place.
    np.testing.assert_allclose(scenario.plant_robot.mass / scenario.robot.mass, 1.02, rtol=3e-16)
    np.testing.assert_array_equal(scenario.plant_robot.ell, scenario.robot.ell)


@pytest.mark.parametrize("name", ["../up", "/absolute", "a\\b", "..", ".hidden", "line\nbreak"])
def test_a_name_that_is_no_file_name_is_refused(write, scenario_data, name):
    scenario_data["name"] = "NAME"
    path = write("scenario.toml", scenario_data)
    text = path.read_text(encoding="utf-8").replace('"NAME"', json.dumps(name))
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ModelError, match="name: expected a name of letters, digits"):
        load_scenario(path)


def test_a_factor_multiplies_what_the_scenario_has_element_by_element():
    scenario = load_scenario("planar_tracking")
    before = system_values(scenario)
    after = system_values(scenario, {"controller.K_v": "*0.8", "plant.mass[2]": "*1.5", "robot.gravity[3]": "*0"})
    assert after["controller"]["K_v[1]"] == 0.8 * before["controller"]["K_v[1]"] > 0.0
    assert after["controller"]["K_v[2]"] == 0.8 * before["controller"]["K_v[2]"] > 0.0
    assert after["plant"]["mass[2]"] == 1.5 * before["plant"]["mass[2]"]
    assert after["feedforward"]["mass[2]"] == before["feedforward"]["mass[2]"]
    assert {name: after[name]["gravity[3]"] for name in ("plant", "feedforward")} == {"plant": 0.0, "feedforward": 0.0}
    for value, words in (("*x", r"a number after the star, such as \*0\.8, got \*x"), ("*", "a number after the star")):
        with pytest.raises(UsageError, match=words):
            system_values(scenario, {"controller.K_v": value})
    with pytest.raises(UsageError, match="expected a number to multiply, got 0"):
        system_values(scenario, {"controller.velocity": "*2"})
