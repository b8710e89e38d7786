"""A robot's parameters stand in one table, and everything else follows from it."""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from fmpy import read_model_description

import vdfmu
from tests.conftest import ran
from vdfmu.arm.fmus import build, build_fmus
from vdfmu.arm.kernel import Kernel
from vdfmu.arm.robot import Robot, load_robot, robot_from_dict
from vdfmu.arm.robot.parameters import OPTIONAL, PARAMETERS
from vdfmu.arm.units.plant import Plant
from vdfmu.base.measure import JOINT_TYPES, measure
from vdfmu.compiler.unit.declaration import SOLVER_TOLERANCE
from vdfmu.compiler.unit.interface import Interface
from vdfmu.system.scenario import load_scenario
from vdfmu.system.scenario.replace import robot_for

PACKAGE = Path(vdfmu.__file__).parent
ROW = '    k_new: Array = row("drive", "stiffness", "new stiffness, Eq. {}", "(99)", 1e3, POSITIVE, default=2.0)\n'
# What a tool or a user sees of the new parameter, from a package that has one more line than this one.
PROGRAM = """
import inspect, json
import vdfmu
from vdfmu.base.errors import ModelError, UsageError
from vdfmu.arm.kernel import Kernel
from vdfmu.arm.robot import load_robot, robot_from_dict
from vdfmu.system.scenario.scenario import FACTOR_FIELDS
from vdfmu.compiler.unit.interface import Interface
from vdfmu.arm.units.plant import Plant

def refused(call, *args, **named):
    try:
        call(*args, **named)
    except (ModelError, UsageError) as error:
        return str(error)

slider = load_robot("slider_3dof")
data = slider.to_dict()
data["joints"][1]["drive"]["k_new"] = 7.0
data["sources"]["joints[2].drive.k_new"] = "measured"
robot = robot_from_dict(data)
bad = robot.to_dict()
bad["joints"][0]["drive"]["k_new"] = 0
bad["joints"][1]["drive"]["k_new"] = 1e4
variables = [v for v in Interface(Plant, robot) if v.group == "k_new"]
print(json.dumps({
    "file": vdfmu.__file__,
    "default": slider.k_new.tolist(),
    "read": robot.k_new.tolist(),
    "kept": robot_from_dict(robot.to_dict()).k_new.tolist(),
    "source": robot.source_of("joints[2].drive.k_new"),
    "set": slider.with_parameters(k_new=3.0).k_new.tolist(),
    "problems": refused(robot_from_dict, bad),
    "names": [p.name for p in robot.entries()][-3:],
    "traced": len(Kernel(robot).p) - len(robot.entries()),
    "variables": [(v.name, v.unit, v.start, v.minimum, v.maximum, v.description) for v in variables],
    "doc": inspect.getdoc(Robot).splitlines()[-2:],
    "factor": "k_new" in FACTOR_FIELDS,
}))
"""


@pytest.fixture(scope="module")
def extended(tmp_path_factory):
    """Return an environment whose vdfmu is a copy with one more row in the table, and nothing else changed."""
    root = tmp_path_factory.mktemp("extended")
    shutil.copytree(PACKAGE, root / "vdfmu", ignore=shutil.ignore_patterns("__pycache__"))
    for folder in ("models", "ssp", "fmu_src"):
        (root / folder).symlink_to(PACKAGE.parent / folder)
    table = root / "vdfmu" / "arm" / "robot" / "parameters.py"
    text = table.read_text(encoding="utf-8")
    before, end, after = text.rpartition("\n\nPARAMETERS = ")
    assert end
    table.write_text(before + ROW + end + after, encoding="utf-8")
    return os.environ | {"PYTHONPATH": str(root), "VDFMU_CACHE_DIR": str(root / "cache"), "COLUMNS": "100"}


