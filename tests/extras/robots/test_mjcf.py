"""An arm of a MuJoCo file is that of MuJoCo."""

import os
import sys
from pathlib import Path

import pytest

import vdfmu
from tests.extras.robots.conftest import largest_difference
from vdfmu.extras.robots import import_robot, robot_from_mjcf

ARM = """<mujoco model="arm"><compiler angle="radian"/><option gravity="1 2 -9"/>
<default><joint damping="0.3" armature="0.01"/></default>
<worldbody><geom type="plane" size="1 1 1"/><geom type="box" size="0.1 0.1 0.1"/>
<body name="one" pos="0.1 0.2 0.3" euler="0.1 0.2 0.3">
 <joint name="turn" axis="1 2 3" pos="0.1 0 0.2" ref="0.4" range="-1 1" frictionloss="0.2"/>
 <geom type="box" size="0.1 0.2 0.3" pos="0.1 0.1 0" rgba="1 0 0 1"/>
 <body name="two" pos="0.3 0 0" quat="0.5 0.1 0.2 0.3">
  <joint name="slide" type="slide" axis="1 0 1" ref="0.2" damping="0" armature="2"/>
  <geom type="capsule" size="0.05" fromto="0 0 0 0.1 0.2 0.3"/>
  <body name="cap" pos="0 0.1 0"><geom size="0.1" group="3"/></body>
  <body name="three" pos="0 0 0.3"><joint name="last" axis="0 0 -1"/><geom size="0.1" pos="0.1 0 0"/></body>
 </body>
</body></worldbody>
<actuator><motor joint="turn" gear="20" ctrlrange="-3 2"/></actuator></mujoco>"""
PAIR = '<body name="{0}"><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>{1}</body>'


@pytest.fixture
def mjcf(tmp_path):
    def write(text: str) -> Path:
        path = tmp_path / "arm.xml"
        path.write_text(text, encoding="utf-8")
        return path

    return write


def test_inverse_dynamics_are_those_of_mujoco_from_a_base_to_a_tip(mjcf):
    path = mjcf(ARM)
    robot = robot_from_mjcf(path)
    assert robot.joint_types == ("revolute", "prismatic", "revolute")
    assert largest_difference(path, robot, ["turn", "slide", "last"]) < 1e-12  # some 100 n roundings
    imported = import_robot(path, tip="two")
    assert largest_difference(path, imported.robot, ["turn", "slide"]) < 1e-12  # as above
    assert "held at 0, because they are not part of the arm: last." in imported.notes


def test_what_the_file_says_of_drives_and_shapes_is_taken_over(mjcf):
    robot = robot_from_mjcf(mjcf(ARM))
    first, second, _ = robot.to_dict()["joints"]
    assert (first["limits"]["q_min"], first["limits"]["q_max"]) == (-1.0, 1.0)
    assert first["limits"]["tau_stall"] == 3 * 20 / 100  # motor-side
    assert (first["friction"]["f_v"], first["friction"]["f_c"]) == (0.3, 0.2)
    assert first["drive"]["I_m"] == 0.01 / 100  # armature is that of the rotor times ell^2, I_m times ell
    assert robot.source_of("joints[1].drive.I_m") == "arm.xml: armature of the joint"
    assert str(robot.source_of("joints[2].friction.f_v")).startswith("Assumed")  # 0 is what MuJoCo has without one
    assert robot.gravity.tolist() == [-1.0, -2.0, 9.0]
    assert second["limits"]["q_max"] == 1e6
    looks = [(visual.joint, visual.shape, visual.size.tolist()) for visual in robot.visuals]
    assert looks[:2] == [(0, "box", [0.2, 0.2, 0.2]), (1, "box", [0.2, 0.4, 0.6])]
    assert [shape for _, shape, _ in looks[2:]] == ["capsule", "sphere"]
    assert robot.visuals[1].color.tolist() == [1.0, 0.0, 0.0, 1.0]


@pytest.mark.parametrize(("inside", "further", "expected"), [
    (PAIR.format("a", "<freejoint/>"), "", "joint joint 1 of a: expected one of revolute, continuous, prismatic"),
    (PAIR.format("a", '<joint type="ball"/>'), "", "got ball. Choose a base above it, --base a"),
    (PAIR.format("a", '<joint name="j"/><joint name="k" axis="1 0 0"/>'), "",
     "joint j: expected a link with mass, which it moves, got no <inertial> with a mass in a at j."),
    (PAIR.format("a", '<joint name="j"/>' + PAIR.format("b", '<joint name="k"/>')),
     '<equality><joint joint1="k" joint2="j"/></equality>',
     "joint k: expected a joint with its own drive, got one that mimics j."),
    (PAIR.format("a", '<joint name="j"/>' + PAIR.format("b", '<joint name="k"/>')),
     '<equality><connect name="bar" body1="b" body2="world" anchor="0 0 0"/></equality>',
     "bar: expected links of one chain, got a loop: it connects b to world in addition to the joints. An arm must"),
    ("<body/><nonsense/>", "", "expected a model that MuJoCo compiles, got: XML Error"),
])  # fmt: skip
def test_what_is_no_arm_is_refused(mjcf, inside, further, expected):
    path = mjcf(f"<mujoco><worldbody>{inside}</worldbody>{further}</mujoco>")
    with pytest.raises(vdfmu.VdfmuError) as error:
        tip = "b" if 'name="b"' in inside else None
        robot_from_mjcf(path, tip=tip)
    assert expected in str(error.value)


def test_without_mujoco_the_package_is_named(mjcf, monkeypatch):
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(vdfmu.VdfmuError, match=r"Install it: pip install 'vdfmu\[robots\]'"):
        robot_from_mjcf(mjcf(ARM))


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="the platform has no pipes in folders")
@pytest.mark.parametrize("text", [
    '<mujoco><include file="special"/></mujoco>',
    '<mujoco><include file="more.xml"/></mujoco>',
    '<mujoco><compiler meshdir="meshes"/><asset><mesh name="a" file="../special"/></asset></mujoco>',
])  # fmt: skip
def test_a_special_file_is_no_part_of_a_model(special, text):
    Path("meshes").mkdir()
    Path("more.xml").write_text('<mujoco><include file="special"/></mujoco>')
    Path("arm.xml").write_text(text)
    with pytest.raises(vdfmu.VdfmuError, match=r"special must be a regular file: "):
        import_robot(Path("arm.xml"))
