"""The tool of an imported arm is where the file, the user or the shape of the last link has it, and joints move it."""

import re
import tomllib

import numpy as np
import pytest
import trimesh

import vdfmu
from tests.extras.robots.conftest import LIMIT, joint, link
from vdfmu.arm.robot import load_robot, robot_names
from vdfmu.arm.robot.plausible import joints_without_tool
from vdfmu.base.errors import UsageError
from vdfmu.extras.robots import import_robot, robot_from_mjcf, robot_from_urdf

MASS = """<inertial><origin xyz="0.15 0 0"/><mass value="1"/>
<inertia ixx="0.001" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial>"""


def planar(last: str, more: str = "") -> str:
    """Return two links of 0.4 m and more about y, the second with this inside."""
    turns = [
        joint(name, parent, child, axis="0 1 0", origin=f'<origin xyz="{place}"/>', inside=LIMIT)
        for name, parent, child, place in (("a", "base", "upper", "0 0 0.3"), ("b", "upper", "fore", "0.4 0 0"))
    ]
    return link("base", "") + link("upper", MASS) + link("fore", MASS + last) + "".join(turns) + more


def shape(inside: str, origin: str = "", tag: str = "visual") -> str:
    return f"<{tag}>{origin}<geometry>{inside}</geometry></{tag}>"


BEAM = shape('<box size="0.3 0.05 0.04"/>', '<origin xyz="0.15 0 0"/>')
TURN = '<origin xyz="0 0.1 0" rpy="0 1.5707963267948966 0"/>'


@pytest.mark.parametrize(("inside", "end"), [
    (BEAM, [0.3, 0, 0]),
    (BEAM + shape('<cylinder radius="0.06" length="0.1"/>', TURN), [0.3, 0, 0]),  # and a housing at the joint
    (shape('<sphere radius="0.02"/>', '<origin xyz="0.3 0 0"/>') + BEAM, [0.32, 0, 0]),
    (shape('<cylinder radius="0.02" length="0.5"/>', '<origin xyz="0.25 0 0" rpy="0 1.5707963267948966 0"/>'),
     [0.5, 0, 0]),
    (shape('<box size="0.02 0.02 0.2"/>', '<origin xyz="0 0 -0.1"/>'), [0, 0, -0.2]),
    (shape('<box size="0.2 0.04 0.04"/>', '<origin xyz="0.1 0 0"/>', "collision"), [0.2, 0, 0]),
])  # fmt: skip
def test_the_tool_is_where_the_last_link_ends(urdf, inside, end):
    imported = import_robot(urdf(planar(inside)))
    assert "because the file has no tip frame" in imported.notes[0]
    p, R = vdfmu.dynamics.forward_kinematics(imported.robot, [0.0, 0.0])
    np.testing.assert_allclose(p - [0.4, 0, 0.3], end, rtol=0, atol=1e-6)  # to which the file has it
    np.testing.assert_allclose(R, np.eye(3), rtol=0, atol=1e-12)  # axes of the link, some roundings
    assert joints_without_tool(imported.robot) == []
    turned, _ = vdfmu.dynamics.forward_kinematics(imported.robot, [0.0, 0.5])
    assert np.linalg.norm(turned - p) == pytest.approx(2 * np.sin(0.25) * np.linalg.norm(end), rel=1e-5)


def test_a_mesh_that_can_be_read_shows_the_end_and_one_that_cannot_hides_it(urdf, tmp_path):
    """Half of a shape would put the tool at a wrong place, without a word."""
    beam = trimesh.creation.box((0.3, 0.05, 0.04), trimesh.transformations.translation_matrix((0.15, 0, 0)))
    beam.export(tmp_path / "fore.stl")
    robot = robot_from_urdf(urdf(planar(shape('<mesh filename="fore.stl" scale="2 2 2"/>'))))
    p, _ = vdfmu.dynamics.forward_kinematics(robot, [0.0, 0.0])
    np.testing.assert_allclose(p, [1.0, 0, 0.3], rtol=0, atol=1e-6)  # an STL has 7 digits
    imported = import_robot(urdf(planar(BEAM + shape('<mesh filename="gone.stl"/>'))))
    assert "neither a tip frame nor a readable shape" in imported.notes[0]


