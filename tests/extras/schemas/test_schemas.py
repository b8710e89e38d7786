"""The JSON schemas accept what the readers accept, and complete what the tables have."""

import copy
import json
import tomllib
from pathlib import Path
from typing import Any

import pytest
from jsonschema import Draft7Validator

from vdfmu.arm.robot.parameters import PARAMETERS
from vdfmu.base.files import data_path
from vdfmu.extras.schemas import robot_schema, scenario_schema, system_schema

EXAMPLES = Path(__file__).resolve().parents[3] / "examples" / "units"


def problems(schema: dict[str, Any], data: dict[str, Any]) -> list[str]:
    return [f"{'.'.join(map(str, e.absolute_path))}: {e.message}" for e in Draft7Validator(schema).iter_errors(data)]


def content(path: Path) -> dict[str, Any]:
    return tomllib.loads(path.read_text(encoding="utf-8"))


@pytest.mark.parametrize("schema", [robot_schema(), scenario_schema(), system_schema()])
def test_a_schema_is_one_of_json(schema):
    Draft7Validator.check_schema(schema)
    assert json.loads(json.dumps(schema)) == schema


def test_every_shipped_file_fits_and_what_a_scenario_can_set_has_its_unit_of_measurement():
    robots, scenarios = (sorted(data_path("models").glob(f"{kind}/*.toml")) for kind in ("robots", "scenarios"))
    systems = sorted(data_path("ssp").glob("*.toml"))
    assert robots and scenarios and systems
    for path in robots:
        assert problems(robot_schema(), content(path)) == []
    for path in scenarios:
        data = content(path)
        system = data.get("system", "system")
        where = str(path.parent / system) if system.endswith(".toml") else system
        assert problems(scenario_schema(where), data) == []
    for path in systems:
        assert problems(system_schema(), content(path)) == []
    sections = scenario_schema()["properties"]
    assert sections["controller"]["properties"]["K_p"]["description"].endswith("Eq. (58) [N.m/rad or N/m]")
    assert sections["plant"]["properties"]["mass"]["description"].endswith("[kg]")
    wrench = "Force of the arm on its surroundings in {O}; Moment of the arm on its surroundings in {O} [N, N.m]"
    assert sections["plant"]["properties"]["F_e"]["description"] == wrench


def test_the_files_of_the_examples_fit():
    pytest.importorskip("vdfmu.extras.laws")  # their controller is a law of it
    assert problems(system_schema(), content(EXAMPLES / "arm.toml")) == []
    assert problems(scenario_schema(str(EXAMPLES / "arm.toml")), content(EXAMPLES / "scenario.toml")) == []


@pytest.mark.parametrize(("key", "value", "where"), [
    ("massive", 1.0, "joints.0.link: Additional properties"),
    ("mass", "3", "joints.0.link.mass: '3' is not of type 'number'"),
    ("mass", -1.0, "joints.0.link.mass: -1.0 is less than the minimum"),
    ("centroid", [1.0], "joints.0.link.centroid: "),
])  # fmt: skip
def test_wrong_values_of_a_robot_are_marked(key, value, where):
    data = copy.deepcopy(content(data_path("models") / "robots" / "planar_2dof.toml"))
    data["joints"][0]["link"][key] = value
    (problem,) = problems(robot_schema(), data)
    assert problem.startswith(where)


def test_wrong_values_of_a_scenario_are_marked_and_a_robot_has_every_row_of_the_table():
    data = content(data_path("models") / "scenarios" / "tracking.toml")
    data["controller"] |= {"K_q": 1.0, "velocity": "kappa", "K_v": [-1.0]}
    assert len(problems(scenario_schema(), data)) == 3
    text = json.dumps(robot_schema())
    assert all(f'"{row.key}": ' in text for row in PARAMETERS.values())


def test_kinds_of_motions_have_their_keys_and_a_scenario_needs_no_robot():
    schema = scenario_schema()
    kinds = schema["properties"]["motion"]["anyOf"][1:]
    keys = {kind["properties"]["kind"]["const"]: set(kind["properties"]) for kind in kinds}
    assert {"file", "points", "times", "dwell"} <= keys["waypoints"]
    assert "robot" not in schema["required"]


def test_a_drive_may_have_the_words_of_a_data_sheet():
    data = content(data_path("models") / "robots" / "planar_2dof.toml")
    for joint in data["joints"]:
        for key in ("K_f0", "c_f", "K_w0", "c_w", "I_m"):
            joint["drive"].pop(key)
        joint["drive"] |= {"stiffness": 5e3, "rotor_inertia": 1e-4}
    assert problems(robot_schema(), data) == []
    assert "[N.m/rad or N/m]" in str(robot_schema()["properties"]["joints"])
