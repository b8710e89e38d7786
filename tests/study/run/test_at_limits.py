"""Shares of the time at limits of torque, speed and travel, and the torque that motors give."""

import dataclasses
import re

import numpy as np
import pytest

import vdfmu
from tests.conftest import heavy, ran
from vdfmu.arm.robot import load_robot
from vdfmu.engine.results.results import Results, Signal
from vdfmu.study.report.sheets import limits_sheet, sheets
from vdfmu.study.run.summary import ArmLimits, limits_of, time_at_limits, tracking_errors
from vdfmu.system.package.description import SystemDescription
from vdfmu.system.scenario import load_scenario
from vdfmu.system.scenario.values import system_values

TAU_STALL, NO_LOAD, FULL_SPEED = 10.0, 4.0, 0.5
# torque asked for, speed, position; torque given; the limit that it is at, from the law's definition
ROWS = [
    (5.0, 1.0, 0.0, 5.0, ""), (20.0, 1.0, 0.0, 10.0, "torque"),
    (20.0, 2.0, 0.0, 10.0, "torque"),  # the corner
    (20.0, 3.0, 0.0, 5.0, "speed"),  # half-way down the line
    (5.0, 3.0, 0.0, 5.0, ""), (1.0, 4.5, 0.0, 0.0, "speed"),
    (-20.0, 4.5, 0.0, -10.0, "torque"),  # brakes
    (-3.0, 1.0, 1.2, -3.0, "stop"), (-3.0, 1.0, -1.1, -3.0, "stop"),
]  # fmt: skip


@pytest.fixture(scope="module")
def limited():
    robot = load_robot("panda_7dof")
    names = ("q_min", "q_max", "stop_stiffness", "stop_damping", "tau_stall", "kappa_dot_max", "full_speed")
    numbers = (-1.0, 1.0, 1e4, 0.5, TAU_STALL, NO_LOAD, FULL_SPEED)
    assert robot.limits
    return dataclasses.replace(robot, **{n: np.full(robot.n, x) for n, x in zip(names, numbers, strict=True)})


@pytest.fixture(scope="module")
def limits(limited):
    return ArmLimits("plant", limited, np.full(limited.n, np.inf), "plant.tau")


def recorded(rows, n, times, **more):
    """Return results of an arm whose first joint does what the rows say, and whose others rest."""
    columns = {f"{name.replace('_of_', '.')}[1]": values for name, values in more.items()}
    columns |= {f"plant.{name}[1]": [row[k] for row in rows] for k, name in enumerate(("tau", "kappa_dot", "q"))}
    names = [f"{name[:-2]}{i + 1}]" for name in columns for i in range(n)]
    data = np.zeros((len(rows), len(names)))
    data[:, ::n] = np.array(list(columns.values())).T
    signals = [Signal(name, "real", "", k) for k, name in enumerate(names)]
    return Results(np.array(times, dtype=float), signals, {"real": data})


@pytest.mark.parametrize("row", ROWS)
def test_each_row_is_at_its_limit_and_gets_its_torque(limited, limits, row):
    tau, speed, _, torque, limit = row
    assert limits.delivered(np.full((1, limited.n), tau), np.full((1, limited.n), speed))[0, 0] == pytest.approx(torque)
    shares_by_limit = time_at_limits(recorded([row[:3]] * 2, limited.n, [0.0, 1.0]), [limits])["limits"]["plant"]
    first = {key: shares[0] for key, shares in shares_by_limit.items()}
    assert first == {key: float(key == limit) for key in ("torque", "speed", "stop")}
    assert all(not any(shares[1:]) for shares in shares_by_limit.values())


def test_a_row_counts_with_the_length_of_its_step_and_the_largest_share_has_its_place(limited, limits):
    rows = [(20.0, 1.0, 0.0), (20.0, 1.0, 0.0), (5.0, 1.0, 0.0), (5.0, 4.5, 2.0)]
    shares = time_at_limits(recorded(rows, limited.n, [0.0, 1.0, 3.0, 10.0]), [limits])["limits"]["plant"]
    np.testing.assert_allclose([shares[key][0] for key in ("torque", "speed", "stop")], [0.1, 0.7, 0.7], rtol=1e-14)
    rows = [(5.0, 1.0, 0.0), (20.0, 1.0, 0.0), (5.0, 1.0, 0.0), (20.0, 1.0, 0.0)]
    figures = time_at_limits(recorded(rows, limited.n, [0.0, 1.0, 4.0, 10.0]), [limits])["key_figures"]
    assert figures == {"saturated": {"value": 0.7, "place": "torque limit of joint 1", "at_s": 1.0}}
    brief = recorded(rows[:3], limited.n, [0.0, 0.9, 100.0])  # 0.9 %, which the table shows as 1: 0.01 is the limit
    assert "limits" in time_at_limits(brief, [limits]) and "key_figures" not in time_at_limits(brief, [limits])


