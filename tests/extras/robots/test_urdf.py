"""An arm of a URDF is that of Pinocchio, and its robot file says what it is."""

import tomllib

import numpy as np
import pinocchio as pin
import pytest

import vdfmu
from tests.extras.robots.conftest import ARM, INERTIAL, LIMIT, differences, joint, link, pinocchio_arm
from vdfmu.arm.drive.limits import motor_torque
from vdfmu.extras.robots import import_robot, robot_from_urdf
from vdfmu.extras.robots.tree import aligned


def test_the_dynamics_and_the_tool_are_those_of_pinocchio(urdf):
    path = urdf(ARM)
    robot = robot_from_urdf(path)
    assert robot.joint_types == ("revolute", "revolute", "prismatic")
    model = pinocchio_arm(path, ["a", "b", "c"])
    inverse, forward = differences(robot, model, 20)
    assert inverse < 1e-13  # some 100 n roundings
    assert forward < 1e-11  # times the condition number of M, below 100
    data, q = model.createData(), np.array([0.3, -0.8, 0.2])
    pin.framesForwardKinematics(model, data, q)
    p_O, R_O = vdfmu.dynamics.forward_kinematics(robot, q)
    pose = data.oMf[model.getFrameId("tool")]
    # Lengths of 1 m, some ten products.
    np.testing.assert_allclose(p_O, pose.translation, rtol=0, atol=1e-14)
    np.testing.assert_allclose(R_O, pose.rotation, rtol=0, atol=1e-14)


@pytest.mark.parametrize("axis", [[0, 0, 1], [0, 0, -1], [1, 0, 0], [0, -1, 0], [0.6, 0.48, -0.64]])
def test_a_frame_is_turned_onto_an_axis(axis):
    R = aligned(np.array(axis, dtype=float))
    np.testing.assert_allclose(R[:, 2], axis, rtol=0, atol=1e-15)  # one rounding an entry
    np.testing.assert_allclose(R @ R.T, np.eye(3), rtol=0, atol=1e-15)
    assert np.linalg.det(R) > 0


def test_axes_along_frames_give_rotations_of_ones_and_zeros_and_another_base_keeps_gravity(urdf):
    bare = joint("a", "ground", "one", axis="0 1 0", origin="")
    robot = robot_from_urdf(urdf(link("ground", "") + link("one") + bare))
    assert robot.rotation[0].tolist() == [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]]
    path = urdf(ARM)
    robot = robot_from_urdf(path, base="two")
    assert robot.n == 1
    # Held at 0, the joints before the base leave it turned: the slide feels the weight along its axis as there.
    whole = robot_from_urdf(path)
    expected = vdfmu.dynamics.gravity_torque(whole, np.zeros(3))[2:]
    # Weights of 20 N.
    np.testing.assert_allclose(vdfmu.dynamics.gravity_torque(robot, np.zeros(1)), expected, rtol=0, atol=1e-13)


def test_what_moves_beside_the_arm_is_held_and_carried(urdf):
    path = urdf(ARM + link("flap") + joint("d", "one", "flap"))
    imported = import_robot(path, tip="tool")
    assert "held at 0, because they are not part of the arm: d." in imported.notes
    inverse, _ = differences(imported.robot, pinocchio_arm(path, ["a", "b", "c"]), 5)
    assert inverse < 1e-13  # as above


def test_joints_that_are_coupled_and_links_without_mass_are_named(urdf):
    fingers = (
        link("left")
        + link("right")
        + joint("left", "tool", "left")
        + joint("right", "tool", "right", inside=LIMIT + '<mimic joint="left"/>')
    )
    imported = import_robot(urdf(ARM + fingers))
    assert imported.robot.n == 3
    assert "held at 0, because they are not part of the arm: left, right." in imported.notes
    shown = link("case", '<visual><geometry><sphere radius="0.1"/></geometry></visual>') + joint(
        "e", "three", "case", "fixed"
    )
    notes = import_robot(urdf(ARM + shown), tip="tool").notes
    assert "joint c: the file has no mass for case." in notes  # and not to the frame tool, which is none


def test_limits_damping_and_friction_are_taken_over(urdf):
    path = urdf(
        link("ground", "") + link("one") + link("two")
        + joint("a", "ground", "one", inside=LIMIT + '<dynamics damping="0.7" friction="0.2"/>')
        + joint("b", "one", "two", "continuous", inside='<limit effort="20" velocity="5"/>')
    )  # fmt: skip
    imported = import_robot(path)
    joints = imported.robot.to_dict()["joints"]
    limits, friction = joints[0]["limits"], joints[0]["friction"]
    assert [limits[key] for key in ("q_min", "q_max", "tau_stall")] == [-2.0, 1.5, 0.5]
    # effort and velocity are limits each by itself: the whole torque up to the speed
    speed = limits["full_speed"] * limits["kappa_dot_max"]
    assert speed == pytest.approx(3.0, rel=1e-15)
    torque = motor_torque(imported.robot, np.array([9.0, 9.0]), np.array([0.999 * speed, 1.06 * speed]))
    assert (
        torque == pytest.approx([0.5, imported.robot.tau_stall[1]])
        and motor_torque(imported.robot, np.full(2, 9.0), np.full(2, 1.06 * speed))[0] == 0.0
    )
    assert imported.robot.joint_names == ("a", "b") and imported.robot.joint_labels == ["1 a", "2 b"]
    assert [friction[key] for key in ("f_v", "f_c", "f_s")] == [0.7, 0.2, 0.2]  # no Stribeck effect
    assert joints[1]["limits"]["q_max"] == 1e6  # turns without end
    assert joints[1]["friction"]["f_c"] > 0  # assumed
    sources = imported.robot.source_of
    assert sources("joints[1].friction.f_v") == "arm.urdf: damping of the joint"
    assert str(sources("joints[2].friction.f_v")).startswith("Assumed: ")
    assert sources("joints[1].limits.q_max") == "arm.urdf: upper of the joint"


