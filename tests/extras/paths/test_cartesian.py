"""Lines and circles of the end effector: paths followed, and what no path can be."""

import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import vdfmu
from tests.arm.motion.files import require_read, writer
from tests.arm.motion.jumps import jumps, rounding
from vdfmu.base.errors import ModelError, UsageError
from vdfmu.extras import paths as motions
from vdfmu.extras.paths.cartesian import follow


@pytest.mark.heavy
def test_a_line_is_straight_and_a_circle_round(arm):
    q = np.array([0.3, 0.5, 0.7, 0.2, 0.8, 0.1])
    p_0, R_0 = vdfmu.dynamics.forward_kinematics(arm, q)
    target, R_1 = p_0 + [-0.1, 0.1, 0.0], Rotation.from_rotvec([0.2, 0.1, -0.3]).as_matrix() @ R_0
    motion = motions.line(arm, q, target, orientation=R_1, velocity=1.0, acceleration=3.0, tolerance=1e-7)
    p, R = vdfmu.dynamics.forward_kinematics(arm, motion.at(np.linspace(0.0, motion.duration, 3001))[0])
    along = (target - p_0) / np.linalg.norm(target - p_0)
    off = p - p_0 - ((p - p_0) @ along)[:, None] * along
    # the tolerance, which holds at five points a knot, and is looked at at some forty here
    assert np.linalg.norm(off, axis=1).max() < 2e-7
    assert np.linalg.norm(p[-1] - target) < 1e-10 and np.abs(R[-1] - R_1).max() < 1e-10  # Newton's 1e-11
    turned = np.array([Rotation.from_matrix(R_0.T @ rotation).as_rotvec() for rotation in R])
    axis = turned[-1] / np.linalg.norm(turned[-1])
    assert np.abs(turned - (turned @ axis)[:, None] * axis).max() < 2e-7  # about one axis: slerp
    share = ((p - p_0) @ along) / np.linalg.norm(target - p_0)
    assert np.abs(turned @ axis / np.linalg.norm(turned[-1]) - share).max() < 1e-5  # 2e-7 m of 0.15 m, 2e-7 rad of 0.37
    centre = p_0 + [-0.05, 0.0, 0.0]
    motion = motions.circle(arm, q, centre, [0, 1, 0], speed=0.2, tolerance=1e-7)
    t = np.linspace(0.0, motion.duration, 3001)
    p, R = vdfmu.dynamics.forward_kinematics(arm, motion.at(t)[0])
    assert np.abs(np.linalg.norm(p - centre, axis=1) - 0.05).max() < 2e-7 and np.abs(p[:, 1] - p_0[1]).max() < 2e-7
    assert np.abs(R - R_0).max() < 2e-7 and motion.closed
    speed = np.linalg.norm(np.diff(p, axis=0), axis=1) / (t[1] - t[0])
    assert speed.max() == pytest.approx(0.2, rel=1e-4)  # chords of arcs of 2e-3 rad: 1e-6; 2e-7 m in 8e-4 s adds more


@pytest.mark.heavy
def test_the_end_effector_keeps_its_speed(planar, arm):
    q = [0.3, 0.5, 0.7, 0.2, 0.8, 0.1]
    p, R = vdfmu.dynamics.forward_kinematics(arm, q)
    for robot, motion in (
        (arm, motions.circle(arm, q, [0.13, 0.0, 1.18], [0, 1, 0], speed=0.2)),
        (arm, motions.line(arm, q, [p + [0.0, 0.05, 0.0], p], speed=0.2)),
        (planar, motions.line(planar, [0.3, 0.8], [0.5, 0.0, 0.6], speed=0.2)),
    ):
        q_all, q_dot = motion.at(np.linspace(0.0, motion.duration, 100_001))[:2]
        J = vdfmu.dynamics.jacobian(robot, q_all)[:, :3]
        speed = np.linalg.norm(np.einsum("tij,tj->ti", J, q_dot), axis=1).max()
        # 400 looks a piece: 1e-5 of the ripple, which is 1e-5 of the speed; and it is not much slower than it may be
        assert 0.2 * (1.0 - 1e-5) < speed <= 0.2 * (1.0 + 1e-9)
    turn = R @ Rotation.from_rotvec([0.0, 0.0, 0.2]).as_matrix()
    with pytest.raises(UsageError, match="speed: expected a path along which the end effector moves"):
        motions.line(arm, q, p, orientation=turn, speed=0.2)
    assert motions.line(arm, q, p, orientation=turn, speed=0.2, duration=1.0).duration == 1.0


