"""Parameters recovered from noisy logs, what a log cannot tell, robot files of it, and logs that are wrong."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
import scipy.io

import vdfmu
from tests.conftest import ran
from tests.extras.identify.recorded import noisy, thinned
from vdfmu.arm.equations.harmonic_drive import deformation
from vdfmu.arm.equations.rigid_body import body_parameters
from vdfmu.base.errors import UsageError
from vdfmu.engine.results.verdict import FAILED
from vdfmu.extras.identify.excitation import multisine
from vdfmu.extras.identify.fit import Identified, identified_robot, identify, robot_text, score
from vdfmu.extras.identify.log import Log, read_log
from vdfmu.extras.identify.verdict import verdict

PHYSICAL = ("I_m", "f_c", "f_s", "v_s", "f_v")


def multisine_run(out, **settings):
    """Run the planar arm along a multisine for 60 s, under feedforward and feedback."""
    sines = multisine([-1.2, 0.4], 1.2, [1, 2, 5, 9], period=15.0, periods=2, phases="random")
    vdfmu.run(
        "planar_tracking", units={"trajectory": sines.unit()}, stop=60.0, reference=False, out=out, overwrite=True,
        parameters=settings,
    )  # fmt: skip
    return out


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    return multisine_run(tmp_path_factory.mktemp("run"))


@pytest.fixture(scope="module")
def sticking(tmp_path_factory, robot):
    """Return the log of a loop whose feedforward knows no friction: it sticks and slips, above any band."""
    weak = {"controller.K_p": [150.0, 50.0], "controller.K_v": [4.0, 2.0]}
    out = multisine_run(tmp_path_factory.mktemp("sticking"), **weak, **{"feedforward.f_c": 0.0, "feedforward.f_s": 0.0})
    return read_log(out / "results.csv", robot)


def named(fit, robot):
    """Return the values that were found and those of a robot by name."""
    return tuple(dict(zip(fit.names, values, strict=True)) for values in (fit.values, fit.of(robot)))


@pytest.fixture(scope="module")
def clean(run, robot):
    return read_log(run / "results.csv", robot)


@pytest.fixture(scope="module")
def exact(clean, robot):
    """Return what is identified without noise from the robot's own values."""
    return identify(clean, robot)


@pytest.fixture(scope="module")
def guess(robot):
    """Return a robot file that is far off."""
    return robot.with_parameters(
        I_m=1.3 * robot.I_m, f_c=0.7 * robot.f_c, f_s=1.2 * robot.f_s, v_s=1.4 * robot.v_s, f_v=0.8 * robot.f_v,
        K_f0=1.2 * robot.K_f0, K_w0=0.8 * robot.K_w0, mass=1.1 * robot.mass,
    )  # fmt: skip


def true_stiffness(robot, fit):
    """Secant stiffness of the robot at the torques at which the found one has its own: they differ by 1e-4."""
    tau_s = fit.torque_level
    return tau_s / np.asarray(deformation(robot, tau_s))


@pytest.mark.heavy
def test_noisy_logs_give_the_truth_within_a_per_cent_and_those_without_what_the_method_leaves(clean, robot, guess):
    """Encoders of 17 bits and torques with 0.5 % noise: of 60 s, from a start 10 to 40 % off."""
    fit = identify(noisy(clean, robot, 1), guess)
    values, true = named(fit, robot)
    for name in (f"{p}[{i}]" for p in PHYSICAL for i in (1, 2)):
        assert name not in fit.held
        assert values[name] == pytest.approx(true[name], rel=0.01), name
    for name, unit in zip(fit.base.names, fit.base.units, strict=True):
        largest = max(abs(true[n]) for n, u in zip(fit.base.names, fit.base.units, strict=True) if u == unit)
        assert values[name] == pytest.approx(true[name], abs=0.01 * min(largest, abs(true[name]) or largest)), name
    np.testing.assert_allclose(fit.stiffness, true_stiffness(robot, fit), rtol=0.01)
    # a torque holds over a step of 1 ms, so on average it is half of one late
    assert fit.delay == pytest.approx(0.5e-3, abs=0.1e-3)
    fit = identify(clean, guess)
    true = np.array(fit.of(robot))
    ratio = np.array([v / t if t else 1.0 for v, t in zip(fit.values, true, strict=True)])
    tight = np.array([name[:3] in ("I_m", "f_c", "f_s", "f_v", "v_s") for name in fit.names])
    tight[fit.links] = True
    # filters and held torques distort friction at its reversals: a half of the per cent that noise may take
    np.testing.assert_allclose(ratio[tight], 1.0, atol=0.005)