def test_user_and_file_choose_the_tool_before_shapes_do(urdf):
    tip = link("tip", "") + joint("end", "fore", "tip", "fixed", origin='<origin xyz="0.1 0.2 0.3"/>')
    path = urdf(planar(BEAM, tip))
    for options, at in (
        ({}, [0.1, 0.2, 0.3]),
        ({"tip": "fore"}, [0.3, 0, 0]),
        ({"tool_frame": "fore"}, [0, 0, 0]),
        ({"tip": "fore", "tool": [0.0, 0.0, 0.2]}, [0, 0, 0.2]),
        ({"tool": [0.0, 0.0, 0.2]}, [0.1, 0.2, 0.5]),  # in the frame of the tip
    ):
        p, _ = vdfmu.dynamics.forward_kinematics(robot_from_urdf(path, **options), [0.0, 0.0])
        np.testing.assert_allclose(p - [0.4, 0, 0.3], at, rtol=0, atol=1e-12)
    _, R = vdfmu.dynamics.forward_kinematics(robot_from_urdf(path, tool=[0, 0, 0, 0, 0, np.pi / 2]), [0.0, 0.0])
    np.testing.assert_allclose(R[:, 0], [0, 1, 0], rtol=0, atol=1e-12)  # yaw turns x onto y


def test_a_site_of_mujoco_is_a_tool(tmp_path):
    path, site = tmp_path / "arm.xml", '<site name="one"/><site name="flange" pos="0 0 0.2"/>'
    body = f'<body name="one"><joint name="a" axis="0 1 0"/><geom size="0.1" pos="0.4 0 0"/>{site}</body>'
    path.write_text(f"<mujoco><worldbody>{body}</worldbody></mujoco>", encoding="utf-8")
    for options, at in (({}, [0.5, 0, 0]), ({"tool_frame": "flange"}, [0, 0, 0.2]), ({"tool_frame": "one"}, [0, 0, 0])):
        p, _ = vdfmu.dynamics.forward_kinematics(robot_from_mjcf(path, **options), [0.0])  # the ball ends at 0.5 m
        np.testing.assert_allclose(p, at, rtol=0, atol=1e-6)
    with pytest.raises(vdfmu.VdfmuError, match="got 'flang'. Did you mean \"flange\"?"):
        robot_from_mjcf(path, tool_frame="flang")


def test_a_tool_on_the_last_axis_is_noted_unless_it_was_chosen(urdf):
    forgotten = import_robot(urdf(planar("")))
    assert any("the tool lies on the axis of joint 2 b" in note for note in forgotten.notes)
    assert "tool_on_last_axis" not in tomllib.loads(forgotten.text)
    chosen = import_robot(urdf(planar("")), tool_frame="fore")
    assert chosen.notes[0].endswith("as given, on the axis of the last joint") and len(chosen.notes) == 1
    assert chosen.robot.tool_on_last_axis and tomllib.loads(chosen.text)["tool_on_last_axis"] is True


@pytest.mark.parametrize(("options", "expected"), [
    ({"tool": [0.3]}, "tool: expected 3 numbers in m, or 6"),
    ({"tool": "a b c"}, "tool: expected a number, or a list or rows of them"),
    ({"tool": [0, 0, np.inf]}, "tool: expected 3 numbers in m, or 6"),
    ({"tool": [0, 0, 1], "tool_frame": "fore"}, "tool_frame: cannot be combined with tool or tip"),
    ({"tip": "fore", "tool_frame": "fore"}, "tool_frame: cannot be combined with tool or tip"),
    ({"tool_frame": "for"}, "expected a link of the file, got 'for'. Did you mean \"fore\"?"),
])  # fmt: skip
def test_a_tool_that_cannot_be_is_refused(urdf, options, expected):
    with pytest.raises((UsageError, vdfmu.VdfmuError), match=re.escape(expected)):
        robot_from_urdf(urdf(planar(BEAM)), **options)


@pytest.mark.parametrize("name", robot_names())
def test_every_joint_moves_the_tool_or_the_file_says_that_the_last_does_not(name):
    """By the Jacobian, which has another origin than the rule that it checks; 3 poses, because one may be singular."""
    robot = load_robot(name)
    poses = np.random.default_rng(5).uniform(-1.0, 1.0, (3, robot.n))
    J = np.array([vdfmu.dynamics.jacobian(robot, q) for q in poses])
    speed = np.linalg.norm(J[:, :3], axis=1).max(axis=0)  # of the tool, for each joint
    still = [i + 1 for i in range(robot.n) if speed[i] < 1e-9]
    assert still == joints_without_tool(robot)[::-1] == ([robot.n] if robot.tool_on_last_axis else [])