def output(environment: dict[str, str], *arguments: str) -> str:
    done = subprocess.run(
        [sys.executable, *arguments],
        cwd=environment["PYTHONPATH"],  # else the folder of this test comes first
        env=environment, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.heavy
def test_a_new_parameter_is_one_line_and_is_shown_on_the_command_line(extended):
    seen = json.loads(output(extended, "-c", PROGRAM))
    assert seen["file"].startswith(extended["PYTHONPATH"])
    assert seen["default"] == [2.0, 2.0, 2.0]
    assert seen["read"] == seen["kept"] == [2.0, 7.0, 2.0]
    assert seen["source"] == "measured"
    assert seen["set"] == [3.0, 3.0, 3.0]
    assert seen["problems"].splitlines() == [
        "robot: joints[1].drive.k_new: expected a finite number > 0 in N.m/rad, got 0. "
        "It is the new stiffness, Eq. (99).",
        "robot: joints[2].drive.k_new: expected a number of at most 1000 in N/m, got 10000.0. "
        "It is the new stiffness, Eq. (99).",
    ]
    assert seen["names"] == ["k_new[1]", "k_new[2]", "k_new[3]"]
    assert seen["traced"] == 0
    assert seen["variables"] == [
        [f"k_new[{i}]", unit, start, 1e-12, 1e3, f"Joint {i}: new stiffness, Eq. (99)"]
        for i, unit, start in ((1, "N.m/rad", 2.0), (2, "N/m", 7.0), (3, "N.m/rad", 2.0))
    ]
    assert seen["doc"] == ["k_new : (n,) [N.m/rad or N/m]", "    New stiffness, Eq. (99)."]
    assert seen["factor"]
    shown = output(extended, "-m", "vdfmu.cli", "robot", "show", "planar_2dof")
    assert re.search(r"theta_err_phase +k_new", shown)
    assert "k_new: no source" in shown


@pytest.mark.parametrize("name", PARAMETERS)
def test_every_unit_of_measurement_is_one_of_fmi(name):
    row = PARAMETERS[name]
    units = [row.unit(joint_type) for joint_type in JOINT_TYPES]
    assert [measure(unit).name for unit in units] == units


def test_a_robot_has_the_flags_and_shapes_of_the_table_and_no_parameters_of_an_inertia_of_zero():
    robot = load_robot("planar_2dof")
    assert not any(getattr(robot, name) for name in OPTIONAL)
    robot = load_robot("slider_3dof")
    for row in PARAMETERS.values():
        assert getattr(robot, row.name).shape == ((3,) if row.per_joint else ()) + row.shape
    robot = Robot(**{**vars(load_robot("planar_2dof")), "payload": True})
    row = PARAMETERS["payload_inertia"]
    assert not any(row.is_free(robot, index) for index in np.ndindex(3, 3))
    heavy = robot.with_parameters(payload_inertia=np.eye(3))
    assert [i for i in np.ndindex(3, 3) if row.is_free(heavy, i)] == [(0, 0), (1, 1), (2, 2)]


def test_an_unfolded_robot_has_its_zeros_as_parameters(draw):
    folded = load_robot("planar_2dof")
    robot = folded.unfolded()
    names = {p.name for p in robot.entries()} - {p.name for p in folded.entries()}
    assert names == {
        "gravity[1]", "gravity[2]", "tool_offset[2]", "tool_offset[3]", "payload_mass", "payload_centroid[1]",
        "payload_centroid[2]", "payload_centroid[3]", "centroid[1,2]", "centroid[1,3]", "centroid[2,2]",
        "centroid[2,3]",
    }  # fmt: skip
    assert {*folded.constants()} - {*robot.constants()} == {n for n in names if not n.startswith("payload")}
    for each in (folded, robot):
        assert {*each.constants()}.isdisjoint({p.name for p in each.entries()} | {p.field for p in each.entries()})
    again = robot_from_dict(robot.to_dict())
    assert not again.folded and again.key() == robot.key() != folded.key()
    kernels, sizes = [Kernel(each, None) for each in (folded, robot)], [2, 2, 2, 6]
    for state in draw(folded, 3, seed=4):
        columns = [state.q, state.q_dot, state.q_ddot, state.F_e]
        torques = [kernel.rows("inverse_dynamics", columns, sizes) for kernel in kernels]
        np.testing.assert_array_equal(*torques)


def test_a_file_can_be_unfolded_and_settings_unfold():
    data = load_robot("planar_2dof").to_dict()
    assert robot_from_dict(data | {"folded": False}).payload
    robot = robot_from_dict(data)
    assert robot_for(robot, ["plant.mass[1]", "plant.gravity", "robot.gravity[3]"]) is robot
    for name in ("plant.gravity[1]", "centroid[2,3]", "robot.tool_offset[2]"):
        assert not robot_for(robot, [name]).folded
    only = robot_for(robot, ["payload_mass"])
    assert only.folded and only.payload


def test_the_solver_has_one_default_tolerance_and_the_docstring_the_shape_of_each_parameter(tmp_path, plant_solver):
    shipped = PACKAGE.parent / "models" / "scenarios" / "planar_tracking.toml"
    text = shipped.read_text(encoding="utf-8")
    assert text.count("\ntolerance") == 1
    (tmp_path / "own.toml").write_text(re.sub(r"\ntolerance.*", "", text), encoding="utf-8")
    robot = load_robot("planar_2dof")
    defaults = [
        load_scenario(tmp_path / "own.toml").tolerance,
        plant_solver(robot).tolerance,
        Interface(Plant, robot).find("tolerance").start,
    ]
    assert defaults == [SOLVER_TOLERANCE] * 3
    shown = Robot.__doc__ or ""
    for row in PARAMETERS.values():
        shape = (*(["n"] if row.per_joint else []), *map(str, row.shape))
        size = f"({shape[0]},)" if len(shape) == 1 else f"({', '.join(shape)})"
        assert f"{row.name} : {size} [" in shown, row.name


@pytest.mark.parametrize("folded", [False, True])
def test_a_plant_has_the_same_parameters_by_each_way_to_build_it(tmp_path, folded):
    """Python FMUs: their descriptions are those of the native ones."""
    robot = load_robot("planar_2dof")
    single = build("plant", tmp_path / "one.fmu", robot=robot, folded=folded, backend="python")
    many = build_fmus(robot, tmp_path / "many", units=["plant"], folded=folded, backend="python")["plant"]
    words = ["build", "plant", "--robot", "planar_2dof", "--backend", "python", "-o", tmp_path / "command"]
    ran(*words, *["--folded"] * folded)
    descriptions = [read_model_description(str(file)) for file in (single, many, tmp_path / "command" / "Plant.fmu")]
    first, *more = ([v.name for v in each.modelVariables if v.causality == "parameter"] for each in descriptions)
    assert more == [first, first] and ("payload_mass" in first) is not folded