@pytest.mark.heavy
@pytest.mark.parametrize("loop", ["clean", "sticking"])
def test_intervals_cover_the_truth(loop, robot, guess, request):
    """Of 50 logs each with other noise and other zeros of the encoders, 95 % intervals of all parameters."""
    log = thinned(request.getfixturevalue(loop), 2)
    inside: dict[str, list[bool]] = {}
    for seed in range(50):
        fit = identify(noisy(log, robot, 100 + seed), guess)
        low, high = fit.interval()
        for name, t, a, b in zip(fit.names, fit.of(robot), low, high, strict=True):
            t = 0.5e-3 if name == "delay_tau" else t  # a torque holds over a step of 1 ms
            inside.setdefault(name, []).append(a <= t <= b)
    shares = {name: float(np.mean(each)) for name, each in inside.items()}
    # 50 x 29 intervals; those of one log are correlated: as 300 independent ones, 0.95 has a deviation of 0.013, of
    # which three are allowed; of one parameter 50: the deviation is 0.031, four of them
    assert np.mean(list(shares.values())) > 0.91, shares
    assert min(share for name, share in shares.items() if name[:2] != "c_") > 0.82, shares
    assert min(shares.values()) > 0.6, shares  # the shape of springs, for which a normal distribution is a poor one


@pytest.mark.heavy
def test_intervals_cover_the_truth_where_torques_go_through_zero(tmp_path):
    """The slider, whose first axis is vertical: its spring's law is nowhere linear over a filter's length."""
    slider = vdfmu.load_robot("slider_3dof")
    sines = multisine([0.0, 0.0, 0.0], [0.8, 0.15, 0.8], [1, 2, 5, 9], period=15.0, periods=2, phases="random")
    units = {"trajectory": sines.unit()}
    vdfmu.run("slider_tracking", units=units, stop=60.0, reference=False, out=tmp_path, overwrite=True)
    log = read_log(tmp_path / "results.csv", slider)
    exact = identify(log, slider)
    values, true = named(exact, slider)
    # without noise the residual is the method's, as of the planar arm; with the law of filtered torques it was 11 %
    assert values["I_m[1]"] == pytest.approx(true["I_m[1]"], rel=0.01)
    np.testing.assert_allclose(exact.stiffness, true_stiffness(slider, exact), rtol=0.005)
    inside: list[bool] = []
    for seed in range(6):
        fit = identify(noisy(thinned(log, 2), slider, seed), slider)
        for name, a, b in zip(fit.names, *fit.interval(), strict=True):
            inside.append(a <= (0.5e-3 if name == "delay_tau" else true[name]) <= b)
    # 6 x 45 intervals, those of a log correlated: as 60 independent ones, 0.95 has a deviation of 0.028, three of them
    assert np.mean(inside) > 0.87, np.mean(inside)


@pytest.mark.heavy
def test_faults_of_sensors_are_found(clean, robot):
    """Encoders behind the gears that are late, and torques with an offset, are told with their intervals."""
    late, offset = np.array([1.5e-3, 0.7e-3]), np.array([0.02, -0.01])
    q = np.stack([np.interp(clean.t - late[i], clean.t, clean.q[:, i]) for i in range(2)], axis=1)
    fit = identify(noisy(clean._replace(q=q, tau=clean.tau + offset), robot, 3), robot)
    values = dict(zip(fit.names, zip(fit.values, fit.deviation, strict=True), strict=True))
    for i in range(2):
        for name, true in ((f"delay_q[{i + 1}]", late[i]), (f"tau_0[{i + 1}]", offset[i])):
            value, deviation = values[name]
            assert abs(value - true) < 4.0 * deviation, name  # beyond that 1 of 16,000 times
            assert deviation < 0.02 * abs(true), name
    np.testing.assert_allclose(fit.stiffness, true_stiffness(robot, fit), rtol=0.01)


@pytest.mark.heavy
def test_without_link_positions_of_all_joints_or_one_the_springs_are_kept_and_said(clean, robot):
    fit = identify(clean._replace(q=None), robot)
    assert not any(name.startswith("K_") for name in fit.names)
    assert "log them by encoders behind the gears" in fit.advice[0]
    values, true = named(fit, robot)
    assert not fit.held
    # links lie by the springs of the robot file, quasi-static: of their accelerations a per cent of the deformation's
    for name in ("f_c[1]", "f_s[2]", "mx2"):
        assert values[name] == pytest.approx(true[name], rel=0.01), name
    for i, name in enumerate(("Izz1 + 0.25 m2", "Izz2")):  # only the robot file parts it from the rotor's inertia
        whole = [each[name] + robot.ell[i] * each[f"I_m[{i + 1}]"] for each in (values, true)]
        assert whole[0] == pytest.approx(whole[1], rel=0.01), name
    q = clean.q.copy()
    q[:, 1] = np.nan
    fit = identify(clean._replace(q=q), robot)
    assert {"K_f0[2]", "K_w0[2]"} <= set(fit.held) and "joint 2," in fit.advice[0]
    assert not fit.deformation_error[:, 1].any() and np.isfinite(fit.deviation).all()
    values, true = named(fit, robot)
    # as without link positions at all; what both encoders see of joint 1 is as in the log without noise
    for name in ("f_c[1]", "f_s[2]", "mx2", "Izz2", "Izz1 + 0.25 m2", "I_m[1]"):
        assert values[name] == pytest.approx(true[name], rel=0.01), name
    assert fit.stiffness[0] == pytest.approx(true_stiffness(robot, fit)[0], rel=0.01)
    assert values["K_f0[2]"] == robot.K_f0[1]


