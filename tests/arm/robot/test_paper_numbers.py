"""The shipped files hold the paper's numbers: Tables 1 to 5, Eq. (34)-(36) and the text of Section IV."""

import numpy as np
import pytest

from vdfmu.arm.robot import load_robot
from vdfmu.system.scenario import load_scenario
from vdfmu.system.scenario.values import group_value

ARM = load_robot("manipulator_6dof")

# Mass [kg], moment of inertia [kg.m2], centroid [m] of links 1 to 6.
TABLE_1 = [
    (3.2, 0.0056, [0, 0, 0.15]), (3.2, 0.0044, [0, 0, 0]), (2.0, 0.0035, [0, 0, 0]), (2.0, 0.0031, [0, 0, 0.1515]),
    (1.2, 0.0026, [0, 0, 0]), (1.2, 0.0021, [0, 0, -0.25]),
]  # fmt: skip
# f_c [N.m], f_s [N.m], f_v [N.m.s/rad], v_s [rad/s], f_ck [N.m] of joints 1 to 6.
TABLE_2 = [
    (0.49, 3.5, 0.15, 0.19, 0.05), (0.49, 3.5, 0.15, 0.19, 0.05), (0.31, 2.8, 0.12, 0.15, 0.03),
    (0.31, 2.8, 0.12, 0.15, 0.03), (0.1, 0.7, 0.03, 0.03, 0.01), (0.1, 0.7, 0.03, 0.03, 0.01),
]  # fmt: skip


@pytest.mark.parametrize("i", range(6))
def test_tables_1_and_2(i):
    mass, inertia, centroid = TABLE_1[i]
    assert ARM.mass[i] == mass
    np.testing.assert_array_equal(ARM.inertia[i], inertia * np.eye(3))
    np.testing.assert_array_equal(ARM.centroid[i], centroid)
    assert tuple(getattr(ARM, key)[i] for key in ("f_c", "f_s", "f_v", "v_s", "f_ck")) == TABLE_2[i]


def test_lengths_ratio_rotor_equations_34_to_36_and_drives_that_are_fitted_to_the_catalogue():
    l1, l2, l3, l4 = 0.3, 0.3, 0.303, 0.5
    offsets = [[0, 0, 0], [0, 0, l1], [l2, 0, 0], [0, 0, 0], [0, 0, l3], [0, l4, 0]]
    np.testing.assert_array_equal(ARM.offset, offsets)
    np.testing.assert_array_equal(ARM.ell, np.full(6, 100.0))
    np.testing.assert_array_equal(ARM.I_m, np.full(6, 0.00114))
    np.testing.assert_array_equal(ARM.gravity, [0, 0, 9.81])
    q = np.array([0.3, -0.7, 1.1, 0.4, -1.3, 2.0])
    c1, c2, c3, c4, c5, c6 = np.cos(q)
    s1, s2, s3, s4, s5, s6 = np.sin(q)
    printed = [
        [[c1, -s1, 0], [s1, c1, 0], [0, 0, 1]], [[c2, -s2, 0], [0, 0, -1], [s2, c2, 0]],
        [[c3, -s3, 0], [s3, c3, 0], [0, 0, 1]], [[0, 0, 1], [-c4, s4, 0], [-s4, -c4, 0]],
        [[c5, -s5, 0], [0, 0, -1], [s5, c5, 0]], [[c6, -s6, 0], [0, 0, 1], [-s6, -c6, 0]],
    ]  # fmt: skip
    for i in range(6):
        c, s = np.cos(q[i]), np.sin(q[i])
        turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
        # Products with 0 and 1 are exact.
        np.testing.assert_array_equal(ARM.rotation[i] @ turn, printed[i])
    # Fitted to catalogue stiffness, sizes 20, 17, 14 for joints 1-2, 3-4, 5-6; not from the paper.
    np.testing.assert_array_equal(ARM.K_f0, np.repeat([28433, 15727, 6957], 2))
    np.testing.assert_array_equal(ARM.c_f, np.repeat([2.955e-3, 4.518e-3, 8.784e-3], 2))
    np.testing.assert_array_equal(ARM.K_w0, np.repeat([3.024, 2.250, 1.223], 2))
    np.testing.assert_array_equal(ARM.c_w, np.repeat([11.43, 20.59, 33.20], 2))
    for key in ("K_f0", "c_f", "K_w0", "c_w"):
        assert "Not in the paper" in (ARM.source_of(f"joints[1].drive.{key}") or "")


@pytest.mark.parametrize(
    ("name", "degrees", "T"), [("tracking", [90, 60, 60, 90, 60, 90], 10.0), ("two_joint", [60, 30, 0, 0, 0, 0], 30.0)]
)
def test_motion_of_section_4(name, degrees, T):
    scenario = load_scenario(name)
    # Written with 16 or 17 digits: equal to one unit in the last place.
    np.testing.assert_allclose(group_value(scenario, "trajectory.q_end"), np.radians(degrees), rtol=3e-16, atol=0)
    np.testing.assert_array_equal(group_value(scenario, "trajectory.q_start"), np.zeros(6))
    assert group_value(scenario, "trajectory.T") == scenario.stop == T
    assert scenario.step == 1e-3
    assert scenario.robot.name == "manipulator_6dof"


def test_tables_4_and_5():
    paper = load_scenario("tracking").paper
    assert paper["rms_position_error_deg"] == [0.0334, 0.0115, 0.0396, 0.1336, 0.0080, 0.0470]
    assert paper["rms_torque_compensation_error_nm"] == [0.1197, 0.4594, 0.2381, 0.0951, 0.3947, 0.0513]
    assert paper["max_position_error_deg"] == [0.4] * 6
    assert "Table 4" in paper["source"]
    paper = load_scenario("two_joint").paper
    assert paper["rms_position_error_deg"] == [0.0456, 0.0227]
    assert paper["rms_torque_compensation_error_nm"] == [0.1173, 0.2981]
    assert paper["max_position_error_deg"] == [0.2, 0.2]
    assert "Table 5" in paper["source"]


@pytest.mark.parametrize(
    "name",
    [
        "estimation", "tracking", "tracking_split", "two_joint", "two_joint_table5",
        "planar_tracking", "slider_tracking",
    ],  # fmt: skip
)  # fmt: skip
def test_gains_keep_the_sampled_loop_stable(name):
    scenario = load_scenario(name)
    robot = scenario.robot
    # K_v h / (ell I_m) is the velocity that one sample of damping removes; near 1 a delayed loop fails. 57 is the half.
    removed = group_value(scenario, "controller.K_v") * scenario.step / (robot.ell * robot.I_m)
    assert (removed <= 0.5 * (1.0 + 1e-12)).all()


def test_gains_of_the_paper_arm():
    scenario = load_scenario("tracking")
    np.testing.assert_array_equal(group_value(scenario, "controller.K_p"), [2000, 2000, 4000, 2500, 2000, 2500])
    np.testing.assert_array_equal(group_value(scenario, "controller.K_v"), [57, 57, 45, 38, 40, 34])
