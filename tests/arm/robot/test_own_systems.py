"""Roles in systems of other names: which component is the plant, and where it starts."""

import dataclasses
import math
import re

import pytest

import vdfmu
from vdfmu.arm.robot import load_robot
from vdfmu.base.errors import UsageError
from vdfmu.system.scenario import load_scenario
from vdfmu.system.scenario.check import model_notes
from vdfmu.system.scenario.replace import with_starts, with_units
from vdfmu.system.scenario.scenario_file import load_system
from vdfmu.system.scenario.values import system_values

SYSTEM = """
name = "mine"
[components]
way = "trajectory"
pd = "controller"
arm = "plant"
[connections]
"way.q_d" = ["pd.q_d"]
"way.q_d_dot" = ["pd.q_d_dot", "pd.kappa_dot_d"]
"pd.tau" = ["arm.tau"]
"arm.q" = ["pd.q"]
"arm.q_dot" = ["pd.q_dot"]
"arm.kappa_dot" = ["pd.kappa_dot"]
"""
SCENARIO = """
name = "mine"
system = "mine.sys.toml"
robot = "planar_2dof"
stop = 0.02
step = 0.001
"""
WAY = """
[way]
q_start = [-1.5, 0.25]
q_end = [0.0, 0.5]
T = 1.0
"""
OWN = """from vdfmu.unit import JOINTS, Output, Parameter, Unit

class Own(Unit):
    \"\"\"A motion of another form.\"\"\"

    begin = Parameter("position", JOINTS, "where it is", start=0.5)
    q_d = Output("position", JOINTS, "desired position")
    q_d_dot = Output("velocity", JOINTS, "desired velocity")

    def outputs(self) -> None:
        self.q_d = self.begin
        self.q_d_dot = 0.0 * self.begin
"""


@pytest.fixture
def mine(tmp_path):
    def load(more: str = "", system: str = SYSTEM, way: str = WAY):
        (tmp_path / "mine.sys.toml").write_text(system)
        (tmp_path / "mine.toml").write_text(SCENARIO + way + more)
        (tmp_path / "own.py").write_text(OWN)
        return load_scenario(tmp_path / "mine.toml")

    return load


def test_plant_factors_reach_a_plant_of_any_name_or_are_noted(mine):
    scenario = mine("[plant_factors]\nmass = 2.0\n[payload]\nmass = 0.5\nknown = false\n")
    values = system_values(scenario)["arm"]
    assert values["mass[1]"] == 2.0 * load_robot("planar_2dof").mass[0]
    assert values["payload_mass"] == 0.5
    assert not model_notes(scenario)
    own_robot = SYSTEM.replace('arm = "plant"', 'arm = { unit = "plant", robot = "planar_2dof" }')
    scenario = mine("[plant_factors]\nmass = 2.0\n", own_robot)
    (note,) = model_notes(scenario)
    assert re.match(r"plant_factors: not used, because .* Write parameters of the plant in its own section", note)
    two_plants = own_robot.replace("pd = ", 'other = "plant"\npd = ')
    (note,) = model_notes(mine("[plant_factors]\nmass = 2.0\n", two_plants))
    assert note == "plant_factors: arm has its own robot, so this does not apply to it."


def test_plants_start_where_their_motion_begins_unless_a_file_says_otherwise(mine):
    values = system_values(mine())["arm"]
    assert (values["q_0[1]"], values["q_0[2]"]) == (-1.5, 0.25)
    motion = '[motion]\nkind = "waypoints"\npoints = [[0.3, 0.1], [0.5, 0.2]]\ntimes = [0.0, 1.0]\n'
    values = system_values(mine(motion, SYSTEM.replace("way", "trajectory"), ""))["arm"]
    assert (values["q_0[1]"], values["q_0[2]"]) == (0.3, 0.1)
    two = SYSTEM.replace('arm = "plant"', 'arm = "plant"\nghost = "plant"').replace(
        '["arm.tau"]', '["arm.tau", "ghost.tau"]'
    )
    scenario = mine(system=two)
    assert scenario.system.shared == {"start": {"way": "q_start", "arm": "q_0", "ghost": "q_0"}}
    assert system_values(scenario)["ghost"]["q_0[1]"] == -1.5
    values = system_values(mine("[arm]\nq_0 = [0.1, 0.2]\n"))["arm"]
    assert (values["q_0[1]"], values["q_0[2]"]) == (0.1, 0.2)
    shared = SYSTEM + '[shared.mine]\nway = "q_end"\narm = "q_0"\n'
    assert system_values(mine(system=shared))["arm"]["q_0[2]"] == 0.5


@pytest.mark.parametrize("tolerance", [0.5, math.nan, -1.0])
def test_the_tolerance_is_one_that_the_solvers_take(mine, tolerance):
    with pytest.raises(UsageError, match=r"arm\.tolerance: expected"):
        system_values(dataclasses.replace(mine(), tolerance=tolerance))


def test_the_tolerance_of_the_solvers_reaches_no_parameter_of_this_name_in_a_unit_without_one(mine, tmp_path):
    scenario = dataclasses.replace(mine(), tolerance=1e-9)
    more = '    tolerance = Parameter("m", text="of the parts", start=0.5)\n    q_d ='
    (tmp_path / "own.py").write_text(OWN.replace("    q_d =", more, 1))
    assert system_values(scenario)["arm"]["tolerance"] == 1e-9
    scenario = with_units(scenario, {"way": tmp_path / "own.py"})
    assert "tolerance" not in system_values(scenario)["way"]


@pytest.mark.parametrize("unit", [3, None, int])
def test_what_is_no_unit_is_refused(mine, unit):
    with pytest.raises(UsageError, match="units: pd: expected a unit, its name or its file, got"):
        with_units(mine(), {"pd": unit})


@pytest.mark.parametrize("name", ["system", "two_arms", "screw", "wall", "estimator"])
def test_the_shipped_systems_say_what_would_be_taken(name):
    system = load_system(name)
    assert with_starts(system).shared == system.shared
    bare = with_starts(dataclasses.replace(system, shared={}))
    assert [*bare.shared.values()] == [*system.shared.values()]


@pytest.mark.parametrize(("factor", "kept"), [(1.0, True), (1.5, False)])
def test_the_numbers_of_the_paper_are_those_of_its_robot(factor, kept):
    """A changed robot of the same name is another."""
    robot = load_robot("manipulator_6dof")
    changed = robot.with_parameters(mass=factor * robot.mass)
    assert changed.name == robot.name
    assert bool(load_scenario("two_joint", changed).paper) is kept


@pytest.mark.heavy
def test_another_start_than_that_of_the_motion_is_noted(mine, tmp_path):
    def notes(more):
        results = vdfmu.run(
            mine(f"[way]\nbegin = [0.5, 0.25]\n{more}", SYSTEM.replace('"trajectory"', '"own.py"'), ""),
            out=tmp_path / "run", reference=False,
        )  # fmt: skip
        return [note for note in results.summary["notes"] if "starts" in note]

    (note,) = notes("[arm]\nq_0 = [0.5, 0.0]\n")
    assert "arm starts 0.25 rad from the start of way at joint 2, and the first torque there is" in note
    assert "link-side: set arm.q_0, or share" in note
    assert notes("[arm]\nq_0 = [0.5, 0.25]\n") == []
