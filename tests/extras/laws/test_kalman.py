"""The Kalman filter of one joint against a system written by hand, and its errors against their theory."""

import control
import numpy as np
import pytest
from scipy.linalg import expm, solve_discrete_are

import vdfmu
from vdfmu.arm.fmus import build_fmus
from vdfmu.arm.robot import robot_from_dict
from vdfmu.arm.units import find_unit
from vdfmu.base.errors import UsageError

PERIOD, POSE = 1e-3, 0.4
SIGMAS = {"sigma_tau": 0.02, "sigma_q": 0.5, "sigma_kappa": 1e-5}
M, J, K, b, ell = 0.04 + 2.0 * 0.25**2, 0.001 * 100.0, 5e3, 0.5, 100.0
K_g = -2.0 * 9.81 * 0.25 * np.sin(POSE)
"""Numbers of the pendulum's joint."""


@pytest.fixture(scope="module")
def pendulum():
    data = vdfmu.load_robot("planar_2dof").to_dict()
    data["joints"] = data["joints"][:1]
    data["joints"][0]["drive"] |= {"K_f0": 5e3, "c_f": 1e-9, "K_w0": 1e9}
    data["joints"][0]["friction"] |= {"f_v": 0.5}
    data["sources"] = {}
    return robot_from_dict(data)


@pytest.fixture(scope="module")
def by_hand():
    """Return ``A, B, G`` of x = [q, q_dot, kappa, kappa_dot] less the pose, over a period, of the file's numbers."""
    rates = np.zeros((6, 6))
    rates[0, 1] = rates[2, 3] = 1.0
    rates[1, :3] = [-(K + K_g) / M, 0.0, K / M]
    rates[3, :4] = [K / J, 0.0, -K / J, -b / J]
    rates[3, 4], rates[1, 5] = ell / J, 1.0 / M
    whole = expm(PERIOD * rates)
    return whole[:4, :4], whole[:4, 4], whole[:4, 4:] * [SIGMAS["sigma_tau"], SIGMAS["sigma_q"]]


def designed(robot):
    unit = find_unit("kalman_filter")
    return unit(robot, **unit.design(robot, POSE, period=PERIOD, **SIGMAS))


def test_model_and_gain_are_those_of_a_joint_written_by_hand_and_of_python_control(pendulum, by_hand):
    A, B, G = by_hand
    C = np.array([[0.0, 0.0, 1.0, 0.0]])
    unit = designed(pendulum)
    # the spring is softer by K (c_f G)^2 and by K / (ell^2 K_w0): 1e-10 of it
    np.testing.assert_allclose(unit.joint[0, :, :4], A, rtol=1e-8, atol=1e-12)
    np.testing.assert_allclose(unit.joint[0, :, 4], B, rtol=1e-8)
    P = solve_discrete_are(A.T, C.T, G @ G.T, np.array([[SIGMAS["sigma_kappa"] ** 2]]))
    gain = (A @ P @ C.T)[:, 0] / (C @ P @ C.T + SIGMAS["sigma_kappa"] ** 2)[0, 0]
    np.testing.assert_allclose(unit.L[0], gain, rtol=1e-6)  # a Riccati equation takes away some two digits of these
    held = 2.0 * 9.81 * 0.25 * np.cos(POSE)
    np.testing.assert_allclose(unit.rest[0], [POSE, POSE + held / 5e3, held / 100.0], rtol=1e-9)
    # The continuous model, sampled and filtered by python-control.
    A = [[0.0, 1.0, 0.0, 0.0], [-(K + K_g) / M, 0.0, K / M, 0.0], [0.0, 0.0, 0.0, 1.0], [K / J, 0.0, -K / J, -b / J]]
    B = [[0.0, 0.0], [0.0, 1.0 / M], [0.0, 0.0], [ell / J, 0.0]]
    C = [[0.0, 0.0, 1.0, 0.0]]
    sampled = control.c2d(control.ss(A, B, C, 0), PERIOD, "zoh")
    noise = np.diag(np.square([SIGMAS["sigma_tau"], SIGMAS["sigma_q"]]))
    L, _, _ = control.dlqe(sampled.A, sampled.B, C, noise, [[SIGMAS["sigma_kappa"] ** 2]])
    np.testing.assert_allclose(unit.L[0], L[:, 0], rtol=1e-6)  # as above


def follow(unit, by_hand, steps, x, noise=None):
    """Return the errors of the estimate, (steps, 4), of a joint that is the model, under a torque that changes."""
    A, B, G = by_hand
    rest = np.array([POSE, 0.0, unit.rest[0, 1], 0.0])
    random, errors = np.random.default_rng(7), []
    unit.kappa = [unit.rest[0, 1]]
    unit.start()
    for k in range(steps):
        estimate = np.concatenate([unit.q_hat, unit.q_dot_hat, unit.kappa_hat, unit.kappa_dot_hat])
        errors.append(rest + x - estimate)
        torque = 0.05 * np.sin(0.02 * k)
        w, v = (random.normal(size=2), random.normal() * SIGMAS["sigma_kappa"]) if noise else (np.zeros(2), 0.0)
        unit.kappa, unit.tau = [rest[2] + x[2] + v], [unit.rest[0, 2] + torque]
        unit.update()
        x = A @ x + B * torque + G @ w
    return np.array(errors)


