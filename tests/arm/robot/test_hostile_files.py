"""Files, numbers and texts that no robot or scenario has are refused in words, and what looks wrong is noted."""

import copy
import os
from pathlib import Path

import pytest

from vdfmu.arm.fmus import build_fmus
from vdfmu.arm.robot import load_robot, robot_from_dict
from vdfmu.arm.robot.parameters import PARAMETERS
from vdfmu.base.errors import ModelError, UsageError
from vdfmu.compiler.fmu.build import build_notes
from vdfmu.system.scenario import load_scenario


def test_special_files_and_a_large_one_are_refused(tmp_path):
    os.mkfifo(tmp_path / "robot.toml")
    for path in (Path("/dev/zero"), tmp_path / "robot.toml"):  # reading either would never end
        with pytest.raises(ModelError, match="it is a pipe, a device or another special file"):
            load_robot(path)
    large = tmp_path / "large.toml"
    with large.open("wb") as stream:
        stream.truncate(114 * 2**20)
    with pytest.raises(ModelError, match="it has more than the 1 MiB that are read"):
        load_robot(large)


@pytest.mark.parametrize("name", sorted(set(PARAMETERS) - {"rotation"}))
def test_every_number_of_a_robot_has_a_bound_from_above(name):
    assert 0 < PARAMETERS[name].largest < 1e13


@pytest.mark.parametrize(("group", "key", "value", "message"), [
    ("drive", "I_m", 1e308, r"I_m: expected a number of at most 1e\+06 in kg\.m2, got 1e\+308"),
    ("drive", "K_f0", 5e-324, r"K_f0: expected a finite number >= 1e-12 in N\.m/rad, got 5e-324"),
    ("link", "mass", 1e7, r"mass: expected a number of at most 1e\+06 in kg, got 10000000\.0"),
    ("link", "centroid", [0, -1e300, 0], r"centroid\[2\]: expected a number of at most 10000 in m"),
    ("friction", "eps", 1e-13, r"eps: expected a finite number >= 1e-12 in rad/s, got 1e-13"),
])  # fmt: skip
def test_a_number_that_is_not_physical_is_refused(robot_data, group, key, value, message):
    robot_data["joints"][1][group][key] = value
    with pytest.raises(ModelError, match=r"joints\[2\]\." + group + r"\." + message):
        robot_from_dict(robot_data)


@pytest.mark.parametrize("key", ["name", "description"])
@pytest.mark.parametrize("character", ["\x00", "\x1b", "\x7f", "\x9b", "\ufffe", "\ud800"])
def test_control_characters_are_refused_and_shown_as_text(robot_data, key, character):
    robot_data[key] = f"arm {character}[31m"
    with pytest.raises(ModelError, match="expected a text without control characters, got") as caught:
        robot_from_dict(robot_data)
    assert character not in str(caught.value)


def test_long_texts_are_refused_with_their_length(robot_data):
    robot_data |= {"name": "n" * 100_000, "description": "d" * 100_000, "k" * 100_000: 1}
    with pytest.raises(ModelError) as caught:
        robot_from_dict(robot_data)
    assert any("name: expected at most 100 characters, got 100000" in p for p in caught.value.problems)
    assert any("description: expected at most 4000 characters, got 100000" in p for p in caught.value.problems)
    assert all(len(p) < 400 for p in caught.value.problems)


@pytest.mark.parametrize("load", [load_robot, load_scenario])
def test_a_name_that_no_file_can_have_is_an_unknown_name(load):
    for name in ("a" * 300, "a" * 100_000, "a\0b"):
        with pytest.raises(UsageError, match="expected a name or the path of a TOML file") as caught:
            load(name)
        assert len(str(caught.value)) < 400
        with pytest.raises(ModelError):
            load(name + ".toml")


def test_at_most_twenty_problems_are_printed_and_the_cost_of_many_joints_is_bounded(robot_data, tmp_path):
    joint = robot_data["joints"][1]
    joint["link"]["mass"] = -1  # one problem a joint
    robot_data["joints"] = [copy.deepcopy(joint) for _ in range(50)]
    with pytest.raises(ModelError) as caught:
        robot_from_dict(robot_data)
    assert len(caught.value.problems) == 50
    lines = str(caught.value).splitlines()
    assert len(lines) == 21
    assert lines[-1] == "and 30 more"
    joint["link"]["mass"] = 1.0
    robot_data["joints"] = [copy.deepcopy(joint) for _ in range(20)]
    twenty = robot_from_dict(robot_data)
    assert "the first build for 20 joints takes some" in build_notes(twenty, "native")[0]
    assert build_notes(load_robot("manipulator_6dof"), "native") == []
    robot_data["joints"] = [copy.deepcopy(joint) for _ in range(513)]
    with pytest.raises(UsageError, match=r"expected at most 512 joints for FMUs, got 513\. Tracing and compiling"):
        build_fmus(robot_from_dict(robot_data), tmp_path, folded=True)


def test_the_end_of_a_scenario_is_bounded(scenario_data, write):
    for stop in (1e12, 1e7):
        scenario_data["stop"] = stop
        with pytest.raises(ModelError, match=r"stop: expected at most 1e\+09 steps of 0\.001 s"):
            load_scenario(write("own.toml", scenario_data))