@pytest.mark.heavy
def test_what_a_motion_cannot_tell_is_near_the_robot_file_with_the_fix(clean, robot, guess):
    fit = identify(noisy(clean, robot, 1), guess)
    assert {"c_f[2]"} <= set(fit.weak) and not fit.held
    place = fit.names.index("c_f[2]")
    # the robot file may be off by 100 %, of which this log leaves at least 70
    assert fit.deviation[place] > 0.7 * fit.values[place] and abs(fit.values[place] / guess.c_f[1] - 1.0) < 0.7
    assert fit.weak["c_f[2]"].advice == "use encoders with a finer resolution" and fit.weak["c_f[2]"].share > 0.7


@pytest.mark.heavy
def test_the_command_writes_a_robot_that_says_where_it_is_from(clean, robot, guess, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "guess.toml").write_text(robot_text(guess, "a guess"))
    log = noisy(clean, robot, 2)
    columns = np.column_stack([log.t, np.rad2deg(log.kappa), log.q, log.tau * robot.ell])
    names = "stamp,m_1 [deg],m_2 [deg],q[1] [rad],q[2] [rad],tau_link[1] [N.m],tau_link[2] [N.m]"
    np.savetxt("log.csv", columns, delimiter=",", header=names, comments="", fmt="%.12g")
    words = ["identify", "log.csv", "--robot", "./guess.toml", "--column", "kappa=m_{}"]
    said = ran(*words, "-o", "found.toml", "--plot", "found.png")
    assert (tmp_path / "found.png").read_bytes().startswith(b"\x89PNG")
    assert "note: times are those of stamp, in s" in said.output
    fit = identify(log, guess)
    assert all(f"{v:.5g}" in said.output for v in fit.values[:2])
    made = vdfmu.load_robot(tmp_path / "found.toml")
    np.testing.assert_allclose(made.I_m, fit.values[:2], rtol=1e-6)
    assert made.source_of("joints[1].drive.I_m").startswith("Identified from log.csv, +- ")
    assert made.source_of("joints[1].drive.ell") == robot.source_of("joints[1].drive.ell")
    # the links that it writes have the base parameters
    wanted = fit.values[fit.links]
    np.testing.assert_allclose(fit.base.matrix @ body_parameters(made), wanted, atol=1e-6)
    again, notes = identified_robot(fit, guess, "log")
    assert not notes and np.all(np.linalg.eigvalsh(again.inertia) > 0)


@pytest.mark.heavy
def test_a_score_needs_the_encoders_of_the_fit_and_torques_that_do_not_fit_are_said(clean, exact, robot):
    bare = clean._replace(q=None, where="bare")
    words = r"expected a log with(out)? encoders behind the gears, as in .*, got one with"
    for fit, scored, other in ((exact, clean, bare), (identify(bare, robot), bare, clean)):
        with pytest.raises(UsageError, match=words):
            score(fit, robot, scored, other)
    rated = score(exact, robot, clean, clean)
    # the log that was fitted leaves what the fit left: sums in another order
    np.testing.assert_allclose(rated.torque_error, exact.torque_error, rtol=1e-9, atol=1e-12)
    assert np.all(rated.torque_left < 0.01 * rated.torque) and np.all(rated.rigid_left > rated.torque_left)
    reversed_log = thinned(clean._replace(tau=-clean.tau), 2)
    backward = identify(reversed_log, robot)
    judged = verdict(backward, (), robot, score(backward, robot, reversed_log, reversed_log))
    assert judged["state"] == FAILED and "has a residual of" in judged["headline"]
    assert exact.advice == []


