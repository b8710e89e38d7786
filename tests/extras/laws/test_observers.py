"""Observers and filters against closed forms and the wrench that a wall takes."""

from typing import Any

import fmpy
import numpy as np
import pytest

import vdfmu
from tests.arm.units.steps import sampled
from vdfmu.arm.equations.flexible_joint import link_torques
from vdfmu.arm.equations.friction import joint_friction
from vdfmu.arm.equations.inverse_dynamics import inverse_dynamics
from vdfmu.arm.fmus import build_fmus
from vdfmu.arm.robot import robot_from_dict
from vdfmu.arm.units import find_unit
from vdfmu.base.errors import FmuError, UsageError
from vdfmu.base.files import data_path
from vdfmu.study.analysis.loops import margins_along

EPS = np.finfo(float).eps


@pytest.fixture(scope="module")
def one_joint():
    data = vdfmu.load_robot("planar_2dof").to_dict()
    data["joints"], data["gravity"] = data["joints"][:1], [0.0, 0.0, 0.0]
    data["joints"][0]["friction"] |= {"f_c": 0.0, "f_s": 0.0, "f_v": 0.0, "f_ck": 0.0}
    data["sources"] = {}
    return robot_from_dict(data)


def test_the_momentum_observer_of_one_joint_is_a_lag_of_first_order(one_joint):
    """The momentum of a joint under constant torques is linear in time: each sample is exact."""
    tau_s, tau_ext, K_o = 7.0, 3.0, 100.0
    a = (tau_s - tau_ext) / vdfmu.dynamics.mass_matrix(one_joint, [0.0])[0, 0]
    observer = find_unit("momentum_observer")(one_joint, K_o=K_o)
    rows = sampled(
        observer, 101, q=lambda t: [0.5 * a * t * t], q_dot=lambda t: [a * t], kappa_dot=lambda t: [a * t],
        tau_s=lambda t: [tau_s],
    )  # fmt: skip
    t = 1e-3 * np.arange(101)
    # a momentum of 0.4 kg m2/s, rounded, over 1e-3 s, and the sum of 100 samples that forgets
    np.testing.assert_allclose(rows["r"][:, 0], tau_ext * (1.0 - np.exp(-K_o * t)), rtol=0, atol=1e4 * EPS)


@pytest.mark.heavy
@pytest.mark.parametrize("name", ["manipulator_6dof", "slider_3dof", "general", "counterbalance"])
def test_the_momentum_observer_sees_nothing_in_free_motion_and_the_wrench_else(name, general, with_options):
    robots = {"general": general, "counterbalance": with_options("counterbalance")}
    robot = robots.get(name) or vdfmu.load_robot(name)
    n, F_e, w = robot.n, np.array([5.0, -3.0, 4.0, 0.3, -0.2, 0.1]), 2.0

    phase, middle = 0.7 * np.arange(n), 0.4 + 0.1 * np.arange(n)
    q = lambda t: middle + 0.2 * np.sin(w * t + phase)  # noqa: E731
    q_dot = lambda t: 0.2 * w * np.cos(w * t + phase)  # noqa: E731
    q_ddot = lambda t: -0.2 * w * w * np.sin(w * t + phase)  # noqa: E731
    kappa_dot = lambda t: q_dot(t) + 1e-2 * np.cos(5.0 * t + phase)  # noqa: E731
    kappa_ddot = lambda t: q_ddot(t) - 5e-2 * np.sin(5.0 * t + phase)  # noqa: E731

    def tau_s(t, wrench):
        rotors = kappa_dot(t), kappa_ddot(t)
        xi_l, _ = joint_friction(robot, q_dot(t), kappa_dot(t))
        links = inverse_dynamics(robot, q(t), q_dot(t), q_ddot(t), wrench, rotors)
        return links - link_torques(robot, q(t)) + xi_l

    errors = []
    for period in (2e-3, 1e-3):
        for wrench in (np.zeros(6), F_e):
            observer = find_unit("momentum_observer")(robot, K_o=200.0, period=period)
            rows = sampled(
                observer, round(0.1 / period), q=q, q_dot=q_dot, kappa_dot=kappa_dot,
                tau_s=lambda t, wrench=wrench: tau_s(t, wrench),
            )  # fmt: skip
            t = period * (round(0.1 / period) - 1)
            errors.append(np.abs(rows["r"][-1] - (vdfmu.dynamics.jacobian(robot, q(t)).T @ wrench)).max())
    free, pressed = errors[::2], errors[1::2]
    scale = np.abs(tau_s(0.1, F_e)).max()
    # Trapezoids, h^2 / 12 of the second derivative of torques that change with some 5 rad/s: 1e-5 of them at 2 ms,
    # where friction does not turn; a quarter at half of the period.
    assert free[0] < 1e-4 * scale
    assert free[0] / free[1] == pytest.approx(4.0, rel=0.3)
    # behind the lag: w / K_o = 1 % of the change of the Jacobian, which moves by 0.2 w rad/s
    assert max(pressed) < 0.02 * scale


