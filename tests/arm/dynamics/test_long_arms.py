"""The dependencies of a long arm, which follow from shorter arms, are those of its own trace."""

import dataclasses

import numpy as np
import pytest

from benchmarks.chains import repeated_link
from vdfmu.arm.units import find_unit
from vdfmu.compiler.unit.interface import Interface


@pytest.fixture(autouse=True)
def _from_shorter_ones():
    """Arms that are traced in less time themselves are taken for long ones."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("vdfmu.arm.robot.robot._MANY", 0)
        yield


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


def test_variables_that_do_not_grow_evenly_are_refused():
    interface = Interface(find_unit("controller"), repeated_link(26))
    assert len(interface.shorter) == 2
    square = Interface(find_unit("controller"), repeated_link(26))
    square.memory += square.memory[:1]
    assert square.shorter == ()
