"""Motions from files: each kind, every problem at once with its place, and the command that shows one."""

import dataclasses

import numpy as np
import pytest

import vdfmu
from tests.arm.motion.files import require_read, writer
from vdfmu.arm.motion.read import check_motion
from vdfmu.base.errors import ModelError, UsageError
from vdfmu.cli.commands import app
from vdfmu.system.scenario import load_scenario

GOOD = {
    "waypoints": "points = [[0, 0], [0.5, 0.2]]\nvelocity = 1.0\nacceleration = [2, 3]",
    "samples": "times = [0, 0.5, 1]\npoints = [[0, 0], [0.1, 0.1], [0, 0.2]]",
}


@pytest.fixture(scope="module")
def robot():
    return vdfmu.load_robot("planar_2dof")


@pytest.fixture
def written(tmp_path):
    return writer(tmp_path)


@pytest.mark.few(2)
@pytest.mark.parametrize("kind", GOOD)
def test_each_kind_is_read(kind, robot, written):
    require_read(written, kind, GOOD[kind], robot)


def test_a_csv_file_has_columns_in_any_order_and_unit(robot, written):
    text = "q2 [rad],time [s],q1 [deg]\n\n0.5,0,90\n0.25,1,0\n0,2,-90\n"
    motion = vdfmu.load_motion(written(text, "path.csv"), robot)
    # degrees have one rounding more
    assert motion.at(np.array([0.0, 1.0, 2.0]))[0] == pytest.approx(
        np.array([[np.pi / 2, 0.5], [0.0, 0.25], [-np.pi / 2, 0.0]]), abs=1e-15
    )
    slider = vdfmu.load_robot("slider_3dof")
    number = slider.joint_types.index("prismatic") + 1
    heading = ",".join(f"q{j}{' [mm]' * (j == number)}" for j in (1, 2, 3))
    path = written(f"{heading},time\n0,0,0,0\n100,100,100,1\n", "slider.csv")
    expected = np.where(np.arange(3) == number - 1, 0.1, 100.0)
    assert vdfmu.load_motion(path, slider).end == pytest.approx(expected)


def test_columns_may_have_the_names_of_joints(robot, written):
    named = dataclasses.replace(robot, joint_names=("shoulder", "elbow_joint"))
    expected = vdfmu.load_motion(written("time,q1 [deg],q2\n0,0,0\n1,90,0.5\n", "numbers.csv"), named)
    motion = vdfmu.load_motion(written("time,elbow_joint,shoulder [deg]\n0,0,0\n1,0.5,90\n", "names.csv"), named)
    np.testing.assert_array_equal(motion.coefficients, expected.coefficients)
    for heading, words in (
        ("time,elbow_joint,shoulder,q1", "q1: expected one column for q1, got another one"),
        ("time,elbow_joint,shoulder,wrist", "wrist: expected q1 to q2, or shoulder, elbow_joint, time"),
    ):
        with pytest.raises(ModelError, match=words):
            vdfmu.load_motion(written(f"{heading}\n0,0,0,0\n1,1,1,1\n", "bad.csv"), named)
    stopped = dataclasses.replace(named, limits=True).with_parameters(
        q_min=-0.1, q_max=0.1, tau_stall=9.0, kappa_dot_max=9.0
    )
    with pytest.raises(ModelError) as caught:
        vdfmu.load_motion(written("time,q1,q2\n0,0,0\n1,1,0.5\n", "far.csv"), stopped)
    text = str(caught.value)
    assert "joint 1 shoulder: expected" in text and "joint 2 elbow_joint: expected" in text
    assert text.count("Choose other points.") == 1  # the fix of both


def test_points_of_a_file_may_rest(robot, written):
    written("q1,q2,dwell [s]\n0,0,0\n1,0.5,0.5\n0,0,0.25\n", "points.csv")
    path = written('[motion]\nkind = "waypoints"\nfile = "points.csv"\nvelocity = 1\nacceleration = 5\n')
    motion = vdfmu.load_motion(path, robot)
    rests = np.flatnonzero(np.abs(motion.coefficients[:, 1:]).max(axis=(1, 2)) == 0.0)
    assert np.diff(motion.knots)[rests] == pytest.approx([0.5, 0.25])


@pytest.mark.parametrize(("text", "words"), [
    (
        "time [s],q1 [mm],q2,q4\n0,0,x,1\n1,nan,0,1\n0.5,0,0,1\n2,0,0\n",
        [
            "row 2: q2: expected a number, got 'x'", "row 5: expected 4 cells, got 3",
            "row 3: q1: expected a finite number, got nan",
            "row 4: time: expected more than the 1 s of the row before", "row 1: q1: expected rad or deg, got 'mm'",
            "row 1: q4: expected q1 to q2, time",
        ],
    ),
    (
        "time,a [mm],q1 [mm],q2 [mm],b\n0,0,0,0,0\n1,1,1,1,1\n",
        ["row 1: a, b: expected q1 to q2, time", "q1, q2: expected rad or deg, got 'mm'. Convert the columns."],
    ),
    ("time,q1\n0,0\n1,1\n", ["row 1: expected a column for each joint, got none of q2"]),
    ("time [ms],q1,q2\n0,0,0\n1,1,1\n", ["row 1: time: expected s, got 'ms'"]),
    ("q1,q2\n0,0\n1,1\n", ["motion.times: expected a value for samples, got nothing"]),
    ("", ["expected rows of numbers below the names, got none"]),
    ("time,q1,q1,q2\n0,0,0,0\n", ["q1: more than one column has this name"]),
    ("time,q1,q2\n0,0,0\n", ["waypoints: expected at least 2 points"]),
])  # fmt: skip
def test_problems_of_a_csv_file_are_named_at_once_with_their_rows(robot, written, text, words):
    with pytest.raises(ModelError) as caught:
        vdfmu.load_motion(written(text, "bad.csv"), robot)
    problems = "\n".join(caught.value.problems)
    for word in words:
        assert word in problems
    assert problems.count("\n") + 1 == len(words)


