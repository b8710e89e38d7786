"""The notation page against the code: units and shapes agree, nothing is missing."""

import dataclasses
import importlib
import re
from pathlib import Path

import numpy as np
import pytest

from vdfmu.arm.robot import Robot, load_robot
from vdfmu.arm.robot.parameters import OPTIONAL, PARAMETERS
from vdfmu.arm.robot.robot import ENDS
from vdfmu.arm.units import shipped_units
from vdfmu.compiler.unit.interface import Interface
from vdfmu.engine.rules import RULES

DOCS = Path(__file__).resolve().parents[2] / "docs"
COLUMNS = ("symbol", "code", "fmi", "unit", "shape", "equation", "meaning")


def read_rows():
    text = (DOCS / "reference" / "notation.md").read_text(encoding="utf-8")
    rows = []
    for line in text.splitlines():
        if line.startswith("| ") and not line.startswith(("| ---", "| symbol")):
            cells = [cell.strip().strip("`") for cell in line.strip("|").split("|")]
            assert len(cells) == len(COLUMNS), line
            rows.append(dict(zip(COLUMNS, cells, strict=True)))
    return rows


ROWS = read_rows()
FMI_ROWS = [row for row in ROWS if row["fmi"]]


def with_everything(robot: Robot) -> Robot:
    every = dict.fromkeys((*OPTIONAL, *ENDS), True)
    return dataclasses.replace(robot, friction="split", **every).with_parameters(
        theta_err_amplitude=1e-6, tool_offset=[0.1, 0.2, 0.3], offset=0.1, centroid=0.1, inertia=robot.inertia + 1e-5,
        gravity=[1.0, 2.0, 9.0], payload_inertia=np.eye(3) + 0.1, full_speed=0.5, F_cb=1.0,
    )  # fmt: skip


@pytest.fixture(scope="module")
def groups():
    variables = {}
    for k, name in enumerate(("manipulator_6dof", "slider_3dof")):
        robot = with_everything(load_robot(name))
        for unit in shipped_units().values():
            for variable in Interface(unit, robot):
                variables.setdefault(variable.group, ([], []))[k].append((robot, variable))
    return variables


@pytest.mark.parametrize("row", FMI_ROWS, ids=lambda row: row["fmi"])
def test_fmi_name_unit_and_shape_agree_with_the_variable_table(row, groups):
    assert row["fmi"] in groups
    revolute, slider = groups[row["fmi"]]
    per_joint = row["shape"].startswith("n")
    expected = re.fullmatch(r"([^\[]*?)(?: \[(.*)\])?", row["unit"])
    unit, prismatic = expected[1], expected[2] or expected[1]
    assert ", ".join(dict.fromkeys(v.unit for _, v in revolute if v.unit)) == unit
    for robot, v in slider:
        slides = per_joint and robot.joint_types[v.index[0]] == "prismatic"
        assert v.unit is None or v.unit in (prismatic if slides else unit).split(", ")
    n = revolute[0][0].n
    sizes = tuple(n if part == "n" else int(part) for part in row["shape"].split(", "))
    seen = {v.index for _, v in revolute}
    if sizes == (1,):
        assert seen == {()}
    else:
        # Of an inertia, which is symmetric, the interface has the upper triangle.
        indices = {i for i in np.ndindex(sizes) if "inertia" not in row["fmi"] or i[-2] <= i[-1]}
        assert seen == indices


def test_every_group_of_the_interface_is_on_the_page_once(groups):
    assert set(groups) == {row["fmi"] for row in FMI_ROWS}
    names = [row["fmi"] for row in FMI_ROWS]
    assert len(names) == len(set(names))


@pytest.mark.parametrize("name", PARAMETERS)
def test_a_parameter_of_the_robot_has_the_shape_unit_and_equation_of_the_table(name):
    row, shown = PARAMETERS[name], {shown["code"]: shown for shown in ROWS}[name]
    sizes = (*(("n",) if row.per_joint else ()), *row.shape) or (1,)
    assert shown["shape"] == ", ".join(map(str, sizes))
    revolute, prismatic = row.unit("revolute"), row.unit("prismatic")
    assert shown["unit"] == revolute + (f" [{prismatic}]" if prismatic != revolute else "")
    assert shown["equation"] == row.equation
    assert shown["fmi"] == (name if row.fold != "always" else "")


def test_the_page_of_the_robot_file_has_every_key(monkeypatch):
    monkeypatch.syspath_prepend(DOCS)
    page = importlib.import_module("interface_pages").robot_file_page()
    for row in PARAMETERS.values():
        section = page.split(f"## [{row.table}]" if row.per_joint or row.table else "## Top")[-1]
        section = page.split("## [[joints]]")[-1] if row.table == "joints" else section
        assert f"| `{row.key}` | {row.unit()}" in section.split("\n## ")[0]


def test_the_page_of_the_rules_has_every_rule(monkeypatch):
    monkeypatch.syspath_prepend(DOCS)
    page = importlib.import_module("reference_pages").rules_page()
    assert re.findall(r"^\| ([A-Z]{3}\d{3}) \| (?:problem|note) \|.*\|.*\|$", page, re.MULTILINE) == [*RULES]
    assert "| FMI009 | problem | min <= start <= max | correct the value |" in page


@pytest.mark.parametrize(
    "page",
    [
        pytest.param("interface", marks=pytest.mark.heavy),  # traces all units: 6 s
        *"gallery robot_file command_line scenario_file rules".split(),
    ],
)
def test_a_kept_page_of_the_reference_is_as_the_code_makes_it(page, monkeypatch):
    monkeypatch.syspath_prepend(DOCS)
    made = importlib.import_module("make").PAGES[f"reference/{page}.md"]()
    assert (DOCS / "reference" / f"{page}.md").read_text(encoding="utf-8") == made, (
        "run python docs/make.py --reference"
    )


def test_the_ssp_of_tracking_is_as_the_writer_makes_it(monkeypatch):
    """Without its FMUs, so that a difference of the text shows what changes for other tools."""
    monkeypatch.syspath_prepend(DOCS)
    folder, made = DOCS.parent / "ssp" / "tracking", importlib.import_module("make").ssp_texts()
    kept = {str(file.relative_to(folder)): file.read_bytes() for file in folder.rglob("*.ss*")}
    assert {*kept} == {*made} and len(made) == 9
    for name, text in made.items():
        assert kept[name] == text, f"{name}: run python docs/make.py --reference"
