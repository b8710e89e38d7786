"""A robot that is exported is the robot of the plant, in MuJoCo and when it is imported again."""

import dataclasses

import mujoco
import numpy as np
import pytest
from lxml import etree
from scipy.integrate import solve_ivp

import vdfmu
from tests.extras.robots.conftest import differences, largest_difference, pinocchio_arm
from vdfmu.arm.equations.plant import equilibrium_torque
from vdfmu.arm.robot import Robot
from vdfmu.extras.robots import export_robot, import_robot

STEP, STOP = 1e-4, 0.1


def linear(robot: Robot, **flags: bool) -> Robot:
    """Return the robot with the drives that MuJoCo has too: linear springs, viscous friction, no limits."""
    robot = dataclasses.replace(robot, friction="lumped", limits=False, **flags)
    return robot.with_parameters(c_f=1e-9, c_w=1e-9, f_c=0.0, f_s=0.0, theta_err_amplitude=0.0)


@pytest.mark.parametrize(
    ("name", "coupling"), [("manipulator_6dof", True), ("manipulator_6dof", False), ("slider_3dof", True)]
)
def test_the_fall_in_mujoco_is_that_of_the_plant(tmp_path, plant_function, name, coupling):
    robot, path = linear(vdfmu.load_robot(name), rotor_coupling=coupling), tmp_path / "arm.xml"
    assert export_robot(robot, path) == []
    model = mujoco.MjModel.from_xml_path(str(path))
    model.opt.timestep, model.opt.integrator = STEP, mujoco.mjtIntegrator.mjINT_RK4
    data = mujoco.MjData(model)
    q = [model.joint(f"joint_{i + 1}").qposadr[0] for i in range(robot.n)]
    rotors = [model.joint(f"joint_{i + 1}_rotor").qposadr[0] for i in range(robot.n)]
    tau = np.asarray(equilibrium_torque(robot, np.zeros(robot.n)), dtype=float)
    data.qpos[rotors] = tau * robot.ell * (1.0 / robot.K_f0 + 1.0 / (robot.ell**2 * robot.K_w0))
    mujoco.mj_step(model, data, nstep=round(STOP / STEP))
    derivatives, start = plant_function(robot, "derivatives"), np.concatenate([np.zeros(3 * robot.n), tau])
    rest = np.zeros(robot.n), np.zeros(6)
    plant = solve_ivp(lambda t, x: derivatives(x, *rest), (0.0, STOP), start, method="DOP853", rtol=1e-9, atol=1e-11).y[
        : robot.n, -1
    ]
    assert np.abs(plant).max() > 0.01
    # springs of at most 100 Hz at steps of 0.1 ms: (2 pi 100 STEP)^5 / 120 of some 1e-3 rad a step, 1e-8 in all; c_f of
    # 1e-9 leaves 1e-14 of a spring's compliance, c_w 1e-8
    np.testing.assert_allclose(data.qpos[q], plant, rtol=0.0, atol=1e-7)


@pytest.mark.parametrize("name", ["ur5e_6dof", "scara_4dof", "slider_3dof"])
def test_a_rigid_robot_comes_back(tmp_path, name):
    robot = vdfmu.load_robot(name)
    joints = [f"joint_{i + 1}" for i in range(robot.n)]
    for path, rigid in ((tmp_path / "arm.xml", True), (tmp_path / "arm.urdf", False)):
        export_robot(robot, path, rigid=rigid)
        back = import_robot(path, tip="tool").robot
        for field in ("mass", "centroid", "inertia", "offset", "rotation", "tool_offset", "tool_rotation", "gravity"):
            # the files' rotations are orthogonal to 1e-10
            np.testing.assert_allclose(getattr(back, field), getattr(robot, field), rtol=1e-9, atol=1e-9, err_msg=field)
        split = robot.friction == "split"
        np.testing.assert_allclose(back.f_v, robot.f_v, rtol=1e-15)
        np.testing.assert_allclose(back.f_c, robot.f_c + split * robot.ell * robot.f_ck, rtol=1e-15)
        if rigid:
            # 1e-10 as above
            assert largest_difference(path, robot, joints) < 1e-9
            # an importer assumes another ratio: what the link feels is the same
            np.testing.assert_allclose(back.I_m * back.ell, robot.I_m * robot.ell, rtol=1e-14)
        else:
            # 1e-10 as above, times the condition of M
            assert max(differences(robot, pinocchio_arm(path, joints), 5)) < 1e-8
        if robot.limits:
            np.testing.assert_allclose(back.q_max, robot.q_max, rtol=1e-15)
            np.testing.assert_allclose(back.tau_stall * back.ell, robot.tau_stall * robot.ell, rtol=1e-14)
            if not rigid:
                np.testing.assert_allclose(back.kappa_dot_max, robot.kappa_dot_max, rtol=1e-14)


