"""A robot's parameters are defined in one table, and everything else follows from it."""

import numpy as np
import pytest

from vdfmu.arm.kernel import Kernel
from vdfmu.arm.robot import Robot, load_robot, robot_from_dict
from vdfmu.arm.robot.parameters import OPTIONAL, PARAMETERS
from vdfmu.base.measure import JOINT_TYPES, measure
from vdfmu.system.scenario.replace import robot_for


@pytest.mark.parametrize("name", PARAMETERS)
def test_every_unit_of_measurement_is_one_of_fmi(name):
    row = PARAMETERS[name]
    units = [row.unit(joint_type) for joint_type in JOINT_TYPES]
    assert [measure(unit).name for unit in units] == units


def test_a_robot_has_the_flags_and_shapes_of_the_table_and_no_parameters_of_an_inertia_of_zero():
    robot = load_robot("planar_2dof")
    assert not any(getattr(robot, name) for name in OPTIONAL)
    robot = load_robot("slider_3dof")
    for row in PARAMETERS.values():
        assert getattr(robot, row.name).shape == ((3,) if row.per_joint else ()) + row.shape
    robot = Robot(**{**vars(load_robot("planar_2dof")), "payload": True})
    row = PARAMETERS["payload_inertia"]
    assert not any(row.is_free(robot, index) for index in np.ndindex(3, 3))
    heavy = robot.with_parameters(payload_inertia=np.eye(3))
    assert [i for i in np.ndindex(3, 3) if row.is_free(heavy, i)] == [(0, 0), (1, 1), (2, 2)]


def test_an_unfolded_robot_has_its_zeros_as_parameters(draw):
    folded = load_robot("planar_2dof")
    robot = folded.unfolded()
    names = {p.name for p in robot.entries()} - {p.name for p in folded.entries()}
    assert names == {
        "gravity[1]", "gravity[2]", "tool_offset[2]", "tool_offset[3]", "payload_mass", "payload_centroid[1]",
        "payload_centroid[2]", "payload_centroid[3]", "centroid[1,2]", "centroid[1,3]", "centroid[2,2]",
        "centroid[2,3]",
    }  # fmt: skip
    assert {*folded.constants()} - {*robot.constants()} == {n for n in names if not n.startswith("payload")}
    for each in (folded, robot):
        assert {*each.constants()}.isdisjoint({p.name for p in each.entries()} | {p.field for p in each.entries()})
    again = robot_from_dict(robot.to_dict())
    assert not again.folded and again.key() == robot.key() != folded.key()
    kernels, sizes = [Kernel(each, None) for each in (folded, robot)], [2, 2, 2, 6]
    for state in draw(folded, 3, seed=4):
        columns = [state.q, state.q_dot, state.q_ddot, state.F_e]
        torques = [kernel.rows("inverse_dynamics", columns, sizes) for kernel in kernels]
        np.testing.assert_array_equal(*torques)


def test_a_file_can_be_unfolded_and_settings_unfold():
    data = load_robot("planar_2dof").to_dict()
    assert robot_from_dict(data | {"folded": False}).payload
    robot = robot_from_dict(data)
    assert robot_for(robot, ["plant.mass[1]", "plant.gravity", "robot.gravity[3]"]) is robot
    for name in ("plant.gravity[1]", "centroid[2,3]", "robot.tool_offset[2]"):
        assert not robot_for(robot, [name]).folded
    only = robot_for(robot, ["payload_mass"])
    assert only.folded and only.payload