def test_a_singular_pose_is_found_where_the_closed_form_has_it(planar):
    l_1, l_2 = 0.5, 0.4
    q = np.array([0.3, 0.8])
    p, _ = vdfmu.dynamics.forward_kinematics(planar, q)
    outward = p / np.linalg.norm(p)
    with pytest.raises(UsageError, match=r"got a singular pose: joint 2, at (\S+), would") as caught:
        motions.line(planar, q, 0.9 * outward, duration=1.0)  # to the stretched arm
    (at,) = np.array(str(caught.value).split("joint 2, at ")[1].split(",")[:1], dtype=float)

    def ratio(q_2):
        J = np.array([[-l_2 * np.sin(q_2), -l_2 * np.sin(q_2)], [l_1 + l_2 * np.cos(q_2), l_2 * np.cos(q_2)]])
        sigma = np.linalg.svd(J)[1]
        return sigma[1] / sigma[0]

    # the first pose on the path whose singular values are 100 apart: in 64 knots the last is within 2.5 mm of the end
    assert 0.0 < at and ratio(at) < 0.01 < ratio(at + 0.1)
    with pytest.raises(UsageError, match=r"expected a pose within reach of the arm, got one that is .* m out of reach"):
        motions.line(planar, q, 2.0 * outward, duration=1.0)
    with pytest.raises(UsageError, match="a pose within reach of the arm"):
        motions.line(planar, q, p + [0.0, 0.1, 0.0], duration=1.0)  # out of the plane


def test_end_stops_on_the_way_are_named_with_place_and_joint(planar):
    limited = dataclasses.replace(planar, limits=True).with_parameters(q_min=[-2.0, 0.7], q_max=[2.0, 2.0])
    p, _ = vdfmu.dynamics.forward_kinematics(limited, [0.3, 0.8])
    with pytest.raises(
        UsageError, match=r"line: .* % along the path, .* m: expected joint 2 between its end stops, 0.7 and 2"
    ):
        motions.line(limited, [0.3, 0.8], 0.87 / np.linalg.norm(p) * p, duration=1.0)


def test_a_redundant_arm_takes_least_norms_and_goes_to_the_middle_of_its_range(arm):
    q = np.array([0.3, 0.5, 0.7, 0.2, 0.8, 0.1])
    p, R = vdfmu.dynamics.forward_kinematics(arm, q)
    s = np.linspace(0.0, 1.0, 201)
    poses = [(p + x * np.array([0.1, 0.0, -0.1]), R) for x in s]
    positions = follow(arm, q, poses, 3, "line", 100.0 * s)
    assert np.abs(vdfmu.dynamics.forward_kinematics(arm, positions)[0] - [point for point, _ in poses]).max() < 1e-10
    for here, step in zip(positions[:-1:20], np.diff(positions, axis=0)[::20], strict=True):
        J = vdfmu.dynamics.jacobian(arm, here)[:3]
        # of a step of 5e-4 m the part that moves nothing is of second order: the change of J over it
        assert np.linalg.norm(step - np.linalg.pinv(J) @ J @ step) < 0.01 * np.linalg.norm(step)
    limited = dataclasses.replace(arm, limits=True).with_parameters(q_min=-3.0, q_max=3.0)
    drawn = follow(limited, q, poses, 3, "line", 100.0 * s)
    assert np.linalg.norm(drawn[-1]) < np.linalg.norm(positions[-1])  # 0 is the middle


