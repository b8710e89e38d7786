"""Robots as they are published: every URDF of example-robot-data."""

import mujoco
import pytest
from lxml import etree

from tests.extras.robots.conftest import largest_difference
from tests.extras.robots.table import folder, parts, table
from vdfmu.extras.robots import import_robot


@pytest.mark.heavy
def test_every_arm_agrees_with_pinocchio_or_is_refused_with_a_reason_as_the_page_says():
    assert table() == parts()[1], "python -m tests.extras.robots.table writes the table anew"


@pytest.mark.heavy
@pytest.mark.parametrize(("file", "tip"), [
    ("ur_description/urdf/ur5_robot.urdf", None),
    ("panda_description/urdf/panda.urdf", None),
    ("xarm_description/urdf/xarm7.urdf", None),
    ("z1_description/urdf/z1.urdf", None),
    ("so_arm_description/urdf/so101.urdf", None),
    ("talos_data/robots/talos_reduced.urdf", "arm_left_7_link"),
])  # fmt: skip
def test_the_same_robots_as_mjcf_agree_with_mujoco(tmp_path, file, tip):
    root = etree.parse(folder() / file).getroot()
    for link in root.findall("link"):  # MuJoCo does not read all meshes
        for shape in (*link.findall("visual"), *link.findall("collision")):
            link.remove(shape)
    options = {"fusestatic": "false", "boundmass": "0", "boundinertia": "0", "balanceinertia": "true"}
    etree.SubElement(etree.SubElement(root, "mujoco"), "compiler", options)
    path = tmp_path / "robot.xml"
    mujoco.mj_saveLastXML(str(path), mujoco.MjModel.from_xml_string(etree.tostring(root).decode()))
    imported = import_robot(path, tip=tip)
    joints = [
        line.partition(": ")[2].partition(", ")[0] for line in imported.text.splitlines() if line.startswith("# Joint ")
    ]
    assert len(joints) >= 6
    assert largest_difference(path, imported.robot, joints) < 1e-12  # some 100 n roundings
