"""A robot survives its file layout, refuses changes in place, and says where its numbers are from."""

import dataclasses
import json
import pickle
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from vdfmu.arm.robot import Robot, load_robot, robot_from_dict, robot_names
from vdfmu.arm.robot.parameters import PARAMETERS
from vdfmu.base.errors import ModelError, UsageError


def assert_same(a: Robot, b: Robot) -> None:
    for field in dataclasses.fields(Robot):
        x, y = getattr(a, field.name), getattr(b, field.name)
        if field.name in PARAMETERS:
            np.testing.assert_array_equal(x, y, err_msg=field.name)
        else:
            assert x == y, field.name


@pytest.mark.parametrize("name", robot_names())
def test_round_trip(name):
    robot = load_robot(name)
    assert_same(robot, robot_from_dict(robot.to_dict()))
    assert_same(robot, robot_from_dict(json.loads(json.dumps(robot.to_dict()))))
    assert_same(robot, pickle.loads(pickle.dumps(robot)))


def positive(low: float, high: float) -> st.SearchStrategy[float]:
    return st.floats(low, high, allow_nan=False)


@st.composite
def joints(draw: st.DrawFn) -> dict[str, Any]:
    turn = Rotation.from_euler("xyz", [draw(positive(-3, 3)) for _ in range(3)]).as_matrix()
    # The moments of three point masses: a + b, b + c, c + a meet the triangle inequality by construction.
    a, b, c = (draw(positive(1e-3, 1)) for _ in range(3))
    inertia = turn @ np.diag([a + b, b + c, c + a]) @ turn.T
    f_c = draw(positive(0, 1))
    point = st.lists(positive(-1, 1), min_size=3, max_size=3)
    return {
        "type": draw(st.sampled_from(["revolute", "prismatic"])),
        "rotation": turn.tolist(),
        "offset": draw(point),
        "link": {
            "mass": draw(positive(1e-3, 100)), "centroid": draw(point),
            "inertia": ((inertia + inertia.T) / 2).tolist(),
        },
        "drive": {
            "ell": draw(positive(1, 200)), "I_m": draw(positive(1e-6, 1)), "K_f0": draw(positive(1, 1e6)),
            "c_f": draw(positive(1e-6, 1)), "K_w0": draw(positive(1e-3, 1e3)), "c_w": draw(positive(1e-3, 1e3)),
            "theta_err_amplitude": draw(positive(0, 1e-3)), "theta_err_phase": draw(positive(-4, 4)),
        },
        "friction": {
            "f_c": f_c, "f_s": f_c + draw(positive(0, 1)), "f_v": draw(positive(0, 1)),
            "v_s": draw(positive(1e-3, 1)), "f_ck": draw(positive(0, 1)), "eps": draw(positive(1e-6, 1)),
        },
    }  # fmt: skip


@settings(max_examples=25, deadline=None)
@given(st.lists(joints(), min_size=1, max_size=3), st.sampled_from(["lumped", "split"]), st.booleans())
def test_round_trip_of_random_robots(chain, friction, coupling):
    data = {
        "name": "random", "description": "", "friction": friction, "rotor_coupling": coupling,
        "gravity": [0.0, 0.0, 9.81], "tool_offset": [0.1, 0.0, 0.0],
        "tool_rotation": [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]], "joints": chain,
        "sources": {"joints[1].link.mass": "drawn"},
    }  # fmt: skip
    robot = robot_from_dict(data)
    assert robot.n == len(chain)
    assert robot.to_dict() == data
    assert_same(robot, robot_from_dict(robot.to_dict()))


def test_a_payload_is_read_written_and_scaled_and_a_robot_without_has_none_to_set():
    data = load_robot("planar_2dof").to_dict()
    assert "payload" not in data
    data["payload"] = {"mass": 0.5, "centroid": [0.1, 0.0, 0.02], "inertia": 1e-3}
    robot = robot_from_dict(data)
    assert_same(robot, robot_from_dict(robot.to_dict()))
    np.testing.assert_array_equal(robot.payload_inertia, 1e-3 * np.eye(3))
    assert robot.with_parameters(payload_mass=0.0).payload_mass == 0.0
    point = robot_from_dict(data | {"payload": {"mass": 0}})
    assert point.payload
    assert not point.payload_inertia.any()
    names = [p.name for p in point.entries()]
    assert names[2:6] == ["payload_mass", "payload_centroid[1]", "payload_centroid[2]", "payload_centroid[3]"]
    assert "payload_inertia[1,1]" in [p.name for p in robot.entries()]
    with pytest.raises(UsageError, match=r"payload_mass: robot planar_2dof has no payload\. .* \[payload\]"):
        load_robot("planar_2dof").with_parameters(payload_mass=1.0)


