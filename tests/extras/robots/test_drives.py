"""Drives come from their file, then from the robot's, and are assumed by one rule where neither says anything."""

import tomllib

import numpy as np
import pytest

import vdfmu
from tests.extras.robots.conftest import ARM, LIMIT, joint, link
from vdfmu.arm.robot import Robot
from vdfmu.arm.robot.catalogue import catalogue
from vdfmu.arm.robot.parameters import section
from vdfmu.arm.robot.robot_file import PLAIN
from vdfmu.base.files import data_path
from vdfmu.base.measure import measure
from vdfmu.extras.robots import import_robot, robot_from_urdf

ASSUMED = tomllib.loads((data_path("models") / "drives" / "assumed.toml").read_text(encoding="utf-8"))
ONE = link("ground", "") + link("one")


def one_joint(urdf, kind: str = "revolute", inside: str = LIMIT) -> Robot:
    return robot_from_urdf(urdf(ONE + joint("a", "ground", "one", kind, inside=inside)))


@pytest.mark.parametrize("kind", ["revolute", "prismatic"])
def test_the_drive_of_the_file_of_assumed_drives_has_its_rating(urdf, kind):
    like = ASSUMED[kind]
    limits = f'<limit effort="{like["rating"]}" velocity="0" lower="0" upper="0"/>'
    robot = one_joint(urdf, kind, limits)
    data = robot.to_dict()["joints"][0]
    for part in ("drive", "friction", "limits"):
        for key, value in like[part].items():
            assert data[part][key] == pytest.approx(value, rel=1e-5), key  # six digits are written


@pytest.mark.parametrize("kind", ["revolute", "prismatic"])
def test_another_size_winds_up_by_the_same_angle_and_swings_at_the_same_frequency(urdf, kind):
    """What has a mass in its unit grows with the largest torque, what is per mass falls, the rest stays."""
    small = one_joint(urdf, kind, '<limit effort="2" lower="-1" upper="1"/>')
    large = one_joint(urdf, kind, '<limit effort="6" lower="-1" upper="1"/>')
    assumed = [
        row
        for part in ("drive", "friction", "limits")
        for row in section(part)
        if row.key in ASSUMED[kind][part] and row.foreign not in ("lower", "upper")
    ]
    assert len(assumed) > 10
    for row in assumed:
        power = measure(row.unit(kind)).exponents.get("kg", 0)
        ratio = getattr(large, row.name)[0] / getattr(small, row.name)[0]
        assert ratio == pytest.approx(3.0**power, rel=2e-5), row.name  # six digits each
    assert {measure(row.unit(kind)).exponents.get("kg", 0) for row in assumed} == {-1, 0, 1}


def test_a_joint_without_effort_gets_twice_what_its_load_needs(urdf):
    body = """<inertial><origin xyz="0.5 0 0"/><mass value="3"/>
    <inertia ixx="0.01" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial>"""
    path = urdf(link("ground", "") + link("one", body) + joint("a", "ground", "one", inside="", origin=""))
    torque = 2 * (3 * 9.81 * 0.5 + (3 * 0.5**2 + 0.02) * 10)
    assert f"# largest torque {torque:.6g} N.m: twice what holds" in import_robot(path).text


def test_a_file_of_drives_comes_before_the_robots_own(urdf, tmp_path):
    drives = tmp_path / "drives.toml"
    drives.write_text(
        """
        ["*"]
        source = "measured in 2024"
        drive = { ell = 50.0, K_f0 = 2e4 }
        [b]
        drive.ell = 160
        friction.f_v = 0.3
        [c.limits]
        kappa_dot_max = 0.4
        """,
        encoding="utf-8",
    )
    robot = robot_from_urdf(urdf(ARM), drives=drives)
    data = robot.to_dict()["joints"]
    assert [entry["drive"]["ell"] for entry in data] == [50.0, 160.0, 50.0]
    assert [entry["drive"]["K_f0"] for entry in data] == [2e4] * 3
    # 3 rad/s of the URDF is a limit up to which there is the whole torque; what a file of drives says is a line
    assert [entry["limits"]["kappa_dot_max"] for entry in data] == [3.0 / 0.95, 3.0 / 0.95, 0.4]
    assert [entry["limits"]["full_speed"] for entry in data] == [0.95, 0.95, 0.0]
    assert data[1]["friction"]["f_v"] == 0.3
    # Torques of a motor are those of the joint, 50 N.m, divided by the ratio.
    assert [entry["limits"]["tau_stall"] for entry in data] == [1.0, 50 / 160, 1.0]
    assert robot.source_of("joints[1].drive.ell") == "measured in 2024"
    assert robot.source_of("joints[2].drive.ell") == "drives.toml: b"
    assert robot.source_of("joints[2].friction.f_v") == "drives.toml: b"


def test_every_problem_of_a_file_of_drives_is_named(urdf, tmp_path):
    drives = tmp_path / "drives.toml"
    drives.write_text(
        '[shoulder]\n[a]\ndrive = { ell = 0.5, gear = 3 }\nfriction.f_c = "low"\nengine = {}\ngear = "CSG-25"\n',
        encoding="utf-8",
    )
    with pytest.raises(vdfmu.VdfmuError) as error:
        robot_from_urdf(urdf(ARM), drives=drives)
    assert [problem.removeprefix(f"{drives}: ") for problem in error.value.problems] == [
        'shoulder: expected a joint of the arm, or a pattern such as "*", got none. There are: a, b, c.',
        "a.engine: expected a known key, got an unknown one. "
        "There are: gear, motor, drive, friction, limits, link, source.",
        "a.drive.gear: expected a known key, got an unknown one. There are: "
        + ", ".join([*(row.key for row in section("drive")), *PLAIN]) + ".",
        "a.drive.ell: expected a finite number >= 1, got 0.5. Give the rotor angle for one unit of joint motion.",
        'a.friction.f_c: expected a finite number >= 0 in N.m, got "low". Write a number. '
        "It is the coulomb friction, link-side, Eq. (54).",
        'a.gear: expected a gear of the catalogue, got "CSG-25". Did you mean "CSG-25-100"? '
        f"There are: {', '.join(catalogue()['gears'])}.",
    ]  # fmt: skip


def test_a_file_of_drives_names_gears_and_motors(urdf, tmp_path):
    drives = tmp_path / "drives.toml"
    drives.write_text(
        """
        ["a*"]
        gear = "CSG-20-100"
        motor = "TBM-6025-B"
        [b]
        gear = "CSG-25-100"
        motor = "TBM-6025-B"
        drive.c_f = 1e-4
        ["*b"]
        motor = "TBM-6013-A"
        [c]
        motor = "TBM-6013-A"
        drive.ell = 160
        """,
        encoding="utf-8",
    )
    robot = robot_from_urdf(urdf(ARM), drives=drives)
    gears = catalogue()["gears"]
    assert robot.ell.tolist() == [100.0, 100.0, 160.0]
    np.testing.assert_allclose(robot.K_w0[:2], [gears[f"CSG-{k}-100"]["drive"]["K_w0"] for k in (20, 25)])
    # inertia of wave generator and motor times ell; a later entry may name the motor alone, as one without a gear
    inertia = np.array([1.93e-5 + 2.52e-5, 4.13e-5 + 1.41e-5, 1.41e-5])
    np.testing.assert_allclose(robot.I_m, robot.ell * inertia)
    assert robot.source_of("joints[1].drive.K_f0") == "models/drives/catalogue.toml: gear CSG-20-100"
    np.testing.assert_allclose(robot.kappa_dot_max, [615.38 / 100.0, 662.47 / 100.0, 662.47 / 160.0])
