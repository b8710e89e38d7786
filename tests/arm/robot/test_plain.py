"""Plain words of a drive, `stiffness` and `rotor_inertia`, are the paper's numbers of the same drive."""

import copy
import tomllib

import numpy as np
import pytest

import vdfmu
from vdfmu.arm.equations.harmonic_drive import deformation, spring_energy
from vdfmu.arm.robot import check_robot, load_robot, robot_from_dict
from vdfmu.arm.robot.plausible import robot_notes
from vdfmu.base.files import data_path

PAPER = ("K_f0", "c_f", "K_w0", "c_w", "I_m")
TORQUES = np.array([1e-6, 0.1, 10.0, 300.0])


@pytest.fixture
def data():
    """Return a robot file with plain words."""
    file = load_robot("slider_3dof").to_dict()
    file["sources"] = {}
    for i, joint in enumerate(file["joints"]):
        joint["drive"] = {key: value for key, value in joint["drive"].items() if key not in PAPER}
        joint["drive"] |= {"stiffness": 1e4 * (i + 1), "rotor_inertia": 2e-5}
    return file


def test_the_spring_is_linear_and_the_rotor_has_its_inertia(data):
    robot = robot_from_dict(data)
    K = np.array([1e4, 2e4, 3e4])
    assert robot.K_f0.tolist() == K.tolist()
    np.testing.assert_allclose(robot.I_m / robot.ell, 2e-5, rtol=1e-15)
    for tau in TORQUES:
        # (c_f tau)^2 = 9e-8 at 300 N.m, and 1 / (ell^2 K_w0) = 1e-11 of 1 / K
        np.testing.assert_allclose(deformation(robot, tau), tau / K, rtol=1e-7)
        np.testing.assert_allclose(spring_energy(robot, tau), tau**2 / (2.0 * K), rtol=1e-7)


def test_the_conversion_is_said(data):
    robot = robot_from_dict(data)
    assert robot.source_of("joints[2].drive.K_f0") == "stiffness = 20000 N/m"
    assert robot.source_of("joints[1].drive.I_m") == "rotor_inertia = 2e-05 kg.m2"
    notes = " ".join(robot_notes(robot))
    assert "K_f0 = stiffness" in notes and "I_m = ell * rotor_inertia" in notes
    assert not any("was converted" in note for note in robot_notes(load_robot("slider_3dof")))
    assert check_robot(robot) is robot
    again = robot_from_dict(robot.to_dict())
    assert again.values().tolist() == robot.values().tolist() and again.sources == robot.sources


def test_a_gear_gives_the_ratio_and_a_word_replaces_its_springs():
    data = tomllib.loads((data_path("models") / "robots" / "planar_2dof.toml").read_text(encoding="utf-8"))
    for joint in data["joints"]:
        joint["drive"] = {"stiffness": 5e3, "rotor_inertia": 1e-4}
        joint["gear"] = "CSG-25-100"
    data.pop("sources", None)
    data["sources"] = {"joints.drive.stiffness": "measured"}
    robot = robot_from_dict(data)
    assert (robot.ell.tolist(), robot.I_m.tolist(), robot.K_f0.tolist()) == ([100.0] * 2, [1e-2] * 2, [5e3] * 2)
    assert robot.sources["joints.drive.stiffness"] == "measured"


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({"K_w0": 2.0}, "drive.stiffness: expected stiffness or K_f0, c_f, K_w0, c_w, got stiffness and K_w0."),
        ({"I_m": 2.0}, "drive.rotor_inertia: expected rotor_inertia or I_m, got rotor_inertia and I_m. Delete"),
        ({"stiffness": -1.0}, "drive.stiffness: expected a finite number > 0 in N.m/rad, got -1.0."),
        ({"rotor_inertia": "big"}, "drive.rotor_inertia: expected a finite number > 0 in kg.m2"),
        ({"ell": None}, "drive.rotor_inertia: expected ell beside it, got nothing. I_m is ell * rotor_inertia"),
        ({"stifness": 1.0}, 'an unknown one. Did you mean "stiffness"?'),
    ],
)
def test_wrong_words_are_named(data, change, expected):
    drive = data["joints"][0]["drive"]
    drive |= change
    data["joints"][0]["drive"] = {key: value for key, value in drive.items() if value is not None}
    with pytest.raises(vdfmu.VdfmuError) as error:
        robot_from_dict(copy.deepcopy(data))
    assert expected in str(error.value)