@pytest.mark.parametrize("name", ["ur5e_6dof", "scara_4dof", "slider_3dof"])
def test_rotors_and_springs_come_back(tmp_path, name):
    robot, path = vdfmu.load_robot(name), tmp_path / "arm.xml"
    export_robot(robot, path)
    imported = import_robot(path)
    rule = "the tool is at the origin of tool, which is fixed to the last link that moves"
    rule += ", on the axis of the last joint" * imported.robot.tool_on_last_axis
    assert imported.robot.tool_on_last_axis == robot.tool_on_last_axis
    assert imported.notes == [rule]
    back = imported.robot
    for field in ("mass", "centroid", "inertia", "offset", "rotation", "tool_offset", "tool_rotation", "gravity"):
        # the files' rotations are orthogonal to 1e-10; a rotor of 1e-6 kg is split off and joined again
        np.testing.assert_allclose(getattr(back, field), getattr(robot, field), rtol=1e-9, atol=1e-9, err_msg=field)
    for field in ("ell", "I_m", "f_v", "f_c"):
        np.testing.assert_allclose(getattr(back, field), getattr(robot, field), rtol=1e-12, err_msg=field)
    # 1 / (ell^2 K_w0), 1e-11 of the spring's compliance
    compliance = 1.0 / robot.K_f0 + 1.0 / (robot.ell**2 * robot.K_w0)
    np.testing.assert_allclose(1.0 / back.K_f0, compliance, rtol=1e-9)
    if robot.limits:
        np.testing.assert_allclose(back.tau_stall, robot.tau_stall, rtol=1e-12)
    assert str(back.source_of("joints[1].drive.ell")) == "arm.xml: tendon between the joint and its rotor"


def test_notes_and_the_file_say_what_is_left_out(tmp_path):
    robot = dataclasses.replace(vdfmu.load_robot("ur5e_6dof"), moving_base=True, friction="split")
    robot = dataclasses.replace(robot, description="A --- B -- C <&>")
    robot = robot.with_parameters(theta_err_amplitude=1e-5, gravity=[0.0, 9.81, 0.0])
    for name in ("arm.xml", "arm.urdf"):
        notes = export_robot(robot, tmp_path / name)
        text = (tmp_path / name).read_text(encoding="utf-8")
        assert all(note in text for note in notes)
        assert "A - - - B - - C <&>" in text and etree.fromstring(text.encode()) is not None
        every = " ".join(notes)
        for key in ("c_f", "theta_err_amplitude", "f_s", "stop_stiffness", "moving base"):
            assert key in every
        assert ("gravity" in every, "ell, I_m" in every) == (name.endswith("urdf"),) * 2
        assert "joints.link.mass: " in text


def test_a_slender_link_has_the_rotor_too(tmp_path):
    robot = linear(vdfmu.load_robot("planar_2dof"))
    inertia = robot.inertia.copy()
    # a rod, whose moments meet the triangle inequality with equality
    inertia[0] = np.diag([1e-9, 0.1, 0.1])
    notes = export_robot(robot.with_parameters(inertia=inertia), tmp_path / "arm.xml")
    assert notes == ["link 1 is too slender to give rotor 2 its transverse inertia, and keeps it."]
    mujoco.MjModel.from_xml_path(str(tmp_path / "arm.xml"))


def test_a_rigid_file_says_that_its_rotors_are_not_bodies(tmp_path):
    notes = export_robot("planar_2dof", tmp_path / "arm.xml", rigid=True)
    assert "turning of the rotors with the links that carry them: rotor_coupling." in notes


@pytest.mark.parametrize(
    ("arguments", "options", "expected"),
    [
        (("arm.txt",), {}, "to must be mjcf or urdf, got 'arm.txt'"),
        (("arm.xml", "sdf"), {}, "got 'sdf'"),
        (("arm.urdf",), {"rigid": True}, "rigid must be False for a URDF"),
        (("nowhere/arm.urdf",), {}, "cannot write nowhere"),
    ],
)
def test_a_wrong_file_is_an_error(tmp_path, monkeypatch, arguments, options, expected):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(vdfmu.VdfmuError, match=expected):
        export_robot("planar_2dof", *arguments, **options)
