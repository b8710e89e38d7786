"""Logs in the files of other tools, joints with and without an encoder behind the gear, and the faults of logs."""

import re

import numpy as np
import pyarrow as pa
import pyarrow.parquet
import pytest
import scipy.io
from scipy.interpolate import CubicSpline

from tests.extras.identify.recorded import STEP, M, T, motion
from vdfmu.arm.robot import load_robot
from vdfmu.base.errors import UsageError
from vdfmu.engine.results.verdict import FAILED
from vdfmu.engine.run import Results, Signal
from vdfmu.extras.identify.excitation import multisine
from vdfmu.extras.identify.log import read_log
from vdfmu.extras.identify.motion_choice import exact_log


@pytest.fixture(scope="module")
def data(robot):
    return motion(robot, T)


def table(data, **other):
    arrays = dict(zip(("kappa", "q", "tau"), data, strict=False)) | other
    return {f"{name}[{i + 1}]": column for name, each in arrays.items() for i, column in enumerate(each.T)}


def write(path, columns, t=T, time="time"):
    np.savetxt(
        path, np.column_stack([t, *columns.values()]), delimiter=",", header=",".join([time, *columns]), comments="",
        fmt="%.17g",
    )  # fmt: skip
    return path


def same(log, data, rtol=1e-14):
    for mine, other in zip((log.kappa, log.q, log.tau), data, strict=True):
        np.testing.assert_allclose(mine, other, rtol=rtol, atol=1e-14)
    np.testing.assert_allclose(log.t - log.t[0], T, atol=1e-9)  # stamps are whole nanoseconds


def test_a_log_without_a_fault_is_taken_as_it_is(robot, data, tmp_path):
    log = read_log(write(tmp_path / "log.csv", table(data)), robot)
    for mine, other in zip((log.t, log.kappa, log.q, log.tau), (T, *data), strict=True):
        assert mine.tobytes() == np.ascontiguousarray(other).tobytes()
    assert log.notes == ()
    kappa, q, tau = (each[:, [0, 0]] for each in data)  # joints that move alike are not taken for each other
    assert read_log(write(tmp_path / "log.csv", table((kappa, q * [1, 1.001], tau))), robot).notes == ()


def test_a_csv_of_another_tool(robot, data, tmp_path):
    """Semicolons, decimal commas, text columns, own names, times in ms, units in brackets and in --column."""
    kappa, q, tau = data
    columns = [1e3 * T + 5e6, *np.rad2deg(kappa.T), *q.T, *(tau.T / -1.81)]
    rows = [";".join(["run 1", *(f"{x:.17g}".replace(".", ",") for x in row)]) for row in zip(*columns, strict=True)]
    head = "what;Timestamp (ms);A1 [deg];A2 [deg];se1;se2;I_1 [A];I_2 [A]"
    (tmp_path / "log.csv").write_text("\ufeff" + "\n".join([head, *rows]), encoding="utf-8")
    columns = {"kappa": "A{}", "q": "se{} [rad]", "tau": "I_{} [-1.81 N.m]"}
    log = read_log(tmp_path / "log.csv", robot, columns)
    same(log, data)
    assert log.notes == ("times are those of Timestamp, in ms",)
    same(read_log(tmp_path / "log.csv", robot, columns, time="Timestamp [ms]"), data)
    with pytest.raises(UsageError, match="expected a column clock; there are what, Timestamp, A1.* Name it by --time"):
        read_log(tmp_path / "log.csv", robot, columns, time="clock")
    with pytest.raises(UsageError, match=r"A1: expected the unit N.m or .*, got 'deg'"):
        read_log(tmp_path / "log.csv", robot, {**columns, "tau": "A{}"})


def test_joints_that_a_tool_counts_from_0(robot, data, tmp_path):
    """Columns between spaces, as RTDE of a UR has them."""
    columns = {f"{name}_{i}": each[:, i] for name, each in zip(("p", "q", "i"), data, strict=True) for i in (0, 1)}
    path = tmp_path / "log.csv"
    np.savetxt(path, np.column_stack([T, *columns.values()]), header=" ".join(["time", *columns]), comments="")
    log = read_log(path, robot, {"kappa": "p_{}", "q": "q_{}", "tau": "i_{}"})
    same(log, data)
    assert log.notes[1] == "q: joint 1 is q_0: counted from 0" and len(log.notes) == 3