def test_errors_fade_by_the_poles_of_the_filter_and_have_the_variance_of_the_riccati_equation(pendulum, by_hand):
    unit = designed(pendulum)
    x = np.array([1e-3, 0.0, 0.0, 0.0])
    errors = follow(unit, by_hand, 300, x)
    closed = by_hand[0] - np.outer(unit.L[0], [0.0, 0.0, 1.0, 0.0])
    assert np.abs(np.linalg.eigvals(closed)).max() < 1.0
    for error in errors:
        # 1e-8 of velocities of up to 1 rad/s, by the spring that is softer
        np.testing.assert_allclose(error, x, rtol=0, atol=1e-7)
        x = closed @ x
    assert abs(errors[-1, 0]) < 1e-5
    A, _, G = by_hand
    C = np.array([[0.0, 0.0, 1.0, 0.0]])
    errors = follow(unit, by_hand, 5_000, np.zeros(4), noise=True)[500:]
    P = solve_discrete_are(A.T, C.T, G @ G.T, np.array([[SIGMAS["sigma_kappa"] ** 2]]))
    # Of m samples that are alike by l^k, l the slowest pole, a variance is known to sqrt(2 / m (1 + l^2) / (1 - l^2))
    slowest = np.abs(np.linalg.eigvals(A - np.outer(unit.L[0], C))).max()
    deviation = np.sqrt(2.0 / len(errors) * (1.0 + slowest**2) / (1.0 - slowest**2))
    assert deviation < 0.2
    np.testing.assert_allclose(np.var(errors, axis=0), np.diag(P), rtol=3.0 * deviation)


SYSTEM = """name = "filtered"
description = "An arm whose links are known from encoders of motors, in the loop"
[components]
trajectory = "trajectory"
feedforward = "feedforward"
controller = "controller"
plant = "plant"
filter = "kalman_filter"
[connections]
"trajectory.q_d" = ["feedforward.q_d", "controller.q_d"]
"trajectory.q_d_dot" = ["feedforward.q_d_dot", "controller.q_d_dot"]
"trajectory.q_d_ddot" = ["feedforward.q_d_ddot"]
"trajectory.q_d_dddot" = ["feedforward.q_d_dddot"]
"trajectory.q_d_ddddot" = ["feedforward.q_d_ddddot"]
"feedforward.tau_m" = ["controller.tau_m"]
"feedforward.kappa_dot_d" = ["controller.kappa_dot_d"]
"controller.tau" = ["plant.tau", "filter.tau"]
"plant.kappa" = ["filter.kappa"]
"filter.q_hat" = ["controller.q"]
"filter.kappa_dot_hat" = ["controller.kappa_dot"]
"""
SCENARIO = """name = "filtered"
description = "The planar arm"
system = "filtered.toml"
robot = "planar_2dof"
stop = 2.0
step = 0.001
tolerance = 1e-7
[trajectory]
q_start = [-1.0, 0.0]
q_end = [-0.5, 0.7]
T = 2.0
[controller]
K_p = [1500.0, 500.0]
K_v = [40.0, 20.0]
"""


@pytest.mark.heavy
def test_links_are_known_in_the_loop(tmp_path):
    (tmp_path / "filtered.toml").write_text(SYSTEM)
    (tmp_path / "scenario.toml").write_text(SCENARIO)
    values = find_unit("kalman_filter").design(vdfmu.load_robot("planar_2dof"), [-0.75, 0.35])
    settings = {f"filter.{name}": value for name, value in values.items()}
    results = vdfmu.run(tmp_path / "scenario.toml", parameters=settings, reference=False, out=False)
    wound = np.abs(results["plant.kappa"] - results["plant.q"]).max()
    error = np.abs(results["filter.q_hat"] - results["plant.q"]).max()
    # 0.19 of 0.86 mrad: the pose is 0.35 rad away, and friction is not in the model
    assert error < 0.3 * wound
    assert np.abs(results["trajectory.q_d"] - results["plant.q"]).max() < 2.0 * error  # as good as what is measured


def test_a_filter_refuses_a_period_for_which_it_is_not_designed():
    robot = vdfmu.load_robot("planar_2dof")
    with pytest.raises(UsageError, match="period: expected design_period, for which joint and L are designed"):
        build_fmus(
            robot,
            "unused",
            units=[find_unit("kalman_filter")],
            parameters={"kalman_filter": {"period": 2e-3}},
            folded=True,
        )