@pytest.mark.few(1)
@pytest.mark.parametrize(("tau_max", "code", "line"), [
    (0.08, 1, r"✗ Failed: tool off its path by 1\.2 m, 72\.3 % of the motion, at 2 s \(limit 50 %\)"),
    *heavy((0.1, 0, r"! Doubtful: torque limit of joint 1 for 48\.9 % of the run, from 0\.767 s on \(limit 1 %\)")),
    (0.112, 0, r"! Doubtful: torque limit of joint 1 for 10\.3 % of the run, from 0\.914 s on \(limit 1 %\)"),
])  # fmt: skip
def test_a_run_at_its_torque_limit_says_so_first_and_has_a_page_with_sliders(tmp_path, tau_max, code, line):
    options = ["--set", f"controller.tau_max={tau_max}", "--no-reference", "--out", str(tmp_path / "run")]
    done = ran("run", "planar_tracking", *options, code=code)
    verdict, *_, last = done.stdout.splitlines()
    assert len(done.stdout.splitlines()) <= 21
    assert re.match(line, verdict) and last == f"Open {tmp_path / 'run' / 'report.html'}"
    page = (tmp_path / "run" / "report.html").read_text()
    assert f'<p class="verdict {"failed" if code else "doubtful"}" data-run="0">' in page
    assert '"sliders"' in page and "<span>Time at a limit</span>" in page


def test_a_controller_that_cuts_its_torque_is_at_the_torque_limit(tmp_path):
    settings = {"controller.tau_max": 1.0, "plant.q_0[1]": -1.0}
    results = vdfmu.run("planar_tracking", stop=0.1, parameters=settings, out=tmp_path, reference=False)
    shares = results.summary["limits"]["plant"]
    cut = np.abs(results["controller.tau"][1:]) == 1.0  # of its clip, to the bit
    np.testing.assert_allclose(shares["torque"], cut.mean(axis=0), rtol=1e-12)
    assert cut[:, 0].mean() > 0.5 and not any(shares["stop"]) and not any(shares["speed"])
    sheet = limits_sheet(results.summary)
    assert sheet in sheets(results.summary)
    assert float(sheet.rows[0][1]) == pytest.approx(100.0 * cut[:, 0].mean(), abs=0.5)
    assert sheet.title in (tmp_path / "report.html").read_text()


@pytest.mark.heavy
def test_a_run_away_from_its_limits_has_no_table_and_its_values_are_those_of_the_motor(planar_run):
    assert "limits" not in planar_run[1].summary
    rests = {"plant": dict.fromkeys(("torque", "speed", "stop"), [0.0, 0.0])}
    assert sheets({"limits": rests}) == [] != sheets({"limits": {"plant": rests["plant"] | {"speed": [0.0, 0.1]}}})
    scenario = load_scenario("tracking", load_robot("ur5e_6dof"))
    (plain,) = limits_of(SystemDescription(scenario))
    changed = system_values(scenario, {"plant.tau_stall[2]": 0.1, "controller.tau_max[3]": 0.2})
    (weaker,) = limits_of(SystemDescription(scenario, changed))
    assert plain.robot.tau_stall[1] == load_robot("ur5e_6dof").tau_stall[1] != weaker.robot.tau_stall[1] == 0.1
    assert weaker.tau_max[2] == 0.2 and weaker.tau_max[1] == plain.tau_max[1]


def test_the_compensation_torque_is_what_the_motors_gave(limited, limits):
    rows = [(20.0, 1.0, 0.0), (20.0, 3.0, 0.0)]
    more = {"trajectory_of_q_d": [0.0, 0.0], "controller_of_tau": [20.0, 20.0], "feedforward_of_tau_m": [1.0, 1.0]}
    results = recorded(rows, limited.n, [0.0, 1.0], **more)
    error = tracking_errors(results, limited, [limits])["rms_torque_compensation_error_nm"]
    assert error[0] == pytest.approx(limited.ell[0] * np.sqrt((9.0**2 + 4.0**2) / 2))
    asked = tracking_errors(results, limited)["rms_torque_compensation_error_nm"]
    assert asked[0] == pytest.approx(limited.ell[0] * 19.0)