def test_a_matlab_file(robot, data, tmp_path):
    """With a row for each joint in a struct."""
    kappa, q, tau = data
    rec = {"t": T, "pos_deg": np.rad2deg(kappa.T), "se": q.T, "torque": tau.T, "name": "x", "n": 2.0}
    scipy.io.savemat(tmp_path / "log.mat", {"rec": rec})
    columns = {"kappa": "rec.pos_deg[{}] [deg]", "q": "rec.se[{}]", "tau": "rec.torque[{}]"}
    log = read_log(tmp_path / "log.mat", robot, columns)
    same(log, data)
    assert log.notes == ("times are those of rec.t, in s",)
    (tmp_path / "log.mat").write_bytes((tmp_path / "log.mat").read_bytes()[:400])
    with pytest.raises(UsageError, match="expected a MATLAB file, got unreadable content"):
        read_log(tmp_path / "log.mat", robot)


def test_a_parquet_file_of_another_tool(robot, data, tmp_path):
    stamps = np.datetime64("2026-01-01T00:00:00", "ns") + np.rint(T * 1e9).astype("timedelta64[ns]")
    columns = {name.replace("kappa", "m"): column for name, column in table(data).items()}
    pa.parquet.write_table(pa.table({"stamp": stamps, "who": ["x"] * M, **columns}), tmp_path / "log.parquet")
    log = read_log(tmp_path / "log.parquet", robot, {"kappa": "m[{}]"})
    same(log, data)
    assert log.notes == ("ignored: who (string)", "times are those of stamp, in ns")


@pytest.mark.parametrize("form", ["csv", "parquet", "mat"])
def test_results_of_a_run_are_logs_in_every_form(robot, data, tmp_path, form):
    signals = [
        Signal(f"plant.{name}", "real", "N.m" if name[0] == "t" else "rad", i) for i, name in enumerate(table(data))
    ]
    Results(T, signals, {"real": np.hstack(data)}).write(tmp_path / f"log.{form}")
    log = read_log(tmp_path / f"log.{form}", robot)
    for mine, other in zip((log.t, log.kappa, log.q, log.tau), (T, *data), strict=True):
        np.testing.assert_array_equal(mine, other)
    assert log.notes == ()


def test_joints_without_an_encoder_behind_the_gear_have_nan(robot, data, tmp_path):
    """By a column that is not there, one without numbers, and one that stands still while the rotor moves."""
    columns = table(data)
    for name, logged in (
        ("missing or without", {k: v for k, v in columns.items() if k != "q[2]"}),
        ("missing or without", {**columns, "q[2]": np.full(M, np.nan)}),
        ("q[2]: the same in all rows", {**columns, "q[2]": np.full(M, 0.25)}),
    ):
        log = read_log(write(tmp_path / "log.csv", logged), robot)
        np.testing.assert_array_equal(np.isfinite(log.q).all(axis=0), [True, False])
        np.testing.assert_array_equal(log.q[:, 0], data[1][:, 0])
        (note,) = log.notes
        assert "q[2]" in note and name in note and "without an encoder" in note
    none = {k: v for k, v in columns.items() if k[0] != "q"} | {f"q[{i}]": np.zeros(M) for i in (1, 2)}
    assert read_log(write(tmp_path / "log.csv", none), robot).q is None


def test_wrapped_angles_are_joined_and_said(robot, data, tmp_path):
    kappa, q, tau = data
    theta = (kappa * robot.ell + np.pi) % (2 * np.pi) - np.pi
    columns = table((theta, (q + 1.0) % (2 * np.pi), tau))
    columns = {name.replace("kappa", "theta"): column for name, column in columns.items()}
    # 4.4 rad/s times 100 is 1.8 rad in 4 ms, less than 0.4 turns
    log = read_log(write(tmp_path / "log.csv", columns), robot)
    for mine, other in ((log.kappa, kappa), (log.q, q)):
        np.testing.assert_allclose(mine - mine[0], other - other[0], atol=1e-12)
    assert re.match(
        r"theta\[1\]: wrapped \d+ times, first in row \d+: unwrapped with a period of 6.28319 rad", log.notes[0]
    )
    assert any(note.startswith("q[1]: wrapped") for note in log.notes)


