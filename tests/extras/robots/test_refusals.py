"""Files that do not describe an arm are refused: place, what was expected, what was found and the fix, all at once."""

from pathlib import Path

import pytest

import vdfmu
from tests.extras.robots.conftest import ARM, INERTIAL, LIMIT, joint, link
from vdfmu.extras.robots import robot_from_urdf

MIMIC = LIMIT + '<mimic joint="a"/>'


def refused(path: Path, **options: str) -> list[str]:
    with pytest.raises(vdfmu.VdfmuError) as error:
        robot_from_urdf(path, **options)
    prefix = f"{path}: "
    problems = error.value.problems
    assert all(problem.startswith(prefix) for problem in problems)
    return [problem.removeprefix(prefix) for problem in problems]


@pytest.mark.parametrize(("content", "options", "expected"), [
    (ARM + link("flap") + joint("d", "one", "flap"), {},
     "--tip: expected a link, got nothing, and 2 joints branch off from one. Choose where the arm ends; all other "
     "joints are held at 0. There are: tool (3 joints), flap (2 joints), one (1 joint)."),
    (ARM, {"tip": "tol"}, "--tip: expected a link of the file, got 'tol'. Did you mean \"tool\"? There are: "),
    (ARM, {"base": "three", "tip": "one"},
     "--tip: expected a link that hangs on three, got one. Choose the base among ground."),
    (ARM, {"tip": "ground"},
     "the file: expected a joint that moves between ground and ground, got none. Choose others by --base, "),
    (ARM.replace('name="b" type="revolute"', 'name="b" type="floating"'), {},
     "joint b: expected one of revolute, continuous, prismatic, fixed, got floating. Choose a base above it, --base "
     'two, or make it type="fixed".'),
    (ARM.replace(LIMIT, MIMIC).replace(MIMIC, LIMIT, 1), {"tip": "tool"},
     "joint b: expected a joint with its own drive, got one that mimics a. End the arm before it, --tip "
     "one, or delete its <mimic>."),
    (ARM + link("flap") + joint("d", "one", "flap", inside=MIMIC), {"tip": "tool"},
     "joint d: expected no other moving joint, got one that mimics a, a joint of the arm. End the "
     "arm before that by --tip, or delete the <mimic>: it is held at 0 then."),
    (ARM + joint("d", "ground", "three"), {},
     "link three: expected one joint that carries it, got the joints c, d. An arm must be an open chain: "
     "delete all but one."),
    (ARM + link("alone"), {},
     "the file: expected one link that no joint carries, got ground, alone. Join them by fixed joints, or "),
    (link("one") + link("two") + joint("a", "one", "two") + joint("b", "two", "one"), {},
     "the file: expected a link that no joint carries, got none. The joints go in a circle."),
    (ARM + link("p") + link("q") + joint("x", "p", "q") + joint("y", "q", "p"), {"tip": "p"},
     "the file: expected links that hang on ground, got p, q. Their joints go in a circle."),
    ("", {}, "the file: expected links, got none. Is it complete? xacro writes a URDF from a .xacro file."),
    (ARM.replace(link("one"), link("one", "")), {},
     "joint a: expected a link with mass, which it moves, got no <inertial> with a mass in one. Give them by "
     "--drives: [a] link = { mass, centroid, inertia }; for a body of boxes, cylinders and spheres the mass alone, "
     'or --density, is enough. Or make the joint type="fixed".'),
    (ARM.replace('ixx="0.03"', 'ixx="-0.03"', 1), {},
     "link one: expected positive definite, in kg.m2, got principal moments -0.0"),
    (ARM.replace("-0.3 0.5 -2", "0 0 0"), {},
     "line 13: joint b: axis: expected a direction, got zeros. Give it, or type=\"fixed\"."),
    (ARM.replace("-0.3 0.5 -2", "0 nan 1"), {},
     "line 13: joint b: axis: xyz: expected 3 finite numbers, got '0 nan 1'. Correct it."),
    (ARM.replace('<mass value="2"/>', '<mass value="-2"/>', 1), {},
     "line 3: link one: mass: expected a finite number >= 0 in kg, got -2. Correct it."),
    (ARM.replace('<mass value="2"/>', "", 1), {},
     'line 3: link one: expected <mass value="..."/> in kg, got nothing. Give it, or remove <inertial>.'),
    (ARM.replace(' iyz="0.003"', "", 1), {},
     "line 3: link one: expected <inertia> with ixx, iyy, izz, ixy, ixz, iyz in kg.m2, got no iyz. Give them "),
    (ARM.replace('type="prismatic"', 'type="screw"'), {},
     "line 15: joint c: type: expected one of revolute, continuous, prismatic, fixed, floating, planar, got "
     "'screw'. Correct it."),
    (ARM.replace('<parent link="cap"/>', '<parent link="cup"/>'), {},
     "line 15: joint c: parent: expected a link of the file, got 'cup'. Did you mean \"cap\"? There are: "),
    (ARM + link("one"), {}, "line 17: link one: expected one of this name, got a second one. Rename it."),
    (ARM.replace(LIMIT, LIMIT + '<dynamics damping="-1"/>', 1), {},
     "joint a: damping: expected a number >= 0, got -1. Correct it."),
])  # fmt: skip
def test_it_is_refused(urdf, content, options, expected):
    problems = refused(urdf(content), **options)
    assert any(expected in problem for problem in problems), problems


