"""The motion of an experiment: its log, its limits, its file, and intervals that hold before the experiment."""

import re

import numpy as np
import pytest

import vdfmu
from tests.conftest import ran, refused
from tests.extras.identify.recorded import noisy, thinned
from vdfmu.arm import motion
from vdfmu.arm.drive.limits import motor_torque
from vdfmu.arm.equations.desired_drive import desired_drive_motion
from vdfmu.arm.equations.feedforward import feedforward_inverse
from vdfmu.arm.equations.trajectory import Desired
from vdfmu.base.errors import UsageError
from vdfmu.extras.identify.excitation import multisine
from vdfmu.extras.identify.fit import identify
from vdfmu.extras.identify.log import read_log
from vdfmu.extras.identify.motion_choice import SensorNoise, design, exact_log, predict
from vdfmu.extras.identify.rows import slope

STEP = 0.004


@pytest.mark.parametrize("name", ["planar_2dof", "slider_3dof", "kr300_6dof"])
def test_the_log_of_a_motion_is_what_the_feedforward_gives(name):
    """Of links that follow it: positions of rotors and torques of motors, the counterbalance of the KR 300 included."""
    arm = vdfmu.load_robot(name)
    sines = multisine(np.full(arm.n, 0.1), 0.2, [1, 2], 2.0, phases="random")
    log = exact_log(arm, sines, 0.001)
    for k in (700, 2345, 4321):
        desired = Desired(*sines.at(log.t[k]))
        drive, force = desired_drive_motion(arm, desired), feedforward_inverse(arm, desired)
        np.testing.assert_allclose(log.kappa[k], drive.kappa, rtol=1e-12)
        # differences of fourth order: (w h)^4 / 30, twice, is 2e-8 for w = 25 rad/s, four times the highest line, as
        # springs are not linear; friction turns an error of 1e-9 rad/s into 1e-9 f_s / eps, of 10 N.m and 0.01 rad/s
        # 1e-6; in the rotors' reaction I_m D_ddot is left out, link-side, of 0.1 rad/s2 1e-6 N.m over 0.1 at the motor
        np.testing.assert_allclose(log.tau[k], force.tau_m, rtol=1e-5)


