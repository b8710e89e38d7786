"""Two arms, the second on the tool of the first, against the one arm of all their joints."""

import dataclasses

import numpy as np
import pytest

from vdfmu.arm.robot import load_robot
from vdfmu.arm.robot.parameters import PARAMETERS
from vdfmu.base.errors import CosimError, ModelError, UsageError
from vdfmu.engine.run import simulate
from vdfmu.system.package.description import SystemDescription
from vdfmu.system.package.write import cached_fmus, write_ssp
from vdfmu.system.reference.reference import reference
from vdfmu.system.scenario import load_scenario
from vdfmu.system.scenario.scenario import resolve
from vdfmu.system.scenario.scenario_file import load_system
from vdfmu.system.scenario.values import system_values

ONE_ARM = """
name = "one_arm"
[components]
trajectory = "trajectory"
controller = "controller"
plant = "plant"
[shared.start]
trajectory = "q_start"
plant = "q_0"
[connections]
"trajectory.q_d" = ["controller.q_d"]
"trajectory.q_d_dot" = ["controller.q_d_dot", "controller.kappa_dot_d"]
"controller.tau" = ["plant.tau"]
"plant.q" = ["controller.q"]
"plant.q_dot" = ["controller.q_dot"]
"plant.kappa_dot" = ["controller.kappa_dot"]
"""


def joined(arm, added):
    """Arm of all joints of two, the second on the tool of the first."""
    arrays = {
        name: np.concatenate([getattr(arm, name), getattr(added, name)])
        for name, row in PARAMETERS.items()
        if row.per_joint
    }
    arrays["offset"][arm.n] += arm.tool_offset
    return dataclasses.replace(
        arm, name="joined", joint_types=arm.joint_types + added.joint_types, tool_offset=added.tool_offset, **arrays
    )


@pytest.fixture
def both(tmp_path):
    two = load_scenario("two_arms")
    sections = {
        name: {
            key: value if key == "T" else [*two.sections[name][key], *two.sections[f"{name}_2"][key]]
            for key, value in two.sections[name].items()
        }
        for name in ("trajectory", "controller")
    }
    (tmp_path / "one_arm.toml").write_text(ONE_ARM)
    robot = joined(two.robot, load_robot("planar_2dof"))
    return two, dataclasses.replace(
        two, name="one_arm", robot=robot, system=load_system(str(tmp_path / "one_arm.toml")), sections=sections
    )


def positions(results, scenario):
    plants = [name for name in scenario.system.parts if name.startswith("plant")]
    return np.hstack([results[f"{plant}.q"] for plant in plants])


@pytest.mark.heavy
def test_without_sampling_they_are_one_arm(both):
    """Apparent mass and wrench are exact: they differ by LSODA's 1e-12 on states of up to 1e2, over elastic modes."""
    q = []
    for scenario in both:
        description = SystemDescription(scenario, system_values(scenario))
        q.append(positions(reference("continuous", description, step=0.05, stop=0.2), scenario))
    assert np.ptp(q[0], axis=0).min() > 1e-5  # all of them move
    np.testing.assert_allclose(q[0], q[1], rtol=0, atol=1e-9)


def direct(scenario):
    """Return the scenario with the wrench itself instead of apparent mass and wrench at rest: an algebraic loop."""
    kept = {
        source: targets
        for source, targets in scenario.system.connections.items()
        if source not in ("plant_2.M_S", "plant_2.F_S0")
    }
    system = dataclasses.replace(scenario.system, connections=kept | {"plant_2.F_S": ["plant.F_e"]})
    return dataclasses.replace(scenario, system=system)


@pytest.mark.heavy
def test_the_coupling_has_the_order_of_the_master(both, tmp_path):
    """At half the step the difference to the one arm is a half with jacobi, a quarter with extrapolated, iterative."""
    packages = {}
    for name, case in (("two", both[0]), ("one", both[1]), ("direct", direct(both[0]))):
        values = system_values(case)
        fmus = cached_fmus(case, tmp_path / name)
        packages[name] = case, write_ssp(case, fmus, tmp_path / f"{name}.ssp", values)

    def difference(master, step, names=("two", "one")):
        q = []
        for case, package in map(packages.get, names):
            q.append(positions(simulate(package, algorithm=master, step=step, stop=0.5), case)[:: round(1e-3 / step)])
        return np.abs(q[0] - q[1]).max()

    for master, order, bound in (("jacobi", 1, 5e-5), ("extrapolated", 2, 5e-6), ("iterative", 2, 3e-6)):
        errors = [difference(master, step) for step in (1e-3, 5e-4, 2.5e-4)]
        # 0.3 of the order: the elastic modes, up to 200 Hz, have 5 to 20 steps in a period
        assert abs(np.log2(errors[1] / errors[2]) - order) < 0.3
        assert errors[0] < bound
    # the second arm weighs more than the tool of the first: what goes round the loop grows at any step
    for step in (1e-3, 2.5e-4):
        with pytest.raises(CosimError, match="plant"):
            difference("jacobi", step, ("direct", "one"))
    # a master that iterates solves the loop, with 5 times the error
    assert 3.0 * difference("iterative", 1e-3) < difference("iterative", 1e-3, ("direct", "one")) < 1e-4


def test_parts_of_a_system_have_robots_of_their_own(tmp_path):
    path = tmp_path / "system.toml"
    (tmp_path / "mine.toml").write_text('name = "mine"\n')
    text = (
        'name = "ends"\n[components]\none = { unit = "plant", coupled_tool = true }\n'
        'two = { unit = "plant", robot = "planar_2dof" }\n'
    )
    path.write_text(text)
    tables = resolve(load_system(str(path)), load_robot("slider_3dof")).tables
    assert tables["one"].robot.n == 3 and tables["one"].robot.coupled_tool
    assert tables["two"].robot.n == 2 and not tables["two"].robot.coupled_tool
    path.write_text(text.replace("planar_2dof", "planar"))
    with pytest.raises((ModelError, UsageError), match=r"components\.two\.robot: no robot 'planar'"):
        load_system(str(path))
    path.write_text(text.replace("planar_2dof", "mine.toml"))
    with pytest.raises(ModelError, match=r"mine\.toml: gravity: expected"):
        load_system(str(path))
    path.write_text(text.replace("coupled_tool = true", "coupled_tool = 1"))
    with pytest.raises(ModelError, match=r"components\.one\.coupled_tool: expected true or false"):
        load_system(str(path))