def test_the_wrench_is_found_where_the_arm_feels_it(arm):
    F_e, q = np.array([10.0, -20.0, 15.0, 1.0, -2.0, 0.5]), np.array([0.3, 0.5, -0.9, 0.4, 1.1, -0.3])
    observer = find_unit("momentum_observer")(arm, q=q)
    observer.start()
    observer.r = vdfmu.dynamics.jacobian(arm, q).T @ F_e
    observer.outputs()
    least = np.linalg.svd(vdfmu.dynamics.jacobian(arm, q), compute_uv=False).min()
    # damped: (1e-4 / least singular value)^2 of it
    np.testing.assert_allclose(observer.F_e_hat, F_e, rtol=0, atol=30.0 * (1e-4 / least) ** 2)


SYSTEM = """extends = "wall"
name = "wall_observed"
description = "An arm at a wall, with a momentum observer"
[components]
observer = "momentum_observer"
[connections]
"plant.q" = ["observer.q"]
"plant.q_dot" = ["observer.q_dot"]
"plant.kappa_dot" = ["observer.kappa_dot"]
"plant.tau_s" = ["observer.tau_s"]
"""


@pytest.mark.heavy
def test_the_wall_is_felt_within_two_percent_50_ms_after_the_touch(tmp_path, planar):
    (tmp_path / "observed.toml").write_text(SYSTEM)
    text = (data_path("models") / "scenarios" / "wall.toml").read_text()
    (tmp_path / "scenario.toml").write_text(text.replace('system = "wall"', 'system = "observed.toml"'))
    results = vdfmu.run(tmp_path / "scenario.toml", parameters={"observer.K_o": 500.0}, out=False)
    J = vdfmu.dynamics.jacobian(planar, results["plant.q"])
    true = np.einsum("kij,ki->kj", J, results["wall.F_e"])
    residual = results["observer.r"]
    touch = int(np.argmax(results["wall.N"] > 0.0))
    assert 1000 < touch < 2000
    # in free motion the solver's tolerance: 1e-7 of velocities and torques of order 1 to 10, over a period of 1e-3 s
    assert np.abs(residual[:touch]).max() < 1e-3
    late = slice(touch + 50, None)
    # The lag of 1 / 500 s and the sample: 3 ms of a force that still grows by some 0.3 % in 1 ms
    assert np.abs(residual[late] - true[late]).max() < 0.02 * np.abs(true[late]).max()
    assert np.linalg.norm(residual[-1] - true[-1]) < 2e-3 * np.linalg.norm(true[-1])  # at rest all but the creep


