"""Bodies without inertia in a URDF get that of their shapes, or what a file of drives says; else they are refused."""

import mujoco
import numpy as np
import pytest

import vdfmu
from tests.extras.robots.conftest import ARM, link
from vdfmu.arm.robot import Robot, robot_from_dict
from vdfmu.extras.robots import import_robot, robot_from_urdf

BOX = '<origin xyz="0.1 0 0.2" rpy="0.3 -0.2 0.5"/><geometry><box size="0.1 0.2 0.3"/></geometry>'
ROD = '<origin xyz="0 0.05 -0.1" rpy="0 1 0"/><geometry><cylinder radius="0.05" length="0.4"/></geometry>'
BALL = '<origin xyz="0.3 0 0"/><geometry><sphere radius="0.08"/></geometry>'
MESH = '<geometry><mesh filename="no.stl"/></geometry>'
SHAPED = f"<visual>{BOX}</visual><visual>{ROD}</visual><visual>{BALL}</visual>"


def with_one(inside: str) -> str:
    return ARM.replace(link("one"), link("one", inside))


def mass_of(robot: Robot, i: int = 0) -> dict[str, object]:
    return robot.to_dict()["joints"][i]["link"]


def test_shapes_have_the_inertia_that_mujoco_gives_them(urdf):
    """In a frame of its own, z along the joint's axis: joint a turns about y of the link."""
    robot = robot_from_urdf(urdf(with_one(SHAPED)), density=2700.0)
    link_1 = mass_of(robot)
    body = mujoco.MjModel.from_xml_string(
        """<mujoco><compiler angle="radian" eulerseq="XYZ"/><worldbody><body>
        <geom type="box" density="2700" size="0.05 0.1 0.15" pos="0.1 0 0.2" euler="0.3 -0.2 0.5"/>
        <geom type="cylinder" density="2700" size="0.05 0.2" pos="0 0.05 -0.1" euler="0 1 0"/>
        <geom type="sphere" density="2700" size="0.08" pos="0.3 0 0"/><joint/></body></worldbody></mujoco>"""
    )
    assert link_1["mass"] == pytest.approx(float(body.body_mass[1]), rel=1e-12)  # sums of three products
    R = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])  # z turned onto y by the shortest turn
    np.testing.assert_allclose(link_1["centroid"], R.T @ body.body_ipos[1], rtol=0, atol=1e-13)
    moments = np.linalg.eigvalsh(link_1["inertia"])
    np.testing.assert_allclose(moments, np.sort(body.body_inertia[1]), rtol=1e-10)  # of its diagonalisation
    axes = np.zeros(9)
    mujoco.mju_quat2Mat(axes, body.body_iquat[1])
    turned = R.T @ axes.reshape(3, 3)
    expected = turned @ np.diag(body.body_inertia[1]) @ turned.T
    # MuJoCo before 3.14 ends its turns at a cosine of 1 - 1e-12, which leaves the axes off by up to 1.4e-6 rad
    np.testing.assert_allclose(link_1["inertia"], expected, rtol=0, atol=1.5e-6 * moments[-1])


def test_what_is_made_of_shapes_is_said(urdf, tmp_path):
    path = urdf(with_one(SHAPED))
    imported = import_robot(path, density=1000.0)
    for key in ("mass", "centroid", "inertia"):
        assert imported.robot.source_of(f"joints[1].link.{key}") == "Assumed: shapes of one in arm.urdf, 1000 kg/m3"
        assert imported.robot.source_of(f"joints[2].link.{key}").startswith("arm.urdf: the links")
    assert any(note.startswith("joint a: 11.29 kg, with the inertia of the shapes of one") for note in imported.notes)
    # a known mass alone: the same shape
    drives = tmp_path / "drives.toml"
    drives.write_text("[a]\nlink.mass = 5.0\n", encoding="utf-8")
    weighed = robot_from_urdf(path, drives=drives)
    assert weighed.mass[0] == 5.0 and weighed.source_of("joints[1].link.mass") == "drives.toml: a"
    ratio = 5.0 / imported.robot.mass[0]
    np.testing.assert_allclose(weighed.inertia[0], ratio * imported.robot.inertia[0], rtol=1e-14)
    np.testing.assert_allclose(weighed.centroid[0], imported.robot.centroid[0], rtol=1e-14)
    # a density does nothing for links that have an inertia
    np.testing.assert_array_equal(imported.robot.mass[1:], robot_from_urdf(urdf(ARM)).mass[1:])