@pytest.mark.parametrize(("text", "words"), [
    ('motion = "motion.toml"', ["motion: expected a table, or another file with it, got the file itself"]),
    ('kind = "sample"', ["motion.kind: expected", 'Did you mean "samples"?']),
    ("points = [[0, 0]]", ["motion.kind: expected"]),
    ('kind = "waypoints"', ["motion.points: expected a value for waypoints, got nothing", "points.csv"]),
    ('kind = "waypoints"\npoints = [[0, 0], [1]]\nfoo = 1', ["motion.foo: expected a known key", "motion.points"]),
    ('kind = "waypoints"\npoints = [[0, "a"], [1, 1]]', ["motion.points[1][2]: expected a finite number"]),
    (
        'kind = "waypoints"\npoints = [[0], [1]]\nduration = 1',
        ["expected positions of the 2 joints of planar_2dof"],
    ),
    ('kind = "waypoints"\nfile = "no.csv"', ["no.csv: expected a CSV file"]),
    ('kind = "waypoints"\npoints = [[0, 0], [1, 1]]\nduration = -1', ["duration: expected more than 0 s"]),
])  # fmt: skip
def test_problems_of_a_table_are_named(robot, written, text, words):
    with pytest.raises(ModelError) as caught:
        vdfmu.load_motion(written(text), robot)
    for word in words:
        assert word in str(caught.value)


def test_a_motion_beyond_the_robot_is_refused(robot):
    limited = dataclasses.replace(robot, limits=True).with_parameters(
        q_min=-1.0, q_max=1.0, tau_stall=[0.5, 0.05], kappa_dot_max=[3.0, 0.5]
    )
    motion = vdfmu.arm.motion.waypoints([[0.0, 0.0], [0.5, 1.5]], duration=1.0)
    with pytest.raises(vdfmu.VdfmuError) as caught:
        check_motion(motion, limited)
    stops, slow = str(caught.value).splitlines()
    assert "joint 2: expected positions between its end stops, -1 and 1, got 1.16" in stops
    assert "joint 2: expected at most the torque of its motor at this speed" in slow
    check_motion(vdfmu.arm.motion.waypoints([[0.0, 0.0], [0.5, 0.2]], duration=2.0), limited)


def test_a_scenario_may_name_the_file_of_its_motion(written):
    head = 'name = "a"\nrobot = "planar_2dof"\nstop = 1.0\nstep = -1.0\n'
    path = written(f'{head}[motion]\nkind = "waypoints"\npoints = [[0, 0], [1, 1]]\n[trajectory]\nT = 1.0\n')
    with pytest.raises(ModelError) as caught:
        load_scenario(path)
    text = str(caught.value)
    for words in ("step: expected", "motion: waypoints: expected times", "trajectory.T: motion has no T"):
        assert words in text
    written(f'kind = "waypoints"\n{GOOD["waypoints"]}', "other.toml")
    head = 'name = "a"\nrobot = "planar_2dof"\nstop = 1.0\nstep = 0.1\nmotion = "other.toml"\n'
    scenario = load_scenario(written(f"{head}[trajectory]\nspeed = 0.5\n"))
    assert scenario.system.parts["trajectory"].unit.__name__ == "Motion"
    assert scenario.sections["plant"]["q_0"] == [0.0, 0.0]


def test_the_command_takes_names_of_scenarios(written, capsys):
    with pytest.raises(vdfmu.VdfmuError, match="expected a robot"):
        app(["scenario", "motion", str(written("q1\n0\n", "a.csv"))], standalone_mode=False)
    with pytest.raises(SystemExit, match="0"):
        app(["scenario", "motion", "two_joint"], standalone_mode=False)
    assert "30 s at" in capsys.readouterr().out
    with pytest.raises(UsageError, match="no scenario 'two_join'.* Did you mean \"two_joint\"?"):
        app(["scenario", "motion", "two_join"], standalone_mode=False)
    with pytest.raises(UsageError, match="no robot 'ur5'.* Did you mean \"ur5e_6dof\"?"):
        app(["scenario", "motion", "two_joint", "--robot", "ur5"], standalone_mode=False)


def test_a_file_in_degrees_under_rad_is_noted(robot, written):
    text = "time [s],q1 [rad],q2\n0,0,0\n1,90,0.5\n2,0,0\n"
    noted = vdfmu.load_motion(written(text, "path.csv"), robot).notes
    assert noted[-1] == "position of joint 1 = 90 rad looks like degrees. Write 1.571 rad."
    right = vdfmu.load_motion(written(text.replace("q1 [rad]", "q1 [deg]"), "path.csv"), robot)
    assert not any("degrees" in note for note in right.notes)