def resampled(robot, data, path, t, columns):
    log = read_log(write(path, columns, t), robot)
    return log, np.abs(log.kappa - CubicSpline(T, data[0])(log.t)).max()


def test_missing_samples_are_bridged_as_far_as_the_motion_allows(robot, data, tmp_path):
    left = np.delete(np.arange(M), [300, 301, 302, 900])
    log, error = resampled(robot, data, tmp_path / "log.csv", T[left], table([x[left] for x in data]))
    # over 16 ms: (2 pi 0.9 16e-3)^4 / 384 of 1.2 rad is 2e-7; the neighbours' steps differ, so some times more
    assert error < 2e-6 and len(log.t) == M
    (note,) = log.notes
    assert "times are uneven, steps of 4 to 16 ms, 2 gaps: resampled every 4 ms by cubic splines" in note
    left = np.delete(np.arange(M), np.arange(300, 400))
    with pytest.raises(UsageError, match=r"kappa\[1\], row 300: .* from 1.196 s to 1.6 s there is a gap, and 0 more"):
        resampled(robot, data, tmp_path / "log.csv", T[left], table([x[left] for x in data]))


def test_a_clock_that_jitters_is_told_from_samples_that_do(robot, data, tmp_path):
    random = np.random.default_rng(0)
    t = T + 0.2 * STEP * random.uniform(-1, 1, M)
    log, error = resampled(robot, data, tmp_path / "log.csv", t, table(data))
    assert "the clock jitters by up to 0.8" in log.notes[0] and "this even spacing is used" in log.notes[0]
    # the line through the times: their deviation 0.12 h over sqrt(m) twice, at its ends, at 6 rad/s: 7e-5 rad
    assert error < 1.5e-4
    log, error = resampled(robot, data, tmp_path / "log.csv", t, table(motion(robot, t)))
    assert error < 1e-7 and len(log.notes) == 1 and "by cubic splines" in log.notes[0]
    bursts = np.maximum.accumulate(T + random.choice([0.0, 6 * STEP], M, p=[0.8, 0.2])) + 1e-6 * np.arange(M)
    with pytest.raises(
        UsageError, match="the clock jitters by up to .* Log the time of the sample, not of its arrival"
    ):
        resampled(robot, data, tmp_path / "log.csv", bursts, table(data))


def test_faults_of_columns_are_refused_with_their_fix(robot, data, tmp_path):
    kappa, q, tau = data
    path = tmp_path / "log.csv"
    back = np.where(np.arange(M) == 700, T[698], T)
    for other, t, message in (
        ({"q": q[:, ::-1]}, T, r"q\[1\] moves with kappa\[2\], correlation 1.000.*\n.*q\[2\] moves with kappa\[1\]"),
        ({"q": q * [1, -1]}, T, r"q\[2\] moves -1 times as far as kappa\[2\], expected 1: a sign differs: --column"),
        ({"q": np.rad2deg(q * 0.05), "kappa": kappa * 0.05}, T, r"q\[1\] moves 57.\d+ .* link positions look like"),
        ({"q": q * 0.05, "kappa": np.rad2deg(kappa * 0.05)}, T, r"q\[1\] moves 0.0174\d* .* rotor positions look like"),
        ({"kappa": kappa * robot.ell * 0.02, "q": q * 0.02}, T, "rotor positions do not look divided by .* theta"),
        ({"tau": tau * [1, 0]}, T, r"tau\[2\]: expected a measured torque, got 0 N.m in all rows"),
        ({}, back, r"row 701: time: expected .* more than the 2.796 s of the row before, got 2.792"),
        ({}, 1e3 * T, "expected a row every few ms, got one every 4 s: give the unit, --time"),
    ):
        with pytest.raises(UsageError, match=message):
            read_log(write(path, table(data, **other), t), robot)
    same(read_log(write(path, table(data), 1e3 * T), robot, time="time [ms]"), data)
    (check, *_) = read_log(write(path, table(data, q=0.9 * q)), robot).checks
    assert check.key == "ratio"
    assert "gear ratio of joint 1 is 111, not 100: the link moves 0.901 times as far" in check.sentence


