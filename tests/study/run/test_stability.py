"""The verdict on the loops of a run: linearised at poses of it, against what simulations do."""

import json
import math
import re

import numpy as np
import pytest

import vdfmu
from tests.conftest import ran
from tests.engine.system_loops import system_loop
from vdfmu.base.errors import CosimError
from vdfmu.engine.linear.growth import Growth, Poses
from vdfmu.engine.linear.loops import fastest_mode
from vdfmu.engine.results.verdict import checks_of, headline_of
from vdfmu.engine.run import Simulator
from vdfmu.study.analysis.arm_space import linearized, packaged
from vdfmu.study.analysis.loops import TIED, margins_along
from vdfmu.study.run.prepare import prepare

SLOW = '''
from vdfmu.unit import JOINTS, Input, Output, Parameter, Sampled, Unit


class SlowPd(Unit):
    """PD controller that samples every 3 ms."""

    q_d = Input("position", JOINTS, "desired position")
    q = Input("position", JOINTS, "position")
    kappa_dot = Input("velocity", JOINTS, "velocity of the rotor")
    tau_m = Input("N.m", JOINTS, "feedforward torque")
    tau = Output("N.m", JOINTS, "torque")
    K = Parameter("N.m", JOINTS, "gain of the position", start=10.0)
    D = Parameter("N.m.s", JOINTS, "gain of the velocity", start=0.4)
    period = Parameter("s", text="time between samples", start=3e-3, minimum=1e-6)
    held = Sampled("N.m", JOINTS, "torque until the next sample")

    def update(self) -> None:
        self.held = self.tau_m + self.K * (self.q_d - self.q) - self.D * self.kappa_dot

    def outputs(self) -> None:
        self.tau = self.held
'''


def checks(results):
    return {check.key: check for check in checks_of(results.summary)}


def run(name, **options):
    return vdfmu.run(name, reference=False, out=False, **options)


@pytest.mark.heavy
def test_a_limit_cycle_fails_with_its_joint_and_the_run_is_written(tmp_path):
    out = tmp_path / "run"
    done = ran(
        "run", "tracking", "--stop", "0.3", "--no-reference", "--set", "controller.K_p=20000", "--out", out, code=1
    )
    assert "✗ failed     Unstable from the start, joint 5" in done.output and "Written to" in done.output
    assert done.stdout.startswith("✗ Failed: unstable from the start, joint 5\n")
    assert '<li class="failed"><b>failed</b> Unstable from the start' in (out / "report.html").read_text()
    verdict = json.loads((out / "summary.json").read_text())["verdict"]
    assert verdict["state"] == verdict["checks"][0]["state"] == "failed"


@pytest.mark.heavy
def test_another_gain_end_or_master_has_loops_of_its_own():
    def margin(**options):
        return run("planar_tracking", **({"stop": 0.02} | options)).summary["key_figures"]["margin"]

    first = margin()
    changes = ({"stop": 0.03}, {"algorithm": "jacobi"}, {"parameters": {"controller.K_v": 35.0}})
    assert all(margin(**change) != first for change in changes)
    assert margin() == first  # from the cache


@pytest.mark.heavy
def test_stick_slip_is_unstable_though_the_fast_part_of_the_motion_is_not():
    """Too little damping for friction that falls with speed: the motor of joint 6 sticks and slips at both ends."""
    settings = {"trajectory.T": 4.0, "controller.K_v[6]": 2.0}
    results = run("tracking", stop=4.0, parameters=settings)
    check = checks(results)["stability"]
    assert check.state == "failed" and "joint 6" in check.sentence
    turns = np.abs(np.diff(results["plant.kappa_dot"], 2, axis=0))
    # rows of 1 ms at accelerations of some m/s2 that change over 1 s: 1e-5 rad/s; stick-slip within 0.1 s: 1e-4
    chatter = np.median(turns[:3980].reshape(-1, 20, 6), axis=1).max(axis=0)
    assert chatter.argmax() == 5 and chatter[5] > 1e-4