@pytest.mark.few(4)
@pytest.mark.parametrize(("keys", "words"), [
    ({"points": [0.5, 0.0]}, "points: expected positions of three finite numbers"),
    ({"orientation": "up"}, "orientation: expected keep, free or a rotation"),
    ({"orientation": 2.0 * np.eye(3)}, "orientation: expected a rotation, three orthogonal rows"),
    ({"start": [0.1]}, "start: expected the positions of 2 joints"),
    ({"duration": None}, "expected a duration, a speed, or limits"),
    ({"dwell": [0.1, 0.2]}, "dwell: expected a number"),
    ({"dwell": -0.1}, "dwell: expected one positive time in s"),
    ({"tolerance": 0.0}, "tolerance: expected more than 0"),
    ({"speed": np.inf}, "speed: expected more than 0"),
    ({"start": [0.3, 0.0]}, "line: 0 % along the path, .* got a singular pose: joint 2, at 0,"),
    ({"speed": 0.1}, "duration: expected at least .* s, because of the speed"),
    ({"velocity": [1.0, 1.0, 1.0]}, "velocity: expected a number above 0 for all joints, or 2"),
])  # fmt: skip
def test_what_does_not_fit_is_named(planar, keys, words):
    good = {"start": [0.3, 0.8], "points": [0.5, 0.0, 0.6], "duration": 1.0}
    with pytest.raises(UsageError, match=words):
        motions.line(planar, **(good | keys))


def test_a_circle_that_does_not_fit_is_named(planar):
    for keys, words in (
        ({"orientation": np.eye(3)}, "orientation: expected a text"),
        ({"axis": [0.0, 0.0, 0.0]}, "circle: expected centre and axis"),
        ({"angle": 0.0}, "angle: expected a finite number other than 0"),
        ({"angle": 720.0}, r"angle: expected at most 10 turns, 62.83 rad, got 720 rad. As degrees .* 12.57"),
        ({"centre": vdfmu.dynamics.forward_kinematics(planar, [0.3, 0.8])[0]}, "centre: expected an axis that does"),
    ):
        with pytest.raises(UsageError, match=words):
            motions.circle(
                planar, [0.3, 0.8], **({"centre": [0.6, 0.0, 0.5], "axis": [0, 1, 0], "duration": 1.0} | keys)
            )


@pytest.mark.heavy
def test_no_derivative_up_to_the_fourth_jumps_and_paths_rest_at_both_ends(planar, arm):
    for motion in (
        motions.line(planar, [0.3, 0.8], [0.5, 0.0, 0.6], velocity=1.0, acceleration=3.0),
        motions.circle(arm, [0.3, 0.5, 0.7, 0.2, 0.8, 0.1], [0.13, 0.0, 1.18], [0, 1, 0], speed=0.2),
    ):
        assert np.all(jumps(motion) < rounding(motion))
        assert np.all(rounding(motion)[1:] < 1e-3 * motion.peaks.max(axis=1))  # so that a jump would show
        assert np.abs(motion.at(0.0)[1:]).max() == 0.0


@pytest.mark.parametrize(("kind", "table"), [
    ("line", "start = [0.3, 0.8]\npoints = [[0.5, 0, 0.6], [0.4, 0, 0.6]]\nspeed = 0.2\ndwell = 0.1"),
    ("circle", 'start = [0.3, 0.8]\ncentre = [0.6, 0, 0.5]\naxis = [0, -1, 0]\norientation = "free"\nduration = 2'),
])  # fmt: skip
def test_a_path_is_read_from_a_file(planar, tmp_path, kind, table):
    require_read(writer(tmp_path), kind, table, planar)


@pytest.mark.parametrize(("text", "words"), [
    ('kind = "circel"', 'Did you mean "circle"?'),
    ('kind = "line"\npoints = [0.5, 0, 0.6]', "motion.start: expected a value for line, got nothing"),
    ('kind = "line"\nstart = [0.3, 0.8]\npoints = [5, 0, 0]\nduration = 1', "out of reach"),
])  # fmt: skip
def test_problems_of_a_table_are_named(planar, tmp_path, text, words):
    with pytest.raises(ModelError) as caught:
        vdfmu.load_motion(writer(tmp_path)(text), planar)
    assert words in str(caught.value)


def test_what_is_no_robot_and_no_number_is_named(planar):
    with pytest.raises(UsageError, match="^robot: expected a Robot, got 'planar_2dof'"):
        motions.circle(planar.name, [0.3, 0.8], [0.6, 0, 0.5])
    with pytest.raises(UsageError, match="^start: expected a number, .* got 'home'"):
        motions.line(planar, "home", [0.5, 0, 0.6])