def test_the_fix_is_one(robot, data, tmp_path):
    """Columns of single joints by name, with a sign; and what is named goes before what has a known name."""
    kappa, q, tau = data
    columns = table((kappa, q[:, ::-1] * [1, -1], tau * [1, -1])) | {"x_1": tau[:, 0], "x_2": tau[:, 1]}
    path = write(tmp_path / "log.csv", columns)
    names = {"q[1]": "q[2] [-1 rad]", "q[2]": "q[1]", "tau[2]": "tau[2] [-1 N.m]"}
    same(read_log(path, robot, names), data)
    log = read_log(path, robot, {**names, "tau_link": "x_{}"})
    np.testing.assert_array_equal(log.tau, tau / robot.ell)
    with pytest.raises(UsageError, match=r"columns: q\[3\]: expected some of kappa"):
        read_log(path, robot, {"q[3]": "x_1"})


def test_all_faults_are_named_at_once(robot, data, tmp_path):
    kappa, q, tau = data
    q = q[:, ::-1].copy()
    q[50:60, 0] = np.nan
    back = np.where(np.arange(M) == 700, T[698], T)
    with pytest.raises(UsageError) as caught:
        read_log(write(tmp_path / "log.csv", table((kappa, q, tau * [0, 1])), back), robot)
    lines = str(caught.value).splitlines()
    for line, start in zip(
        lines,
        ("q[1], row 51, 0.2 s: expected a finite number, got nan, and 9 more", "kappa[1], row 701: time", "tau[1]: exp",
         "q[1] moves with kappa[2]", "q[2] moves with kappa[1]"),
        strict=True,
    ):  # fmt: skip
        assert line.startswith(f"{tmp_path / 'log.csv'}: {start}")


@pytest.mark.filterwarnings("error")
def test_a_log_without_a_whole_row_has_its_sentences_alone(robot, data, tmp_path):
    kappa, q, tau = (each.copy() for each in data)
    q[::2, 0] = kappa[1::2, 1] = np.nan
    with pytest.raises(UsageError) as caught:
        read_log(write(tmp_path / "log.csv", table((kappa, q, tau))), robot)
    starts = [
        "q[1], row 1, 0 s: expected a finite number, got nan",
        "kappa[2], row 2, 0.004 s: expected a finite number",
    ]
    lines = str(caught.value).splitlines()
    assert len(lines) == 2 and all(any(start in line for line in lines) for start in starts)


@pytest.mark.few(1)
@pytest.mark.parametrize("amplitude", [0.3, 1.0])
@pytest.mark.parametrize("name", ["planar_2dof", "manipulator_6dof"])
def test_positions_in_degrees_are_named_with_and_without_links_and_torques_of_rotors_are_not(name, amplitude, tmp_path):
    """Headings say rad. Slow motions too, with speeds below the limit; torques of another size have their own cause."""
    arm = load_robot(name)
    sines = multisine([0.2] * arm.n, amplitude, [1, 2, 5, 9], period=12.0, phases="random")
    log, degree = exact_log(arm, sines, 0.01), np.rad2deg(1.0)
    for q in (log.q, None):
        encoders = {} if q is None else {"q": q}
        for unit, size, keys in ((degree, 1.0, ["degrees"]), (1.0, 1.0 / arm.ell, ["torque"]), (1.0, 1.0, [])):
            positions = {name: unit * each for name, each in {"kappa": log.kappa, **encoders}.items()}
            columns = table((), **positions, tau=size * log.tau)
            headed = {name if name[:3] == "tau" else f"{name} [rad]": column for name, column in columns.items()}
            path = write(tmp_path / "log.csv", headed, log.t)
            assert [check.key for check in read_log(path, arm).checks] == keys


def test_torques_that_fit_otherwise_are_failed_checks(robot, data, tmp_path):
    _, _, tau = data
    sign = "tau[1] has the opposite sign: its friction would drive the joint"
    for other, sentences in (
        (tau[:, ::-1], ["tau[1] fits joint 2 better than its own", "tau[2] fits joint 1 better than its own"]),
        (tau * [-1, 1], [sign]),
        (tau * robot.ell, ["torques are "]),
    ):
        checks = read_log(write(tmp_path / "log.csv", table(data, tau=other)), robot).checks
        assert len(checks) == len(sentences)
        assert all(c.sentence.startswith(start) for c, start in zip(checks, sentences, strict=True)), checks
        assert all(check.state == FAILED for check in checks)