def nudged(scenario, settings, move, **options):
    """Return the rate of the fastest mode, its state, and the rate at which a small disturbance of a run grows."""
    settings = {f"plant.{name}[{i}]": 0.0 for name in ("f_c", "f_s") for i in (1, 2)} | settings
    settings |= {"trajectory.q_end": [-1.5707963267948966, 0.0]}
    with packaged(scenario, settings) as (package, made):
        with Simulator(package, isolate=False, **(made | options)) as simulator:
            simulator.run(stop=0.02, taps=[poses := Poses("tau", TIED)])
            rate, state = fastest_mode(poses.loops.part(poses.loops.rows[0].matrix))
            runs = [
                simulator.run(stop=0.15, parameters={"plant.q_dot_0[1]": start})["plant.kappa_dot"][:, 0]
                for start in (0.0, move)
            ]
    assert not poses.lacking and rate > 10.0
    nudge = np.abs(runs[1] - runs[0])
    first, last = (np.log(nudge[a : a + 30].max()) for a in (60, 120))
    return rate, state, (last - first) / 0.06


def test_the_rate_of_a_loop_and_of_a_slow_controller_is_that_of_a_nudge(tmp_path):
    rate, state, grown = nudged("planar_tracking", {"controller.K_v[1]": 2.4 * 40.0}, 1e-3, algorithm="jacobi")
    assert state == "plant.kappa_dot[1]"
    # the next mode decays with 20 1/s: 30 % of its start is left in the first window, a third of it in the last; the
    # nonlinear spring adds some per cent
    assert grown == pytest.approx(rate, rel=0.2)
    # Samples of 3 ms under steps of 1 ms: the run is judged at the period of the samples.
    (tmp_path / "slow.py").write_text(SLOW)
    slow = prepare("planar_tracking", units={"controller": str(tmp_path / "slow.py")})
    rate, state, grown = nudged(slow, {"controller.D[1]": 0.65}, 1e-5)
    assert state.endswith("kappa_dot[1]")
    # the next mode decays with 25 1/s: 0.2 of its start is left in the first window beside a growth by e**2, 3 %
    assert grown == pytest.approx(rate, rel=0.03)
    results = run(slow, stop=0.15, parameters={"controller.D": 0.65})
    assert re.match(r"Failed: unstable from 0\.0\d+ s on, joint 1", headline_of(results.summary))


@pytest.mark.heavy
def test_springs_that_are_loaded_fast_are_not_a_growth():
    """Far from the desired position springs that stiffen swing by hundreds of N.m; the loop is stable all the same."""
    with packaged("planar_tracking") as (package, options):
        with Simulator(package, isolate=False, **options) as simulator:
            runs = [
                simulator.run(
                    stop=0.2,
                    parameters={"plant.q_0[1]": -1.0 + nudge, "plant.q_0[2]": 0.0},
                    taps=[poses := Poses("tau", TIED)],
                )
                for nudge in (0.0, 1e-6)
            ]
    apart = np.abs(runs[1]["plant.q"] - runs[0]["plant.q"]).max(axis=1)
    # the loop's rates K_p / K_v are 37 1/s and 25 1/s: e**-5 is left after 0.2 s; a growth would leave more than all
    assert apart[-1] < 0.1 * apart[0]
    assert np.abs(runs[0]["plant.tau_s"]).max() > 100.0
    # but for some milliseconds, in which the springs turn faster than the loop
    growth = poses.loops.growth(0.0, 0.2, 0.0)
    assert growth.exponent < np.log(1.05) and growth.end < 0.005
    times = [0.005, 0.02, 0.05]  # margins says the same of the same loop
    start = {"plant.q_0[1]": -1.0, "plant.q_0[2]": 0.0}
    along = margins_along("planar_tracking", at=times, parameters=start)
    assert all(each.rate < 0.0 for each in along.margins)
    plain = [linearized("planar_tracking", t, parameters=start) for t in times]
    assert max(system_loop(linear, ["plant.tau"]).rate for linear in plain) > 0.0  # with the torques as states


