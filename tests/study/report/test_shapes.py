"""What a page draws of an arm, against closed forms and the equations."""

import numpy as np
import pytest

import vdfmu
from vdfmu.arm.robot import robot_names
from vdfmu.study.analysis.modes import middle_pose
from vdfmu.study.report.shapes import Chain, own_shapes, turn_to
from vdfmu.study.run.scene import arm_of

ROBOTS = robot_names()


@pytest.mark.parametrize("name", ROBOTS)
def test_frames_and_tubes_lead_to_the_end_effector_of_the_equations(name):
    robot = vdfmu.load_robot(name)
    chain, q = Chain(arm_of(robot, {})), np.array(middle_pose(robot)) + 0.1
    points = chain.points(q)
    assert points.shape == (robot.n + 2, 3)
    # a product of at most 24 rotations of entries of at most 1, at a reach of some metres: 24 * 2^-52 * 5 m
    np.testing.assert_allclose(points[-1], vdfmu.dynamics.forward_kinematics(robot, q)[0], atol=3e-14)
    ends = [*chain.offset, chain.tool_offset]
    parts = list(chain.parts(0.5, chain.reach))
    for tube in (part for part in parts if part.shape == "capsule"):
        half = tube.rotation[:, 2] * tube.size[1] / 2.0
        # one rounding of each number
        np.testing.assert_allclose(tube.offset - half, 0.0, atol=1e-15)
        np.testing.assert_allclose(tube.offset + half, ends[tube.body], atol=1e-15)
    assert [part.body for part in parts if part.colour == "joint"] == list(range(1, robot.n + 1))


def test_up_is_against_gravity_and_a_turn_is_a_rotation():
    for direction in np.vstack([np.eye(3), -np.eye(3), [[1.0, -2.0, 0.5]]]):
        R = turn_to(direction)
        np.testing.assert_allclose(R.T @ R, np.eye(3), atol=1e-15)  # roundings of entries below 1
        assert np.linalg.det(R) == pytest.approx(1.0)
        np.testing.assert_allclose(R[:, 2], direction / np.linalg.norm(direction), atol=1e-15)
    robot = vdfmu.load_robot("planar_2dof")
    arm = arm_of(robot, {}) | {"gravity": [0.0, -3.0, 0.0]}
    assert Chain(arm).up.tolist() == [0.0, -1.0, 0.0]
    still = Chain(arm | {"gravity": [0.0, 0.0, 0.0]})
    assert still.weightless
    assert still.up.tolist() == [0.0, 0.0, 1.0]


def test_shapes_of_the_file_keep_their_place():
    shape = {"joint": 1, "shape": "box", "size": [1.0, 2.0, 3.0], "offset": [0.1, 0.2, 0.3]}
    shape |= {"rotation": np.eye(3).tolist(), "color": [1.0, 0.5, 0.0, 1.0]}
    (part,) = own_shapes([shape, shape | {"shape": "mesh"}])
    assert (part.body, part.shape, part.size, part.colour) == (1, "box", [1.0, 2.0, 3.0], "#ff8000")
    arm = arm_of(vdfmu.load_robot("planar_2dof"), {}) | {"shapes": [shape]}
    assert [each.shape for each in Chain(arm).parts(0.0, 1.0) if each.colour == "#ff8000"] == ["box"]
    assert all(each.shape != "capsule" for each in Chain(arm).parts(0.0, 1.0))  # no tubes beside them
