"""Connections of single elements of a group."""

import numpy as np
import pytest

import vdfmu
from vdfmu.base.errors import ModelError
from vdfmu.system.scenario import load_scenario
from vdfmu.system.scenario.scenario_file import load_system
from vdfmu.system.scenario.values import system_values

UNIT = '''
from vdfmu.unit import Input, Output, Parameter, Unit


class Spring(Unit):
    """Spring between the first joint and the ground, acting as a force at the tool."""

    q = Input("rad", text="position")
    k = Parameter("N/rad", text="stiffness", start=40.0)
    f = Output("N", text="force")

    def outputs(self) -> None:
        self.f = -self.k * self.q
'''
SYSTEM = """
extends = "system"
name = "spring"
[components]
spring = "spring.py"
[connections]
"plant.q[1]" = ["spring.q"]
"spring.f" = ["plant.F_e[2]"]
"""
SCENARIO = """
name = "spring"
system = "system.toml"
robot = "planar_2dof"
stop = 0.05
step = 0.001
[trajectory]
q_start = 0.3
q_end = 0.3
"""


@pytest.fixture
def folder(tmp_path):
    for name, text in (("spring.py", UNIT), ("system.toml", SYSTEM), ("scenario.toml", SCENARIO)):
        (tmp_path / name).write_text(text)
    return tmp_path


@pytest.mark.heavy
def test_an_element_feeds_a_scalar_and_a_scalar_an_element(folder):
    results = vdfmu.run(folder / "scenario.toml", out=folder / "out", record=["spring.q", "plant.F_e[*]"])
    np.testing.assert_array_equal(results["spring.f"], -40.0 * results["spring.q"])
    # gauss-seidel: the spring reads the plant of the step before, and the plant what the spring made of it
    np.testing.assert_array_equal(results["spring.q"][1:], results["plant.q[1]"][:-1])
    np.testing.assert_array_equal(results["plant.F_e[2]"][1:], results["spring.f"][1:])
    assert np.ptp(results["spring.f"]) > 1e-3
    # as for the shipped units: the plant's tolerance of 1e-7 rad, and nothing added by the connection
    assert results.summary["reference"]["sampled"]["max_position_difference_rad"] < 1e-7


def test_a_group_takes_the_place_of_the_elements_that_another_file_feeds(folder):
    (folder / "more.toml").write_text(
        'extends = "system.toml"\n[components]\nwall = "wall"\n[connections]\n"wall.F_e" = ["plant.F_e"]\n'
    )
    connections = load_system(folder / "more.toml").connections
    assert "spring.f" not in connections
    assert connections["plant.q[1]"] == ["spring.q"]


@pytest.mark.parametrize(("wrong", "message"), [
    ('"plant.q[3]" = ["spring.q"]', r"plant\.q\[3\]: expected an output of plant, got 'q\[3\]'"),
    ('"plant.q" = ["spring.q"]', r"plant\.q -> spring\.q: expected signals of the same shape"),
    ('"plant.q[1]" = ["spring.q"]\n"plant.q[2]" = ["spring.q"]', r"spring\.q: expected one connected output"),
])  # fmt: skip
def test_elements_that_do_not_fit_are_named(folder, wrong, message):
    path = folder / "system.toml"
    path.write_text(path.read_text().replace('"plant.q[1]" = ["spring.q"]', wrong))
    with pytest.raises(ModelError, match=message):
        load_scenario(folder / "scenario.toml")


def test_an_output_called_tolerance_is_not_set(folder):
    path = folder / "spring.py"
    path.write_text(path.read_text().replace("f = Output", 'tolerance = Output("1", text="margin")\n    f = Output')
                    .replace("self.f = ", "self.tolerance = self.k\n        self.f = "))  # fmt: skip
    values = system_values(load_scenario(folder / "scenario.toml"))
    assert "tolerance" not in values["spring"]
    assert values["plant"]["tolerance"] == 1e-7