@pytest.mark.parametrize(("payload", "words"), [
    ({}, r"payload\.mass: expected a finite number >= 0 in kg, got nothing"),
    ({"mass": -1.0}, r"payload\.mass: expected .* >= 0 in kg, got -1\.0"),
    ({"mass": 1.0, "inertia": [1.0, 1.0, 3.0]}, r"payload\.inertia: expected no principal moment above"),
    ({"mass": 1.0, "mas": 1.0}, r"payload\.mas: expected a known key"),
])  # fmt: skip
def test_a_payload_that_no_body_has_is_refused(payload, words):
    with pytest.raises(ModelError, match=words):
        robot_from_dict(load_robot("planar_2dof").to_dict() | {"payload": payload})


def test_forms_of_inertia_and_defaults():
    data = load_robot("planar_2dof").to_dict()
    link = data["joints"][0]["link"]
    link["inertia"] = 0.5
    np.testing.assert_array_equal(robot_from_dict(data).inertia[0], 0.5 * np.eye(3))
    link["inertia"] = [1, 2, 2.5]
    np.testing.assert_array_equal(robot_from_dict(data).inertia[0], np.diag([1, 2, 2.5]))
    link["inertia"] = [[1, 0.1, 0], [0.1, 2, 0], [0, 0, 2.5]]
    np.testing.assert_array_equal(robot_from_dict(data).inertia[0], link["inertia"])
    for key in ("description", "friction", "tool_offset", "sources"):
        del data[key]
    for joint in data["joints"]:
        del joint["drive"]["theta_err_amplitude"], joint["drive"]["theta_err_phase"], joint["friction"]["eps"]
    robot = robot_from_dict(data)
    assert (robot.description, robot.friction, robot.sources) == ("", "lumped", {})
    np.testing.assert_array_equal(robot.eps, [1e-3, 1e-3])
    np.testing.assert_array_equal(robot.theta_err_amplitude, [0, 0])
    np.testing.assert_array_equal(robot.tool_offset, [0, 0, 0])


@pytest.mark.parametrize("key", PARAMETERS)
def test_arrays_refuse_assignment(key):
    array = getattr(load_robot("planar_2dof"), key)
    assert array.dtype == np.float64
    with pytest.raises(ValueError, match="read-only"):
        array[...] = 0.0


def test_a_joint_of_an_unknown_type_is_refused_from_python_too():
    robot = load_robot("planar_2dof")
    with pytest.raises(UsageError, match="joint_types: expected revolute or prismatic, got 'helical'. A screw"):
        dataclasses.replace(robot, joint_types=("revolute", "helical"))


def test_other_parameters_are_those_of_another_robot():
    robot = load_robot("planar_2dof")
    other = robot.with_parameters(mass=[3, 4], f_v=0.5)
    np.testing.assert_array_equal(other.mass, [3.0, 4.0])
    np.testing.assert_array_equal(other.f_v, [0.5, 0.5])
    np.testing.assert_array_equal(robot.mass, [2.0, 1.0])
    assert not other.mass.flags.writeable
    with pytest.raises(UsageError, match=r"robot planar_2dof: no parameter 'mas'\. There are: gravity, tool_offset"):
        robot.with_parameters(mas=1)
    with pytest.raises(UsageError, match=r"mass: expected numbers of shape \(2,\), got \(3,\)"):
        robot.with_parameters(mass=[1, 2, 3])
    with pytest.raises(UsageError, match=r"mass: expected numbers of shape \(2,\), got 'heavy'"):
        robot.with_parameters(mass="heavy")


@pytest.mark.parametrize("name", robot_names())
def test_every_number_has_its_source(name):
    robot = load_robot(name)
    groups = {"link": ("mass", "centroid", "inertia")}
    data = robot.to_dict()
    assert robot.source_of("gravity") and robot.source_of("tool_offset")
    for i, joint in enumerate(data["joints"], 1):
        for key in ("rotation", "offset"):
            assert robot.source_of(f"joints[{i}].{key}"), key
        for group in (*groups, "drive", "friction", *(("limits",) if robot.limits else ())):
            for key in joint[group].keys() - {"full_speed"}:  # 0, which no file says
                assert robot.source_of(f"joints[{i}].{group}.{key}"), (i, group, key)


def test_source_of_one_joint_goes_before_that_of_all_and_may_be_nested():
    robot = load_robot("manipulator_6dof")
    assert "+x of B_2" in (robot.source_of("joints[3].offset") or "")
    assert "+x of B_2" not in (robot.source_of("joints[2].offset") or "")
    assert robot.source_of("joints[2].colour") is None
    data = load_robot("planar_2dof").to_dict()
    data["sources"] = {"joints": {"link": {"mass": "scales"}}}
    assert robot_from_dict(data).source_of("joints[2].link.mass") == "scales"
