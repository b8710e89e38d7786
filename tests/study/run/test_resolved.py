"""The roles of the components of a system are found by what the units are."""

import dataclasses

import vdfmu
from vdfmu.system.package.description import SystemDescription
from vdfmu.system.scenario import load_scenario
from vdfmu.system.scenario.values import system_values

OWN = """from vdfmu.unit import JOINTS, Input, Output, Parameter, RobotParameters, Unit

class Body(Unit):
    \"\"\"An arm of another form.\"\"\"

    robot = RobotParameters("mass")
    q_0 = Parameter("position", JOINTS, "where it starts")
    tau = Input("torque", JOINTS, "torque of the motors")
    q = Output("position", JOINTS, "position")

    def outputs(self) -> None:
        self.q = self.q_0
"""
SYSTEM = """name = "mine"

[components]
{name} = "own.py"
"""
SCENARIO = """name = "mine"
system = "mine.sys.toml"
robot = "planar_2dof"
stop = 0.1
step = 0.01

[plant_factors]
mass = 2.0
"""


def test_a_plant_is_known_by_its_interface_and_gives_the_system_its_tolerance(tmp_path):
    (tmp_path / "own.py").write_text(OWN)
    (tmp_path / "mine.toml").write_text(SCENARIO)
    nominal = vdfmu.load_robot("planar_2dof").mass[0]
    for name, text, factor in (("body", OWN, 2.0), ("plant", OWN.replace("tau =", "effort ="), 1.0)):
        (tmp_path / "own.py").write_text(text)
        (tmp_path / "mine.sys.toml").write_text(SYSTEM.format(name=name))
        assert system_values(load_scenario(tmp_path / "mine.toml"))[name]["mass[1]"] == factor * nominal
    scenario = load_scenario("planar_tracking")
    system = scenario.system
    parts = {("arm" if name == "plant" else name): part for name, part in system.parts.items()}
    renamed = dataclasses.replace(
        scenario, system=dataclasses.replace(system, parts=parts, connections={}, shared={}), sections={}
    )
    assert SystemDescription(renamed, system_values(renamed, {"arm.tolerance": 1e-5})).tolerance == 1e-5