def test_a_run_that_fails_says_that_its_loop_is_unstable(tmp_path):
    with pytest.raises(CosimError) as raised:
        vdfmu.run("planar_tracking", reference=False, out=tmp_path / "run", parameters={"controller.K_v": 400})
    assert any("Stability: Unstable from the start, joint 1" in note for note in raised.value.__notes__)
    summary = json.loads((tmp_path / "run" / "partial" / "summary.json").read_text())
    assert [check["name"] for check in summary["verdict"]["checks"]] == ["Stability", "Runs to its end"]
    assert headline_of(summary) == "Failed: unstable from the start, joint 1"
    assert checks_of(summary)[1].more == str(raised.value)


@pytest.mark.heavy
def test_friction_that_excites_itself_is_doubtful_and_python_fmus_are_judged_by_their_native_twins():
    split = run("tracking_split", stop=1.0)
    assert checks(split)["friction"].state == "doubtful" and checks(split)["stability"].state == "good"
    assert headline_of(split.summary).startswith("Doubtful: friction-induced oscillation, growing fastest at joint ")
    native, python = (run("planar_tracking", stop=0.05, backend=backend) for backend in ("native", "python"))
    assert checks(python)["margin"] == checks(native)["margin"] and checks(python)["margin"].state == "good"


@pytest.mark.heavy
def test_a_system_of_a_scenario_has_the_verdict_of_its_run(tmp_path):
    """Made when the summary is asked for: with the values and the end of that run, by the same checks."""
    whole = run("planar_tracking", stop=0.1, parameters={"controller.K_v": 30.0})
    results = vdfmu.load("planar_tracking").run(stop=0.1, parameters={"controller.K_v": 30.0})
    ours, theirs = (each.summary["verdict"] for each in (results, whole))
    assert (ours["state"], ours["headline"], ours["results"]) == (
        theirs["state"],
        theirs["headline"],
        theirs["results"],
    )
    assert [c["key"] for c in ours["checks"]] == [c["key"] for c in theirs["checks"]]
    solved = vdfmu.load("planar_tracking").run(stop=0.1, reference=True).summary["verdict"]
    assert next(check for check in solved["checks"] if check["key"] == "reference")["state"] == "good"


@pytest.mark.few(1)
@pytest.mark.parametrize(("settings", "headline"), [
    ({"controller.K_p": 0.0, "controller.K_v": 0.0}, "Doubtful: nothing is fed back to joint 1"),
    # 97 % of the gain that is unstable (verdict on the edge of stability: its modulus margin is below 0.01)
    ({"controller.K_p": [9288.0, 2376.0], "controller.K_v": [197.46, 29.26]}, "Doubtful: modulus margin 4."),
    ({"trajectory.T": 20.0}, "Doubtful: the motion of 20 s is cut at 2 s"),
])  # fmt: skip
def test_a_loop_at_its_edge_without_feedback_or_a_motion_that_was_cut_is_doubtful(settings, headline):
    results = run("planar_tracking", parameters=settings)
    assert headline_of(results.summary).startswith(headline)


def test_an_end_that_the_user_chose_is_said_and_no_fault():
    results = run("planar_tracking", stop=0.05)
    assert results.summary["verdict"]["state"] == "good"
    assert "stopped at 0.05 s of a motion of 2 s" in results.summary["verdict"]["results"]


@pytest.mark.parametrize(
    ("factor", "lasts", "unstable"),
    [(49.0, False, False), (51.0, False, True), (2.71, True, False), (2.72, True, True)],
)
def test_disturbances_may_grow_50_fold_for_a_while_and_e_fold_until_the_end(factor, lasts, unstable):
    assert Growth(math.log(factor), 0.0, 1.0, 1.0, "plant.q[1]", lasts).unstable is unstable