def test_the_file_of_a_design_is_a_motion_and_its_table_that_of_an_identification(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("vdfmu.extras.identify.motion_choice._SEEDS", 1)  # for speed
    words = ["identify", "--design", "planar_2dof", "--duration", "10", "--pose", "-1.2 0.4", "--step", "0.01"]
    said = ran(*words, "-o", "motion.toml")
    for part in (
        "I_m[1]",
        "+- ",
        "note: a prediction, for a row every 10 ms, encoders of 17 bits on both sides",
        "note: the robot file has no limits",
        "collisions are not checked",
        "motion.toml: the motion, 10 s",
    ):
        assert part in said.output  # fmt: skip
    arm = vdfmu.load_robot("planar_2dof")
    read = motion.load_motion("motion.toml", arm)
    np.testing.assert_array_equal(read.start, [-1.2, 0.4])
    assert read.duration == pytest.approx(10.0, rel=1e-12) and read.notes == ()
    # the defaults, on rounded amplitudes and samples of the peaks
    assert np.all(read.peaks[0] <= 1.5) and np.all(read.peaks[1] <= 5.0)
    assert np.abs(read.extremes(0) - read.start).max() <= 1.0
    expected = predict(arm, read, sensors=SensorNoise(step=0.01))
    for value, deviation in zip(expected.values[:4], expected.deviation[:4], strict=True):
        assert f"{value:.5g}" in said.output and f"+- {1.96 * deviation:.2g}" in said.output
    shown = ran("scenario", "motion", "motion.toml", "--robot", "planar_2dof")
    assert "10 s in" in shown.output


def test_words_that_do_not_fit_are_named(robot):
    for words, message in (
        ([], "expected a log, or --design ROBOT for a motion to log, got neither"),
        (["a.csv", "--design", "planar_2dof"], "a motion to log, got both"),
        (["a.csv"], "expected --robot ROBOT"),
        (["a.csv", "--robot", "planar_2dof", "--bits", "9", "--no-links"],
         "--bits goes with --design.\n--no-links goes with --design"),
        (["--design", "planar_2dof", "--robot", "planar_2dof"], "--robot goes with a log"),
        (["--design", "planar_2dof", "--pose", "up"], "--pose up: expected numbers, such as"),
        (["--design", "planar_2dof", "--step", "0", "--bits", "3", "--noise", "2"],
         "step: expected more than 0 and at most 0.1 s, got 0.\nbits: .* from 8 to 40, got 3.\nnoise: .* got 2."),
    ):  # fmt: skip
        assert re.search(message, refused("identify", *words)), words
    panda = vdfmu.load_robot("panda_7dof")
    for call, message in (
        (lambda: design(robot, start=[1.0]), "start: expected a position for each of the 2 joints of planar_2dof"),
        (lambda: design(robot, duration=0.0), "duration: expected at least 5 s, got 0 s"),
        (lambda: design(robot, prior=-1.0), "prior: expected a share above 0"),
        (lambda: design(robot, band=-1.0), "band: expected more than 0 Hz"),
        (lambda: design(panda, start=np.zeros(7)), "start: joint .*4.*: expected a position between its end stops"),
    ):
        with pytest.raises(UsageError, match=message):
            call()


@pytest.mark.heavy
def test_a_motion_stays_within_the_limits_of_the_robot():
    arm = vdfmu.load_robot("scara_4dof")
    best = design(arm, duration=20.0, sensors=SensorNoise(step=0.005, links=False))
    low, high = best.motion.extremes(0)
    assert np.all(low > arm.q_min) and np.all(high < arm.q_max)
    log = exact_log(arm, best.motion, 0.001)
    kappa_dot = slope(log.kappa, 0.001)
    # 90 % of the speeds, with what springs add: a hundredth
    assert np.all(np.abs(kappa_dot) < 0.91 * arm.kappa_dot_max)
    # 90 % of the torques at the samples by which candidates are compared; friction and springs between them: a tenth
    np.testing.assert_array_equal(motor_torque(arm, log.tau, kappa_dot), log.tau)
    assert not any("no limits" in note for note in best.notes)
    assert not any(name.startswith("K_") for name in best.expected.names)  # no encoders behind the gears
    weak = arm.with_parameters(tau_stall=1e-3 * arm.tau_stall)
    with pytest.raises(UsageError, match="the motors are too weak for any motion"):
        design(weak, duration=20.0)


@pytest.mark.heavy
def test_intervals_before_the_experiment_are_those_after_it(robot, tmp_path):
    """Predicted deviations, and how far estimates spread over noisy logs of a simulation; also of a plain motion."""
    sensors = SensorNoise(step=STEP)
    best = design(robot, sensors=sensors)
    plain = multisine([0.0, 0.0], 1.0, [1, 2, 5, 9], 15.0, periods=2, velocity=1.5, acceleration=5.0)
    size: list[float] = []
    spread: list[float] = []
    for name, moves in (("best", best.motion), ("plain", plain)):
        out = tmp_path / name
        vdfmu.run("planar_tracking", units={"trajectory": moves.unit()}, stop=60.0, reference=False, out=out)
        log = thinned(read_log(out / "results.csv", robot), round(STEP / 0.001))
        expected = predict(robot, moves, sensors=sensors)
        kept = [k for k in range(expected.links.stop) if expected.names[k][:2] not in ("K_", "c_")]  # see docs
        values = np.array([identify(noisy(log, robot, seed), robot).values for seed in range(12)])
        actual, predicted = values.std(axis=0, ddof=1)[kept], expected.deviation[kept]
        # of 12 estimates a deviation is known to 1 / sqrt(22) = 0.21, of one log to 0.1: 2 is 3 times both. What goes
        # with the springs' shape is told wider: steps of encoders count by themselves, and in what is left
        ratio = dict(zip(kept, predicted / actual, strict=True))
        assert min(ratio.values()) > 0.5 and max(ratio.values()) < 5.0 and np.median(list(ratio.values())) < 2.0, ratio
        size.append(np.log(predicted).mean())
        spread.append(np.log(actual).mean())
    # means over 16 parameters, as 8 independent ones, are known to 0.23 / sqrt(8) = 0.08 each: two of their difference
    assert size[0] < size[1] - 0.2 and spread[0] < spread[1] - 0.2
