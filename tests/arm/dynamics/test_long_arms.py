"""The C and the dependencies of a long arm, which shorter ones tell, are those that its own trace has."""

import dataclasses

import numpy as np
import pytest

from benchmarks.chains import repeated_link
from vdfmu.arm.units import find_unit
from vdfmu.compiler.c.generate import traced_files
from vdfmu.compiler.c.grow import grown
from vdfmu.compiler.unit.interface import Interface


@pytest.fixture(autouse=True)
def _from_shorter_ones():
    """Arms that are traced in less time themselves are taken for long ones."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("vdfmu.arm.robot.robot._MANY", 0)
        yield


def alternating(n):
    return dataclasses.replace(repeated_link(n), joint_types=("revolute", "prismatic") * (n // 2))


def check_files(unit, robot):
    interface = Interface(find_unit(unit), robot)
    assert len(interface.shorter) == 2
    assert grown({arm.joints: traced_files(arm) for arm in interface.shorter}, robot.n) == traced_files(interface)


@pytest.mark.parametrize(
    "robot", [repeated_link(24), repeated_link(33), alternating(36)], ids=["24", "33", "two kinds"]
)
def test_the_c_of_a_long_arm_is_that_of_its_trace(robot):
    check_files("controller", robot)
    check_files("trajectory", robot)


@pytest.mark.heavy
@pytest.mark.parametrize("unit", ["plant", "feedforward"])
def test_the_c_of_the_equations_of_a_long_arm_is_that_of_their_trace(unit):
    check_files(unit, repeated_link(27))


@pytest.mark.parametrize("unit", ["controller", pytest.param("plant", marks=pytest.mark.heavy)])
def test_the_dependencies_of_a_long_arm_are_those_of_its_trace(unit, monkeypatch):
    interface = Interface(find_unit(unit), repeated_link(26))
    traced = Interface(find_unit(unit), repeated_link(26))
    monkeypatch.setattr(type(repeated_link(26)), "shorter", lambda self: [])
    assert not traced.shorter
    expected = traced.patterns
    monkeypatch.undo()
    assert interface.shorter
    assert not isinstance(interface.patterns[0], np.ndarray)
    for pattern, other in zip(interface.patterns, expected, strict=True):
        assert all((pattern[row] == other[row]).all() for row in range(interface.size))


def test_arms_with_an_unlike_joint_or_of_less_time_have_no_shorter_ones(monkeypatch):
    robot = repeated_link(40)
    assert [arm.n for arm in robot.shorter()] == [14, 16]
    types = list(robot.joint_types)
    types[20] = "prismatic"
    assert dataclasses.replace(robot, joint_types=tuple(types)).shorter() == []
    inertia = robot.inertia.copy()
    inertia[20, 0, 1] = inertia[20, 1, 0] = 0.0  # a structural zero
    assert dataclasses.replace(robot, inertia=inertia).shorter() == []
    types = ["prismatic", *robot.joint_types[1:-1], "prismatic"]  # the ends may be unlike
    ends = dataclasses.replace(robot, joint_types=tuple(types)).shorter()
    assert [arm.joint_types.count("prismatic") for arm in ends] == [2, 2]
    assert repeated_link(20).shorter() == []  # not much longer than they are
    monkeypatch.setattr("vdfmu.arm.robot.robot._MANY", 1.0)
    assert [len(repeated_link(n).shorter()) for n in (28, 30, 31, 32, 33)] == [0, 2, 0, 2, 2]  # 14 + 16, 15 + 17


def test_texts_and_variables_that_do_not_grow_evenly_are_refused():
    def files(*texts):
        return {n: {"a.c": text} for n, text in zip((10, 12, 14), texts, strict=True)}

    made = grown(files("w[10] = -1.5 * p[21];", "w[12] = -1.5 * p[25];", "w[14] = -1.5 * p[29];"), 100)
    assert made == {"a.c": "w[100] = -1.5 * p[201];"}
    assert grown(files("w[-1];", "w[1];", "w[3];"), 20) == {"a.c": "w[9];"}
    assert grown(files("w[1];", "w[2];", "w[4];"), 20) is None  # uneven
    assert grown(files("w[1];", "w[2];", "w[3];"), 21) is None  # half a number a joint
    assert grown(files("w[1];", "w[1];", "v[1];"), 20) is None
    assert grown(files("w / 10.0;", "w / 12.0;", "w / 14.0;"), 20) == {"a.c": "w / 20.0;"}
    assert grown(files("w = 0.5;", "w = 0.6;", "w = 0.7;"), 20) is None  # else 0.10
    assert grown(files("w[10 * i + 1];", "w[12 * i + 1];", "w[14 * i + 1];"), 20) is None  # a matrix of joints
    assert grown({10: {"a.c": ""}, 12: {"b.c": ""}, 14: {"a.c": ""}}, 20) is None
    interface = Interface(find_unit("controller"), repeated_link(26))
    assert len(interface.shorter) == 2
    square = Interface(find_unit("controller"), repeated_link(26))
    square.memory += square.memory[:1]
    assert square.shorter == ()