def test_arrays_of_a_matlab_file_are_read_by_their_names(tmp_path):
    """As the archive of the KUKA KR300 has them: arrays (6, m), degrees, N.m, 250 Hz; for training 10 Hz."""
    robot, random = vdfmu.load_robot("manipulator_6dof"), np.random.default_rng(0)
    motor, links, tau = random.normal(size=(3, 6, 600))
    t = 0.004 * np.arange(600)
    path = tmp_path / "recording_2021_12_15_20H_45M.mat"
    scipy.io.savemat(path, {"time": t[None], "q_mot_meas": motor, "q_se_meas": links, "tau_meas": tau, "q_ref": motor})
    columns = {"kappa": "q_mot_meas[{}] [deg]", "q": "q_se_meas[{}] [deg]", "tau_link": "tau_meas[{}]"}
    log = read_log(path, robot, columns)
    np.testing.assert_allclose(log.kappa, np.deg2rad(motor.T), rtol=1e-15)
    np.testing.assert_allclose(log.q, np.deg2rad(links.T), rtol=1e-15)
    np.testing.assert_allclose(log.tau * robot.ell, tau.T, rtol=1e-14)
    np.testing.assert_array_equal(log.t, t)
    path = tmp_path / "forward_identification_without_raw_data.mat"
    scipy.io.savemat(path, {"time_train": 0.1 * np.arange(600)[None], "y_train": motor, "u_train": tau})
    log = read_log(path, robot, {"kappa": "y_train[{}] [deg]", "tau_link": "u_train[{}]"})
    assert log.q is None and log.step == pytest.approx(0.1)
    scipy.io.savemat(tmp_path / "other.mat", {"x": t})
    with pytest.raises(UsageError, match="expected a column time; there are x. Name it by --time"):
        read_log(tmp_path / "other.mat", robot)


def write(path, t, columns, names):
    np.savetxt(path, np.column_stack([t, *columns]), delimiter=",", header=f"time,{names}", comments="")
    return path


def test_columns_of_a_log_may_have_the_names_of_joints(tmp_path, robot):
    named = dataclasses.replace(robot, joint_names=("lift", "elbow"))
    t = 0.001 * np.arange(600)
    y = [np.sin(k * t) for k in (1, 2, 3, 4)]
    plain = read_log(write(tmp_path / "a.csv", t, y, "kappa[1],kappa[2],tau[1],tau[2]"), named)
    for names, columns in (
        ("kappa[lift],kappa[elbow],tau[lift],tau[elbow]", None),
        ("lift,elbow,lift_effort,elbow_effort", {"kappa": "{}", "tau": "{}_effort"}),
    ):
        log = read_log(write(tmp_path / "b.csv", t, y, names), named, columns)
        np.testing.assert_array_equal(log.kappa, plain.kappa)
        np.testing.assert_array_equal(log.tau, plain.tau)


@pytest.mark.heavy
def test_columns_motions_and_options_that_do_not_fit_are_named(tmp_path, robot, clean):
    path, t = tmp_path / "log.csv", 0.001 * np.arange(600)
    y = [np.sin(t)] * 4
    names = "kappa[1],kappa[2],tau[1],tau[2]"
    write(path, t, y, names)
    alike, still, none = np.column_stack([np.sin(t)] * 2), np.column_stack([np.sin(t), 0 * t]), np.zeros((600, 2))
    for call, message in (
        (lambda: read_log(path, robot, {"q": "p{}"}), r"q: expected columns p1, p2; there are kappa\[1\]"),
        (lambda: read_log(path, robot, {"speed": "v{}"}), "columns: speed: expected some of kappa, theta"),
        (lambda: read_log(path, robot, {"q": "p"}), "columns: q=p: expected a name with {} for the joint"),
        (lambda: read_log(path, robot, {"q": "{x}{}"}), "q: expected columns {x}1, {x}2"),
        (lambda: identify(Log("log", t, still, none, None), robot), "joint 2 did not move"),
        (lambda: identify(Log("log", t, alike, none, still), robot), "log: joint 2: expected rotors, .* move alike"),
        (
            lambda: identify(Log("log", t, alike, none, None), robot, band=0.3),
            "expected a log of at least .* s for the band of",
        ),
        *((lambda band=b: identify(clean, robot, band=band), "band: expected more than 0 Hz") for b in (0, -1, np.nan)),
        (
            lambda: identify(clean, dataclasses.replace(robot, friction="split")),
            "expected friction in the lumped arrangement, got split",
        ),
    ):
        with pytest.raises(UsageError, match=message):
            call()


def test_intervals_hold_the_truth_as_often_as_they_say():
    """Of estimates with normal errors of the deviations that they state, 95 % of the intervals hold the truth."""
    dice, count = np.random.default_rng(7), 20_000
    truth, deviation = dice.uniform(-1.0, 1.0, count), dice.uniform(0.1, 1.0, count)
    estimates = SimpleNamespace(values=truth + deviation * dice.standard_normal(count), deviation=deviation)
    low, high = Identified.interval(estimates)
    held = np.mean((low <= truth) & (truth <= high))
    assert held == pytest.approx(0.95, abs=5.0 * np.sqrt(0.95 * 0.05 / count))  # five deviations of the share