def test_an_inertia_of_zero_is_completed_by_collisions_before_visuals_and_the_mass_stays(urdf):
    ball = 4.0 / 3.0 * np.pi * 0.08**3
    for inside, volume in (
        (f"<visual>{MESH}</visual><collision>{BALL}</collision>", ball),
        (f"<visual>{BALL}</visual><collision>{MESH}</collision>", ball),
        (f"<visual>{BOX}</visual><collision>{BALL}</collision>", ball),
    ):
        robot = robot_from_urdf(urdf(with_one(inside)), density=1000.0)
        assert robot.mass[0] == pytest.approx(1000.0 * volume, rel=1e-14)
    zero = '<inertial><mass value="2"/><inertia ixx="0" iyy="0" izz="0" ixy="0" ixz="0" iyz="0"/></inertial>'
    path = urdf(with_one(zero + f"<visual>{BALL}</visual>"))
    with pytest.raises(
        vdfmu.VdfmuError, match=r"link one: expected positive definite, .* Give them by --drives: \[a\]"
    ):
        robot_from_urdf(path)
    robot = robot_from_urdf(path, density=500.0)
    assert robot.mass[0] == 2.0 and not robot.centroid[0].any()
    np.testing.assert_allclose(robot.inertia[0], 0.4 * 2.0 * 0.08**2 * np.eye(3), rtol=1e-14)


def test_a_file_of_drives_gives_what_meshes_do_not(urdf, tmp_path):
    path, drives = urdf(with_one(f"<visual>{MESH}</visual>")), tmp_path / "drives.toml"
    for text, words in (
        ("", "joint a: expected a link with mass, which it moves, got no <inertial> with a mass in one"),
        ("[a]\nlink.mass = 3.0\n", "link one: expected positive definite"),
        ("[a]\nlink = { mass = -3.0, weight = 1 }\n", "a.link.mass: expected a finite number > 0"),
        ("[a]\nlink = { mass = 3.0, inertia = [0.1, 0.1, 1.0] }\n", "triangle inequality"),
    ):
        drives.write_text(text, encoding="utf-8")
        with pytest.raises(vdfmu.VdfmuError, match=words):
            robot_from_urdf(path, drives=drives, density=1000.0)
    drives.write_text(
        '["*"]\nlink.mass = 9.0\n[a]\nlink = { mass = 3.0, centroid = [0, 0, 0.1], inertia = 0.02 }\n', encoding="utf-8"
    )
    robot = robot_from_urdf(path, drives=drives)
    assert robot.mass.tolist() == [3.0, 9.0, 9.0]  # a later table comes before
    assert robot.centroid[0].tolist() == [0.0, 0.0, 0.1]
    np.testing.assert_array_equal(robot.inertia[0], 0.02 * np.eye(3))
    with pytest.raises(vdfmu.VdfmuError, match="density: expected a number above 0 in kg/m3, got -1"):
        robot_from_urdf(path, density=-1.0)
    with pytest.raises(vdfmu.VdfmuError, match="density: expected a number, got 'steel'"):
        robot_from_urdf(path, density="steel")


def test_joints_keep_their_names(urdf, tmp_path):
    imported = import_robot(urdf(ARM))
    file = tmp_path / "arm.toml"
    file.write_text(imported.text, encoding="utf-8")
    robot = vdfmu.load_robot(file)
    assert robot.joint_names == ("a", "b", "c") and robot.joint_labels == ["1 a", "2 b", "3 c"]
    assert robot_from_dict(robot.to_dict()).joint_names == robot.joint_names
    data = robot.to_dict()
    data["joints"][2]["name"] = "a"
    with pytest.raises(vdfmu.VdfmuError, match=r"joints\[3\].name: expected its own name, got the name of joints\[1\]"):
        robot_from_dict(data)
    plain = vdfmu.load_robot("planar_2dof")
    assert plain.joint_labels == ["1", "2"] and "name" not in plain.to_dict()["joints"][0]