def test_all_problems_come_at_once(urdf):
    content = ARM.replace('<mass value="2"/>', '<mass value="x"/>', 2).replace('xyz="0 1 0"', 'xyz="0 1"')
    assert refused(urdf(content)) == [
        "line 3: link one: mass: value: expected a finite number, got 'x'. Correct it.",
        "line 5: link two: mass: value: expected a finite number, got 'x'. Correct it.",
        "line 12: joint a: axis: xyz: expected 3 finite numbers, got '0 1'. Correct it.",
    ]
    bare = ARM.replace(INERTIAL, "")
    assert [problem.split(":")[0] for problem in refused(urdf(bare))] == ["joint a", "joint b", "joint c"]


@pytest.mark.parametrize(("text", "expected"), [
    ("<robot", "is not well-formed XML"),
    ('<!DOCTYPE robot [<!ENTITY x SYSTEM "/etc/passwd">]><robot>&x;</robot>', "has a document type declaration"),
    ("<sdf/>", "expected <robot>, got <sdf>. Is it the right file?"),
])  # fmt: skip
def test_what_is_no_urdf_is_named(tmp_path, text, expected):
    path = tmp_path / "arm.urdf"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(vdfmu.VdfmuError, match=expected):
        robot_from_urdf(path)


def test_a_file_that_is_missing_is_named(tmp_path):
    with pytest.raises(vdfmu.VdfmuError, match="expected a URDF or MJCF file, got nothing: it does not exist"):
        robot_from_urdf(tmp_path / "arm.urdf")


@pytest.mark.parametrize("arguments", [{"path": 5}, {"base": 1}, {"tip": ["a"]}, {"drives": b"x"}, {"tool": "x"}])
def test_an_argument_of_another_type_is_named(arguments):
    with pytest.raises(vdfmu.VdfmuError, match=f"^{next(iter(arguments))}"):
        robot_from_urdf(**{"path": "none.urdf"} | arguments)


def test_a_row_of_links_without_end_is_refused(urdf):
    n = 3000
    row = "".join(link(f"l{i}", "") for i in range(n + 1))
    row += "".join(joint(f"j{i}", f"l{i}", f"l{i + 1}", "fixed") for i in range(n))
    (problem,) = refused(urdf(row))
    assert problem == "expected a chain of at most a few hundred links. Is it one robot?"
