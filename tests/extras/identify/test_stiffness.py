"""Stiffness from the motors' side: the linear model, its derivatives, and logs whose springs are known."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

import vdfmu
from tests.conftest import ran, refused
from vdfmu.arm.equations.harmonic_drive import deformation, deformation_derivative
from vdfmu.base.errors import UsageError
from vdfmu.extras.identify.log import Log, read_log
from vdfmu.extras.identify.motor_side import MotorSide, effective_stiffness
from vdfmu.extras.identify.periodic import SETTLING, USED, aligned, periods_of
from vdfmu.extras.identify.stiffness import _Fit, identify_stiffness
from vdfmu.extras.identify.stiffness_commands import excitation_text, read_excitation
from vdfmu.extras.identify.stiffness_design import LEAST, NYQUIST, stiffness_experiment
from vdfmu.extras.identify.stiffness_report import scaled_robot, stiffness_verdict, unexcited_verdict

POSES = {
    "planar_2dof": [0.3, -0.5],
    "slider_3dof": [0.1, 0.3, -0.4],
    "ur5e_6dof": [0.3, -0.9, 1.2, -0.6, 0.8, 0.2],
    "manipulator_6dof": [0.2, 0.5, -0.8, 0.4, 0.6, -0.3],
}


@pytest.mark.parametrize("name", POSES)
def test_the_model_is_that_of_linearize_with_rotor_coupling_and_without(name):
    for coupled in (True, False):
        robot = dataclasses.replace(vdfmu.load_robot(name), rotor_coupling=coupled)
        side = MotorSide(robot, np.array(POSES[name]))
        tangent = 1.0 / np.asarray(deformation_derivative(robot, side.weight), dtype=float)
        drives = side.start()._replace(stiffness=tangent, damping=np.zeros(robot.n))
        system = vdfmu.linearize(robot, POSES[name])
        rows = [system.outputs.index(f"kappa[{i + 1}]") for i in range(robot.n)]
        columns = [system.inputs.index(f"tau[{i + 1}]") for i in range(robot.n)]
        w = 2.0 * np.pi * np.array([3.0, 17.0, 60.0, 200.0, 390.0])
        for s, Z in zip(1j * w, side.impedance(w, drives), strict=True):
            states = np.linalg.solve(s * np.eye(len(system.A)) - system.A, system.B[:, columns])
            theirs = system.C[rows] @ states
            # the slope of gravity is a difference, good to 1e-10 of the torque; the rest is rounding
            np.testing.assert_allclose(np.linalg.inv(Z) * robot.ell, theirs, atol=1e-10 * np.abs(theirs).max())


def test_the_effective_stiffness_is_the_tangent_for_a_small_torque_and_the_regression_for_a_large_one():
    robot = vdfmu.load_robot("planar_2dof")
    weight = np.array([3.0, 0.5])
    tangent = 1.0 / np.asarray(deformation_derivative(robot, weight), dtype=float)
    small = effective_stiffness(robot, weight, np.array([1e-3, 1e-3]))
    np.testing.assert_allclose(small, tangent, rtol=1e-6)  # its square, 1e-6 of the torque scale of the spring
    swing = np.array([8.0, 3.0])
    torques = weight + swing * np.random.default_rng(0).standard_normal((40_000, 2))
    bent = np.array([deformation(robot, each) for each in torques])
    about = bent - bent.mean(axis=0)
    sampled = (about * (torques - torques.mean(axis=0))).sum(axis=0) / (about**2).sum(axis=0)
    large = effective_stiffness(robot, weight, swing)
    np.testing.assert_allclose(large, sampled, rtol=0.01)  # a mean of 40,000 has 0.5 %
    assert (large > 1.05 * tangent).any()


def linear_log(robot, plan, pose, *, factor, delay, step=1e-3, payload=0.0, noise=1e-3, seed=0):
    """Log of an arm that is its linear model, without dry friction: exact answers, line by line, plus noise."""
    side = MotorSide(robot, pose)
    start = side.start()
    drives = start._replace(stiffness=start.stiffness * factor, payload=payload)
    dice = np.random.default_rng(seed)
    every = round(step / plan.t[1])
    rows = round(plan.period / plan.t[1])
    kappa = []
    for part in plan.torque.reshape(-1, rows, robot.n):
        spectrum = np.fft.rfft(part, axis=0)
        f = np.arange(len(spectrum)) / plan.period
        used = np.abs(spectrum).sum(axis=1) > 1e-6 * np.abs(spectrum).max()
        w = 2.0 * np.pi * f[used]
        motion = np.zeros_like(spectrum)
        motion[used] = np.linalg.solve(side.impedance(w, drives), (spectrum[used] * robot.ell)[..., None])[..., 0]
        motion[used] *= np.exp(-1j * w * delay)[:, None]
        kappa.append(np.fft.irfft(motion, rows, axis=0))
    fade = np.linspace(0.0, 1.0, rows)[:, None]
    count = SETTLING + USED
    for k in range(count, len(kappa), count):  # from one realisation to the next, in its settling period
        kappa[k] = (1.0 - fade) * kappa[k - 1] + fade * kappa[k]
    positions = pose + np.concatenate(kappa)[::every]
    torques = (plan.torque + side.weight / robot.ell)[::every]
    torques = torques + noise * plan.torque.std(axis=0) * dice.standard_normal(torques.shape)
    bit = 2.0 * np.pi / 2**17 / robot.ell
    return Log("log", plan.t[::every], np.round(positions / bit) * bit, torques, None), drives


@pytest.fixture(scope="module")
def planar():
    robot = vdfmu.load_robot("planar_2dof")
    return robot, stiffness_experiment(robot, pose=POSES["planar_2dof"])


def test_a_linear_arm_is_identified_within_its_interval_with_its_delay_and_payload(planar):
    robot, plan = planar
    factor = np.array([0.75, 1.3])
    log, drives = linear_log(robot, plan.excitation, plan.pose, factor=factor, delay=1.5e-3, payload=0.4)
    fit = identify_stiffness(log, robot, plan.excitation)
    for level in fit.levels:
        assert level.identifiable.all()
        # no nonlinearity: the residual is the noise, far below the floor of 0.75 %
        np.testing.assert_allclose(level.stiffness, drives.stiffness, rtol=3e-3)
        assert abs(level.delay - 1.5e-3) < 1e-5
        assert abs(level.drives.payload - 0.4) < 0.05
        assert (level.absolute > level.deviation).all()
    made, notes = scaled_robot(fit)
    assert not notes
    ratio = made.K_f0 / robot.K_f0
    # the file's spring at the torque of the springs, to which the factor belongs here only at rest
    at = MotorSide(made, fit.side.pose).start(fit.levels[-1].spring).stiffness
    np.testing.assert_allclose(at, fit.levels[-1].stiffness, rtol=2e-2)
    assert ratio[0] < 1.0 < ratio[1]
    assert stiffness_verdict(fit)["state"] == "good"


def test_derivatives_of_the_residuals_are_those_of_differences():
    robot = dataclasses.replace(vdfmu.load_robot("slider_3dof"), rotor_coupling=True)
    plan = stiffness_experiment(robot, pose=POSES["slider_3dof"])
    log, _ = linear_log(robot, plan.excitation, plan.pose, factor=1.1, delay=1e-3, payload=0.2)
    fit = _Fit(periods_of(log, plan.excitation, robot, 0)[-1], MotorSide(robot, plan.pose))
    dice = np.random.default_rng(1)
    x = fit.middle + 0.05 * dice.standard_normal(fit.size)
    state = fit.state(x)
    for k in range(fit.size):
        step = 1e-5 * np.eye(fit.size)[k]
        slope = (fit.errors(x + step)[1] - fit.errors(x - step)[1]) / 2e-5
        # differences of second order are off by a sixth of the square of step times Q, which is 50 near a pole: 4e-8 of
        # the second derivative, which is Q times as large
        largest = np.maximum(np.abs(state.slopes[..., k]).max(), np.abs(state.errors).max())
        np.testing.assert_allclose(state.slopes[..., k], slope, atol=5e-6 * largest)


def test_a_log_that_begins_earlier_is_aligned_and_other_torques_are_refused(planar):
    robot, plan = planar
    log, _ = linear_log(robot, plan.excitation, plan.pose, factor=1.0, delay=0.0)
    before = 137
    padded = log._replace(
        t=np.arange(len(log.t) + before) * log.step,
        kappa=np.vstack([np.repeat(log.kappa[:1], before, axis=0), log.kappa]),
        tau=np.vstack([np.repeat(log.tau.mean(axis=0)[None], before, axis=0), log.tau]),
    )
    assert aligned(padded, plan.excitation) == before
    with pytest.raises(UsageError, match="expected the torques of the excitation, got others"):
        aligned(log._replace(tau=log.tau[:, ::-1]), plan.excitation)
    with pytest.raises(UsageError, match="a log of the whole excitation, 48 s, got 10 s"):
        aligned(log._replace(t=log.t[:10001], tau=log.tau[:10001], kappa=log.kappa[:10001]), plan.excitation)


def test_a_joint_whose_antiresonance_is_beyond_the_lines_is_not_identifiable():
    robot = vdfmu.load_robot("ur5e_6dof")
    plan = stiffness_experiment(robot)
    assert plan.excitation.lines[-1] <= NYQUIST * 1000.0
    assert [bool(text) for text in plan.lacks] == [False] * 5 + [True]
    assert "logged at 3" in plan.lacks[5]  # 1.5 * 979 Hz / 0.45 = 3.26 kHz
    assert (plan.torque >= LEAST * plan.breakaway).all()
    assert not any(stiffness_experiment(robot, step=2.5e-4).lacks)


def test_limits_of_torque_reduce_the_excitation_and_are_named():
    robot = vdfmu.load_robot("iiwa_7dof")
    weak = robot.with_parameters(tau_stall=robot.tau_stall * 0.05)
    plan = stiffness_experiment(weak, pose=np.zeros(7) + 0.05)
    free = stiffness_experiment(robot, pose=np.zeros(7) + 0.05)
    assert (plan.torque < free.torque).any()
    lacking = plan.torque < LEAST * plan.breakaway
    assert lacking.any()
    assert all(("N.m RMS" in text) == short for text, short in zip(plan.lacks, lacking, strict=True))


@pytest.mark.heavy
def test_torques_survive_their_file(planar, tmp_path):
    _, plan = planar
    path = tmp_path / "torques.csv"
    path.write_text(excitation_text(plan.excitation))
    again = read_excitation(path, 2)
    np.testing.assert_allclose(again.torque, plan.excitation.torque, atol=1e-5)  # six digits of 0.1 N.m
    np.testing.assert_array_equal(again.lines, plan.excitation.lines)
    assert again.period == pytest.approx(2.0, rel=1e-9)
    with pytest.raises(UsageError, match=r"controller.tau_m\[3\] is missing"):
        read_excitation(path, 3)


def test_the_measured_kr300_does_not_show_its_springs_because_friction_hides_them():
    robot = vdfmu.load_robot("kr300_6dof")
    log = read_log("examples/kr300/a.parquet", robot)
    plan = stiffness_experiment(robot, pose=log.kappa.mean(axis=0), step=log.step)
    verdict = unexcited_verdict(log, robot, plan)
    assert verdict["state"] == "failed"
    assert "excitation of joint 1 at 8.5 to 34 Hz is 11 % of its friction" in verdict["headline"]
    loud = log._replace(tau=100.0 * log.tau)  # what would refute it: torques that are not small there
    assert "joint 1 is excited, but not by periodic torques" in unexcited_verdict(loud, robot, plan)["headline"]


@pytest.mark.heavy
def test_the_command_designs_torques_and_writes_what_their_log_shows(planar, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    robot, plan = planar
    pose = " ".join(map(str, POSES["planar_2dof"]))
    words = ["identify", "--design", "planar_2dof", "--for", "stiffness", "--pose", pose, "-o", "torques.csv"]
    said = ran(*words).output
    assert f"{len(plan.excitation.lines)} lines from 1 to {plan.excitation.lines[-1]:.4g} Hz, 48 s" in said
    log, drives = linear_log(robot, plan.excitation, plan.pose, factor=0.8, delay=0.0)
    heads = ",".join(f"{name}[{i}]" for name in ("kappa", "tau") for i in (1, 2))
    table = np.column_stack([log.t, log.kappa, log.tau])
    np.savetxt("log.csv", table, delimiter=",", header=f"time,{heads}", comments="", fmt="%.12g")
    words = ["identify", "log.csv", "--robot", "planar_2dof", "--for", "stiffness"]
    files = ["--plot", "a.png", "--page", "a.html", "-o", "arm.toml"]
    said = ran(*words, "--excitation", "torques.csv", *files).output
    assert "Good: stiffness of 2 of 2 joints" in said
    page = (tmp_path / "a.html").read_text()
    assert "Good: stiffness of 2 of 2 joints" in page and "data:image/png;base64," in page
    assert (tmp_path / "a.png").stat().st_size > 10_000
    made = vdfmu.load_robot("arm.toml")
    assert "scaled to" in made.sources["joints[1].drive.K_f0"]
    np.testing.assert_allclose(made.K_f0 / robot.K_f0, 0.8, rtol=0.1)  # at another torque than at rest
    said = ran(*words, "--margins", "planar_tracking", code=1).output
    assert "failed" in said  # without the torques the log is not known to be periodic
    assert "margins of planar_tracking were not computed" in said
    assert "--for must be stiffness, got springs" in refused(*words[:4], "--for", "springs")
    assert "--band does not go with --for stiffness" in refused(*words, "--band", "3")
    assert "--margins goes with --for stiffness" in refused(*words[:4], "--margins", "planar_tracking")
    assert "--excitation goes with a log" in refused("identify", "--design", "planar_2dof", "--excitation", "x.csv")
    assert "expected --robot ROBOT" in refused("identify", "log.csv", "--for", "stiffness")


@pytest.mark.heavy
def test_margins_over_the_springs_hold_for_random_arms_that_fit_the_log(planar):
    from vdfmu.extras.identify.margins import spring_margins
    from vdfmu.study.analysis.loops import margins_along

    robot, plan = planar
    log, _ = linear_log(robot, plan.excitation, plan.pose, factor=0.6, delay=0.0)
    fit = identify_stiffness(log, robot, plan.excitation)
    wide = [dataclasses.replace(level, uncertainty=16.0 * level.uncertainty) for level in fit.levels]
    interval, wider = (spring_margins(each, "planar_tracking") for each in (fit, fit._replace(levels=wide)))
    made, _ = scaled_robot(fit)

    def exact(shift):
        values = {"plant.K_f0": made.K_f0 * np.exp(shift), "plant.K_w0": made.K_w0 * np.exp(shift)}
        return margins_along("planar_tracking", parameters=values).judged.figures["margin"]["value"]

    assert interval.middle == exact(np.zeros(2))
    assert interval.corner == exact(np.log(interval.factors)) < interval.likely < interval.middle
    assert wider.likely < interval.likely
    assert abs(wider.likely - wider.linear) < 0.5 * (wider.middle - wider.likely)  # the slopes say as much as the loop
    dice = np.random.default_rng(0)
    draws = dice.multivariate_normal(np.zeros(2), wide[-1].uncertainty, 20)
    below = sum(exact(each) < min(wider.likely, wider.linear) for each in draws)
    assert below <= 3  # of 20, each with 5 %: more have a probability of 1.6 %
    with pytest.raises(UsageError, match="expected a plant with the joints and gear ratios of planar_2dof"):
        spring_margins(fit, "tracking")


def test_positions_of_another_sign_or_order_give_no_stiffness_and_name_the_columns(planar):
    robot, plan = planar
    log, _ = linear_log(robot, plan.excitation, plan.pose, factor=1.0, delay=0.0)
    for kappa in (-log.kappa, log.kappa[:, ::-1]):
        fit = identify_stiffness(log._replace(kappa=kappa), robot, plan.excitation)
        assert not fit.identifiable.any()
        checks = stiffness_verdict(fit)["checks"]
        assert any("check the order, signs and units of the columns" in str(check) for check in checks)


@pytest.mark.heavy
def test_changed_files_of_torques_and_steps_that_do_not_fit_the_period_are_refused(planar, tmp_path):
    robot, plan = planar
    lines = excitation_text(plan.excitation).splitlines()
    head, row = lines[0], lines[51].split(",")
    changed = {
        "empty": [head],
        "half": lines[: len(lines) // 2 + 1],
        "cut": lines[:-1],
        "nan": [*lines[:51], ",".join([row[0], "nan", row[2]]), *lines[52:]],
        "zero": [head, *(f"{line.partition(',')[0]},0,0" for line in lines[1:])],
    }
    for name, content in changed.items():
        path = tmp_path / f"{name}.csv"
        path.write_text("\n".join([*content, ""]))
        with pytest.raises(UsageError, match="expected torques in even rows, 6 times 4 equal periods"):
            read_excitation(path, 2)
    for step in (0.003, 0.09, 0.0, 0.5):
        with pytest.raises(UsageError, match="step: must divide the period of 2 s and be less than 0.1 s"):
            stiffness_experiment(robot, step=step)


@pytest.mark.heavy
def test_faults_of_the_log_fail_the_command_and_files_that_are_not_written_are_named(planar, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    robot, plan = planar
    log, _ = linear_log(robot, plan.excitation, plan.pose, factor=1.0, delay=0.0)
    Path("torques.csv").write_text(excitation_text(plan.excitation))
    heads = ",".join(["time", *(f"{name}[{i}]" for name in ("kappa", "tau") for i in (1, 2))])
    words = ["identify", "log.csv", "--robot", "planar_2dof", "--for", "stiffness", "--excitation", "torques.csv"]

    def said(tau, every=1):
        rows = np.column_stack([log.t, log.kappa, tau])[::every]
        np.savetxt("log.csv", rows, delimiter=",", header=heads, comments="", fmt="%.12g")
        return "".join(ran(*words, "-o", "arm.toml", code=1).output.split())  # lines wrap anywhere

    assert "timestherobotfile's" in said(100.0 * log.tau)
    slow = said(log.tau, every=10)
    assert f"torquesgoupto{plan.excitation.lines[-1]:.4g}Hz,butthelog'srateshows45Hz" in slow
    assert "arm.tomlwasnotwritten,becausetheverdictisfailed" in slow
    assert not Path("arm.toml").exists()
