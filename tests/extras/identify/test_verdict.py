"""The verdict on an identification: faults of logs with their likely causes, residuals, and simpler models."""

import numpy as np
import pytest

from tests.conftest import invoked
from tests.extras.identify.recorded import noisy, thinned
from vdfmu.engine.results.verdict import DOUBTFUL, FAILED, GOOD
from vdfmu.extras.identify.excitation import multisine
from vdfmu.extras.identify.fit import identified_robot, identify, score
from vdfmu.extras.identify.motion_choice import exact_log
from vdfmu.extras.identify.verdict import gain, verdict

FAULTS = {
    "none": ({}, GOOD, "residual torque"),
    "ratio": ({"q": 100.0 / 120.0}, FAILED, "gear ratio of joint 1 is 120, not 100: the link moves 0.833 times as far"),
    "mN.m": ({"tau": 1e3}, FAILED, "torques are 1000 times the robot file's: mN.m were read as N.m"),
    "kN.m": ({"tau": 1e-3}, FAILED, "torques are 0.001 times the robot file's: kN.m were read as N.m"),
    "side": ({"tau": 100.0}, FAILED, "torques are 100 times the robot file's: they are link-side"),
    "sign": ({"tau": -1.0}, FAILED, "tau[1] has the opposite sign: its friction would drive the joint"),
    "degrees": ({"kappa": np.rad2deg(1.0), "q": np.rad2deg(1.0)}, FAILED, "positions look like degrees that were read"),
    "time": ({"t": 1e-3}, FAILED, "joint 1 moves at"),
    "model": ({"friction": 0.6}, DOUBTFUL, "has a residual of 38"),
}  # fmt: skip
"""Factors of a log, the state of its identification, and what its headline says."""


@pytest.fixture(scope="module")
def log(robot):
    """Return the log of a multisine of 48 s: a row every 4 ms, encoders of 17 bits, torques with 0.5 % of noise."""
    sines = multisine([-1.2, 0.4], 1.0, [1, 2, 5, 9], period=12.0, periods=2, phases="random")
    return noisy(exact_log(robot, sines, 0.004), robot, 1)


def write(log, path, t=1.0, kappa=1.0, q=1.0, tau=1.0, friction=0.0):
    """Write a log with factors; `friction` is the size of a torque that no model has, over the RMS of torques."""
    size = friction * np.sqrt((log.tau**2).mean(axis=0)) * np.sin(0.7 * log.t)[:, None]
    columns = np.column_stack([t * log.t, kappa * log.kappa, q * log.q, tau * log.tau + size])
    heads = ["time [s]", *(f"{name}[{i}] [{unit}]" for name, unit in (("kappa", "rad"), ("q", "rad"), ("tau", "N.m"))
                           for i in (1, 2))]  # fmt: skip
    np.savetxt(path, columns, delimiter=",", header=",".join(heads), comments="", fmt="%.12g")
    return path


def test_friction_that_the_file_does_not_have_is_the_first_advice(robot):
    sticky = robot.with_parameters(f_c=30.0 * robot.f_c, f_s=30.0 * robot.f_s)
    log = exact_log(sticky, multisine([-1.2, 0.4], 1.0, [1, 2, 5, 9], period=12.0, periods=2, phases="random"), 0.01)
    smooth = robot.with_parameters(f_c=np.zeros(2), f_s=np.zeros(2), f_v=np.zeros(2))
    fit = identify(log, smooth)
    judged = verdict(fit, log.checks, smooth, score(fit, smooth, log, log))
    (advice,) = [check["more"] for check in judged["checks"] if check["key"] == "residual"]
    assert judged["state"] == FAILED and advice.startswith("give f_c[1], f_c[2], f_s[1]"), judged
    assert "in the robot file, where they are 0 and so not fitted, or check units" in advice


@pytest.mark.few(1)
@pytest.mark.parametrize(("ell", "prior", "state", "words"), [
    ([100, 100], 0.2, GOOD, "residual torque"),
    pytest.param([105, 105], 0.2, GOOD, "residual torque", marks=pytest.mark.heavy),
    ([120, 120], 0.2, DOUBTFUL, "torques are 1.2 times the file's: is the gear ratio 100, not 120? (limit 1.1)"),
    pytest.param([50, 50], 0.2, FAILED, "times the file's: is the gear ratio 100, not 50? (limit 1.6)",
                 marks=pytest.mark.heavy),
    # links of the file that may be off so far have no scale
    pytest.param([120, 120], 0.5, GOOD, "residual torque", marks=pytest.mark.heavy),
    ([120, 100], 0.2, DOUBTFUL, "identified links are physically inconsistent, so the file's are kept"),
])  # fmt: skip
def test_a_wrong_ratio_that_only_scales_torques_shows_by_the_links(ell, prior, state, words, log, robot):
    """A log of rotors that are divided by the true ratio does not show a wrong one: it only scales the torques."""
    log = thinned(log, 2)
    wrong = robot.with_parameters(ell=np.array(ell, dtype=float))
    fit = identify(log, wrong, prior=prior)
    judged = verdict(fit, log.checks, wrong, score(fit, wrong, log, log))
    assert judged["state"] == state and words in judged["headline"], judged
    made, notes = identified_robot(fit, wrong, "log.csv")
    assert not notes
    assert np.array_equal(made.mass, robot.mass) == any(check["key"] == "bodies" for check in judged["checks"])


@pytest.mark.heavy
@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_of_a_log_has_its_cause_in_the_headline_and_an_exit_code(fault, log, tmp_path):
    factors, state, words = FAULTS[fault]
    path, out = write(log, tmp_path / "log.csv", **factors), tmp_path / "arm.toml"
    done = invoked("identify", path, "--robot", "planar_2dof", "-o", out)
    (headline,) = [line for line in done.output.splitlines() if f" {state.capitalize()}: " in line]
    assert words in headline, done.output
    assert done.exit_code == (1 if state == FAILED else 0)
    assert out.exists() == (state != FAILED)


def test_a_gain_beyond_chance_is_told_from_one_by_chance():
    """Of residuals that are alike over ten rows; the interval of 95 % misses no gain in one of 20 cases."""
    missed, k = 0, 600
    for seed in range(40):
        dice = np.random.default_rng(seed)
        null, other = (np.convolve(dice.standard_normal(k + 9), np.ones(10), "valid") for _ in range(2))
        low, high = gain(other, null)
        missed += not low <= 0.0 <= high
        assert gain(0.5 * null, null) == pytest.approx((0.75, 0.75))  # a quarter of each square
    # blocks of 17 rows cut a part of the likeness, which makes intervals narrower: 40 cases of up to 0.15, four
    # deviations of 2.3 more
    assert missed <= 15
