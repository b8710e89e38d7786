"""A payload that a scenario or a setting puts on a robot, known to the feedforward or not."""

import numpy as np
import pytest
from scipy.optimize import root

from vdfmu.arm.robot import load_robot
from vdfmu.base.errors import ModelError, UsageError
from vdfmu.base.files import data_path
from vdfmu.study.run.prepare import prepare
from vdfmu.system.package.description import SystemDescription
from vdfmu.system.reference.reference import reference
from vdfmu.system.scenario import load_scenario
from vdfmu.system.scenario.replace import with_parameters
from vdfmu.system.scenario.values import system_values

MASS, ARM = 0.6, 0.5  # kg, and its distance from joint 2 [m]: tool_offset 0.4, centroid 0.1
PAYLOAD = f"""
[payload]
mass = {MASS}
centroid = [0.1, 0.0, 0.0]
inertia = 0.002
"""


@pytest.fixture
def scenario_file(tmp_path):
    def write(more):
        path = tmp_path / "loaded.toml"
        path.write_text((data_path("models") / "scenarios" / "planar_tracking.toml").read_text() + more)
        return path

    return write


def solved(scenario, stop, **settings):
    values = system_values(scenario, {"plant.tolerance": 1e-9} | settings)
    return reference("sampled", SystemDescription(scenario, values), step=1e-3, stop=stop)["plant.q"]


@pytest.mark.parametrize("informed", [True, False])
def test_a_payload_is_that_of_the_plant_and_a_known_one_of_the_feedforward(scenario_file, informed):
    values = system_values(load_scenario(scenario_file(PAYLOAD + f"known = {str(informed).lower()}\n")))
    for component in ("plant", "feedforward") if informed else ("plant",):
        assert values[component]["payload_mass"] == MASS
        assert values[component]["payload_centroid[1]"] == 0.1
        assert values[component]["payload_inertia[2,2]"] == 0.002
    if not informed:
        assert values["feedforward"]["payload_mass"] == 0.0
        assert values["feedforward"]["payload_inertia[2,2]"] < 1e-14
    assert not load_robot("planar_2dof").payload


@pytest.mark.heavy
def test_an_unknown_payload_costs_what_statics_say(scenario_file):
    """At rest the feedback carries what the feedforward does not: K_p e = G(q) - G_known(q_d), in closed form."""
    q_d, K_p, g = np.array([0.3, 0.4]), np.array([1500.0, 500.0]), 9.81

    def weights(q, load):
        lever_1, lever_2 = np.cos(q[0]), np.cos(q[0] + q[1])
        second = (1.0 * 0.2 + load * ARM) * g * lever_2
        return np.array([(2.0 * 0.25 + 1.0 * 0.5 + load * 0.5) * g * lever_1 + second, second])

    q = root(lambda q: K_p * (q_d - q) - weights(q, MASS) + weights(q_d, 0.0), q_d, tol=1e-14).x
    held = [f"{name}[{i}]" for name in ("f_c", "f_s", "f_v") for i in (1, 2)]
    scenario = load_scenario(scenario_file(PAYLOAD + "known = false\n"))
    values = {f"robot.{name}": 0.0 for name in held} | {
        "trajectory.q_start": q_d, "trajectory.q_end": q_d, "plant.q_0": q
    }  # fmt: skip
    positions = solved(scenario, 0.1, **values)
    # It stays where the closed form puts it: the solver's 1e-9 of torques of 10 N.m, over K_p, and 1e3 times more
    # by the springs, which are stiffer than K_p.
    np.testing.assert_allclose(positions, np.broadcast_to(q, positions.shape), rtol=0, atol=1e-9)
    assert np.abs(q_d - q).min() > 3e-3
    assert np.abs(solved(scenario, 0.1, **values | {"plant.q_0": q_d}) - q).max() > 1e-3


def test_a_setting_gives_a_robot_a_payload():
    scenario = prepare("planar_tracking", ["plant.payload_mass"])
    values = system_values(scenario, {"plant.payload_mass": 2.0})
    assert values["plant"]["payload_mass"] == 2.0
    assert values["feedforward"]["payload_mass"] == 0.0
    scenario = prepare("planar_tracking", ["robot.payload_inertia"])
    values = system_values(scenario, {"robot.payload_mass": 2.0, "robot.payload_inertia": 0.01})
    assert values["feedforward"]["payload_mass"] == 2.0
    assert values["plant"]["payload_inertia[1,1]"] == 0.01
    assert with_parameters(scenario, ["plant.payload_mass"]) is scenario
    assert not prepare("planar_tracking", ["plant.mass"]).robot.payload


def test_a_component_without_bodies_has_no_payload_and_a_variable_of_an_option_names_it(tmp_path):
    scenario = prepare("planar_tracking", ["controller.payload_mass"])
    with pytest.raises(UsageError, match=r"controller has no payload_mass\. There are: q_d, "):
        system_values(scenario, {"controller.payload_mass": 1.0})
    (tmp_path / "system.toml").write_text(
        'extends = "system"\n[components]\nwall = "wall"\n[connections]\n"plant.V_O" = ["wall.V_O"]\n'
    )
    (tmp_path / "free.toml").write_text(
        (data_path("models") / "scenarios" / "planar_tracking.toml")
        .read_text()
        .replace('name = "planar_tracking"', 'name = "free"\nsystem = "system.toml"')
    )
    with pytest.raises(
        ModelError, match=r"an output of plant, got 'V_O'\. It exists only for a robot with coupled_tool\."
    ):
        load_scenario(tmp_path / "free.toml")
    with pytest.raises(UsageError, match=r"plant has no V_S\. It exists only for a robot with moving_base\."):
        system_values(load_scenario("planar_tracking"), {"plant.V_S": 1.0})
