"""Every fault of a robot file is reported with file, key, expected, got and the fix."""

import math
import re
from typing import Any

import pytest

from vdfmu.arm.robot import check_robot, load_robot, robot_from_dict
from vdfmu.base.errors import ModelError, VdfmuError

DELETE = object()

# (path to the entry, its new value, what the message says)
FAULTS: list[tuple[tuple[Any, ...], Any, str]] = [
    (("name",), DELETE, r"name: expected a string that is not empty, got nothing\. The key is missing: add it\."),
    (("name",), 3, r"name: expected a string that is not empty, got 3\. Write a string in quotes"),
    (("gravity",), DELETE, r"gravity: expected 3 finite numbers in m/s2, got nothing"),
    (("gravity",), 9.81, r"gravity: expected 3 finite numbers in m/s2, got one number\. Write 3 numbers"),
    (("gravity",), [0, 9.81], r"gravity: expected 3 finite numbers in m/s2, got 2\."),
    (("gravity", 2), math.inf, r"gravity\[3\]: expected a finite number in m/s2, got inf"),
    (("friction",), "lumpd", r'friction: expected "lumped" or "split", got "lumpd"\. Did you mean "lumped"\?'),
    (("masss",), 1.0, r"masss: expected a known key, got an unknown one\."),
    (("joints",), DELETE, r"joints: expected one table \[\[joints\]\] for each joint, got nothing"),
    (("joints",), [], r"joints: expected one table .* got \[\]\. Write \[\[joints\]\] in double brackets"),
    (("joints",), {"type": "revolute"}, r"joints: expected one table .* got a table\."),
    (("joints", 1), 5, r"joints\[2\]: expected a table, got 5\. Its keys are: type, rotation, offset, link"),
    (("joints", 0, "type"), "revolut", r'type: expected "revolute" or "prismatic".* Did you mean "revolute"\?'),
    (("joints", 0, "type"), DELETE, r'joints\[1\]\.type: expected "revolute" or "prismatic", got nothing'),
    (("joints", 1, "offset"), [1, 2, "3"], r'joints\[2\]\.offset\[3\]: expected a finite number in m, got "3"'),
    (("joints", 1, "offset"), [1, [2], 3], r"joints\[2\]\.offset: expected 3 finite numbers in m, got \[1, \[2\], 3\]"),
    (("joints", 1, "rotation"), [1, 0, 0], r"rotation: expected 3 x 3 finite numbers, got 3\. Write 3 x 3 numbers"),
    (("joints", 1, "rotation"), [[0.71, -0.71, 0], [0.71, 0.71, 0], [0, 0, 1]],
     r"joints\[2\]\.rotation: expected an orthogonal matrix .* got .* R\^T - E\| up to 0\.0082"),
    (("joints", 1, "rotation"), [[1, 0, 0], [0, 1, 0], [0, 0, -1]],
     r"rotation: expected a rotation of determinant \+1, got determinant -1\. It is a reflection"),
    (("joints", 1, "link", "mass"), 0, r"joints\[2\]\.link\.mass: expected a finite number > 0 in kg, got 0\."),
    (("joints", 1, "link", "mass"), True, r"mass: expected a finite number > 0 in kg, got true\. Write a number"),
    (("tool_rotation",), [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.1, 1.0]],
     r"my\.toml: tool_rotation: expected an orthogonal matrix .* got .* R\^T - E\| up to 0\.1"),
    (("joints", 1, "link", "mass"), 10**400, r"joints\[2\]\.link\.mass: .* got 1000"),
    (("joints", 1, "link", "mas"), 1.0, r'joints\[2\]\.link\.mas: .* an unknown one\. Did you mean "mass"\?'),
    (("joints", 1, "link"), DELETE, r"joints\[2\]\.link: expected a table, got nothing"),
    (("joints", 1, "link", "inertia"), DELETE, r"joints\[2\]\.link\.inertia: expected .* kg\.m2, got nothing"),
    (("joints", 1, "link", "inertia"), -1.0, r"inertia: expected positive definite, in kg\.m2, got principal moments"),
    (("joints", 1, "link", "inertia"), [1.0, 2.0, 3.1],
     r"inertia: expected no .* \(triangle inequality\), got principal moments 1, 2, 3\.1 kg"),
    (
        # Entries on the diagonal meet the inequality; principal moments 0.5, 1.5, 2.1 do not.
        ("joints", 1, "link", "inertia"),
        [[1.0, 0.5, 0.0], [0.5, 1.0, 0.0], [0.0, 0.0, 2.1]],
        r"\(triangle inequality\), got principal moments 0\.5, 1\.5, 2\.1",
    ),
    (("joints", 1, "link", "inertia"), [[1.0, 0.1, 0.0], [0.2, 1.0, 0.0], [0.0, 0.0, 1.0]],
     r"inertia: expected a symmetric matrix"),
    (("joints", 1, "link", "inertia"), [1.0, 2.0], r"inertia: expected 3 finite numbers in kg\.m2, got 2\..*3 x 3"),
    (("joints", 0, "drive", "ell"), 0.5, r"joints\[1\]\.drive\.ell: expected a finite number >= 1, got 0\.5"),
    (("joints", 0, "drive", "K_f0"), -1, r"K_f0: expected a finite number > 0 in N\.m/rad, got -1"),
    (("joints", 0, "drive", "c_f"), 0, r"c_f: .* got 0\. For a linear spring give a small value"),
    (("joints", 0, "drive", "theta_err_amplitude"), -1e-4, r"theta_err_amplitude: expected .* >= 0 in rad"),
    (
        # 2 * 100 * 0.0025 is the limit itself.
        ("joints", 0, "drive", "theta_err_amplitude"),
        0.0025,
        r"theta_err_amplitude: expected 2\*ell\*theta_err_amplitude < 0\.5, got ell = 100, .* = 0\.0025\. Lower",
    ),
    (("joints", 0, "friction", "f_c"), -0.1, r"f_c: expected a finite number >= 0 in N\.m, got -0\.1"),
    (("joints", 0, "friction", "f_s"), 0.1, r"f_s: expected f_s >= f_c, got f_s = 0\.1, f_c = 0\.3\. Set f_s = f_c"),
    (("joints", 0, "friction", "eps"), 0.0, r"eps: expected a finite number > 0 in rad/s, got 0\.0"),
    (("sources",), "the paper", r"sources: expected a table"),
    (("sources", "gravity"), 1, r"sources\.gravity: expected a string, got 1"),
    (("sources", "joints.link.mas"), "x", r'sources\.joints\.link\.mas: .* Did you mean "joints\.link\.mass"\?'),
]  # fmt: skip