def test_a_range_that_is_none_is_no_end_stop(urdf):
    for ends in ('lower="0" upper="0"', 'lower="-1e16" upper="1e16"', 'effort="3"'):
        robot = robot_from_urdf(
            urdf(link("ground", "") + link("one") + joint("a", "ground", "one", inside=f"<limit {ends}/>"))
        )
        if robot.limits:
            assert (robot.q_min[0], robot.q_max[0]) == (-1e6, 1e6)
    robot = robot_from_urdf(
        urdf(link("ground", "") + link("one") + joint("a", "ground", "one", "continuous", inside=""))
    )
    assert not robot.limits
    assert robot.source_of("joints[1].drive.ell")


def test_the_robot_file_is_what_load_robot_reads_and_every_number_has_a_source(urdf, tmp_path):
    imported = import_robot(urdf(ARM))
    (tmp_path / "arm.toml").write_text(imported.text, encoding="utf-8")
    read = vdfmu.load_robot(tmp_path / "arm.toml")
    assert read.to_dict() == imported.robot.to_dict()
    data = tomllib.loads(imported.text)
    keys = {
        f"joints[{i}].{part}.{key}"
        for i, entry in enumerate(data["joints"], 1)
        for part in ("link", "drive", "friction", "limits")
        for key in entry[part]
    } | {"gravity", "tool_offset", "tool_rotation", "joints[1].rotation", "joints[1].offset"}
    assert [key for key in keys if read.source_of(key) is None] == []
    assert "# Joint 2: b, revolute, moves two, cap, joined to one body" in imported.text


def test_visuals_follow_their_links(urdf, tmp_path):
    (tmp_path / "shapes").mkdir()
    (tmp_path / "shapes" / "one.stl").write_bytes(b"")
    looks = """<visual><origin xyz="1 0 0"/><geometry><mesh filename="package://shapes/one.stl" scale="2 2 2"/>
    </geometry><material name="red"/></visual><visual><geometry><box size="1 2 3"/></geometry></visual>"""
    lost = '<visual><geometry><mesh filename="package://gone/two.stl"/></geometry></visual>'
    content = (
        '<material name="red"><color rgba="1 0 0 1"/></material>'
        + link("ground", '<visual><geometry><cylinder radius="0.1" length="0.4"/></geometry></visual>')
        + link("one", INERTIAL + looks + lost)
        + joint("a", "ground", "one", axis="0 1 0", origin="")
    )
    imported = import_robot(urdf(content), out=tmp_path / "robots" / "arm.toml")
    ground, mesh, box, gone = imported.robot.visuals
    assert (ground.joint, ground.shape, ground.size.tolist()) == (0, "cylinder", [0.1, 0.4])
    assert (mesh.joint, mesh.file, mesh.size.tolist()) == (1, "../shapes/one.stl", [2.0, 2.0, 2.0])
    assert mesh.color.tolist() == [1.0, 0.0, 0.0, 1.0]
    # {B_1} has its z axis along y of the link, and x along x.
    np.testing.assert_allclose(mesh.offset, [1.0, 0.0, 0.0], rtol=0, atol=1e-15)
    np.testing.assert_allclose(mesh.rotation[:, 1], [0.0, 0.0, 1.0], rtol=0, atol=1e-15)
    assert box.shape == "box"
    assert gone.file == "package://gone/two.stl"
    assert any(note.startswith("meshes not found") for note in imported.notes)


def test_a_file_of_xacro_and_a_ratio_that_is_left_out_are_named(urdf):
    path = urdf("")
    path.write_text('<robot xmlns:xacro="http://x"><xacro:include filename="a"/></robot>', encoding="utf-8")
    with pytest.raises(vdfmu.VdfmuError, match=r"Write the URDF first: xacro arm.urdf > arm_plain.urdf"):
        robot_from_urdf(path)

    def transmission(name: str, ratio: str) -> str:
        motor = f'<actuator name="m"><mechanicalReduction>{ratio}</mechanicalReduction></actuator>'
        return f'<transmission name="t_{name}"><joint name="{name}"/>{motor}</transmission>'

    notes = import_robot(urdf(ARM + transmission("a", "-1.0") + transmission("b", "101"))).notes
    assert "ratios of transmissions are ignored; give them in the file of --drives: b." in notes
