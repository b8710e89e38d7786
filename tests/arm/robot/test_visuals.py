"""Visuals of a robot file are read and checked, and change nothing that is calculated."""

import copy
from typing import Any

import pytest

from vdfmu.arm.robot import robot_from_dict
from vdfmu.arm.units.plant import Plant
from vdfmu.base.errors import ModelError
from vdfmu.compiler.fmu.content import Content

MESH = {"joint": 2, "shape": "mesh", "file": "arm.stl", "offset": [0.0, 0.0, 0.1]}
BALL = {"joint": 0, "shape": "sphere", "size": [0.1], "color": [1.0, 0.0, 0.0, 0.5]}


def with_visuals(data: dict[str, Any], *visuals: object) -> dict[str, Any]:
    return copy.deepcopy(data) | {"visuals": list(visuals)}


def test_visuals_are_kept_and_change_no_fmu(robot_data):
    robot = robot_from_dict(with_visuals(robot_data, MESH, BALL))
    mesh, ball = robot.visuals
    assert (mesh.joint, mesh.file, mesh.size.tolist()) == (2, "arm.stl", [1.0, 1.0, 1.0])
    assert (ball.shape, ball.size.tolist(), ball.color.tolist()) == ("sphere", [0.1], [1.0, 0.0, 0.0, 0.5])
    assert robot_from_dict(robot.to_dict()).to_dict() == robot.to_dict()
    plain, shown = robot_from_dict(robot_data), robot_from_dict(with_visuals(robot_data, MESH, BALL))
    assert "visuals" not in plain.to_dict()
    plain_content, shown_content = (Content(Plant, robot, {}, "native") for robot in (plain, shown))
    assert plain_content.to_json() == shown_content.to_json()
    assert plain_content.model_key == shown_content.model_key


@pytest.mark.parametrize(("change", "problem"), [
    ({"joint": 3}, "visuals[1].joint: expected a joint from 0 to 2, got 3. 0 is for shapes at rest."),
    ({"joint": True}, "visuals[1].joint: expected a joint from 0 to 2, got true."),
    ({"shape": "cone"}, 'visuals[1].shape: expected "mesh" or "box" or '),
    ({"shape": "box"}, "visuals[1].size: expected 3 finite numbers >= 0 in m, got nothing."),
    ({"size": [1.0]}, "visuals[1].size: expected 3 finite numbers, got 1. Write 3 numbers."),
    ({"color": [2.0, 0.0, 0.0, 1.0]}, "visuals[1].color[1]: expected a number of at most 1, got 2.0."),
    ({"rotation": [[2.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]}, "visuals[1].rotation: expected an ortho"),
    ({"scale": 2.0}, "visuals[1].scale: expected a known key, got an unknown one."),
    ({"file": ""}, "visuals[1].file: expected a string that is not empty"),
])  # fmt: skip
def test_wrong_visuals_are_refused(robot_data, change, problem):
    with pytest.raises(ModelError) as error:
        robot_from_dict(with_visuals(robot_data, MESH | change))
    assert any(problem in line for line in error.value.problems), error.value.problems


def test_visuals_are_tables(robot_data):
    with pytest.raises(ModelError, match=r"visuals: expected tables, got a table. Write \[\[visuals\]\]"):
        robot_from_dict(robot_data | {"visuals": {"joint": 1}})