def test_the_notch_filter_has_the_gain_of_its_closed_form_below_half_of_the_sampling_frequency(one_joint, tmp_path):
    h, f, zeta_n, zeta_d = 1e-3, 35.0, 0.05, 0.7
    w = 2.0 * np.pi * f
    for f_z in (5.0, 35.0, 300.0):
        notch = find_unit("notch_filter")(one_joint, f=f, zeta_n=zeta_n, zeta_d=zeta_d)
        steps = 2000  # 2 s: whole periods in the last 1 s, after exp(-0.7 w 1 s) = 1e-67
        y = sampled(notch, steps, u=lambda t, f_z=f_z: [np.sin(2.0 * np.pi * f_z * t)])["y"][1000:, 0]
        t = h * np.arange(1000, 2000)
        response = 2.0 * np.mean(y * 1j * np.exp(-2j * np.pi * f_z * t))
        s = 1j * w * np.tan(np.pi * f_z * h) / np.tan(np.pi * f * h)
        exact = (s * s + 2.0 * zeta_n * w * s + w * w) / (s * s + 2.0 * zeta_d * w * s + w * w)
        assert abs(response - exact) < 1e-10  # 2000 steps of rounding in a filter whose poles are within 0.1 of 1
    y = sampled(find_unit("notch_filter")(one_joint), 1000, u=lambda t: [2.0])["y"]
    assert y[-1, 0] == pytest.approx(2.0, abs=1e-12)  # poles at exp(-0.7 * 2 pi * 20 * 1 s) = 1e-38
    path = build_fmus(one_joint, tmp_path, units=["notch_filter"], backend="python", folded=True)["notch_filter"]
    fmpy.simulate_fmu(str(path), stop_time=0.01, start_values={"f[1]": 499.0})
    with pytest.raises(Exception, match="InitializationMode failed"):
        fmpy.simulate_fmu(str(path), stop_time=0.01, start_values={"f[1]": 501.0})
    with pytest.raises((FmuError, UsageError), match=r"less than half of 1 / period"):
        build_fmus(
            one_joint, tmp_path, units=["notch_filter"], parameters={"notch_filter": {"f[1]": 501.0}}, folded=True
        )


NOTCHED = {
    "system.toml": """name = "notched"
description = "An arm under torque feedback with a notch"
[components]
trajectory = "trajectory"
controller = "joint_torque"
notch = "notch_filter"
plant = "plant"
[connections]
"trajectory.q_d" = ["controller.q_d"]
"trajectory.q_d_dot" = ["controller.q_d_dot"]
"controller.tau" = ["notch.u"]
"notch.y" = ["plant.tau"]
"plant.kappa" = ["controller.kappa"]
"plant.kappa_dot" = ["controller.kappa_dot"]
"plant.tau_s" = ["controller.tau_s"]
""",
    "scenario.toml": """name = "notched"
system = "system.toml"
robot = "planar_2dof"
stop = 2.0
step = 0.001
[trajectory]
q_start = [-1.5707963267948966, 0.0]
q_end = [0.7853981633974483, 1.0471975511965976]
T = 2.0
[controller]
K_p = [1500.0, 500.0]
K_v = [20.0, 10.0]
[notch]
f = 55.0
""",
}


@pytest.mark.heavy
def test_a_notch_at_the_first_mode_raises_the_margin_of_torque_feedback(tmp_path):
    """The mode with motors free goes from 50 to 61 Hz; a filter whose poles and zeros are alike does nothing."""
    for name, text in NOTCHED.items():
        (tmp_path / name).write_text(text)

    def margin(share, zeta_n, f=55.0, **options):
        settings = {"controller.share": share, "notch.zeta_n": zeta_n, "notch.f": f}
        study = margins_along(tmp_path / "scenario.toml", parameters=settings, **options)
        return min(m.modulus.min() for m in study.margins)

    without = margin(0.5, 0.7)
    assert without > 0.5
    assert margin(0.5, 0.1) > 1.15 * without
    assert margin(0.5, 0.1, f=100.0) == 0.0  # a notch lags below its frequency
    # with a sample of delay in each connection, while the arm moves, and before it has left its motion
    late: dict[str, Any] = {"at": [0.2, 0.4], "algorithm": "jacobi"}
    assert margin(0.8, 0.7, **late) == 0.0
    assert margin(0.8, 0.1, **late) > 0.1