def put(data: Any, path: tuple[Any, ...], value: Any) -> None:
    for key in path[:-1]:
        data = data[key]
    if value is DELETE:
        del data[path[-1]]
    else:
        data[path[-1]] = value


@pytest.mark.parametrize(("path", "value", "message"), FAULTS, ids=lambda v: None if isinstance(v, str) else "")
def test_fault_is_named(robot_data, path, value, message):
    put(robot_data, path, value)
    with pytest.raises(ModelError, match=message) as caught:
        robot_from_dict(robot_data, "my.toml")
    assert all(line.startswith("my.toml: ") for line in caught.value.problems)


def test_units_of_a_prismatic_joint(robot_data):
    robot_data["joints"][1]["type"] = "prismatic"
    robot_data["joints"][1]["drive"]["K_f0"] = -1.0
    robot_data["joints"][1]["friction"]["f_v"] = -1.0
    with pytest.raises(ModelError) as caught:
        robot_from_dict(robot_data)
    assert [re.sub(r".* in (\S+),.*", r"\1", line) for line in caught.value.problems] == ["N/m", "N.s/m"]


def test_every_problem_at_once(robot_data):
    robot_data["gravity"] = [0, 0]
    robot_data["colour"] = "red"
    robot_data["joints"][0]["link"]["mass"] = -1
    robot_data["joints"][0]["drive"]["ell"] = 0.1
    del robot_data["joints"][1]["friction"]["f_c"]
    robot_data["joints"][1]["rotation"] = [[2, 0, 0], [0, 2, 0], [0, 0, 2]]
    with pytest.raises(ModelError) as caught:
        robot_from_dict(robot_data)
    assert len(caught.value.problems) == 6
    assert str(caught.value).splitlines() == caught.value.problems
    for key in ("gravity", "colour", "joints[1].link.mass", "joints[1].drive.ell", "joints[2].friction.f_c"):
        assert sum(f" {key}: " in line for line in caught.value.problems) == 1


def test_missing_table_is_one_problem_of_the_robot_that_is_named(robot_data):
    del robot_data["joints"][0]["drive"]
    with pytest.raises(ModelError) as caught:
        robot_from_dict(robot_data)
    assert len(caught.value.problems) == 1
    robot = load_robot("planar_2dof")
    assert check_robot(robot) is robot
    with pytest.raises(ModelError, match=r"robot planar_2dof: joints\[2\]\.link\.mass: .* got -1\.0"):
        check_robot(robot.with_parameters(mass=[1.0, -1.0]))
    assert issubclass(ModelError, VdfmuError)
    assert ModelError("one").problems == ["one"]
